"""Poses as values and as text: round trips, and errors that name the column."""

from __future__ import annotations

import copy
import math
import pickle
import re
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.values.poses import (
    AT_COMMAND,
    AT_ENCODER,
    FIG_AUTO,
    FIG_NEAREST,
    FIG_WITHIN_LIMITS,
    PASSING,
    Extra,
    Figure,
    J,
    P,
    PassMark,
    T,
    Target,
    V,
    describe_figure,
    parse_target,
    parse_targets,
    to_text,
)
from orinkit.values.variant import R8_ARRAY, Variant, variant

pytestmark = pytest.mark.core

SEED = (364.16, 0, 278.5355, 180, 0, 180, 5)
TEN = (364.16, 0, 278.5355, 0, 1, 0, 0, 0, -1, 5)

# --- values -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text", "representation"),
    [
        (P(*SEED), "P(364.16, 0, 278.5355, 180, 0, 180, 5)",
         "P(x=364.16, y=0, z=278.5355, rx=180, ry=0, rz=180, fig=5)"),
        (P(1, 2, 3, 4, 5, 6), "P(1, 2, 3, 4, 5, 6, -1)", "P(x=1, y=2, z=3, rx=4, ry=5, rz=6, fig=-1)"),
        (T(*TEN), "T(364.16, 0, 278.5355, 0, 1, 0, 0, 0, -1, 5)",
         "T(x=364.16, y=0, z=278.5355, ox=0, oy=1, oz=0, ax=0, ay=0, az=-1, fig=5)"),
        (V(1, -2.5, 1e-7), "V(1, -2.5, 0)", "V(x=1, y=-2.5, z=1e-07)"),
        (J(45, 30, 120, 0, -60, 0), "J(45, 30, 120, 0, -60, 0)", "J(45, 30, 120, 0, -60, 0)"),
        (J(1e22), "J(10000000000000000000000)", "J(1e+22)"),
        (J(44.99999999999999, -1e-9, 1 / 3), "J(45, 0, 0.333333)", "J(44.99999999999999, -1e-09, 0.3333333333333333)"),
        (J(-0.0, 0.1, 1.2699999999999999e-14), "J(0, 0.1, 0)",
         "J(-0, 0.1, 1.2699999999999999e-14)"),
    ],
)  # fmt: skip
def test_texts_of_values(value, text, representation):
    assert str(value) == text
    assert repr(value) == representation
    assert eval(repr(value)) == value
    assert f"{value}" == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (V(1, -2.5, 1e-7), "V(1, -2.5, 0.0000001)"),
        (J(-0.0, 0.1, 1.2699999999999999e-14), "J(0, 0.1, 0.000000000000012699999999999999)"),
        (J(44.99999999999999, 1 / 3), "J(44.99999999999999, 0.3333333333333333)"),
        (P(1e-9, 0, 0, 0, 0, 0), "P(0.000000001, 0, 0, 0, 0, 0, -1)"),
    ],
)
def test_to_text_keeps_all_digits(value, text):
    assert to_text(value) == text
    assert to_text(value, "@E") == f"@E {text}"
    assert parse_target(to_text(value)).pose == value


def test_fields():
    pose = P(*SEED)
    assert (pose.x, pose.y, pose.z, pose.rx, pose.ry, pose.rz, pose.fig) == SEED
    assert type(pose.fig) is int
    turned = T(*TEN)
    fields = (turned.x, turned.y, turned.z, turned.ox, turned.oy, turned.oz, turned.ax, turned.ay, turned.az)
    assert (*fields, turned.fig) == TEN
    assert type(turned.fig) is int
    assert (V(1, 2, 3).x, V(1, 2, 3).y, V(1, 2, 3).z) == (1, 2, 3)
    assert J(*range(1, 9))[7] == 8


