"""Taking connections when the system has no more descriptors: one line in the log, and on again when there are some.

asyncio's selector loop calls ``accept`` as often as the backlog that it is told, goes on after an error, and logs a
traceback for each: 512 in a second. It is told a backlog of one; the kernel gets the real one.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
from typing import Any, Final

from orinkit.core.i18n import tr

logger = logging.getLogger("orinkit.server")

ONE_AT_A_TIME: Final = 1
"""Backlog to give to ``create_server``: how many connections are accepted in a turn of the loop."""
BACKLOG: Final = 512
"""Connections that the kernel keeps until they are accepted."""

_ACCEPT_TURNS: Final = 3
_EXHAUSTED: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


def deepen(server: asyncio.Server) -> None:
    """Give the kernel the real backlog of a server that accepts one connection at a time."""
    for each in server.sockets:
        with socket.socket(fileno=os.dup(each.fileno())) as twin:
            twin.listen(BACKLOG)


async def close(server: asyncio.Server) -> None:
    """Stop accepting connections, let those that are just being accepted become ready, and close the server.

    asyncio's selector loop accepts a connection, makes its protocol, and calls ``connection_made`` in one turn each. A server
    that is closed between the first two leaves the connection open.
    """
    loop = asyncio.get_running_loop()
    if isinstance(loop, asyncio.SelectorEventLoop):
        for each in server.sockets:
            loop.remove_reader(each.fileno())
        for _ in range(_ACCEPT_TURNS):
            await asyncio.sleep(0)
    server.close()


def watch(loop: asyncio.AbstractEventLoop) -> None:
    """Have a loop of orinkit's own log in one line that no connection can be accepted, without a traceback."""
    loop.set_exception_handler(_handle)


def _handle(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    error = context.get("exception")
    if isinstance(error, OSError) and error.errno in _EXHAUSTED and "accept" in str(context.get("message", "")):
        text = tr("no connection can be accepted for now: %s")
        logger.error(text, error.strerror)
    else:
        loop.default_exception_handler(context)
