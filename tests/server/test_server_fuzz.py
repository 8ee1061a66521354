"""Mutated packets (100,000 by ``make soak``) against a running server, while another client makes calls undisturbed.

Every connection sends a few mutants after packets that create valid handles, shuts down its sending side, and reads to the
end of the stream. The replies are checked: one for every packet in the stream, in order, with that packet's serial; the
matching code if the arguments of a packet cannot be decoded; a named code for every other packet; and, if the packet
boundary is lost, the code for that, with serial 0, and the end of the stream.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import random
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, Self

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.packet import Framer, Packet
from orinkit.bcap.requests import encode_request
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import ProtocolError
from orinkit.server.threaded import Server
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from support import paths
from support.devices import Recorder
from support.waiting import PATIENCE, until

MUTANTS = 100_000
VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
EDGES = [0, 1, 2, 9, 10, 15, 16, 17, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0xFFFFFF, 0x1000000,
         0x1000001, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF]  # fmt: skip
TYPES = [*map(int, VarType), *(int(vt) | ARRAY for vt in VarType), 0x4003, 0x200C, 99, 0xFFFF]

VALUES: list[Any] = [
    None, True, -5, 0, 1, 1.5, "", "IO150", "I5", "I*", "日本語", b"\x01\x04", [1, 2, 3], [1.5] * 8, ["a", "b"],
    [1, "b", [2.5, [None]]], [], float("nan"), float("inf"), 2**31 - 1, "P1", "J2", "@MODE", "@CURRENT_TIME", "ClearError",
    "GetCurErrorCount", "GetCurErrorInfo", "GetErrorDescription", "GetErrorLog", "GetOprLog", "SysState", "SysInfo", "@IfNotMember",
    Variant(VarType.I2, 3), Variant(VarType.CY, 1), Variant(VarType.DATE, 1.25), Variant(VarType.ERROR, 5),
    Variant(VarType.DATE, 1e300), Variant(VarType.UI8, 2**63), Variant(VarType.R4 | ARRAY, [1.0, 2.0]), Variant(VarType.NULL),
    Variant(VarType.BOOL | ARRAY, [True, False]), Variant(VarType.BSTR | ARRAY, []),
]  # fmt: skip


def corpus(chance: random.Random) -> list[bytes]:
    """Return valid requests: those of the documents, and each function with several arguments."""
    packets = [bytes.fromhex(v["hex"]) for v in VECTORS if v["kind"] == "request" and v["transport"] == "tcp"]
    for function in FUNCTIONS.values():
        for _ in range(6):
            arguments: list[object] = []
            for argument in function.arguments:
                if argument.is_handle:
                    arguments.append(chance.choice([2, 3, 4, 5]))
                elif argument.vt is VarType.VARIANT:
                    arguments.append(chance.choice(VALUES))
                else:
                    known = {VarType.I4: [0, 1, -1], VarType.R4: [1.0], VarType.BSTR: ["", "I5", "Motor", "WDT=400"]}
                    arguments.append(chance.choice(known[argument.vt]))
            packets.append(encode_request(function, tuple(arguments), chance.randrange(1, 0x10000)))
    return packets


class Mutator:
    """Mutates valid packets; the same seed produces the same mutants."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.corpus = corpus(self.chance)
        self.mutations: list[Callable[[bytearray], bytearray]] = [
            self.flip, self.flip, self.flip, self.cut, self.repeat, self.insert, self.remove, self.header, self.field,
            self.field, self.field, self.kind, self.splice, self.noise, self.nest, self.reshape, self.reshape,
        ]  # fmt: skip

    def mutant(self) -> bytes:
        data = bytearray(self.chance.choice(self.corpus))
        for _ in range(self.chance.choice([1, 1, 1, 2, 3])):
            data = self.chance.choice(self.mutations)(data)
        if self.chance.random() < 0.75:  # valid framing, so that the server decodes the content
            data = self.repair(data)
        return bytes(data)

    def repair(self, data: bytearray) -> bytearray:
        data += bytes(max(0, packet.OVERHEAD - len(data)))
        data[0], data[-1] = packet.SOH, packet.EOT
        packet.LENGTH.pack_into(data, 1, len(data))
        return data

    def _place(self, data: bytearray, size: int = 1) -> int:
        return self.chance.randrange(max(1, len(data) - size + 1))

    def flip(self, data: bytearray) -> bytearray:
        for _ in range(self.chance.choice([1, 1, 2, 8])):
            if data:
                data[self._place(data)] ^= 1 << self.chance.randrange(8)
        return data

    def cut(self, data: bytearray) -> bytearray:
        return data[: self._place(data)]

    def repeat(self, data: bytearray) -> bytearray:
        place = self._place(data)
        part = data[place : place + self.chance.randrange(1, 40)]
        data[place:place] = part * self.chance.choice([1, 2, 10])
        return data

    def insert(self, data: bytearray) -> bytearray:
        place = self._place(data)
        data[place:place] = self.chance.randbytes(self.chance.randrange(1, 20))
        return data

    def remove(self, data: bytearray) -> bytearray:
        place = self._place(data)
        del data[place : place + self.chance.randrange(1, 20)]
        return data

    def header(self, data: bytearray) -> bytearray:
        form, place = self.chance.choice([("<I", 1), ("<H", 5), ("<H", 7), ("<I", 9), ("<H", 13)])
        size = struct.calcsize(form)
        if len(data) >= place + size:
            struct.pack_into(form, data, place, self.chance.choice(EDGES) & (256**size - 1))
        return data

    def field(self, data: bytearray) -> bytearray:
        """Write an edge value at any place: argument lengths, element counts and text lengths all have four bytes."""
        if len(data) > 20:
            struct.pack_into("<I", data, self.chance.randrange(15, len(data) - 4), self.chance.choice(EDGES))
        return data

    def kind(self, data: bytearray) -> bytearray:
        """Change the type of the first argument, or write a type at any place."""
        if len(data) > 22:
            place = self.chance.choice([19, self.chance.randrange(15, len(data) - 2)])
            struct.pack_into("<H", data, place, self.chance.choice(TYPES) & 0xFFFF)
        return data

    def splice(self, data: bytearray) -> bytearray:
        other = self.chance.choice(self.corpus)
        return data[: self._place(data)] + other[self.chance.randrange(len(other)) :]

    def noise(self, data: bytearray) -> bytearray:
        return data[:15] + self.chance.randbytes(self.chance.randrange(60))

    def reshape(self, data: bytearray) -> bytearray:
        """Return a different call: any function with any arguments, valid as a packet."""
        arguments = [self.chance.choice(VALUES) for _ in range(self.chance.choice([0, 1, 2, 2, 3, 3, 4, 5]))]
        if arguments and self.chance.random() < 0.8:
            arguments[0] = self.chance.choice([2, 3, 4, 5])
        return bytearray(packet.encode(Packet(self.chance.randrange(0x10000), self.chance.randrange(140), arguments)))

    def nest(self, data: bytearray) -> bytearray:
        """Nest VARIANT arrays deeper than allowed, or with a count that exceeds the number of elements."""
        body = bytes.fromhex("0300010000000100 0000".replace(" ", ""))
        for _ in range(self.chance.choice([2, 15, 16, 17, 40])):
            body = struct.pack("<HI", 0x200C, self.chance.choice([1, 1, 1, 0, 2, 0xFFFFFFFF])) + body
        return data[:15] + struct.pack("<I", len(body)) + body + data[-1:]


