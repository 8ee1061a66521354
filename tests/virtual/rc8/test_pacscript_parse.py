from __future__ import annotations

from time import process_time

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.virtual.rc8.pacscript import tree
from orinkit.virtual.rc8.pacscript.compiler import compile_program
from orinkit.virtual.rc8.pacscript.errors import ProgramLoadError
from orinkit.virtual.rc8.pacscript.functions import FUNCTIONS
from orinkit.virtual.rc8.pacscript.keywords import KEYWORDS, REFUSED, STARTERS
from orinkit.virtual.rc8.pacscript.machine import Machine, MachineState
from orinkit.virtual.rc8.pacscript.parser import parse
from orinkit.virtual.rc8.samples import sample_programs
from support.pacscript_world import FakeWorld, after, body, run


def kinds(source: str) -> list[str]:
    return [type(statement).__name__ for statement in parse(source, "f")]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("", []),
        ("\n\n' only comments\nRem and this : I1 = 2\n", []),
        ("I1 = 1 ' a comment", ["Assign"]),
        ("I1 = 1 : I2 = 2", ["Assign", "Assign"]),
        ("I1 = _\n 1", ["Assign"]),
        ("I1 = 1\r\nI2 = 2\rI3 = 3", ["Assign", "Assign", "Assign"]),
        ("\ufeffI1 = 1", ["Assign"]),
        ("\u3000I1 = 1", ["Assign"]),
        ('#Pragma Encoding("UTF-8")\nI1 = 1', ["Assign"]),
        ("*here: I1 = 1", ["Label", "Assign"]),
        ("*here\nI1 = 1", ["Label", "Assign"]),
        ("here: I1 = 1", ["Label", "Assign"]),
        ("here : I1 = 1", ["Call", "Assign"]),
        ("ENDIF", ["KeywordStatement"]),
        ("end   if", ["KeywordStatement"]),
        ("MOVE P, P1", ["Motion"]),
        ("Foo", ["Call"]),
        ("Foo 1, 2", ["Call"]),
        ("Call Foo(1, 2)", ["Call"]),
        ("Let I1 = 2", ["Assign"]),
    ],
)
def test_a_source_becomes_statements(source, expected):
    assert kinds(source) == expected


def test_places_count_from_one():
    first, second = parse("\n  I1 = 1 : 変数 = 2\n", "f")
    assert first.at == (2, 3)
    assert second.at == (2, 12)


def test_a_position_after_a_line_continuation_is_that_of_the_physical_line():
    (statement,) = parse("I1 = _\n   I2\n", "f")
    assert isinstance(statement, tree.Assign)
    assert statement.value.at == (2, 4)


def test_the_parts_of_a_motion():
    (motion,) = parse("Move L, @10 P1 ExA((7, 5)), S = 50, Next", "f")
    assert isinstance(motion, tree.Motion)
    letter, pose, option, following = motion.items
    assert isinstance(letter.value, tree.Name)
    assert letter.value.key == "l"
    assert pose.mark is not None
    assert pose.mark.mode == "n"
    assert pose.extra is not None
    assert pose.extra.absolute
    assert isinstance(option.value, tree.Binary)
    assert following.value is None


def test_the_arguments_of_a_call_are_the_same_in_every_form():
    for source in ("Foo 1, 2", "Foo(1, 2)", "Call Foo(1, 2)", "Foo (1), 2"):
        (call,) = parse(source, "f")
        assert isinstance(call, tree.Call)
        assert [argument.value for argument in call.arguments if isinstance(argument, tree.Literal)] == [1, 2]


@pytest.mark.parametrize(
    ("expression", "shown"),
    [
        ("1 + 2 * 3", "7"),
        ("(1 + 2) * 3", "9"),
        ("2 ^ 3 ^ 2", "64"),
        ("-2 ^ 2", "-4"),
        ("2 ^ -1", "0.5"),
        ("10 - 3 - 2", "5"),
        ("12 / 3 / 2", "2"),
        ("10 \\ 2 * 2", "2"),
        ("20 Mod 12 \\ 5", "0"),
        ("7 Mod 3 + 1", "2"),
        ("-7 \\ 2", "-3"),
        ("-7 Mod 2", "-1"),
        ("1 + 2 & 3 + 4", "37"),
        ("1 << 2 + 1", "8"),
        ("&HFF >> 4", "15"),
        ("1 + 1 = 2", "-1"),
        ("Not 1 = 2", "-1"),
        ("Not 5", "-6"),
        ("True Or False And False", "-1"),
        ("6 And 3", "2"),
        ("6 Xor 3", "5"),
        ("1 Xor 1 Or 2", "2"),
        ("3 > 2 And 2 > 1", "-1"),
        ('"a" < "b"', "-1"),
        ('"a" + "b"', "ab"),
        ('"say ""yes"""', 'say "yes"'),
        ("&H1F", "31"),
        ("&hffffffff", "-1"),
        ("&B101", "5"),
        (".5", "0.5"),
        ("1.5e3", "1500"),
        ("2147483647", "2147483647"),
        ("7 / 2", "3.5"),
        ("1 <= 1", "-1"),
        ("1 => 2", "0"),
        ("1 <> 1", "0"),
        ("On", "1"),
        ("Off", "0"),
        ("True", "-1"),
        ("Not True", "0"),
        ("Pi", "3.141592653589793"),
    ],
)
def test_operators_have_the_documented_precedence(expression, shown):
    assert after("Dim v As Variant", f"v = {expression}", "PrintDbg v").shown == [("dbg", shown, "")]


