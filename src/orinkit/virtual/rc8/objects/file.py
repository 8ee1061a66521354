r"""The File objects that clients hold: one file or folder of the controller, by its name from the root folder.

Everything that takes a name takes one from the root folder (``dir\Pro1.pcs``), only :meth:`RC8File.get_file` takes one
from the folder it is called on. What an object answers is what is there at that moment; where nothing is there any
more, it answers FILE_NOT_FOUND.
"""

from __future__ import annotations

import codecs
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Final, TypeAlias

from orinkit.cao.options import Options
from orinkit.cao.provider import BlockingCall, FileObject, VariableObject, not_found, not_implemented
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.types import UI1_ARRAY, VarType, type_name
from orinkit.values.variant import Value, Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.files import PROGRAM, FileStore
from orinkit.virtual.rc8.files.names import SEPARATOR, extension, join, read_name
from orinkit.virtual.rc8.files.store import Staged

Run: TypeAlias = Callable[[ClientContext, str, str], str | BlockingCall]
"""Starts a program for a client: the client, the file's name from the root folder, the option; gives the task's name."""

_TEXTS: Final = frozenset(("pcs", "pac", "h", "txt", "csv", "ini", "log", "xml", "json"))
_NOT_SHIFT_JIS: Final = frozenset("\x80\xa0\uf8f0\uf8f1\uf8f2\uf8f3")  # what Python makes of bytes that have no meaning
_FOLDER_TYPE: Final = "folder"
_FOLDER_BIT: Final = 16
_LARGE: Final = 64 * 1024  # bytes or characters, from which on a content is read and written in a thread
_SLICE: Final = 64 * 1024
_LARGEST_SIZE: Final = 2**31 - 1  # of VT_I4, for a file that the store did not write


def find_file(caller: ClientContext, store: FileStore, name: str, option: str, run: Run | None = None) -> RC8File:
    r"""Return the file or folder of that name; ``""``, ``"\"`` and ``"/"`` are the root folder.

    Args:
        caller: the client.
        store: the controller's files.
        name: its name from the root folder; one that ends in a separator is that of a folder.
        option: with ``@Create=1`` (or ``true``, ``on``, ``yes``, or the name alone) what is not there is created: an
            empty file, or a folder where the name ends in a separator, and the folders that it is in. Others are passed
            over.
        run: starts programs; without it, File_Run is E_NOTIMPL.

    Raises:
        CallError: NO_READ_RIGHT, NO_WRITE_RIGHT; E_INVALIDARG, the name; FILE_NOT_FOUND; what
            :meth:`~orinkit.virtual.rc8.files.FileStore.create` and
            :meth:`~orinkit.virtual.rc8.files.FileStore.make_folder` refuse.
    """
    caller.require_read()
    if not store.exists(name):
        wanted = read_name(name)
        if not Options(option).flag("@Create"):
            raise error_for(
                hresult.FILE_NOT_FOUND,
                tr("{path}; the option @Create=1 creates it", path=wanted),
            )
        caller.require_write()
        for depth in range(1, len(wanted.parts)):
            folder = join((*wanted.parts[:depth], ""))
            if not store.exists(folder):
                store.make_folder(folder)
        if wanted.folder:
            store.make_folder(name)
        else:
            store.create(name)
    return RC8File(caller, store, store.path(name), run)


