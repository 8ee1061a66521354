"""send_raw(): bytes on the connection of a client."""

from __future__ import annotations

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.core.errors import ConnectionClosed, ConnectionLost, InvalidValue
from orinkit.raw.packets import assemble
from orinkit.virtual.rc8 import VirtualRC8
from support.both import only
from support.peers import BadPeer, Line


@only("tcp", "udp", "serial", because="e-CAP has no packets")
def test_a_raw_packet_and_calls_alternate(both, listen_at):
    device = VirtualRC8()
    with orinkit.serve(device, listen_at) as server:
        controller = both.connect(server.url, timeout=30.0)
        client = controller.client
        for _ in range(3):
            # over UDP and serial lines, a server drops a request that is older than the last one
            serial = client._conversation.serial
            data = assemble("Controller_GetName", [str(controller.handle)], serial, client.profile)
            for _ in range(2):
                reply = both.run(client.send_raw(data))
            assert packet.decode(reply, crc=client.profile.crc).arguments == ["Controller1"]
            assert both.run(controller.get_name()) == "Controller1"
        both.run(controller.close())
    device.close()


@only("http", because="only e-CAP is refused")
def test_e_cap_has_no_packets(both, listen_at):
    device = VirtualRC8()
    with orinkit.serve(device, listen_at) as server:
        controller = both.connect(server.url)
        with pytest.raises(InvalidValue, match="e-CAP over HTTP has no packets"):
            both.run(controller.client.send_raw(b"x"))
        both.run(controller.close())
    device.close()


def test_a_lost_connection(both):
    def script(line: Line) -> None:
        line._receive()
        line.shut()

    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=30.0)
        with pytest.raises(ConnectionLost):
            both.run(client.send_raw(b"x"))
        with pytest.raises(ConnectionClosed):
            both.run(client.send_raw(b"x"))
        both.run(client.close())


def test_no_reply(both):
    with BadPeer(Line.wait_for_end) as peer:
        client = both.client(peer.url)
        assert both.run(client.send_raw(b"x", timeout=0.2)) is None
        both.run(client.close())
