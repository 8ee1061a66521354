"""Addresses to connect to or to listen on, as URLs.

Examples: ``tcp://192.168.0.1:5007``, ``udp://...``, ``serial:///dev/ttyUSB0``, ``http://...``.

DENSO's connection strings are accepted too: ``tcp:192.168.0.1:5007``, ``udp:192.168.0.1:5007``,
``com:1:38400:N:8:1:0``. ABH3 drivers use ``can://INTERFACE/CHANNEL``, for example ``can://socketcan/can0``.
"""

from __future__ import annotations

from typing import ClassVar, Final, NamedTuple, TypeAlias

from orinkit.core.errors import InvalidAddress
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.core.validation import brief
from orinkit.transport import registry
from orinkit.transport.registry import AnyAddress, SplitAddress

DEFAULT_PORT: Final = 5007
"""The port of b-CAP (List 3-1)."""

_WEB: Final = {"http": 80, "https": 443}
LONGEST: Final = 4000
"""The largest number of characters of the path of a serial port, or of the channel of a CAN interface."""
_USUAL: Final = "tcp"
"""The scheme of an address that does not contain a scheme."""
_BITRATES: Final = range(1000, 1_000_001)  # bit/s, classic CAN
_TAKEN: Final = ("interface", "channel", "bustype", "context", "config_context", "ignore_config")
"""Parameters of python-can that cannot be options of an address.

The first two are other parts of the address, and ``bustype`` is an old name of the first one. The others concern
configuration files, which orinkit does not read.
"""


class Address(NamedTuple):
    """A host and a port.

    Attributes:
        scheme: ``"tcp"`` or ``"udp"``.
        host: Name or IP address; an IPv6 address without brackets.
        port: 0 to 65535; if it is 0, a server selects a free port.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def is_loopback(host: str) -> bool:
    """Return True if the host is a loopback address or ``localhost``; other names are not resolved."""
    from ipaddress import ip_address  # few programs require it

    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def network_of(host: str) -> str:
    """Return the group of a host for limits per address: its IPv4 address, IPv6 /64 network, ``127.0.0.1`` or name.

    The /64 network is used because it usually belongs to one owner. ``127.0.0.1`` represents all loopback addresses,
    because they belong to one machine.
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


class HttpAddress(NamedTuple):
    """The address of an e-CAP server; ``str`` returns its URL.

    Attributes:
        scheme: ``"http"`` or ``"https"``.
        host: Name or IP address; an IPv6 address without brackets.
        port: 0 to 65535; if it is 0, a server selects a free port.
        path: Path, from the first slash on; a server accepts every path.
    """

    scheme: str
    host: str
    port: int
    path: str = "/"

    def __str__(self) -> str:
        return f"{Address(self.scheme, self.host, self.port)}{self.path if self.path != '/' else ''}"


CanOption: TypeAlias = str | int | float | bool
"""The value of an option of a CAN interface."""


@record
class CanAddress:
    """The address of a CAN bus that python-can opens; ``str`` returns its URL.

    The form is ``can://INTERFACE/CHANNEL?bitrate=500000&OPTION=VALUE``. The channel is the text between the first slash
    after the interface and the ``?``, percent-decoded. Examples are ``can://socketcan/can0``,
    ``can://slcan//dev/ttyACM0``, ``can://udp_multicast/239.74.163.2?port=43113`` and ``can://virtual/test``. Options
    that look like numbers are parsed as numbers, ``true`` and ``false`` as bool. ``007`` remains text, because a number
    is not written with leading zeros.

    Attributes:
        interface: The name of the interface in python-can.
        channel: The channel of the interface; ``""`` for its default.
        bitrate: Bit rate in bit/s; ``None`` keeps the setting of the interface.
        options: Further options for python-can, as pairs of name and value, in the order of the URL.
    """

    scheme: ClassVar[str] = "can"
    interface: str
    channel: str = ""
    bitrate: int | None = None
    options: tuple[tuple[str, CanOption], ...] = ()

    def __str__(self) -> str:
        from urllib.parse import quote  # as above

        pairs = [*([("bitrate", self.bitrate)] if self.bitrate is not None else []), *self.options]
        query = "&".join(f"{name}={quote(_option_text(value), safe=PLAIN)}" for name, value in pairs)
        return f"can://{self.interface}/{quote(self.channel, safe=PLAIN)}{'?' if query else ''}{query}"


