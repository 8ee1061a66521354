"""THE TABLE of transports: one row per address scheme.

A row refers to objects by references, ``"module:attribute"``, because the objects are in higher layers, or are imported
on first use only. :func:`resolve` returns the object. A new transport requires a module and a row.

A package outside orinkit registers its row in the entry point group ``orinkit.transports``. The name of the entry point
is the scheme, and its value refers to the row::

    [project.entry-points."orinkit.transports"]
    unix = "my_package.unix:UNIX"

Entry points are looked up if a scheme is unknown. Instead of having an entry point, a program
may call :func:`register`.
"""

from __future__ import annotations

import sys
from functools import cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, TypeAlias

from orinkit.core.errors import InvalidAddress, InvalidValue, MissingExtra
from orinkit.core.i18n import N_, tr
from orinkit.transport.credentials import NOTHING, Credentials
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP: Final = "orinkit.transports"
"""The group of the entry points."""

_LONGEST: Final = 300  # maximum number of characters of an exception's text in a message

Reference: TypeAlias = str
"""``"module:attribute"``, imported on first use; ``""`` if there is no object."""


class AnyAddress(Protocol):
    """An address; ``str`` returns its URL."""

    @property
    def scheme(self) -> str:
        """The scheme, which identifies the row of the table of transports."""


class SplitAddress(NamedTuple):
    """An address split at its scheme, the input of the parser of a row.

    Attributes:
        text: The whole address, for messages.
        scheme: The scheme in lower case; ``tcp`` if the address has none.
        rest: The text after ``://`` or after the colon; the whole address if it has no scheme.
        url: True if the address has the form ``scheme://rest``; False if it is ``scheme:rest`` or has no scheme.
    """

    text: str
    scheme: str
    rest: str
    url: bool = True


class LinkOptions(NamedTuple):
    """Parameters for a client to open a link.

    Attributes:
        seconds: Time-out for opening the link, s.
        access: Credentials for HTTP.
        most: The largest number of bytes of a reply over HTTP.
        dead_after: Time in s after which a TCP connection is considered lost if the controller's machine does not
            respond.
    """

    seconds: float
    access: Credentials = NOTHING
    most: int = DEFAULT_LIMITS.packet
    dead_after: float = DEAD_AFTER


class ServeOption(NamedTuple):
    """The command-line option ``--SCHEME ADDRESS`` of ``orinkit serve`` and ``orinkit gateway``.

    Attributes:
        help: Help text in English; :func:`~orinkit.core.i18n.tr` translates it.
        ports: True if the address may be only a number, which is then a port of this machine.
        flag: True if the option takes no address.
        secure: The scheme to use instead if the server has a certificate; ``""`` if the scheme stays the same.
    """

    help: str
    ports: bool = False
    flag: bool = False
    secure: str = ""


