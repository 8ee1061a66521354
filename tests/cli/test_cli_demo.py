"""demo: the document's programs against the virtual RC8, and what happens when an answer is not as documented."""

from __future__ import annotations

import dataclasses

import pytest

from orinkit import functions, language
from orinkit.bcap import packet
from orinkit.cli._demo_steps import (
    LIST_3_1,
    LISTS,
    Handle,
    Program,
    a_handle,
    a_text,
    an_error,
    exactly,
    near_p1,
    nothing,
)
from orinkit.cli._errors import Failure
from orinkit.cli._transcript import Transcript
from orinkit.cli.demo import compare, run_program
from orinkit.variant import VARIANT_ARRAY, Variant, VarType, variant

STEPS = [step for program in LISTS.values() for step in program.steps]


def test_the_transcript_shows_every_packet_and_says_that_all_is_well(run):
    done = run("demo")
    assert (done.code, done.err) == (0, "")
    assert done.out.count("→") == done.out.count("←") == len(STEPS)
    for line in (
        '    → Controller_Connect("", "CaoProv.DENSO.VRC", "localhost", "")',
        '    → Controller_GetVariable(2, "IO150", "")',
        "    → Variable_PutValue(3, -1)",
        "    ← S_OK -> True",
        '    → Controller_Execute(2, "ClearError", VT_EMPTY)',
        '    → Controller_GetTask(2, "Pro1", "")',
        '    → Task_Start(3, 2, "")',
        '    → Robot_Execute(3, "Takearm", "")',
        '    → Robot_Move(3, 1, "P1", "")',
        "      01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04",
    ):
        assert line in done.out.splitlines()
    assert done.out.splitlines()[-1] == f"All {len(STEPS)} answers are as the document says."


def test_as_json(run):
    said = run("demo", "--json").json
    assert said["as_documented"] is True
    numbers = [(name, number) for name, program in LISTS.items() for number, _ in enumerate(program.steps, 1)]
    assert [(step["list"], step["number"]) for step in said["steps"]] == numbers
    for step, expected in zip(said["steps"], STEPS, strict=True):
        request, reply = (packet.decode(bytes.fromhex(each["bytes"])) for each in step["packets"])
        assert request.code == expected.function.id
        assert (reply.serial, reply.code) == (request.serial, 0)


def test_field_by_field(run):
    out = run("demo", "--fields").out
    assert "function id" in out
    assert "return code" in out
    assert "Variable handle" in out


def test_in_japanese(run):
    language.use("ja")
    out = run("demo").out
    assert " 1. この接続のサービスを開始する  [RC8 3.1.1]" in out
    assert out.splitlines()[-1] == f"{len(STEPS)} 件の応答はすべて仕様書のとおりでした。"


def test_the_steps_are_those_of_the_sample():
    sample = [
        functions.service_start, functions.controller_connect, functions.controller_get_variable,
        functions.variable_get_value, functions.variable_put_value, functions.variable_release,
        functions.controller_disconnect, functions.service_stop,
    ]  # fmt: skip
    called = [step.function for step in LIST_3_1]
    assert [function for function in dict.fromkeys(called) if function in sample] == sample
    assert LIST_3_1[4].arguments == (Handle("IO150"), Variant(VarType.I4, -1))
    assert LISTS["List 3-1"].steps is LIST_3_1


def test_the_joints_are_shown_while_the_arm_moves(run, tmp_path):
    picture = tmp_path / "motion.png"
    out = run("demo", "--picture", str(picture)).out
    shown = [float(line.split()[1]) for line in out.splitlines() if line.startswith("      J1 ")]
    assert len(shown) > 3
    assert shown[0] < 1 < 20 < max(shown)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert str(picture) in out


def with_check(number: int, check) -> Program:
    steps = list(LIST_3_1)
    steps[number - 1] = dataclasses.replace(steps[number - 1], check=check)
    return Program("it", "それ", tuple(steps))


def test_an_answer_that_differs_ends_the_demo():
    said: list[str] = []
    with pytest.raises(Failure) as caught:
        run_program("List", with_check(4, exactly(VarType.BOOL, True)), [], said.append, fields=False)
    assert str(caught.value) == (
        "List, 4. Read it: the point is off: answered with [Variant(VT_BOOL, False)], "
        "the document has Variant(VT_BOOL, True)"
    )
    assert caught.value.code == 1
    assert "← S_OK -> False" in said[-1]


def test_an_error_ends_the_demo():
    steps = (LIST_3_1[0], dataclasses.replace(LIST_3_1[1], arguments=("", "CaoProv.Nobody", "", "")))
    with pytest.raises(Failure, match="E_CAO_PROV_INVALID"):
        run_program("List", Program("", "", steps), [], lambda _line: None, fields=False)


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (packet.pack(8, 0, 0, b""), "(8, 0, 0), (7, 0, 0) was expected"),
        (packet.pack(7, 0, 0, b"", 7), "(7, 7, 0), (7, 0, 0) was expected"),
        (packet.pack(7, 1, 0, b""), "(7, 0, 1), (7, 0, 0) was expected"),
        (None, "one request and one reply were expected"),
    ],
)
def test_the_head_of_a_reply_is_compared_too(reply, said):
    transcript = Transcript()
    transcript(">", packet.pack(7, 1, 0, b""))
    if reply is not None:
        transcript("<", reply)
    assert said in compare(transcript.packets, LIST_3_1[0])
    assert compare([], LIST_3_1[0]) != ""


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        (nothing, [], [Variant(VarType.EMPTY)]),
        (a_handle, [Variant(VarType.I4, 2)], [Variant(VarType.I4, 0)]),
        (a_handle, [Variant(VarType.I4, 2)], []),
        (a_handle, [Variant(VarType.I4, 2)], [Variant(VarType.I2, 2)]),
        (exactly(VarType.EMPTY), [Variant(VarType.EMPTY)], []),
        (exactly(VarType.I4, 3), [Variant(VarType.I4, 3)], [Variant(VarType.I2, 3)]),
        (a_text, [Variant(VarType.BSTR, "x")], [Variant(VarType.BSTR, "")]),
        (a_text, [Variant(VarType.BSTR, "x")], []),
        (an_error(5), [Variant(VARIANT_ARRAY, [5, "x"])], [Variant(VARIANT_ARRAY, [6, "x"])]),
        (an_error(5), [Variant(VARIANT_ARRAY, [5, "x"])], [Variant(VARIANT_ARRAY, [5])]),
        (an_error(5), [Variant(VARIANT_ARRAY, [5, "x"])], [Variant(VarType.I4, 5)]),
        (near_p1, [variant([330.0, 180.0, 320.0, 180.0, 0.0, 180.0, 5.0])], [variant([330.0, 180.0])]),
        (near_p1, [variant([330.0, 180.0, 320.0, 180.0, 0.0, 180.0, 5.0])], [variant(1)]),
    ],
)
def test_the_checks_can_fail(check, right, wrong):
    assert check(right) == ""
    assert check(wrong) != ""