@pytest.mark.parametrize("value", [P(*SEED), T(*TEN), V(1, 2, 3), J(1), J(*range(8))])
def test_values_are_tuples_that_keep_their_class(value):
    assert value == tuple(value)
    assert all(type(number) is float for number in value)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(value, protocol))
        assert (type(again), again) == (type(value), value)
    assert type(copy.deepcopy(value)) is type(value)
    with pytest.raises(AttributeError):
        value.x = 1.0
    with pytest.raises(AttributeError):
        value.other = 1.0


@pytest.mark.parametrize("value", [P(*SEED), T(*TEN), V(1, 2, 3), J(1, 2, 3, 4, 5, 6)])
def test_poses_can_be_assigned_to_variables_directly(value):
    assert variant(value) == Variant(R8_ARRAY, list(value))


def test_replace():
    assert P(*SEED).replace(z=300, fig=FIG_AUTO) == P(364.16, 0, 300, 180, 0, 180)
    assert type(T(*TEN).replace(az=1)) is T
    assert V(1, 2, 3).replace() == V(1, 2, 3)
    with pytest.raises(TypeError, match=r"V has no field 'rx', it has x, y, z"):
        V(1, 2, 3).replace(rx=1)
    with pytest.raises(InvalidValue, match="P: x must be a finite number, not nan"):
        P(*SEED).replace(x=math.nan)


@pytest.mark.parametrize(
    ("made", "value"),
    [
        (P.of([1, 2, 3, 4, 5, 6, 7]), P(1, 2, 3, 4, 5, 6, 7)),
        (P.of([1, 2, 3, 4, 5, 6]), P(1, 2, 3, 4, 5, 6, -1)),
        (T.of(range(10)), T(*range(10))),
        (T.of(range(9)), T(*range(9), -1)),
        (J.of([45, 30, 120, 0, -60, 0, 0, 0]), J(45, 30, 120, 0, -60, 0, 0, 0)),
        (J.of((1,)), J(1)),
        (V.of(np.array([1, 2, 3], "float32")), V(1, 2, 3)),
        (V.of(iter((1, 2, 3))), V(1, 2, 3)),
        (J.of(Variant(R8_ARRAY, [1.0, 2.0])), J(1, 2)),
        (J(Decimal("1.5"), np.float64(2), Figure.LEFTY), J(1.5, 2, 1)),
    ],
)
def test_poses_from_replies_of_a_controller(made, value):
    assert (type(made), made) == (type(value), value)


class Awkward:
    def __repr__(self) -> str:
        raise RuntimeError

    def __float__(self) -> float:
        raise ValueError


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: P(1, math.nan, 3, 4, 5, 6), "P: y must be a finite number, not nan"),
        (lambda: T(*range(8), math.inf), "T: az must be a finite number, not inf"),
        (lambda: V(1, 2, 10**400), "V: z must be a finite number, not 1000000000000000000000000000000000000..."),
        (lambda: V(1, 2, 10**5000), "V: z must be a finite number, not 0x31e20801036510f3c591fde5361dc619987..."),
        (lambda: J(1, "2"), "J: J2 must be a finite number, not '2'"),
        (lambda: J(b"1"), "J: J1 must be a finite number, not b'1'"),
        (lambda: J(1, 2, True), "J: J3 must be a finite number, not True"),
        (lambda: J(None), "J: J1 must be a finite number, not None"),
        (lambda: J(1j), "J: J1 must be a finite number, not 1j"),
        (lambda: J(Awkward()), "J: J1 must be a finite number, not <Awkward>"),
        (lambda: J(np.array([1, 2])), "J: J1 must be a finite number, not array([1, 2])"),
        (lambda: P(1, 2, 3, 4, 5, 6, 5.5), "P: fig must be a whole number of 32 bits, not 5.5"),
        (lambda: P(1, 2, 3, 4, 5, 6, 2**31), "P: fig must be a whole number of 32 bits, not 2147483648"),
        (lambda: P(1, 2, 3, 4, 5, 6, math.inf), "P: fig must be a finite number, not inf"),
        (lambda: J(), "J: got 0 values, expected 1 to 8"),
        (lambda: J(*range(9)), "J: got more than 8 values, expected 1 to 8"),
        (lambda: P.of([1, 2, 3, 4, 5]), "P: got 5 values, expected 6 or 7"),
        (lambda: T.of(range(10**9)), "T: got more than 10 values, expected 9 or 10"),
        (lambda: V.of([1, 2]), "V: got 2 values, expected 3"),
        (lambda: V.of("123"), "V: '123' is not a sequence of numbers"),
        (lambda: V.of(b"123"), "V: b'123' is not a sequence of numbers"),
        (lambda: V.of(None), "V: None is not a sequence of numbers"),
    ],
)
def test_invalid_values(make, message):
    with pytest.raises(InvalidValue) as caught:
        make()
    assert str(caught.value) == message


