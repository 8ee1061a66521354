"""The two drivers, side by side: one protocol operation, on the caller's own thread or in asyncio.

An operation is a generator as :meth:`orinkit.bcap.client.BcapConversation.call`: it yields bytes to send and how many
seconds to wait for an answer, and is sent what was received. Beside them, waiting without receiving: :func:`pause`,
:func:`apause`, and :class:`Deadline` for how long.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from time import monotonic, sleep
from typing import Protocol, TypeAlias, TypeVar

from orinkit.core.errors import OrinError, StreamError
from orinkit.core.i18n import tr

T = TypeVar("T")
_GOODBYE = 0.1  # s for each packet of a close_sequence
Operation: TypeAlias = Generator[tuple[bytes, float | None], bytes | None, T]
ClosePacket: TypeAlias = tuple[bytes, float]
"""Something to send before a link is closed, and how many seconds to wait for an answer."""


class Link(Protocol):
    """A way to the other side, used by one thread at a time."""

    def send(self, data: bytes, seconds: float) -> None:
        """Send all of the bytes within the seconds."""

    def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, ``None`` when the seconds have passed."""

    def fileno(self) -> int:
        """Descriptor, to be lent to another process."""

    def release(self) -> None:
        """Close it in this process only: in another one that has it too the connection goes on."""

    def close(self) -> None:
        """Close; may be called again."""


class AsyncLink(Protocol):
    """The same for asyncio."""

    def send(self, data: bytes) -> None:
        """Send all of the bytes; they are queued whole, so a cancelled task cannot send half of them."""

    async def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes, ``b""`` at the end of the stream, ``None`` when the seconds have passed."""

    def fileno(self) -> int:
        """Descriptor, to be lent to another process; nothing is received here until the next call."""

    def release(self) -> None:
        """Close it in this process only: in another one that has it too the connection goes on."""

    def close(self) -> None:
        """Close; may be called again."""


class DetachedLink:
    """Stands for a link that another process has: nothing can be sent over it."""

    def __init__(self, link: Link, closing: Callable[[], None]) -> None:
        self.link = link
        self._closing = closing

    def send(self, data: bytes, seconds: float) -> None:  # noqa: ARG002 - as of every link
        """Refuse.

        Raises:
            StreamError: always.
        """
        raise _lent()

    def receive(self, seconds: float) -> bytes | None:  # noqa: ARG002
        """Refuse, as :meth:`send`."""
        raise _lent()

    def fileno(self) -> int:
        """Refuse, as :meth:`send`."""
        raise _lent()

    def release(self) -> None:
        """Close the link itself, in this process."""
        self.link.release()

    def close(self) -> None:
        """Have the other process give it up in good order, and close it here."""
        self._closing()
        self.link.release()


class AsyncDetachedLink:
    """The same for asyncio."""

    def __init__(self, link: AsyncLink, closing: Callable[[], None]) -> None:
        self.link = link
        self._closing = closing

    def send(self, data: bytes) -> None:  # noqa: ARG002 - as of every link
        """Refuse.

        Raises:
            StreamError: always.
        """
        raise _lent()

    async def receive(self, seconds: float) -> bytes | None:  # noqa: ARG002
        """Refuse, as :meth:`send`."""
        raise _lent()

    def fileno(self) -> int:
        """Refuse, as :meth:`send`."""
        raise _lent()

    def release(self) -> None:
        """Close the link itself, in this process."""
        self.link.release()

    def close(self) -> None:
        """Have the other process give it up in good order, and close it here."""
        self._closing()
        self.link.release()


def _lent() -> StreamError:
    return StreamError(
        tr(
            "the connection is in slave mode: it carries nothing but set-points until the block "
            "ends. Try: the stream's own feedback, or another connection"
        )
    )


def run(operation: Operation[T], link: Link, close_sequence: Callable[[], Iterable[ClosePacket]] = tuple) -> T:
    """Carry out an operation on the caller's thread and return its result.

    An exception from outside in the middle of it, such as KeyboardInterrupt, closes the link: bytes may have been
    received and lost, and what follows could no longer be told apart.

    Args:
        operation: what to do.
        link: to do it over.
        close_sequence: gives what to send before the link is closed by such an exception.
    """
    received: bytes | None = None
    deadline = 0.0
    sent = False
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
            finally:  # who is interrupted once more does not wait for an answer to that
                link.close()
        raise


def send_close(link: Link, packets: Iterable[ClosePacket]) -> None:
    """Send packets, and wait for their answers where that is asked for; a link that is broken or closed is no error."""
    try:
        for data, seconds in packets:
            link.send(data, _GOODBYE)
            if seconds:
                link.receive(seconds)
    except OrinError:
        pass


async def asend_close(link: AsyncLink, packets: Iterable[ClosePacket]) -> None:
    """The same in asyncio."""
    try:
        for data, seconds in packets:
            link.send(data)
            if seconds:
                await link.receive(seconds)
    except OrinError:
        pass


async def arun(
    operation: Operation[T], link: AsyncLink, close_sequence: Callable[[], Iterable[ClosePacket]] = tuple  # noqa: ARG001 - as run
) -> T:
    """Carry out an operation in asyncio and return its result; one that is cancelled leaves the link as it is."""
    received: bytes | None = None
    deadline = 0.0
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


def pause(seconds: float) -> None:
    """Wait on the caller's thread; nothing is received meanwhile."""
    sleep(max(0.0, seconds))


async def apause(seconds: float) -> None:
    """Wait in asyncio."""
    import asyncio  # a synchronous program needs none

    await asyncio.sleep(max(0.0, seconds))


class Deadline:
    """A limit on how long something may take.

    Args:
        seconds: from now on; ``None`` for no limit.
    """

    __slots__ = ("_end",)

    def __init__(self, seconds: float | None) -> None:
        self._end = float("inf") if seconds is None else monotonic() + seconds

    @property
    def left(self) -> float:
        """Seconds that are left, infinite where there is no limit, never below 0."""
        return max(0.0, self._end - monotonic())

    @property
    def passed(self) -> bool:
        """Whether no time is left."""
        return not self.left
