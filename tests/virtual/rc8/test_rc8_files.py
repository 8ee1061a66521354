from __future__ import annotations

import logging
import os
import resource
import shutil
import stat
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.cao.functions import BY_NAME
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8 import StateError, VirtualRC8
from orinkit.virtual.rc8.client_context import ClientContext, open_context
from orinkit.virtual.rc8.files import MOST_BYTES, MOST_ENTRIES, FileStore, disk, usage
from orinkit.virtual.rc8.objects.file import RC8File, find_file, require_program
from orinkit.virtual.rc8.permission import AccessRight
from orinkit.virtual.rc8.state import Origin

NOT_FOUND = hresult.FILE_NOT_FOUND
TAKEN = hresult.E_CAO_COLLECTION_REGISTERED
DENIED = hresult.E_ACCESSDENIED
INVALID = hresult.E_INVALIDARG
BYTES = VarType.UI1 | ARRAY
SECRET = b"SECRET"
CREATE = "@Create=1"


@pytest.fixture
def root(tmp_path) -> Path:
    return tmp_path / "in" / "files"


@pytest.fixture
def store(root, clock) -> FileStore:
    return FileStore(root, clock.wall)


@pytest.fixture
def caller(rc8):
    def caller(access: AccessRight = AccessRight.READ_WRITE) -> ClientContext:
        return open_context(rc8.state, Origin("ctrl", "192.168.0.7"), access)

    return caller


@pytest.fixture
def open_file(store, caller):
    def open_file(
        name: str, option: str = "", access: AccessRight = AccessRight.READ_WRITE, run: Any = None
    ) -> RC8File:
        return find_file(caller(access), store, name, option, run)

    return open_file


@pytest.fixture
def notified(store) -> list[str]:
    names: list[str] = []
    store.changed.append(lambda name, _: names.append(name))
    return names


def text(value: str) -> Variant:
    return Variant(VarType.BSTR, value)


def plain(file: RC8File) -> Any:
    value = file.get_value()
    assert isinstance(value, Variant)
    return value.plain


def everything(directory: Path) -> dict[str, tuple[int, bytes, int]]:
    """Return all entries below a directory: type and mode, content or target, time of change."""
    found = {}
    for path in sorted(directory.rglob("*")):
        status = path.lstat()
        content = b""
        if stat.S_ISLNK(status.st_mode):
            content = os.fsencode(path.readlink())
        elif stat.S_ISREG(status.st_mode):
            content = path.read_bytes()
        found[str(path.relative_to(directory))] = (status.st_mode, content, status.st_mtime_ns)
    return found


@contextmanager
def untouched(outside: Path):
    before = everything(outside)
    yield
    assert everything(outside) == before


@pytest.fixture
def outside(tmp_path) -> Path:
    """A tree outside the store, with names that hostile names aim at."""
    directory = tmp_path / "outside"
    (directory / "sub").mkdir(parents=True)
    (directory / "canary.pcs").write_bytes(SECRET)
    (directory / "sub" / "canary.pcs").write_bytes(SECRET)
    return directory


# --- the store --------------------------------------------------------------------------------------------------------


def test_what_is_written_is_read(store, root):
    store.write("Pro1.pcs", b"old")
    store.write("PRO1.PCS", b"new\r\n\0")
    assert store.read("pro1.pcs") == b"new\r\n\0"
    assert [path.name for path in root.iterdir()] == ["Pro1.pcs"]
    assert (root / "Pro1.pcs").read_bytes() == b"new\r\n\0"
    assert store.size("Pro1.pcs") == 6
    assert FileStore(root, datetime.now).read("Pro1.pcs") == b"new\r\n\0"


def test_names_differ_by_more_than_case_and_composition(store):
    store.write("か\u3099.txt", b"1")  # decomposed
    assert store.read("が.txt") == b"1"
    assert store.names() == ["が.txt"]
    store.write("か.txt", b"2")
    store.write("CAF\u00c9", b"3")
    assert store.read("cafe\u0301") == b"3"
    assert store.names() == ["CAFÉ", "か.txt", "が.txt"]


def test_decomposed_entries_that_another_program_made_are_found(store, root):
    store.make_folder("d")
    (root / "d" / "か\u3099.pcs").write_bytes(b"1")
    assert store.names("d") == ["が.pcs"]
    assert store.full_name("D/が.PCS") == "d\\が.pcs"
    store.write("d\\が.pcs", b"2")
    assert store.names("d") == ["が.pcs"]
    assert len(list((root / "d").iterdir())) == 1


def test_entries_that_differ_in_case_only_are_each_reached_by_their_own_spelling(store, root):
    (root / "A.txt").write_bytes(b"A")
    (root / "a.txt").write_bytes(b"a")
    if len(list(root.iterdir())) == 2:
        assert (store.read("A.txt"), store.read("a.txt"), store.read("a.TXT")) == (b"A", b"a", b"A")
        assert store.names() == ["A.txt", "a.txt"]


def test_folders(store, refused):
    assert store.is_folder("")
    assert store.is_folder("\\")
    store.make_folder("dir")
    store.make_folder("DIR/Sub\\")
    store.write("dir\\sub/x.txt", b"1")
    store.create("dir\\empty.txt")
    assert store.names("dir") == ["empty.txt", "Sub\\"]
    assert store.names("Dir\\SUB\\") == ["x.txt"]
    assert store.full_name("dir/sub/X.TXT") == "dir\\Sub\\x.txt"
    assert store.full_name("/") == "\\"
    assert (store.is_folder("dir\\sub"), store.is_folder("dir\\empty.txt"), store.is_folder("no")) == (
        True,
        False,
        False,
    )
    assert (store.exists("dir"), store.exists("dir\\"), store.exists("dir\\empty.txt\\")) == (True, True, False)
    assert (store.size("dir"), store.size("dir\\sub\\x.txt")) == (0, 1)
    assert refused(store.names, "dir\\empty.txt") == NOT_FOUND
    assert refused(store.names, "no") == NOT_FOUND


def test_listings_are_sorted_without_regard_to_case(store):
    for name in ("b.pcs", "A.pcs", "c.txt", "_.pcs", "10.pcs", "9.pcs", "い.pcs", "あ.pcs"):
        store.create(name)
    store.make_folder("B")
    assert store.names() == ["10.pcs", "9.pcs", "A.pcs", "B\\", "b.pcs", "c.txt", "_.pcs", "あ.pcs", "い.pcs"]


