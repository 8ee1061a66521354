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

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr

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
        raise _refused(name, tr("longer than {most} characters", most=MOST_CHARACTERS))
    if name in ("", "\\", "/"):
        return FileName((), folder=True)
    try:
        written = unicodedata.normalize("NFC", name)
        written.encode("utf-8")
    except UnicodeEncodeError:
        raise _refused(name, tr("a lone surrogate is no character")) from None
    parts = _SEPARATORS.split(written)
    if not parts[0]:
        raise _refused(name, tr("names begin at the root folder, without a separator"))
    folder = not parts[-1]
    if folder:
        parts.pop()
    if len(parts) > MOST_PARTS:
        raise _refused(name, tr("more than {most} parts", most=MOST_PARTS))
    for part in parts:
        fault = _fault(part)
        if fault is not None:
            raise _refused(name, fault)
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


def _fault(part: str) -> str | None:
    if not part:
        return tr("a part of it is empty")
    if part in (".", ".."):
        return tr('"{part}" is not allowed', part=part)
    if ":" in part:
        return tr("there are no drives, and no ':' in names")
    wrong = _REFUSED.search(part)
    if wrong is not None:
        return tr("{sign!r} is not allowed in it", sign=wrong[0])
    if part[-1] in ". ":
        return tr("a part of it ends in a dot or a space")
    if part.split(".")[0].rstrip(" ").upper() in _DEVICES:
        return tr("{part!r} is a device", part=part[:_SHOWN])
    if len(part.encode("utf-8")) > MOST_PART_BYTES:
        return tr("a part of it has more than {most} bytes in UTF-8", most=MOST_PART_BYTES)
    if part_key(part).startswith(part_key(TEMPORARY_PREFIX)):
        return tr("{prefix} is for half-written files", prefix=TEMPORARY_PREFIX)
    return None


def _refused(name: str, reason: str) -> CallError:
    shown = repr(name if len(name) <= _SHOWN else f"{name[:_SHOWN]}...")
    return error_for(hresult.E_INVALIDARG, tr("file name {name}: {reason}", name=shown, reason=reason))
