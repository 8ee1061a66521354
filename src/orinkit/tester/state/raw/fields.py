"""The parameters of Raw Packet Mode as form fields: :class:`RawFields` (RC8 table 5-2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Self

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.raw.options import DEFAULT_CLIENTS, DEFAULT_TIMEOUT, LOOPBACK, OPTIONS, RawOptions, Role, place_text
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.transport.address import DEFAULT_PORT, Address, HttpAddress, is_loopback, parse_address

ROLES: Final[Mapping[Role, str]] = MappingProxyType(
    {
        Role.TCP_CLIENT: N_("TCP client"),
        Role.TCP_SERVER: N_("TCP server"),
        Role.UDP_CLIENT: N_("UDP client"),
        Role.UDP_SERVER: N_("UDP server"),
        Role.SERIAL: N_("Serial line"),
    }
)
"""The roles, with their names for users, in English."""

SERVER_PORT: Final = 5008
"""The port that the form proposes for the server roles; the default port of b-CAP may belong to a controller."""
_SERIAL_PLACE: Final = "/dev/ttyUSB0:38400:N:8:1:0"
_SEPARATORS: Final = ',"'
_ROWS: Final = {row.name: row for row in OPTIONS}


@dataclass(frozen=True, slots=True)
class RawFields:
    """The form fields; ``str`` returns the parameter string, even if a field is invalid.

    Attributes:
        role: The role: EtherOpt, or the serial line.
        place: The address: ``HOST:PORT``; for a serial line ``PORT:38400:N:8:1:0`` or ``serial://PATH``.
        timeout: Time-out, ms.
        packet_opt: PacketOpt.
        clients: Maximum number of clients of a TCP server.
        sync: True to wait for the reply to each packet.
    """

    role: Role = Role.TCP_CLIENT
    place: str = f"{LOOPBACK}:{DEFAULT_PORT}"
    timeout: str = f"{DEFAULT_TIMEOUT * 1000:.0f}"
    packet_opt: str = "0:0:0"
    clients: str = f"{DEFAULT_CLIENTS}"
    sync: bool = True

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the fields of a parameter string, or of an address.

        Raises:
            InvalidValue, InvalidAddress: If it is invalid.
        """
        options = RawOptions.parse(text)
        place = place_text(options.address).removeprefix("eth:").removeprefix("com:")
        milliseconds = f"{round(options.timeout * 1000)}"
        return cls(options.role, place, milliseconds, clients=f"{options.clients}", sync=options.sync)

    def __str__(self) -> str:
        values = [f"Conn={self._conn()}", f"Timeout={self.timeout.strip()}", f"PacketOpt={self.packet_opt.strip()}"]
        if self.role is not Role.SERIAL:
            clients = self.clients.strip() if self.role is Role.TCP_SERVER else "0"
            values.append(f"EtherOpt={self.role:d}:{clients}")
        return ", ".join([*values, f"Sync={self.sync}"])

    def _conn(self) -> str:
        place = self.place.strip()
        if self.role is not Role.SERIAL:
            return f"eth:{place}"
        return f'"{place}"' if place.startswith("serial:") else f"com:{place}"

    def problems(self) -> dict[str, str]:
        """Return the messages of the invalid fields, by the names of their attributes."""
        found = {"place": self._place_problem()}
        for name, option, value in (
            ("timeout", "Timeout", self.timeout),
            ("packet_opt", "PacketOpt", self.packet_opt),
            ("clients", "EtherOpt", f"1:{self.clients}" if self.role is Role.TCP_SERVER else "1:0"),
        ):
            try:
                _ROWS[option].parse(value)
            except InvalidValue as error:
                found[name] = f"{error}"
        return {name: text for name, text in found.items() if text}

    def _place_problem(self) -> str:
        if any(each in self.place for each in _SEPARATORS):
            return tr("an address contains neither commas nor quotation marks")
        only = replace(RawFields(), role=self.role, place=self.place)
        try:
            checked_options(f"{only}")
        except (InvalidValue, InvalidAddress) as error:
            return f"{error}"
        return ""


def checked_options(text: str) -> RawOptions:
    """Return the parameters of a string; unlike :meth:`RawOptions.parse`, a server may listen on this machine only.

    Raises:
        InvalidValue, InvalidAddress: If it is invalid.
    """
    options = RawOptions.parse(text)
    address = options.address
    if options.role.serves and isinstance(address, Address) and not is_loopback(address.host):
        raise InvalidValue(
            tr(
                "a server of this page accepts clients of this computer only, and {host} is not a loopback address. "
                "Try: {loopback}, or orinkit raw",
                host=address.host,
                loopback=LOOPBACK,
            )
        )
    return options


def initial_fields(spec: ConnectionSpec | None) -> RawFields:
    """Return the fields for the address of a connection; the default if there is none, or it is not a controller."""
    if spec is None or spec.is_can:
        return RawFields()
    address = parse_address(spec.url)
    place = f"tcp://{address.host}" if isinstance(address, HttpAddress) else spec.url
    if isinstance(address, HttpAddress) and ":" in address.host:
        place = f"tcp://[{address.host}]"
    fields = RawFields.parse(place)
    return replace(fields, timeout=f"{spec.timeout}") if spec.timeout else fields


def proposed_place(role: Role, spec: ConnectionSpec | None) -> str:
    """Return the address that the form proposes for a role."""
    if role.serves:
        return f"{LOOPBACK}:{SERVER_PORT}"
    initial = initial_fields(spec)
    if (initial.role is Role.SERIAL) == (role is Role.SERIAL):
        return initial.place
    return _SERIAL_PLACE if role is Role.SERIAL else RawFields().place
