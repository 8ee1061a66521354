"""The two runners of protocol operations: on the caller's thread (:func:`run`), and in asyncio (:func:`arun`).

An operation is a generator such as :meth:`orinkit.bcap.client.BcapConversation.call`. It yields the bytes to send and
the time in s to wait for a reply. The runner sends these bytes, and passes the received bytes to the generator. The
module also contains :func:`sleep` and :func:`asleep`, which wait without receiving, and :class:`Deadline`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable
from time import monotonic
from typing import Generic, Protocol, TypeAlias, TypeVar

from orinkit.core.errors import OrinError, StreamError
from orinkit.core.i18n import tr

T = TypeVar("T")
_GOODBYE = 0.1  # time-out for sending each packet of a close_sequence, s
Operation: TypeAlias = Generator[tuple[bytes, float | None], bytes | None, T]
ClosePacket: TypeAlias = tuple[bytes, float]
"""A packet to send before a link is closed, and the time in s to wait for its reply; 0 to not wait."""


class Link(Protocol):
    """A synchronous connection to a peer, used by one thread at a time."""

    def send(self, data: bytes, seconds: float) -> None:
        """Send all bytes within the given seconds."""

    def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, or ``None`` if the time has passed."""

    def fileno(self) -> int:
        """Return the descriptor, so that another process can take it over."""

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""

    def close(self) -> None:
        """Close the link; calls after the first have no effect."""


class AsyncLink(Protocol):
    """A connection to a peer, in asyncio."""

    def send(self, data: bytes) -> None:
        """Queue all bytes for sending in one step, so that a cancelled task cannot send only a part of them."""

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, or ``None`` if the time has passed."""

    def fileno(self) -> int:
        """Return the descriptor, so that another process can take it over.

        This process receives nothing until the next call of :meth:`receive`.
        """

    def close_local(self) -> None:
        """Close the link in this process only; the connection stays open in another process that has it."""

    def close(self) -> None:
        """Close the link; calls after the first have no effect."""


L = TypeVar("L", Link, AsyncLink)


class _Handed(Generic[L]):
    """Placeholder for a link that another process has taken over.

    Args:
        link: The link; this process still has its descriptor.
        closing: Callback that requests the other process to close the link.
    """

    def __init__(self, link: L, closing: Callable[[], None]) -> None:
        self.link: L = link
        self._closing = closing

    def fileno(self) -> int:
        """Raise StreamError, because another process uses the link.

        Raises:
            StreamError: Always.
        """
        raise _handed_over()

    def close_local(self) -> None:
        """Close the underlying link in this process."""
        self.link.close_local()

    def close(self) -> None:
        """Request the other process to close the link, and close the link in this process."""
        self._closing()
        self.link.close_local()


class DetachedLink(_Handed[Link]):
    """Placeholder for a link that another process has taken over; it can neither send nor receive."""

    def send(self, data: bytes, seconds: float) -> None:
        """Raise StreamError, as :meth:`fileno`."""
        raise _handed_over()

    def receive(self, seconds: float) -> bytes | None:
        """Raise StreamError, as :meth:`fileno`."""
        raise _handed_over()

    def exchange(self, data: bytes, seconds: float) -> bytes | None:
        """Raise StreamError, as :meth:`fileno`."""
        raise _handed_over()


class AsyncDetachedLink(_Handed[AsyncLink]):
    """Placeholder for a link that another process has taken over, in asyncio; it can neither send nor receive."""

    def send(self, data: bytes) -> None:
        """Raise StreamError, as :meth:`fileno`."""
        raise _handed_over()

    async def receive(self, seconds: float) -> bytes | None:
        """Raise StreamError, as :meth:`fileno`."""
        raise _handed_over()

    async def exchange(self, data: bytes, seconds: float) -> bytes | None:
        """Raise StreamError, as :meth:`fileno`."""
        raise _handed_over()


def _handed_over() -> StreamError:
    return StreamError(
        tr(
            "the connection is in slave mode: it carries only set-points until the with block ends. Try: use the "
            "feedback of the stream, or another connection"
        )
    )


def run(
    operation: Operation[T],
    link: Link,
    close_sequence: Callable[[], Iterable[ClosePacket]] = tuple,
    end: float | None = None,
) -> T:
    """Run an operation on the caller's thread and return its result.

    An exception that interrupts the operation, such as KeyboardInterrupt, closes the link if something was sent. In
    this case received bytes may have been lost, so that later replies could not be matched to requests.

    Args:
        operation: The operation.
        link: The link to use.
        close_sequence: Callback that returns the packets to send before an interrupting exception closes the link.
        end: End of the current wait (``time.monotonic``), if the operation continues a call whose request was sent.
    """
    received: bytes | None = None
    deadline = end or 0.0
    sent = end is not None
    try:
        while True:
            data, seconds = operation.send(received)
            if seconds is None:
                seconds = deadline - monotonic()
            else:
                deadline = monotonic() + seconds
            if data:
                sent = True
                link.send(data, seconds)
            received = link.receive(seconds) if seconds > 0 else None
    except StopIteration as stop:
        result: T = stop.value
        return result
    except OrinError:
        raise
    except BaseException:
        if sent:
            try:
                send_close(link, close_sequence())
            finally:  # a second interrupt skips the wait for the replies
                link.close()
        raise


def send_close(link: Link, packets: Iterable[ClosePacket]) -> None:
    """Send packets and wait for their replies if required; a lost or closed connection is not an error."""
    try:
        for data, seconds in packets:
            link.send(data, _GOODBYE)
            if seconds:
                link.receive(seconds)
    except OrinError:
        pass


async def asend_close(link: AsyncLink, packets: Iterable[ClosePacket]) -> None:
    """Send packets, as :func:`send_close`, in asyncio."""
    try:
        for data, seconds in packets:
            link.send(data)
            if seconds:
                await link.receive(seconds)
    except OrinError:
        pass


async def arun(
    operation: Operation[T],
    link: AsyncLink,
    close_sequence: Callable[[], Iterable[ClosePacket]] = tuple,  # noqa: ARG001 - same signature as run
    end: float | None = None,
) -> T:
    """Run an operation in asyncio, as :func:`run`, and return its result; cancelling it does not close the link."""
    received: bytes | None = None
    deadline = end or 0.0
    try:
        while True:
            data, seconds = operation.send(received)
            if data:
                link.send(data)
            if seconds is None:
                seconds = deadline - monotonic()
            else:
                deadline = monotonic() + seconds
            received = await link.receive(seconds) if seconds > 0 else None
    except StopIteration as stop:
        result: T = stop.value
        return result


def sleep(seconds: float) -> None:
    """Block the caller's thread for the given seconds, without receiving."""
    time.sleep(max(0.0, seconds))


async def asleep(seconds: float) -> None:
    """Sleep for the given seconds in asyncio."""
    import asyncio  # synchronous programs do not require it

    await asyncio.sleep(max(0.0, seconds))


class Deadline:
    """A point in time by which a call must have ended.

    Args:
        seconds: Time from now, s; ``None`` for no limit.
    """

    __slots__ = ("_end",)

    def __init__(self, seconds: float | None) -> None:
        self._end = float("inf") if seconds is None else monotonic() + seconds

    @property
    def left(self) -> float:
        """The remaining time, s; infinite if there is no limit, 0 if the deadline has passed."""
        return max(0.0, self._end - monotonic())

    @property
    def passed(self) -> bool:
        """True if no time is left."""
        return not self.left
