"""The files of a controller, as the page Programs uses them."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from typing import Any, Final

from orinkit.client._async.controller import AsyncController
from orinkit.client._async.file import AsyncFile
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import tr

SEPARATOR: Final = "\\"
MAX_EDITED: Final = 256 * 1024  # one message of the browser may have 1 MB
"""Largest number of characters of a file that can be edited."""
MAX_TRANSFERRED: Final = 16 * 1024 * 1024
"""Largest number of bytes of a file that can be uploaded."""
PROGRAM: Final = ".pcs"
_LONGEST_NAME: Final = 255


@dataclass(frozen=True, slots=True)
class Entry:
    """A file or folder.

    Attributes:
        name: Name in its folder.
        path: Path from the root folder.
        is_folder: True for a folder.
    """

    name: str
    path: str
    is_folder: bool


@dataclass(frozen=True, slots=True)
class TextFile:
    """A text file, with what is required to write it back in the same form.

    Attributes:
        path: Path from the root folder.
        text: The text; lines end in LF.
        encoding: Encoding of the bytes that the controller sends; ``""`` if it sends text.
        newline: Line end in the file: LF or CR LF.
    """

    path: str
    text: str
    encoding: str
    newline: str

    def content(self, text: str) -> str | bytes:
        """Return a new text in the form in which the controller sent the previous one.

        Raises:
            InvalidValue: If the encoding of the file does not have a character.
        """
        whole = text.replace("\n", self.newline)
        if not self.encoding:
            return whole
        try:
            return whole.encode(self.encoding)
        except UnicodeEncodeError as error:
            line = whole[: error.start].count("\n") + 1
            raise InvalidValue(
                tr(
                    "line {line}: the encoding of the file ({encoding}) does not have the character {character}",
                    line=line,
                    encoding="Shift_JIS" if self.encoding == "cp932" else self.encoding,
                    character=repr(whole[error.start]),
                )
            ) from None


def text_file(path: str, content: Any) -> TextFile:
    """Return the text in the content of a file: text, or bytes in UTF-8 or else Shift_JIS (code page 932).

    Raises:
        InvalidValue: If the content is not text, or too long to edit.
    """
    encoding = ""
    if isinstance(content, bytes):
        content, encoding = _decoded(content)
    if content is None:
        content = ""
    if not isinstance(content, str) or "\0" in content:
        raise InvalidValue(tr("{path} is not a text file. Try: download it", path=path))
    if len(content) > MAX_EDITED:
        raise InvalidValue(
            tr("{path} has {count} characters; at most {most} can be edited. Try: download it", path=path,
               count=len(content), most=MAX_EDITED)
        )  # fmt: skip
    newline = "\r\n" if "\r\n" in content else "\n"
    return TextFile(path, content.replace("\r\n", "\n").replace("\r", "\n"), encoding, newline)


def _decoded(content: bytes) -> tuple[str | None, str]:
    for encoding in ("utf-8-sig" if content.startswith(codecs.BOM_UTF8) else "utf-8", "cp932"):
        try:
            return content.decode(encoding), encoding
        except UnicodeDecodeError:
            continue
    return "\0", ""  # not a text


def joined(folder: str, name: str) -> str:
    """Return the path of a name in a folder.

    Raises:
        InvalidValue: If the name is empty or too long.
    """
    name = name.strip()
    if not name or len(name) > _LONGEST_NAME:
        raise InvalidValue(tr("the name must have 1 to {most} characters", most=_LONGEST_NAME))
    return f"{folder}{SEPARATOR}{name}" if folder else name


def parent_of(path: str) -> str:
    """Return the folder of a path; ``""`` for the root folder."""
    return path.rpartition(SEPARATOR)[0]


def task_of(path: str) -> str:
    """Return the name of the task of a program; ``""`` if the file is not a program."""
    return path[: -len(PROGRAM)] if path.lower().endswith(PROGRAM) else ""


async def entries(controller: AsyncController, folder: str) -> list[Entry]:
    """Return the contents of a folder, folders first.

    Raises:
        OrinError: If the controller refuses, or does not reply.
    """
    if folder:
        async with await controller.file(folder + SEPARATOR) as opened:
            names = await opened.file_names()
    else:
        names = await controller.file_names()
    found = []
    for name in names:
        bare = name.rstrip("\\/")
        if bare:
            found.append(Entry(bare, joined(folder, bare), bare != name))
    return sorted(found, key=lambda entry: (not entry.is_folder, entry.name.casefold()))


async def read_text(controller: AsyncController, path: str) -> TextFile:
    """Read a file to edit it.

    Raises:
        InvalidValue: If the file is not text, or too long.
        OrinError: If the controller refuses, or does not reply.
    """
    async with await controller.file(path) as file:
        return text_file(path, await file.get_value())


async def read_data(controller: AsyncController, path: str) -> bytes:
    """Return the bytes of a file; raises the errors of :func:`read_text`."""
    async with await controller.file(path) as file:
        return await file.get_data()


async def write(controller: AsyncController, path: str, content: str | bytes) -> None:
    """Write a file; if it does not exist, it is created.

    Raises:
        OrinError: If the controller refuses, or does not reply.
    """
    async with await controller.file(path) as file:
        await file.put_value(content)


async def create(controller: AsyncController, path: str, content: str | bytes = "", *, folder: bool = False) -> None:
    """Create a file or folder.

    Raises:
        InvalidValue: If the name exists.
        OrinError: If the controller refuses, or does not reply.
    """
    async with await controller.file(path) as existing:
        if await existing.get_exists():
            raise InvalidValue(tr("{path} exists. Try: another name", path=path))
    if folder:
        async with await controller.file(path + SEPARATOR, create=True):
            return
    async with await controller.file(path, create=True) as file:
        if content:
            await file.put_value(content)


async def details(file: AsyncFile) -> str:
    """Return size and time of the last change as text; ``""`` if the controller does not report them."""
    try:
        size, modified = await file.get_size(), await file.get_date_last_modified()
    except OrinError:
        return ""
    return tr("{size} bytes, changed {time}", size=size, time=f"{modified}"[:19])