PREFIX = b"".join(
    packet.encode(Packet(serial, function, arguments))
    for serial, (function, arguments) in enumerate(
        [
            (1, ["WDT=400"]),
            (3, ["b-CAP", "CaoProv.DENSO.VRC", "localhost", ""]),
            (9, [2, "IO150", ""]),
            (3, ["RC", "Test.Recorder", "localhost", ""]),
            (7, [4, "Arm", ""]),
        ],
        start=1,
    )
)


def expected(stream: list[bytes]) -> tuple[list[tuple[int, int | None]], int]:
    """Return serial and code of the replies to a stream, and the number of pieces used.

    The code is ``None`` if several codes are correct.
    """
    answers: list[tuple[int, int | None]] = []
    framer = Framer()
    for used, piece in enumerate(stream, 1):
        try:
            frame = framer.feed(piece)
            while frame is not None:
                _, _, serial, _, function_id, count = packet.HEADER.unpack_from(frame)
                try:
                    if 5 < count <= len(frame) // 10:
                        known = function_id in FUNCTIONS
                        raise ProtocolError("too many", hresult.E_INVALIDARG if known else hresult.E_NOTIMPL)
                    packet.decode_arguments(frame, count, len(frame) - 1, exact=True)
                except ProtocolError as error:
                    answers.append((serial, error.code))
                else:
                    answers.append((serial, None))
                frame = framer.next_frame()
        except ProtocolError as error:
            return [*answers, (0, error.code)], used
    return answers, len(stream)


def converse(address: tuple[str, int], data: bytes) -> tuple[list[tuple[int, int]], bool]:
    """Send everything, shut down the sending side, and read to the end.

    Returns:
        The serials and codes of the replies, and True if the connection was not reset.
    """
    answers: list[tuple[int, int]] = []
    framer = Framer()
    with socket.create_connection(address, PATIENCE) as connection:
        in_order = True
        try:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            while received := connection.recv(65536):
                frame = framer.feed(received)
                while frame is not None:
                    answer = packet.decode(frame)
                    answers.append((answer.serial, answer.code))
                    frame = framer.next_frame()
        except ConnectionError:  # closed by the server before it has read all bytes
            in_order = False
    assert framer.skipped_bytes == 0
    assert not in_order or framer.pending == 0
    return answers, in_order


