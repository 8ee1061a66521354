"""Where to connect or listen: ``tcp://192.168.0.1:5007``, ``udp://...``, ``serial:///dev/ttyUSB0``, ``http://...``.

DENSO's connection strings too: ``tcp:192.168.0.1:5007``, ``udp:192.168.0.1:5007``, ``com:1:38400:N:8:1:0``. For ABH3
drivers ``can://INTERFACE/CHANNEL``, as ``can://socketcan/can0``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, TypeAlias

from orinkit.core.errors import InvalidAddress
from orinkit.core.i18n import tr
from orinkit.transport import registry
from orinkit.transport.registry import AnyAddress, Given
from orinkit.values.pose_numbers import brief

DEFAULT_PORT: Final = 5007
"""The port of b-CAP (List 3-1)."""

_WEB: Final = {"http": 80, "https": 443}
_LONGEST: Final = 4000  # characters of a path
_BAUDRATES: Final = range(50, 20_000_001)
_STOPS: Final = {"1": 1.0, "1.0": 1.0, "1.5": 1.5, "2": 2.0, "2.0": 2.0}
_USUAL: Final = "tcp"
"""The scheme of an address that has none."""
_BITRATES: Final = range(1000, 1_000_001)  # of classic CAN
_TAKEN: Final = ("interface", "channel", "bustype", "context", "config_context", "ignore_config")
"""Names of python-can that cannot be options: the address says the first two, and reads no configuration files."""


class Address(NamedTuple):
    """A host and a port.

    Attributes:
        scheme: ``"tcp"`` or ``"udp"``.
        host: name or address; an IPv6 address without its brackets.
        port: 0 to 65535; 0 lets a server take a free one.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def is_loopback(host: str) -> bool:
    """Whether a host is this machine itself, as far as its name tells."""
    from ipaddress import ip_address  # few programs ask

    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def network_of(host: str) -> str:
    """Return what counts as one place of origin: an IPv4 address, a /64 network of IPv6, this machine, or any other name.

    Whoever has an IPv6 address usually has all of its /64 network, and a machine has all addresses of 127.0.0.0/8.
    """
    from ipaddress import IPv6Address, IPv6Network, ip_address

    try:
        address = ip_address(host)
    except ValueError:
        return host
    if isinstance(address, IPv6Address):
        if address.ipv4_mapped is not None:
            return network_of(str(address.ipv4_mapped))
        if not address.is_loopback:
            return str(IPv6Network((int(address) >> 64 << 64, 64)))
    return "127.0.0.1" if address.is_loopback else str(address)


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """A serial port and how it is set; ``str`` gives its URL.

    Attributes:
        path: as the system names it: ``/dev/ttyUSB0``, ``COM3``.
        baudrate: bits in a second.
        parity: ``"N"`` none, ``"E"`` even, ``"O"`` odd, ``"M"`` mark, ``"S"`` space.
        bits: of a character, 5 to 8.
        stop: stop bits: 1, 1.5 or 2.
        flow: 0 no flow control, 1 XON/XOFF, 2 hardware (RTS/CTS).
    """

    scheme: ClassVar[str] = "serial"
    path: str
    baudrate: int = 38400
    parity: str = "N"
    bits: int = 8
    stop: float = 1.0
    flow: int = 0

    def __str__(self) -> str:
        from urllib.parse import quote  # few programs have a serial port

        settings = f"baudrate={self.baudrate}&parity={self.parity}&bits={self.bits}&stop={self.stop:g}&flow={self.flow}"
        return f"serial://{quote(self.path, safe=_PLAIN)}?{settings}"


class HttpAddress(NamedTuple):
    """Where e-CAP is spoken; ``str`` gives its URL.

    Attributes:
        scheme: ``"http"`` or ``"https"``.
        host: name or address; an IPv6 address without its brackets.
        port: 0 to 65535; 0 lets a server take a free one.
        path: from the first slash on; a server answers at every path.
    """

    scheme: str
    host: str
    port: int
    path: str = "/"

    def __str__(self) -> str:
        return f"{Address(self.scheme, self.host, self.port)}{self.path if self.path != '/' else ''}"


