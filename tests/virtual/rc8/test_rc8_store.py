from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import closing
from datetime import datetime
from pathlib import Path

import pytest

from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.rc8 import StateError, VirtualRC8, temporary_directory

R4S = VarType.R4 | 0x2000
VALUES = {
    "I5": Variant(VarType.I4, -7),
    "F5": Variant(VarType.R4, 1.5),
    "D5": Variant(VarType.R8, 0.1),
    "S5": Variant(VarType.BSTR, "漢字\0 \ud800 \"'"),
    "V5": Variant(R4S, [1.0, 2.0, 3.0]),
    "P5": Variant(R4S, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -1.0]),
    "J5": Variant(R4S, [-0.0, 2.0**-140, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]),
    "T5": Variant(R4S, [float(n) for n in range(10)]),
    "IO5": Variant(VarType.BOOL, True),
    "IOB16": Variant(VarType.I1, 0xA5 - 256),
    "IOW128": Variant(VarType.I2, -2),
    "IOF200": Variant(VarType.R4, -1.5),
}


@pytest.fixture
def start(tmp_path, connect):
    devices = []

    def start(**settings):
        device = VirtualRC8(state=tmp_path / "state", **settings)
        devices.append(device)
        return device, connect(device=device)

    yield start
    for device in devices:
        device.close()


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "state" / "variables.sqlite3"


def put(controller, name, value):
    controller.get_variable(name, "").put_value(value)


def get(controller, name):
    return controller.get_variable(name, "").get_value()


def test_everything_survives_a_restart(start):
    clock = ManualClock(datetime(2025, 1, 2, 3, 4, 5, 678901))
    device, controller = start(clock=clock)
    for name, value in VALUES.items():
        put(controller, name, value)
    device.close()
    device.close()
    _, controller = start()
    for name, value in VALUES.items():
        again = controller.get_variable(name, "")
        assert again.get_value() == value
        assert again.get_date_time() == datetime(2025, 1, 2, 3, 4, 5, 678901)
        assert again.get_microsecond() == 678901
    assert get(controller, "I4").value == 0
    assert get(controller, "IO4").value is False


def test_a_point_that_was_reset_stays_reset(start):
    device, controller = start()
    put(controller, "IOW128", Variant(VarType.I2, -1))
    put(controller, "IO130", Variant(VarType.BOOL, False))
    device.close()
    _, controller = start()
    assert get(controller, "IOW128").value == ~4


def test_values_beyond_the_counts_are_kept_but_not_served(start, refused, path):
    device, controller = start()
    put(controller, "I50", Variant(VarType.I4, 50))
    put(controller, "IO300", Variant(VarType.BOOL, True))
    device.close()
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("INSERT INTO variable VALUES ('FUTURE', 1, '[{}]', '2025-01-01')")
    device, controller = start(counts={"I": 10}, io_points=100)
    assert refused(controller.get_variable, "I50", "") == 0x81500053
    put(controller, "I5", Variant(VarType.I4, 5))
    device.close()
    device, controller = start()
    assert [get(controller, name).value for name in ("I5", "I50", "IO300")] == [5, 50, True]
    device.close()
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("SELECT value FROM variable WHERE class = 'FUTURE'").fetchall() == [("[{}]",)]


def test_the_file_can_be_read_by_a_person(start, path):
    device, controller = start(clock=ManualClock())
    put(controller, "P1", VALUES["P5"])
    device.close()
    with closing(sqlite3.connect(path)) as database:
        (row,) = database.execute("SELECT class, number, value, written FROM variable")
    assert row[:2] == ("P", 1)
    assert json.loads(row[2]) == VALUES["P5"].value
    assert row[3] == "2024-04-01T09:00:00"


WRITER = """
import itertools, sys
from orinkit.cao.provider import ClientInfo
from orinkit.values.variant import VarType, Variant
from orinkit.virtual.rc8 import VirtualRC8

controller = VirtualRC8(state=sys.argv[1]).connect("c", "", "", ClientInfo())
numbers = [controller.get_variable(f"I{n}", "") for n in range(100)]
points = controller.get_variable("IOD128", "")
print("ready", flush=True)
for n in itertools.count():
    numbers[n % 100].put_value(Variant(VarType.I4, n))
    points.put_value(Variant(VarType.I4, -(n % 2)))
    print(n, flush=True)
"""