# --- figures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fig", "words"),
    [
        (5, "LEFTY ABOVE NONFLIP"),
        (0, "RIGHTY ABOVE FLIP"),
        (6, "RIGHTY BELOW NONFLIP"),
        (17.0, "LEFTY ABOVE FLIP J4 DOUBLE"),
        (63, "LEFTY BELOW NONFLIP J6 DOUBLE J4 DOUBLE J1 DOUBLE"),
        (261, "LEFTY ABOVE NONFLIP 256"),
        (Figure.LEFTY | Figure.NONFLIP, "LEFTY ABOVE NONFLIP"),
        (FIG_AUTO, "AUTO"),
        (FIG_NEAREST, "NEAREST"),
        (FIG_WITHIN_LIMITS, "WITHIN LIMITS"),
        (-4, "-4"),
    ],
)
def test_figures_in_words(fig, words):
    assert describe_figure(fig) == words


@pytest.mark.parametrize("fig", [0.5, math.nan, 2**40, "5", None])
def test_invalid_figures(fig):
    with pytest.raises(InvalidValue, match="Fig: fig must be "):
        describe_figure(fig)


# --- pass marks, extra joints, targets --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "mark", "written"),
    [
        ("@E", AT_ENCODER, "@E"), ("@e", AT_ENCODER, "@E"), (" @ P ", PASSING, "@P"), ("@0", AT_COMMAND, "@0"),
        ("@0.0", AT_COMMAND, "@0"), ("@-0", AT_COMMAND, "@0"), ("@10", PassMark("n", 10), "@10"),
        ("@+2.50", PassMark("n", 2.5), "@2.5"), ("@1e-5", PassMark("n", 0.00001), "@0.00001"),
        ("@.5", PassMark("n", 0.5), "@0.5"), ("@1.", PassMark("n", 1), "@1"),
    ],
)  # fmt: skip
def test_pass_marks(text, mark, written):
    assert PassMark.parse(text) == mark
    assert str(mark) == written
    assert PassMark.parse(written) == mark


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", 'column 1: expected a pass mark ("@P", "@E", "@0", or "@10" for 10 mm), the text ends here'),
        ("E", 'column 1: expected a pass mark ("@P", "@E", "@0", or "@10" for 10 mm), found \'E\''),
        ("@", "column 2: expected P, E, C, 0 or a radius in mm, the text ends here"),
        ("@X", "column 2: expected P, E, C, 0 or a radius in mm, found 'X'"),
        ("@ -5", "column 3: expected P, E, C, 0 or a radius in mm, found '-5'"),
        ("@1e999", "column 2: expected P, E, C, 0 or a radius in mm, found '1e999'"),
        ("@nan", "column 2: expected P, E, C, 0 or a radius in mm, found 'nan'"),
        ("@１", "column 2: expected P, E, C, 0 or a radius in mm, found '１'"),
        ("@E P1", "column 4: expected the end of the text, found 'P1'"),
    ],
)  # fmt: skip
def test_invalid_texts_of_pass_marks(text, message):
    with pytest.raises(NotationError) as caught:
        PassMark.parse(text)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("mode", "radius"), [("X", 0), ("n", 0), ("E", 5), ("0", 5), ("n", -1), ("P", -1), ("n", math.inf), ("n", "5")]
)
def test_invalid_pass_marks(mode, radius):
    with pytest.raises(InvalidValue, match=r"PassMark: radius must be|invalid pass mark"):
        PassMark(mode, radius)


