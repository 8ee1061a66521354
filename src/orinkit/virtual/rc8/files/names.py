r"""Names of files and folders on the controller: ``Pro1.pcs``, ``dir\Pro1.pcs``.

A name is always relative to the root folder; its parts are separated by ``\`` or ``/``. Names are stored as written,
but compared without regard to case. Unicode is stored in its composed form (NFC). A name is checked before any access
to the disk: :func:`read_name` refuses every name that has a special meaning on any supported operating system.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record

SEPARATOR: Final = "\\"
"""Separator of the parts in names that the controller returns; in names from clients, ``/`` is accepted as well."""

MOST_CHARACTERS: Final = 1024
"""Largest number of characters of a whole name."""

MOST_PART_BYTES: Final = 255
"""Largest number of bytes of one part in UTF-8."""

MOST_PARTS: Final = 16
"""Largest number of parts of a name: its folders, and the file or folder itself."""

TEMPORARY_PREFIX: Final = ".orinkit-tmp-"
"""Prefix of temporary files; not allowed in names of the controller."""

_SEPARATORS: Final = re.compile(r"[\\/]")
_REFUSED: Final = re.compile(r'[<>"|?*\x00-\x1f\x7f-\x9f\u2028\u2029]')  # punctuation, control and line separators
_DEVICES: Final = frozenset(
    (
        *("CON", "PRN", "AUX", "NUL", "CLOCK$", "CONIN$", "CONOUT$"),
        *(f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"),
    )
)
_SHOWN: Final = 60


@record
class FileName:
    """A checked name.

    Attributes:
        parts: Names of the folders, and of the file or folder itself, in NFC; empty for the root folder.
        folder: True if only a folder can have this name: the root, or a name that ends in a separator.
    """

    parts: tuple[str, ...]
    folder: bool = False

    def __str__(self) -> str:
        return join(self.parts)

    @property
    def key(self) -> tuple[str, ...]:
        """The canonical form, which is equal for all spellings of a name."""
        return tuple(map(part_key, self.parts))


def read_name(name: str) -> FileName:
    r"""Check a name as written by a client and split it into parts; ``""``, ``"\"`` and ``"/"`` are the root folder.

    Raises:
        CallError: E_INVALIDARG; the detail describes the error.
    """
    if len(name) > MOST_CHARACTERS:
        raise _refused(name, tr("longer than {most} characters", most=MOST_CHARACTERS))
    if name in ("", "\\", "/"):
        return FileName((), folder=True)
    try:
        written = unicodedata.normalize("NFC", name)
        written.encode("utf-8")
    except UnicodeEncodeError:
        raise _refused(name, tr("it contains a lone surrogate")) from None
    parts = _SEPARATORS.split(written)
    if not parts[0]:
        raise _refused(name, tr("it begins with a separator; names are relative to the root folder"))
    folder = not parts[-1]
    if folder:
        parts.pop()
    if len(parts) > MOST_PARTS:
        raise _refused(name, tr("the path has more than {most} levels", most=MOST_PARTS))
    for part in parts:
        fault = _fault(part)
        if fault is not None:
            raise _refused(name, fault)
    return FileName(tuple(parts), folder)


def join(parts: tuple[str, ...]) -> str:
    r"""Join parts to a name with the controller's separator; the root folder is ``"\"``."""
    return SEPARATOR.join(parts) or SEPARATOR


def part_key(part: str) -> str:
    """Return the canonical form of one part: upper case, NFC.

    As on Windows, each character is converted to exactly one character: ``ß`` does not become ``SS``.
    """
    if part.isascii():
        return part.upper()
    return "".join(upper if len(upper := sign.upper()) == 1 else sign for sign in unicodedata.normalize("NFC", part))


def name_on_disk(entry: str) -> str | None:
    """Return the name that a directory entry has on the controller; ``None`` if the name is not valid there."""
    try:
        name = unicodedata.normalize("NFC", entry)
        name.encode("utf-8")
    except UnicodeEncodeError:  # the entry's name is not valid UTF-8
        return None
    return None if _SEPARATORS.search(name) or _fault(name) is not None else name


def extension(name: str) -> str:
    """Return the extension of a name in lower case, without its dot; ``""`` if there is none."""
    stem, dot, ending = _SEPARATORS.split(name)[-1].rpartition(".")
    return ending.lower() if stem and dot else ""


def _fault(part: str) -> str | None:
    if not part:
        return tr("it contains an empty folder or file name")
    if part in (".", ".."):
        return tr('"{part}" is not allowed', part=part)
    if ":" in part:
        return tr("drives and ':' are not allowed")
    invalid = _REFUSED.search(part)
    if invalid is not None:
        return tr("the character {sign!r} is not allowed", sign=invalid[0])
    if part[-1] in ". ":
        return tr("a folder or file name in it ends in a dot or a space")
    if part.split(".")[0].rstrip(" ").upper() in _DEVICES:
        return tr("{part!r} is a reserved device name of Windows", part=part[:_SHOWN])
    if len(part.encode("utf-8")) > MOST_PART_BYTES:
        return tr("a folder or file name in it has more than {most} bytes in UTF-8", most=MOST_PART_BYTES)
    if part_key(part).startswith(part_key(TEMPORARY_PREFIX)):
        return tr("the prefix {prefix} is reserved for temporary files", prefix=TEMPORARY_PREFIX)
    return None


def _refused(name: str, reason: str) -> CallError:
    shown = repr(name if len(name) <= _SHOWN else f"{name[:_SHOWN]}...")
    return error_for(hresult.E_INVALIDARG, tr("invalid file name {name}: {reason}", name=shown, reason=reason))