def test_no_acknowledged_write_is_lost_when_the_process_is_killed(start, tmp_path, path):
    for acknowledged in (1, 500, 3000):
        path.unlink(missing_ok=True)
        for beside in path.parent.glob("*") if path.parent.exists() else ():
            if beside.is_file():
                beside.unlink()
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(tmp_path / "state")], stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout.readline() == "ready\n"
            for _ in range(acknowledged):
                writer.stdout.readline()
            writer.send_signal(signal.SIGKILL)
            rest = writer.stdout.read().split("\n")[:-1]
        last = int(rest[-1]) if rest else acknowledged - 1
        device, controller = start()
        for n in range(max(0, last - 99), last + 1):
            assert get(controller, f"I{n % 100}").value in (n, n + 100)
        assert get(controller, "IOD128").value in (0, -1)  # all 32 points of one write, or none
        device.close()


HOLDER = """
import sys
from orinkit.virtual.rc8 import VirtualRC8
rc8 = VirtualRC8(state=sys.argv[1])
print("ready", flush=True)
sys.stdin.read()
"""


def test_a_state_directory_belongs_to_one_process(start, tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path / "state")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout.readline() == "ready\n"
        with pytest.raises(StateError, match=r"variables\.sqlite3 is in use by another process"):
            start()
        holder.kill()
    start()


def test_a_state_directory_belongs_to_one_controller(start):
    device, controller = start()
    with pytest.raises(StateError, match="in use"):
        start()
    put(controller, "I1", Variant(VarType.I4, 1))
    device.close()
    _, controller = start()
    assert get(controller, "I1").value == 1


def test_a_configuration_error_lets_go_of_the_directory(start, tmp_path):
    with pytest.raises(ValueError, match="class"):
        start(counts={"X": 1})
    start()


def foreign_database(path: Path, setting: str) -> None:
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(setting)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: path.write_bytes(b"This is a letter to my aunt. " * 99), "not a database"),
        (lambda path: path.write_bytes(b"short"), "not a database"),
        (lambda path: foreign_database(path, "CREATE TABLE mine (x)"), "another program"),
        (lambda path: foreign_database(path, "PRAGMA application_id = 7"), "another program"),
        (lambda path: foreign_database(path, "PRAGMA user_version = 7"), "another program"),
        (lambda path: path.mkdir(), "unable to open"),
    ],
)
def test_a_file_that_is_not_ours_is_refused_and_left_alone(make, reason, start, path):
    path.parent.mkdir()
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(StateError, match=reason) as caught:
        start()
    assert str(path) in str(caught.value)
    assert (path.read_bytes() if path.is_file() else None) == before
    assert [other.name for other in path.parent.iterdir()] == [path.name]


def test_a_directory_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StateError, match="file"):
        VirtualRC8(state=tmp_path / "file" / "state")


def test_an_empty_file_has_lost_its_values_and_is_refused(start, path):
    written_file(start)
    path.write_bytes(b"")
    with pytest.raises(StateError, match=r"0 bytes.*backup.*move it away to start without values") as caught:
        start()
    assert str(path) in str(caught.value)
    assert path.read_bytes() == b""
    path.rename(path.with_name("away"))
    _, controller = start()
    assert get(controller, "I1").value == 0


def test_what_a_killed_process_has_begun_is_removed(start, path):
    path.parent.mkdir()
    left = path.parent / ".variables-abc.new"
    left.touch()
    start()
    assert not left.exists()


def test_a_write_is_refused_while_the_directory_is_missing_and_succeeds_afterwards(start, refused, path, caplog):
    device, controller = start()
    put(controller, "I1", Variant(VarType.I4, 1))
    shutil.rmtree(path.parent)
    for _ in range(3):
        assert refused(put, controller, "I1", Variant(VarType.I4, 2)) == 0x80004005
    assert get(controller, "I1").value == 1
    assert len([each for each in caplog.records if each.levelname == "ERROR"]) == 1
    assert "cannot be written until" in caplog.text
    path.parent.mkdir()
    put(controller, "I2", Variant(VarType.I4, 3))
    assert "written again with all variables" in caplog.text
    device.close()
    _, controller = start()
    assert [get(controller, name).value for name in ("I1", "I2")] == [1, 3]


def test_a_directory_that_was_moved_away_and_back(start, refused, path, caplog):
    device, controller = start()
    put(controller, "I1", Variant(VarType.I4, 1))
    away = path.parent.with_name("away")
    path.parent.rename(away)
    assert refused(put, controller, "I1", Variant(VarType.I4, 2)) == 0x80004005
    away.rename(path.parent)
    put(controller, "I1", Variant(VarType.I4, 3))
    assert "available again" in caplog.text
    device.close()
    _, controller = start()
    assert get(controller, "I1").value == 3