@pytest.mark.parametrize(
    "joints", [(), ((6, 1.0),), ((7, 1.0), (7, 2.0)), ((7, math.nan),), ((7, 1.0), (8, 2.0), (9, 3.0))]
)
def test_invalid_extra_joints(joints):
    with pytest.raises(InvalidValue, match=r"extended joints must be|Extra: J7 must be"):
        Extra(absolute=True, joints=joints)


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        ("Q", 1, 'the pose type of a target must be "P", "T", "J", "V" or "" (unspecified), not \'Q\''),
        ("", 1, "invalid variable of kind '' and number 1; a kind and a number of 0 or more are required"),
        ("P", -1, "invalid variable of kind 'P' and number -1; a kind and a number of 0 or more are required"),
        (
            "P",
            2**31,
            "invalid variable of kind 'P' and number 2147483648; a kind and a number of 0 or more are required",
        ),
        ("P", True, "invalid variable of kind 'P' and number True; a kind and a number of 0 or more are required"),
        ("P", (1, 2), "P: got 2 values, expected 6 or 7"),
        ("", (), "a pose: got 0 values, expected 1 to 10"),
        ("", (1, math.inf), "a pose: value 2 must be a finite number, not inf"),
        ("J", 1.5, "J: 1.5 is not a sequence of numbers"),
    ],
)
def test_invalid_targets(kind, value, message):
    with pytest.raises(InvalidValue) as caught:
        Target(kind, value)
    assert str(caught.value) == message


def test_the_pose_of_a_target():
    assert Target("P", (1, 2, 3, 4, 5, 6)).pose == P(1, 2, 3, 4, 5, 6)
    assert type(Target("T", tuple(TEN)).pose) is T
    assert type(Target("J", J(1, 2)).pose) is J
    assert type(Target("V", V(1, 2, 3)).pose) is V
    assert Target("P", 1).pose is None
    assert Target("", (1, 2, 3)).pose is None
    assert type(Target("J", J(1, 2)).value) is tuple
    assert Target("J", np.array([1, 2])).value == (1.0, 2.0)


# --- text -> target ---------------------------------------------------------------------------------------------------

BOTH_EXTRA = Extra(absolute=False, joints=((7, 30.5), (8, -1)))


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("P1", Target("P", 1)),
        ("@E P1", Target("P", 1, AT_ENCODER)),
        ("@E J(45, 30, 120, 0, -60, 0)", Target("J", (45, 30, 120, 0, -60, 0), AT_ENCODER)),
        ("@E J1", Target("J", 1, AT_ENCODER)),
        ("@0 J(2.745191,40.80005,90.0,0,3.221371,0)", Target("J", (2.745191, 40.80005, 90, 0, 3.221371, 0), AT_COMMAND)),
        ("@P P[1]", Target("P", 1, PASSING)),
        ("@pp99", Target("P", 99, PASSING)),
        ("@10P1", Target("P", 1, PassMark("n", 10))),
        ("@5 T(0,0,0,0,1,0,0,0,-1)", Target("T", (0, 0, 0, 0, 1, 0, 0, 0, -1), PassMark("n", 5))),
        ("t(0,0,0,0,1,0,0,0,-1,5)", Target("T", (0, 0, 0, 0, 1, 0, 0, 0, -1, 5))),
        ("P(1,2,3,4,5,6)", Target("P", (1, 2, 3, 4, 5, 6))),
        ("P(1,2,3,4,5,6,5.0)", Target("P", (1, 2, 3, 4, 5, 6, 5))),
        ("V(1,2,3)", Target("V", (1, 2, 3))),
        ("V 7", Target("V", 7)),
        ("(10)", Target("", (10,))),
        ("@0 (1,10)", Target("", (1, 10), AT_COMMAND)),
        ("(1,2,3,4,5,6,7,8,9,10)", Target("", (1, 2, 3, 4, 5, 6, 7, 8, 9, 10))),
        ("J(+1,-.5,1.,1e1,1.5E-1)", Target("J", (1, -0.5, 1, 10, 0.15))),
        (" @ e \t P [ 007 ] \r\n", Target("P", 7, AT_ENCODER)),
        (" j ( 1 , 2 ) ", Target("J", (1, 2))),
        ("P2147483647", Target("P", 2147483647)),
        ("P1 EX((7,30.5),(8,-1))", Target("P", 1, None, BOTH_EXTRA)),
        ("P1EX((7,30.5),(8,-1))", Target("P", 1, None, BOTH_EXTRA)),
        ("@P J(1,2) exa ( ( 8 , 2 ) )", Target("J", (1, 2), PASSING, Extra(absolute=True, joints=((8, 2),)))),
        ("P1 EX(7,10)", Target("P", 1, None, Extra(absolute=False, joints=((7, 10),)))),
        ("@P J(0,0) EXA((7,15))", Target("J", (0, 0), PASSING, Extra(absolute=True, joints=((7, 15),)))),
    ],
)  # fmt: skip
def test_targets(text, target):
    assert parse_target(text) == target
    assert parse_targets(text) == (target,)
    assert parse_target(str(target)) == target


