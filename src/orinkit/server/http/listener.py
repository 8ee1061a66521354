"""Listener for e-CAP over HTTP or HTTPS.

The packages that HTTP requires are imported when a listener is opened.
"""

from __future__ import annotations

import asyncio
import logging
import ssl
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from orinkit.core import optional_deps
from orinkit.core.errors import ConnectFailed
from orinkit.core.i18n import tr
from orinkit.core.record import replaced
from orinkit.server.accepting import ONE_AT_A_TIME, StreamListener, start
from orinkit.server.context import ServerContext
from orinkit.server.http.options import HttpOptions
from orinkit.transport.address import HttpAddress

if TYPE_CHECKING:
    from uvicorn.config import Config

    from orinkit.server.http.app import App

logger = logging.getLogger("orinkit.server")

LEAST_TOKEN: Final = 16
"""Number of characters below which a token causes a warning."""


class HttpListener(StreamListener):
    """Accepts HTTP clients at one address."""

    @classmethod
    async def open(cls, address: HttpAddress, context: ServerContext, options: HttpOptions) -> Self:
        """Open a listening socket.

        Raises:
            OSError: If the address cannot be used.
            ValueError: If the host is not a valid host name.
            ConnectFailed: If the certificate for https is missing or cannot be used.
            MissingExtra: If uvicorn or starlette is not installed.
        """
        optional_deps.require(tr("e-CAP over HTTP"), "http", "starlette", "uvicorn")
        from uvicorn.server import ServerState

        from orinkit.server.http.app import App
        from orinkit.server.http.connection_limiter import ConnectionLimiter
        from orinkit.server.http.limits import LimitedProtocol
        from orinkit.server.http.tls import TlsAcceptor

        tls_context = _context(address, options) if address.scheme == "https" else None
        if ":" not in address.host:  # an IPv6 address requires no entry, because the Host header may be any address
            options = replaced(options, hosts=(*options.hosts, address.host))
        app = App(context, options, secure=tls_context is not None)
        config = _config(app)
        state = ServerState()
        state.tasks = context.tasks
        guard = ConnectionLimiter(context)

        def make() -> LimitedProtocol:
            return LimitedProtocol(guard, config, state)

        def accept() -> asyncio.BaseProtocol:
            context.opening += 1
            return make() if tls_context is None else TlsAcceptor(guard, tls_context, make)

        _warn_of_token(address, options)
        server = await asyncio.get_running_loop().create_server(
            accept, address.host, address.port, backlog=ONE_AT_A_TIME, reuse_address=True, start_serving=False
        )
        port = server.sockets[0].getsockname()[1]
        app.listens_at(port)
        await start(server)
        return cls(server, str(address._replace(port=port)))


def _warn_of_token(address: HttpAddress, options: HttpOptions) -> None:
    if 0 < len(options.token) < LEAST_TOKEN:
        logger.warning(
            tr("%s: the token has only %d characters and can be guessed. Try: use %d or more (openssl rand -hex 16)"),
            address,
            len(options.token),
            LEAST_TOKEN,
        )


def _config(app: App) -> Config:
    """Return the configuration of uvicorn's protocol; orinkit uses no other part of uvicorn."""
    from uvicorn.config import Config

    from orinkit.server.http.h11_connection import LONGEST_HEADER
    from orinkit.server.http.limits import LimitedProtocol

    config = Config(
        app,
        loop="none",
        http=LimitedProtocol,
        ws="none",
        lifespan="off",
        interface="asgi3",
        log_config=None,  # do not change the program's logging
        proxy_headers=False,  # a client could pretend to have another address
        server_header=False,
        date_header=False,
        workers=1,
        h11_max_incomplete_event_size=LONGEST_HEADER,
    )
    config.load()
    return config


def _context(address: HttpAddress, options: HttpOptions) -> ssl.SSLContext:
    """Return the TLS context of the server.

    Raises:
        ConnectFailed: If the certificate is missing, or cannot be used with its key.
    """
    if not options.cert:
        raise _unusable(address, tr("https requires a certificate"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(
            options.cert, options.key or None, password=lambda: ""
        )  # without the password argument, OpenSSL would ask for a password on the terminal
    except (OSError, ValueError) as error:
        raise _unusable(address, _reason(options, error)) from error
    return context


def _reason(options: HttpOptions, error: Exception) -> str:
    """Return the reason why the certificate and the key cannot be used.

    OpenSSL itself reports "PEM lib" for nearly every reason.
    """
    cert, key = options.cert, options.key or options.cert
    if isinstance(error, ssl.SSLError) and error.reason == "KEY_VALUES_MISMATCH":
        return tr("the key in {key} does not match the certificate in {cert}", key=key, cert=cert)
    try:
        certificates, keys = (Path(name).read_bytes() for name in (cert, key))
    except (OSError, ValueError) as unreadable:
        return str(unreadable)
    if b"CERTIFICATE-----" not in certificates:
        if b"CERTIFICATE-----" in keys:
            return tr("{cert} contains no certificate, but {key} does; they may be swapped", cert=cert, key=key)
        return tr("{cert} contains no certificate", cert=cert)
    if b"PRIVATE KEY-----" not in keys:
        return tr("{key} contains no private key", key=key)
    if b"ENCRYPTED" in keys:
        return tr("the key in {key} is protected by a password", key=key)
    return f"{', '.join(dict.fromkeys((cert, key)))}: {error}"


def _unusable(address: HttpAddress, reason: str) -> ConnectFailed:
    return ConnectFailed(
        tr(
            "cannot listen on {address}: {reason}. Try: pass PEM files of a certificate and of its key without "
            "a password: cert= (--cert), and key= (--key) if the key is in a separate "
            "file",
            address=address,
            reason=reason,
        )
    )
