"""Replies and requests that are packed and read in one step have the bytes of the general functions."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.cao.functions import FUNCTIONS
from orinkit.core.errors import ProtocolError
from orinkit.values import codec
from orinkit.values.variant import R8_ARRAY, Variant, VarType
from support.strategies import arrays, scalars

pytestmark = pytest.mark.core

SHORTS = st.integers(0, 0xFFFF)
CODES = st.sampled_from([0, 1, 0x0F1234, 0x80004005, 0xFFFFFFFF])


@given(
    SHORTS,
    CODES,
    st.one_of(scalars(), arrays(), st.lists(st.floats(), max_size=70).map(lambda n: Variant(R8_ARRAY, n))),
    SHORTS,
)
def test_a_simple_reply_has_the_bytes_of_the_general_encoder(serial, code, result, reserved):
    data = packet.pack_reply(serial, code, result, reserved)
    if data is not None:
        assert data == packet.pack(serial, code, 1, codec.encode_variant(result), reserved)


@pytest.mark.parametrize(
    "result",
    [
        Variant(VarType.I4, -(2**31)), Variant(VarType.I2, 7), Variant(VarType.R8, 0.1), Variant(VarType.R4, 0.5),
        Variant(VarType.BOOL, True), Variant(VarType.BOOL, False), Variant(VarType.BSTR, "座標"),
        Variant(R8_ARRAY, []), Variant(R8_ARRAY, [1.5] * 8), None,
    ],
)  # fmt: skip
def test_the_usual_results_are_simple(result):
    data = packet.pack_reply(3, 0, result)
    assert data is not None
    read = packet.decode(data, exact=True)
    assert (read.serial, read.code, read.arguments) == (3, 0, [] if result is None else [result])


@pytest.mark.parametrize(
    "result",
    [
        Variant(VarType.EMPTY), Variant(VarType.BSTR, "x" * 5000), Variant(R8_ARRAY, [0.0] * 1000),
        Variant(VarType.VARIANT | VarType.ARRAY, [1, "a"]), Variant(VarType.ERROR, 5),
    ],
)  # fmt: skip
def test_all_other_results_use_the_general_encoder(result):
    assert packet.pack_reply(3, 0, result) is None


@given(st.binary(min_size=25, max_size=40), st.data())
def test_only_a_request_with_one_handle_is_read_in_one_step(noise, data):
    whole = packet.pack(
        data.draw(SHORTS), data.draw(st.integers(0, 200)), 1, codec.encode(data.draw(st.integers(-9, 2**31 - 1)))
    )
    at = data.draw(st.integers(0, len(whole) - 1))
    mutated = whole[:at] + bytes([data.draw(st.integers(0, 255))]) + whole[at + 1 :]
    for each in (whole, mutated, whole[:-1], whole + b"\x04", noise):
        found = packet.read_one_handle(each)
        try:
            read = packet.decode(each, exact=True)
        except ProtocolError:
            assert found is None
            continue
        if found is None:
            assert [each.type for each in read.arguments] != [VarType.I4] or read.trailer
        else:
            (argument,) = read.arguments
            assert found == (read.serial, read.reserved, read.code, argument.value)
            assert argument.type == VarType.I4


def test_all_getters_are_read_in_one_step():
    for function in FUNCTIONS.values():
        if [each.is_handle for each in function.arguments] == [True]:
            assert packet.read_one_handle(packet.pack(1, function.id, 1, codec.encode(5))) == (1, 0, function.id, 5)


@given(st.binary(max_size=60), st.integers(0, 3))
def test_a_framer_with_nothing_buffered_recognizes_a_whole_packet(body, extra):
    data = packet.pack(1, 2, 0, body) + b"\x01" * extra
    framer = packet.Framer()
    whole = framer.has_whole(data)
    assert whole is (extra == 0)
    assert framer.pending == 0
    if whole:
        assert framer.feed(data) is data
