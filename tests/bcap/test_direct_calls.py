"""Direct calls behave exactly as the generator of the conversation: the same results, errors and state for any data."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.client import BcapConversation
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, STREAM
from orinkit.bcap.requests import encode_request
from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.speedups import EXTENSION
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import ARRAY, Variant, VarType
from support.strategies import variants

pytestmark = pytest.mark.core

SERIAL = 7
SECONDS = 0.5
CALLS: list[tuple[Function[..., Any], tuple[Any, ...]]] = [
    (f.robot_execute, (3, "slvMove", [1.0, 2.0])),
    (f.variable_get_value, (3,)),
    (f.robot_get_name, (3,)),
    (f.robot_get_attribute, (3,)),
    (f.robot_move, (3, 1, "P1", "")),
]


def reply(*arguments: Any, serial: int = SERIAL, code: int = 0, reserved: int = 0) -> bytes:
    return packet.encode(Packet(serial, code, list(arguments), reserved))


def executing(serial: int = SERIAL) -> bytes:
    return reply(serial=serial, code=hresult.S_EXECUTING)


GOOD = reply([1.0, 2.0, 3.0])
RESULTS = st.one_of(
    st.sampled_from(
        [
            5,
            -1,
            1.5,
            True,
            False,
            None,
            "text",
            [1.0],
            [1.0, 2.0],
            [1.0] * 8,
            [0.5] * 64,
            [0.5] * 65,
            [1, 2],
            [],
            b"ab",
            Variant(VarType.R4, 0.5),
            Variant(VarType.I2, 3),
            Variant(VarType.BOOL | ARRAY, [True]),
            [[1.0, 2.0], 5, "x"],
        ]
    ),
    variants(),
)
REPLIES = st.builds(
    lambda result, serial, code, reserved: reply(result, serial=serial, code=code, reserved=reserved),
    RESULTS,
    st.sampled_from([SERIAL, SERIAL, SERIAL, SERIAL - 1, SERIAL + 1, 0]),
    st.sampled_from([0, 0, 0, 1, hresult.S_BUF_FULL, hresult.S_EXECUTING, hresult.E_HANDLE, 0xFFFFFFFF]),
    st.sampled_from([0, 0, 9]),
)
PARTS = st.one_of(
    REPLIES,
    REPLIES,
    st.sampled_from([executing(), executing(3), reply(), reply("a", "b"), b"\0", b"HTTP/1.1 400", GOOD[:-1] + b"\5"]),
    st.binary(min_size=1, max_size=40),
    st.tuples(REPLIES, st.integers(0, 200), st.integers(1, 255)).map(lambda each: altered(*each)),
)


def altered(data: bytes, position: int, mask: int) -> bytes:
    """Return the data with one byte changed."""
    position %= len(data)
    return data[:position] + bytes([data[position] ^ mask]) + data[position + 1 :]


@st.composite
def received(draw: st.DrawFn) -> list[bytes | None]:
    """Draw what a client receives: packets and other data in pieces, then a time-out or the end of the stream."""
    data = b"".join(draw(st.lists(PARTS, min_size=1, max_size=3)))
    cuts = sorted(draw(st.lists(st.integers(1, max(1, len(data) - 1)), max_size=3)))
    pieces = [data[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True)]
    return [*filter(None, pieces), draw(st.sampled_from([None, b""]))]


def new(**options: Any) -> BcapConversation:
    made = BcapConversation(**options)
    made.serial = SERIAL
    return made


def drive(operation: Any, waits: list[Any], pieces: list[bytes | None]) -> Any:
    """Feed a generator until it ends; record its waits."""
    try:
        waits.append(next(operation))
        for piece in pieces:
            waits.append(operation.send(piece))  # noqa: PERF401 - extend() would drop the result
    except StopIteration as stop:
        return stop.value
    raise AssertionError("the call has not ended")


def by_generator(call: Any, function: Any, arguments: Any, pieces: Any, exact: bool, waits: list[Any]) -> Any:
    return drive(call.call(function, arguments, SECONDS, exact=exact), waits, pieces)


def directly(call: Any, function: Any, arguments: Any, pieces: Any, exact: bool, waits: list[Any]) -> Any:
    assert call.direct
    serial, request = call.begin(function, arguments)
    waits.append((request, SECONDS))
    outcome = call.finish(function, serial, pieces[0], exact)
    if outcome is None:
        operation = call.resume(serial, function, arguments, SECONDS, pieces[0], exact=exact)
        return drive(operation, waits, pieces[1:])
    return outcome


def prepared(call: Any, function: Any, arguments: Any, pieces: Any, exact: bool, waits: list[Any]) -> Any:
    template = call.template(function, arguments[:2])
    serial, request = call.begin_prepared(template, arguments[2] if len(arguments) > 2 else None)
    waits.append((request, SECONDS))
    outcome = call.finish(function, serial, pieces[0], exact)
    if outcome is None:
        operation = call.resume(serial, function, arguments, SECONDS, pieces[0], exact=exact)
        return drive(operation, waits, pieces[1:])
    return outcome


def observed(way: Any, call: BcapConversation, *how: Any) -> tuple[Any, ...]:
    """Return all that a caller can observe: waits, result or error, and the state of the conversation afterwards."""
    waits: list[Any] = []
    result: Any
    try:
        result = repr(way(call, *how, waits))
    except OrinError as error:
        result = type(error), str(error), getattr(error, "code", None), getattr(error, "fatal", None)
    return waits, result, call.serial, call.stray_replies, call._framer.pending, call.direct


@given(pieces=received(), which=st.sampled_from(CALLS), exact=st.booleans(), small=st.booleans())
@example(pieces=[GOOD], which=CALLS[0], exact=False, small=False)
@example(pieces=[executing(), executing(), GOOD], which=CALLS[0], exact=False, small=False)
@example(pieces=[executing() + GOOD], which=CALLS[0], exact=False, small=False)
@example(pieces=[GOOD + reply(9)], which=CALLS[0], exact=False, small=False)
@example(pieces=[GOOD + GOOD[:5]], which=CALLS[0], exact=False, small=False)
@example(pieces=[None], which=CALLS[0], exact=False, small=False)
@example(pieces=[b""], which=CALLS[0], exact=False, small=False)
def test_any_data_has_the_same_outcome(
    pieces: list[bytes | None], which: tuple[Function[..., Any], tuple[Any, ...]], exact: bool, small: bool
) -> None:
    options: dict[str, Any] = {"limits": PacketLimits(packet=100, variants=2)} if small else {}
    how = (*which, pieces, exact)
    expected = observed(by_generator, new(**options), *how)
    assert observed(directly, new(**options), *how) == expected
    if which[0] in (f.robot_execute, f.variable_get_value):
        assert observed(prepared, new(**options), *how) == expected


@pytest.mark.parametrize("end", [None, b""])
def test_a_reply_that_is_cut_off_at_any_byte(end: bytes | None) -> None:
    for cut in range(1, len(GOOD)):
        for pieces in ([GOOD[:cut], end], [GOOD[:cut], GOOD[cut:]]):
            how = (*CALLS[0], pieces, False)
            assert observed(directly, new(), *how) == observed(by_generator, new(), *how)


def test_calls_follow_a_call_that_left_data_behind() -> None:
    """The rest of a packet must reach the framer that has its beginning."""
    call = new()
    waits: list[Any] = []
    late = reply("late", serial=SERIAL - 1)
    assert directly(call, *CALLS[0], [GOOD + late[:9]], False, waits) == (0, [1.0, 2.0, 3.0])
    assert not call.direct
    operation = call.call(*CALLS[1], SECONDS)
    next(operation)
    with pytest.raises(StopIteration) as stop:
        operation.send(late[9:] + reply(4, serial=SERIAL + 1))
    assert stop.value.value == (0, 4)
    assert (call.direct, call.stray_replies) == (True, 1)


def test_a_generator_that_was_dropped_while_data_is_incomplete() -> None:
    """A cancelled call may still be referred to by the traceback of its exception."""
    call = new()
    operation = call.resume(SERIAL, *CALLS[0], SECONDS, GOOD[:9])
    next(operation)
    assert not call.direct
    operation.close()
    assert not call.direct


def test_conversations_without_direct_calls() -> None:
    assert not new(trace=lambda mark, data: None).direct
    assert not new(profile=DATAGRAM).direct
    assert new(profile=STREAM).direct


# --- requests ---------------------------------------------------------------------------------------------------------

LISTS = st.lists(st.floats(), min_size=1, max_size=70)


@given(value=st.one_of(LISTS, LISTS.map(tuple), variants()))
@example(value=2**31)
@example(value=2**31 - 1)
@example(value=True)
@example(value=[1, 2.0])
@example(value=[True, 2.0])
@example(value=None)
@example(value=1)
@example(value=1.0)
@example(value=[])
@example(value=float("nan"))
def test_a_prepared_request_has_the_same_bytes(value: Any) -> None:
    for function, constants in ((f.robot_execute, (3, "slvMove")), (f.variable_put_value, (3,))):
        call = new()
        template = call.template(function, constants)
        assert template is not None
        for _ in range(2):
            serial = call.serial
            begun = call.begin_prepared(template, value)
            if begun is None:
                assert call.serial == serial
            else:
                assert begun == (serial, encode_request(function, (*constants, value), serial))
                assert call.serial == serial + 1


def test_lists_of_float_numbers_and_none_have_templates() -> None:
    call = new()
    template = call.template(f.robot_execute, (3, "slvMove"))
    assert template is not None
    for value in ([0.5], (0.5,) * 8, [0.5] * 64, 1, 0.5, None):
        assert call.begin_prepared(template, value) is not None
    for value in (Variant(VarType.I2, 1), 2**31, object(), 1j):
        assert call.begin_prepared(template, value) is None


@pytest.mark.skipif(EXTENSION is not None, reason="the extension in C needs no layouts")
def test_other_lists_and_texts_have_no_templates_in_python() -> None:
    call = new()
    template = call.template(f.robot_execute, (3, "slvMove"))
    assert template is not None
    for value in (True, "text", [1], [0.5] * 65, [], b"", [0.5, 1]):
        assert call.begin_prepared(template, value) is None


def test_a_function_without_a_varying_argument_has_only_one_prepared_request() -> None:
    call = new()
    template = call.template(f.variable_get_value, (3,))
    assert template is not None
    for value in (5, 0.5, [0.5], True):
        assert call.begin_prepared(template, value) is None
    assert call.begin_prepared(template, None) == (SERIAL, encode_request(f.variable_get_value, (3,), SERIAL))


def test_the_serial_of_a_prepared_request_starts_again_after_65535() -> None:
    call = new()
    call.serial = 0xFFFF
    template = call.template(f.variable_get_value, (3,))
    assert template is not None
    assert call.begin_prepared(template, None) == (0xFFFF, encode_request(f.variable_get_value, (3,), 0xFFFF))
    assert call.begin_prepared(template, None) == (1, encode_request(f.variable_get_value, (3,), 1))


def test_a_packet_beyond_the_limit_has_no_template() -> None:
    call = new(limits=PacketLimits(packet=80))
    template = call.template(f.robot_execute, (3, "slvMove"))
    assert template is not None
    assert call.begin_prepared(template, [0.5] * 8) is None
    with pytest.raises(InvalidValue, match="exceeds the limit of 80 bytes"):
        call.begin(f.robot_execute, (3, "slvMove", [0.5] * 8))
    assert call.serial == SERIAL


@pytest.mark.parametrize(
    ("function", "constants"),
    [(f.robot_execute, (3, 5)), (f.robot_execute, ("3", "x")), (f.robot_speed, (3, 1)), (f.robot_execute, (3, None))],
)
def test_calls_that_have_no_template(function: Function[..., Any], constants: tuple[Any, ...]) -> None:
    assert new().template(function, constants) is None
