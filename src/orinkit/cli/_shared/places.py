"""Where a server listens: an option for each transport of the registry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, make_dataclass
from typing import Annotated, Any, Final, NamedTuple

from cyclopts import Group, Parameter

from orinkit.cli._shared.errors import unusable
from orinkit.cli._shared.web import HTTP
from orinkit.core.i18n import tr
from orinkit.server.aio_server import DEFAULT_URL
from orinkit.transport.address import parse_address
from orinkit.transport.registry import ServeOption, aliases, entries, rows

LISTENING: Final = Group(tr("Network"), sort_key=8)


class ListenTransport(NamedTuple):
    """A transport that a server can listen with.

    Attributes:
        scheme: of its addresses, and the name of its option.
        help: in the current language.
        option: of its row.
        http: clients may show a token, servers a certificate.
    """

    scheme: str
    help: str
    option: ServeOption
    http: bool = False

    @property
    def name(self) -> str:
        """The name of its field."""
        return self.scheme.replace("-", "_")

    def url(self, place: str, *, secure: bool) -> str:
        """Return the URL of a place.

        Args:
            place: what the option was given.
            secure: the server has a certificate.

        Raises:
            Failure: the address is one of another transport.
            InvalidAddress: it is none.
        """
        scheme = self.option.secure if secure and self.option.secure else self.scheme
        begins = tuple(f"{each}:" for each in (scheme, *aliases()))
        named = "://" in place or place.lower().startswith(begins)
        if self.option.ports and place.isascii() and place.isdecimal():
            place = f"127.0.0.1:{place}"
        url = place if named else f"{scheme}://{place}"
        found = parse_address(url).scheme
        if found != scheme:
            raise unusable(
                tr(
                    "--{option} {address}: that is an address of {scheme}",
                    option=self.scheme,
                    address=place,
                    scheme=found,
                ),
            )
        return url


def _offers() -> Iterator[ListenTransport]:
    for row in rows():
        if row.option is not None:
            yield ListenTransport(row.scheme, tr(row.option.help), row.option, row.http)
    taken = {row.scheme for row in rows()}
    for scheme, entry in entries().items():
        if scheme not in taken and scheme.replace("-", "_").isidentifier():
            text = tr("Address to listen on with {scheme}, of {place}; may be given again.", scheme=scheme, place=entry.value)  # fmt: skip
            yield ListenTransport(scheme, text, ServeOption(text))  # its package is imported when it is used


OFFERS: Final = tuple(_offers())


@dataclass(frozen=True)
class ListenAddresses:
    """What the options were given; each has a field, which :func:`places_class` adds."""

    def of(self, offer: ListenTransport) -> tuple[str, ...]:
        """Return what an option was given; for a flag that is set one place without a name."""
        given: tuple[str, ...] | bool = getattr(self, offer.name)
        if isinstance(given, bool):
            return ("",) if given else ()
        return given

    def given(self) -> Iterator[tuple[ListenTransport, str]]:
        """Yield each place, and the transport that it was given for."""
        for offer in OFFERS:
            for place in self.of(offer):
                yield offer, place


def places_class(first_help: str | None = None) -> type[ListenAddresses]:
    """Return the class with a field for each transport.

    Args:
        first_help: instead of the usual help of the option that has a default; then it has none.
    """
    fields: list[Any] = []
    for offer in OFFERS:
        first = DEFAULT_URL.startswith(f"{offer.scheme}://")
        text = first_help if first and first_help is not None else offer.help
        parameter = Parameter(
            help=text,
            group=HTTP if offer.http else LISTENING,
            show_default=_default if first and first_help is None else None,
        )
        kind: Any = bool if offer.option.flag else tuple[str, ...]
        default: Any = False if offer.option.flag else ()
        fields.append((offer.name, Annotated[kind, parameter], field(default=default)))
    # Python 3.11 gives the class the module "types", and cyclopts looks at no class of the interpreter's own
    namespace = {"__module__": __name__}
    made = make_dataclass("PlacesHere", fields, bases=(ListenAddresses,), frozen=True, namespace=namespace)
    return Parameter(name="*", group=LISTENING)(made)


def _default(_given: object) -> str:
    return DEFAULT_URL.partition("://")[2]