@dataclass(frozen=True, slots=True)
class PtyAddress:
    """A pair of pseudo-terminals that a server opens: a serial line without any hardware."""

    scheme: ClassVar[str] = "pty"

    def __str__(self) -> str:
        return "pty://"


CanOption: TypeAlias = str | int | float | bool
"""What an option of a CAN interface can be."""


@dataclass(frozen=True, slots=True)
class CanAddress:
    """A CAN bus, as python-can opens it; ``str`` gives its URL.

    ``can://INTERFACE/CHANNEL?bitrate=500000&OPTION=VALUE``: the channel is all that is between the first slash behind the
    interface and the ``?``, percent-decoded: ``can://socketcan/can0``, ``can://slcan//dev/ttyACM0``,
    ``can://udp_multicast/239.74.163.2?port=43113``, ``can://virtual/test``. An option that looks like a number is one,
    ``true`` and ``false`` are bool; ``007`` is text, as a number would be written otherwise.

    Attributes:
        interface: as python-can calls it.
        channel: of the interface; ``""`` for the usual one.
        bitrate: bit/s; ``None`` for what the interface is set to.
        options: further ones that python-can gets, pairs of a name and a value, in their order.
    """

    scheme: ClassVar[str] = "can"
    interface: str
    channel: str = ""
    bitrate: int | None = None
    options: tuple[tuple[str, CanOption], ...] = ()

    def __str__(self) -> str:
        from urllib.parse import quote  # as above

        pairs = [*([("bitrate", self.bitrate)] if self.bitrate is not None else []), *self.options]
        query = "&".join(f"{name}={quote(_option_text(value), safe=_PLAIN)}" for name, value in pairs)
        return f"can://{self.interface}/{quote(self.channel, safe=_PLAIN)}{'?' if query else ''}{query}"


_PLAIN: Final = "/\\:.,-_+@"  # what a path has often, and stays readable


def parse_address(text: str) -> AnyAddress:
    """Read a URL or a connection string; a bare host means TCP, a missing port 5007.

    Raises:
        InvalidAddress: it is none, its transport is unknown, or the package of its transport cannot be loaded.
    """
    if not isinstance(text, str):
        raise bad_address(brief(text), tr("a text is needed"))
    given = _split_scheme(text)
    if text.strip().startswith("/"):
        raise bad_address(text, tr("a serial port has serial:// before it"), "serial")
    row = registry.find(given.scheme)
    if row is None:
        known = registry.schemes()
        raise bad_address(
            text, tr("unknown transport {scheme!r:.80}; {known} are known", scheme=given.scheme, known=known)
        )
    address: AnyAddress = registry.resolve(row.parse)(given)
    return address


def bad_address(text: str, reason: str, scheme: str = _USUAL) -> InvalidAddress:
    """Return the exception for an address that cannot be read.

    Args:
        text: the address.
        reason: in the current language.
        scheme: whose row has an example of what would do.
    """
    row = registry.find(scheme) or registry.find(_USUAL)
    example = "" if row is None else row.example
    return InvalidAddress(
        tr("{text!r:.200} is no address: {reason}. Example: {example}", text=text, reason=reason, example=example)
    )


def _split_scheme(text: str) -> Given:
    place = text.strip()
    scheme, mark, rest = place.partition("://")
    if mark:
        return Given(text, scheme.lower(), rest)
    scheme, mark, rest = place.partition(":")
    if mark and registry.known(scheme.lower()):
        return Given(text, scheme.lower(), rest, url=False)
    return Given(text, _USUAL, place, url=False)


# --- hosts ------------------------------------------------------------------------------------------------------------


def parse_host(given: Given) -> Address:
    """Read ``192.168.0.1:5007``."""
    return Address(given.scheme, *_split_port(given.text, given.rest.removesuffix("/"), given.scheme))