def test_programs_are_found_in_all_folders(store):
    store.make_folder("dir")
    store.make_folder("dir\\sub")
    store.make_folder("dir\\folder.pcs")
    for name in ("Pro1.pcs", "dir\\Pro2.PCS", "dir\\sub\\日本.pcs", "Pro1.txt", "pcs", ".pcs", "a.b.pcs"):
        store.create(name)
    assert store.programs() == ["a.b", "dir\\Pro2", "dir\\sub\\日本", "Pro1"]


REFUSALS = [
    ("read", ("no",), NOT_FOUND),
    ("read", ("no\\x",), NOT_FOUND),
    ("read", ("file\\x",), NOT_FOUND),
    ("read", ("file\\",), NOT_FOUND),
    ("read", ("dir",), DENIED),
    ("read", ("",), DENIED),
    ("full_name", ("no",), NOT_FOUND),
    ("size", ("no",), NOT_FOUND),
    ("dates", ("no",), NOT_FOUND),
    ("write", ("", b""), DENIED),
    ("write", ("dir", b""), DENIED),
    ("write", ("dir\\", b""), DENIED),
    ("write", ("file\\", b""), TAKEN),
    ("write", ("new\\", b""), INVALID),
    ("write", ("no\\x", b""), NOT_FOUND),
    ("write", ("file\\x", b""), NOT_FOUND),
    ("write", ("file", bytes(MOST_BYTES + 1)), hresult.E_TOO_MUCH_DATA),
    ("create", ("FILE",), TAKEN),
    ("create", ("dir",), TAKEN),
    ("create", ("new\\",), INVALID),
    ("create", ("no\\x",), NOT_FOUND),
    ("make_folder", ("DIR",), TAKEN),
    ("make_folder", ("dir\\",), TAKEN),
    ("make_folder", ("file\\",), TAKEN),
    ("make_folder", ("file",), TAKEN),
    ("make_folder", ("",), TAKEN),
    ("make_folder", ("no\\x",), NOT_FOUND),
    ("delete", ("no",), NOT_FOUND),
    ("delete", ("file\\",), NOT_FOUND),
    ("delete", ("dir",), DENIED),
    ("delete", ("\\",), DENIED),
    ("copy", ("no", "x"), NOT_FOUND),
    ("copy", ("dir", "x"), DENIED),
    ("copy", ("file", "File"), TAKEN),
    ("copy", ("file", "dir\\in"), TAKEN),
    ("copy", ("file", "dir"), TAKEN),
    ("copy", ("file", "dir\\"), TAKEN),
    ("copy", ("file", "new\\"), INVALID),
    ("copy", ("file", "no\\x"), NOT_FOUND),
    ("copy", ("file", ".."), INVALID),
    ("move", ("no", "x"), NOT_FOUND),
    ("move", ("", "x"), DENIED),
    ("move", ("file", "dir"), TAKEN),
    ("move", ("file", "dir\\IN"), TAKEN),
    ("move", ("file", "x\\"), INVALID),
    ("move", ("file", "file\\x"), NOT_FOUND),
    ("move", ("file", "..\\x"), INVALID),
    ("move", ("dir", "Dir\\x"), INVALID),
    ("move", ("dir", "dir\\sub\\x"), INVALID),
    ("move", ("dir", "\\"), TAKEN),
]


@pytest.mark.parametrize(("method", "arguments", "code"), REFUSALS)
def test_refused_calls_change_nothing(method, arguments, code, store, root, notified, refused):
    store.write("file", b"1")
    store.make_folder("dir")
    store.make_folder("dir\\sub")
    store.write("dir\\in", b"2")
    notified.clear()
    with untouched(root):
        assert refused(getattr(store, method), *arguments) == code
    assert notified == []


def test_recursive_delete_reports_the_deleted_files(store, notified, root):
    store.make_folder("dir")
    store.make_folder("dir\\sub")
    store.write("dir\\a.pcs", b"")
    store.write("dir\\sub\\b.pcs", b"")
    notified.clear()
    store.delete("DIR", recursive=True)
    assert notified == ["dir\\a.pcs", "dir\\sub\\b.pcs"]
    assert list(root.iterdir()) == []
    store.make_folder("dir")
    store.delete("dir")
    assert not store.exists("dir")


def test_listeners_are_called_for_each_change_of_a_file(store, notified):
    store.write("Pro1.pcs", b"1")
    store.write("pro1.pcs", b"2")
    store.create("x.txt")
    store.make_folder("dir")
    store.copy("PRO1.pcs", "dir\\Copy.pcs")
    store.move("pro1.pcs", "dir\\Moved.pcs")
    store.move("dir", "other")
    store.move("x.txt", "X.TXT")
    store.delete("x.txt")
    assert notified == [
        *("Pro1.pcs", "Pro1.pcs", "x.txt", "dir\\Copy.pcs", "Pro1.pcs", "dir\\Moved.pcs"),
        *("dir\\Copy.pcs", "other\\Copy.pcs", "dir\\Moved.pcs", "other\\Moved.pcs"),
        *("x.txt", "X.TXT", "X.TXT"),
    ]
    assert store.read("other\\copy.pcs") == b"2"


def test_a_failing_listener_affects_neither_the_write_nor_the_others(store, notified, caplog):
    def fail(name: str, _: bool) -> None:
        raise ValueError(name)

    store.changed.insert(0, fail)
    store.write("a", b"1")
    assert store.read("a") == b"1"
    assert notified == ["a"]
    assert "a has changed" in caplog.text


def test_a_listener_sees_the_new_state(store):
    seen = []
    store.changed.append(lambda name, exists: seen.append((name, exists and store.read(name))))
    store.write("a", b"1")
    store.move("a", "b")
    store.delete("b")
    assert seen == [("a", b"1"), ("a", False), ("b", b"1"), ("b", False)]


def test_rename_in_case_only(store):
    store.write("pro1.pcs", b"1")
    store.move("pro1.pcs", "PRO1.pcs")
    assert store.names() == ["PRO1.pcs"]
    store.move("PRO1.pcs", "PRO1.pcs")
    store.make_folder("dir")
    store.create("dir\\x")
    store.move("dir", "Dir\\")
    assert store.names() == ["Dir\\", "PRO1.pcs"]
    assert store.full_name("dir\\X") == "Dir\\x"


