"""Recordings can be read again, and errors of a file never stop a stream."""

from __future__ import annotations

import csv
import json
import math
import struct
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from orinkit.cli._shared.motion_record import read_csv
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, MissingExtra
from orinkit.streaming.recording.recorder import open_recorder
from orinkit.streaming.recording.samples import Sample
from orinkit.streaming.trajectory.csv_file import load_csv
from orinkit.streaming.trajectory.trajectory import read_trajectory
from orinkit.values.poses import J, P, T

PERIOD = 0.008
START = 1_700_000_000_000_000_000
FULL = Path("/dev/full")  # a full disk


def sample(number: int = 0, **changes) -> Sample:
    """Return a sample with all fields of the feedback; samples are sent in bursts, as in practice."""
    given = {
        "number": number,
        "sent": number // 3 * 3 * PERIOD + number % 3 * 0.0002,
        "command": (number / 10, 45.0, 90.0, 0.0, 45.0, 0.0),
        "code": 0x0F200501 if number % 3 == 2 else 0,
        "time": 100 + number * PERIOD,
        "joints": J(number / 10 - 0.05, 45, 90, 0, 45, 0, 0, 0),
        "position": P(364.16, 0, 278.5355, 180, 0, 180, 5),
        "mini": 0x0102,
        "hand": 3,
        "user": b"\x01\xff",
        "current": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.0, 0.0),
    }
    return Sample(**(given | changes))


def recorded(path, samples, kind="J"):
    with open_recorder(path, kind=kind, period=PERIOD, start_ns=START) as recorder:
        for each in samples:
            recorder.write(each)
    assert recorder.error is None
    assert recorder.count == len(samples)
    return path


