"""What a URL says to a client: where to connect, which protocol is spoken there, how long it may take."""

from __future__ import annotations

from time import monotonic
from typing import TYPE_CHECKING, Final, Protocol, Self, TypeAlias, TypeVar, runtime_checkable

from orinkit.bcap.client import BcapConversation
from orinkit.bcap.profiles import BcapProfile
from orinkit.cao.replies import Trace
from orinkit.cao.transport_profile import TransportProfile
from orinkit.client._shared.common import check_timeout, check_tries
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.transport.address import parse_address
from orinkit.transport.credentials import Credentials
from orinkit.transport.links import refused
from orinkit.transport.registry import AnyAddress, resolve, row_of, rows
from orinkit.values.codec import PacketLimits

if TYPE_CHECKING:
    from orinkit.ecap.client import EcapConversation as EcapConversation

    AnyConversation: TypeAlias = BcapConversation | EcapConversation

L = TypeVar("L")
_LEAST_DEADLINE: Final = 3.0  # s
_LEAST_OPENING: Final = 1.0  # s: a name may have to be looked up, however short the time-outs are


def opening_of(url: str, timeout: float | None, tries: int) -> tuple[AnyAddress, TransportProfile, float]:
    """Return what a URL says, how calls travel there, and how many seconds opening the link may take.

    Args:
        url: of the controller.
        timeout: seconds of a try, ``None`` for what is usual on the profile.
        tries: how often a request is sent.

    Raises:
        InvalidAddress: the URL cannot be used by a client.
        InvalidValue: timeout or tries cannot be used.
    """
    address = parse_address(url)
    row = row_of(address)
    if not row.profile:
        raise refused(address)
    profile: TransportProfile = resolve(row.profile)
    seconds, times = check_timeout(profile.timeout if timeout is None else timeout), check_tries(tries)
    return address, profile, max(seconds * times, _LEAST_OPENING) if profile.lossy else seconds


def closing_deadline(timeout: float, tries: int, profile: TransportProfile) -> float:
    """Return the seconds that connecting, or closing, may take in all unless the program says otherwise."""
    return max(3 * timeout * (tries if profile.lossy else 1), _LEAST_DEADLINE)


def conversation(profile: TransportProfile, limits: PacketLimits, trace: Trace | None) -> AnyConversation:
    """Return the conversation for a way that calls travel: b-CAP, or e-CAP."""
    if isinstance(profile, BcapProfile):
        return BcapConversation(limits, trace, profile, clock=monotonic)
    from orinkit.ecap.client import EcapConversation as EcapConversation

    return EcapConversation(limits, trace, profile, clock=monotonic)


@runtime_checkable
class _RepeatableLink(Protocol):
    """A link over which a call cannot be left alone while something else is said."""

    def another(self) -> Self: ...

    def close(self) -> None: ...


def parting(link: L) -> L:
    """Return the link to take leave over.

    Where that cannot be done beside a call that another thread or task may have at work, it is another link to the same
    place, and this one is closed: the call ends, and no other one can come in between.
    """
    if isinstance(link, _RepeatableLink):
        link.close()
        return link.another()
    return link


@runtime_checkable
class _ShareableLink(Protocol):
    """A link over which something can be sent while a call is under way."""

    def share(self) -> None: ...

    def beside(self, data: bytes) -> None: ...


def share(link: object) -> None:
    """Prepare a link for :func:`beside`."""
    if isinstance(link, _ShareableLink):
        link.share()


def beside(link: object, data: bytes) -> None:
    """Send something over a link on which a call is under way, if that can be done; not over one that is lent."""
    if isinstance(link, _ShareableLink):
        link.beside(data)


def another(link: L) -> L | None:
    """Return another link for the same client to the same place, ``None`` where there can be none."""
    return link.another() if isinstance(link, _RepeatableLink) else None


def access_to(address: AnyAddress, token: str, cafile: str) -> Credentials:
    """Return what a client shows to a server.

    Raises:
        InvalidValue: there is something that is not for this kind of address.
    """
    if (token or cafile) and not row_of(address).http:
        schemes = ", ".join(f"{row.scheme}://" for row in rows() if row.http)
        raise InvalidValue(
            tr("token and cafile are for {schemes}; b-CAP at {address} has none", schemes=schemes, address=address)
        )
    return Credentials(token, cafile)
