"""demo: the programs of the document against the virtual RC8, and replies that differ from the document."""

from __future__ import annotations

import dataclasses
import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from orinkit import StreamResult, Timing, functions
from orinkit.bcap import packet
from orinkit.bcap.pcapng import CaptureConnection
from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.transcript import Transcript
from orinkit.cli.app import main
from orinkit.cli.demo import stream
from orinkit.cli.demo.rc8 import compare, run_program
from orinkit.cli.demo.steps import (
    LIST_3_1,
    LIST_4_1,
    LISTS,
    DemoProgram,
    DemoStep,
    HandleOf,
    StreamStep,
    a_handle,
    a_text,
    an_error,
    exactly,
    near_first,
    near_p1,
    nothing,
    sine,
)
from orinkit.core import hresult, i18n
from orinkit.streaming.recording.samples import Sample
from orinkit.values.poses import J
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType, variant
from orinkit.virtual.rc8 import VirtualRC8
from support.tshark import Tshark, assert_named, needs_tshark

pytestmark = pytest.mark.slow

STEPS = [step for program in LISTS.values() for step in program.steps]
CALLS = [step for step in STEPS if isinstance(step, DemoStep)]
SET_POINTS = 304
ANSWERS = len(CALLS) + SET_POINTS


def run_once(texts: str, *argv: str) -> str:
    """Run the demo once for several tests, because it is slow."""
    before = i18n.current()
    i18n.use(texts)
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        code = main(["demo", *argv])
    i18n.use(before)
    assert (code, err.getvalue()) == (0, "")
    return out.getvalue()


@pytest.fixture(scope="module")
def pictures(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("pictures")


@pytest.fixture(scope="module")
def shown(pictures) -> str:
    """The output of the demo."""
    return run_once("en", "--picture", str(pictures / "motion.png"))


@pytest.fixture(scope="module")
def japanese() -> str:
    """The output in Japanese, with the fields of the packets."""
    return run_once("ja", "--fields")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """The output as JSON."""
    output: dict[str, Any] = json.loads(run_once("en", "--json"))
    return output


def test_the_transcript_shows_every_packet_and_the_verdict(shown):
    lines = shown.splitlines()
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
        '    → Service_Start("WDT=400")',
        '    → Robot_Execute(3, "Takearm", [0, 1])',
        '    → Robot_Execute(3, "ExtSpeed", [20.0])',
        '    → Robot_Move(3, 1, "@E J(45, 30, 120, 0, -60, 0)", "")',
        '    → Robot_Execute(3, "slvGetMode", VT_EMPTY)',
        "      01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04",
    ):
        assert line in lines
    requests, executing = shown.count("→"), shown.count("← S_EXECUTING\n")
    assert shown.count("←") - executing == requests > len(CALLS)
    assert f"All {ANSWERS} replies match the document." in lines


@needs_tshark
@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_tshark_names_every_packet(document, tmp_path, transport):
    """Each list of the document has a connection of its own."""
    packets = [
        (">" if each["direction"] == "request" else "<", bytes.fromhex(each["bytes"]), connection)
        for port, name in enumerate(LISTS, 40000)
        for connection in [CaptureConnection(transport, ("127.0.0.1", port), ("127.0.0.1", 5007))]
        for step in document["steps"]
        if step["list"] == name
        for each in step.get("packets", [])
    ]
    assert len(packets) > 2 * len(CALLS)
    found = Tshark(tmp_path).dissect(packets)
    assert_named(found, packets)


def test_the_sine_is_shown_while_it_is_streamed(shown):
    lines = [line.split() for line in shown.splitlines() if line.endswith("/304")]
    assert len(lines) > 5
    first = [float(line[1]) for line in lines]
    assert [line[-1] for line in lines].count("304/304") == 1
    assert lines[-1][-1] == "304/304"
    assert min(first) == pytest.approx(45, abs=2)
    assert 60 < max(first) < 65.01
    for words in (
        "set-points         304\n",
        "underflows         0\n",
        "largest deviation  J1 ",
        "gaps               p50 ",
    ):
        assert f"      {words}" in shown