def test_a_move_does_not_make_names_too_deep_or_too_long(store, refused):
    for depth in range(1, 13):
        store.make_folder("\\".join(["d"] * depth))
    for depth in range(1, 5):
        store.make_folder("\\".join(["e"] * depth))
    store.move("e", "\\".join(["d"] * 12 + ["e"]))
    deepest = "\\".join(["d"] * 12 + ["e"] * 4)
    assert store.is_folder(deepest)
    store.make_folder("f")
    assert refused(store.move, "d", "f\\d") == INVALID  # an empty folder would be the 17th part
    assert store.is_folder(deepest)
    long = "\\".join(["x" * 200] * 4)
    for depth in range(1, 5):
        store.make_folder("\\".join(["x" * 200] * depth))
    store.create(f"{long}\\{'y' * 200}")
    assert refused(store.move, "x" * 200, f"f\\{'z' * 230}") == INVALID


def test_dates_are_the_controllers(store, clock, root):
    def dates() -> tuple[datetime, datetime, datetime]:
        found = store.dates("Pro1.pcs")
        return found.created, found.accessed, found.modified

    start = clock.wall()
    store.write("Pro1.pcs", b"1")
    assert dates() == (start, start, start)
    clock.advance(60)
    store.write("pro1.pcs", b"2")
    written = clock.wall()
    assert dates() == (start, written, written)
    clock.advance(60)
    store.read("Pro1.pcs")
    assert dates() == (start, clock.wall(), written)
    store.move("Pro1.pcs", "x")
    store.move("x", "Pro1.pcs")
    assert dates() == (start, clock.wall(), written)
    assert FileStore(root, clock.wall).dates("Pro1.pcs").modified == written
    clock.advance(60)
    store.copy("Pro1.pcs", "copy")
    assert store.dates("copy").created == clock.wall()
    store.delete("Pro1.pcs")
    store.create("Pro1.pcs")
    assert dates() == (clock.wall(),) * 3


def test_a_file_of_an_earlier_run_keeps_its_first_date(store, clock, root):
    store.write("a", b"1")
    created = clock.wall()
    clock.advance(60)
    later = FileStore(root, clock.wall)
    later.write("a", b"2")
    assert (later.dates("a").created, later.dates("a").modified) == (created, clock.wall())


def test_a_folder_keeps_the_dates_of_its_files_when_it_moves(store, clock):
    store.make_folder("dir")
    store.write("dir\\a", b"1")
    created = clock.wall()
    clock.advance(60)
    store.write("dir\\a", b"2")
    store.move("dir", "other")
    assert store.dates("other\\a").created == created
    assert store.dates("other").created == created


@pytest.mark.parametrize(
    ("seconds", "year"), [(-(2**31), 1980), (2**33, 2099), (2**34 - 1, 2099), (1_700_000_000, 2023)]
)
def test_dates_from_elsewhere_stay_within_the_calendar(seconds, year, store, root):
    (root / "x").write_bytes(b"")
    os.utime(root / "x", (seconds, seconds))
    if int((root / "x").stat().st_mtime) == seconds:
        assert store.dates("x").modified.year == store.dates("x").created.year == year


# --- what the system does ---------------------------------------------------------------------------------------------


def test_half_written_files_are_removed_at_the_start_and_never_seen(store, root):
    store.make_folder("dir")
    store.write("dir\\x", b"1")
    left = [root / ".orinkit-tmp-0123", root / "dir" / ".orinkit-tmp-4567"]
    for path in left:
        path.write_bytes(b"half")
    assert (store.names(), store.names("dir"), store.programs()) == (["dir\\"], ["x"], [])
    FileStore(root, datetime.now)
    assert not any(path.exists() for path in left)
    assert store.read("dir\\x") == b"1"


def test_a_write_that_the_system_refuses_leaves_the_old_content(store, root, refused, caplog):
    store.write("a", b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with caplog.at_level(logging.CRITICAL + 1):
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))  # like a full disk
        try:
            codes = [refused(store.write, name, bytes(20_000)) for name in ("a", "b")]
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert codes == [hresult.E_FAIL] * 2
    assert [path.name for path in root.iterdir()] == ["a"]
    assert store.read("a") == b"old"


def test_e_fail_contains_the_reason_of_the_system(store, root):
    store.root = root / "/".join(["x" * 250] * 17)  # longer than the system allows for a path
    with pytest.raises(CallError) as caught:
        store.exists("a")
    assert caught.value.code == hresult.E_FAIL
    assert "File name too long" in caught.value.detail
    assert str(root) not in caught.value.detail


def test_a_store_whose_directory_is_missing(store, root, refused):
    store.write("a", b"")
    shutil.rmtree(root)
    assert not store.exists("a")
    assert refused(store.read, "a") == NOT_FOUND
    assert refused(store.names) == NOT_FOUND
    assert refused(store.write, "a", b"") == NOT_FOUND
    assert refused(store.make_folder, "a") == NOT_FOUND
    assert not root.exists()


