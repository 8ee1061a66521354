r"""File objects: a file or folder of the controller, identified by its path from the root folder.

All names are paths from the root folder (``dir\Pro1.pcs``). Only the name passed to :meth:`RC8File.get_file` is
relative to the folder of the object. An object reports the current state of the file; if the file no longer exists, the
methods of the object raise FILE_NOT_FOUND.

The disk is accessed in a thread, one call at a time, because a folder may have thousands of entries and a file may have
megabytes. The methods therefore return a Deferred, unless the clock is manual.
"""

from __future__ import annotations

import codecs
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import wraps
from typing import Concatenate, Final, ParamSpec, TypeAlias, TypeVar

from orinkit.cao.options import Options
from orinkit.cao.provider import Deferred, FileObject, VariableObject, not_implemented
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.types import UI1_ARRAY, VarType, type_name
from orinkit.values.variant import Value, Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.files import PROGRAM, FileStore
from orinkit.virtual.rc8.files.errors import taken
from orinkit.virtual.rc8.files.names import SEPARATOR, FileName, extension, join, read_name
from orinkit.virtual.rc8.objects.file_variables import FILE_VARIABLES, find_file_variable

P = ParamSpec("P")
T = TypeVar("T")

Run: TypeAlias = Callable[[ClientContext, str, str], str | Deferred[str]]
"""Function that starts a program and returns the task name.

The arguments are the client, the path, which may not be that of a program, and the option.
"""

_TEXTS: Final = frozenset(("pcs", "pac", "pns", "h", "txt", "csv", "ini", "log", "xml", "json"))
# The characters to which Python decodes bytes that are undefined in Shift_JIS.
_NOT_SHIFT_JIS: Final = frozenset("\x80\xa0\uf8f0\uf8f1\uf8f2\uf8f3")
_FOLDER_TYPE: Final = "folder"
_FOLDER_BIT: Final = 16
_SLICE: Final = 64 * 1024
_NEVER, _MUST_BE_NEW = 0, 2  # values of the option @Create
_LARGEST_SIZE: Final = 2**31 - 1  # limit of VT_I4; a file that another program has written may be larger


def on_disk(method: Callable[Concatenate[RC8File, P], T]) -> Callable[Concatenate[RC8File, P], T | Deferred[T]]:
    """Execute a method in the thread that accesses the disk."""

    @wraps(method)
    def in_thread(self: RC8File, /, *arguments: P.args, **named: P.kwargs) -> T | Deferred[T]:
        return self.caller.state.disk.run(lambda: method(self, *arguments, **named))

    return in_thread


def find_file(
    caller: ClientContext, store: FileStore, name: str, option: str, run: Run | None = None
) -> FileObject | Deferred[FileObject]:
    r"""Return a file or folder; ``""``, ``"\"`` and ``"/"`` are the root folder.

    Args:
        caller: The client.
        store: The files of the controller.
        name: Path from the root folder; a path that ends in a separator refers to a folder.
        option: With ``@Create=1`` (or ``true``, ``on``, ``yes``, or the name of the option alone), a missing file is
            created empty. If the name ends in a separator, a folder is created instead. Missing parent folders are
            created too. With ``@Create=2``, the file must not exist. Other options are ignored.
        run: Callback that starts programs; if it is None, File_Run raises E_NOTIMPL.

    Raises:
        CallError: NO_READ_RIGHT; NO_WRITE_RIGHT; E_INVALIDARG if the name is invalid; FILE_NOT_FOUND;
            E_CAO_COLLECTION_REGISTERED if the file exists and the option is ``@Create=2``; errors of
            :meth:`~orinkit.virtual.rc8.files.FileStore.create` and
            :meth:`~orinkit.virtual.rc8.files.FileStore.make_folder`.
    """
    return caller.state.disk.run(lambda: _find(caller, store, name, option, run))


def _find(caller: ClientContext, store: FileStore, name: str, option: str, run: Run | None) -> FileObject:
    caller.require_read()
    creation = _creation(option)
    if store.exists(name):
        if creation == _MUST_BE_NEW:
            raise taken(read_name(name))
        return RC8File(caller, store, store.full_name(name), run)
    wanted = read_name(name)
    if creation == _NEVER:
        if caller.state.switches.create_files and not wanted.folder:
            return RC8File(caller, store, join(wanted.parts), run)
        raise error_for(
            hresult.FILE_NOT_FOUND,
            tr("{path} does not exist. Try: the option @Create=1, which creates it", path=wanted),
        )
    caller.require_write()
    _make_parents(store, wanted)
    if wanted.folder:
        store.make_folder(name)
    else:
        store.create(name)
    return RC8File(caller, store, store.full_name(name), run)


def _creation(option: str) -> int:
    """Return the value of the option ``@Create``: 0 never, 1 if the file is missing, 2 the file must be new."""
    options = Options(option)
    return _MUST_BE_NEW if options.text_of("@Create").strip() == str(_MUST_BE_NEW) else int(options.flag("@Create"))


