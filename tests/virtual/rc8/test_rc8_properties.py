"""For any input of a client, the controller accepts it or returns an error code; accepted values can be read back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.cao.provider import ClientInfo, Deferred
from orinkit.core.errors import CallError
from orinkit.values.codec import encode
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.objects.controller_commands import COMMANDS
from support.strategies import strings, variants

DEVICE = VirtualRC8()
CONTROLLER = DEVICE.connect("c", "", "", ClientInfo())
NAMES = CONTROLLER.get_variable_names("")
POSES = st.sampled_from([VarType.R4, VarType.R8, VarType.VARIANT]).flatmap(
    lambda vt: st.lists(st.floats(width=32), min_size=2, max_size=11).map(lambda v: Variant(vt | ARRAY, v))
)


@given(st.sampled_from(NAMES), st.one_of(variants(), POSES))
def test_a_write_is_taken_or_refused(name, value):
    one = CONTROLLER.get_variable(name, "")
    before = one.get_value()
    try:
        one.put_value(value)
    except CallError:
        if name not in ("@TIME", "@CURRENT_TIME"):
            assert repr(one.get_value()) == repr(before)
    else:
        after = one.get_value()
        assert after.type == before.type
        encode(after)
        if name.endswith("_LEN"):
            one.put_value(before)  # other tests use the variables
        if name.endswith("*"):
            one.put_value(after)  # a value that can be read can be written
            assert repr(one.get_value()) == repr(after)


@given(st.sampled_from([name for name in NAMES if name.endswith("*")]), variants())
def test_an_id_is_taken_or_refused(name, value):
    one = CONTROLLER.get_variable(name, "")
    try:
        one.put_id(value)
    except CallError:
        assert one.get_id() == Variant(VarType.I4, 0)
    one.get_value()


@given(st.sampled_from(sorted(COMMANDS)), variants())
def test_a_command_answers_or_refuses(name, parameter):
    try:
        with DEVICE.guard:  # as a server calls it; the cycles run in another thread
            result = CONTROLLER.execute(name, parameter)
    except CallError:
        return
    if not isinstance(result, Deferred):
        encode(variant(result))


@given(strings())
def test_a_name_is_found_or_not(name):
    try:
        CONTROLLER.get_variable(name, "").get_value()
    except CallError as error:
        code = error.code
    else:
        return
    assert code in (0x80000204, 0x81500053)


@given(strings())
def test_any_connect_option_connects(option):
    DEVICE.connect("x", "", option, ClientInfo()).release()


def test_the_strings_of_a_variable_are_kept_as_they_are():
    s1 = CONTROLLER.get_variable("S1", "")
    for text in ("\ud800", "\0", "～―", "①"):
        s1.put_value(variant(text))
        assert s1.get_value().value == text
    with pytest.raises(CallError):
        s1.put_value(variant("①" * 128))
