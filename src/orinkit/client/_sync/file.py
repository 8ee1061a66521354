"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``file.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from typing import Any, Concatenate, ParamSpec, TypeVar

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.client._shared.common import (
    ObjectFunctions,
    check_content,
    file_data,
    file_option,
    file_text,
    is_file_not_found,
    parse_date,
    text_list,
)
from orinkit.client._shared.prepared import PreparedCommand
from orinkit.client._sync.client import Client
from orinkit.client._sync.objects import ObjectBase, ObjectContainer
from orinkit.core.errors import CallError
from orinkit.values.variant import Value

P = ParamSpec("P")
R = TypeVar("R")


class File(ObjectContainer):
    """A file or folder of a controller.

    The file need not exist. Setting its text or data creates the file and the folders in its path. Until then, all
    other methods except :meth:`get_exists` raise an exception.
    """

    __slots__ = ("_missing",)

    functions = ObjectFunctions(
        f.file_release, f.file_get_attribute, f.file_get_help, f.file_get_name,
        f.file_get_tag, f.file_put_tag, f.file_get_id, f.file_put_id,
        f.file_get_variable, f.file_get_variable_names, f.file_execute,
    )  # fmt: skip

    def __init__(self, client: Client, handle: int, label: str, parent: ObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._missing: tuple[ObjectContainer, Function[[int, str, str], int], str] | None = None

    def file(self, name: str, option: str = "", *, create: bool = False) -> File:
        """Connect to a file in this folder; with ``create``, create it if it does not exist."""
        return connect_file(self, f.file_get_file, name, option, create=create)

    def get_exists(self) -> bool:
        """Return True if the file exists."""
        if self._missing is not None:
            try:
                self._connect_missing(create=False)
            except CallError as error:
                if is_file_not_found(error):
                    return False
                raise
        return True

    def _call(self, function: Function[Concatenate[int, P], R], *args: P.args, **kwargs: P.kwargs) -> R:
        if self._missing is not None:
            self._connect_missing(create=function is f.file_put_value)
        return super()._call(function, *args, **kwargs)

    def _execute(self, command: PreparedCommand, parameter: Value) -> Any:
        if self._missing is not None:
            self._connect_missing(create=False)
        if command.handle != self.handle:  # prepared before the file existed
            command = self._prepare(command.command)
        return super()._execute(command, parameter)

    def _connect_missing(self, *, create: bool) -> None:
        """Connect to the file if it did not exist when this object was created; with ``create``, create the file."""
        self._require_open()
        if self._missing is None:
            return
        owner, function, option = self._missing
        try:
            handle = owner._call(function, self._label, file_option(option, create=create))
        except CallError as error:
            error.subject = self._label
            raise
        self.handle, self._missing = handle, None
        owner._adopt(self)

    def file_names(self, option: str = "") -> list[str]:
        """Return the names of the files in this folder."""
        return text_list(self._call(f.file_get_file_names, option))

    def copy(self, name: str, option: str = "") -> None:
        """Copy the file; ``name`` is the name of the copy."""
        self._call(f.file_copy, name, option)

    def delete(self, option: str = "") -> None:
        """Delete the file."""
        self._call(f.file_delete, option)

    def move(self, name: str, option: str = "") -> None:
        """Move or rename the file; ``name`` is its new name."""
        self._call(f.file_move, name, option)

    def run(self, option: str = "") -> str:
        """Run the program in the file for one cycle; return the name of its task."""
        return self._call(f.file_run, option)

    def get_date_created(self) -> Any:
        """Return the time of creation as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return parse_date(self._call(f.file_get_date_created))

    def get_date_last_accessed(self) -> Any:
        """Return the time of the last access as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return parse_date(self._call(f.file_get_date_last_accessed))

    def get_date_last_modified(self) -> Any:
        """Return the time of the last modification as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return parse_date(self._call(f.file_get_date_last_modified))

    def get_names(self) -> list[str]:
        """Return the names of the files in this folder."""
        return self.file_names()

    def get_text(self) -> str:
        """Return the content as text.

        Raises:
            InvalidValue: If the content is not text; :meth:`get_data` returns bytes.
        """
        return file_text(self.get_value())

    def put_text(self, text: str) -> None:
        """Set the content to text."""
        self.put_value(check_content(str, text))

    def get_data(self) -> bytes:
        """Return the content as bytes; a text from the controller is encoded as UTF-8."""
        return file_data(self.get_value())

    def put_data(self, data: bytes) -> None:
        """Set the content to bytes."""
        self.put_value(check_content(bytes, data))

    def get_path(self) -> str:
        """Return the path of the file on the controller."""
        return self._call(f.file_get_path)

    def get_size(self) -> int:
        """Return the size in bytes."""
        return self._call(f.file_get_size)

    def get_type(self) -> str:
        """Return the type of the file."""
        return self._call(f.file_get_type)

    def get_value(self) -> Any:
        """Return the content: text or bytes, as the controller sends it."""
        return self._call(f.file_get_value)

    def put_value(self, value: Value) -> None:
        """Set the content."""
        self._call(f.file_put_value, value)

    @property
    def exists(self) -> bool:
        """Return True if the file exists."""
        return self.get_exists()

    @property
    def date_created(self) -> Any:
        """Return the time of creation as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return self.get_date_created()

    @property
    def date_last_accessed(self) -> Any:
        """Return the time of the last access as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return self.get_date_last_accessed()

    @property
    def date_last_modified(self) -> Any:
        """Return the time of the last modification as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return self.get_date_last_modified()

    @property
    def names(self) -> list[str]:
        """Return the names of the files in this folder."""
        return self.get_names()

    @property
    def text(self) -> str:
        """Return the content as text.

        Raises:
            InvalidValue: If the content is not text; :meth:`get_data` returns bytes.
        """
        return self.get_text()

    @text.setter
    def text(self, new: str) -> None:
        self.put_text(new)

    @property
    def data(self) -> bytes:
        """Return the content as bytes; a text from the controller is encoded as UTF-8."""
        return self.get_data()

    @data.setter
    def data(self, new: bytes) -> None:
        self.put_data(new)

    @property
    def path(self) -> str:
        """Return the path of the file on the controller."""
        return self.get_path()

    @property
    def size(self) -> int:
        """Return the size in bytes."""
        return self.get_size()

    @property
    def type(self) -> str:
        """Return the type of the file."""
        return self.get_type()

    @property
    def value(self) -> Any:
        """Return the content: text or bytes, as the controller sends it."""
        return self.get_value()

    @value.setter
    def value(self, new: Value) -> None:
        self.put_value(new)


def connect_file(
    owner: ObjectContainer, function: Function[[int, str, str], int], name: str, option: str, *, create: bool
) -> File:
    """Connect to a file of a controller or folder.

    If the file does not exist and ``create`` is False, the returned object has no handle yet.

    Args:
        owner: The controller or the folder.
        function: Controller_GetFile or File_GetFile.
        name: Path of the file, relative to ``owner``.
        option: Option string of the function.
        create: Create the file now if it does not exist.

    Raises:
        CallError: If the controller refuses the call.
    """
    try:
        return owner._child(File, function, name, file_option(option, create=create))
    except CallError as error:
        if create or not is_file_not_found(error):
            raise
    file = File(owner.client, 0, name, owner)
    file._missing = (owner, function, option)
    return file