def _make_parents(store: FileStore, wanted: FileName) -> None:
    for depth in range(1, len(wanted.parts)):
        folder = join((*wanted.parts[:depth], ""))
        if not store.exists(folder):
            store.make_folder(folder)


class RC8File(FileObject):
    """A file or folder.

    The name of the object is the last part of its path. The attribute is the sum of 1 if the client may read,
    2 if the client may write, and 16 for a folder.

    Args:
        caller: The client.
        store: The files of the controller.
        path: Path from the root folder, as returned by the store.
        run: Callback that starts programs, or None.

    Attributes:
        caller: The client.
    """

    def __init__(self, caller: ClientContext, store: FileStore, path: str, run: Run | None = None) -> None:
        super().__init__(_last_part(path))
        self.caller = caller
        self._store = store
        self._path = path
        self._start = run

    def get_id(self) -> Value:
        """Return the ID that the client has set, by default the number of the file (``@LINE_NO``, GetCurErrorInfo)."""
        return Variant(VarType.I4, self._store.number(self._path)) if self.id == Variant(VarType.EMPTY) else self.id

    @on_disk
    def get_attribute(self) -> int:
        """Return the sum of 1 (readable), 2 (writable) and 16 (folder)."""
        return int(self.caller.access) | (_FOLDER_BIT if self._is_folder() else 0)

    @on_disk
    def get_help(self) -> str:
        """Return a description in the controller's language."""
        say = self.caller.state.say
        if self._is_folder():
            return say("{path}: folder", path=self._path)
        if extension(self._path) == PROGRAM:
            return say("{path}: program", path=self._path)
        return say("{path}: file", path=self._path)

    # --- contents of a folder -------------------------------------------------------------------------------------

    @on_disk
    def get_file(self, name: str, option: str) -> FileObject:
        """Connect to a file below this folder by its relative path; for the option see :func:`find_file`.

        Raises:
            CallError: FILE_NOT_FOUND if this is not a folder; errors of :func:`find_file`.
        """
        if not self._is_folder():
            raise error_for(hresult.FILE_NOT_FOUND, tr("{path} is not a folder", path=self._path))
        whole = f"{self._path}{SEPARATOR}{name}" if read_name(self._path).parts else name
        return _find(self.caller, self._store, whole, option, self._start)

    @on_disk
    def get_file_names(self, option: str) -> Sequence[str]:
        r"""Return the names in this folder, sorted; names of folders end in ``\``. For a file the list is empty."""
        return self._store.names(self._path) if self._is_folder() else []

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Connect to a variable of the file: ``@CRC``.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND.
        """
        return find_file_variable(self.caller, name, lambda: self._store.read(self._path))

    def get_variable_names(self, option: str) -> Sequence[str]:
        """Return the names of the variables of a file."""
        return list(FILE_VARIABLES)

    def execute(self, command: str, parameter: Variant) -> Value:
        """Raise an error: a file has no commands.

        Raises:
            CallError: E_INVALID_CMD_NAME.
        """
        raise error_for(hresult.E_INVALID_CMD_NAME, command)

    # --- operations -----------------------------------------------------------------------------------------------

    @on_disk
    def copy(self, name: str, option: str) -> None:
        """Copy the file to an unused name, or into a folder if the name ends in a separator.

        Raises:
            CallError: NO_WRITE_RIGHT; errors of :meth:`~orinkit.virtual.rc8.files.FileStore.copy`.
        """
        self.caller.require_read()
        self.caller.require_write()
        self._store.copy(self._path, self._target(name))

    @on_disk
    def delete(self, option: str) -> None:
        """Delete the file or folder; a non-empty folder requires the option ``@Recursive=1``.

        Raises:
            CallError: NO_WRITE_RIGHT; errors of :meth:`~orinkit.virtual.rc8.files.FileStore.delete`.
        """
        self.caller.require_write()
        self._store.delete(self._path, recursive=Options(option).flag("@Recursive"))

    @on_disk
    def move(self, name: str, option: str) -> None:
        """Move or rename the file to an unused name, or move it into a folder if the name ends in a separator.

        Afterwards the object refers to the new path.

        Raises:
            CallError: NO_WRITE_RIGHT; errors of :meth:`~orinkit.virtual.rc8.files.FileStore.move`.
        """
        self.caller.require_write()
        target = self._target(name)
        self._store.move(self._path, target)
        self._path = self._store.full_name(target)
        self.name = _last_part(self._path)

    def run(self, option: str) -> str | Deferred[str]:
        """Run the program and return the name of its task.

        Raises:
            CallError: NO_WRITE_RIGHT; FILE_NOT_FOUND; E_INVALIDARG if the file is not a program (``*.pcs``); E_NOTIMPL
                if programs cannot be started; errors of the start.
        """
        self.caller.require_write()
        return self._refuse_run() if self._start is None else self._start(self.caller, self._path, option)

    @on_disk
    def _refuse_run(self) -> str:
        require_program(self.caller, self._store, self._path)
        raise not_implemented()

    # --- properties -----------------------------------------------------------------------------------------------

    @on_disk
    def get_date_created(self) -> Value:
        """Return the time of creation, ``yyyy-mm-dd HH:MM:SS``."""
        self.caller.require_read()
        return _written(self._store.dates(self._path).created)

    @on_disk
    def get_date_last_accessed(self) -> Value:
        """Return the time of the last read or write, ``yyyy-mm-dd HH:MM:SS``."""
        self.caller.require_read()
        return _written(self._store.dates(self._path).accessed)

    @on_disk
    def get_date_last_modified(self) -> Value:
        """Return the time of the last write, ``yyyy-mm-dd HH:MM:SS``."""
        self.caller.require_read()
        return _written(self._store.dates(self._path).modified)

    @on_disk
    def get_path(self) -> str:
        r"""Return the path from the root folder, ``dir\Pro1.pcs``, as used by Controller_GetFile; the root is ``\``."""
        self.caller.require_read()
        return self._store.full_name(self._path)

    @on_disk
    def get_size(self) -> int:
        """Return the size of the file in bytes, 0 for a folder."""
        self.caller.require_read()
        return min(self._store.size(self._path), _LARGEST_SIZE)

    @on_disk
    def get_type(self) -> str:
        """Return the extension in lower case, ``pcs``; ``""`` if there is none; ``folder`` for a folder."""
        return _FOLDER_TYPE if self._is_folder() else extension(self._path)

    @on_disk
    def get_value(self) -> Value:
        """Return the content: text as VT_BSTR, other data as an array of VT_UI1.

        Text is decoded as UTF-8; a byte order mark is removed. A file with an extension of text files (``.pcs .pac .pns
        .h .txt .csv .ini .log .xml .json``) may also be encoded in Shift_JIS (code page 932); any other file is text if it
        is UTF-8 without NUL.

        Raises:
            CallError: NO_READ_RIGHT; FILE_NOT_FOUND; E_ACCESSDENIED if it is a folder; E_TOO_MUCH_DATA; E_FAIL.
        """
        self.caller.require_read()
        return _content(self._store.read(self._path), text=extension(self._path) in _TEXTS)

    @on_disk
    def put_value(self, value: Variant) -> None:
        """Set the content: text, which is stored as UTF-8, or an array of VT_UI1; VT_EMPTY empties the file.

        Raises:
            CallError: NO_WRITE_RIGHT; DISP_E_TYPEMISMATCH; FILE_NOT_FOUND; E_INVALIDARG if the text is not valid
                Unicode; errors of :meth:`~orinkit.virtual.rc8.files.FileStore.write`.
        """
        self.caller.require_write()
        _check_content(value)
        data = _data(value)
        if not self._store.exists(self._path):
            if not self.caller.state.switches.create_files:
                raise error_for(hresult.FILE_NOT_FOUND, self._path)
            _make_parents(self._store, read_name(self._path))
        self._store.write(self._path, data)

    def _is_folder(self) -> bool:
        self.caller.require_read()
        return _is_folder(self._store, self._path)

    def _target(self, name: str) -> str:
        target = read_name(name)
        if not name:
            raise error_for(hresult.E_INVALIDARG, tr("the new name is empty"))
        return join((*target.parts, self.name)) if target.folder else name


def require_program(caller: ClientContext, store: FileStore, path: str) -> None:
    """Check that a path is the path of a program; accesses the disk.

    Raises:
        CallError: NO_READ_RIGHT; FILE_NOT_FOUND; E_INVALIDARG if the file is not a program (``*.pcs``).
    """
    caller.require_read()
    if _is_folder(store, path) or extension(path) != PROGRAM:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("{path} is not a program: its extension is not .{extension}", path=path, extension=PROGRAM),
        )


def _is_folder(store: FileStore, path: str) -> bool:
    store.full_name(path)  # raises FILE_NOT_FOUND if the file no longer exists
    return store.is_folder(path)


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
    """Decode bytes in slices, so that other threads can run between two slices.

    A codec does not release the interpreter lock (GIL) while it decodes.

    Raises:
        UnicodeDecodeError: If the data is not in this encoding, or if the text contains a character in ``wrong``.
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
    """Return the content sent by a client as bytes; text is encoded in slices, like :func:`_decoded`.

    Raises:
        CallError: E_INVALIDARG if the text contains lone surrogates.
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
            tr("the text contains a lone surrogate, which is not a character"),
        ) from None


def _check_content(value: Variant) -> None:
    if value.type in (VarType.BSTR, UI1_ARRAY, VarType.EMPTY):
        return
    raise error_for(
        hresult.DISP_E_TYPEMISMATCH,
        tr(
            "expected text (VT_BSTR) or bytes ({bytes}), got {given}",
            given=type_name(value.type),
            bytes=type_name(UI1_ARRAY),
        ),
    )
