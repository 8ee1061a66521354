"""THE TABLE of transports: one row per scheme of an address.

A row names what is above this module, and what has to be imported only when it is used, by references
``"module:attribute"``; :func:`resolve` returns the object. A new transport is a module and a row.

A package outside orinkit registers its row under the entry point ``orinkit.transports``. The name of the entry is the
scheme, its value is where the row is::

    [project.entry-points."orinkit.transports"]
    unix = "my_package.unix:UNIX"

Entry points are looked up if a scheme is unknown. A program may call :func:`register` instead.
"""

from __future__ import annotations

import sys
from functools import cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, TypeAlias

from orinkit.core.errors import InvalidAddress, InvalidValue, MissingExtra
from orinkit.core.i18n import N_, tr

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from orinkit.transport.credentials import Credentials

GROUP: Final = "orinkit.transports"
"""The entry points' group."""

_LONGEST: Final = 300  # characters of an exception in a message

Reference: TypeAlias = str
"""``"module:attribute"``, imported when it is used; ``""`` for nothing."""


class AnyAddress(Protocol):
    """An address; ``str`` gives its URL."""

    @property
    def scheme(self) -> str:
        """The scheme of its row."""


class AddressText(NamedTuple):
    """What the parser of a row gets.

    Attributes:
        text: the whole address, for messages.
        scheme: in lower case.
        rest: behind ``://``, or behind the colon.
        url: the address has the form ``scheme://rest``, not ``scheme:rest``.
    """

    text: str
    scheme: str
    rest: str
    url: bool = True


class LinkOptions(NamedTuple):
    """How a client opens a link.

    Attributes:
        seconds: that it may take.
        access: for HTTP.
        most: bytes of a reply over HTTP.
        dead_after: seconds without an answer from the controller's machine after which a TCP connection is given up.
    """

    seconds: float
    access: Credentials
    most: int
    dead_after: float


class ServeOption(NamedTuple):
    """The option of ``orinkit serve`` and ``orinkit gateway``: ``--SCHEME PLACE``.

    Attributes:
        help: in English; :func:`~orinkit.core.i18n.tr` translates it.
        ports: a number alone is a port of this machine.
        flag: the option takes no place.
        secure: the scheme if the server has a certificate.
    """

    help: str
    ports: bool = False
    flag: bool = False
    secure: str = ""


class Transport(NamedTuple):
    """A row.

    Attributes:
        scheme: of the address, in lower case.
        parse: ``(AddressText) -> AnyAddress``. Raises InvalidAddress.
        example: an address, for messages.
        profile: a :class:`~orinkit.bcap.profiles.BcapProfile` for b-CAP, another :class:`~orinkit.cao.transport_profile.TransportProfile` for
            e-CAP. Its name is a scheme with the same profile, whose row adopts its links.
        link: ``(address, LinkOptions) -> Link``, for a client.
        aio_link: ``async (address, LinkOptions) -> AsyncLink``.
        adopt: ``(descriptor) -> Link``, in the streaming process.
        listener: ``async (address, Connections) -> Listener``, for a server. With ``http`` it gets its HttpOptions too.
        refusal: ``(address) -> InvalidAddress``, why there is no link, or no listener.
        option: of ``orinkit serve``.
        http: clients may show a token, servers a certificate.
        alias: the scheme of the addresses that this is another form of.
    """

    scheme: str
    parse: Reference
    example: str
    profile: Reference = ""
    link: Reference = ""
    aio_link: Reference = ""
    adopt: Reference = ""
    listener: Reference = ""
    refusal: Reference = ""
    option: ServeOption | None = None
    http: bool = False
    alias: str = ""

    @property
    def references(self) -> tuple[Reference, ...]:
        """All references of the row."""
        each = (self.parse, self.profile, self.link, self.aio_link, self.adopt, self.listener, self.refusal)
        return tuple(filter(None, each))


