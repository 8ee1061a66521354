"""ABH3 over CAN: round trips, decoding, and a control loop of 10 ms in a busy program. Part of ``make bench``.

The bare reference is python-can itself: prepared messages, sent and received in a loop. In both cases, the peer of the
round trips is an echo that always sends the same feedback. With ``virtual``, which works only within one process, the
echo is a thread; with ``udp_multicast``, it is a separate process.
"""

from __future__ import annotations

import asyncio
import itertools
import multiprocessing.connection
import socket
import statistics
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial

import can
from measuring import ROUNDS, alternate, each_us, in_turn, line, medians, middle, on_core, process
from orinkit.abh3 import aio, connect
from orinkit.abh3.table import dbc, ids
from orinkit.abh3.table.decoder import Decoder
from orinkit.abh3.table.frames import Codec
from orinkit.can.bus import open_bus
from orinkit.can.frame import CanFrame
from orinkit.can.server import serve_can
from orinkit.core.i18n import choose
from orinkit.transport.address import CanAddress, parse_address
from orinkit.virtual.abh3 import VirtualABH3

GROUP = "239.74.163.2"
COMMAND_ID = ids.single(1, 2)
FEEDBACK_ID = ids.single(2, 1)
VELOCITIES = (100.0, -50.0)
COMMAND = can.Message(arbitration_id=COMMAND_ID, data=struct.pack("<hhI", 500, -250, 0))
FEEDBACK = can.Message(arbitration_id=FEEDBACK_ID, data=struct.pack("<hhhh", 500, -250, 125, 375))
CYCLE = 0.010
LATE = 2 * CYCLE
PIECE = 5.0  # s for which one control loop runs before the other one runs
CHANNELS = itertools.count()


def abh3(count: int, seconds: float) -> None:
    """Run all measurements; the control loops take twice ``seconds``."""
    round_trips(count)
    decoding(count)
    control_loops(seconds)


# --- peers ------------------------------------------------------------------------------------------------------------


def bus_at(url: str) -> can.BusABC:
    """Open a bus of python-can."""
    address = parse_address(url)
    assert isinstance(address, CanAddress)
    return open_bus(address)


def free_url() -> str:
    """Return the URL of an unused bus on this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        return f"can://udp_multicast/{GROUP}?port={taken.getsockname()[1]}"


def answer(bus: can.BusABC, ended: Callable[[], bool]) -> None:
    """Reply to each command with the same feedback."""
    while not ended():
        message = bus.recv(0.2)
        if message is not None and message.arbitration_id == COMMAND_ID:
            bus.send(FEEDBACK)


@contextmanager
def echo_thread() -> Iterator[str]:
    """Run the echo on a virtual bus; yield its URL."""
    url = f"can://virtual/bench-{next(CHANNELS)}"
    end = threading.Event()
    with bus_at(url) as bus:
        thread = threading.Thread(target=answer, args=(bus, end.is_set))
        thread.start()
        try:
            yield url
        finally:
            end.set()
            thread.join()


def echo_process(pipe: multiprocessing.connection.Connection) -> None:
    """Run the echo on udp_multicast."""
    on_core(-1)
    url = free_url()
    with bus_at(url) as bus:
        pipe.send(url)
        answer(bus, lambda: False)


@contextmanager
def driver_thread() -> Iterator[str]:
    """Run a virtual ABH3 on a virtual bus; yield its URL."""
    with serve_can(VirtualABH3(), at=f"can://virtual/bench-{next(CHANNELS)}") as server:
        yield server.url


def driver_process(pipe: multiprocessing.connection.Connection) -> None:
    """Run a virtual ABH3 on udp_multicast."""
    on_core(-1)
    with serve_can(VirtualABH3(), at=free_url()) as server:
        pipe.send(server.url)
        pipe.recv()  # blocks until this process is terminated


# --- round trips ------------------------------------------------------------------------------------------------------


@contextmanager
def bare_exchange(url: str) -> Iterator[Callable[[], object]]:
    """Yield a bare exchange with python-can: send a command and receive until its feedback arrives."""
    with bus_at(url) as bus:
        send, receive = bus.send, bus.recv

        def exchange() -> None:
            send(COMMAND)
            while (message := receive(1.0)) is not None:
                if message.arbitration_id == FEEDBACK_ID:  # udp_multicast also returns the frames that were sent
                    return
            raise TimeoutError("no reply")

        yield exchange


def synchronous(url: str, bare: Callable[[], object], count: int) -> tuple[float, float, float]:
    """Alternate commands and bare exchanges; return both medians and their ratio."""
    with connect(url) as driver:
        command = driver.command
        return in_turn(lambda: command(*VELOCITIES), bare, count)


async def asynchronous(url: str, bare: Callable[[], object], count: int) -> tuple[float, float, float]:
    """Alternate commands in asyncio and bare exchanges; return both medians and their ratio."""
    ours, other = [], []
    async with aio.connect(url) as driver:
        for _ in range(count):
            begin = time.perf_counter()
            await driver.command(*VELOCITIES)
            between = time.perf_counter()
            bare()
            ours.append(between - begin)
            other.append(time.perf_counter() - between)
    return medians(ours, other)


async def both_in_asyncio(url: str, bare_url: str, count: int) -> tuple[float, float, float]:
    """Alternate commands in asyncio with python-can's own asyncio API: a Notifier with a reader."""
    ours, other = [], []
    reader = can.AsyncBufferedReader()
    with bus_at(bare_url) as bus, can.Notifier(bus, [reader], loop=asyncio.get_running_loop()):
        async with aio.connect(url) as driver:
            for _ in range(count):
                begin = time.perf_counter()
                await driver.command(*VELOCITIES)
                between = time.perf_counter()
                bus.send(COMMAND)
                while (await reader.get_message()).arbitration_id != FEEDBACK_ID:
                    pass
                ours.append(between - begin)
                other.append(time.perf_counter() - between)
    return medians(ours, other)


