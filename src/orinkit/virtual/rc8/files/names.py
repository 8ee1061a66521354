r"""Names of files and folders on the controller: ``Pro1.pcs``, ``dir\Pro1.pcs``.

A name is always told from the root folder; its parts are separated by ``\`` or ``/``. Upper and lower case do not
matter but are kept, and Unicode is kept in its composed form (NFC). A name is checked before it comes near a disk:
:func:`read_name` refuses everything that could mean something else there, on whichever system the controller runs.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Final

from orinkit import hresult
from orinkit.errors import CallError, error_for
from orinkit.language import pick

SEPARATOR: Final = "\\"
"""Between the parts of a name that the controller tells; it takes ``/`` as well."""

MOST_CHARACTERS: Final = 1024
"""Characters of a whole name."""

MOST_PART_BYTES: Final = 255
"""Bytes of one part in UTF-8."""

MOST_PARTS: Final = 16
"""Folders within folders, the file itself counted."""

TEMPORARY_PREFIX: Final = ".orinkit-tmp-"
"""What the names of half-written files begin with; no name of the controller does."""

_SEPARATORS: Final = re.compile(r"[\\/]")
_REFUSED: Final = re.compile(r'[<>"|?*\x00-\x1f\x7f-\x9f\u2028\u2029]')  # signs, control characters, ends of lines
_DEVICES: Final = frozenset(
    (
        *("CON", "PRN", "AUX", "NUL", "CLOCK$", "CONIN$", "CONOUT$"),
        *(f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"),
    )
)
_SHOWN: Final = 60


@dataclass(frozen=True, slots=True)
class FileName:
    """A name that has been read.

    Attributes:
        parts: folders and the last name, in NFC; none for the root folder.
        folder: whether it can only be that of a folder: the root, or written with a separator at its end.
    """

    parts: tuple[str, ...]
    folder: bool = False

    def __str__(self) -> str:
        return join(self.parts)

    @property
    def key(self) -> tuple[str, ...]:
        """What two names of the same file have in common, however they are written."""
        return tuple(map(part_key, self.parts))


def read_name(name: str) -> FileName:
    r"""Read a name as a client writes it; ``""``, ``"\"`` and ``"/"`` are the root folder.

    Raises:
        CallError: E_INVALIDARG; the detail says what is wrong with it.
    """
    if len(name) > MOST_CHARACTERS:
        raise _refused(name, f"longer than {MOST_CHARACTERS} characters", f"{MOST_CHARACTERS} 文字を超えています")
    if name in ("", "\\", "/"):
        return FileName((), folder=True)
    try:
        written = unicodedata.normalize("NFC", name)
        written.encode("utf-8")
    except UnicodeEncodeError:
        raise _refused(name, "a lone surrogate is no character", "不正なサロゲートが含まれています") from None
    parts = _SEPARATORS.split(written)
    if not parts[0]:
        raise _refused(
            name, "names begin at the root folder, without a separator", "名前の先頭に区切り文字は付けません"
        )
    folder = not parts[-1]
    if folder:
        parts.pop()
    if len(parts) > MOST_PARTS:
        raise _refused(name, f"more than {MOST_PARTS} parts", f"階層が {MOST_PARTS} を超えています")
    for part in parts:
        fault = _fault(part)
        if fault is not None:
            raise _refused(name, *fault)
    return FileName(tuple(parts), folder)


def join(parts: tuple[str, ...]) -> str:
    r"""Return parts as the controller tells them; the root folder is ``"\"``."""
    return SEPARATOR.join(parts) or SEPARATOR


def part_key(part: str) -> str:
    """Return what one part has in common with the same part written otherwise: upper case, NFC.

    As on Windows, one character stands for one: ``ß`` is not ``SS``.
    """
    if part.isascii():
        return part.upper()
    return "".join(upper if len(upper := sign.upper()) == 1 else sign for sign in unicodedata.normalize("NFC", part))


def name_on_disk(entry: str) -> str | None:
    """Return the controller's name of a directory entry, ``None`` where no name can reach it."""
    try:
        name = unicodedata.normalize("NFC", entry)
        name.encode("utf-8")
    except UnicodeEncodeError:  # bytes that are no UTF-8
        return None
    return None if _SEPARATORS.search(name) or _fault(name) is not None else name


def extension(name: str) -> str:
    """Return the extension of a name in lower case, without its dot; ``""`` where it has none."""
    stem, dot, ending = _SEPARATORS.split(name)[-1].rpartition(".")
    return ending.lower() if stem and dot else ""


def _fault(part: str) -> tuple[str, str] | None:
    if not part:
        return "a part of it is empty", "空の部分があります"
    if part in (".", ".."):
        return f'"{part}" is not allowed', f"「{part}」は使えません"
    if ":" in part:
        return "there are no drives, and no ':' in names", "ドライブ指定や「:」は使えません"
    wrong = _REFUSED.search(part)
    if wrong is not None:
        return f"{wrong[0]!r} is not allowed in it", f"{wrong[0]!r} は使えません"
    if part[-1] in ". ":
        return "a part of it ends in a dot or a space", "末尾がドットまたは空白の部分があります"
    if part.split(".")[0].rstrip(" ").upper() in _DEVICES:
        return f"{part[:_SHOWN]!r} is a device", f"{part[:_SHOWN]!r} はデバイス名です"
    if len(part.encode("utf-8")) > MOST_PART_BYTES:
        return (
            f"a part of it has more than {MOST_PART_BYTES} bytes in UTF-8",
            f"UTF-8 で {MOST_PART_BYTES} バイトを超える部分があります",
        )
    if part_key(part).startswith(part_key(TEMPORARY_PREFIX)):
        return f"{TEMPORARY_PREFIX} is for half-written files", f"{TEMPORARY_PREFIX} は書き込み途中のファイル用です"
    return None


def _refused(name: str, en: str, ja: str) -> CallError:
    shown = repr(name if len(name) <= _SHOWN else f"{name[:_SHOWN]}...")
    return error_for(hresult.E_INVALIDARG, pick(f"file name {shown}: {en}", f"ファイル名 {shown}: {ja}"))