def rows_of(path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


# --- CSV --------------------------------------------------------------------------------------------------------------


def test_the_columns(tmp_path):
    path = recorded(tmp_path / "x.csv", [sample(n) for n in range(4)])
    rows = rows_of(path)
    assert list(rows[0]) == [
        "time_s",
        *(f"J{joint}_command" for joint in range(1, 7)),
        *(f"J{joint}_encoder" for joint in range(1, 7)),
        "sent_s", "controller_s", "code",
        "X", "Y", "Z", "RX", "RY", "RZ", "Fig",
        "mini", "hand", "user",
        *(f"current_{joint}" for joint in range(1, 9)),
    ]  # fmt: skip
    assert [row["time_s"] for row in rows] == ["0.000000", "0.008000", "0.016000", "0.024000"]
    assert [row["sent_s"] for row in rows] == ["0.000000", "0.000200", "0.000400", "0.024000"]
    assert [int(row["code"], 16) for row in rows] == [0, 0, 0x0F200501, 0]
    assert float(rows[3]["J1_command"]) == pytest.approx(0.3)
    assert float(rows[3]["J1_encoder"]) == pytest.approx(0.25)
    assert (float(rows[3]["X"]), float(rows[3]["Fig"]), rows[3]["mini"], rows[3]["hand"]) == (364.16, 5, "258", "3")
    assert (rows[3]["user"], float(rows[3]["current_6"])) == ("01ff", 0.6)
    assert float(rows[3]["controller_s"]) == pytest.approx(100.024)


def test_a_recording_is_a_trajectory_and_can_be_plotted(tmp_path):
    path = recorded(tmp_path / "x.csv", [sample(n) for n in range(50)])
    commands = [sample(n).command for n in range(50)]
    assert load_csv(path) == ("J", PERIOD, commands)
    assert read_trajectory(path, "J", period=PERIOD) == commands
    recording = read_csv(path)
    assert list(recording.joints) == [1, 2, 3, 4, 5, 6]
    assert recording.times[:3] == pytest.approx([0, PERIOD, 2 * PERIOD])
    assert recording.encoder[10][0] == pytest.approx(0.95)


@pytest.mark.parametrize(
    ("kind", "command", "names"),
    [
        ("P", (400.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0), ["X", "Y", "Z", "RX", "RY", "RZ", "Fig"]),
        ("T", (400.0, 0.0, 300.0, 0.0, 1.0, 0.0, 0.0, 0.123456789, -0.9, 5.0),
         ["X", "Y", "Z", "OX", "OY", "OZ", "AX", "AY", "AZ", "Fig"]),
    ],
)  # fmt: skip
def test_positions(tmp_path, kind, command, names):
    answer = {"position": None, "trans": T(*command)} if kind == "T" else {}
    path = recorded(tmp_path / "x.csv", [sample(n, command=command, **answer) for n in range(3)], kind)
    assert list(rows_of(path)[0])[1:] [: len(names) + 6] == [
        *(f"{name}_command" for name in names), *(f"J{joint}_encoder" for joint in range(1, 7))
    ]  # fmt: skip
    assert set(names) < rows_of(path)[0].keys()
    assert load_csv(path) == (kind, PERIOD, [command] * 3)


def test_little_was_asked_for(tmp_path):
    path = recorded(tmp_path / "x.csv", [Sample(n, n * PERIOD, (1.0,) * 8) for n in range(2)])
    assert list(rows_of(path)[0]) == [
        "time_s", *(f"J{joint}_command" for joint in range(1, 9)), "sent_s", "code"
    ]  # fmt: skip
    assert load_csv(path)[2] == [(1.0,) * 8] * 2


def test_what_a_later_sample_lacks_is_empty_and_what_it_has_more_is_left_out(tmp_path):
    bare = Sample(1, 0.008, (1.0,) * 6)
    more = sample(2, current=(1.0,) * 20, command=(1.0,) * 8)
    rows = rows_of(recorded(tmp_path / "x.csv", [sample(0), bare, more]))
    assert rows[1]["J1_encoder"] == rows[1]["X"] == rows[1]["hand"] == ""
    assert len(rows[2]) == len(rows[0])


def test_seven_and_eight_joints(tmp_path):
    moved = J(1, 2, 3, 4, 5, 6, 7, 8)
    position = sample(0, command=(400.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0), joints=moved)
    assert "J8_encoder" in rows_of(recorded(tmp_path / "p.csv", [position], "P"))[0]
    joints = sample(0, command=tuple(moved), joints=moved)
    assert "J8_encoder" in rows_of(recorded(tmp_path / "j.csv", [joints]))[0]


def test_a_row_is_in_the_file_as_soon_as_it_was_written(tmp_path):
    recorder = open_recorder(tmp_path / "x.csv", kind="J", period=PERIOD)
    for number in range(3):
        recorder.write(sample(number))
        assert len(rows_of(tmp_path / "x.csv")) == number + 1
    recorder.close()


def test_an_empty_recording(tmp_path):
    path = recorded(tmp_path / "x.csv", [])
    with pytest.raises(InvalidValue, match="empty"):
        load_csv(path)


# --- MCAP -------------------------------------------------------------------------------------------------------------


def messages(path, topic):
    with path.open("rb") as file:
        return [
            (message, json.loads(message.data)) for _, _, message in make_reader(file).iter_messages(topics=[topic])
        ]


def test_mcap(tmp_path):
    path = recorded(tmp_path / "x.mcap", [sample(n, delay=0.012) for n in range(1000)])
    found = messages(path, "/slave/sample")
    assert [content["number"] for _, content in found] == list(range(1000))
    message, content = found[500]
    assert message.log_time == message.publish_time == START + round(sample(500).sent * 1e9)
    assert message.sequence == 500
    assert content == {
        "replied": 0.0,
        "number": 500,
        "sent": sample(500).sent,
        "command": list(sample(500).command),
        "code": 0x0F200501,
        "time": 104.0,
        "joints": [49.95, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0],
        "position": [364.16, 0.0, 278.5355, 180.0, 0.0, 180.0, 5.0],
        "mini": 258,
        "hand": 3,
        "user": "01ff",
        "current": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.0, 0.0],
        "delay": 0.012,
    }
    [(message, content)] = messages(path, "/slave/info")
    assert (content, message.log_time) == ({"kind": "J", "period": PERIOD}, START)


