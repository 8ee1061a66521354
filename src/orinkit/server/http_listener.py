"""Taking clients of e-CAP at one address, over HTTP or HTTPS.

The packages that HTTP needs are imported when a listener is opened.
"""

from __future__ import annotations

import asyncio
import ssl
from typing import TYPE_CHECKING, Final, Self

from orinkit import extra
from orinkit.language import pick
from orinkit.server.connections import Connections
from orinkit.server.http_options import HttpOptions
from orinkit.transport.address import HttpAddress

if TYPE_CHECKING:
    from uvicorn.config import Config

    from orinkit.server.http_app import App

_BACKLOG: Final = 512


class HttpListener:
    """Takes clients at one address.

    Attributes:
        url: with the real port.
    """

    def __init__(self, server: asyncio.Server, url: str) -> None:
        self._server = server
        self.url = url

    @classmethod
    async def open(cls, address: HttpAddress, shared: Connections, options: HttpOptions) -> Self:
        """Listen.

        Raises:
            OSError: the address cannot be used.
            ValueError: the host is no host name; there is no certificate for https, or none that can be used.
            MissingExtra: uvicorn or starlette is missing.
        """
        extra.require(("HTTP", "HTTP "), "http", "starlette", "uvicorn")
        from uvicorn.server import ServerState

        from orinkit.server.http_app import App
        from orinkit.server.http_guard import Entrance, Guard, GuardedProtocol

        context = _context(options) if address.scheme == "https" else None
        app = App(shared, options, secure=context is not None)
        config = _config(app)
        state = ServerState()
        state.tasks = shared.tasks
        guard = Guard(shared)

        def make() -> GuardedProtocol:
            return GuardedProtocol(guard, config, state)

        def accept() -> asyncio.BaseProtocol:
            shared.opening += 1
            return make() if context is None else Entrance(guard, context, make)

        server = await asyncio.get_running_loop().create_server(
            accept, address.host, address.port, backlog=_BACKLOG, reuse_address=True, start_serving=False
        )
        port = server.sockets[0].getsockname()[1]
        app.listens_at(port)
        try:
            await server.start_serving()
        except BaseException:
            server.close()
            raise
        return cls(server, str(address._replace(port=port)))

    async def close(self) -> None:
        """Take no more clients."""
        self._server.close()


def _config(app: App) -> Config:
    """Return uvicorn's configuration for its protocol; nothing else of uvicorn is used."""
    from uvicorn.config import Config

    from orinkit.server.http_guard import KEPT_ALIVE, LONGEST_HEADER, GuardedProtocol

    config = Config(
        app,
        loop="none",
        http=GuardedProtocol,
        ws="none",
        lifespan="off",
        interface="asgi3",
        log_config=None,  # a program's logging is its own
        proxy_headers=False,  # a client says with them that it is another one
        server_header=False,
        date_header=False,
        workers=1,
        timeout_keep_alive=int(KEPT_ALIVE),
        h11_max_incomplete_event_size=LONGEST_HEADER,
    )
    config.load()
    return config


def _context(options: HttpOptions) -> ssl.SSLContext:
    if not options.cert:
        raise ValueError(pick("https needs a certificate (cert)", "https には証明書 (cert) が必要です"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(options.cert, options.key or None, password=lambda: "")  # never asks on the terminal
    except (OSError, ValueError) as error:
        files = f"{options.cert}, {options.key}" if options.key else options.cert
        reason = pick(
            "PEM files of a certificate and of its key, which has no password, are needed",
            "証明書と、パスワードなしの秘密鍵の PEM ファイルが必要です",
        )
        raise ValueError(f"{files}: {error}: {reason}") from error
    return context