def test_another_file_in_its_place_is_left_alone(start, refused, path):
    _, controller = start()
    path.unlink()
    path.write_bytes(b"mine")
    assert refused(put, controller, "I1", Variant(VarType.I4, 2)) == 0x80004005
    assert path.read_bytes() == b"mine"


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: os.truncate(path, 0),
        lambda path: os.truncate(path, path.stat().st_size // 2),
        lambda path: path.write_bytes(bytes(path.stat().st_size)),
        lambda path: (os.truncate(path, 0), path.unlink()),
    ],
    ids=["truncated", "half", "zeros", "truncated and deleted"],
)
def test_no_write_is_acknowledged_after_the_file_was_damaged(harm, start, refused, path, caplog):
    """The attack: SQLite keeps the content in its cache, and does not notice the damage."""
    _, controller = start()
    for number in range(100):
        put(controller, "S1", Variant(VarType.BSTR, f"{number}" * 50))
    harm(path)
    for _ in range(3):
        assert refused(put, controller, "I1", Variant(VarType.I4, 2)) == 0x80004005
    with pytest.raises(CallError, match=r"truncated or overwritten.*Try: .*backup.*variables\.sqlite3-wal away"):
        put(controller, "I1", Variant(VarType.I4, 2))
    assert get(controller, "I1").value == 0
    assert len([each for each in caplog.records if each.levelname == "ERROR"]) == 1


def test_a_file_that_grows_is_not_damaged(start):
    device, controller = start(counts={"S": 3000})
    for number in range(3000):
        put(controller, f"S{number}", Variant(VarType.BSTR, "x" * 255))
    device.close()
    _, controller = start(counts={"S": 3000})
    assert get(controller, "S2999").value == "x" * 255


def test_a_directory_that_is_back_but_cannot_be_used(start, refused, path, monkeypatch):
    _, controller = start()
    path.unlink()
    monkeypatch.setattr(tempfile, "mkstemp", lambda **_: (_ for _ in ()).throw(PermissionError("no")))
    assert refused(put, controller, "I1", Variant(VarType.I4, 2)) == 0x80004005
    monkeypatch.undo()
    put(controller, "I1", Variant(VarType.I4, 2))


def test_a_file_is_made_where_there_are_no_links(start, path, monkeypatch):
    monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(OSError("no links here")))
    _, controller = start()
    put(controller, "I1", Variant(VarType.I4, 1))
    assert path.exists()


def test_state_is_for_its_owner_only(start, path, caplog):
    before = os.umask(0o022)
    try:
        device, controller = start()
        put(controller, "I1", Variant(VarType.I4, 1))
        device.state.files.make_folder("Folder")
        device.state.files.write("Folder\\a.pcs", b"x")
        modes = {each.name: each.stat().st_mode & 0o777 for each in (path.parent, *path.parent.rglob("*"))}
        assert modes["state"] == modes["files"] == modes["Folder"] == 0o700
        assert modes["variables.sqlite3"] == modes["variables.sqlite3-wal"] == modes["a.pcs"] == 0o600
        device.close()
        assert "chmod 700" not in caplog.text
        path.chmod(0o644)
        path.parent.chmod(0o755)
        start()
        assert path.stat().st_mode & 0o777 == 0o600
        assert "chmod 700" in caplog.text
    finally:
        os.umask(before)


