"""The variables of files: a table of names, types and sources (provider guide 5.3.4)."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from orinkit.cao.provider import Deferred, VariableObject, not_found
from orinkit.core.i18n import N_
from orinkit.values.variant import Value, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext

_SYSTEM_PREFIX: Final = "@"

Read: TypeAlias = Callable[[], bytes]
"""Returns the content of the file; accesses the disk."""


def _crc(data: bytes) -> int:
    """Return the CRC32 of the content as VT_I4."""
    crc = zlib.crc32(data)
    return crc - (crc >> 31 << 32)


FILE_VARIABLES: Final[dict[str, tuple[Callable[[bytes], Any], str]]] = {"@CRC": (_crc, N_("CRC32 of the content"))}
"""The value, calculated from the content, and the description of each variable, by name."""


class FileVariable(VariableObject):
    """A variable of a file, for one client; read-only."""

    def __init__(self, caller: ClientContext, name: str, key: str, read: Read) -> None:
        self._value, text = FILE_VARIABLES[key]
        super().__init__(name, attribute=1, help=caller.state.say(text))
        self._caller = caller
        self._read = read

    def get_value(self) -> Value | Deferred[Value]:
        """Return the current value."""
        self._caller.require_read()
        return self._caller.state.disk.run(lambda: Variant(VarType.I4, self._value(self._read())))


def find_file_variable(caller: ClientContext, name: str, read: Read) -> FileVariable:
    """Return a variable of a file by its name; case-insensitive. The guide's example omits the ``@``.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND.
    """
    key = _SYSTEM_PREFIX + name.strip().upper().removeprefix(_SYSTEM_PREFIX)
    if key not in FILE_VARIABLES:
        raise not_found(name)
    return FileVariable(caller, name, key, read)
