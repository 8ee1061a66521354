"""Connection parameters that a client derives from the URL of a controller: address, protocol and time limits."""

from __future__ import annotations

from time import monotonic
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TypeAlias, TypeVar, runtime_checkable

from orinkit.bcap.client import BcapConversation, RawOperation
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
_UTF_8: Final = "utf-8"
_MIN_DEADLINE: Final = 3.0  # s
_MIN_OPEN_TIMEOUT: Final = 1.0  # s, because name resolution takes time


def opening_of(url: str, timeout: float | None, tries: int) -> tuple[AnyAddress, TransportProfile, float]:
    """Return the address in a URL, the properties of its transport, and the time limit in s for opening the connection.

    Args:
        url: URL of the controller.
        timeout: Time-out of one attempt in s; ``None`` for the default of the transport.
        tries: Maximum number of times that a request is sent.

    Raises:
        InvalidAddress: If the URL is not an address that clients can connect to.
        InvalidValue: If timeout or tries is invalid.
    """
    address = parse_address(url)
    row = row_of(address)
    if not row.profile:
        raise refused(address)
    profile: TransportProfile = resolve(row.profile)
    seconds, times = check_timeout(profile.timeout if timeout is None else timeout), check_tries(tries)
    return address, profile, max(seconds * times, _MIN_OPEN_TIMEOUT) if profile.lossy else seconds


def connection_deadline(timeout: float, tries: int, profile: TransportProfile) -> float:
    """Return the default deadline in s for connecting and for closing."""
    return max(3 * timeout * (tries if profile.lossy else 1), _MIN_DEADLINE)


def conversation(
    profile: TransportProfile, limits: PacketLimits, trace: Trace | None, charset: str = _UTF_8
) -> AnyConversation:
    """Create the conversation, b-CAP or e-CAP, for the transport that a profile describes.

    Args:
        profile: Properties of the transport.
        limits: Limits on the size of received packets and on the values in them.
        trace: Callback invoked with every packet or body.
        charset: Encoding of text over e-CAP.

    Raises:
        InvalidValue: If the encoding is not supported.
    """
    if isinstance(profile, BcapProfile):
        return BcapConversation(limits, trace, profile, clock=monotonic)
    from orinkit.ecap.client import EcapConversation as EcapConversation
    from orinkit.ecap.fields import find_charset

    found = find_charset(charset)
    if found is None:
        raise InvalidValue(tr('charset must be "utf-8" or "shift_jis", not {charset!r:.40}', charset=charset))
    return EcapConversation(limits, trace, profile, clock=monotonic, charset=found)


def raw_operation(by: AnyConversation, data: bytes, seconds: float) -> RawOperation:
    """Return the operation that sends bytes unchanged.

    Raises:
        InvalidValue: If the conversation is not b-CAP.
    """
    if isinstance(by, BcapConversation):
        return by.raw(data, seconds)
    raise InvalidValue(tr("e-CAP over HTTP has no packets. Try: tcp://, udp:// or serial://"))


@runtime_checkable
class _RepeatableLink(Protocol):
    """A link on which nothing else can be sent during a call; instead, it can open a second link to its address."""

    def another(self) -> Self: ...

    def close(self) -> None: ...


def link_for_closing(link: L) -> L:
    """Return the link over which to send the closing requests.

    If ``link`` can send nothing during a call of another thread or task, it is closed, which ends that call. A new link
    to the same address is then returned; no other call can use the new link. Any other ``link`` is returned itself.
    """
    if isinstance(link, _RepeatableLink):
        link.close()
        return link.another()
    return link


@runtime_checkable
class _ConcurrentLink(Protocol):
    """A link on which data can be sent during a call."""

    def enable_concurrent_send(self) -> None: ...

    def send_concurrently(self, data: bytes) -> None: ...


@runtime_checkable
class _GuardedLink(Protocol):
    """A link that other threads can close during a call."""

    def guard(self, lock: Any) -> None: ...


def guard(link: object, lock: object) -> None:
    """Let a link keep its descriptor open while another thread holds the lock of a client; do nothing in asyncio."""
    if isinstance(link, _GuardedLink):
        link.guard(lock)


def enable_concurrent_send(link: object) -> None:
    """Prepare a link for :func:`send_during_call`."""
    if isinstance(link, _ConcurrentLink):
        link.enable_concurrent_send()


def send_during_call(link: object, data: bytes) -> None:
    """Send data on a link while a call is executing. If the link does not support this, or is detached, do nothing."""
    if isinstance(link, _ConcurrentLink):
        link.send_concurrently(data)


@runtime_checkable
class _PatientLink(Protocol):
    """A link that waits longer than the time-out of a call if the server cannot report that the call is executing."""

    def limit_patience(self, seconds: float) -> None: ...


def limit_patience(link: object, seconds: float) -> None:
    """Limit the time for which a link waits for the reply to its next request, s.

    A link that never waits longer than the time-out of a call requires no limit.
    """
    if isinstance(link, _PatientLink):
        link.limit_patience(seconds)


def another(link: L) -> L | None:
    """Return a second link of the same client to the same address; ``None`` if the link does not support this."""
    return link.another() if isinstance(link, _RepeatableLink) else None


def access_to(address: AnyAddress, token: str, cafile: str, charset: str = "") -> Credentials:
    """Return the credentials of a client.

    Raises:
        InvalidValue: If token, cafile or charset is given for an address that is not HTTP.
    """
    if (token or cafile) and not row_of(address).http:
        schemes = ", ".join(f"{row.scheme}://" for row in rows() if row.http)
        raise InvalidValue(
            tr("token and cafile require {schemes}; {address} uses b-CAP", schemes=schemes, address=address)
        )
    if charset and charset.lower() != _UTF_8 and not row_of(address).http:
        raise InvalidValue(tr("charset requires http:// or https://; text over b-CAP is UTF-16"))
    return Credentials(token, cafile, charset if row_of(address).http and charset.lower() != _UTF_8 else "")