class Transport(NamedTuple):
    """A row of the table: one transport.

    ``parse``, ``link``, ``aio_link``, ``adopt``, ``listener`` and ``refusal`` are references to functions with the
    signatures below, and ``profile`` is a reference to an object. ``""``: the transport does not have it.

    Attributes:
        scheme: The scheme of the address, in lower case.
        parse: ``(SplitAddress) -> AnyAddress``. Raises InvalidAddress.
        example: An example address, for messages.
        profile: A :class:`~orinkit.bcap.profiles.BcapProfile` for b-CAP, another
            :class:`~orinkit.cao.transport_profile.TransportProfile` for e-CAP. The
            ``name`` of the profile must be the scheme of a row of the table: to take over a connection, the streaming
            process calls the ``adopt`` function of this row.
        link: ``(address, LinkOptions) -> Link``, for a client.
        aio_link: ``async (address, LinkOptions) -> AsyncLink``.
        adopt: ``(descriptor) -> Link``, in the streaming process.
        listener: ``async (address, ServerContext) -> Listener``, for a server. If ``http`` is True, it receives
            HttpOptions too.
        refusal: ``(address) -> InvalidAddress``: returns the exception if the transport has no link, or no listener.
        option: The option of ``orinkit serve``; ``None`` if the transport has none of its own.
        http: True if clients may send a token, and servers may have a certificate.
        alias: The scheme for which ``scheme`` is only another notation; ``""`` if there is none.
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
        """All references of the row, without empty ones."""
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
                "HOST:PORT to listen on, or PORT alone for 127.0.0.1; may be repeated. Port 0 selects a free "
                "port. The default is not used if another address is given."
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
            N_("HOST:PORT to listen on with UDP, or PORT alone for 127.0.0.1; may be repeated."), ports=True
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
            N_("Serial port to listen on, such as /dev/ttyUSB0?baudrate=115200; default 38400 8N1; may be repeated.")
        ),
    ),
    Transport("com", parse="orinkit.transport.serial.address:parse_com", example="com:1:38400:N:8:1:0", alias="serial"),
    _http(
        "http",
        ServeOption(
            N_(
                "HOST:PORT to listen on for e-CAP over HTTP, or PORT alone for 127.0.0.1; may be "
                "repeated. A host alone means port 80. With --cert, https and port 443 are used."
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
    """Return the rows of orinkit, and the rows registered so far."""
    return tuple(_rows.values())


def known(scheme: str) -> bool:
    """Return True if the scheme has a row; entry points are not searched."""
    return scheme in _rows


def aliases() -> tuple[str, ...]:
    """Return the schemes that are only another notation for another scheme."""
    return tuple(row.scheme for row in rows() if row.alias)


def examples(*, slave_mode: bool = False) -> str:
    """Return an example address of each transport that a client can use, for messages.

    Args:
        slave_mode: True to return only transports that support slave mode.
    """
    return ", ".join(row.example for row in rows() if row.link and (row.adopt or not slave_mode))


def schemes() -> str:
    """Return all schemes, including those of entry points, for messages."""
    return ", ".join(dict.fromkeys([*_rows, *entry_points()]))


def register(row: Transport) -> None:
    """Add a row.

    Raises:
        InvalidValue: If the scheme is not valid, or already has another row.
    """
    if row.scheme != row.scheme.lower() or not row.scheme.replace("-", "_").isidentifier():
        raise InvalidValue(tr("{scheme!r:.80} cannot be the scheme of a transport", scheme=row.scheme))
    if _rows.setdefault(row.scheme, row) != row:
        raise InvalidValue(tr("the scheme {scheme} already has another transport", scheme=row.scheme))


def find(scheme: str) -> Transport | None:
    """Return the row of a scheme, loaded from an entry point if there is one; ``None`` if the scheme is unknown.

    Raises:
        InvalidAddress: If the package of the entry point cannot be loaded.
    """
    row = _rows.get(scheme)
    if row is None and scheme.isascii():
        entry = entry_points().get(scheme)
        return None if entry is None else _load(scheme, entry)
    return row


def row_of(address: AnyAddress) -> Transport:
    """Return the row of a parsed address.

    Raises:
        InvalidAddress: If the scheme of the address is unknown.
    """
    row = find(address.scheme)
    if row is None:
        raise InvalidAddress(tr("unknown transport {scheme!r:.80}; available: {known}", scheme=address.scheme, known=schemes()))  # fmt: skip
    return row


def entry_points() -> dict[str, EntryPoint]:
    """Return the entry points by scheme, without importing them."""
    return _entries(tuple(sys.path))


@cache  # a client may send any number of unknown schemes; each search of all packages would delay the other clients
def _entries(_path: tuple[str, ...]) -> dict[str, EntryPoint]:
    from importlib import metadata  # slow to import, and few programs have such a package

    try:
        found = metadata.entry_points(group=GROUP)
    except Exception:  # noqa: BLE001 - the metadata of an installed package may be damaged
        return {}
    return {entry.name.lower(): entry for entry in sorted(found, key=lambda each: (each.name, each.value))}


def resolve(reference: Reference) -> Any:
    """Return the object that a reference names.

    Raises:
        InvalidAddress: If the object cannot be imported.
        MissingExtra: If a package of one of orinkit's extras is not installed.
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
            tr("cannot import {reference}, used by a transport: {reason}", reference=reference, reason=_reason(error))
        ) from error
    return found


def _load(scheme: str, entry: EntryPoint) -> Transport:
    try:
        row = entry.load()
    except Exception as error:
        raise _unloadable(scheme, entry, _reason(error)) from error
    if not isinstance(row, Transport) or row.scheme != scheme:
        raise _unloadable(scheme, entry, tr("it is not a Transport with the scheme {scheme}", scheme=scheme))
    register(row)
    return row


def _unloadable(scheme: str, entry: EntryPoint, reason: str) -> InvalidAddress:
    return InvalidAddress(
        tr(
            "cannot load the transport {scheme} of the package {package} ({place}): {reason}. Try: pip install "
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
    except Exception:  # noqa: BLE001 - the package's METADATA file is damaged or missing
        name = ""
    return name or entry.module


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"[:_LONGEST]
