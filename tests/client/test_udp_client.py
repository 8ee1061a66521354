"""Errors of a UDP client that the controller has forgotten explain why its handles are invalid."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit import functions as f
from orinkit.bcap.profiles import DATAGRAM
from orinkit.core.errors import InvalidHandle
from orinkit.server import udp
from orinkit.server.threaded import Server
from orinkit.transport import aio_links, links
from orinkit.transport.address import parse_address
from orinkit.transport.registry import LinkOptions
from support.both import Both
from support.devices import Recorder
from support.waiting import until


@pytest.mark.parametrize("silent", [False, True])
def test_forgotten(both: Both, monkeypatch: pytest.MonkeyPatch, silent: bool) -> None:
    wire = replace(DATAGRAM, session_timeout=0.1) if silent else DATAGRAM
    with orinkit.serve(Recorder(), "udp://127.0.0.1:0") as server:
        address = parse_address(server.url)
        link: Any = both.run((links if both.loop is None else aio_links).open_link(address, LinkOptions(10.0)))
        kind: Any = orinkit.Client if both.loop is None else aio.AsyncClient
        client = kind(link, profile=wire, timeout=10.0)
        both.run(client.call(f.controller_connect, "", Recorder.provider_names[0], "", ""))
        if silent:
            forget_clients(server, monkeypatch)
            time.sleep(0.1)  # the client also assumes that it was forgotten
        with pytest.raises(InvalidHandle) as caught:
            both.run(client.call(f.controller_get_name, 2 if silent else 99))
        assert ("over UDP, a controller releases a client" in str(caught.value)) is silent
        both.run(client.close())


def forget_clients(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a server forget its clients, as after a long idle period."""

    def look() -> None:
        for caller in list(server._server._context.open):
            caller._check_idle_time()

    with monkeypatch.context() as patched:
        patched.setattr(udp, "IDLE_TIMEOUT", 0.0)
        server._loop.call_soon_threadsafe(look)
        until(lambda: server.clients == 0)