def _http(scheme: str, option: ServeOption | None = None) -> Transport:
    return Transport(
        scheme,
        parse="orinkit.transport.address:parse_http",
        example=f"{scheme}://192.168.0.1:8080",
        profile="orinkit.ecap.client:HTTP",
        link="orinkit.transport.http.link:HttpLink.open",
        aio_link="orinkit.transport.http.aio_link:AsyncHttpLink.open",
        listener="orinkit.server.http.listener:HttpListener.open",
        option=option,
        http=True,
    )


_BUILT_IN: Final = (
    Transport(
        "tcp",
        parse="orinkit.transport.address:parse_host",
        example="tcp://192.168.0.1:5007",
        profile="orinkit.bcap.profiles:STREAM",
        link="orinkit.transport.sockets.tcp:TcpLink.open",
        aio_link="orinkit.transport.sockets.aio_tcp:AsyncTcpLink.open",
        adopt="orinkit.transport.sockets.tcp:TcpLink.adopt",
        listener="orinkit.server.tcp:TcpListener.open",
        option=ServeOption(
            N_(
                "HOST:PORT to listen on, or PORT alone for 127.0.0.1; may be given again. Port 0 takes a "
                "free one. No default if another address is given."
            ),
            ports=True,
        ),
    ),
    Transport(
        "udp",
        parse="orinkit.transport.address:parse_host",
        example="udp://192.168.0.1:5007",
        profile="orinkit.bcap.profiles:DATAGRAM",
        link="orinkit.transport.sockets.udp:UdpLink.open",
        aio_link="orinkit.transport.sockets.aio_udp:AsyncUdpLink.open",
        adopt="orinkit.transport.sockets.udp:UdpLink.adopt",
        listener="orinkit.server.udp:UdpListener.open",
        option=ServeOption(
            N_("HOST:PORT to listen on with UDP, or PORT alone for 127.0.0.1; may be given again."), ports=True
        ),
    ),
    Transport(
        "serial",
        parse="orinkit.transport.serial.address:parse_serial",
        example="serial:///dev/ttyUSB0?baudrate=38400",
        profile="orinkit.bcap.profiles:LINE",
        link="orinkit.transport.serial.opening:open_link",
        aio_link="orinkit.transport.serial.opening:open_aio_link",
        adopt="orinkit.transport.serial.opening:adopt",
        listener="orinkit.server.serial_line:PortListener.open",
        option=ServeOption(
            N_("Serial port to listen on, as /dev/ttyUSB0?baudrate=115200; 38400 8N1 by default; may be given again.")
        ),
    ),
    Transport("com", parse="orinkit.transport.serial.address:parse_com", example="com:1:38400:N:8:1:0", alias="serial"),
    _http(
        "http",
        ServeOption(
            N_(
                "HOST:PORT to listen on for e-CAP over HTTP, or PORT alone for 127.0.0.1; may be given "
                "again. A host alone means port 80. With --cert it is https, and port 443."
            ),
            ports=True,
            secure="https",
        ),
    ),
    _http("https"),
    Transport(
        "pty",
        parse="orinkit.transport.serial.address:parse_pty",
        example="pty://",
        listener="orinkit.server.serial_line:PtyListener.open",
        refusal="orinkit.transport.links:for_servers",
        option=ServeOption(N_("Listen on a new pseudo-terminal: a serial line without a cable."), flag=True),
    ),
    Transport(
        "can",
        parse="orinkit.transport.address:parse_can",
        example="can://slcan//dev/ttyACM0?bitrate=500000",
        refusal="orinkit.transport.links:for_drivers",
    ),
)
_rows: Final = {row.scheme: row for row in _BUILT_IN}


def rows() -> tuple[Transport, ...]:
    """Return the rows of orinkit and those that are registered by now."""
    return tuple(_rows.values())


def known(scheme: str) -> bool:
    """Return True if the scheme has a row already, without a look at entry points."""
    return scheme in _rows


def aliases() -> tuple[str, ...]:
    """Return the schemes that are another form of an address of another one."""
    return tuple(row.scheme for row in rows() if row.alias)


