"""The parameter string of Raw Packet Mode (RC8 table 5-2).

>>> options = RawOptions.parse("Conn=eth:192.168.0.1:5007, Timeout=300, PacketOpt=0:0:0, EtherOpt=0:0, Sync=True")
>>> options.role.name, str(options.address), options.timeout
('TCP_CLIENT', 'tcp://192.168.0.1:5007', 0.3)
>>> str(RawOptions.parse("udp://192.168.0.1"))
'Conn=eth:192.168.0.1:5007, Timeout=500, PacketOpt=0:0:0, EtherOpt=2:0, Sync=True'

Instead of the parameter string, :meth:`RawOptions.parse` accepts an address of orinkit. The addresses of both forms
have the same settings.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, NamedTuple, TypeAlias

from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM, BcapProfile
from orinkit.cao.options import Options
from orinkit.cao.table import LONGEST_OPTION
from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.core.validation import check_amount
from orinkit.transport.address import Address, parse_address, whole_number
from orinkit.transport.serial.address import SerialAddress

DEFAULT_TIMEOUT: Final = 0.5
"""The default time-out of table 5-2, s."""
LONGEST_TIMEOUT: Final = 3600.0
DEFAULT_CLIENTS: Final = 5
MOST_CLIENTS: Final = 100
LOOPBACK: Final = "127.0.0.1"

RawAddress: TypeAlias = Address | SerialAddress

_NAMED: Final = re.compile(r"\s*[A-Za-z]+\s*=")  # begins a parameter string; a URL begins with its scheme
_TRUTH: Final = {"true": True, "1": True, "-1": True, "false": False, "0": False}


class Role(IntEnum):
    """The roles: the modes of EtherOpt, and the client on a serial line."""

    TCP_CLIENT = 0
    TCP_SERVER = 1
    UDP_CLIENT = 2
    UDP_SERVER = 3
    SERIAL = 4

    @property
    def serves(self) -> bool:
        """True if the role waits for clients."""
        return self in (Role.TCP_SERVER, Role.UDP_SERVER)

    @property
    def profile(self) -> BcapProfile:
        """The properties of packets on the transport of this role."""
        return _PROFILES[self]


_PROFILES: Final = {
    Role.TCP_CLIENT: STREAM,
    Role.TCP_SERVER: STREAM,
    Role.UDP_CLIENT: DATAGRAM,
    Role.UDP_SERVER: DATAGRAM,
    Role.SERIAL: LINE,
}
_SCHEMES: Final = {"tcp": Role.TCP_CLIENT, "udp": Role.UDP_CLIENT, "serial": Role.SERIAL}


class PacketMode(NamedTuple):
    """A bit of the mode of PacketOpt, and why it does not apply to packets in hex."""

    value: int
    name: str
    reason: str


PACKET_MODES: Final = (
    PacketMode(1, "ISO", N_("it converts text to ISO code, and a packet in hex is not text")),
    PacketMode(2, "EIA", N_("it converts text to EIA code, and a packet in hex is not text")),
    PacketMode(4, "Unicode", N_("it converts text from Unicode, and a packet in hex is not text")),
    PacketMode(8, "text", N_("it sends lines of text, and a packet in hex is not text")),
    PacketMode(16, "RoboTalk", N_("RoboTalk is another protocol, with its own header and checksum")),
    PacketMode(32, "b-CAP", N_("it adds the frame of a b-CAP packet, and a packet in hex already contains its frame")),
)
HEADERS: Final = {0: "", 1: "ENQ"}
TERMINATORS: Final = {0: "CR", 1: "LF", 2: "CR+LF"}


class OptionRow(NamedTuple):
    """A row of table 5-2.

    Attributes:
        name: Name of the parameter.
        form: Notation of its value.
        default: Default value; ``""`` if the parameter is required.
        meaning: Meaning, in English; :func:`~orinkit.core.i18n.tr` translates it.
        parse: Function that parses the value to the fields of :class:`RawOptions`.
    """

    name: str
    form: str
    default: str
    meaning: str
    parse: Callable[[str], dict[str, Any]]


@dataclass(frozen=True, slots=True)
class RawOptions:
    """The parameters of a raw link; ``str`` returns the parameter string.

    Attributes:
        address: Address of the controller, or for the server roles the address to listen on.
        role: Role of this side.
        timeout: Time-out for opening the link and for a reply, s.
        clients: Maximum number of clients of a TCP server.
        sync: True to wait for the reply to each packet.
    """

    address: RawAddress
    role: Role = Role.TCP_CLIENT
    timeout: float = DEFAULT_TIMEOUT
    clients: int = DEFAULT_CLIENTS
    sync: bool = True

    def __post_init__(self) -> None:
        check_amount("Timeout", self.timeout, LONGEST_TIMEOUT)

    @classmethod
    def parse(cls, text: str) -> RawOptions:
        """Parse a parameter string, or an address: ``tcp://``, ``udp://``, ``serial://``.

        Raises:
            InvalidValue: If the parameter string is invalid, or contains a mode that does not apply to packets in hex.
            InvalidAddress: If the address is invalid, or belongs to a transport without b-CAP packets.
        """
        if not _NAMED.match(text):
            address = _usable(text)
            return cls(address, _SCHEMES[address.scheme])
        return _parse_table(text)

    def __str__(self) -> str:
        values = [
            f"Conn={_quoted(place_text(self.address))}",
            f"Timeout={round(self.timeout * 1000)}",
            "PacketOpt=0:0:0",
        ]
        if self.role is not Role.SERIAL:
            values.append(f"EtherOpt={self.role:d}:{self.clients if self.role is Role.TCP_SERVER else 0}")
        return ", ".join([*values, f"Sync={self.sync}"])


def _parse_table(text: str) -> RawOptions:
    if len(text) > LONGEST_OPTION:
        raise InvalidValue(tr("the parameters must not exceed {most} characters", most=LONGEST_OPTION))
    given = Options(text)
    known = {row.name.lower(): row for row in OPTIONS}
    for name in given.names:
        if name not in known or name in given.repeated:
            raise InvalidValue(_wrong_name(name, repeated=name in given.repeated))
    fields: dict[str, Any] = {}
    for row in OPTIONS:
        fields |= row.parse(given.text_of(row.name, row.default))
    place, ether = fields.pop("conn"), fields.pop("ether")
    if place.startswith("serial:"):
        if "etheropt" in given:
            raise InvalidValue(tr("EtherOpt does not apply to a serial line. Try: omit EtherOpt"))
        return RawOptions(_usable(place), Role.SERIAL, **fields)
    role, clients = ether
    return RawOptions(_network(place, role), role, clients=clients or DEFAULT_CLIENTS, **fields)


def _wrong_name(name: str, *, repeated: bool) -> str:
    if repeated:
        return tr("{name} is given twice", name=name)
    known = ", ".join(row.name for row in OPTIONS)
    return tr("unknown parameter {name!r:.80}; available: {known}", name=name, known=known)


# --- the parameters ---------------------------------------------------------------------------------------------------


def _parse_conn(value: str) -> dict[str, Any]:
    """Return ``serial:...`` for a serial line, and the text after ``eth:`` for a network."""
    kind, colon, rest = value.partition(":")
    kind = kind.strip().lower()
    if kind == "eth":
        return {"conn": f"eth:{rest.strip()}"}
    if kind == "com" and colon:
        return {"conn": str(parse_address(f"com:{rest.strip()}"))}
    if kind == "serial" and colon:
        return {"conn": value}
    reason = tr("Conn cannot be {value!r:.80}; expected: eth:ADDRESS:PORT, com:PORT or serial://PATH", value=value)
    raise InvalidValue(reason)


def _parse_timeout(value: str) -> dict[str, Any]:
    number = whole_number(value)
    if not 0 < number <= LONGEST_TIMEOUT * 1000:
        raise _bad_number("Timeout", value, f"1-{LONGEST_TIMEOUT * 1000:.0f} ms")
    return {"timeout": number / 1000}


def _parse_packet(value: str) -> dict[str, Any]:
    mode, header, terminator = _numbers("PacketOpt", value, (63, 1, 2))
    for each in PACKET_MODES:
        if mode & each.value:
            raise InvalidValue(
                tr(
                    "PacketOpt: the mode {name} ({value}) does not apply here: {reason}. Try: PacketOpt=0:0:0",
                    name=each.name,
                    value=each.value,
                    reason=tr(each.reason),
                )
            )
    if header or terminator:
        name = HEADERS[header] or TERMINATORS[terminator]
        raise InvalidValue(
            tr(
                "PacketOpt: {name} does not apply here: a b-CAP packet begins with SOH and ends with EOT. Try: "
                "PacketOpt=0:0:0",
                name=name,
            )
        )
    return {}


def _parse_ether(value: str) -> dict[str, Any]:
    mode, clients = _numbers("EtherOpt", value, (Role.UDP_SERVER, MOST_CLIENTS))
    return {"ether": (Role(mode), clients)}


def _parse_sync(value: str) -> dict[str, Any]:
    sync = _TRUTH.get(value.strip().lower())
    if sync is None:
        raise _bad_number("Sync", value, "True, False")
    return {"sync": sync}


def _numbers(name: str, value: str, most: tuple[int, ...]) -> list[int]:
    """Return the numbers of a value such as ``0:0:0``; missing and empty numbers are 0."""
    parts = [part.strip() for part in value.split(":")]
    numbers = [whole_number(part) if part else 0 for part in parts]
    if len(parts) > len(most) or any(not 0 <= number <= limit for number, limit in zip(numbers, most, strict=False)):
        raise _bad_number(name, value, ":".join(f"0-{limit:d}" for limit in most))
    return numbers + [0] * (len(most) - len(numbers))


def _bad_number(name: str, value: str, known: str) -> InvalidValue:
    return InvalidValue(tr("{name} cannot be {value!r:.80}; expected: {known}", name=name, value=value, known=known))


OPTIONS: Final = (
    OptionRow(
        "Conn",
        "eth:[<IP>[:<port>]], com:<port>[:<baudrate>:<parity>:<bits>:<stop>:<flow>]",
        "",
        N_("Address of the controller; for the server modes, the address to listen on (127.0.0.1 if it is omitted)"),
        _parse_conn,
    ),
    OptionRow("Timeout", "<ms>", "500", N_("Time-out for connecting and for each reply, ms"), _parse_timeout),
    OptionRow(
        "PacketOpt",
        "[<Mode>[:<Header>[:<Term>]]]",
        "0:0:0",
        N_("Conversion of the data, header and terminator; 0:0:0 for packets in hex"),
        _parse_packet,
    ),
    OptionRow(
        "EtherOpt",
        "[<Mode>[:<ConnMax>]]",
        "0:0",
        N_("Mode 0 TCP client, 1 TCP server, 2 UDP client, 3 UDP server; ConnMax: clients of a TCP server (5)"),
        _parse_ether,
    ),
    OptionRow("Sync", "True, False", "True", N_("Wait for the reply to each packet"), _parse_sync),
)
"""Table 5-2."""


# --- addresses --------------------------------------------------------------------------------------------------------


def _network(place: str, role: Role) -> Address:
    """Return the address of a network role, from the text after ``Conn=``."""
    rest = place.removeprefix("eth:")
    host, colon, port = ("", ":", rest[1:]) if rest.startswith(":") else (rest, "", "")
    if not host:
        if not role.serves:
            raise InvalidValue(tr("Conn contains no address. Try: Conn=eth:192.168.0.1:5007"))
        host = LOOPBACK
    scheme = "udp" if role in (Role.UDP_CLIENT, Role.UDP_SERVER) else "tcp"
    found = _usable(f"{scheme}://{host}{colon if port else ''}{port}")
    assert isinstance(found, Address)
    return found


def _usable(text: str) -> RawAddress:
    """Parse an address.

    Raises:
        InvalidAddress: If the transport does not carry b-CAP packets.
    """
    address = parse_address(text)
    if isinstance(address, Address | SerialAddress) and address.scheme in _SCHEMES:
        return address
    raise InvalidAddress(
        tr(
            "{address!r:.200}: this transport does not carry b-CAP packets. Try: tcp://, udp:// or serial://",
            address=text,
        )
    )


def place_text(address: RawAddress) -> str:
    """Return an address as the value of ``Conn``: ``eth:127.0.0.1:5007``, ``com:/dev/ttyUSB0:38400:N:8:1:0``."""
    if isinstance(address, Address):
        return f"eth:{str(address).partition('://')[2]}"
    if ":" in address.path or "," in address.path:
        return str(address)
    return f"com:{address.path}:{address.baudrate}:{address.parity}:{address.bits}:{address.stop:g}:{address.flow}"


def _quoted(place: str) -> str:
    return f'"{place}"' if place.startswith("serial:") else place