@pytest.mark.parametrize("words", ["en", "ja"])
def test_the_header_and_the_schemas(tmp_path, words):
    i18n.use(words)
    path = recorded(tmp_path / "x.mcap", [sample(0)])
    with path.open("rb") as file:
        reader = make_reader(file)
        assert (reader.get_header().profile, reader.get_header().library) == ("", "orinkit")
        schemas = {schema.name: json.loads(schema.data) for schema in reader.get_summary().schemas.values()}
        encodings = {schema.encoding for schema in reader.get_summary().schemas.values()}
    assert encodings == {"jsonschema"}
    fields = schemas["orinkit.streaming.Sample"]["properties"]
    assert fields.keys() == set(Sample.__slots__) - {"more"}
    assert fields["joints"]["items"] == {"type": "number"}
    assert "deg" in fields["joints"]["description"]
    assert fields["joints"]["description"].isascii() == (words == "en")


def recovered(path) -> list[int]:
    """Return the numbers of the samples that a streaming reader finds in an incomplete file."""
    found = []
    with path.open("rb") as file, suppress(McapError, struct.error):
        found.extend(record for record in StreamReader(file, validate_crcs=True).records)
    contents = [json.loads(record.data) for record in found if isinstance(record, Message)]
    return [content["number"] for content in contents if "number" in content]


@pytest.mark.parametrize("part", [0.2, 0.5, 0.9, 0.999])
def test_a_file_that_was_cut_off_has_its_whole_chunks(tmp_path, part):
    path = recorded(tmp_path / "x.mcap", [sample(n) for n in range(2000)])
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * part)])
    numbers = recovered(path)
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 2000 * part - 500


def test_what_a_process_that_is_killed_leaves_behind(tmp_path):
    """Before it is closed, the file contains all samples except those of about the last second."""
    recorder = open_recorder(tmp_path / "x.mcap", kind="J", period=PERIOD)
    for number in range(1000):
        recorder.write(sample(number))
    numbers = recovered(tmp_path / "x.mcap")
    recorder.close()
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 1000 - 250
    assert recovered(tmp_path / "x.mcap") == list(range(1000))


def test_numbers_that_json_has_not(tmp_path):
    path = recorded(tmp_path / "x.mcap", [sample(0, current=(math.nan, 1.0, math.inf), time=math.nan)])
    [(_, content)] = messages(path, "/slave/sample")
    assert (content["current"], content["time"]) == ([None, 1.0, None], None)


def test_times_from_the_clock(tmp_path):
    with open_recorder(tmp_path / "x.mcap", kind="J", period=PERIOD) as recorder:
        for number in (300, 301, 302):
            recorder.write(sample(number))
    found = [message.log_time for message, _ in messages(tmp_path / "x.mcap", "/slave/sample")]
    assert found[0] > START
    assert [time - found[0] for time in found] == [0, 200_000, 400_000]


def test_without_mcap(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap", None)
    with pytest.raises(MissingExtra, match=r"pip install 'orinkit\[log\]'"):
        open_recorder(tmp_path / "x.mcap", kind="J", period=PERIOD)
    assert not (tmp_path / "x.mcap").exists()
    i18n.use("ja")
    with pytest.raises(MissingExtra, match=r"mcap が必要です"):
        open_recorder(tmp_path / "x.mcap", kind="J", period=PERIOD)
    recorded(tmp_path / "x.csv", [sample(0)])


# --- what goes wrong --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x.txt", "must end in .csv or .mcap"),
        ("x", "must end in .csv or .mcap"),
        ("", "must end in .csv or .mcap"),
        ("none/x.csv", "does not exist"),
        ("none/x.mcap", "does not exist"),
        ("folder.csv", "cannot write"),
        ("folder.mcap", "cannot write"),
        ("y" * 5000 + ".csv", "cannot write"),
        ("y\x00.mcap", "cannot write"),
    ],
)
def test_files_that_cannot_be(tmp_path, name, words):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "folder.mcap").mkdir()
    with pytest.raises(InvalidValue, match=words) as caught:
        open_recorder(tmp_path / name, kind="J", period=PERIOD)
    i18n.use("ja")
    with pytest.raises(InvalidValue) as japanese:
        open_recorder(str(tmp_path / name), kind="J", period=PERIOD)
    assert str(japanese.value) != str(caught.value)


