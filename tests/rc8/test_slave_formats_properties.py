"""Parameters and results of slave mode: both sides agree, and invalid input never crashes."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.core import hresult
from orinkit.core.errors import CallError, ProtocolError
from orinkit.rc8 import slave_formats as sf
from orinkit.rc8.slave_formats import ReceiveBits, ReceiveFormat, SendBits, SetPoint, SlaveReply, UserWindow
from orinkit.values.codec import decode, encode, encode_variant
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType
from support.strategies import variants

pytestmark = pytest.mark.core

KINDS = st.sampled_from(["P", "J", "T"])
SENDS = st.sampled_from(sf.SEND_FORMATS).map(SendBits)
RECEIVES = st.builds(
    lambda pose, flags, unit: sf.receive_format(pose | sum(flags), unit),
    st.sampled_from(sorted(sf.POSE_PARTS)),
    st.sets(st.sampled_from(list(ReceiveBits))),
    st.integers(0, 1),
)
NUMBERS = st.floats(-sf.LARGEST, sf.LARGEST)
STATES = st.integers(-(2**31), 2**31 - 1)
OFFSETS = st.integers(0, 2**28 - 1).map(lambda number: number * sf.USER_STEP)
USER = st.binary(min_size=1, max_size=sf.MOST_USER_BYTES)
REFUSALS = {hresult.E_INVALIDARG, hresult.DISP_E_TYPEMISMATCH}


def eight(elements):
    return st.tuples(*[elements] * 8)


@st.composite
def poses(draw, kind):
    numbers = [draw(NUMBERS) for _ in range(sf.POSE_SIZES[kind])]
    if kind != "J":
        numbers[-1] = float(draw(st.integers(-3, 1023)))
    return tuple(numbers)


@st.composite
def set_points(draw):
    kind, send, receive = draw(KINDS), draw(SENDS), draw(RECEIVES)
    pose = draw(poses(kind))
    axes = draw(st.sampled_from([(), (7,), (8,), (7, 8)]))
    extra = tuple((axis, pose[axis - 1] if kind == "J" else draw(NUMBERS)) for axis in axes)
    point = SetPoint(
        pose,
        extra,
        draw(STATES) if SendBits.MINI in send else None,
        draw(STATES) if SendBits.HAND in send else None,
        (draw(OFFSETS), draw(USER)) if SendBits.USER in send else None,
        UserWindow(draw(OFFSETS), draw(st.integers(1, sf.MOST_USER_BYTES))) if receive.has(ReceiveBits.USER) else None,
    )
    return kind, point, send, receive


@st.composite
def answers(draw):
    receive = draw(RECEIVES)
    kinds = receive.kinds
    return receive, SlaveReply(
        draw(poses("J")) if "J" in kinds else None,
        draw(poses("P")) if "P" in kinds else None,
        draw(poses("T")) if "T" in kinds else None,
        draw(STATES) if receive.has(ReceiveBits.TIME) else None,
        draw(STATES) if receive.has(ReceiveBits.MINI) else None,
        draw(STATES) if receive.has(ReceiveBits.HAND) else None,
        draw(USER) if receive.has(ReceiveBits.USER) else None,
        draw(eight(NUMBERS)) if receive.has(ReceiveBits.CURRENT) else None,
    )


@given(set_points())
def test_a_set_point_arrives_as_it_was_sent(sent):
    kind, point, send, receive = sent
    data = encode(sf.encode_set_point(kind, point, send, receive))
    read = sf.read_set_point(kind, decode(data, exact=True)[0], send, receive)
    assert read == point
    assert encode(sf.encode_set_point(kind, read, send, receive)) == data


@given(answers())
def test_an_answer_arrives_as_it_was_given(given_answer):
    receive, answer = given_answer
    data = encode_variant(sf.build_reply(receive, answer))
    read = sf.read_reply(receive, decode(data)[0])
    assert read == answer
    assert encode_variant(sf.build_reply(receive, read)) == data


def pose_like(element):
    """Return arrays of about the length of a pose, of one type or of VARIANTs."""
    typed = st.sampled_from([VarType.R8, VarType.R4]).flatmap(
        lambda vt: st.lists(st.floats(width=32), max_size=14).map(lambda numbers: Variant(vt | 0x2000, numbers))
    )
    return st.one_of(typed, st.lists(element, max_size=14).map(lambda items: Variant(VARIANT_ARRAY, items)))


def outcome(kind, function, *arguments):
    """Return the result of a function, or the expected exception that it raises."""
    try:
        return function(*arguments)
    except kind as error:
        return error


@given(KINDS, st.one_of(variants(), pose_like(variants()), pose_like(pose_like(variants()))), SENDS, RECEIVES)
@example("J", Variant(VARIANT_ARRAY, []), SendBits.HAND, ReceiveFormat())
def test_any_parameter_is_read_or_refused(kind, parameter, send, receive):
    point = outcome(CallError, sf.read_set_point, kind, parameter, send, receive)
    if isinstance(point, CallError):
        assert point.code in REFUSALS
        assert len(point.detail) < 400
    else:
        again = encode(sf.encode_set_point(kind, point, send, receive))
        assert sf.read_set_point(kind, decode(again, exact=True)[0], send, receive) == point


@given(variants())
def test_any_parameter_of_slv_recv_format_is_read_or_refused(parameter):
    receive = outcome(CallError, sf.read_receive_parameter, parameter)
    if isinstance(receive, CallError):
        assert receive.code in REFUSALS
    else:
        assert sf.receive_format(receive.number, int(receive.microseconds)) == receive


@given(RECEIVES, st.one_of(variants(), pose_like(variants())).map(lambda item: item.plain))
def test_any_answer_is_read_or_refused(receive, value):
    answer = outcome(ProtocolError, sf.read_reply, receive, value)
    if isinstance(answer, ProtocolError):
        assert len(str(answer)) < 400
    else:
        assert sum(getattr(answer, name) is not None for name in ("joints", "position", "trans")) == len(receive.kinds)
        assert sf.read_reply(receive, sf.build_reply(receive, answer).plain) == answer
