"""raw: packets in hex, unchanged, to a controller or to a client."""

from __future__ import annotations

import io
import re
import subprocess

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.profiles import DATAGRAM, LINE
from orinkit.core import hresult
from orinkit.raw.hex_text import hex_text
from orinkit.raw.packets import assemble
from orinkit.virtual.ve026a import VirtualVE026A
from support.peers import BadPeer, Line, reply

START = assemble("Service_Start")
PATIENCE = "30"


@pytest.fixture
def recording():
    """A server that records the received bytes and replies to packets, and the bytes."""
    got: list[bytes] = []

    def script(line: Line) -> None:
        while True:
            data = line._receive()
            got.append(data)
            line.send(reply(packet.decode(data)) if packet.is_whole(data) else b"?")

    with BadPeer(script) as peer:
        yield peer.url, got


@pytest.mark.parametrize("words", [(START.hex(),), tuple(START.hex(" ").split()), (START.hex(" "),)])
def test_a_packet_arrives_unchanged(run, recording, words):
    url, got = recording
    done = run("raw", url, *words, "--timeout", PATIENCE)
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("← S_OK\n")
    assert "return code  00 00 00 00              0x00000000 S_OK" in done.out
    assert got == [START]


def test_several_packets(run, recording, tmp_path, monkeypatch):
    url, got = recording
    packets = [assemble("Service_Start", [], serial) for serial in (1, 2, 3, 4)]
    file = tmp_path / "two.hex"
    file.write_text(f"{hex_text(packets[1])}\n\n{hex_text(packets[2])}\n")
    monkeypatch.setattr("sys.stdin", io.StringIO(packets[3].hex()))
    done = run("raw", url, packets[0].hex(), f"@{file}", "-", "--hex", "--timeout", PATIENCE)
    assert got == packets
    replies = [packet.decode(bytes.fromhex(line)) for line in done.out.splitlines()]
    assert [each.serial for each in replies] == [1, 2, 3, 4]


def test_a_malformed_packet_is_sent_with_a_warning(run, recording):
    url, got = recording
    done = run("raw", url, "01", "11", "0x00", "--hex", "--timeout", PATIENCE)
    assert (done.code, done.out) == (0, "3f\n")
    assert got == [b"\x01\x11\x00"]
    assert done.err == "orinkit: warning: packet 1: 3 bytes are present, but a packet has at least 16\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["0x1G"], "packet 1: '0x1G' is not hex"),
        ([START.hex(), "011"], "packet 2: '011' has an odd number of hex digits (3)"),
        (["@missing.hex"], "HEX missing.hex: "),
        ([START.hex(), "--count", "0"], "--count must be at least 1"),
        (["@/dev/null"], "no packet given"),
    ],
)
def test_nothing_is_sent_after_an_error(refused, recording, words, message):
    url, got = recording
    assert message in refused("raw", url, *words, code=2)
    assert got == []


@pytest.mark.parametrize("url", ["http://127.0.0.1:1", "Conn=eth:h, PacketOpt=2", "Conn=eth:"])
def test_invalid_parameters(refused, url):
    refused("raw", url, START.hex(), code=2)


def test_no_reply(run):
    with BadPeer(Line.wait_for_end) as peer:
        done = run("raw", f"Conn=eth:127.0.0.1:{peer.port}, Timeout=1000", START.hex())
        assert (done.code, done.out) == (1, "")
        assert done.err == "orinkit: packet 1: no reply within 1 s\n"
        assert run("raw", f"Conn=eth:127.0.0.1:{peer.port}, Sync=False", START.hex()) == (0, "", "")


def test_no_controller(refused):
    with BadPeer(Line.wait_for_end) as peer:
        url = peer.url
    assert "cannot connect" in refused("raw", url, START.hex())


def test_a_loop_prints_the_rates(run, url):
    done = run("raw", url, START.hex(), "--count", "30", "--timeout", PATIENCE)
    assert done.code == 0
    assert re.search(r"\n30 packets sent, 30 replies, \d+\.\d+ s, \d+ packets/s\n$", done.out)


def test_udp_and_serial_lines(run, rc8):
    arm = VirtualVE026A()
    with orinkit.serve(rc8, "udp://127.0.0.1:0") as udp, orinkit.serve(arm, "pty://") as serial:
        for server, profile in ((udp, DATAGRAM), (serial, LINE)):
            data = assemble("Service_Start", [], 7, profile)
            done = run("raw", server.url, data.hex(), "--hex", "--timeout", PATIENCE)
            found = packet.decode(bytes.fromhex(done.out), crc=profile.crc)
            assert (found.serial, found.code) == (7, hresult.S_OK)
    arm.close()


def test_a_server_answers_a_client(program):
    answers = [packet.encode(packet.Packet(serial, 0)).hex() for serial in (1, 2)]
    command = [*program, "raw", "Conn=eth::0, EtherOpt=1:1", *answers]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = process.stdout.readline().removeprefix("ready ").strip()
        assert url.startswith("tcp://127.0.0.1:")
        with orinkit.open_client(url, timeout=30.0) as client:
            client.call(orinkit.functions.service_start)
            client.call(orinkit.functions.service_stop)
        rest = process.stdout.read()
        assert process.wait(30) == 0
    assert rest.index("← Service_Start()") < rest.index("→ S_OK") < rest.index("← Service_Stop()")
