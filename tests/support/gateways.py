"""What the tests of the gateway share: chains of gateways, waiting, and waiting less."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import orinkit
from orinkit.cao.provider import Provider
from orinkit.gateway import RemoteProvider, Upstream

LISTEN = "tcp://127.0.0.1:0"
HTTP = "http://127.0.0.1:0"
PATIENCE = 20.0


@contextmanager
def chain(
    provider: Provider,
    gateways: int = 1,
    between: str = LISTEN,
    made: list[RemoteProvider] | None = None,
    **options: Any,
) -> Iterator[str]:
    """Serve a provider behind so many gateways in a row; yields the address of the last one, which is TCP."""
    with ExitStack() as stack:
        url = stack.enter_context(orinkit.serve(provider, between if gateways == 1 else LISTEN)).url
        for left in reversed(range(gateways)):
            url = stack.enter_context(gateway(url, between if left else LISTEN, made, **options))
        yield url


@contextmanager
def gateway(url: str, listen: str = LISTEN, made: list[RemoteProvider] | None = None, **options: Any) -> Iterator[str]:
    """Serve a gateway to an address; yields its own, and adds it to those that were made."""
    provider = RemoteProvider(Upstream(url, **options))
    if made is not None:
        made.append(provider)
    with orinkit.serve(provider, listen) as server:
        yield server.url


def hurry(made: Iterable[RemoteProvider], seconds: float) -> None:
    """Have calls from gateways wait so long for their answers from now on: opening did not depend on a short time."""
    for provider in made:
        for connection in list(provider._connections):
            if connection._client is not None:
                connection._client.timeout = seconds
