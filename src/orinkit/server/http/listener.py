"""Taking clients of e-CAP at one address, over HTTP or HTTPS.

The packages that HTTP needs are imported when a listener is opened.
"""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from orinkit.core import optional_deps
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.server import accepting
from orinkit.server.accepting import ONE_AT_A_TIME, deepen
from orinkit.server.context import ServerContext
from orinkit.server.http.options import HttpOptions
from orinkit.transport.address import HttpAddress
from orinkit.transport.fork_safety import keep_from_children

if TYPE_CHECKING:
    from uvicorn.config import Config

    from orinkit.server.http.app import App

logger = logging.getLogger("orinkit.server")

LEAST_TOKEN: Final = 16
"""Characters of a token below which it is warned of."""


class HttpListener:
    """Takes clients at one address.

    Attributes:
        url: with the real port.
    """

    def __init__(self, server: asyncio.Server, url: str) -> None:
        self._server = server
        self.url = url
        keep_from_children(self)

    @classmethod
    async def open(cls, address: HttpAddress, shared: ServerContext, options: HttpOptions) -> Self:
        """Listen.

        Raises:
            OSError: the address cannot be used.
            ValueError: the host is no host name.
            ConnectFailed: there is no certificate for https, or none that can be used.
            MissingExtra: uvicorn or starlette is missing.
        """
        optional_deps.require(tr("e-CAP over HTTP"), "http", "starlette", "uvicorn")
        from uvicorn.server import ServerState

        from orinkit.server.http.app import App
        from orinkit.server.http.limits import ConnectionLimiter, LimitedProtocol
        from orinkit.server.http.tls import TlsAcceptor

        context = _context(address, options) if address.scheme == "https" else None
        if ":" not in address.host:  # an IPv6 address needs no entry: any address is accepted as a Host
            options = replace(options, hosts=(*options.hosts, address.host))
        app = App(shared, options, secure=context is not None)
        config = _config(app)
        state = ServerState()
        state.tasks = shared.tasks
        guard = ConnectionLimiter(shared)

        def make() -> LimitedProtocol:
            return LimitedProtocol(guard, config, state)

        def accept() -> asyncio.BaseProtocol:
            shared.opening += 1
            return make() if context is None else TlsAcceptor(guard, context, make)

        _warn_of_token(address, options)
        server = await asyncio.get_running_loop().create_server(
            accept, address.host, address.port, backlog=ONE_AT_A_TIME, reuse_address=True, start_serving=False
        )
        port = server.sockets[0].getsockname()[1]
        app.listens_at(port)
        try:
            await server.start_serving()
            deepen(server)
        except BaseException:
            server.close()
            raise
        return cls(server, str(address._replace(port=port)))

    def left_behind(self) -> Iterable[int]:
        """Be left to the server in a child that it forks."""
        return [each.fileno() for each in self._server.sockets]

    async def close(self) -> None:
        """Take no more clients."""
        await accepting.close(self._server)


def _warn_of_token(address: HttpAddress, options: HttpOptions) -> None:
    if 0 < len(options.token) < LEAST_TOKEN:
        logger.warning(
            tr("%s: the token has %d characters and can be guessed. Try: %d or more; openssl rand -hex 16 makes one"),
            address,
            len(options.token),
            LEAST_TOKEN,
        )


def _config(app: App) -> Config:
    """Return uvicorn's configuration for its protocol; nothing else of uvicorn is used."""
    from uvicorn.config import Config

    from orinkit.server.http.limits import KEPT_ALIVE, LONGEST_HEADER, LimitedProtocol

    config = Config(
        app,
        loop="none",
        http=LimitedProtocol,
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


def _context(address: HttpAddress, options: HttpOptions) -> ssl.SSLContext:
    """Return the server's side of TLS.

    Raises:
        ConnectFailed: there is no certificate, or none that can be used with its key.
    """
    if not options.cert:
        raise _unusable(address, tr("https needs a certificate"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(options.cert, options.key or None, password=lambda: "")  # never asks on the terminal
    except (OSError, ValueError) as error:
        raise _unusable(address, _reason(options, error)) from error
    return context


def _reason(options: HttpOptions, error: Exception) -> str:
    """Return why certificate and key cannot be used; OpenSSL itself says "PEM lib" of nearly everything."""
    cert, key = options.cert, options.key or options.cert
    if isinstance(error, ssl.SSLError) and error.reason == "KEY_VALUES_MISMATCH":
        return tr("the key in {key} is not that of the certificate in {cert}", key=key, cert=cert)
    try:
        certificates, keys = (Path(name).read_bytes() for name in (cert, key))
    except (OSError, ValueError) as unreadable:
        return str(unreadable)
    if b"CERTIFICATE-----" not in certificates:
        if b"CERTIFICATE-----" in keys:
            return tr("{cert} has no certificate in it, {key} has one: exchange them", cert=cert, key=key)
        return tr("{cert} has no certificate in it", cert=cert)
    if b"PRIVATE KEY-----" not in keys:
        return tr("{key} has no private key in it", key=key)
    if b"ENCRYPTED" in keys:
        return tr("the key in {key} has a password", key=key)
    return f"{', '.join(dict.fromkeys((cert, key)))}: {error}"


def _unusable(address: HttpAddress, reason: str) -> ConnectFailed:
    return ConnectFailed(
        tr(
            "cannot listen on {address}: {reason}. Try: PEM files of a certificate and of its key, "
            "which has no password: cert= (--cert), and key= (--key) if the key is in a file of its "
            "own",
            address=address,
            reason=reason,
        )
    )
