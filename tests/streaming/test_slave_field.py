"""An additional row of the table of slave-mode fields, from the virtual controller to the files of a recording.

The row is added to a copy of the package, which the program and the streaming process both import.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import pytest

import orinkit
from orinkit.client._shared.stream_options import FeedbackField
from orinkit.rc8 import slave_fields
from orinkit.rc8.slave_feedback import SlaveReply
from orinkit.rc8.slave_formats import SetPoint
from orinkit.streaming.process.record_layout import WORD, RecordLayout
from orinkit.streaming.process.shared_memory import Outputs
from orinkit.streaming.recording.samples import OWN
from orinkit.virtual.rc8.robot.slave_feedback import SOURCES

ROW = """
    SlaveField(name="temperature", label=N_("temperature"), form=FieldType.REAL, place=7, receive=0x400, text=N_("of the arm, deg C")),
"""
END_OF_ROWS = ')  # fmt: skip\n"""The rows of the table."""'

PROGRAM = """
import json
import sys

import orinkit
from orinkit.core.errors import CallError
from orinkit.streaming.recording.recorder import open_recorder
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.robot.slave_feedback import SOURCES

with orinkit.serve(VirtualRC8(motor=True), "tcp://127.0.0.1:0") as server, orinkit.connect(server.url) as rc8:
    robot = rc8.robot()
    with robot.arm():
        try:
            robot.execute("slvRecvFormat", [0x412, 1])
        except CallError as error:
            refused = error.code
        SOURCES["temperature"] = lambda moment: 30.0 + moment.here.angles()[1] / 10  # J2 stands at 45 deg
        here = robot.joints
        recv = ("joints", "current", "temperature")
        with robot.slave_mode(recv=recv, hand=3, record="run.csv") as stream:
            samples = stream.run([here] * 5).samples
with open_recorder("run.mcap", kind="J", period=0.008) as recorder:
    for sample in samples:
        recorder.write(sample)
print(json.dumps([orinkit.__file__, refused, [sample.more for sample in samples], recorder.error]))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    """Run the program with the additional row; return its directory and its output."""
    folder = tmp_path_factory.mktemp("field")
    package = folder / "orinkit"
    shutil.copytree(Path(orinkit.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    table = package / "rc8" / "slave_fields.py"
    text = table.read_text(encoding="utf-8")
    assert text.count(END_OF_ROWS) == 1
    table.write_text(text.replace(END_OF_ROWS, ROW + END_OF_ROWS), encoding="utf-8")
    (folder / "program.py").write_text(PROGRAM, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(folder), "ORINKIT_LANG": "en"}
    done = subprocess.run(
        [sys.executable, "program.py"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_a_row_reaches_the_client(run: tuple[Path, list[Any]]) -> None:
    folder, (imported, _, fields, error) = run
    assert Path(imported).is_relative_to(folder)
    assert len(fields) >= 5
    assert error is None
    for each in fields:
        assert each == {"temperature": pytest.approx(34.5, abs=0.01)}


def test_a_row_without_a_source_is_not_implemented(run: tuple[Path, list[Any]]) -> None:
    assert run[1][1] == 0x80004001  # E_NOTIMPL


def test_a_row_is_a_column_of_a_csv_file(run: tuple[Path, list[Any]]) -> None:
    with (run[0] / "run.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]][-9:] == [*(f"current_{axis}" for axis in range(1, 9)), "temperature"]
    assert {row["temperature"] for row in rows} == {"34.500000"}
    assert {row["J2_encoder"] for row in rows} == {"45.000000"}


def test_a_row_is_in_the_messages_of_an_mcap_file(run: tuple[Path, list[Any]]) -> None:
    reader = pytest.importorskip("mcap.reader")
    with (run[0] / "run.mcap").open("rb") as file:
        messages = list(reader.make_reader(file).iter_messages(topics=["/slave/sample"]))
    schema = json.loads(messages[0][0].data)["properties"]["temperature"]
    assert schema == {"type": "number", "description": "of the arm, deg C"}
    assert {json.loads(message.data)["temperature"] for _, _, message in messages} == {34.5}


# --- what is written out for type checkers has what the rows have -----------------------------------------------------


def test_the_words_of_recv() -> None:
    assert set(get_args(FeedbackField)) == {row.name for row in slave_fields.WORDS}


def test_every_row_has_its_attributes() -> None:
    assert {row.name for row in slave_fields.RECEIVED} == OWN
    assert SlaveReply.of({row.name: 1 for row in slave_fields.RECEIVED}).more == {}
    assert set(Outputs.__slots__) == {row.name for row in slave_fields.OUTPUTS}
    assert {"pose", "extra", *(row.name for row in slave_fields.PARAMETERS)} == set(SetPoint.__slots__)


def test_the_virtual_controller_has_a_source_for_every_row() -> None:
    assert SOURCES.keys() == {row.name for row in slave_fields.RECEIVED}


def test_rows_have_bits_and_names_of_their_own() -> None:
    for rows, column in (
        (slave_fields.RECEIVED, "receive"),
        (slave_fields.OUTPUTS, "send"),
        (slave_fields.FIELDS, "name"),
    ):
        values = [getattr(row, column) for row in rows if getattr(row, column)]
        assert len(values) == len(set(values))
    assert not slave_fields.POSE_MASK & sum(slave_fields.RECEIVE_BITS)


# --- records of the shared memory -------------------------------------------------------------------------------------


def test_currents_of_six_axes_do_not_get_those_of_an_earlier_sample() -> None:
    layout, view = RecordLayout(slave_fields.RECEIVED), memoryview(bytearray(1024))
    layout.write(view, 0, [("current", (9.0,) * 8)])
    flags = layout.write(view, 0, [("current", (1.0,) * 6), ("user", b"\1\xff"), ("mini", -1), ("time", None)])
    assert layout.read(view, 0, flags) == {"current": (1.0,) * 6, "user": b"\1\xff", "mini": -1}


def test_a_record_that_is_being_overwritten_can_be_read() -> None:
    layout = RecordLayout(slave_fields.RECEIVED)
    for byte in (0x00, 0x7F, 0xFF):
        view = memoryview(bytes([byte]) * layout.size * WORD)
        for flags in (-1, 2**40, 1 << len(slave_fields.RECEIVED)):
            found = layout.read(view, 0, flags)
            assert len(found.get("current", ())) <= 8
            assert len(found.get("user", b"")) <= slave_fields.MOST_USER_BYTES
