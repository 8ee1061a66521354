"""The packets of requests in C: for any function and any arguments, the same packet or the same error as in Python."""

from __future__ import annotations

from datetime import datetime
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit import functions as f
from orinkit.bcap.direct import RequestTemplate
from orinkit.bcap.requests import encode_request, request_template
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Function
from orinkit.cao.user_functions import foreign_entry
from orinkit.core.speedups import native_request
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.variant import Variant, VarType
from support.speedups import check_same_outcome, needs_extension
from support.strategies import strings, variants

pytestmark = [pytest.mark.core, needs_extension]

POSE = [0.125, 45.0, 90.0, 0.25, 45.0, 0.5, 0.0, 0.0]
VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-5, 5), st.integers(), st.floats(), strings(), st.lists(st.floats(), max_size=9),
    variants(),
    st.sampled_from([object(), 1j, Decimal("1e400"), Decimal("1.5"), datetime(1, 1, 1), "x" * 9000, b"x" * 17_000, [None]]),
)  # fmt: skip
ENTRIES = st.sampled_from([*FUNCTIONS, foreign_entry(300, 2), foreign_entry(301, 0)])


@given(ENTRIES, st.lists(VALUES, max_size=6).map(tuple), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF))
@example(f.robot_execute, (3, "slvMove", POSE), 1, 0)
@example(f.robot_execute, (3, "slvMove"), 1, 0)
@example(f.robot_execute, (3, "slvMove", Decimal("1e400")), 1, 0)
@example(f.robot_speed, (3, 1, 50.5), 1, 0)
@example(f.robot_speed, (3, 1, 1e300), 1, 0)
@example(f.variable_put_value, (True, 1), 1, 0)
@example(f.variable_put_value, (2**31, 1), 1, 0)
@example(f.variable_get_value, (1, 2, 3), 1, 0)
def test_same_packet_or_same_error(
    function: Function[..., Any], arguments: tuple[Any, ...], serial: int, first: int
) -> None:
    check_same_outcome("encode_request", encode_request, function, arguments, serial)
    check_same_outcome("encode_request", encode_request, function, arguments, serial, first)
    for crc in (False, True):
        for size in (2, 4):
            check_same_outcome(
                "encode_request", encode_request, function, arguments, serial, first, crc=crc, vt_error_size=size
            )


@pytest.mark.parametrize("serial", [-1, 0x10000, 2**70, "1", 1.0, None, True])
def test_an_invalid_serial(serial: Any) -> None:
    encode_request(f.variable_get_value, (3,), 1)  # from now on, the types of its arguments are known
    check_same_outcome("encode_request", encode_request, f.variable_get_value, (3,), serial)
    check_same_outcome("encode_request", encode_request, f.variable_get_value, (3,), 1, serial)


def test_unusual_ways_to_pass_the_arguments() -> None:
    entry = f.variable_get_value
    for arguments, named in (
        ((entry, [3], 1), {}),
        ((entry, (3,)), {"serial": 1}),
        ((entry, (3,), 1), {"reserved": 2}),
        ((entry, (3,), 1), {"crc": 1}),
        ((entry, (3,), 1), {"vt_error_size": 4.0}),
        ((entry, (3,), 1), {"other": 1}),
        ((entry,), {}),
        ((entry, (3,), 1, 2, False), {}),
        ((None, (3,), 1), {}),
        ((object(), (), 1), {}),
    ):
        check_same_outcome("encode_request", encode_request, *arguments, **named)


def template(*, most: int = DEFAULT_LIMITS.packet) -> RequestTemplate:
    found = request_template(f.robot_execute, (3, "slvMove"), most)
    assert found is not None
    return found


@given(VALUES, st.integers(0, 0xFFFF))
@example(POSE, 7)
@example(Variant(VarType.R8, 1.0), 7)
def test_a_template_creates_the_packet_of_encode_request(value: Any, serial: int) -> None:
    made = template().request(serial, value)
    assert made is None or made == encode_request(f.robot_execute, (3, "slvMove", value), serial)


@pytest.mark.parametrize("value", [POSE, tuple(POSE), 1, 1.5, "P1", None, True, [1, 2.0], b"x", []])
def test_a_template_creates_the_packets_of_plain_values(value: Any) -> None:
    assert template().request(1, value) is not None


def test_a_packet_beyond_the_limit_has_no_template() -> None:
    packet = encode_request(f.robot_execute, (3, "slvMove", POSE), 1)
    assert template(most=len(packet)).request(1, POSE) == packet
    assert template(most=len(packet) - 1).request(1, POSE) is None


@pytest.mark.parametrize("arguments", [(), (None, 1, 2), (template().native, -1, 2), (template().native, 1.0, 2)])
def test_wrong_arguments_of_the_function_in_c(arguments: tuple[Any, ...]) -> None:
    assert native_request is not None
    with pytest.raises(TypeError, match="a template, a serial and a value"):
        native_request(*arguments)
