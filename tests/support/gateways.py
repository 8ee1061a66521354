"""Helpers of the tests of gateways: chains of gateways, and time-outs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import orinkit
from orinkit.cao.provider import Provider
from orinkit.gateway import RemoteProvider, Upstream
from orinkit.server.threaded import Server

LISTEN = "tcp://127.0.0.1:0"
HTTP = "http://127.0.0.1:0"
PATIENCE = 20.0
SILENCE = 600.0
"""Seconds for which a client may be silent. A gateway infers motions from calls; the default of 2 s is too short for a
test whose process gets little processor time."""


@contextmanager
def chain(
    provider: Provider,
    gateways: int = 1,
    between: str = LISTEN,
    made: list[RemoteProvider] | None = None,
    **options: Any,
) -> Iterator[str]:
    """Serve a provider behind a chain of gateways; yields the TCP address of the last one."""
    with ExitStack() as stack:
        url = stack.enter_context(_serve(provider, between if gateways == 1 else LISTEN)).url
        for left in reversed(range(gateways)):
            url = stack.enter_context(gateway(url, between if left else LISTEN, made, **options))
        yield url


@contextmanager
def gateway(url: str, listen: str = LISTEN, made: list[RemoteProvider] | None = None, **options: Any) -> Iterator[str]:
    """Serve a gateway to an address; yields the gateway's address and appends its provider to ``made``."""
    provider = RemoteProvider(Upstream(url, **options))
    if made is not None:
        made.append(provider)
    with _serve(provider, listen) as server:
        yield server.url


def _serve(provider: Provider, listen: str) -> Server:
    return orinkit.serve(provider, listen, alive=SILENCE)


def hurry(made: Iterable[RemoteProvider], seconds: float) -> None:
    """Set the time-out of the calls of gateways after connecting, so that connecting does not depend on a short one."""
    for provider in made:
        for connection in list(provider._connections):
            if connection._client is not None:
                connection._client.timeout = seconds
