"""A client on UDP that the controller has forgotten is told why its handles are no more."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import pytest

import orinkit
from both import Both
from devices import Recorder
from orinkit import aio
from orinkit import functions as f
from orinkit.bcap.wire import DATAGRAM
from orinkit.errors import InvalidHandle
from orinkit.server import udp
from orinkit.transport import aio_links, links
from orinkit.transport.address import parse_address


@pytest.mark.parametrize("silence", [0.0, 0.3])
def test_forgotten(both: Both, monkeypatch: pytest.MonkeyPatch, silence: float) -> None:
    monkeypatch.setattr(udp, "FORGOTTEN_AFTER", 0.1)
    wire = replace(DATAGRAM, memory=0.1)
    with orinkit.serve(Recorder(), "udp://127.0.0.1:0") as server:
        address = parse_address(server.url)
        link: Any = both.run((links if both.loop is None else aio_links).open_link(address, 1.0))
        kind: Any = orinkit.Client if both.loop is None else aio.AsyncClient
        client = kind(link, wire=wire)
        both.run(client.call(f.controller_connect, "", Recorder.provider_names[0], "", ""))
        time.sleep(silence)
        with pytest.raises(InvalidHandle) as caught:
            both.run(client.call(f.controller_get_name, 2 if silence else 99))
        assert ("forgets a client on UDP" in str(caught.value)) is (silence > 0)
        both.run(client.close())