def test_names_are_the_same_in_any_case():
    assert after("DIM Count AS integer", "count = 2", "i1 = COUNT").values == {("I", 1): 2}


def test_names_may_be_japanese():
    assert after("Dim 個数 As Integer", "個数 = 3", "I1 = 個数").values == {("I", 1): 3}


def test_a_program_lists_its_subs_and_the_lines_of_its_statements():
    source = "Sub Main\n  Dim a As Integer\n  ' nothing\n  a = 1\n\n  Work1\nEnd Sub\nSub Work1\nEnd Sub\n"
    program = compile_program(source, "dir\\Pro1.pcs")
    assert program.file == "dir\\Pro1.pcs"
    assert program.subs == ("Main", "Work1")
    assert program.lines == (4, 6, 7, 9)


def test_the_samples_load():
    assert [*sample_programs()] == ["Pro1.pcs", "Pro2.pcs", "Pro3.pcs"]
    for name, source in sample_programs().items():
        assert compile_program(source, name).subs[0] == "Main"
        assert not source.splitlines()[0].isascii()


# --- arbitrary input --------------------------------------------------------------------------------------------------

_WORDS = st.sampled_from(
    [
        *KEYWORDS, *STARTERS, *REFUSED, *FUNCTIONS, "Sub Main\n", "End Sub\n", "\n", "\n", ":", "(", ")", ",", "'", "_\n",
        "[", "]", "@P", "@10", "=", "=", "+", "-", "*", "/", "\\", "^", "&", "<", ">", "<=", "<<", "1", "2.5", "&HF", '"s"',
        "x", "x", "f(1)", "I1", "P[2]", "IO[3]", "P(1,2,3)", "*label", "label:", "As Integer", "#Include", "P", "L", "S",
    ]
)  # fmt: skip
_MUTATIONS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 20), st.one_of(_WORDS, st.text(max_size=3))), min_size=1, max_size=4
)


def loads_or_is_rejected(source: str) -> None:
    rejection = None
    try:
        program = compile_program(source, "f")
    except ProgramLoadError as error:
        rejection = error
    if rejection is not None:
        assert rejection.line >= 1
        assert rejection.column >= 1
        assert rejection.message
        return
    machine = Machine(program, FakeWorld())
    for _ in range(10):
        machine.run(20)
    assert machine.state in MachineState
    assert machine.line >= 1


@given(st.text())
def test_any_text_loads_or_is_rejected(source):
    loads_or_is_rejected(source)


@given(st.lists(_WORDS, max_size=40).map(" ".join))
@example("ForceChangeTable CurPos")
def test_any_words_load_or_are_rejected(source):
    loads_or_is_rejected(source)
    loads_or_is_rejected(body("Dim x As Integer", source))


@given(st.sampled_from([*sample_programs().values()]), _MUTATIONS)
def test_a_damaged_program_loads_or_is_rejected(source, mutations):
    for where, length, text in mutations:
        at = int(where * len(source))
        source = source[:at] + text + source[at + length :]
    loads_or_is_rejected(source)


@pytest.mark.parametrize(
    "source",
    [
        "(" * 100_000,
        "I1 = " + "(_\n" * 60_000,
        "I1 = 1" + " +_\n 1" * 30_000,
        body("I1 = 1" + "+1" * 500),
        body("I1 = " + "-" * 1000 + "1"),
        body("I1 = " + "Not " * 200 + "1"),
        body(*["If I1 = 0 Then"] * 5000),
        body(*["For I1 = 0 To 1"] * 5000),
        '"' * 200_000,
        body("S1 = " + '"a"' * 300),
        "&" * 200_000,
        "*" * 1000,
        "9" * 1000,
        "_" * 1000,
        "Sub Main\n" * 20_000,
        "\n" * 100_000,
        "x" * 262_145,
    ],
    ids=range(17),
)
def test_hostile_input_is_processed_in_bounded_time(source):
    began = process_time()  # CPU time: the machine may be busy with other processes
    loads_or_is_rejected(source)
    assert process_time() - began < 20


def test_deep_blocks_run():
    deep = 300
    machine = run(body(*["If I1 = 0 Then"] * deep, "I1 = 1", *["End If"] * deep))
    assert machine.state is MachineState.DONE