def test_a_directory_that_cannot_be_used(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    for path in (tmp_path / "file", tmp_path / "file" / "x"):
        with pytest.raises(StateError, match="file"):
            FileStore(path, datetime.now)


def test_the_largest_file(store, root, refused):
    store.write("a", bytes(MOST_BYTES))
    assert len(store.read("a")) == MOST_BYTES
    with (root / "b").open("wb") as file:
        file.truncate(2**40)  # sparse: uses no disk space
    assert refused(store.read, "b") == hresult.E_TOO_MUCH_DATA
    assert refused(store.copy, "b", "c") == hresult.E_TOO_MUCH_DATA
    assert store.size("b") == 2**40


def test_the_number_of_entries_is_limited(root, clock, refused):
    for folder in range(10):
        directory = root / str(folder)
        directory.mkdir(parents=True)
        for number in range(MOST_ENTRIES // 10 - 1):
            (directory / f"{number}.pcs").touch()
    store = FileStore(root, clock.wall)
    for call in (
        store.create,
        store.make_folder,
        lambda name: store.write(name, b""),
        lambda name: store.copy("0\\1.pcs", name),
    ):
        assert refused(call, "new") == hresult.E_MAX_OBJECT
    store.write("0\\1.pcs", b"full, but what is there can be written")
    store.delete("0\\1.pcs")
    store.create("new")
    assert refused(store.create, "new2") == hresult.E_MAX_OBJECT
    (root / "new").unlink()  # not through the store
    store.create("new2")
    store.delete("5", recursive=True)
    store.create("new3")
    assert len(store.programs()) == 9 * (MOST_ENTRIES // 10 - 1) - 1


@pytest.fixture
def quota(monkeypatch, root, clock) -> FileStore:
    """A store that is limited to 1,000 bytes, and counts again after 400 bytes."""
    monkeypatch.setattr(usage, "MOST_STORED", 1000)
    monkeypatch.setattr(usage, "_COUNTED_EVERY", 400)
    return FileStore(root, clock.wall)


def test_the_total_size_of_the_files_is_limited(quota, root, clock, refused):
    """The attack: a file of 16 MiB copied 10,000 times."""
    store = quota
    store.write("a", bytes(300))
    store.copy("a", "b")
    store.make_folder("dir")
    store.copy("b", "dir\\c")
    for call in (
        lambda: store.copy("a", "d"),
        lambda: store.write("d", bytes(101)),
        lambda: store.write("a", bytes(401)),
    ):
        assert refused(call) == hresult.E_TOO_MUCH_DATA
    assert not store.exists("d")
    assert store.size("a") == 300
    assert {path.name for path in root.rglob("*")} == {"a", "b", "dir", "c"}  # no temporary file is left
    with pytest.raises(CallError, match=r"would have 1001 bytes, the limit is 1000 bytes. Try: delete some"):
        store.write("d", bytes(101))
    store.write("d", bytes(100))
    store.create("e")
    store.write("a", bytes(50))
    store.write("e", bytes(250))
    assert refused(store.write, "e", bytes(251)) == hresult.E_TOO_MUCH_DATA
    store.delete("dir", recursive=True)
    store.move("e", "f")
    store.delete("f")
    store.write("e", bytes(550))
    assert refused(store.write, "f", b"x") == hresult.E_TOO_MUCH_DATA
    assert refused(FileStore(root, clock.wall).write, "f", b"x") == hresult.E_TOO_MUCH_DATA  # also after a restart


def test_files_of_other_programs_count(quota, root, refused):
    store = quota
    store.write("a", bytes(400))
    (root / "b").write_bytes(bytes(500))
    store.write("c", bytes(1))  # everything is counted now
    assert refused(store.write, "d", bytes(100)) == hresult.E_TOO_MUCH_DATA
    (root / "b").unlink()
    store.write("d", bytes(100))
    (root / "b").write_bytes(bytes(900))
    store.delete("b")
    store.write("e", bytes(499))
    assert refused(store.write, "f", bytes(1)) == hresult.E_TOO_MUCH_DATA
    (root / "b").write_bytes(bytes(10_000))
    store.write("e", b"smaller")  # allowed although the store is too large
    assert store.read("b") == bytes(10_000)


# --- hostile names and trees ------------------------------------------------------------------------------------------

HOSTILE = [
    "..", "../outside/canary.pcs", "..\\..\\outside\\canary.pcs", "../../outside", "dir/../../../outside/canary.pcs",
    "dir\\..\\file", "./file", "/etc/passwd", "\\etc\\passwd", "//server/share", "\\\\server\\share", "\\\\?\\C:\\x",
    "C:\\x", "c:", "C:file", "file:stream", "file\0", "\0", "file\0.pcs", "a\nb", "a" * 4096, "../" * 300, "a/" * 512,
    "dir\\" * 17 + "x", "CON", "nul.pcs", "dir\\COM1", "aux\\x", "file.", "file ", "dir.\\x", "dir /x", "dir//x",
    "dir\\/x", "dir/\\x", "*", "*.pcs", "file?", "<", ">", "|", '"', "\ud800", "\udcff", ".orinkit-tmp-x", "あ" * 86,
    "ｆ" * 2000, "dir/./x", "dir/. /x", "... /x", "\u202e/../x", "%2e%2e/:x", "~/..",
]  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE, ids=lambda name: ascii(name)[:30])
def test_hostile_names_are_refused_by_every_method(name, store, root, outside, notified, refused, open_file):
    store.make_folder("dir")
    store.write("file", b"1")
    file, folder = open_file("file"), open_file("dir")
    notified.clear()
    with untouched(outside.parent):
        calls = [
            (store.exists, name), (store.is_folder, name), (store.full_name, name), (store.names, name), (store.size, name),
            (store.dates, name), (store.read, name), (store.write, name, b"x"), (store.create, name),
            (store.make_folder, name), (store.delete, name), (store.copy, name, "new"), (store.copy, "file", name),
            (store.move, name, "new"), (store.move, "file", name), (open_file, name, CREATE),
            (folder.get_file, name, CREATE), (file.copy, name, ""), (file.move, name, ""),
        ]  # fmt: skip
        assert [refused(*call) for call in calls] == [INVALID] * len(calls)
    assert notified == []


@pytest.fixture
def planted(store, root, outside) -> Path:
    """A store with planted links and special files."""
    store.make_folder("dir")
    store.write("file", b"1")
    (root / "link.pcs").symlink_to(outside / "canary.pcs")
    (root / "linkdir").symlink_to(outside)
    (root / "dir" / "up").symlink_to(Path("..", "..", "..", "outside"))
    (root / "dangling").symlink_to(outside / "not yet")
    (root / "loop").symlink_to("loop")
    (root / "inside.pcs").symlink_to("file")
    os.mkfifo(root / "pipe")
    return root


LINKS = ["link.pcs", "LINK.PCS", "linkdir", "dir\\up", "DIR/UP", "dangling", "loop", "inside.pcs", "pipe"]
BEHIND = [
    "linkdir\\canary.pcs",
    "LinkDir/sub",
    "linkdir\\sub\\canary.pcs",
    "linkdir\\new",
    "dir\\up\\canary.pcs",
    "loop\\x",
]


@pytest.mark.parametrize("name", LINKS + BEHIND)
def test_links_are_not_there_and_nothing_is_written_through_them(
    name, store, planted, outside, notified, refused, open_file
):
    with untouched(outside.parent):
        assert (store.exists(name), store.is_folder(name)) == (False, False)
        for call in (store.full_name, store.size, store.dates, store.read, store.delete, store.names, open_file):
            assert refused(call, name) == NOT_FOUND
        assert refused(lambda: store.delete(name, recursive=True)) == NOT_FOUND
        for arguments in ((store.copy, name, "new"), (store.move, name, "new")):
            assert refused(*arguments) == NOT_FOUND
        for arguments in (
            (store.write, name, b"x"), (store.create, name), (store.make_folder, name), (store.copy, "file", name),
            (store.move, "file", name), (open_file, name, CREATE),
        ):  # fmt: skip
            assert refused(*arguments) == DENIED
    assert store.names() == ["dir\\", "file"]
    assert (store.names("dir"), store.programs(), notified) == ([], [], [])


def test_a_link_that_takes_a_files_place_while_a_client_holds_it(store, root, outside, open_file, refused):
    store.make_folder("dir")
    file, folder = open_file("Pro1.pcs", CREATE), open_file("dir\\")
    inner = open_file("dir\\canary.pcs", CREATE)
    (root / "Pro1.pcs").unlink()
    (root / "Pro1.pcs").symlink_to(outside / "canary.pcs")
    shutil.rmtree(root / "dir")
    (root / "dir").symlink_to(outside)
    with untouched(outside.parent):
        for each in (file, inner):
            calls = [
                (each.get_value,),
                (each.put_value, text("x")),
                (each.delete, ""),
                (each.move, "y", ""),
                (each.copy, "y", ""),
            ]
            assert [refused(*call) for call in calls] == [NOT_FOUND] * 5
        assert refused(folder.get_file_names, "") == NOT_FOUND
        assert refused(folder.get_file, "new", CREATE) == NOT_FOUND
        assert refused(folder.delete, "@Recursive=1") == NOT_FOUND


def test_a_recursive_delete_does_not_follow_links(store, planted, outside):
    with untouched(outside):
        store.delete("dir", recursive=True)
    assert not (planted / "dir").exists()


def test_a_folder_that_only_looks_empty(store, planted, refused):
    assert store.names("dir") == []
    assert refused(store.delete, "dir") == DENIED


def test_the_start_cleans_nothing_behind_links(store, planted, outside):
    (outside / ".orinkit-tmp-1").write_bytes(b"not ours")
    with untouched(outside):
        FileStore(planted, datetime.now)


def test_a_rename_in_case_does_not_replace_a_link(store, root, outside, refused):
    store.write("a.pcs", b"1")
    (root / "A.pcs").symlink_to(outside / "canary.pcs")
    with untouched(outside.parent):
        assert refused(store.move, "a.pcs", "A.pcs") == TAKEN
        assert refused(store.write, "A.pcs", b"") == DENIED
    store.write("a.pcs", b"2")
    assert store.read("a.pcs") == b"2"


def test_a_link_planted_between_check_and_open_is_not_followed(root, outside):
    root.mkdir(parents=True)
    (root / "link").symlink_to(outside / "canary.pcs")
    os.mkfifo(root / "pipe")
    with pytest.raises(OSError):
        disk.read_file(root / "link", 10)
    with pytest.raises(FileNotFoundError):
        disk.read_file(root / "pipe", 10)
    with untouched(outside):
        disk.stamp(root / "link", datetime(2024, 4, 1))
        disk.put_in_place(disk.write_temporary(root, b"x"), root / "link", datetime(2024, 4, 1))
    assert not (root / "link").is_symlink()


def test_a_hard_link_is_cut_by_a_write(store, root, outside):
    (root / "hard.pcs").hardlink_to(outside / "canary.pcs")
    store.write("hard.pcs", b"x")
    assert (outside / "canary.pcs").read_bytes() == SECRET


def test_entries_without_a_controllers_name_are_not_there(store, root):
    for name in (b"a:b", b"a\\b", b"nul", b"end.", b"\xff\xfe.pcs", b"a\nb", b".orinkit-tmp-dir"):
        Path(os.fsdecode(os.fsencode(root) + b"/" + name)).mkdir()
    assert (store.names(), store.programs()) == ([], [])


def test_a_tree_deeper_than_names_reach_is_left_alone(store, root):
    deep = root
    for _ in range(40):
        deep = deep / "d"
        deep.mkdir()
        (deep / "x.pcs").touch()
    assert len(store.programs()) == 15
    store.delete("d", recursive=True)
    assert list(root.iterdir()) == []


FRAGMENTS = st.sampled_from(
    ["..", ".", "", "a", "A", "dir", "file", "link.pcs", "linkdir", "canary.pcs", "sub", "C:", "~", "nul", "é", "e\u0301", "漢字", "🤖", "\0", " ", "x.", "*"]
)  # fmt: skip
NAMES = st.one_of(
    st.lists(st.tuples(FRAGMENTS, st.sampled_from(["\\", "/", ""])), max_size=6).map(
        lambda parts: "".join(map("".join, parts))
    ),
    st.text(st.characters(exclude_categories=()), max_size=30),
    st.text(st.sampled_from("./\\:aA\0 é\u0301*"), max_size=12),
    st.builds(lambda one, times: one * times, st.sampled_from(["..\\", "a", "あ", "a/", "\\"]), st.integers(0, 2000)),
)


def test_no_text_as_a_name_gets_outside(planted, store, outside, open_file):
    """Every method with any text: a return code, or an effect inside; nothing outside is changed or read."""
    file, folder = open_file("file"), open_file("dir")
    canary = outside.parent
    before = {path: everything(path) for path in canary.iterdir() if path.name != "in"}

    @settings(max_examples=250, deadline=None, database=None)
    @given(NAMES, NAMES)
    def attempt(name: str, other: str) -> None:
        calls = [
            (store.exists, name), (store.is_folder, name), (store.size, name), (store.dates, name), (store.names, name),
            (store.make_folder, name), (store.create, other), (store.write, name, b"w"), (store.copy, name, other),
            (folder.get_file, name, CREATE), (file.copy, name, ""), (store.move, name, other), (store.delete, other),
            (open_file, other, CREATE), (store.delete, name),
        ]  # fmt: skip
        for call in calls:
            _try(*call)
        for each in (name, other):
            content = _try(store.read, each)
            assert content is None or SECRET not in content
            path = _try(store.full_name, each)
            assert path is None or (store.exists(path) and store.full_name(path) == path)
        assert {path: everything(path) for path in canary.iterdir() if path.name != "in"} == before
        assert [path.name for path in (canary / "in").iterdir()] == ["files"]
        _try(store.write, "file", b"1")
        _try(store.make_folder, "dir")

    attempt()


def _try(call: Any, *arguments: Any) -> Any:
    try:
        return call(*arguments)
    except CallError as error:
        assert error.code in (INVALID, NOT_FOUND, TAKEN, DENIED)  # noqa: PT017 - a few codes, or no error
        return None


PARTS = st.sampled_from(["a", "A", "b", "B", "é", "E\u0301"])
PATHS = st.one_of(PARTS, st.builds("{}\\{}".format, PARTS, PARTS), st.builds("{}/{}/{}".format, PARTS, PARTS, PARTS))
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("write"), PATHS, st.binary(max_size=3)),
        st.tuples(st.sampled_from(["create", "make_folder", "delete"]), PATHS),
        st.tuples(st.sampled_from(["copy", "move"]), PATHS, PATHS),
    ),
    max_size=25,
)