def test_several_targets():
    assert parse_targets("P1,@E P2") == (Target("P", 1), Target("P", 2, AT_ENCODER))
    assert parse_targets("@0 (1,10), (2,20)") == (Target("", (1, 10), AT_COMMAND), Target("", (2, 20)))
    three = parse_targets("P(1,2,3,4,5,6) EX((7,1)) , J(1,2),T3")
    assert [target.kind for target in three] == ["P", "J", "T"]
    with pytest.raises(NotationError, match=r"^column 3: expected the end of the text, found ',P2'"):
        parse_target("P1,P2")


POSE = "a pose like P1, P(x, y, z, rx, ry, rz, fig) or J(j1, ..., j6)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", f"column 1: expected {POSE}, the text ends here"),
        ("  ", f"column 3: expected {POSE}, the text ends here"),
        ("Q1", f"column 1: expected {POSE}, found 'Q1'"),
        ("@E", f"column 3: expected {POSE}, the text ends here"),
        ("@E @E P1", f"column 4: expected {POSE}, found '@E P1'"),
        ("P1,", f"column 4: expected {POSE}, the text ends here"),
        ("　P1", f"column 1: expected {POSE}, found '\\u3000P1'"),
        ("P", 'column 2: expected the number of a variable P, or "(" followed by values, the text ends here'),
        ("tX", "column 2: expected the number of a variable T, or \"(\" followed by values, found 'X'"),
        ("P-1", "column 2: expected the number of a variable P, or \"(\" followed by values, found '-1'"),
        ("P１", "column 2: expected the number of a variable P, or \"(\" followed by values, found '１'"),
        ("P2147483648", "column 2: expected the number of a variable P, or \"(\" followed by values, found '2147483648'"),
        ("P" + "9" * 4000, "column 2: expected the number of a variable P, or \"(\" followed by values, found '99999999999999999999'"),
        ("P[I1]", "column 3: expected the number of a variable P, found 'I1]'"),
        ("P[1", 'column 4: expected "]", the text ends here'),
        ("P[1.5]", "column 4: expected \"]\", found '.5]'"),
        ("P1.5", "column 3: expected the end of the text, found '.5'"),
        ("P1 J2", "column 4: expected the end of the text, found 'J2'"),
        ("P(", "column 3: expected a number (x), the text ends here"),
        ("P()", "column 3: expected a number (x), found ')'"),
        ("P(1,,3)", "column 5: expected a number (y), found ',3)'"),
        ("P(1,2,3,4,5)", "column 12: expected \",\" and another value (P(...) has 6 or 7 values), found ')'"),
        ("P(1 2)", "column 5: expected \",\" and another value (P(...) has 6 or 7 values), found '2)'"),
        ("P(1,2,3,4,5,6", 'column 14: expected "," or ")", the text ends here'),
        ("P(1,2,3,4,5,6,7,8)", "column 16: expected \")\" after the 6 or 7 values of P(...), found ',8)'"),
        ("P(1,2,3,4,5,6,5.5)", "column 15: expected a whole number (fig), found '5.5)'"),
        ("T(1,2,3,4,5,6,7,8,9,4e9)", "column 21: expected a whole number (fig), found '4e9)'"),
        ("V(1,2)", "column 6: expected \",\" and another value (V(...) has 3 values), found ')'"),
        ("J(1,2,3,4,5,6,7,8,9)", "column 18: expected \")\" after the 1 to 8 values of J(...), found ',9)'"),
        ("(1,2,3,4,5,6,7,8,9,10,11)", "column 22: expected \")\" after the 1 to 10 values of (...), found ',11)'"),
        ("J(nan)", "column 3: expected a number (J1), found 'nan)'"),
        ("J(1,1e999)", "column 5: expected a number (J2), found '1e999)'"),
        ("J(1_0)", "column 4: expected \",\" or \")\", found '_0)'"),
        ("J(0x10)", "column 4: expected \",\" or \")\", found 'x10)'"),
        ("P1 E", "column 4: expected the end of the text, found 'E'"),
        ("P1 EX", 'column 6: expected "(", the text ends here'),
        ("P1 EX()", "column 7: expected the number of an extended joint, 7 or 8, found ')'"),
        ("P1 EX((6,1))", "column 8: expected the number of an extended joint, 7 or 8, found '6,1))'"),
        ("P1 EX((7))", "column 9: expected \",\", found '))'"),
        ("P1 EX((7,x))", "column 10: expected a number (J7), found 'x))'"),
        ("P1 EX((7,1),8,2)", "column 13: expected \"(\", found '8,2)'"),
        ("P1 EX((7,1),(7,2))", "column 14: expected the number of the other extended joint, found '7,2))'"),
        ("P1 EX((7,1)", 'column 12: expected ")", the text ends here'),
        ("P1 EX(7,1,8,2)", "column 10: expected \")\", found ',8,2)'"),
        ("P1 EX(7,1) EX(8,1)", "column 12: expected the end of the text, found 'EX(8,1)'"),
        ("(" * 4096, f"column 2: expected a number (value 1), found '{'(' * 20}'"),
        ("P1" + " " * 4095, "column 4097: the text is longer than 4096 characters"),
    ],
)  # fmt: skip
def test_invalid_texts_of_targets(text, message):
    with pytest.raises(NotationError) as caught:
        parse_targets(text)
    assert str(caught.value) == message