def test_the_joints_are_shown_while_the_arm_moves(shown, pictures):
    joints = [float(line.split()[1]) for line in shown.splitlines() if line.startswith("      J1 ") and "/" not in line]
    assert len(joints) > 6
    assert joints[0] == 0
    assert max(joints) == joints[-1] == pytest.approx(45, abs=0.01)
    for name in ("motion.png", "slave.png"):
        assert (pictures / name).read_bytes().startswith(b"\x89PNG")
        assert str(pictures / name) in shown.splitlines()[-1]


def test_as_json(document):
    output = document
    assert output["as_documented"] is True
    assert output["picture"] is None
    numbers = [(name, number) for name, program in LISTS.items() for number, _ in enumerate(program.steps, 1)]
    assert [(step["list"], step["number"]) for step in output["steps"]] == numbers
    assert sum(step["answers"] for step in output["steps"]) == ANSWERS
    for step, expected in zip(output["steps"], STEPS, strict=True):
        if isinstance(expected, StreamStep):
            assert (step["stream"]["set_points"], step["stream"]["underflows"]) == (SET_POINTS, 0)
            continue
        request, *_, reply = (packet.decode(bytes.fromhex(each["bytes"])) for each in step["packets"])
        assert request.code == expected.function.id
        assert (reply.serial, reply.code) == (request.serial, 0)


def test_field_by_field_in_japanese(japanese):
    assert " 1. この接続のサービスを開始する  [RC8 3.1.1]" in japanese
    for words in ("関数 ID", "リターンコード", "バッファ枯渇"):
        assert words in japanese
    assert japanese.splitlines()[-1] == f"{ANSWERS} 件の応答はすべて仕様書のとおりでした。"


def test_the_sine_of_the_document():
    points = sine([45.0, 30.0, 120.0, 0.0, -60.0, 0.0, 0.0, 0.0])
    assert len(points) == SET_POINTS == 3 * 101 + 1
    assert points[0] == points[100] == points[101] == points[-1] == (45, 30, 120, 0, -60, 0)
    assert points[50] == points[151] == pytest.approx((65, 50, 120, 0, -60, 0))
    assert points[25] == pytest.approx((55, 40, 120, 0, -60, 0))


def streamed(**changed: object) -> StreamResult:
    """Return the stream result of List 4-1, with changes."""
    points = sine((45.0, 30.0, 120.0, 0.0, -60.0, 0.0))
    samples = tuple(
        Sample(number, number * 0.008, point, time=number * 0.008, joints=J(*point))
        for number, point in enumerate(points)
    )
    return dataclasses.replace(StreamResult(len(points), 0, samples, 0, Timing()), **changed)


def with_sample(number: int, **changed: object) -> StreamResult:
    samples = list(streamed().samples)
    samples[number] = dataclasses.replace(samples[number], **changed)
    return streamed(samples=tuple(samples))


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (streamed(underflows=1), "1 underflows"),
        (streamed(missed=2), "2 samples overwritten before they were read"),
        (streamed(sent=303), "303 of 304"),
        (with_sample(7, command=(0.0,) * 6), "differ from those given"),
        (with_sample(7, code=hresult.E_BUF_FULL), "set-point 7"),
        (with_sample(7, joints=None), "set-point 7"),
        (with_sample(7, time=9.0), "backwards"),
        (with_sample(7, time=None), "backwards"),
        (with_sample(-1, joints=J(50, 30, 120, 0, -60, 0)), "the final joint position is wrong"),
    ],
)
def test_the_replies_of_slave_mode_are_compared(result, words):
    points = sine((45.0, 30.0, 120.0, 0.0, -60.0, 0.0))
    assert stream.deviation_from_document(streamed(), points) == ""
    assert stream.deviation_from_document(with_sample(3, code=hresult.S_BUF_FULL), points) == ""
    assert words in stream.deviation_from_document(result, points)


def test_the_stream_is_repeated_on_a_busy_computer():
    output: list[str] = []
    documents: list[dict[str, Any]] = []
    steps = list(LIST_4_1)
    devices: list[VirtualRC8] = []
    steps[0] = dataclasses.replace(steps[0], before=devices.append)

    def say(line: str) -> None:
        output.append(line)
        sent = re.search(r" (\d+)/304$", line)
        if sent and 50 <= int(sent[1]) < 250 and not any("too busy" in each for each in output):
            devices[0].raise_error(hresult.COMMAND_DELAY)

    run_program("List 4-1", DemoProgram("it", tuple(steps)), documents, say, fields=False)
    assert any("COMMAND_DELAY" in line for line in output)
    assert sum("too busy" in line for line in output) == 1
    assert sum("slvRecvFormat" in line for line in output) == 2
    assert sum(document["answers"] for document in documents) == len(steps) - 1 + SET_POINTS


