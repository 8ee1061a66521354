"""CAN buses of every kind that requires no hardware, with virtual ABH3 drivers or with a scripted peer."""

from __future__ import annotations

import asyncio
import os
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import pytest

import can
import orinkit
from orinkit import abh3
from orinkit.abh3 import aio
from orinkit.abh3.table import ids
from orinkit.can.bus import _is_interrupted, shut
from orinkit.can.frame import CanFrame
from orinkit.can.server import serve_can
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from orinkit.virtual.clock import Clock
from support import multicast
from support.both import Both
from support.can_ptys import CrossedPtys

PATIENCE = 20.0
"""Seconds until a wait fails."""
KINDS = ("virtual", "udp_multicast", "slcan", "serial")


def only_on(*kinds: str, because: str) -> pytest.MarkDecorator:
    """Restrict a test to these kinds of bus, with the reason."""
    assert because
    return pytest.mark.parametrize("bare", kinds, indirect=True)


_NUMBERS = count()
_ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(orinkit.__file__).parent.parent)}

DRIVERS: dict[int, dict[str, Any]] = {
    1: {"command_timeout": 0, "error_timeout": 0},
    7: {"command_timeout": 0, "error_timeout": 0},
    3: {"group": 6, "command_timeout": 250, "error_timeout": 500},
    9: {"command_timeout": 0, "error_timeout": 0, "dialect": "v2", "group": 3, "load_unit": 0.1},
}
"""Drivers of the bus that tests share: two identical ones, one with a time-out error, one with the dialect of 2023."""
FAST = {"acceleration_time": 0.05, "deceleration_time": 0.05}
"""Parameters of a motor with short acceleration times."""


def rest(both: Both, seconds: float) -> None:
    """Let time pass; an event loop keeps running meanwhile."""
    if both.loop is None:
        time.sleep(seconds)
    else:
        both.run(asyncio.sleep(seconds))


def wait(both: Both, condition: Callable[[], object], seconds: float = PATIENCE) -> None:
    """Wait until a condition is true; an event loop keeps running meanwhile."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        rest(both, 0.01)


# --- where a bus is ---------------------------------------------------------------------------------------------------


@dataclass
class Place:
    """A bus without participants: two ends, which are the same URL unless the bus is a cable."""

    kind: str
    near: str
    far: str
    cable: CrossedPtys | None = None
    folder: Path | None = None

    def link(self) -> None:
        """Link stable names to the ends of the cable, as adapters have when they are plugged in again."""
        assert self.cable is not None
        assert self.folder is not None
        for name, path in (("near", self.cable.left), ("far", self.cable.right)):
            (self.folder / name).unlink(missing_ok=True)
            (self.folder / name).symlink_to(path)

    def cut(self) -> None:
        """Unplug the adapters."""
        assert self.cable is not None
        assert self.folder is not None
        for name in ("near", "far"):
            (self.folder / name).unlink()
        self.cable.cut()

    def restore(self) -> None:
        """Plug the adapters in again."""
        assert self.cable is not None
        self.cable.restore()
        self.link()


@contextmanager
def place(kind: str, folder: Path) -> Iterator[Place]:
    """Provide a bus."""
    if kind == "virtual":
        url = f"can://virtual/abh3-{os.getpid()}-{next(_NUMBERS)}"
        yield Place(kind, url, url)
    elif kind == "udp_multicast":
        url = multicast.bus()
        yield Place(kind, url, url)
    else:
        cable = CrossedPtys()
        try:
            found = Place(kind, f"can://{kind}/{folder}/near", f"can://{kind}/{folder}/far", cable, folder)
            found.link()
            yield found
        finally:
            cable.close()


def raw_bus(url: str) -> can.BusABC:
    """Open a bus with python-can alone."""
    parts = urlsplit(url)
    interface, channel = parts.netloc, parts.path[1:]
    settings: dict[str, Any] = {name: int(value) for name, value in parse_qsl(parts.query)}
    if interface == "slcan":
        settings["sleep_after_open"] = 0
    return can.Bus(interface=interface, channel=channel, ignore_config=True, **settings)


# --- drivers on it ----------------------------------------------------------------------------------------------------


@contextmanager
def process(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Run Python in a separate process, which is killed at the end."""
    with subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=_ENVIRONMENT
    ) as child:
        watchdog = threading.Timer(100.0, child.kill)  # no test may wait forever
        watchdog.start()
        try:
            yield child
        finally:
            watchdog.cancel()
            child.kill()
            child.communicate()
            watchdog.join()


