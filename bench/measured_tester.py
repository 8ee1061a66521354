"""``orinkit tester`` that measures itself: ``python bench/measured_tester.py tester ...``, for bench/tester.py.

Commands are lines of JSON on stdin: ``fill`` (packets), ``load`` (packets per s), ``stream`` (s), ``reset``, ``report``.
The reply to each command is a line of JSON on stdout.

The event loop is measured in two ways. A *block* is a callback that has used the processor for a time. A *delay* is the
time by which the loop is late; on a busy machine it also contains the time for which other programs use the processor.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from asyncio.events import Handle
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from orinkit.bcap import packet as bcap
from orinkit.cao import functions as f
from orinkit.cli.app import main
from orinkit.core.errors import OrinError
from orinkit.streaming.trajectory import generators
from orinkit.tester import server
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.slave_move import SlaveMove
from orinkit.tester.state.slave_options import SlaveMoveOptions
from orinkit.tester.state.slave_trajectory import SlaveTrajectory
from orinkit.tester.state.workspace import Workspace
from orinkit.tester.ui.presence import Presence
from orinkit.values.variant import Variant, VarType

START = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
PERIOD = 4.0  # s of one sine
TICK = 0.002  # s
TURN = 0.01  # s between two turns of the load


class Loop:
    """Measures the event loop.

    Attributes:
        block: The longest callback, s of processor time.
        where: Name of that callback.
        delay: The largest delay, s.
    """

    def __init__(self) -> None:
        self.reset()
        self._expected = 0.0
        self._watch_callbacks()

    def reset(self) -> None:
        """Begin again."""
        self.block, self.where, self.delay = 0.0, "", 0.0
        self._delays: deque[float] = deque(maxlen=100_000)

    def _watch_callbacks(self) -> None:
        run, clock = Handle._run, time.thread_time

        def measured(handle: Handle) -> None:
            begin = clock()
            run(handle)
            taken = clock() - begin
            if taken > self.block:
                self.block, self.where = taken, _name(handle)

        Handle._run = measured  # type: ignore[method-assign, assignment]  # replaced to measure it

    def tick(self) -> None:
        """Measure the delay, again and again."""
        loop = asyncio.get_running_loop()
        now = loop.time()
        if self._expected:
            delay = max(0.0, now - self._expected)
            self._delays.append(delay)
            self.delay = max(self.delay, delay)
        self._expected = now + TICK
        loop.call_later(TICK, self.tick)

    def report(self) -> dict[str, Any]:
        """Return the figures in ms."""
        ordered = sorted(self._delays)
        p99 = ordered[int(0.99 * len(ordered))] if ordered else 0.0
        return {"block": self.block * 1e3, "where": self.where, "delay": self.delay * 1e3, "delay_p99": p99 * 1e3}


def _name(handle: Handle) -> str:
    callback = getattr(handle, "_callback", None)
    task = getattr(callback, "__self__", None)
    if isinstance(task, asyncio.Task):
        coroutine = task.get_coro()
        return f"{getattr(coroutine, '__qualname__', coroutine)} ({task.get_name()})"[:100]
    return f"{getattr(callback, '__qualname__', callback)}"[:100]


class Heartbeats:
    """Measures the time between two heartbeats of a page.

    Attributes:
        longest: The longest time, s.
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._last: dict[Presence, float] = {}
        beat = Presence._beat

        def measured(presence: Presence, event: Any) -> None:
            now = time.monotonic()
            last = self._last.get(presence)
            if last is not None:
                self.longest = max(self.longest, now - last)
            self._last[presence] = now
            beat(presence, event)

        Presence._beat = measured  # type: ignore[method-assign, assignment]  # replaced to measure it

    def reset(self) -> None:
        """Begin again."""
        self.longest = 0.0
        self._last.clear()


class MeasuredWorkspace(Workspace):
    """A workspace that measures the event loop, and obeys commands."""

    def __init__(self, profiles: Path | None = None) -> None:
        super().__init__(profiles)
        self._loop = Loop()
        self._loop.tick()
        self._heartbeats = Heartbeats()
        self._rate = 0.0
        self._calls = 0
        self._since = time.monotonic()
        self._move: SlaveMove | None = None
        self._tasks = [asyncio.ensure_future(each) for each in (self._obey(), self._load())]

    async def _obey(self) -> None:
        reader = asyncio.StreamReader()
        commands: dict[str, Callable[..., object]] = {
            "fill": self.fill, "load": self.load, "reset": self.reset, "stream": self.stream, "report": self.report,
        }  # fmt: skip
        await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        while line := await reader.readline():
            command, *values = json.loads(line)
            reply = commands[command](*values)
            print(json.dumps(reply), flush=True)

    def fill(self, count: int) -> int:
        """Fill the log with packets."""
        request = bcap.encode(bcap.Packet(7, 101, [Variant(VarType.I4, 3)]))
        reply = bcap.encode(bcap.Packet(7, 0, [Variant(VarType.R8 | 0x2000, [1.0] * 8)]))
        now = time.time_ns()
        for index in range(count):
            received = index % 2
            data = reply if received else request
            self.packets.add("filled", "tcp", "<" if received else ">", data, now - (count - index) * 1_000_000)
        return len(self.packets)

    def load(self, rate: float) -> float:
        """Make calls, so that ``rate`` packets per second are added to the log."""
        self._rate, self._calls, self._since = rate, 0, time.monotonic()
        return rate

    def reset(self) -> None:
        """Begin to measure."""
        self._loop.reset()
        self._heartbeats.reset()
        self._calls, self._since = 0, time.monotonic()

    def stream(self, seconds: float) -> None:
        """Begin a Slave Move: whole sines of joint 1."""
        points = generators.sine(START, 1, 20.0, PERIOD, max(1, round(seconds / PERIOD)))
        trajectory = SlaveTrajectory("J", points, "sine")
        options = SlaveMoveOptions(2, approach=100.0)
        self._move = self.slave_moves.start(self._connection(), trajectory, options, absent=lambda: "")

    def report(self) -> dict[str, Any]:
        """Return all figures."""
        rate = 2 * self._calls / max(time.monotonic() - self._since, 1e-9)
        return {
            **self._loop.report(), "packets": rate, "kept": len(self.packets), "stream": self._stream(),
            "heartbeat": self._heartbeats.longest * 1e3,
        }  # fmt: skip

    def _stream(self) -> dict[str, Any] | None:
        move = self._move
        if move is None:
            return None
        result = move.result
        return {
            "finished": move.finished,
            "error": f"{move.error or move.reason}",
            "sent": move.trace.count,
            "late_gaps": move.trace.late_gaps,
            "longest_gap": move.trace.longest_gap * 1e3,
            "missed": (result.underflows + result.late.count) if result else 0,
        }

    def _connection(self) -> ControllerConnection:
        return next(each for each in self if isinstance(each, ControllerConnection))

    async def _load(self) -> None:
        variable = None
        while True:
            await asyncio.sleep(TURN)
            wanted = int((time.monotonic() - self._since) * self._rate / 2)
            if not self._rate or self._calls >= wanted:
                continue
            try:
                objects = self._connection().objects
                if variable is None:
                    assert objects.controller is not None
                    made = await objects.call(objects.controller, f.controller_get_variable, "I1", "")
                    variable = made.created
                assert variable is not None
                while self._calls < wanted:
                    await objects.call(variable, f.variable_get_value)
                    self._calls += 1
            except OrinError as error:
                print(f"load: {error}", file=sys.stderr)
                variable = None


if __name__ == "__main__":
    vars(server)["Workspace"] = MeasuredWorkspace
    sys.exit(main(sys.argv[1:]))