def round_trips(count: int) -> None:
    """Measure a command and its feedback, with an echo and with a virtual driver."""
    with echo_thread() as url, echo_thread() as bare_url:
        against(choose("virtual, echo", "virtual, エコー"), url, bare_url, count, "aim <= 1.3")
    with driver_thread() as url, echo_thread() as bare_url:
        against(choose("virtual, virtual ABH3", "virtual, 仮想 ABH3"), url, bare_url, count // 2)
    with process(echo_process) as url, process(echo_process) as bare_url:
        against(choose("udp_multicast, echo", "udp_multicast, エコー"), url, bare_url, count // 2)
    with process(driver_process) as url, process(echo_process) as bare_url:
        against(choose("udp_multicast, virtual ABH3", "udp_multicast, 仮想 ABH3"), url, bare_url, count // 2)


def against(where: str, url: str, bare_url: str, count: int, aim: str = "") -> None:
    """Measure the round trip of the host, synchronous and in asyncio."""
    each = max(10, count // ROUNDS)
    command = choose("command", "指令")
    with bare_exchange(bare_url) as bare:
        results = [synchronous(url, bare, each) for _ in range(ROUNDS)]
        line(f"ABH3 {command}, {where}, sync", *middle(results), "us", aim)
        results = [asyncio.run(asynchronous(url, bare, each)) for _ in range(ROUNDS)]
        line(f"ABH3 {command}, {where}, async", *middle(results), "us")
    results = [asyncio.run(both_in_asyncio(url, bare_url, each)) for _ in range(ROUNDS)]
    line(f"ABH3 {command}, {where}, async", *middle(results), "us", choose("bare: asyncio too", "素: 同じく asyncio"))


# --- decoding ---------------------------------------------------------------------------------------------------------

FRAMES = {
    "DP0R": (FEEDBACK_ID, struct.pack("<hhhh", 500, -250, 125, 375)),
    "BR0": (ids.broadcast(5, 0, 1), struct.pack("<II", 0x00400000, 0x00400000)),
    "BR6": (ids.broadcast(5, 6, 1), struct.pack("<ff", 1.5, -2.25)),
}


def by_hand(name: str) -> Callable[[bytes], object]:
    """Return a minimal decoder for a frame."""
    if name != "DP0R":
        return struct.Struct("<II" if name == "BR0" else "<ff").unpack
    unpack = struct.Struct("<hhhh").unpack

    def velocities(data: bytes) -> tuple[float, ...]:
        a, b, y, x = unpack(data)
        return a / 5, b / 5, y / 5, x / 5

    return velocities


def decoding(count: int) -> None:
    """Measure decoding frames; the references are struct with a division, and cantools with the DBC of orinkit."""
    from cantools.database.can import Database

    database = Database()
    database.add_dbc_string(dbc.dbc("v1"))
    codec, decode_frame = Codec(), Decoder().decode
    for name, (number, data) in FRAMES.items():
        decode, from_dbc = partial(codec.decode, name, data), partial(database.decode_message, number, data)
        least = partial(by_hand(name), data)
        shown(choose(f"ABH3 {name} to a record", f"ABH3 {name} をレコードに"), decode, least, from_dbc, count)
    number, data = FRAMES["DP0R"]
    whole, from_dbc = partial(decode_frame, CanFrame(number, data, 1.0)), partial(database.decode_message, number, data)
    what = choose("ABH3 DP0R, all contents with texts", "ABH3 DP0R の全内容 (項目名付き)")
    shown(what, whole, partial(by_hand("DP0R"), data), from_dbc, count)


def shown(
    what: str, ours: Callable[[], object], least: Callable[[], object], from_dbc: Callable[[], object], count: int
) -> None:
    """Compare a decoder with both references."""
    for other, beside in ((least, "struct"), (from_dbc, "cantools")):
        mine, bare, ratio = alternate(lambda: each_us(ours, count), lambda: each_us(other, count), 5)  # noqa: B023 - called in this iteration
        line(
            what,
            mine,
            bare,
            ratio,
            "us",
            choose(f"{1e6 / mine:,.0f} /s, bare: {beside}", f"{1e6 / mine:,.0f} /s, 素: {beside}"),
        )


# --- a control loop ---------------------------------------------------------------------------------------------------


@dataclass
class Loop:
    """Result of a control loop.

    Attributes:
        periods: Times from each command to the next one in s.
        trips: Times from each command to its feedback in s.
    """

    periods: list[float] = field(default_factory=list)
    trips: list[float] = field(default_factory=list)

    def run(self, action: Callable[[], object], seconds: float) -> None:
        """Run an action every 10 ms; after a late cycle, the next cycle starts immediately."""
        clock = time.monotonic
        end = clock() + seconds
        due = clock()
        before = 0.0
        while (now := clock()) < end:
            action()
            self.trips.append(clock() - now)
            if before:
                self.periods.append(now - before)
            before = now
            due = max(due + CYCLE, clock())
            time.sleep(max(0.0, due - clock()))

    def show(self, what: str) -> None:
        """Print one line."""
        late = sum(period > LATE for period in self.periods)
        print(
            choose(
                f"{what}: {len(self.periods)} cycles, period {percentiles(self.periods)}, later than 20 ms: {late}; "
                f"round trip {percentiles(self.trips)}",
                f"{what}: {len(self.periods)} 周期, 周期 {percentiles(self.periods)}, 20 ms 超過: {late}; 往復 {percentiles(self.trips)}",
            ),
            flush=True,
        )


def percentiles(times: list[float]) -> str:
    """Return p50, p99 and the maximum of times in s as text in ms."""
    cuts = statistics.quantiles(times, n=100, method="inclusive")
    return f"p50 {cuts[49] * 1e3:.2f} p99 {cuts[98] * 1e3:.2f} max {max(times) * 1e3:.2f} ms"


@contextmanager
def busy(threads: int) -> Iterator[None]:
    """Run threads that do nothing but count."""
    end = threading.Event()

    def count() -> None:
        number = 0
        while not end.is_set():
            for _ in range(10_000):
                number += 1

    workers = [threading.Thread(target=count) for _ in range(threads)]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        end.set()
        for worker in workers:
            worker.join()


def control_loops(seconds: float) -> None:
    """Measure commands every 10 ms, with this host and with bare python-can, without and with a busy thread."""
    for threads, share in ((0, 0.1), (1, 1.0)):
        ours, bare = Loop(), Loop()
        piece = min(PIECE, seconds * share)
        with ExitStack() as stack:
            url, bare_url = (stack.enter_context(process(driver_process)) for _ in range(2))
            driver = stack.enter_context(connect(url))
            exchange = stack.enter_context(bare_exchange(bare_url))
            stack.enter_context(busy(threads))
            for _ in range(max(1, round(seconds * share / piece))):
                ours.run(lambda: driver.command(*VELOCITIES), piece)  # noqa: B023 - called within this iteration
                bare.run(exchange, piece)
        ours.show(
            choose(f"ABH3, 10 ms loop, {threads} busy threads", f"ABH3, 10 ms 制御ループ, 負荷スレッド {threads}")
        )
        bare.show(choose("   the same with bare python-can", "   python-can のみで同じ処理"))