def test_the_store_is_a_tree_by_folded_names(tmp_path):
    """Compare with a model: a dictionary from folded names to contents, ``None`` for a folder."""
    numbers = iter(range(10**6))

    @settings(max_examples=150, deadline=None, database=None)
    @given(STEPS)
    def follow(steps: list[tuple[Any, ...]]) -> None:
        store = FileStore(tmp_path / str(next(numbers)), datetime.now)
        model: dict[str, bytes | None] = {"": None}
        for method, *arguments in steps:
            expected = _step(model, method, *arguments)
            try:
                getattr(store, method)(*arguments)
            except CallError as error:
                assert error.code == expected  # noqa: PT017 - not every case raises
            else:
                assert expected == 0
            assert _contents(store, "") == {name: value for name, value in model.items() if name}
        shutil.rmtree(store.root)

    follow()


def _fold(name: str) -> str:
    return name.replace("/", "\\").replace("e\u0301", "é").replace("E\u0301", "É").upper()


def _contents(store: FileStore, folder: str) -> dict[str, bytes | None]:
    found: dict[str, bytes | None] = {}
    for name in store.names(folder):
        path = f"{folder}{name}"
        if name.endswith("\\"):
            found[_fold(path[:-1])] = None
            found |= _contents(store, path)
        else:
            found[_fold(path)] = store.read(path)
    return found