def _split_port(text: str, place: str, scheme: str) -> tuple[str, int]:
    usual = _WEB.get(scheme, DEFAULT_PORT)
    if place.startswith("["):
        host, closing, rest = place[1:].partition("]")
        colon, port = rest[:1], rest[1:]
        whole = bool(closing) and colon in ("", ":")
    else:
        host, colon, port = place.partition(":")
        whole = ":" not in port
    if host.isdecimal():
        raise bad_address(text, tr("{host:.80} is no host", host=host), scheme)
    if not whole or not host or any(sign in host for sign in " /?@#[]\0\t\r\n"):
        reason = tr("a host and perhaps a port are needed")
        raise bad_address(text, reason, scheme)
    if not colon:
        return host, usual
    number = _whole(port)
    if not 0 <= number <= 65535:
        reason = tr("port {port!r:.80} is not 0 to 65535", port=port)
        raise bad_address(text, reason, scheme)
    return host, number


def parse_http(given: Given) -> HttpAddress:
    """Read ``127.0.0.1:8080/path?query``."""
    text, scheme, rest, _ = given
    place, slash, path = rest.partition("/")
    if "?" in place or "#" in rest or any(not "!" <= sign <= "~" for sign in path):
        reason = tr("a path has no blanks, no # and only ASCII: others are written %XX")
        raise bad_address(text, reason, scheme)
    return HttpAddress(scheme, *_split_port(text, place, scheme), slash + path or "/")


# --- serial ports -----------------------------------------------------------------------------------------------------


def parse_serial(given: Given) -> SerialAddress:
    """Read ``/dev/ttyUSB0?baudrate=38400&parity=N&bits=8&stop=1&flow=0``."""
    from urllib.parse import unquote

    text = given.text
    place, mark, query = given.rest.partition("?")
    if place.startswith("dev/"):
        raise bad_address(text, tr("a path begins with a slash"), "serial")
    settings: dict[str, str] = {}
    for part in query.split("&") if mark and query else ():
        name, _, value = part.partition("=")
        name = name.strip().lower()
        if name not in _SETTINGS or name in settings:
            raise bad_address(text, _wrong_setting(name, twice=name in settings), "serial")
        settings[name] = value.strip()
    return _port(text, unquote(place, errors="surrogateescape"), settings, "serial")


def parse_com(given: Given) -> SerialAddress:
    """Read ``1:38400:N:8:1:0``; what is left out, or empty, is as usual."""
    if given.url:
        return parse_serial(given)
    text = given.text
    place, *values = (part.strip() for part in given.rest.split(":"))
    if len(values) > len(_SETTINGS):
        reason = tr(
            "at most {count} settings follow the port, a path with colons needs the form serial://",
            count=len(_SETTINGS),
        )
        raise bad_address(text, reason, "com")
    number = _whole(place)
    if number > 0:
        place = f"COM{number}" if os.name == "nt" else f"/dev/ttyS{number - 1}"
    elif place.isdecimal():
        raise bad_address(text, tr("COM ports count from 1"), "com")
    settings = {name: value for name, value in zip(_SETTINGS, values, strict=False) if value}
    return _port(text, place, settings, "com")


def _port(text: str, path: str, settings: dict[str, str], form: str) -> SerialAddress:
    path = path.strip()
    if not path or len(path) > _LONGEST or any(sign < " " or "\ud800" <= sign <= "\udfff" for sign in path):
        reason = tr("a serial port is needed")
        raise bad_address(text, reason, form)
    if os.name != "nt" and "/" not in path:
        path = f"/dev/{path}"
    baudrate = _whole(settings.get("baudrate", "38400"))
    if baudrate not in _BAUDRATES:
        raise bad_address(
            text, _wrong_value("baudrate", settings["baudrate"], f"{_BAUDRATES.start}-{_BAUDRATES.stop - 1}"), form
        )
    parity = settings.get("parity", "N").upper()
    if len(parity) != 1 or parity not in "NEOMS":
        raise bad_address(text, _wrong_value("parity", settings["parity"], "N, E, O, M, S"), form)
    bits = _whole(settings.get("bits", "8"))
    if bits not in range(5, 9):
        raise bad_address(text, _wrong_value("bits", settings["bits"], "5, 6, 7, 8"), form)
    stop = _STOPS.get(settings.get("stop", "1"))
    if stop is None:
        raise bad_address(text, _wrong_value("stop", settings["stop"], "1, 1.5, 2"), form)
    flow = _whole(settings.get("flow", "0"))
    if flow not in range(3):
        raise bad_address(
            text,
            _wrong_value("flow", settings["flow"], tr("0 none, 1 XON/XOFF, 2 hardware")),
            form,
        )
    return SerialAddress(path, baudrate, parity, bits, stop, flow)


