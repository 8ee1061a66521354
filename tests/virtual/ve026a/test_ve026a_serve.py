"""``orinkit serve ve026a``: as a process, over TCP and over a pseudo-terminal."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.cli.app import main
from orinkit.core import i18n
from orinkit.values.variant import Variant, VarType
from support.ve_cell import SYNC

Serve = Callable[..., "tuple[subprocess.Popen[str], list[str]]"]
R4 = 0x2004
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="descriptors of sockets and terminals are files only there")
PLACE = (10.0, 30.0, 120.0, 0.0, 30.0, 0.0, 5.0)


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Start the server; return the process and the addresses of its listeners."""
    started: list[subprocess.Popen[str]] = []

    def serve(*options: str, listeners: int = 1) -> tuple[subprocess.Popen[str], list[str]]:
        process = subprocess.Popen(
            [sys.executable, "-m", "orinkit", "serve", "ve026a", *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        lines = [process.stdout.readline().rstrip("\n") for _ in range(listeners)]
        assert all(line.startswith("ready ") for line in lines)
        return process, [line.removeprefix("ready ") for line in lines]

    yield serve
    for process in started:
        process.kill()
        process.communicate()


class Raw:
    """A client that sends and receives packets."""

    def __init__(self, descriptor: int, *, crc: bool) -> None:
        self.descriptor = descriptor
        self.crc = crc
        self.serial = 0

    def call(self, function: int, *arguments: object) -> Packet:
        """Call a function; return its reply."""
        self.serial += 1
        request = Packet(self.serial, function, list(arguments), self.serial if self.crc else 0)
        os.write(self.descriptor, packet.encode(request, crc=self.crc))
        data = b""
        while len(data) < 5 or len(data) < int.from_bytes(data[1:5], "little"):
            assert select.select([self.descriptor], [], [], 20.0)[0], "no answer"
            data += os.read(self.descriptor, 4096)
        answer = packet.decode(data, exact=True, crc=self.crc)
        assert (answer.serial, answer.reserved) == (request.serial, request.reserved)
        return answer

    def play(self) -> None:
        """Execute the first calls of the sample in the document (VE026A 6.2)."""
        assert self.call(1).code == 0
        assert self.call(3, "", "", "", "").arguments == [Variant(VarType.I4, 1)]
        assert self.call(7, 1, "VE", "").arguments == [Variant(VarType.I4, 1)]
        assert self.call(64, 1, "Motor", Variant(VarType.I2, 1)).arguments == []
        assert self.call(62, 1, "@CURRENT_ANGLE", "").arguments == [Variant(VarType.I4, 1)]
        (angles,) = self.call(101, 1).arguments
        assert angles == Variant(R4, [*PLACE, 0.0])
        assert self.call(64, 1, "slvChangeMode", Variant(VarType.I2, SYNC)).arguments == []
        assert self.call(64, 1, "slvMove", angles).arguments == [angles]
        assert self.call(64, 1, "Motor", Variant(VarType.I2, 0)).code == 0
        assert self.call(2).code == 0


FAST = ("--joints", "10,30,120,0,30,0,5", "--time-scale", "5")


@POSIX
def test_over_tcp(serve):
    process, (url,) = serve("--tcp", "127.0.0.1:0", *FAST)
    with socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2]))) as link:
        Raw(link.fileno(), crc=False).play()
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 0


@POSIX
def test_over_a_pseudo_terminal(serve):
    import tty

    _, (url,) = serve("--pty", *FAST)
    assert url.startswith("serial:///dev/")
    descriptor = os.open(url.removeprefix("serial://").partition("?")[0], os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(descriptor)
        Raw(descriptor, crc=True).play()
    finally:
        os.close(descriptor)


@pytest.mark.parametrize(("lang", "words"), [("en", "(J7: the hand)"), ("ja", "J7 はハンド")])
def test_its_help_is_there_in_both_languages(capsys, lang, words):
    before = i18n.current()
    i18n.use(lang)
    try:
        assert main(["serve", "ve026a", "--help"]) == 0
    finally:
        i18n.use(before)
    assert words in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize(
    ("option", "value"),
    [("--joints", "1,2,3"), ("--joints", "0,0,0,0,0,0,26"), ("--joints", "x"), ("--time-scale", "0")],
)
def test_invalid_options_are_reported(capsys, option, value):
    assert main(["serve", "ve026a", option, value]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("orinkit: ")
    assert err.count("\n") == 1