def _step(model: dict[str, bytes | None], method: str, name: str, extra: Any = b"") -> int:
    """Apply a step to the model; return the code with which it is refused, or 0."""
    key = _fold(name)
    if method in ("copy", "move"):
        return _transfer(model, method, key, _fold(extra))
    if method == "delete":
        if key not in model:
            return NOT_FOUND
        if any(other.startswith(key + "\\") for other in model):
            return DENIED
        del model[key]
        return 0
    if model.get(key.rpartition("\\")[0], b"") is not None:
        return NOT_FOUND
    if key in model and not (method == "write" and model[key] is not None):
        return DENIED if method == "write" else TAKEN
    model[key] = None if method == "make_folder" else extra
    return 0


def _transfer(model: dict[str, bytes | None], method: str, key: str, new: str) -> int:
    if key not in model:
        return NOT_FOUND
    is_folder = model[key] is None
    if method == "copy" and is_folder:
        return DENIED
    if method == "move" and new == key:
        return 0
    if is_folder and new.startswith(key + "\\"):
        return INVALID
    if model.get(new.rpartition("\\")[0], b"") is not None:
        return NOT_FOUND
    if new in model:
        return TAKEN
    for old in [each for each in model if each == key or each.startswith(key + "\\")]:
        model[new + old[len(key) :]] = model[old]
        if method == "move":
            del model[old]
    return 0


# --- File objects -----------------------------------------------------------------------------------------------------


def test_a_file_is_created_only_on_demand(open_file, store, refused):
    assert refused(open_file, "Pro1.pcs") == NOT_FOUND
    assert refused(open_file, "Pro1.pcs", "@Create=0") == NOT_FOUND
    assert not store.exists("Pro1.pcs")
    assert plain(open_file("Pro1.pcs", "@Create=1")) == ""
    open_file("dir\\", "@create")
    open_file("dir/x.txt", "@Create=true, @IfNotMember")
    assert store.names() == ["dir\\", "Pro1.pcs"]
    store.write("Pro1.pcs", b"kept")
    assert plain(open_file("PRO1.pcs", "@Create=1")) == "kept"
    assert refused(open_file, "Pro1.pcs\\") == NOT_FOUND
    assert refused(open_file, "Pro1.pcs\\", CREATE) == TAKEN
    assert refused(open_file, "Pro1.pcs\\x", CREATE) in (NOT_FOUND, TAKEN)


def test_a_file_is_created_with_the_folders_that_it_is_in(open_file, store):
    open_file("a\\b/x.txt", CREATE)
    open_file("c/d/", CREATE)
    assert store.names() == ["a\\", "c\\"]
    assert store.names("a\\b") == ["x.txt"]
    assert store.is_folder("c\\d")


def test_attributes_of_a_file(open_file, store, clock):
    store.make_folder("dir")
    file = open_file("DIR/Pro1.PCS", CREATE)
    clock.advance(1.5)
    file.put_value(text("あ"))
    assert (file.get_name(), file.get_path(), file.get_type(), file.get_size()) == (
        "Pro1.PCS",
        "dir\\Pro1.PCS",
        "pcs",
        3,
    )
    assert file.get_attribute() == 3
    assert file.get_help() == "dir\\Pro1.PCS: program"
    assert file.get_date_created() == "2024-04-01 09:00:00"
    assert file.get_date_last_modified() == file.get_date_last_accessed() == "2024-04-01 09:00:01"
    clock.advance(3600)
    assert plain(file) == "あ"
    assert file.get_date_last_accessed() == "2024-04-01 10:00:01"
    assert (file.get_variable_names(""), file.get_file_names("")) == (["@CRC"], [])
    assert open_file(file.get_path()).get_path() == file.get_path()
    assert open_file("noext", CREATE).get_type() == ""


@pytest.mark.parametrize("name", ["", "\\", "/"])
def test_the_root_folder(name, open_file, store, refused):
    store.make_folder("dir")
    store.create("a.txt")
    folder = open_file(name)
    assert (folder.get_name(), folder.get_path(), folder.get_type(), folder.get_size()) == ("\\", "\\", "folder", 0)
    assert folder.get_attribute() == 19
    assert folder.get_help() == "\\: folder"
    assert folder.get_file_names("") == ["a.txt", "dir\\"]
    assert folder.get_file("A.TXT", "").get_path() == "a.txt"
    assert folder.get_file("", "").get_path() == "\\"
    for call in (
        folder.get_value,
        lambda: folder.put_value(text("")),
        lambda: folder.delete("@Recursive=1"),
        lambda: folder.move("x", ""),
        lambda: folder.copy("x", ""),
    ):
        assert refused(call) == DENIED
    assert refused(folder.run, "") == INVALID