def line_of(child: subprocess.Popen[str]) -> str:
    """Return the next line that a process prints."""
    assert child.stdout is not None
    line = child.stdout.readline()
    if not line:
        assert child.stderr is not None
        raise AssertionError(f"the process has ended: {child.stderr.read()}")
    return line.rstrip("\n")


def _options(address: int, given: dict[str, Any]) -> list[str]:
    return [f"--address={address}", *(f"--{name.replace('_', '-')}={value}" for name, value in given.items())]


@contextmanager
def served(kind: str, folder: Path) -> Iterator[Place]:
    """Provide a bus with :data:`DRIVERS`; with udp_multicast each driver runs in a separate process."""
    with place(kind, folder) as found, ExitStack() as stack:
        if kind == "udp_multicast":
            children = [
                stack.enter_context(process("-m", "orinkit", "serve", "abh3", found.far, *_options(address, given)))
                for address, given in DRIVERS.items()
            ]
            for child in children:
                assert line_of(child) == f"ready {found.far}"
        else:
            devices = [VirtualABH3(Parameters(address=address, **given)) for address, given in DRIVERS.items()]
            stack.enter_context(serve_can(*devices, at=found.far))
        yield found


@dataclass
class Echo:
    """A device whose replies repeat the command and identify it: feedback A and B as commanded, Y is its address."""

    address: int
    group: int = 5
    clock: Clock = field(default_factory=Clock)
    commands: int = 0

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        parts = ids.FrameId.parse(frame.id)
        if parts.pf == ids.SINGLE and parts.ps == self.address and len(frame.data) == 8:
            self.commands += 1
            data = frame.data[:4] + struct.pack("<hh", 5 * self.address, 0)
            return [CanFrame(ids.single(parts.sa, self.address), data)]
        if parts.pf == ids.REQUEST and parts.ps in (self.address, ids.EVERYONE):
            data = struct.pack("<ii", self.address, self.commands)
            return [CanFrame(ids.broadcast(self.group, frame.data[0] % 8, self.address), data)]
        return []

    def advance(self) -> list[CanFrame]:
        return []

    def due(self) -> None:
        return None

    def close(self) -> None:
        pass


# --- a peer that a test scripts ---------------------------------------------------------------------------------------

COMMAND = 0x00EF0102
FEEDBACK = 0x00EF0201
REQUEST = 0x00EA0102


def message(number: int, data: bytes = bytes(8), **kind: Any) -> can.Message:
    return can.Message(arbitration_id=number, data=data, **{"is_extended_id": True, **kind})


def feedback(a: float = 0.0, number: int = FEEDBACK) -> can.Message:
    """Return the reply to a command, with the velocity of A in min^-1."""
    return message(number, struct.pack("<hhhh", round(a * 5), 0, 0, 0))


def broadcast(number: int, first: int = 0, second: int = 0, *, source: int = 1, priority: int = 0) -> can.Message:
    data = struct.pack("<II", first & 0xFFFFFFFF, second & 0xFFFFFFFF)
    return message(priority << 26 | 0x00FF2800 | number << 8 | source, data)