@pytest.mark.parametrize(
    "change",
    [{"kind": "X"}, {"kind": None}, {"period": 0}, {"period": math.nan}, {"start_ns": -1}, {"start_ns": 2**64}],
)
def test_arguments_that_are_none(tmp_path, change):
    with pytest.raises(InvalidValue):
        open_recorder(tmp_path / "x.mcap", **({"kind": "J", "period": PERIOD} | change))
    assert not (tmp_path / "x.mcap").exists()


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_full_disk(tmp_path):
    """Writing ends and reports the error, without an exception."""
    (tmp_path / "x.csv").symlink_to(FULL)
    recorder = open_recorder(tmp_path / "x.csv", kind="J", period=PERIOD)
    for number in range(5):
        recorder.write(sample(number))
    recorder.close()
    assert recorder.count == 0
    assert "cannot write" in recorder.error
    assert "No space left" in recorder.error
    assert "after 0 samples" in recorder.error


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_disk_that_is_full_before_anything_moves(tmp_path):
    """The head of an MCAP file is written at once."""
    (tmp_path / "x.mcap").symlink_to(FULL)
    with pytest.raises(InvalidValue, match=r"cannot write .*No space left"):
        open_recorder(tmp_path / "x.mcap", kind="J", period=PERIOD)


@pytest.mark.parametrize("name", ["x.csv", "x.mcap"])
def test_a_disk_that_becomes_full(tmp_path, name):
    """A limit of the file size simulates a full disk."""
    resource = pytest.importorskip("resource")
    signal = pytest.importorskip("signal")
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    recorder = open_recorder(tmp_path / name, kind="J", period=PERIOD)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, before[1]))
        for number in range(3000):
            recorder.write(sample(number))
        recorder.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert 0 < recorder.count < 3000
    assert f"after {recorder.count} samples" in recorder.error
    i18n.use("ja")
    count = recorder.count
    recorder.write(sample(0))
    assert recorder.count == count
    if name == "x.mcap":
        numbers = recovered(tmp_path / name)
        assert numbers == list(range(len(numbers)))
        assert numbers


@pytest.mark.parametrize("name", ["x.csv", "x.mcap"])
def test_samples_that_make_no_sense_stop_nothing(tmp_path, name):
    recorder = open_recorder(tmp_path / name, kind="J", period=PERIOD)
    recorder.write(sample(0))
    recorder.write(Sample(1, math.nan, ("x",)))
    recorder.write(sample(2))
    recorder.close()
    assert recorder.error is not None
    assert recorder.count == 1


def test_closing_twice_and_writing_afterwards(tmp_path):
    recorder = open_recorder(tmp_path / "x.csv", kind="J", period=PERIOD)
    recorder.write(sample(0))
    recorder.close()
    recorder.close()
    recorder.write(sample(1))
    assert (recorder.count, recorder.error) == (1, None)
    assert len(rows_of(tmp_path / "x.csv")) == 1


def test_an_error_in_the_block_leaves_a_whole_file(tmp_path):
    with pytest.raises(RuntimeError), open_recorder(tmp_path / "x.mcap", kind="J", period=PERIOD) as recorder:
        recorder.write(sample(0))
        raise RuntimeError
    assert len(messages(tmp_path / "x.mcap", "/slave/sample")) == 1