def test_files_below_a_folder(open_file, refused):
    folder = open_file("dir\\", CREATE)
    sub = folder.get_file("sub\\", CREATE)
    file = sub.get_file("x.txt", CREATE)
    assert (sub.get_path(), file.get_path(), folder.get_attribute()) == ("dir\\sub", "dir\\sub\\x.txt", 19)
    assert folder.get_file("SUB/X.txt", "").get_path() == "dir\\sub\\x.txt"
    assert folder.get_file_names("") == ["sub\\"]
    assert folder.get_file("", "").get_path() == "dir"
    assert refused(folder.get_file, "no", "") == NOT_FOUND
    assert refused(folder.get_file, "..", "") == INVALID
    assert refused(folder.get_file, "\\x", CREATE) == INVALID
    assert refused(file.get_file, "x", CREATE) == NOT_FOUND
    assert refused(folder.get_value) == DENIED
    assert refused(folder.put_value, text("x")) == DENIED


TEXTS = [
    ("a.pcs", "改行\r\n\n\rtab\t\0end".encode(), "改行\r\n\n\rtab\t\0end"),
    ("a.PAC", "\ufeffWith a mark".encode(), "With a mark"),
    ("a.h", "'漢字".encode("cp932"), "'漢字"),
    ("a.txt", b"", ""),
    ("a.csv", b"\x81", None),  # neither UTF-8 nor half of a kanji
    ("a.json", b"\xff\xff\xff", None),
    ("a.dat", "漢字".encode(), "漢字"),
    ("a.dat", "\ufeff漢字".encode(), "漢字"),
    ("a.dat", "漢字".encode("cp932"), None),
    ("a.dat", b"a\0b", None),
    ("a", b"", ""),
    ("a.bin", bytes(range(256)), None),
]


