"""Motion options: as written in documents and by clients, and the codes of invalid ones."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.cao.options import Options
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.rc8.motion_options import MAX_PERCENT, MAX_TIME, MotionOptions, VariableRef, parse_options, resolve
from orinkit.values.poses import AT_COMMAND, AT_ENCODER, PassMark

pytestmark = pytest.mark.core


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("", MotionOptions()),
        (" , ,", MotionOptions()),
        ("NEXT", MotionOptions(next=True)),
        ("Next", MotionOptions(next=True)),
        ("next=1", MotionOptions(next=True)),
        ("NEXT = true", MotionOptions(next=True)),
        ("NEXT=0", MotionOptions()),
        ("NEXT=False", MotionOptions()),
        ("SPEED=50", MotionOptions(speed=50)),
        ("S=50", MotionOptions(speed=50)),
        (",speed = 1e1 ,", MotionOptions(speed=10)),
        ("SPEED=100", MotionOptions(speed=100)),
        ("SPEED=+.5", MotionOptions(speed=0.5)),
        ("SPEED=F2,NEXT", MotionOptions(speed=VariableRef("F", 2), next=True)),
        ("ACCEL=i10,DECEL=D[ 003 ]", MotionOptions(accel=VariableRef("I", 10), decel=VariableRef("D", 3))),
        ("Accel=25.5,Decel=30", MotionOptions(accel=25.5, decel=30)),
        ("TIME=200", MotionOptions(time=200)),
        ("TIME=3600000", MotionOptions(time=3_600_000)),
        ("TIME=F1", MotionOptions(time=VariableRef("F", 1, MAX_TIME))),
        ("@0,Pose=1,TIME=200,NEXT", MotionOptions(mark=AT_COMMAND, pose=1, time=200, next=True)),
        ("@0,Pose=2,NEXT", MotionOptions(mark=AT_COMMAND, pose=2, next=True)),
        (" @ e , pose=2.0", MotionOptions(mark=AT_ENCODER, pose=2)),
        ("@12.5", MotionOptions(mark=PassMark("n", 12.5))),
        ("SPEED=10,S=20", MotionOptions(speed=20)),
        ("NEXT,NEXT=0", MotionOptions()),
        ("@P,@E", MotionOptions(mark=AT_ENCODER)),
    ],
)
def test_options(text, options):
    assert parse_options(text) == options


def test_the_general_option_reader_takes_them_too():
    options = Options("@0,Pose=1,TIME=200,NEXT")
    assert options.flag("@0")
    assert options.flag("NEXT")
    assert options.number("pose") == 1
    assert options.number("Time") == 200


KNOWN = "SPEED (S), ACCEL, DECEL, TIME, NEXT, POSE, @0, @E, @P, @n"
INVALID, RANGE = hresult.MOTION_OPTION_INVALID, hresult.VALUE_OUT_OF_RANGE


@pytest.mark.parametrize(
    ("text", "code", "detail"),
    [
        ("FAST", INVALID, f"'FAST' is not a motion option. Try: {KNOWN}"),
        ("SPEED=50,x=1,y=2", INVALID, f"'x=1' is not a motion option. Try: {KNOWN}"),
        ("=5", INVALID, "'=5' is not a motion option"),
        ("NEXT SPEED=5", INVALID, "'NEXT SPEED=5' is not a motion option"),
        ("if IO128=ON", INVALID, f"'if IO128=ON': IF and UNTIL are only valid in PacScript programs. Try: {KNOWN}"),
        ("IF(IO[1]=1)", INVALID, "IF and UNTIL are only valid in PacScript programs"),
        ("NEXT,UNTIL IO128", INVALID, "'UNTIL IO128': IF and UNTIL are only valid in PacScript programs"),
        ("IFFY", INVALID, "'IFFY' is not a motion option"),
        ("SPEED", INVALID, "'SPEED': expected a number after the equals sign"),
        ("SPEED=", INVALID, "'SPEED=': expected a number"),
        ("SPEED=fast", INVALID, "'SPEED=fast': expected a number"),
        ("SPEED=nan", INVALID, "expected a number"),
        ("SPEED=1_0", INVALID, "expected a number"),
        ("SPEED=５０", INVALID, "expected a number"),
        ("SPEED=P1", INVALID, "expected a number"),
        ("SPEED=F", INVALID, "expected a number"),
        ("SPEED=F[1", INVALID, "expected a number"),
        ("SPEED=F" + "9" * 500, INVALID, "expected a number"),
        ("SPEED=50=60", INVALID, "expected a number"),
        ("SPEED=0", RANGE, "SPEED=0: 0 is out of range; expected above 0 and at most 100"),
        ("SPEED=-1", RANGE, "SPEED=-1: -1 is out of range; expected above 0 and at most 100"),
        ("ACCEL=100.5", RANGE, "ACCEL=100.5: 100.5 is out of range; expected above 0 and at most 100"),
        ("DECEL=1e999", RANGE, "DECEL=1e999: inf is out of range; expected above 0"),
        ("S=" + "9" * 1000, RANGE, "inf is out of range; expected above 0 and at most 100"),
        ("TIME=0", RANGE, "TIME=0: 0 is out of range; expected above 0 and at most 3600000"),
        ("TIME=3600001", RANGE, "TIME=3600001: 3600001 is out of range; expected above 0 and at most 3600000"),
        ("NEXT=5", INVALID, "'NEXT=5': expected NEXT without a value, NEXT=1 or NEXT=0"),
        ("NEXT=", INVALID, "'NEXT=': expected NEXT without a value"),
        ("Pose=3", RANGE, "'Pose=3': expected 1 or 2"),
        ("Pose=1.5", RANGE, "'Pose=1.5': expected 1 or 2"),
        ("Pose", INVALID, "'Pose': expected a number"),
        ("@X", INVALID, "'@X': column 2: expected P, E, C, 0 or a radius in mm, found 'X'"),
        ("@0 NEXT", INVALID, "'@0 NEXT': column 4: expected the end of the text, found 'NEXT'"),
        ("x" * 1024, INVALID, "is not a motion option"),
        ("," * 1025, INVALID, "option string of 1025 characters exceeds the limit of 1024"),
    ],
)  # fmt: skip
def test_invalid_options(text, code, detail):
    with pytest.raises(CallError) as caught:
        parse_options(text)
    assert caught.value.code == code
    assert detail in caught.value.detail
    assert len(caught.value.detail) < 250


def test_details_in_japanese():
    i18n.use("ja")
    for text, detail in [
        ("FAST", f"'FAST' という動作オプションはありません。対処: {KNOWN} のいずれかを指定してください"),
        ("SPEED=0", "SPEED=0: 0 は範囲外です (0 より大きく 100 以下)"),
    ]:
        with pytest.raises(CallError) as caught:
            parse_options(text)
        assert caught.value.detail == detail


def test_amounts_from_variables():
    variables = {("F", 2): 12.5, ("I", 1): 30, ("D", 3): 5000.0}

    def read(kind, index):
        return variables[kind, index]

    options = parse_options("SPEED=F2,ACCEL=I1,DECEL=80,TIME=D3")
    assert resolve(options.speed, read) == 12.5
    assert (type(resolve(options.accel, read)), resolve(options.accel, read)) == (float, 30.0)
    assert resolve(options.decel, read) == 80
    assert resolve(options.time, read) == 5000
    with pytest.raises(KeyError):
        resolve(VariableRef("F", 3), read)


@pytest.mark.parametrize("value", [0.0, -1.0, 100.1, math.nan, math.inf])
def test_a_variable_that_holds_no_amount(value):
    with pytest.raises(CallError, match=r"F2: .* is out of range; expected above 0 and at most 100") as caught:
        resolve(VariableRef("F", 2), lambda _kind, _index: value)
    assert caught.value.code == RANGE


def amounts(most):
    numbers = st.integers(0, 999_999)
    return st.none() | st.floats(0.001, most) | st.builds(VariableRef, st.sampled_from("IFD"), numbers, st.just(most))


percent, times = amounts(MAX_PERCENT), amounts(MAX_TIME)


@given(percent, percent, percent, times, st.booleans(), st.none() | st.sampled_from((1, 2)))
def test_what_was_written_is_read(speed, accel, decel, time, at_once, pose):
    given_values = {"speed": speed, "Accel": accel, "DECEL": decel, "time": time, "Pose": pose}
    parts = [f" {name} = {value} " for name, value in given_values.items() if value is not None]
    text = ",".join([*parts, "NEXT"] if at_once else parts)
    assert parse_options(text) == MotionOptions(speed, accel, decel, time, at_once, None, pose)


@given(st.text(st.sampled_from("SPEDTIMNX=,@0f1[]. "), max_size=30) | st.text(max_size=20))
def test_any_text_is_read_or_refused(text):
    code = 0
    try:
        parse_options(text)
    except CallError as error:
        code = error.code
    assert code in (0, INVALID, RANGE)