def examples() -> str:
    """Return an address of each transport that a client can use, for messages."""
    return ", ".join(row.example for row in rows() if row.link)


def schemes() -> str:
    """Return all schemes, those of entry points too, for messages."""
    return ", ".join(dict.fromkeys([*_rows, *entries()]))


def register(row: Transport) -> None:
    """Add a row.

    Raises:
        InvalidValue: If the scheme is none, or has another row.
    """
    if row.scheme != row.scheme.lower() or not row.scheme.replace("-", "_").isidentifier():
        raise InvalidValue(tr("{scheme!r:.80} cannot be the scheme of a transport", scheme=row.scheme))
    if _rows.setdefault(row.scheme, row) != row:
        raise InvalidValue(tr("there is another transport of the scheme {scheme}", scheme=row.scheme))


def find(scheme: str) -> Transport | None:
    """Return the row of a scheme, loaded from an entry point if there is one; ``None`` if the scheme is unknown.

    Raises:
        InvalidAddress: If the package of the entry point cannot be loaded.
    """
    row = _rows.get(scheme)
    if row is None and scheme.isascii():
        entry = entries().get(scheme)
        return None if entry is None else _load(scheme, entry)
    return row


def row_of(address: AnyAddress) -> Transport:
    """Return the row of an address that was parsed.

    Raises:
        InvalidAddress: If there is none: the address is not of this registry.
    """
    row = find(address.scheme)
    if row is None:
        raise InvalidAddress(tr("unknown transport {scheme!r:.80}; {known} are known", scheme=address.scheme, known=schemes()))  # fmt: skip
    return row


def entries() -> dict[str, EntryPoint]:
    """Return the entry points by scheme; nothing of them is imported."""
    return _entries(tuple(sys.path))


@cache  # a client may send any number of unknown schemes, and each look at all packages holds up the others
def _entries(_path: tuple[str, ...]) -> dict[str, EntryPoint]:
    from importlib import metadata  # takes long, and few programs have such a package

    try:
        found = metadata.entry_points(group=GROUP)
    except Exception:  # noqa: BLE001 - the data of one of all installed packages are damaged
        return {}
    return {entry.name.lower(): entry for entry in sorted(found, key=lambda each: (each.name, each.value))}


def resolve(reference: Reference) -> Any:
    """Return what a reference names.

    Raises:
        InvalidAddress: If it cannot be imported.
        MissingExtra: If a package is missing that an extra of orinkit has.
    """
    from importlib import import_module

    module, _, path = reference.partition(":")
    try:
        found: Any = import_module(module)
        for name in path.split("."):
            found = getattr(found, name)
    except MissingExtra:
        raise
    except (ImportError, AttributeError) as error:
        raise InvalidAddress(
            tr("{reference} of a transport cannot be loaded: {reason}", reference=reference, reason=_reason(error))
        ) from error
    return found


def _load(scheme: str, entry: EntryPoint) -> Transport:
    try:
        row = entry.load()
    except Exception as error:
        raise _unloadable(scheme, entry, _reason(error)) from error
    if not isinstance(row, Transport) or row.scheme != scheme:
        raise _unloadable(scheme, entry, tr("it is no row of the scheme {scheme}", scheme=scheme))
    register(row)
    return row


def _unloadable(scheme: str, entry: EntryPoint, reason: str) -> InvalidAddress:
    return InvalidAddress(
        tr(
            "the transport {scheme} of the package {package} ({place}) cannot be loaded: {reason}. Try: pip install "
            "--force-reinstall {package}",
            scheme=scheme,
            package=_package(entry),
            place=entry.value,
            reason=reason,
        )
    )


def _package(entry: EntryPoint) -> str:
    try:
        name = "" if entry.dist is None else entry.dist.name
    except Exception:  # noqa: BLE001 - its METADATA are damaged, or are missing
        name = ""
    return name or entry.module


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"[:_LONGEST]
