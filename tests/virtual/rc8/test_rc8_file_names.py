from __future__ import annotations

import unicodedata

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, InvalidArgument
from orinkit.virtual.rc8.files.names import extension, join, name_on_disk, part_key, read_name

GOOD = {
    "Pro1.pcs": ("Pro1.pcs",),
    "dir\\Pro1.pcs": ("dir", "Pro1.pcs"),
    "dir/Pro1.pcs": ("dir", "Pro1.pcs"),
    "a/b\\c": ("a", "b", "c"),
    "日本語\\プログラム.pcs": ("日本語", "プログラム.pcs"),
    "🤖.txt": ("🤖.txt",),
    "👩‍🔧.txt": ("👩‍🔧.txt",),
    " leading space": (" leading space",),
    ".hidden": (".hidden",),
    "a..b": ("a..b",),
    "...a": ("...a",),
    "~": ("~",),
    "-rf": ("-rf",),
    "$(x) `y` 'z' %1;&": ("$(x) `y` 'z' %1;&",),
    "COM": ("COM",),
    "COM10": ("COM10",),
    "CONSOLE.txt": ("CONSOLE.txt",),
    "null": ("null",),
    "／": ("／",),  # full width: an ordinary character
    "\xa0": ("\xa0",),
    "cafe\u0301": ("café",),
    "か\u3099": ("が",),
    "\u212a": ("K",),  # Kelvin: NFC converts it to the letter
    "a" * 255: ("a" * 255,),
    "あ" * 85: ("あ" * 85,),
    "\\".join(["d"] * 16): ("d",) * 16,
}


@pytest.mark.parametrize("name", GOOD, ids=ascii)
def test_a_name_is_read(name):
    read = read_name(name)
    assert (read.parts, read.folder) == (GOOD[name], False)
    assert read_name(str(read)) == read
    assert name_on_disk(read.parts[-1]) == read.parts[-1]


@pytest.mark.parametrize(
    ("name", "parts"), [("", ()), ("\\", ()), ("/", ()), ("dir\\", ("dir",)), ("a/b/", ("a", "b"))]
)
def test_a_folders_name_may_end_in_a_separator(name, parts):
    read = read_name(name)
    assert (read.parts, read.folder) == (parts, True)


BAD = {
    "//": "begins with a separator",
    "\\\\": "begins with a separator",
    "/x": "begins with a separator",
    "\\x": "begins with a separator",
    "\\\\server\\share": "begins with a separator",
    "//server/share": "begins with a separator",
    "\\\\?\\C:\\x": "begins with a separator",
    "a\\\\b": "empty",
    "a//b": "empty",
    "a\\/b": "empty",
    "a\\\\": "empty",
    ".": '"."',
    "..": '".."',
    "..\\x": '".."',
    "a/../../x": '".."',
    "a\\.\\b": '"."',
    "a/..": '".."',
    "../": '".."',
    "C:": "drives",
    "C:\\x": "drives",
    "c:x": "drives",
    "a\\C:\\b": "drives",
    "x.pcs:stream": "drives",
    "x.pcs::$DATA": "drives",
    "a\0b": "'\\x00'",
    "\0": "'\\x00'",
    "a\nb": "'\\n'",
    "a\x1bb": "'\\x1b'",
    "a\x7f": "'\\x7f'",
    "a\x85b": "'\\x85'",
    "a\u2028b": "'\\u2028'",
    "a<b": "'<'",
    "a>b": "'>'",
    'a"b': "'\"'",
    "a|b": "'|'",
    "a?b": "'?'",
    "*.pcs": "'*'",
    "a.": "dot or a space",
    "a ": "dot or a space",
    " ": "dot or a space",
    "...": "dot or a space",
    "dir.\\x": "dot or a space",
    "dir \\x": "dot or a space",
    ".. \\x": "dot or a space",
    "CON": "device",
    "con.txt": "device",
    "nul": "device",
    "NUL.tar.gz": "device",
    "NUL .txt": "device",
    "a\\aux\\b": "device",
    "COM1": "device",
    "com¹.pcs": "device",
    "LPT9": "device",
    "conin$": "device",
    "a" * 256: "255 bytes",
    "あ" * 86: "255 bytes",
    "a" * 4096: "1024 characters",
    "a\\" * 4096: "1024 characters",
    "\\".join(["d"] * 17): "16 levels",
    "\ud800": "surrogate",
    "a\udc80.pcs": "surrogate",
    ".orinkit-tmp-0": "temporary files",
    "a\\.ORINKIT-TMP-0": "temporary files",
}


@pytest.mark.parametrize("name", BAD, ids=lambda name: ascii(name)[:40])
def test_a_refused_name_has_a_reason(name):
    with pytest.raises(InvalidArgument) as caught:
        read_name(name)
    assert caught.value.code == hresult.E_INVALIDARG
    assert BAD[name] in caught.value.detail
    assert len(caught.value.detail) < 200


def test_refusals_are_also_in_japanese():
    i18n.use("ja")
    try:
        for name in BAD:
            with pytest.raises(CallError) as caught:
                read_name(name)
            assert caught.value.detail.startswith("ファイル名 ")
            assert any("\u3040" <= sign <= "\u30ff" for sign in caught.value.detail.partition(": ")[2])
    finally:
        i18n.use("en")


@pytest.mark.parametrize("entry", [".", "..", "a\\b", "a:b", "a.", "nul", "a\nb", "\udcff", ".orinkit-tmp-00", "*"])
def test_an_entry_that_no_name_reaches(entry):
    assert name_on_disk(entry) is None


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("Pro1.pcs", "PRO1.PCS", True),
        ("é", "E\u0301", True),
        ("ж", "Ж", True),
        ("ａ", "Ａ", True),
        ("ß", "SS", False),
        ("か", "が", False),
        ("a", "b", False),
    ],
)
def test_upper_and_lower_case_are_the_same_name(one, other, same):
    assert (part_key(one) == part_key(other)) is same
    assert (read_name(f"d\\{one}").key == read_name(f"D/{other}").key) is same


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("Pro1.PCS", "pcs"),
        ("a.b\\Pro1", ""),
        ("a.tar.gz", "gz"),
        (".gitignore", ""),
        ("dir\\.x.Y", "y"),
        ("", ""),
        ("\\", ""),
    ],
)
def test_extension(name, wanted):
    assert extension(name) == wanted


def test_the_root_is_written_as_a_separator():
    assert join(()) == str(read_name("")) == "\\"


@given(st.text(st.characters(exclude_categories=()), max_size=40))
@example("\u037e")  # NFC converts it to a semicolon
@example("\u2024")  # one dot leader
def test_any_text_is_a_safe_name_or_refused(text):
    try:
        read = read_name(text)
    except InvalidArgument:
        return
    for part in read.parts:
        assert part == unicodedata.normalize("NFC", part)
        assert part not in ("", ".", "..")
        assert not set(part) & set('\\/:*?"<>|\0\n')
        assert part[-1] not in ". "
        assert len(part.encode()) <= 255
        assert name_on_disk(part) == part
    assert read_name(str(read)).parts == read.parts
    assert read_name(str(read)).key == read.key
