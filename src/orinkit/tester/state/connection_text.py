"""Connections as connection strings (RC8 table 5-1), and the earlier strings of a user."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from orinkit.cao.table import LONGEST_OPTION
from orinkit.cao.transport_profile import TransportProfile
from orinkit.client._shared.common import LOCALHOST
from orinkit.client._shared.connection_string import BY_NAME, OPTIONS, ConnectionString
from orinkit.core.errors import InvalidAddress
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.json_file import JsonFile
from orinkit.transport.address import parse_address
from orinkit.transport.registry import resolve, row_of

LONGEST_STRING: Final = LONGEST_OPTION
MAX_STRINGS: Final = 30
_SOCKETS: Final = ("tcp", "udp")
_MS: Final = 1000


def string_of(spec: ConnectionSpec) -> str:
    """Return the connection string with all options, also of invalid parameters; ``""`` without an address, or for CAN.

    If the specification has the default time-out, the string contains its value, because the default of connection
    strings (500 ms) differs from that of the transport.
    """
    scheme, _, rest = spec.url.partition("://")
    if not rest or scheme == "can":
        return ""
    values: dict[str, Any] = {
        "server": rest if scheme in _SOCKETS else spec.url,
        "udp": scheme == "udp",
        "timeout_ms": spec.timeout or _default_timeout(spec.url),
        "tries": spec.tries,
        "provider": spec.provider,
        "machine": spec.machine or LOCALHOST,
        "option": spec.option,
        "messages": spec.messages,
        "debug": spec.debug,
    }
    return ", ".join(option.write(values[option.parameter]) for option in OPTIONS)


def spec_of_string(text: str, base: ConnectionSpec) -> ConnectionSpec:
    """Return a specification with the parameters of a connection string; its other parameters are those of ``base``.

    Raises:
        InvalidAddress: If the string is invalid.
        InvalidValue: If a value is not possible in the Tester.
    """
    parsed = ConnectionString.parse(text)
    machine = "" if parsed.machine == LOCALHOST else parsed.machine
    found = replace(
        base, url=parsed.url, provider=parsed.provider, machine=machine, option=parsed.option,
        messages=parsed.messages, timeout=parsed.timeout_ms, tries=parsed.tries, debug=parsed.debug,
    )  # fmt: skip
    if found.renamed(found.name or "-").check().is_can:  # the table has no options for a CAN bus
        raise BY_NAME["server"].refusal(parsed.server)
    return found


def _default_timeout(url: str) -> int:
    """Return the default time-out of a transport in ms."""
    try:
        reference = row_of(parse_address(url)).profile
    except InvalidAddress:
        reference = ""
    profile: TransportProfile | None = resolve(reference) if reference else None
    return round((profile.timeout if profile else ConnectionString(server=LOCALHOST).timeout) * _MS)


class StringHistory:
    """The connection strings that a user has used, newest first, in a file.

    Args:
        path: Path of the file.
    """

    def __init__(self, path: Path) -> None:
        self._file = JsonFile(path)
        self._strings = self._file.read(_strings)

    def __iter__(self) -> Iterator[str]:
        return iter(list(self._strings))

    def add(self, text: str) -> None:
        """Put a string first; the oldest ones are discarded.

        Raises:
            OSError: If the file cannot be written.
        """
        if text and len(text) <= LONGEST_STRING and text not in self._strings[:1]:
            self._write([text, *(each for each in self._strings if each != text)][:MAX_STRINGS])

    def clear(self) -> None:
        """Forget all strings.

        Raises:
            OSError: If the file cannot be written.
        """
        self._write([])

    def _write(self, strings: list[str]) -> None:
        self._file.write(strings)
        self._strings = strings


def _strings(rows: Any) -> list[str]:
    if not isinstance(rows, list) or not all(isinstance(each, str) for each in rows):
        raise TypeError(type(rows).__name__)
    return [each for each in rows if len(each) <= LONGEST_STRING][:MAX_STRINGS]