def test_the_steps_are_those_of_the_sample():
    sample = [
        functions.service_start, functions.controller_connect, functions.controller_get_variable,
        functions.variable_get_value, functions.variable_put_value, functions.variable_release,
        functions.controller_disconnect, functions.service_stop,
    ]  # fmt: skip
    called = [step.function for step in LIST_3_1]
    assert [function for function in dict.fromkeys(called) if function in sample] == sample
    assert LIST_3_1[4].arguments == (HandleOf("IO150"), Variant(VarType.I4, -1))
    assert LISTS["List 3-1"].steps is LIST_3_1


def with_check(number: int, check) -> DemoProgram:
    steps = list(LIST_3_1)
    steps[number - 1] = dataclasses.replace(steps[number - 1], check=check)
    return DemoProgram("it", tuple(steps))


def test_a_reply_that_differs_ends_the_demo():
    output: list[str] = []
    with pytest.raises(CommandError) as caught:
        run_program("List", with_check(4, exactly(VarType.BOOL, True)), [], output.append, fields=False)
    assert str(caught.value) == (
        "List, 4. Read IO150: the point is off: the reply is [Variant(VT_BOOL, False)]; "
        "the document has Variant(VT_BOOL, True)"
    )
    assert caught.value.code == 1
    assert "← S_OK -> False" in output[-1]


def test_an_error_ends_the_demo():
    steps = (LIST_3_1[0], dataclasses.replace(LIST_3_1[1], arguments=("", "CaoProv.Nobody", "", "")))
    with pytest.raises(CommandError, match="E_CAO_PROV_INVALID"):
        run_program("List", DemoProgram("", steps), [], lambda _line: None, fields=False)


@pytest.mark.parametrize(
    ("reply", "difference"),
    [
        (packet.pack(8, 0, 0, b""), "(8, 0, 0); the document has (7, 0, 0)"),
        (packet.pack(7, 0, 0, b"", 7), "(7, 7, 0); the document has (7, 0, 0)"),
        (packet.pack(7, 1, 0, b""), "(7, 0, 1); the document has (7, 0, 0)"),
        (None, "expected one request and one reply"),
    ],
)
def test_the_header_of_a_reply_is_compared_too(reply, difference):
    transcript = Transcript()
    transcript(">", packet.pack(7, 1, 0, b""))
    if reply is not None:
        transcript("<", reply)
    assert difference in compare(transcript.packets, LIST_3_1[0])
    assert compare([], LIST_3_1[0]) != ""


def test_s_executing_may_come_before_a_reply():
    transcript = Transcript()
    for direction, code in ((">", 1), ("<", hresult.S_EXECUTING), ("<", hresult.S_EXECUTING), ("<", 0)):
        transcript(direction, packet.pack(7, code, 0, b""))
    assert compare(transcript.packets, LIST_3_1[0]) == ""
    assert compare(transcript.packets[:3], LIST_3_1[0]) != ""
    assert compare([*transcript.packets, transcript.packets[-1]], LIST_3_1[0]) != ""
    assert compare([transcript.packets[0], *transcript.packets], LIST_3_1[0]) != ""


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
        (near_first, [variant([45.0, 30.0, 120.0, 0.0, -60.0, 0.0, 0.0, 0.0])], [variant([45.0, 30.0])]),
        (near_first, [variant([45.0, 30.0, 120.0, 0.0, -60.0, 0.0, 0.0, 0.0])], [variant([45.0] * 8)]),
        (near_p1, [variant([330.0, 180.0, 320.0, 180.0, 0.0, 180.0, 5.0])], [variant([330.0, 180.0])]),
        (near_p1, [variant([330.0, 180.0, 320.0, 180.0, 0.0, 180.0, 5.0])], [variant(1)]),
    ],
)
def test_the_checks_can_fail(check, right, wrong):
    assert check(right) == ""
    assert check(wrong) != ""