class RC8File(FileObject):
    """A file or folder.

    Its name is the last part of its path. Its attribute has bit 1 (readable) and bit 2 (writable) as this client's
    permission has them, and bit 16 for a folder.

    Args:
        caller: the client.
        store: the controller's files.
        path: its name from the root folder, as the store tells it.
        run: starts programs.
    """

    def __init__(self, caller: ClientContext, store: FileStore, path: str, run: Run | None = None) -> None:
        super().__init__(_last_part(path))
        self._caller = caller
        self._store = store
        self._path = path
        self._start = run

    def get_attribute(self) -> int:
        """1 readable, 2 writable, 16 folder."""
        return int(self._caller.access) | (_FOLDER_BIT if self._is_folder() else 0)

    def get_help(self) -> str:
        """What it is, in the controller's language."""
        say = self._caller.state.say
        if self._is_folder():
            return say("{path}: folder", path=self._path)
        if extension(self._path) == PROGRAM:
            return say("{path}: program", path=self._path)
        return say("{path}: file", path=self._path)

    # --- below it -------------------------------------------------------------------------------------------------

    def get_file(self, name: str, option: str) -> RC8File:
        """Connect to a file below this folder, by its name from here; the option is that of :func:`find_file`.

        Raises:
            CallError: as :func:`find_file`; FILE_NOT_FOUND, this is no folder.
        """
        if not self._is_folder():
            raise error_for(hresult.FILE_NOT_FOUND, tr("{path} is no folder", path=self._path))
        whole = f"{self._path}{SEPARATOR}{name}" if read_name(self._path).parts else name
        return find_file(self._caller, self._store, whole, option, self._start)

    def get_file_names(self, option: str) -> Sequence[str]:  # noqa: ARG002 - has none
        r"""Names of what is in this folder, sorted; those of folders end in ``\``. A file has none."""
        return self._store.names(self._path) if self._is_folder() else []

    def get_variable(self, name: str, option: str) -> VariableObject:  # noqa: ARG002
        """A file has no variables.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND.
        """
        raise not_found(name)

    def execute(self, command: str, parameter: Variant) -> Value:  # noqa: ARG002
        """A file has no commands.

        Raises:
            CallError: E_INVALID_CMD_NAME.
        """
        raise error_for(hresult.E_INVALID_CMD_NAME, command)

    # --- what happens to it ---------------------------------------------------------------------------------------

    def copy(self, name: str, option: str) -> BlockingCall | None:  # noqa: ARG002
        """Copy the file to a name that is free; into a folder, if the name ends in a separator.

        Raises:
            CallError: NO_WRITE_RIGHT; what :meth:`~orinkit.virtual.rc8.files.FileStore.copy` refuses.
        """
        self._caller.require_read()
        self._caller.require_write()
        path, target = self._path, self._target(name)
        if self._store.size(path) < _LARGE:
            self._store.copy(path, target)
            return None

        def copy() -> None:
            staged = self._store.stage(path, self._store.read(path))
            with self._caller.state.cycles:
                self._store.copy(path, target, staged)

        return BlockingCall(copy)

    def delete(self, option: str) -> None:
        """Delete it; a folder that is not empty only with the option ``@Recursive=1``.

        Raises:
            CallError: NO_WRITE_RIGHT; what :meth:`~orinkit.virtual.rc8.files.FileStore.delete` refuses.
        """
        self._caller.require_write()
        self._store.delete(self._path, recursive=Options(option).flag("@Recursive"))

    def move(self, name: str, option: str) -> None:  # noqa: ARG002
        """Move or rename it to a name that is free; into a folder, if the name ends in a separator.

        The object is then that of the new name.

        Raises:
            CallError: NO_WRITE_RIGHT; what :meth:`~orinkit.virtual.rc8.files.FileStore.move` refuses.
        """
        self._caller.require_write()
        target = self._target(name)
        self._store.move(self._path, target)
        self._path = self._store.path(target)
        self.name = _last_part(self._path)

    def run(self, option: str) -> str | BlockingCall:
        """Run the program; the name of its task is returned.

        Raises:
            CallError: NO_WRITE_RIGHT; FILE_NOT_FOUND; E_INVALIDARG, no program (``*.pcs``); E_NOTIMPL; what the start
                refuses.
        """
        self._caller.require_write()
        if self._is_folder() or extension(self._path) != PROGRAM:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("{path} is no program; programs end in .{extension}", path=self._path, extension=PROGRAM),
            )
        if self._start is None:
            raise not_implemented()
        return self._start(self._caller, self._path, option)

    # --- what it is -----------------------------------------------------------------------------------------------

    def get_date_created(self) -> Value:
        """When it was created, ``yyyy-mm-dd HH:MM:SS``."""
        self._caller.require_read()
        return _written(self._store.dates(self._path).created)

    def get_date_last_accessed(self) -> Value:
        """When it was read or written last, ``yyyy-mm-dd HH:MM:SS``."""
        self._caller.require_read()
        return _written(self._store.dates(self._path).accessed)

    def get_date_last_modified(self) -> Value:
        """When it was written last, ``yyyy-mm-dd HH:MM:SS``."""
        self._caller.require_read()
        return _written(self._store.dates(self._path).modified)

    def get_path(self) -> str:
        r"""Its name from the root folder, ``dir\Pro1.pcs``, as Controller_GetFile takes it; the root is ``\``."""
        self._caller.require_read()
        return self._store.path(self._path)

    def get_size(self) -> int:
        """Bytes of the file; 0 for a folder."""
        self._caller.require_read()
        return min(self._store.size(self._path), _LARGEST_SIZE)

    def get_type(self) -> str:
        """The extension in lower case, ``pcs``, ``""`` where it has none; ``folder`` for a folder."""
        return _FOLDER_TYPE if self._is_folder() else extension(self._path)

    def get_value(self) -> Value | BlockingCall:
        """The content.

        Text is VT_BSTR: read as UTF-8, with or without a byte order mark, which is left out. A file whose extension says
        that it is text (``.pcs .pac .h .txt .csv .ini .log .xml .json``) may also be in Shift_JIS (code page 932); any
        other file is text if it is UTF-8 without NUL. What is no text is an array of VT_UI1.

        Raises:
            CallError: NO_READ_RIGHT; FILE_NOT_FOUND; E_ACCESSDENIED, a folder; E_TOO_MUCH_DATA; E_FAIL.
        """
        self._caller.require_read()
        path = self._path

        def read() -> Variant:
            return _content(self._store.read(path), text=extension(path) in _TEXTS)

        return read() if self._store.size(path) < _LARGE else BlockingCall(read)

    def put_value(self, value: Variant) -> BlockingCall | None:
        """Set the content: text, which is kept as UTF-8, or an array of VT_UI1; VT_EMPTY empties the file.

        Raises:
            CallError: NO_WRITE_RIGHT; DISP_E_TYPEMISMATCH; FILE_NOT_FOUND; E_INVALIDARG, text that is no Unicode; what
                :meth:`~orinkit.virtual.rc8.files.FileStore.write` refuses.
        """
        self._caller.require_write()
        path = self._path
        _check_content(value)
        if value.type == VarType.EMPTY or len(value.value) < _LARGE:
            self._write(path, _data(value))
            return None

        def write() -> None:
            staged = self._store.stage(path, _data(value))
            with self._caller.state.cycles:
                self._write(path, staged)

        return BlockingCall(write)

    def _write(self, path: str, data: bytes | Staged) -> None:
        if not self._store.exists(path):
            if isinstance(data, Staged):
                data.discard()
            raise error_for(hresult.FILE_NOT_FOUND, path)
        self._store.write(path, data)

    def _is_folder(self) -> bool:
        self._caller.require_read()
        self._store.path(self._path)  # is there anything
        return self._store.is_folder(self._path)

    def _target(self, name: str) -> str:
        target = read_name(name)
        if not name:
            raise error_for(hresult.E_INVALIDARG, tr("the new name is empty"))
        return join((*target.parts, self.name)) if target.folder else name


