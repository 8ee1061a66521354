"""Options for the addresses that a server listens on: one for each transport of the registry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, make_dataclass
from typing import Annotated, Any, Final, NamedTuple

from cyclopts import Group, Parameter

from orinkit.cli._shared.errors import usage_error
from orinkit.cli._shared.http import HTTP
from orinkit.core.i18n import tr
from orinkit.server.aio_server import DEFAULT_URL
from orinkit.transport.address import parse_address
from orinkit.transport.registry import ServeOption, aliases, entry_points, rows

LISTENING: Final = Group(tr("Network"), sort_key=8)


class ListenTransport(NamedTuple):
    """A transport that a server can listen on.

    Attributes:
        scheme: URL scheme of its addresses, and the name of its option.
        help: Help text of the option, in the current language.
        option: The declaration of the option in the registry of transports.
        http: True for HTTP: clients may send a token, and servers may have a certificate.
    """

    scheme: str
    help: str
    option: ServeOption
    http: bool = False

    @property
    def name(self) -> str:
        """The name of the field for this transport in :class:`ListenAddresses`."""
        return self.scheme.replace("-", "_")

    def url(self, address: str, *, secure: bool) -> str:
        """Return the URL for a value of the option.

        Args:
            address: The value of the option.
            secure: True if the server has a certificate.

        Raises:
            CommandError: If the value is an address of another transport.
            InvalidAddress: If the value is not a valid address.
        """
        scheme = self.option.secure if secure and self.option.secure else self.scheme
        begins = tuple(f"{each}:" for each in (scheme, *aliases()))
        named = "://" in address or address.lower().startswith(begins)
        if self.option.ports and address.isascii() and address.isdecimal():
            address = f"127.0.0.1:{address}"
        url = address if named else f"{scheme}://{address}"
        found = parse_address(url).scheme
        if found != scheme:
            raise usage_error(
                tr(
                    "--{option} {address}: this is an address for {scheme}",
                    option=self.scheme,
                    address=address,
                    scheme=found,
                ),
            )
        return url


def _transports() -> Iterator[ListenTransport]:
    for row in rows():
        if row.option is not None:
            yield ListenTransport(row.scheme, tr(row.option.help), row.option, row.http)
    taken = {row.scheme for row in rows()}
    for scheme, entry in entry_points().items():
        if scheme not in taken and scheme.replace("-", "_").isidentifier():
            text = tr("Address to listen on over {scheme}, a transport from {place}; may be repeated.", scheme=scheme, place=entry.value)  # fmt: skip
            yield ListenTransport(scheme, text, ServeOption(text))  # the transport's package is imported on first use


TRANSPORTS: Final = tuple(_transports())


@dataclass(frozen=True)
class ListenAddresses:
    """The values of the address options; :func:`listen_addresses_class` adds a field for each option."""

    def values_of(self, transport: ListenTransport) -> tuple[str, ...]:
        """Return the values of an option; ``("",)`` for a flag that is set."""
        given: tuple[str, ...] | bool = getattr(self, transport.name)
        if isinstance(given, bool):
            return ("",) if given else ()
        return given

    def items(self) -> Iterator[tuple[ListenTransport, str]]:
        """Yield a pair of transport and address for each address on the command line."""
        for transport in TRANSPORTS:
            for address in self.values_of(transport):
                yield transport, address


def listen_addresses_class(first_help: str | None = None) -> type[ListenAddresses]:
    """Return a subclass of :class:`ListenAddresses` with a field for each transport.

    Args:
        first_help: Help text for the option of the default address, instead of the usual text and the default;
            ``None`` for these.
    """
    fields: list[Any] = []
    for transport in TRANSPORTS:
        first = DEFAULT_URL.startswith(f"{transport.scheme}://")
        text = first_help if first and first_help is not None else transport.help
        parameter = Parameter(
            help=text,
            group=HTTP if transport.http else LISTENING,
            show_default=_default if first and first_help is None else None,
        )
        kind: Any = bool if transport.option.flag else tuple[str, ...]
        default: Any = False if transport.option.flag else ()
        fields.append((transport.name, Annotated[kind, parameter], field(default=default)))
    # Python 3.11 sets the module of the class to "types", and cyclopts ignores classes of the standard library
    namespace = {"__module__": __name__}
    made = make_dataclass("ListenAddressOptions", fields, bases=(ListenAddresses,), frozen=True, namespace=namespace)
    return Parameter(name="*", group=LISTENING)(made)


def _default(_given: object) -> str:
    return DEFAULT_URL.partition("://")[2]