@pytest.fixture
def left(tmp_path, monkeypatch) -> Path:
    """The temporary directory of a killed process."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    program = "import os, signal; from orinkit.virtual.rc8 import VirtualRC8; d = VirtualRC8(); os.kill(os.getpid(), signal.SIGKILL)"
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    subprocess.run([sys.executable, "-c", program], env=environment, check=False)
    (left,) = tmp_path.iterdir()
    return left


def test_the_next_start_removes_the_leftovers_of_a_killed_process(left):
    device = VirtualRC8()
    assert not left.exists()
    device.close()


def test_leftovers_of_dead_processes_are_removed_and_nothing_else(left, tmp_path):
    alive = VirtualRC8()
    beside = tmp_path / "elsewhere"
    beside.mkdir()
    (beside / "lock").touch()
    (tmp_path / "orinkit-rc8-link").symlink_to(beside)
    (tmp_path / "orinkit-rc8-nolock").mkdir()
    (tmp_path / "orinkit-rc8-file").touch()
    temporary_directory.sweep(tmp_path)
    assert not left.exists()
    names = {each.name for each in tmp_path.iterdir()}
    assert {"elsewhere", "orinkit-rc8-link", "orinkit-rc8-nolock", "orinkit-rc8-file"} < names
    assert len(names) == 5
    assert beside.exists()
    alive.close()
    alive.close()
    assert len(list(tmp_path.iterdir())) == 4


def written_file(start) -> None:
    device, controller = start()
    for n in range(100):
        put(controller, f"S{n}", Variant(VarType.BSTR, "x" * 200))
    device.close()


def test_a_newer_format_is_refused(start, path):
    written_file(start)
    foreign_database(path, "PRAGMA user_version = 2")
    with pytest.raises(StateError, match="newer"):
        start()


def test_a_damaged_file_is_refused_and_left_alone(start, path):
    written_file(start)
    content = bytearray(path.read_bytes())
    content[8192:8600] = os.urandom(408)
    path.write_bytes(content)
    with pytest.raises(StateError, match="repair") as caught:
        start()
    assert str(path) in str(caught.value)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    "row",
    [
        ("I", 1, "not json", "2025-01-01"),
        ("I", 1, '"text"', "2025-01-01"),
        ("I", 1, "1.5", "2025-01-01"),
        ("P", 1, "[1, 2]", "2025-01-01"),
        ("V", 1, "1", "2025-01-01"),
        ("V", 1, "[1, 2, NaN]", "2025-01-01"),
        ("S", 1, json.dumps("x" * 256), "2025-01-01"),
        ("IO", 1, "null", "2025-01-01"),
        ("I", 1, "1", "yesterday"),
        ("I", "one", "1", "2025-01-01"),
        ("I", 1, b"\xff\x00", "2025-01-01"),
        ("I", 1, "[" * 100_000, "2025-01-01"),
    ],
)
def test_a_row_that_cannot_be_a_variable_is_refused(row, start, path):
    written_file(start)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("INSERT OR REPLACE INTO variable VALUES (?, ?, ?, ?)", row)
    content = path.read_bytes()
    with pytest.raises(StateError, match=f"{row[0]}{row[1]}") as caught:
        start()
    assert str(path) in str(caught.value)
    assert path.read_bytes() == content


def test_a_row_that_is_not_text_is_refused(start, path):
    written_file(start)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("INSERT INTO variable VALUES ('I', 1, CAST(X'FF' AS TEXT), '2025-01-01')")
    with pytest.raises(StateError, match="repair"):
        start()


def test_a_write_that_cannot_be_saved_is_refused_and_changes_nothing(start, refused, caplog):
    device, controller = start()
    put(controller, "S1", Variant(VarType.BSTR, "old"))
    put(controller, "IOW128", Variant(VarType.I2, 5))
    before = controller.get_variable("S1", "").get_date_time()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, hard))  # like a full disk
    try:
        assert refused(put, controller, "S1", Variant(VarType.BSTR, "new")) == 0x80004005
        assert refused(put, controller, "IOW128", Variant(VarType.I2, -1)) == 0x80004005
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "variables.sqlite3" in caplog.text
    assert get(controller, "S1").value == "old"
    assert controller.get_variable("S1", "").get_date_time() == before
    assert get(controller, "IOW128").value == 5
    put(controller, "S2", Variant(VarType.BSTR, "room again"))
    device.close()
    _, controller = start()
    assert [get(controller, name).value for name in ("S1", "S2", "IOW128")] == ["old", "room again", 5]


def test_a_write_after_the_end_is_refused(start, refused):
    device, controller = start()
    device.close()
    assert refused(put, controller, "I1", Variant(VarType.I4, 1)) == 0x80004005
    assert get(controller, "I1").value == 0


@pytest.mark.parametrize("damage", ["empty", "gone"])
def test_a_journal_without_its_file_is_refused_and_kept(tmp_path, damage):
    journal = tmp_path / "variables.sqlite3-wal"
    journal.write_bytes(b"writes that are nowhere else")
    if damage == "empty":
        (tmp_path / "variables.sqlite3").write_bytes(b"")
    with pytest.raises(StateError, match=r"variables\.sqlite3-wal"):
        VirtualRC8(state=tmp_path)
    assert journal.read_bytes() == b"writes that are nowhere else"