PLAIN: Final = "/\\:.,-_+@"
"""Characters that are not percent-encoded in a path, because they are frequent there."""


def parse_address(text: str) -> AnyAddress:
    """Parse a URL or a connection string. The default scheme is ``tcp``; the default port of b-CAP is 5007.

    Raises:
        InvalidAddress: If the address is malformed, its transport is unknown, or the package of its transport cannot be
            loaded.
    """
    if not isinstance(text, str):
        raise bad_address(brief(text), tr("expected a string"))
    given = _split_scheme(text)
    if text.strip().startswith("/"):
        raise bad_address(text, tr("a serial port requires the prefix serial://"), "serial")
    row = registry.find(given.scheme)
    if row is None:
        known = registry.schemes()
        raise bad_address(
            text, tr("unknown transport {scheme!r:.80}; available: {known}", scheme=given.scheme, known=known)
        )
    address: AnyAddress = registry.resolve(row.parse)(given)
    return address


def bad_address(text: str, reason: str, scheme: str = _USUAL, *, example: str = "") -> InvalidAddress:
    """Return the exception for an address that cannot be parsed.

    Args:
        text: The address.
        reason: The reason why it cannot be parsed, in the current language.
        scheme: The scheme of which the message shows an example.
        example: A better example, the address that the user probably wants.
    """
    row = registry.find(scheme) or registry.find(_USUAL)
    example = example or ("" if row is None else row.example)
    return InvalidAddress(
        tr("invalid address {text!r:.200}: {reason}. Example: {example}", text=text, reason=reason, example=example)
    )


def _split_scheme(text: str) -> SplitAddress:
    place = text.strip()
    scheme, mark, rest = place.partition("://")
    if mark:
        return SplitAddress(text, scheme.lower(), rest)
    scheme, mark, rest = place.partition(":")
    if mark and registry.known(scheme.lower()):
        return SplitAddress(text, scheme.lower(), rest, url=False)
    return SplitAddress(text, _USUAL, place, url=False)


# --- hosts ------------------------------------------------------------------------------------------------------------


def parse_host(given: SplitAddress) -> Address:
    """Parse the part of an address after the scheme, for example ``192.168.0.1:5007``."""
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
    if not colon and 0 <= whole_number(host) <= _LAST_PORT:
        raise bad_address(
            text, tr("{port} is a port without a host", port=host), scheme, example=f"{scheme}://127.0.0.1:{host}"
        )
    if host.isdecimal():
        raise bad_address(text, tr("{host:.80} is not a host", host=host), scheme)
    if not whole or not host or any(sign in host for sign in " /?@#[]\0\t\r\n"):
        reason = tr("expected HOST or HOST:PORT")
        raise bad_address(text, reason, scheme)
    if not colon:
        return host, usual
    number = whole_number(port)
    if not 0 <= number <= 65535:
        reason = tr("port {port!r:.80} is not 0 to 65535", port=port)
        raise bad_address(text, reason, scheme)
    return host, number


def parse_http(given: SplitAddress) -> HttpAddress:
    """Parse the part of an address after the scheme, for example ``127.0.0.1:8080/path?query``."""
    text, scheme, rest, _ = given
    place, slash, path = rest.partition("/")
    if "?" in place or "#" in rest or any(not "!" <= sign <= "~" for sign in path):
        reason = tr("a path must be ASCII without spaces and #; write other characters as %XX")
        raise bad_address(text, reason, scheme)
    return HttpAddress(scheme, *_split_port(text, place, scheme), slash + path or "/")