class Neighbour:
    """A client that continuously writes and reads its variable."""

    def __init__(self, url: str) -> None:
        self.turns = 0
        self.error: BaseException | None = None
        self._url = url
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        try:
            with orinkit.connect(self._url, timeout=PATIENCE) as controller:
                variable = controller.variable("S99")
                while not self._stop.is_set():
                    variable.value = f"turn {self.turns}"
                    assert variable.value == f"turn {self.turns}"
                    self.turns += 1
                    self._stop.wait(0.001)  # yields the processor to the others
                assert controller.client.stray_replies == 0
        except BaseException as error:  # noqa: BLE001 - checked by the test
            self.error = error

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def server() -> Iterator[Server]:
    with orinkit.serve([VirtualRC8(), Recorder()], "tcp://127.0.0.1:0") as served:
        yield served


def fuzz(server: Server, seed: int, mutants: int) -> Counter[int]:
    """Send mutants and check the replies; return the number of replies with each code."""
    mutator = Mutator(seed)
    host, _, port = server.url.removeprefix("tcp://").rpartition(":")
    codes: Counter[int] = Counter()
    sent = 0
    while sent < mutants:
        stream = [PREFIX, *(mutator.mutant() for _ in range(mutator.chance.choice([1, 5, 25, 60])))]
        wanted, used = expected(stream)
        data = b"".join(stream)
        answers, in_order = converse((host, int(port)), data)
        sent += used - 1
        clue = f"seed {seed}, mutant {sent}: {data[len(PREFIX) :].hex()[:4000]}"
        if in_order:
            # the end of the stream ends the session; calls that wait behind an executing one are then dropped
            assert len(answers) <= len(wanted), clue
        else:
            assert wanted[-1][0] == 0, clue  # only a stream without a packet boundary is closed
        replies = answers
        if (
            answers and answers[-1][0] == wanted[-1][0] == 0 and wanted[-1][1] is not None
        ):  # it does not wait for the calls before it
            assert answers[-1][1] == wanted[-1][1], clue
            replies = answers[:-1]
        for (serial, code), (wanted_serial, wanted_code) in zip(replies, wanted, strict=False):
            assert serial == wanted_serial, clue
            assert wanted_code is None or code == wanted_code, clue
        codes.update(code for _, code in answers)
    for code in codes:
        assert not hresult.lookup(code).name.startswith("0x"), f"seed {seed}: no documented code: {code:#x}"
    return codes


@pytest.mark.timeout(900)
@pytest.mark.parametrize("count", [5_000, pytest.param(MUTANTS, marks=pytest.mark.soak)])
def test_mutated_packets(server: Server, caplog: pytest.LogCaptureFixture, count: int) -> None:
    caplog.set_level(logging.ERROR)
    before = alive()
    with Neighbour(server.url) as neighbour:
        codes = fuzz(server, 2024, count)
    assert neighbour.error is None
    assert neighbour.turns > 100
    assert [record.getMessage() for record in caplog.records] == []
    # all kinds of replies occurred: the mutants are neither all completely invalid nor all nearly valid
    for code in (
        hresult.S_OK, hresult.E_NOTIMPL, hresult.E_HANDLE, hresult.E_INVALIDARG, hresult.E_INVALIDARGTYPE,
        hresult.E_INVALIDRCVPACKET, hresult.E_PACKETSIZEOVER,
    ):  # fmt: skip
        assert codes[code] > 0, hresult.lookup(code).name
    context = server._server._context
    until(lambda: not (context.open or context.all or context.tasks))
    known = {id(thing) for thing in before}
    end = time.monotonic() + PATIENCE
    while (left := [thing for thing in alive() if id(thing) not in known]) and time.monotonic() < end:
        del left  # these references would keep further objects alive
        time.sleep(0.02)  # the last connection is deregistered before its objects are deleted
    assert left == []


@pytest.mark.soak
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", range(8))
def test_more_mutated_packets(server: Server, caplog: pytest.LogCaptureFixture, seed: int) -> None:
    caplog.set_level(logging.ERROR)
    with Neighbour(server.url) as neighbour:
        fuzz(server, seed, 2 * MUTANTS)
    assert neighbour.error is None
    assert [record.getMessage() for record in caplog.records] == []


def alive() -> list[object]:
    """Return every session, and every task that is not done."""
    gc.collect()
    things = gc.get_objects()
    return [t for t in things if isinstance(t, Session) or (isinstance(t, asyncio.Task) and not t.done())]
