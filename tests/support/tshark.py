"""tshark with the dissector of orinkit: packets of a capture as trees of fields."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pytest

from orinkit.bcap import packet
from orinkit.bcap.dissector import lua
from orinkit.bcap.pcapng import CaptureConnection, PcapngWriter
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult

TSHARK = shutil.which("tshark")
needs_tshark = pytest.mark.skipif(TSHARK is None, reason="requires tshark (Debian, Ubuntu: apt-get install tshark)")

TCP = CaptureConnection("tcp", ("127.0.0.1", 50000), ("127.0.0.1", 5007))
UDP = CaptureConnection("udp", ("127.0.0.1", 50000), ("127.0.0.1", 5007))
START = 1_700_000_000_000_000_000

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # tshark does not escape U+FFFF

Sent = tuple[str, bytes, CaptureConnection]


@dataclass
class Dissected:
    """One packet of b-CAP as tshark dissects it.

    Attributes:
        tree: The protocol element of PDML.
        frame: Number of the frame, from 1.
    """

    tree: ET.Element
    frame: int

    @cached_property
    def fields(self) -> list[ET.Element]:
        """All fields, in order."""
        return list(self.tree.iter("field"))

    def shows(self, name: str) -> list[str]:
        """Return the values of all fields of a name."""
        return [each.get("show", "") for each in self.fields if each.get("name") == name]

    def show(self, name: str) -> str:
        """Return the value of the only field of a name."""
        (value,) = self.shows(name)
        return value

    def labels(self, name: str) -> list[str]:
        """Return the texts of all fields of a name."""
        return [each.get("showname") or each.get("show", "") for each in self.fields if each.get("name") == name]

    @property
    def malformed(self) -> bool:
        """True if the packet is marked as malformed."""
        return any(each.get("name") == "bcap.malformed" for each in self.fields)

    def pieces(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return the fields that have bytes and do not consist of others: position in the packet, and the bytes.

        Args:
            data: The packet. The bytes that tshark shows for a field must be the same.
        """
        start = int(self.tree.get("pos", "0"))
        found = []
        for each in _leaves(self.tree):
            at, size = int(each.get("pos", "0")) - start, int(each.get("size", "0"))
            found.append((at, data[at : at + size]))
            assert bytes.fromhex(each.get("value") or found[-1][1].hex()) == found[-1][1]
        return found


def _leaves(tree: ET.Element) -> Iterator[ET.Element]:
    for each in tree.findall("field"):
        if each.get("name") in ("bcap.argument", "bcap.element"):
            yield from _leaves(each)
        elif each.get("size", "0") != "0":
            yield each


class Result:
    """The report of tshark about a capture.

    Attributes:
        packets: The packets of b-CAP, in order.
        frames: The protocols of each frame.
        experts: The expert messages that do not come from the dissector of b-CAP.
    """

    def __init__(self, tshark: Tshark, capture: Path, options: tuple[str, ...]) -> None:
        self._run = lambda *output: tshark.run(capture, *output, *options)
        self.packets: list[Dissected] = []
        self.frames: list[list[str]] = []
        self.experts: list[str] = []
        for number, frame in enumerate(ET.fromstring(_NOT_XML.sub("?", self._run("-T", "pdml"))).iter("packet"), 1):
            protocols = frame.findall("proto")
            self.frames.append([each.get("name", "") for each in protocols])
            for each in protocols:
                if each.get("name") == "bcap":
                    self.packets.append(Dissected(each, number))
                else:
                    self.experts += [
                        part.get("show", "") for part in each.iter("field") if part.get("name") == "_ws.expert.message"
                    ]

    @cached_property
    def infos(self) -> list[str]:
        """The info column of each frame."""
        return self._run("-T", "fields", "-e", "_ws.col.Info").splitlines()


class Tshark:
    """Runs tshark with the dissector, in a directory of its own."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.script = directory / "bcap.lua"
        self.script.write_text(lua("test", 5007), encoding="utf-8")

    def run(self, capture: Path, *options: str) -> str:
        """Return the output of tshark for a file; fail if there is a Lua error."""
        assert TSHARK is not None
        environment = {
            **os.environ,
            "WIRESHARK_CONFIG_DIR": str(self.directory),
            "HOME": str(self.directory),
            "TZ": "UTC",
        }
        done = subprocess.run(
            [TSHARK, "-n", "-2", "-X", f"lua_script:{self.script}", "-r", str(capture), *options],
            capture_output=True, encoding="utf-8", errors="replace", env=environment, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "Lua" not in done.stderr, done.stderr
        assert "Lua Error" not in done.stdout
        return done.stdout

    def dissect(self, packets: Iterable[Sent], *options: str) -> Result:
        """Write packets to a file, one every millisecond, and dissect it."""
        capture = self.directory / "capture.pcapng"
        with capture.open("wb") as file:
            writer = PcapngWriter(file.write)
            for number, (direction, data, connection) in enumerate(packets):
                writer.packet(START + number * 1_000_000, direction, data, connection=connection)
        return Result(self, capture, options)


def assert_named(found: Result, packets: list[Sent]) -> None:
    """Check that every packet is one of b-CAP, is not malformed, has its function, and each reply its request."""
    assert found.experts == []
    assert [frame[-1] for frame in found.frames] == ["bcap"] * len(packets)
    for (direction, data, _), shown, info in zip(packets, found.packets, found.infos, strict=True):
        assert not shown.malformed
        _, _, serial, _, code, _ = packet.HEADER.unpack_from(data)
        assert shown.show("bcap.serial") == str(serial)
        function = FUNCTIONS[int(shown.show("bcap.function"))]
        assert function.name in info
        if direction == ">":
            assert function.id == code
            assert shown.shows("bcap.response_in") != []
        else:
            assert int(shown.show("bcap.return_code"), 16) == code
            assert hresult.lookup(code).name in info
            assert shown.shows("bcap.request_in") != []