def parse_pty(given: Given) -> PtyAddress:
    """Read nothing: the system chooses the terminals."""
    if given.rest:
        raise bad_address(given.text, tr("pty takes nothing more, not {rest!r:.80}", rest=given.rest), "pty")
    return PtyAddress()


_SETTINGS: Final = ("baudrate", "parity", "bits", "stop", "flow")


def _wrong_setting(name: str, *, twice: bool) -> str:
    if twice:
        return tr("{name} is given twice", name=name)
    known = ", ".join(_SETTINGS)
    return tr("there is no setting {name!r:.80}; {known} are known", name=name, known=known)


def _wrong_value(name: str, value: str, known: str) -> str:
    return tr("{name} cannot be {value!r:.80}; known: {known}", name=name, value=value, known=known)


# --- CAN --------------------------------------------------------------------------------------------------------------


def parse_can(given: Given) -> CanAddress:
    """Read ``slcan//dev/ttyACM0?bitrate=500000&sleep_after_open=0``."""
    from urllib.parse import unquote

    text = given.text
    place, _, query = given.rest.partition("?")
    interface, _, channel = place.partition("/")
    if not interface.replace("-", "_").isidentifier() or not interface.isascii() or len(interface) > _NAME:
        reason = tr("an interface of python-can is needed: socketcan, slcan, serial, udp_multicast, virtual, pcan ...")
        raise bad_address(text, reason, "can")
    channel = unquote(channel, errors="surrogateescape")
    if interface == "udp_multicast" and channel[:1] == "[" and channel[-1:] == "]":
        channel = channel[1:-1]  # an IPv6 address as in other URLs
    if len(channel) > _LONGEST or any(sign < " " or "\ud800" <= sign <= "\udfff" for sign in channel):
        raise bad_address(text, tr("that is no channel"), "can")
    options: dict[str, CanOption] = {}
    for part in query.split("&") if query else ():
        name, _, value = part.partition("=")
        if name in options or name in _TAKEN or not name.isidentifier() or not name.isascii() or len(name) > _NAME:
            raise bad_address(text, _wrong_option(name, twice=name in options), "can")
        options[name] = _option(unquote(value))
    bitrate = options.pop("bitrate", None)
    if bitrate is not None and (not isinstance(bitrate, int) or bitrate not in _BITRATES):
        known = f"{_BITRATES.start}-{_BITRATES.stop - 1}"
        raise bad_address(text, _wrong_value("bitrate", _option_text(bitrate), known), "can")
    return CanAddress(interface, channel, bitrate, tuple(options.items()))


def _option(text: str) -> CanOption:
    """Return what an option is, so that :func:`_option_text` gives the same text or one that means the same."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    if len(text) > _NUMBER or not text.isascii() or text.strip("+-.0123456789eE"):
        return text
    try:
        if text.lstrip("-").isdecimal():
            return int(text) if str(int(text)) == text else text  # 007 may be the number of an adapter
        number = float(text)
    except ValueError:
        return text
    return number if abs(number) != float("inf") else text


def _option_text(value: CanOption) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


_NAME: Final = 80  # characters of an interface or an option
_NUMBER: Final = 40  # characters of a number


def _wrong_option(name: str, *, twice: bool) -> str:
    if twice:
        return tr("{name} is given twice", name=name)
    return tr("{name!r:.80} cannot be an option", name=name)


def _whole(text: str) -> int:
    """Return a whole number, -1 for what is none."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 9 else -1
