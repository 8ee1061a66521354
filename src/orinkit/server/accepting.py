"""Accepts connections; if file descriptors run out, logs one line and resumes as soon as descriptors are available.

In each of its turns, asyncio's selector loop calls ``accept`` up to ``backlog`` times. If descriptors run out, the loop
continues after each error and logs a traceback for each error: with a backlog of 512, up to 512 per second. Therefore
asyncio is passed a backlog of one, and only the kernel is passed the actual backlog.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
from collections.abc import Iterable
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.transport.fork_safety import keep_from_children

logger = logging.getLogger("orinkit.server")

ONE_AT_A_TIME: Final = 1
"""Backlog for ``create_server``: the number of connections accepted per turn of the event loop."""
BACKLOG: Final = 512
"""Number of connections that the kernel queues until they are accepted."""

_ACCEPT_TURNS: Final = 3
_EXHAUSTED: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


async def start(server: asyncio.Server) -> None:
    """Begin to accept connections; if this fails or is cancelled, close the server.

    A server that ``create_server`` has started itself would remain open if it was cancelled meanwhile.

    Args:
        server: a server with the backlog :data:`ONE_AT_A_TIME`, created with ``start_serving=False``. The kernel's
            backlog is set to :data:`BACKLOG`.

    Raises:
        OSError: If the address is in use.
    """
    try:
        await server.start_serving()
        for each in server.sockets:
            with socket.socket(fileno=os.dup(each.fileno())) as twin:
                twin.listen(BACKLOG)
    except BaseException:
        server.close()
        raise


async def close(server: asyncio.Server) -> None:
    """Stop accepting connections, finish those that are being accepted, and close the server.

    asyncio's selector loop requires three turns for a connection: it accepts the connection, creates its protocol, and
    calls ``connection_made``. If the server is closed between the first two turns, the connection stays open.
    """
    loop = asyncio.get_running_loop()
    if isinstance(loop, asyncio.SelectorEventLoop):
        for each in server.sockets:
            loop.remove_reader(each.fileno())
        for _ in range(_ACCEPT_TURNS):
            await asyncio.sleep(0)
    server.close()


class StreamListener:
    """Accepts clients at one address: the base class of the listeners that use a server of asyncio.

    Attributes:
        url: the address, with the actual port.
    """

    def __init__(self, server: asyncio.Server, url: str) -> None:
        self._server = server
        self.url = url
        keep_from_children(self)

    def after_fork_in_child(self) -> Iterable[int]:
        """Return the descriptors that a forked child replaces by the null device."""
        return [each.fileno() for each in self._server.sockets]

    async def close(self) -> None:
        """Stop accepting clients."""
        await close(self._server)


def install_exception_handler(loop: asyncio.AbstractEventLoop) -> None:
    """Install a handler in an event loop of orinkit that logs a failed ``accept`` in one line, without a traceback."""
    loop.set_exception_handler(_handle)


def _handle(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    error = context.get("exception")
    if isinstance(error, OSError) and error.errno in _EXHAUSTED and "accept" in str(context.get("message", "")):
        text = tr("cannot accept connections at the moment: %s")
        logger.error(text, error.strerror)
    else:
        loop.default_exception_handler(context)