@pytest.mark.parametrize(("name", "data", "wanted"), TEXTS)
def test_content_is_text_or_bytes(name, data, wanted, store, open_file):
    store.write(name, data)
    expected = Variant(BYTES, data) if wanted is None else Variant(VarType.BSTR, wanted)
    assert open_file(name).get_value() == expected


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (text("改行\r\n\n\r🤖"), "改行\r\n\n\r🤖".encode()),
        (text(""), b""),
        (Variant(BYTES, b"\0\xff"), b"\0\xff"),
        (Variant(BYTES, b"x"), b"x"),
        (Variant(BYTES, b""), b""),
        (Variant(VarType.EMPTY), b""),
    ],
)
def test_content_is_stored_exactly(value, kept, store, open_file):
    file = open_file("a.pcs", CREATE)
    file.put_value(text("before"))
    file.put_value(value)
    assert store.read("a.pcs") == kept


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (Variant(VarType.I4, 1), hresult.DISP_E_TYPEMISMATCH),
        (Variant(VarType.NULL), hresult.DISP_E_TYPEMISMATCH),
        (Variant(VarType.BOOL, True), hresult.DISP_E_TYPEMISMATCH),
        (Variant(VarType.UI1, 1), hresult.DISP_E_TYPEMISMATCH),
        (Variant(VarType.I1 | ARRAY, [1]), hresult.DISP_E_TYPEMISMATCH),
        (Variant(VarType.BSTR | ARRAY, ["a"]), hresult.DISP_E_TYPEMISMATCH),
        (Variant(VarType.VARIANT | ARRAY, ["a"]), hresult.DISP_E_TYPEMISMATCH),
        (text("\ud800"), INVALID),
        (text("あ" * (MOST_BYTES // 3 + 1)), hresult.E_TOO_MUCH_DATA),
        (Variant(BYTES, bytes(MOST_BYTES + 1)), hresult.E_TOO_MUCH_DATA),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_what_cannot_be_put_leaves_the_content(value, code, open_file, refused):
    file = open_file("a.pcs", CREATE)
    file.put_value(text("before"))
    assert refused(file.put_value, value) == code
    assert plain(file) == "before"


def test_any_text_comes_back_from_a_program(open_file):
    file = open_file("a.pcs", CREATE)

    @settings(max_examples=50, deadline=None, database=None)
    @given(st.text(st.characters(exclude_categories=("Cs",))))
    def put_and_get(value: str) -> None:
        file.put_value(text(value))
        assert plain(file) == value.removeprefix("\ufeff")

    put_and_get()


def test_copy_move_delete(open_file, store, refused):
    store.make_folder("dir")
    file = open_file("Pro1.pcs", CREATE)
    file.put_value(text("1"))
    file.copy("Copy.pcs", "")
    file.copy("dir\\", "")
    assert store.read("copy.pcs") == store.read("dir\\Pro1.pcs") == b"1"
    assert file.get_path() == "Pro1.pcs"
    assert refused(file.copy, "DIR/", "") == TAKEN
    assert refused(file.move, "copy.pcs", "") == TAKEN
    assert refused(file.move, "no\\", "") == NOT_FOUND
    for name in ("", "."):
        assert refused(file.move, name, "") == INVALID
    file.move("dir\\Pro2.PCS", "")
    assert (file.get_path(), file.get_name(), plain(file)) == ("dir\\Pro2.PCS", "Pro2.PCS", "1")
    file.move("/", "")
    assert file.get_path() == "Pro2.PCS"
    assert store.names() == ["Copy.pcs", "dir\\", "Pro2.PCS"]
    file.delete("")
    assert store.names() == ["Copy.pcs", "dir\\"]


def test_after_delete_there_is_nothing(open_file, refused):
    file, other = open_file("a.pcs", CREATE), open_file("A.PCS")
    file.delete("")
    for each in (file, other):
        calls = [
            (each.get_value,), (each.put_value, text("x")), (each.get_size,), (each.get_type,), (each.get_path,),
            (each.get_attribute,), (each.get_help,), (each.get_date_created,), (each.get_date_last_accessed,),
            (each.get_date_last_modified,), (each.get_file, "x", CREATE), (each.get_file_names, ""), (each.copy, "x", ""),
            (each.move, "x", ""), (each.delete, ""), (each.run, ""),
        ]  # fmt: skip
        assert [refused(*call) for call in calls] == [NOT_FOUND] * len(calls)
        assert each.get_name() == "a.pcs"


def test_a_folder_is_deleted_with_its_content_on_demand(open_file, store, refused):
    folder = open_file("dir\\", CREATE)
    folder.get_file("x.pcs", CREATE)
    assert refused(folder.delete, "") == DENIED
    folder.delete("@Recursive=1")
    assert store.names() == []


def test_run_passes_the_program_to_its_callback(open_file, store, refused):
    runs = []

    def run(caller: ClientContext, name: str, option: str) -> str:
        require_program(caller, store, name)
        runs.append((caller.origin.address, name, option))
        return name.removesuffix(".pcs")

    folder = open_file("dir\\", CREATE, run=run)
    program = folder.get_file("Pro1.pcs", CREATE)
    assert program.run("@x") == "dir\\Pro1"
    assert runs == [("192.168.0.7", "dir\\Pro1.pcs", "@x")]
    assert refused(folder.run, "") == INVALID
    assert refused(folder.get_file("a.txt", CREATE).run, "") == INVALID
    assert refused(folder.get_file("b.pcs\\", CREATE).run, "") == INVALID
    assert refused(open_file("dir\\Pro1.pcs").run, "") == hresult.E_NOTIMPL
    assert refused(open_file("dir\\Pro1.pcs", access=AccessRight.READ, run=run).run, "") == hresult.NO_WRITE_RIGHT
    program.delete("")
    assert refused(program.run, "") == NOT_FOUND
    assert len(runs) == 1


def test_a_reader_changes_nothing(open_file, store, notified, refused):
    store.write("a.pcs", b"1")
    store.make_folder("dir")
    notified.clear()
    file = open_file("a.pcs", access=AccessRight.READ)
    assert plain(file) == "1"
    assert file.get_attribute() == 1
    assert open_file("dir", access=AccessRight.READ).get_attribute() == 17
    calls = [
        (file.put_value, text("x")), (file.copy, "b", ""), (file.move, "b", ""), (file.delete, ""), (file.run, ""),
        (open_file, "new", CREATE, AccessRight.READ), (open_file, "new\\", CREATE, AccessRight.READ),
    ]  # fmt: skip
    assert [refused(*call) for call in calls] == [hresult.NO_WRITE_RIGHT] * len(calls)
    assert (notified, store.names()) == ([], ["a.pcs", "dir\\"])


def test_without_the_right_to_read_there_is_nothing_to_see(caller, store, refused):
    store.write("a.pcs", b"1")
    for name in ("a.pcs", "no", ""):
        assert refused(find_file, caller(AccessRight.NONE), store, name, "") == hresult.NO_READ_RIGHT
    file = RC8File(caller(AccessRight.NONE), store, "a.pcs")
    for call in (
        file.get_value,
        file.get_size,
        file.get_path,
        file.get_type,
        file.get_date_created,
        file.get_attribute,
    ):
        assert refused(call) == hresult.NO_READ_RIGHT
    assert refused(file.get_file_names, "") == hresult.NO_READ_RIGHT


def test_a_file_has_no_variables_and_no_commands(open_file, refused):
    file = open_file("a.pcs", CREATE)
    for name in ("", "@SIZE", "I1"):
        assert refused(file.get_variable, name, "") == hresult.E_CAO_OBJECT_NOTFOUND
    assert refused(file.execute, "GetSize", Variant(VarType.EMPTY)) == hresult.E_INVALID_CMD_NAME


def test_help_is_in_the_controllers_language(clock, store):
    device = VirtualRC8(clock=clock, language="ja")
    caller = open_context(device.state, Origin("ctrl"), AccessRight.READ_WRITE)
    helps = [find_file(caller, store, name, CREATE).get_help() for name in ("a.pcs", "a.txt", "dir\\")]
    assert helps == ["a.pcs: プログラム", "a.txt: ファイル", "dir: フォルダ"]
    device.close()


class _Served(Provider):
    provider_names = ("CaoProv.Test",)

    def __init__(self, caller: ClientContext, store: FileStore) -> None:
        self.caller = caller
        self.store = store

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        return _Controller(self.caller, self.store)


class _Controller(ControllerObject):
    def __init__(self, caller: ClientContext, store: FileStore) -> None:
        super().__init__()
        self.caller = caller
        self.store = store

    def get_file(self, name: str, option: str) -> RC8File:
        return find_file(self.caller, self.store, name, option, lambda caller, name, option: "Pro1")


def test_every_function_of_a_file_answers_as_the_table_types_it(caller, store):
    session = Session(ProviderRegistry(_Served(caller(), store)))

    def call(function: str, *arguments: Any) -> Any:
        values = [
            each if isinstance(each, Variant) else Variant(VarType.I4 if isinstance(each, int) else VarType.BSTR, each)
            for each in arguments
        ]
        reply = session.invoke(BY_NAME[function].id, values)
        assert getattr(reply, "code", None) == 0, (function, reply)
        return reply.result

    controller = call("Controller_Connect", "", "CaoProv.Test", "", "").value
    folder = call("Controller_GetFile", controller, "dir\\", CREATE).value
    file = call("File_GetFile", folder, "Pro1.pcs", CREATE).value
    call("File_PutValue", file, text("Sub Main\r\nEnd Sub"))
    assert call("File_GetValue", file) == text("Sub Main\r\nEnd Sub")
    assert call("File_GetSize", file) == Variant(VarType.I4, 17)
    assert call("File_GetPath", file) == text("dir\\Pro1.pcs")
    assert call("File_GetType", file) == text("pcs")
    assert call("File_GetName", file) == text("Pro1.pcs")
    assert call("File_GetAttribute", folder) == Variant(VarType.I4, 19)
    assert call("File_GetHelp", file).type == VarType.BSTR
    for function in ("File_GetDateCreated", "File_GetDateLastAccessed", "File_GetDateLastModified"):
        assert call(function, file) == text("2024-04-01 09:00:00")
    assert call("File_GetFileNames", folder).plain == ["Pro1.pcs"]
    assert call("File_GetFileNames", file).plain == []
    assert call("File_GetVariableNames", file).plain == ["@CRC"]
    assert call("File_Run", file, "") == text("Pro1")
    call("File_Copy", file, "Copy.pcs", "")
    call("File_Move", file, "Moved.pcs", "")
    call("File_PutTag", file, text("tag"))
    assert call("File_GetTag", file) == text("tag")
    call("File_Delete", file, "")
    call("File_Release", file)
    assert store.names() == ["Copy.pcs", "dir\\"]
    session.close()


def test_a_write_is_refused_while_the_directory_is_missing(store, root):
    store.write("a.pcs", b"old")
    away = root.with_name("away")
    root.rename(away)
    with pytest.raises(CallError):
        store.write("a.pcs", b"new")
    with pytest.raises(CallError):
        store.write("b.pcs", b"new")
    away.rename(root)
    assert store.read("a.pcs") == b"old"
    store.write("a.pcs", b"new")
    assert store.read("a.pcs") == b"new"
