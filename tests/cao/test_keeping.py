"""Quotas for tags and parameters of commands."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given

from orinkit.cao import functions as f
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.quota import CLIENT_LIMIT, TOTAL_LIMIT, VALUE_LIMIT, ByteQuota, stored_size
from orinkit.cao.session import Session
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.values.codec import encode_variant
from orinkit.values.variant import Variant, variant
from support.devices import Recorder, Workshop
from support.strategies import variants

pytestmark = pytest.mark.core


def refused(call, *arguments):
    with pytest.raises(CallError) as caught:
        call(*arguments)
    return caught.value.code


@given(variants())
def test_the_size_is_that_in_a_packet(value):
    length = len(encode_variant(value)) - 4
    if length <= VALUE_LIMIT:
        assert length - 2 * astral(value) <= stored_size(value) <= length


def astral(value: Variant) -> int:
    """Characters of two UTF-16 units count as one character."""
    items = value.value if isinstance(value.value, list) else [value.value]
    return sum(
        sum(sign > "\uffff" for sign in item)
        if isinstance(item, str)
        else astral(item)
        if isinstance(item, Variant)
        else 0
        for item in items
    )


@pytest.mark.parametrize(
    "value",
    [bytes(VALUE_LIMIT), "x" * (VALUE_LIMIT // 2), [0.0] * (VALUE_LIMIT // 8), ["x"] * (VALUE_LIMIT // 6), [variant(1)] * (VALUE_LIMIT // 10 + 1),
     [[None] * 6000, [None] * 6000], [variant(None)] * 2_000_000],
)  # fmt: skip
def test_values_that_are_too_long(value):
    assert refused(stored_size, variant(value)) == hresult.E_TOO_MUCH_DATA
    i18n.use("ja")
    with pytest.raises(CallError, match="タグまたはコマンドのパラメータ"):
        stored_size(variant(value))


def test_quotas():
    total = ByteQuota(150)
    one, other = ByteQuota(100, total), ByteQuota(100, total)
    one.change(100)
    assert refused(one.change, 1) == hresult.E_OUTOFMEMORY
    other.change(50)
    assert refused(other.change, 1) == hresult.E_OUTOFMEMORY
    assert (one.bytes, other.bytes, total.bytes) == (100, 50, 150)
    one.change(-100)
    other.change(50)
    assert (one.bytes, other.bytes, total.bytes) == (0, 100, 100)


# --- in a session -----------------------------------------------------------------------------------------------------


def open_session(host):
    session = Session(host)
    session.invoke(3, [variant(text) for text in ("", "Test.Workshop", "localhost", "")])
    return session


def put_tag(session, handle, value):
    return session.invoke(f.variable_put_tag.id, [variant(handle), variant(value)]).code


def new_variable(session, number):
    return session.invoke(f.controller_get_variable.id, [variant(2), variant(f"v{number}"), variant("")]).result.value


def test_tags_of_a_client_are_bounded():
    """The attack: 60 tags of nearly a packet."""
    host = ProviderRegistry(Workshop())
    session = open_session(host)
    handles = [new_variable(session, number) for number in range(60)]
    assert {put_tag(session, handle, bytes(15_800_000)) for handle in handles} == {hresult.E_TOO_MUCH_DATA}
    codes = [put_tag(session, handle, bytes(60_000)) for handle in handles]
    fit = CLIENT_LIMIT // 60_006
    assert codes == [0] * fit + [hresult.E_OUTOFMEMORY] * (60 - fit)
    assert host.kept.bytes == fit * 60_006
    assert put_tag(session, handles[0], "another") == 0  # replaces the first one
    assert put_tag(session, handles[-1], bytes(60_000)) == 0
    session.invoke(f.variable_release.id, [variant(handles[1])])
    assert put_tag(session, handles[-2], bytes(60_000)) == 0
    session.close()
    assert host.kept.bytes == 0


def test_tags_of_all_clients_are_bounded():
    host = ProviderRegistry(Workshop())
    sessions = [open_session(host) for _ in range(20)]
    codes = []
    for session in sessions:
        handles = [new_variable(session, number) for number in range(17)]
        codes += [put_tag(session, handle, bytes(60_000)) for handle in handles]
    assert host.kept.bytes <= TOTAL_LIMIT
    assert codes.count(0) == TOTAL_LIMIT // 60_006
    for session in sessions:
        session.close()
    assert host.kept.bytes == 0


def test_a_refused_tag_does_not_replace_the_previous_one():
    session = open_session(ProviderRegistry(Workshop()))
    handle = new_variable(session, 1)
    assert put_tag(session, handle, "mine") == 0
    assert put_tag(session, handle, bytes(VALUE_LIMIT)) == hresult.E_TOO_MUCH_DATA
    assert session.invoke(f.variable_get_tag.id, [variant(handle)]).result == variant("mine")


def test_ids_and_parameters_are_bounded_like_tags():
    session = Session(ProviderRegistry(Recorder()))
    session.invoke(3, [variant(text) for text in ("", "Test.Recorder", "localhost", "")])
    for make, *stores in (
        (f.controller_get_variable, f.variable_put_tag, f.variable_put_id),
        (f.controller_get_command, f.command_put_tag, f.command_put_id, f.command_put_parameters),
    ):
        handle = session.invoke(make.id, [variant(2), variant("x"), variant("")]).result
        for store in stores:
            assert session.invoke(store.id, [handle, variant(bytes(VALUE_LIMIT))]).code == hresult.E_TOO_MUCH_DATA
            assert session.invoke(store.id, [handle, variant("short")]).code == 0


def test_the_size_of_a_header():
    assert stored_size(variant(None)) == struct.calcsize("<HI")
