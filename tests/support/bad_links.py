"""Unreliable links between a real client and a real server: packets are lost, duplicated, delayed, reordered, cut, corrupted.

::

    with orinkit.serve(device, "udp://127.0.0.1:0") as server:
        with BadUdp(server.url, at_random(seed=1)) as link:
            ...  # a client connects to link.url

A link has two directions for each client, ``"there 0"`` (to the server) and ``"back 0"``. Each direction has a :data:`Spoil`:
a function that returns what arrives of a packet. :func:`at_random` seeds its random numbers with the seed and the name of
the direction, so the faults of a direction are reproducible. :class:`Script` applies the faults that a test has specified
to the next packets.

:class:`Ledger` is a device that records what it executes, so that a call that is executed twice is detected.

Each link runs in a separate thread, which ends with the ``with`` block.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import os
import random
import selectors
import socket
import struct
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self, TypeAlias

from orinkit.cao import provider as p
from orinkit.cao.provider import ClientInfo, Provider
from orinkit.values.variant import Variant, plain

PATIENCE = 20.0  # s for a link to end
SLOW = 0.1  # s, duration of a slow call
MOST_CLIENTS = 1000
MOST_UNDER_WAY = 10_000  # packets; further ones are lost

Piece: TypeAlias = tuple[float, bytes]
"""Delay in seconds, and the bytes that arrive then; the delay counts from now (UDP) or from the previous piece (serial)."""
Spoil: TypeAlias = Callable[[bytes], Iterable[Piece]]


# --- a device with a counter ------------------------------------------------------------------------------------------


class Account(p.ControllerObject):
    """A controller object that records the calls of one client."""

    def __init__(self, name: str, carried: list[int]) -> None:
        super().__init__(name)
        self._carried = carried

    def execute(self, command: str, parameter: Variant) -> Any:
        if command not in ("Count", "CountSlowly"):
            raise p.not_implemented()
        number = plain(parameter)
        self._carried.append(number)
        return [self.name, number, command] if command == "Count" else self._later(number, command)

    async def _later(self, number: int, command: str) -> list[Any]:
        await asyncio.sleep(SLOW)
        return [self.name, number, command]


class Ledger(Provider):
    """A device that records every number that has been executed, by client name."""

    provider_names = ("Test.Ledger",)

    def __init__(self) -> None:
        self.carried: dict[str, list[int]] = {}

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Account:
        return Account(name, self.carried.setdefault(name, []))


# --- what happens to a packet ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Harm:
    """Probabilities of the faults of a link, per packet.

    Attributes:
        loss: The packet is lost; drawn for each copy if it is duplicated.
        double: The packet arrives twice.
        late: The packet is delayed.
        delay: The longest delay, s.
        cut: The end of the packet is missing.
        broken: The packet is corrupted: any bits on a serial line; SOH, EOT or length on UDP.
        noise: Random bytes precede, interrupt or follow the packet (serial).
        gap: Some bytes of the packet are missing (serial).
        stop: The line pauses in the middle of the packet, for at most 2 ``delay`` (serial).
    """

    loss: float = 0.2
    double: float = 0.05
    late: float = 0.1
    delay: float = 0.02
    cut: float = 0.02
    broken: float = 0.02
    noise: float = 0.03
    gap: float = 0.02
    stop: float = 0.03


def spoil_datagram(dice: random.Random, harm: Harm, data: bytes) -> list[Piece]:
    """Return what arrives of a datagram. UDP has a checksum, so randomly corrupted datagrams would not arrive at all."""
    arriving = []
    for _ in range(2 if dice.random() < harm.double else 1):
        if dice.random() < harm.loss:
            continue
        piece = bytearray(data)
        if dice.random() < harm.broken and len(piece) > 5:
            piece[dice.choice((0, 1, 2, 3, 4, -1))] ^= dice.randrange(1, 256)
        if dice.random() < harm.cut:
            del piece[dice.randrange(len(piece)) :]
        arriving.append((dice.random() * harm.delay if dice.random() < harm.late else 0.0, bytes(piece)))
    return arriving


def spoil_bytes(dice: random.Random, harm: Harm, data: bytes) -> list[Piece]:
    """Return what arrives of a packet on a serial line; order is kept, but any other fault may occur."""
    arriving: list[Piece] = []
    for _ in range(2 if dice.random() < harm.double else 1):
        if dice.random() < harm.loss:
            continue
        piece = bytearray(data)
        if dice.random() < harm.broken:
            for _ in range(dice.randrange(1, 4)):  # CRC-16 detects up to three bit errors
                piece[dice.randrange(len(piece))] ^= 1 << dice.randrange(8)
        if dice.random() < harm.gap:
            start = dice.randrange(len(piece))
            del piece[start : start + dice.randrange(1, 6)]
        if dice.random() < harm.cut:
            del piece[dice.randrange(len(piece) + 1) :]
        if dice.random() < harm.noise:
            place = dice.choice((0, len(piece), dice.randrange(len(piece) + 1)))
            piece[place:place] = noise(dice)
        wait = dice.random() * harm.delay if dice.random() < harm.late else 0.0
        if dice.random() < harm.stop:
            place = dice.randrange(len(piece) + 1)
            arriving.append((wait, bytes(piece[:place])))
            piece, wait = piece[place:], dice.random() * harm.delay * 2
        arriving.append((wait, bytes(piece)))
    return arriving


def noise(dice: random.Random) -> bytes:
    """Return random bytes; some end like the beginning of a short or long packet."""
    some = dice.randbytes(dice.randrange(1, 30))
    return some + dice.choice((b"", b"", b"\x01", b"\x01\x40\0\0\0", b"\x01\xf0\x01\0\0", b"\x01" + dice.randbytes(4)))


def at_random(seed: int, harm: Harm | None = None, spoil: Any = spoil_datagram) -> Callable[[str], Spoil]:
    """Return a factory of spoils with random faults, by the name of the direction."""
    return lambda way: partial(spoil, random.Random(f"{seed} {way}"), Harm() if harm is None else harm)


class Script:
    """A factory of spoils that leave packets unchanged, except for the faults that a test has queued."""

    def __init__(self) -> None:
        self._next: dict[str, list[Spoil]] = {}

    def next(self, way: str, *spoils: Spoil) -> None:
        """Queue spoils for the next packets of a direction, one each."""
        self._next.setdefault(way, []).extend(spoils)

    def left(self, way: str) -> int:
        """Return the number of spoils still queued for a direction."""
        return len(self._next.get(way, ()))

    @property
    def done(self) -> bool:
        """True if no queued spoils are left."""
        return not any(self._next.values())

    def __call__(self, way: str) -> Spoil:
        mine = self._next.setdefault(way, [])
        return lambda data: mine.pop(0)(data) if mine else [(0.0, data)]


def as_it_is(data: bytes) -> list[Piece]:
    """Let a packet arrive unchanged."""
    return [(0.0, data)]


def lose(data: bytes) -> list[Piece]:
    """Lose a packet."""
    return []


# --- links ------------------------------------------------------------------------------------------------------------


class _Link(ABC):
    """Base of both links: a thread that receives bytes and delivers delayed ones when they are due.

    Attributes:
        came: number of packets received.
        arrived: number of pieces delivered.
    """

    def __init__(self, spoiled: Callable[[str], Spoil]) -> None:
        self._spoiled = spoiled
        self._selector = selectors.DefaultSelector()
        self._due: list[tuple[float, int, Callable[[bytes], Any], bytes]] = []
        self._numbers = itertools.count()
        self._woken, self._wake = socket.socketpair()
        self._ending = False
        self._error: BaseException | None = None
        self.came = 0
        self.arrived = 0
        self._thread = threading.Thread(target=self._run, name="bad-link", daemon=True)

    def _watch(self, end: Any, readable: Callable[[], None]) -> None:
        self._selector.register(end, selectors.EVENT_READ, readable)

    def _later(self, when: float, send: Callable[[bytes], Any], data: bytes) -> None:
        if data and len(self._due) < MOST_UNDER_WAY:
            heapq.heappush(self._due, (when, next(self._numbers), send, data))

    def _run(self) -> None:
        try:
            self._selector.register(self._woken, selectors.EVENT_READ)
            while not self._ending:
                wait = max(0.0, self._due[0][0] - time.monotonic()) if self._due else None
                for key, _ in self._selector.select(wait):
                    if key.data is not None:
                        key.data()
                while self._due and self._due[0][0] <= time.monotonic():
                    _, _, send, data = heapq.heappop(self._due)
                    self._deliver(send, data)
        except BaseException as error:  # noqa: BLE001 - raised in the test
            self._error = error

    def _deliver(self, send: Callable[[bytes], Any], data: bytes) -> None:
        try:
            send(data)
            self.arrived += 1
        except (BlockingIOError, ConnectionRefusedError):
            pass  # lost, as on any link

    @abstractmethod
    def _close(self) -> None: ...

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending = True
        self._wake.send(b"\0")
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        self._selector.close()
        self._woken.close()
        self._wake.close()
        self._close()
        if self._error is not None:
            raise self._error


class BadUdp(_Link):
    """An unreliable link to a server on UDP, for any number of clients; the server sees a different address for each.

    Attributes:
        url: the address for clients.
    """

    def __init__(self, server: str, spoiled: Callable[[str], Spoil]) -> None:
        super().__init__(spoiled)
        host, _, port = server.rpartition("/")[2].rpartition(":")
        self._server = (host, int(port))
        self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._front.bind(("127.0.0.1", 0))
        self._front.setblocking(False)
        self._backs: dict[Any, tuple[socket.socket, Spoil]] = {}
        self._watch(self._front, self._from_clients)
        self.url = f"udp://127.0.0.1:{self._front.getsockname()[1]}"

    def _from_clients(self) -> None:
        while True:
            try:
                data, client = self._front.recvfrom(65536)
            except (BlockingIOError, ConnectionRefusedError):
                return
            if client not in self._backs:
                assert len(self._backs) < MOST_CLIENTS
                self._backs[client] = self._new(client)
            back, spoil = self._backs[client]
            self._carry(data, spoil, back.send)

    def _new(self, client: Any) -> tuple[socket.socket, Spoil]:
        number = len(self._backs)
        back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        back.connect(self._server)
        back.setblocking(False)
        self._watch(back, partial(self._from_server, back, client, self._spoiled(f"back {number}")))
        return back, self._spoiled(f"there {number}")

    def _from_server(self, back: socket.socket, client: Any, spoil: Spoil) -> None:
        try:
            data = back.recv(65536)
        except (BlockingIOError, ConnectionRefusedError):
            return
        self._carry(data, spoil, lambda piece: self._front.sendto(piece, client))

    def _carry(self, data: bytes, spoil: Spoil, send: Callable[[bytes], Any]) -> None:
        self.came += 1
        now = time.monotonic()
        for delay, piece in spoil(data):
            if delay:
                self._later(now + delay, send, piece)
            else:
                self._deliver(send, piece)

    def _close(self) -> None:
        self._front.close()
        for back, _ in self._backs.values():
            back.close()


class _SerialWay:
    """One direction of a serial line: receives whole packets and forwards their pieces in order."""

    def __init__(self, source: int, target: int, spoil: Spoil) -> None:
        self.source = source
        self.target = target
        self._spoil = spoil
        self._begun = b""
        self.last = 0.0  # time at which the latest piece is due

    def read(self) -> list[bytes]:
        """Return the packets received; bytes that are not a packet are returned as they are."""
        try:
            self._begun += os.read(self.source, 65536)
        except BlockingIOError:
            return []
        packets = []
        while len(self._begun) >= 5:
            (length,) = struct.unpack_from("<I", self._begun, 1)
            if self._begun[0] != 1 or not 18 <= length <= 65536:
                length = len(self._begun)
            if len(self._begun) < length:
                break
            packets.append(self._begun[:length])
            self._begun = self._begun[length:]
        return packets

    def pieces(self, data: bytes) -> list[Piece]:
        """Return the pieces that arrive, with the time of each."""
        self.last = max(self.last, time.monotonic())
        arriving = []
        for wait, piece in self._spoil(data):
            self.last += wait
            arriving.append((self.last, piece))
        return arriving

    def send(self, data: bytes) -> None:
        """Write; bytes that exceed the buffer of the line are lost."""
        os.write(self.target, data)


class BadSerial(_Link):
    """Unreliable links to the pseudo-terminals of a server, one for each.

    Attributes:
        urls: the addresses for clients, in the same order.
    """

    def __init__(self, servers: Iterable[str], spoiled: Callable[[str], Spoil]) -> None:
        super().__init__(spoiled)
        self.urls: list[str] = []
        self._ends: list[int] = []
        self._ways: dict[str, _SerialWay] = {}
        for number, server in enumerate(servers):
            there = os.open(server.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY)
            mine, clients = os.openpty()
            self._ends += [there, mine, clients]
            for end in (there, clients):
                tty.setraw(end)
            for end in (there, mine):
                os.set_blocking(end, False)
            self.urls.append(f"serial://{os.ttyname(clients)}")
            for source, target, name in ((mine, there, f"there {number}"), (there, mine, f"back {number}")):
                way = self._ways[name] = _SerialWay(source, target, spoiled(name))
                self._watch(source, partial(self._readable, way))

    @property
    def url(self) -> str:
        """The first address."""
        return self.urls[0]

    def say(self, way: str, data: bytes) -> None:
        """Inject bytes at the end of a direction."""
        self._ways[way].send(data)

    def _readable(self, way: _SerialWay) -> None:
        for data in way.read():
            self.came += 1
            for when, piece in way.pieces(data):
                self._later(when, way.send, piece)

    def _close(self) -> None:
        for end in self._ends:
            os.close(end)