# --- what a client sends ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pose", "mark", "text"),
    [
        (P(*SEED), "", "P(364.16, 0, 278.5355, 180, 0, 180, 5)"),
        (P(*SEED), "@E", "@E P(364.16, 0, 278.5355, 180, 0, 180, 5)"),
        (J(1, 2), "@ p", "@P J(1, 2)"),
        (V(1, 2, 3), PassMark("n", 10), "@10 V(1, 2, 3)"),
        (T(*range(10)), "@0", "@0 T(0, 1, 2, 3, 4, 5, 6, 7, 8, 9)"),
        ("P1", "@E", "@E P1"),
        ("  anything", "", "  anything"),
        ("@E P1", "", "@E P1"),
        (Target("P", 1, AT_ENCODER), "", "@E P1"),
        (Target("P", 1), "@E", "@E P1"),
    ],
)
def test_text_that_a_client_sends(pose, mark, text):
    assert to_text(pose, mark) == text


@pytest.mark.parametrize(
    ("pose", "mark", "error", "message"),
    [
        ("@E P1", "@P", InvalidValue, "'@E P1' already has a pass mark, @P cannot be added"),
        (" \n@E P1", "@P", InvalidValue, "already has a pass mark"),
        (Target("P", 1, AT_ENCODER), AT_ENCODER, InvalidValue, "already has a pass mark"),
        ("P1", "E", NotationError, 'column 1: expected a pass mark ("@P", "@E", "@0", or "@10" for 10 mm), found'),
        (J(1), "E", NotationError, "pass mark"),
        (J(1), 10, InvalidValue, '10 is not a pass mark. Try: a text, "@P", "@E", "@0", or "@10" for 10 mm'),
        (J(1), None, InvalidValue, "None is not a pass mark"),
        (
            [1, 2, 3],
            "",
            InvalidValue,
            r"[1, 2, 3] is not a pose. Try: P(...), T(...), J(...), V(...) or a text like 'P1'",
        ),
        (None, "", InvalidValue, "None is not a pose"),
    ],
)
def test_poses_that_a_client_cannot_send(pose, mark, error, message):
    with pytest.raises(error, match=re.escape(message)):
        to_text(pose, mark)