class Peer:
    """The node at the other end of a bus: replies to each frame according to its script.

    Attributes:
        heard: all frames received.
        script: returns the frames to send in reply to a frame.
        served: number of frames processed, with or without a reply.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.heard: list[can.Message] = []
        self.script: Callable[[can.Message], list[can.Message]] = lambda _frame: []
        self.served = 0
        self.failed: list[Exception] = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="peer", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                found = self.bus.recv(0.05)
                if found is None or not self._is_for_me(found):
                    continue
                self.heard.append(found)
                self.send(*self.script(found))
                self.served += 1
            except Exception as error:  # noqa: BLE001 - reported by close()
                self.failed.append(error)
                return

    @staticmethod
    def _is_for_me(found: can.Message) -> bool:
        return found.arbitration_id & 0xFF == 2  # udp_multicast also delivers a node's own frames

    def send(self, *messages: can.Message) -> None:
        for each in messages:
            try:
                self.bus.send(each)
            except can.CanOperationError as error:
                if not _is_interrupted(error):
                    raise

    @property
    def data(self) -> list[str]:
        """The received frames, as ``ID#DATA`` in hex."""
        return [f"{frame.arbitration_id:08X}#{bytes(frame.data).hex(' ')}" for frame in self.heard]

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        shut(self.bus)  # slcan writes to its port on shutdown; the port may no longer exist
        assert self.failed == []


def obliging(frame: can.Message) -> list[can.Message]:
    """Reply as a driver without faults: feedback A is the A/Y command; broadcasts contain their number twice."""
    number = frame.arbitration_id & 0x03FFFFFF
    if number == COMMAND and len(frame.data) == 8:
        return [message(FEEDBACK, bytes(frame.data[:2]) + bytes(6))]
    if number in (REQUEST, 0x00EAFF02) and bytes(frame.data[1:]) == b"\xff\x00":
        return [broadcast(frame.data[0] - 0x28, frame.data[0] - 0x28, frame.data[0] - 0x28)]
    return []


def arrived(both: Both, bare: Place, driver: Any, number: int) -> None:
    """Wait until ``number`` unsolicited frames for a driver have been received."""
    if both.loop is not None:
        wait(both, lambda: len(driver._port.frames) >= number)
    elif bare.cable is not None:  # on other buses, a frame arrives as soon as it is sent
        listener = driver.listen(PATIENCE)
        for _ in range(number):
            next(listener)
        listener.close()


# --- the host ---------------------------------------------------------------------------------------------------------


class Hosts:
    """Opens drivers and buses with either client, and closes them at the end of a test."""

    def __init__(self, both: Both) -> None:
        self.both = both
        self._module: Any = abh3 if both.loop is None else aio
        self._opened: list[Any] = []

    def opening(self, at: Any, **settings: Any) -> Any:
        """Return the result of ``connect`` before it is awaited or entered."""
        return self._module.connect(at, **settings)

    def connect(self, at: Any, **settings: Any) -> Any:
        return self.keep(self.both.run(self.opening(at, **settings)))

    def open_bus(self, at: Any, **settings: Any) -> Any:
        return self.keep(self.both.run(self._module.open_bus(at, **settings)))

    def opening_bus(self, at: Any, **settings: Any) -> Any:
        """Return the result of ``open_bus`` before it is awaited or entered."""
        return self._module.open_bus(at, **settings)

    def keep(self, opened: Any) -> Any:
        self._opened.append(opened)
        return opened

    @staticmethod
    @contextmanager
    def in_vain(driver: Any, seconds: float) -> Iterator[None]:
        """Shorten the time-out of a driver for calls that get no reply."""
        before, driver.host.timeout = driver.host.timeout, seconds
        try:
            yield
        finally:
            driver.host.timeout = before

    @staticmethod
    def impatient(driver: Any, *, patience: float | None = None, idle: float | None = None) -> None:
        """Shorten the times of a running keep-alive; the steps before this one do not depend on a short time."""
        heart = driver._keep_alive_timer
        heart.patience, heart.idle = patience or heart.patience, idle or heart.idle

    def close(self) -> None:
        for opened in reversed(self._opened):
            self.both.run(opened.close())


def turn(both: Both, driver: Any) -> None:
    """Start both motors."""
    both.run(driver.set_input("servo_on", 1))
    both.run(driver.set_input("start", 1))
    both.run(driver.command(100.0, 100.0))
