"""What the tests of the gateway share: chains of gateways, and waiting."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import orinkit
from orinkit.cao.provider import Provider
from orinkit.gateway import RemoteProvider, Upstream

LISTEN = "tcp://127.0.0.1:0"
HTTP = "http://127.0.0.1:0"
PATIENCE = 20.0


@contextmanager
def chain(provider: Provider, gateways: int = 1, between: str = LISTEN, **options: Any) -> Iterator[str]:
    """Serve a provider behind so many gateways in a row; yields the address of the last one, which is TCP."""
    with ExitStack() as stack:
        url = stack.enter_context(orinkit.serve(provider, between if gateways == 1 else LISTEN)).url
        for left in reversed(range(gateways)):
            url = stack.enter_context(gateway(url, between if left else LISTEN, **options))
        yield url


@contextmanager
def gateway(url: str, listen: str = LISTEN, **options: Any) -> Iterator[str]:
    """Serve a gateway to an address; yields its own."""
    with orinkit.serve(RemoteProvider(Upstream(url, **options)), listen) as server:
        yield server.url