# --- CAN --------------------------------------------------------------------------------------------------------------


def parse_can(given: SplitAddress) -> CanAddress:
    """Parse the part after the scheme, for example ``slcan//dev/ttyACM0?bitrate=500000&sleep_after_open=0``."""
    from urllib.parse import unquote

    text = given.text
    place, _, query = given.rest.partition("?")
    interface, _, channel = place.partition("/")
    if not interface.replace("-", "_").isidentifier() or not interface.isascii() or len(interface) > _NAME:
        reason = tr("expected an interface of python-can: socketcan, slcan, serial, udp_multicast, virtual, pcan ...")
        raise bad_address(text, reason, "can")
    channel = unquote(channel, errors="surrogateescape")
    if interface == "udp_multicast" and channel[:1] == "[" and channel[-1:] == "]":
        channel = channel[1:-1]  # removes the brackets of an IPv6 address
    if len(channel) > LONGEST or any(sign < " " or "\ud800" <= sign <= "\udfff" for sign in channel):
        raise bad_address(text, tr("invalid channel"), "can")
    options: dict[str, CanOption] = {}
    for part in query.split("&") if query else ():
        name, _, value = part.partition("=")
        if name in options or name in _TAKEN or not name.isidentifier() or not name.isascii() or len(name) > _NAME:
            raise bad_address(text, _wrong_option(name, twice=name in options), "can")
        options[name] = _option(unquote(value))
    bitrate = options.pop("bitrate", None)
    if bitrate is not None and (not isinstance(bitrate, int) or bitrate not in _BITRATES):
        known = f"{_BITRATES.start}-{_BITRATES.stop - 1}"
        raise bad_address(text, invalid_value_message("bitrate", _option_text(bitrate), known), "can")
    return CanAddress(interface, channel, bitrate, tuple(options.items()))


def _option(text: str) -> CanOption:
    """Parse the value of an option; :func:`_option_text` converts the result back to the same or an equivalent text."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    if len(text) > _NUMBER or not text.isascii() or text.strip("+-.0123456789eE"):
        return text
    try:
        if text.lstrip("-").isdecimal():
            return int(text) if str(int(text)) == text else text  # 007 may be an adapter's serial number, not a number
        number = float(text)
    except ValueError:
        return text
    return number if abs(number) != float("inf") else text


def _option_text(value: CanOption) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


_NAME: Final = 80  # maximum number of characters of the name of an interface or an option
_NUMBER: Final = 40  # maximum number of characters of a number


def _wrong_option(name: str, *, twice: bool) -> str:
    if twice:
        return tr("{name} is given twice", name=name)
    return tr("{name!r:.80} is not a valid option", name=name)


def invalid_value_message(name: str, value: str, known: str) -> str:
    """Return the message for a setting with an invalid value; ``known`` describes the valid values."""
    return tr("{name} cannot be {value!r:.80}; expected: {known}", name=name, value=value, known=known)


def whole_number(text: str) -> int:
    """Return the non-negative integer that a text consists of, or -1 if the text is not a number of up to 8 digits."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 9 else -1


_LAST_PORT: Final = 65535


def consecutive_addresses(text: str, count: int) -> list[str]:
    """Return the URLs of ``count`` addresses on consecutive ports; the first one is ``text``.

    If its port is 0, all URLs are equal, and servers select free ports.

    Raises:
        InvalidAddress: If the address is invalid, has no port, or if the last port would exceed 65,535.
    """
    address = parse_address(text)
    if not isinstance(address, Address | HttpAddress):
        raise bad_address(text, tr("consecutive ports require an address with a port. Try: tcp://127.0.0.1:5007"))
    step = 1 if address.port else 0
    if address.port + step * (count - 1) > _LAST_PORT:
        raise bad_address(text, tr("{count} consecutive ports would exceed port {last}", count=count, last=_LAST_PORT))
    return [str(address._replace(port=address.port + step * number)) for number in range(count)]
