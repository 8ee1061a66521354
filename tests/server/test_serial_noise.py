"""Noise on a serial line between a client and a server: the affected call succeeds, and the next one is normal.

Most tests use one line for each kind of noise, and make calls on all lines at the same time, since many calls wait for a
time-out. The number of attempts depends on times that a slow machine may exceed: see :func:`in_time`.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any

import pytest

import orinkit
from orinkit.bcap import client as bcap_client
from orinkit.bcap import duplicate_filter, packet
from orinkit.bcap import server as bcap_server
from orinkit.bcap.profiles import SILENCE
from orinkit.core.errors import CallTimeout
from orinkit.server import serial_line
from orinkit.server.threaded import Server
from support.bad_links import BadSerial, Harm, Ledger, Piece, Script, Spoil, at_random, lose, noise, spoil_bytes
from support.both import Both
from support.callers import CONNECT, EXECUTE, Counting, SerialRaw
from support.waiting import PATIENCE, until

TRY = 0.4  # s; time-out of one attempt
PACES = (1, 2, 4, 8)
WAYS = pytest.mark.parametrize("way", ["there", "back"])
REQUEST = packet.encode(packet.Packet(700, EXECUTE, [2, "Count", -1], 700), crc=True)

NOISE = [
    b"\x55",
    bytes(40),
    b"login: \r\n",
    b"\x01",
    b"\x04\x04",
    b"\x01\x12\0\0\0",  # the length of a short packet
    b"\x01\0\0\0\0",  # of an empty one
    b"\x01\xf0\x01\0\0",  # of a long one
    b"\x01\0\0\1\0",  # of the longest
    b"\x01\x01\0\1\0",  # of one that is too long
    b"\x01\x90\0\0\0\x07\0\x07\0\x11\0\0\0\x03\0",  # a complete header
    b"\x01\x01\0\1\0\x07\0\x07\0\x11\0\0\0\x03\0",  # the header of a packet that is too long
    REQUEST[:25],
    REQUEST[:-3] + b"\0\0\x04",
    *(noise(random.Random(seed)) for seed in range(4)),
]
PLACES = [1, 4, 5, 20, -4, -1]
TIMES: list[tuple[Any, str]] = [
    (sys.modules[__name__], "TRY"),
    (sys.modules[__name__], "SILENCE"),
    (bcap_client, "SILENCE"),
    (bcap_server, "_OVERDUE"),
    (duplicate_filter, "_LATE_BYTES"),
    (serial_line, "SILENCE"),
]
"""All time-outs for a serial line: here, in the client, and in the server."""


class Late(AssertionError):
    """A call took longer than allowed."""


def in_time(test: Callable[..., None]) -> Callable[..., None]:
    """Repeat a test that was late with all time-outs doubled; a slow machine finally passes, and a defect does not."""

    @wraps(test)
    def repeated(*arguments: Any, **named: Any) -> None:
        for pace in PACES:
            with pytest.MonkeyPatch.context() as patch:
                for module, name in TIMES:
                    patch.setattr(module, name, getattr(module, name) * pace)
                try:
                    return test(*arguments, **named)
                except (Late, CallTimeout):
                    if pace == PACES[-1]:
                        raise
        return None

    return pytest.mark.timeout(300)(repeated)


class Noisy:
    """A client of a server, and the line between them, on which a test causes disturbances."""

    def __init__(self, both: Both, number: int, link: BadSerial, script: Script, ledger: Ledger) -> None:
        self._both = both
        self._number = number
        self._link = link
        self._script = script
        self._name = f"client {number}"
        self._calls = 0
        self.sent = 0
        self.controller = both.connect(
            link.urls[number],
            provider="Test.Ledger",
            name=self._name,
            timeout=TRY,
            tries=7,
            trace=self._trace,
            dialect="rc8",
        )
        self._carried = ledger.carried[self._name]

    def _trace(self, direction: str, data: bytes) -> None:
        self.sent += direction == ">"

    def next(self, way: str, *spoils: Spoil) -> None:
        """Disturb the next packets in one direction, ``"there"`` or ``"back"``."""
        self._script.next(f"{way} {self._number}", *spoils)

    def say(self, way: str, data: bytes) -> None:
        """Insert bytes into one direction, outside any packet."""
        self._link.say(f"{way} {self._number}", data)

    @property
    def undisturbed(self) -> bool:
        """True if no disturbances are left."""
        return not any(self._script.left(f"{way} {self._number}") for way in ("there", "back"))

    async def count(self) -> tuple[int, float]:
        """Make a call, which must be executed once; return the number of attempts, and the duration, s."""
        began, self.sent = time.monotonic(), 0
        answer = await self._both.now(self.controller.execute("Count", self._calls))
        assert answer == [self._name, self._calls, "Count"]
        self._calls += 1
        assert self._carried == list(range(self._calls))
        return self.sent, time.monotonic() - began

    async def check(self, *, tries: int = 2) -> None:
        """Check that a call succeeds within so many attempts and time-outs, and the next one at the first attempt."""
        sent, seconds = await self.count()
        if sent > tries or seconds >= TRY * (tries + 1):
            raise Late(f"sent {sent} times, {seconds:.3f} s")
        sent, seconds = await self.count()
        if sent > 1 or seconds >= TRY:
            raise Late(f"the next one was sent {sent} times, {seconds:.3f} s")


@contextmanager
def lines(both: Both, number: int) -> Iterator[list[Noisy]]:
    """Serve on several lines, and yield a client for each."""
    ledger, script = Ledger(), Script()
    with orinkit.serve(ledger, *["pty://"] * number) as server, BadSerial(server.urls, script) as link:
        noisy: list[Noisy] = []
        try:
            noisy += (Noisy(both, n, link, script, ledger) for n in range(number))
            yield noisy
            assert script.done
        finally:
            for each in noisy:
                both.run(each.controller.client.close())


def on_each(both: Both, way: str, spoils: Sequence[Spoil], *, tries: int = 2) -> None:
    """Apply each disturbance to the next packet on a separate line, and check the calls there."""

    async def body(noisy: Noisy, spoil: Spoil) -> None:
        noisy.next(way, spoil)
        await noisy.check(tries=tries)

    with lines(both, len(spoils)) as clients:
        both.side_by_side(*map(body, clients, spoils))


def inside(said: bytes, place: int) -> Spoil:
    return lambda data: [(0.0, data[:place] + said + data[place:])]


# --- noise ------------------------------------------------------------------------------------------------------------


@in_time
@WAYS
def test_before_a_packet(both: Both, way: str) -> None:
    """A server finds the packet once the line is silent, a client after its time-out: nothing is sent twice."""
    on_each(both, way, [inside(said, 0) for said in NOISE], tries=1)


@in_time
@WAYS
def test_after_a_packet(both: Both, way: str) -> None:
    """That call is not affected, but the next one is."""

    async def body(noisy: Noisy, said: bytes) -> None:
        noisy.next(way, lambda data: [(0.0, data + said)])
        await noisy.count()
        await noisy.check(tries=1)

    with lines(both, len(NOISE)) as clients:
        both.side_by_side(*map(body, clients, NOISE))


@in_time
@WAYS
def test_between_packets(both: Both, way: str) -> None:
    """The noise occurs while no call is in progress."""

    async def body(noisy: Noisy, said: bytes) -> None:
        noisy.say(way, said)
        await noisy.check(tries=1)

    with lines(both, len(NOISE)) as clients:
        both.side_by_side(*map(body, clients, NOISE))


@in_time
@WAYS
@pytest.mark.parametrize("place", [3, 7, 24])
def test_inside_a_packet(both: Both, way: str, place: int) -> None:
    on_each(both, way, [inside(said, place) for said in NOISE])


def changed(bit: int) -> Spoil:
    def change(data: bytes) -> list[Piece]:
        number = int.from_bytes(data, "little") ^ 1 << bit % (8 * len(data))
        return [(0.0, number.to_bytes(len(data), "little"))]

    return change


@in_time
@WAYS
def test_bits_that_are_changed(both: Both, way: str) -> None:
    """Many bits of the header, and some others."""
    on_each(both, way, [changed(bit) for bit in (*range(0, 15 * 8, 3), *range(120, 300, 9), *range(1000, 1040, 4))])


def without(start: int, end: int) -> Spoil:
    return lambda data: [(0.0, data[:start] + data[end:])]


@in_time
@WAYS
def test_bytes_that_are_missing(both: Both, way: str) -> None:
    on_each(both, way, [without(n, n + length) for n in (0, 1, 4, 5, 14, 20, 30) for length in (1, 2, 9)])


@in_time
def test_noise_on_every_packet(both: Both) -> None:
    """Twenty packets are disturbed in each direction; then calls are normal again."""
    harm = Harm(loss=0.0, double=0.0, late=0.0, delay=TRY / 20, cut=0.0, broken=0.0, noise=0.3, gap=0.0, stop=0.2)

    async def body(noisy: Noisy, seed: int) -> None:
        for way in ("there", "back"):
            noisy.next(way, *[at_random(seed, harm, spoil_bytes)(way)] * 20)
        while not noisy.undisturbed:
            await noisy.count()
        await noisy.check(tries=1)

    with lines(both, 10) as clients:
        both.side_by_side(*map(body, clients, range(10)))


# --- interruptions of the line ----------------------------------------------------------------------------------------


def broken_at(place: int, seconds: float) -> Spoil:
    """Return a disturbance by which the rest of a packet arrives later."""
    return lambda data: [(0.0, data[:place]), (seconds, data[place:])]


@in_time
@WAYS
@pytest.mark.parametrize(
    ("seconds", "tries"),
    [(lambda: SILENCE / 3, 1), (lambda: SILENCE * 2, 2), (lambda: TRY * 1.3, 2)],
    ids=["part of a silence", "two silences", "longer than an attempt"],
)
def test_an_interruption_inside_a_packet(both: Both, way: str, seconds: Callable[[], float], tries: int) -> None:
    on_each(both, way, [broken_at(place, seconds()) for place in PLACES], tries=tries)


@in_time
@WAYS
def test_an_incomplete_packet(both: Both, way: str) -> None:
    on_each(both, way, [without(place, 1000) for place in PLACES])


def one_by_one(data: bytes) -> list[Piece]:
    return [(0.001, data[n : n + 1]) for n in range(len(data))]


@in_time
@WAYS
def test_a_packet_byte_by_byte(both: Both, way: str) -> None:
    on_each(both, way, [one_by_one], tries=1)


@in_time
def test_a_line_that_is_dead_for_a_while(both: Both) -> None:
    """Every lost packet costs exactly one time-out."""

    async def body(noisy: Noisy) -> None:
        noisy.next("there", lose, lose)
        noisy.next("back", lose)
        sent, seconds = await noisy.count()
        assert seconds >= 3 * TRY - 0.01
        if sent > 4 or seconds >= 4 * TRY:
            raise Late
        await noisy.check(tries=1)

    with lines(both, 1) as clients:
        both.side_by_side(*map(body, clients))


# --- one client after the other ----------------------------------------------------------------------------------------


@pytest.fixture
def shop() -> Counting:
    return Counting()


@pytest.fixture
def server(shop: Counting) -> Iterator[Server]:
    with orinkit.serve(shop, "pty://") as served:
        yield served


class Next:
    """The client that connects after one that was killed."""

    def __init__(self, both: Both, url: str, **options: Any) -> None:
        self._both = both
        self.sent: list[int] = []
        self.controller = both.connect(url, provider="Test.Workshop", dialect="rc8", trace=self._trace, **options)

    def _trace(self, direction: str, data: bytes) -> None:
        if direction == ">":
            self.sent.append(packet.decode(data, crc=True).code)

    def count(self, number: int) -> Any:
        return self._both.run(self.controller.execute("Count", number))

    def kill(self) -> None:
        """Close the link without Service_Stop."""
        self.controller.client._link.close()


def leave(url: str, said: bytes) -> None:
    """Send bytes as a client that is killed then."""
    with SerialRaw(url) as killed:
        killed.send(said)


@pytest.mark.parametrize("place", [1, 4, 5, 14, 15, 40, -4, -1])
def test_half_a_packet_of_a_client_that_was_killed(both: Both, server: Server, shop: Counting, place: int) -> None:
    leave(server.url, REQUEST[:place])
    client = Next(both, server.url, timeout=PATIENCE)
    assert client.count(1) == 1
    assert client.sent == [1, CONNECT, EXECUTE]  # each at the first attempt
    both.run(client.controller.close())
    assert shop.counts == [1]


def test_noise_before_the_first_client(both: Both, server: Server) -> None:
    dice = random.Random(1)
    for _ in range(5):
        leave(server.url, b"".join(noise(dice) for _ in range(dice.randrange(1, 200))))
        client = Next(both, server.url, timeout=PATIENCE)
        assert client.sent == [1, CONNECT]
        both.run(client.controller.close())


def test_the_next_client_does_not_receive_replies_to_a_killed_one(both: Both, server: Server, shop: Counting) -> None:
    with SerialRaw(server.url) as killed:
        handle = killed.open_workshop()
        for number in range(50):  # serials that the next client uses too
            killed.request(EXECUTE, handle, "Count", number, serial=number + 1, reserved=number + 1)
        until(lambda: len(shop.counts) == 50)
    client = Next(both, server.url, timeout=1.0, tries=7)
    assert [client.count(number) for number in range(50, 60)] == list(range(51, 61))
    both.run(client.controller.close())
    assert shop.counts == list(range(60))
    assert shop.released[:1] == ["Controller"]


@in_time
def test_clients_that_are_killed_one_after_the_other(both: Both) -> None:
    """Each is killed while it sends a packet, of which nothing affects the next client.

    Within a second after the Service_Start of one client, the same packet is not taken for the start of another one.
    """
    dice, shop = random.Random(1), Counting()
    with orinkit.serve(shop, "pty://") as server:
        for number in range(8):
            client = Next(both, server.url, timeout=TRY)
            try:
                assert client.count(number) == number + 1
                both.run(client.controller.variable(f"v{number}"))
                if [code for code in client.sent if code != 1] != [CONNECT, EXECUTE, 9]:
                    raise Late(f"sent: {client.sent}")
                if len(client.sent) > 3 + 1 + duplicate_filter._LATE_BYTES / TRY:
                    raise Late(f"sent: {client.sent}")
            finally:
                client.kill()
            leave(server.url, REQUEST[: dice.randrange(1, len(REQUEST))])
        assert shop.released == [name for number in range(7) for name in (f"v{number}", "Controller")]
        assert server.clients == 1
