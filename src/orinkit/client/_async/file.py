"""Asynchronous files: files and folders of a controller.

The synchronous version is generated from this file; :mod:`orinkit.client._async.controller` describes how.
"""

from __future__ import annotations

from typing import Any, Concatenate, ParamSpec, TypeVar

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.client._async.client import AsyncClient
from orinkit.client._async.objects import AsyncObjectBase, AsyncObjectContainer
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
from orinkit.core.errors import CallError
from orinkit.values.variant import Value

P = ParamSpec("P")
R = TypeVar("R")


class AsyncFile(AsyncObjectContainer):
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

    def __init__(self, client: AsyncClient, handle: int, label: str, parent: AsyncObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._missing: tuple[AsyncObjectContainer, Function[[int, str, str], int], str] | None = None

    async def file(self, name: str, option: str = "", *, create: bool = False) -> AsyncFile:
        """Connect to a file in this folder; with ``create``, create it if it does not exist."""
        return await connect_file(self, f.file_get_file, name, option, create=create)

    async def get_exists(self) -> bool:
        """Return True if the file exists."""
        if self._missing is not None:
            try:
                await self._connect_missing(create=False)
            except CallError as error:
                if is_file_not_found(error):
                    return False
                raise
        return True

    async def _call(self, function: Function[Concatenate[int, P], R], *args: P.args, **kwargs: P.kwargs) -> R:
        if self._missing is not None:
            await self._connect_missing(create=function is f.file_put_value)
        return await super()._call(function, *args, **kwargs)

    async def _execute(self, command: PreparedCommand, parameter: Value) -> Any:
        if self._missing is not None:
            await self._connect_missing(create=False)
        if command.handle != self.handle:  # prepared before the file existed
            command = self._prepare(command.command)
        return await super()._execute(command, parameter)

    async def _connect_missing(self, *, create: bool) -> None:
        """Connect to the file if it did not exist when this object was created; with ``create``, create the file."""
        self._require_open()
        if self._missing is None:
            return
        owner, function, option = self._missing
        try:
            handle = await owner._call(function, self._label, file_option(option, create=create))
        except CallError as error:
            error.subject = self._label
            raise
        self.handle, self._missing = handle, None
        owner._adopt(self)

    async def file_names(self, option: str = "") -> list[str]:
        """Return the names of the files in this folder."""
        return text_list(await self._call(f.file_get_file_names, option))

    async def copy(self, name: str, option: str = "") -> None:
        """Copy the file; ``name`` is the name of the copy."""
        await self._call(f.file_copy, name, option)

    async def delete(self, option: str = "") -> None:
        """Delete the file."""
        await self._call(f.file_delete, option)

    async def move(self, name: str, option: str = "") -> None:
        """Move or rename the file; ``name`` is its new name."""
        await self._call(f.file_move, name, option)

    async def run(self, option: str = "") -> str:
        """Run the program in the file for one cycle; return the name of its task."""
        return await self._call(f.file_run, option)

    async def get_date_created(self) -> Any:
        """Return the time of creation as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return parse_date(await self._call(f.file_get_date_created))

    async def get_date_last_accessed(self) -> Any:
        """Return the time of the last access as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return parse_date(await self._call(f.file_get_date_last_accessed))

    async def get_date_last_modified(self) -> Any:
        """Return the time of the last modification as a ``datetime`` in the controller's local time.

        A value that is not a date is returned unchanged.
        """
        return parse_date(await self._call(f.file_get_date_last_modified))

    async def get_names(self) -> list[str]:
        """Return the names of the files in this folder."""
        return await self.file_names()

    async def get_text(self) -> str:
        """Return the content as text.

        Raises:
            InvalidValue: If the content is not text; :meth:`get_data` returns bytes.
        """
        return file_text(await self.get_value())

    async def put_text(self, text: str) -> None:
        """Set the content to text."""
        await self.put_value(check_content(str, text))

    async def get_data(self) -> bytes:
        """Return the content as bytes; a text from the controller is encoded as UTF-8."""
        return file_data(await self.get_value())

    async def put_data(self, data: bytes) -> None:
        """Set the content to bytes."""
        await self.put_value(check_content(bytes, data))

    async def get_path(self) -> str:
        """Return the path of the file on the controller."""
        return await self._call(f.file_get_path)

    async def get_size(self) -> int:
        """Return the size in bytes."""
        return await self._call(f.file_get_size)

    async def get_type(self) -> str:
        """Return the type of the file."""
        return await self._call(f.file_get_type)

    async def get_value(self) -> Any:
        """Return the content: text or bytes, as the controller sends it."""
        return await self._call(f.file_get_value)

    async def put_value(self, value: Value) -> None:
        """Set the content."""
        await self._call(f.file_put_value, value)


async def connect_file(
    owner: AsyncObjectContainer, function: Function[[int, str, str], int], name: str, option: str, *, create: bool
) -> AsyncFile:
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
        return await owner._child(AsyncFile, function, name, file_option(option, create=create))
    except CallError as error:
        if create or not is_file_not_found(error):
            raise
    file = AsyncFile(owner.client, 0, name, owner)
    file._missing = (owner, function, option)
    return file