def test_messages_in_japanese():
    i18n.use("ja")
    attempts = [
        (lambda: J(math.nan), "J: J1 は有限の数値でなければなりません (nan)"),
        (lambda: P(1, 2, 3, 4, 5, 6, 0.5), "P: fig の値 0.5 は 32 ビットの整数ではありません"),
        (lambda: P.of([1]), "P: 値は 6 または 7 個必要ですが、1 個指定されています"),
        (lambda: J(), "J: 値は 1～8 個必要ですが、0 個指定されています"),
        (lambda: Target("", range(11)), "ポーズ: 値は 1～10 個必要ですが、10 個より多く指定されています"),
        (lambda: parse_target("P"), "2 文字目: P 型変数の番号、または「(」と値が必要ですが、ここで終わっています"),
        (lambda: parse_target("P1 x"), "4 文字目: 文字列の終わりが必要ですが、'x' です"),
    ]
    for attempt, message in attempts:
        with pytest.raises(ValueError) as caught:
            attempt()
        assert str(caught.value) == message


# --- for every value --------------------------------------------------------------------------------------------------

numbers = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-400, 400).map(float)
figures = st.integers(-3, 512).map(float)
extras = st.builds(
    Extra, absolute=st.booleans(), joints=st.lists(st.tuples(st.sampled_from((7, 8)), numbers), min_size=1, max_size=2,
                                                   unique_by=lambda joint: joint[0]).map(tuple)
)  # fmt: skip
marks = st.sampled_from((AT_COMMAND, AT_ENCODER, PASSING)) | numbers.filter(lambda radius: radius > 0).map(
    lambda radius: PassMark("n", radius)
)
values = st.one_of(
    st.tuples(st.sampled_from("PTJV"), st.integers(0, 2**31 - 1)),
    st.tuples(st.just("P"), st.tuples(*[numbers] * 6) | st.tuples(*[numbers] * 6, figures)),
    st.tuples(st.just("T"), st.tuples(*[numbers] * 9) | st.tuples(*[numbers] * 9, figures)),
    st.tuples(st.just("J"), st.lists(numbers, min_size=1, max_size=8).map(tuple)),
    st.tuples(st.just("V"), st.tuples(*[numbers] * 3)),
    st.tuples(st.just(""), st.lists(numbers, min_size=1, max_size=10).map(tuple)),
)


@given(values, st.none() | marks, st.none() | extras)
def test_every_target_is_read_as_it_was_written(value, mark, extra):
    target = Target(*value, mark, extra)
    text = str(target)
    assume(len(text) <= 4096)
    assert parse_targets(text) == (target,)
    assert "e" not in text.lower().replace("ex", "").replace("@e", "")
    shuffled = text.lower().replace(" ", "")
    assert parse_target(shuffled) == target


@given(st.text(st.sampled_from("@PEX0A19.,()[]tjV e-+"), max_size=40) | st.text(max_size=20))
def test_any_text_ends_in_a_target_or_an_error(text):
    try:
        targets = parse_targets(text)
    except NotationError as error:
        column = re.match(r"column (\d+): expected ", str(error))
        assert column
        assert 1 <= int(column[1]) <= len(text) + 1
    else:
        assert parse_targets(", ".join(map(str, targets))) == targets