def _last_part(path: str) -> str:
    return path.rpartition(SEPARATOR)[2] or SEPARATOR


def _written(moment: datetime) -> str:
    return moment.isoformat(" ", "seconds")


def _content(data: bytes, *, text: bool) -> Variant:
    for encoding in ("utf-8-sig", "cp932") if text else ("utf-8-sig",):
        try:
            decoded = _decoded(data, encoding, _NOT_SHIFT_JIS if encoding == "cp932" else frozenset())
        except UnicodeDecodeError:
            continue
        if text or "\0" not in decoded:
            return Variant(VarType.BSTR, decoded)
    return Variant(UI1_ARRAY, data)


def _decoded(data: bytes, encoding: str, wrong: frozenset[str]) -> str:
    """Decode in slices: Python runs no other thread while a codec works.

    Raises:
        UnicodeDecodeError: it is not that encoding, or there are characters that are wrong.
    """
    decoder = codecs.getincrementaldecoder(encoding)()
    parts = []
    for at in range(0, len(data), _SLICE):
        part = decoder.decode(data[at : at + _SLICE])
        if not wrong.isdisjoint(part):
            raise UnicodeDecodeError(encoding, data[at : at + 1], 0, 1, "bytes without a meaning")
        parts.append(part)
    parts.append(decoder.decode(b"", final=True))
    return "".join(parts)


def _data(value: Variant) -> bytes:
    """Return the content that a client has sent, encoded in slices like :func:`_decoded`.

    Raises:
        CallError: E_INVALIDARG, the text has lone surrogates.
    """
    if value.type == VarType.EMPTY:
        return b""
    slices = (value.value[at : at + _SLICE] for at in range(0, len(value.value), _SLICE))
    if value.type == UI1_ARRAY:
        return b"".join(map(bytes, slices))
    try:
        return b"".join(part.encode("utf-8") for part in slices)
    except UnicodeEncodeError:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("the text has a lone surrogate, which is no character"),
        ) from None


def _check_content(value: Variant) -> None:
    if value.type in (VarType.BSTR, UI1_ARRAY, VarType.EMPTY):
        return
    raise error_for(
        hresult.DISP_E_TYPEMISMATCH,
        tr(
            "{given} was given, text (VT_BSTR) or bytes ({bytes}) are wanted",
            given=type_name(value.type),
            bytes=type_name(UI1_ARRAY),
        ),
    )
