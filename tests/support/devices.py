"""Devices for tests of clients and servers.

:class:`Recorder` has every function of the table. It notes each call, and its answer depends on function, object and
arguments, so an answer that went astray is seen. :class:`Workshop` works slowly, waits, fails: whatever a handler may do.
"""

from __future__ import annotations

import asyncio
import threading
import zlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from orinkit.cao import provider as p
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.provider import BlockingCall, ClientInfo, Provider
from orinkit.cao.table import Function
from orinkit.core.errors import error_for
from orinkit.values.variant import Variant, VarType, plain
from support.waiting import PATIENCE


class Call(NamedTuple):
    """One call as the device got it: the document's name, the object's path, the arguments as plain values."""

    function: str
    path: str
    arguments: tuple[Any, ...]


def answer(function: Function[..., Any], path: str, arguments: Sequence[Any]) -> Any:
    """What :class:`Recorder` answers a call with."""
    text = f"{function.name}|{path}|{list(arguments)!r}"
    if function.result is VarType.I4:
        return zlib.crc32(text.encode()) - 2**31
    if function.result is VarType.BSTR:
        return text
    return [text, float(len(text)), True] if function.result is VarType.VARIANT else None


class Recorded:
    """What the objects of a :class:`Recorder` have beside their methods."""

    recorder: Recorder
    path: str
    kind: str

    def release(self) -> None:
        self.recorder.note(Call(_RELEASES[self.kind], self.path, ()))


_BASES: dict[str, type[p.CaoObject]] = {
    "Controller": p.ControllerObject, "Extension": p.ExtensionObject, "File": p.FileObject, "Robot": p.RobotObject,
    "Task": p.TaskObject, "Variable": p.VariableObject, "Command": p.CommandObject, "Message": p.MessageObject,
}  # fmt: skip
_RELEASES = {entry.interface: entry.name for entry in FUNCTIONS.values() if entry.releases}


def _method(function: Function[..., Any]) -> Callable[..., Any]:
    def method(self: Any, *arguments: Any) -> Any:
        values = tuple(map(plain, arguments))
        self.recorder.note(Call(function.name, self.path, values))
        if function.creates:
            return self.recorder.make(function.creates, f"{self.path}/{values[0] if values else 'message'}")
        return answer(function, self.path, values)

    return method


_CLASSES = {
    interface: type(
        f"Recorded{interface}",
        (Recorded, base),
        {f.method: _method(f) for f in FUNCTIONS.values() if f.interface == interface and not f.releases},
    )
    for interface, base in _BASES.items()
}


class Recorder(Provider):
    """A device with all 137 functions.

    Attributes:
        calls: what was called, in order, releases too; they come also when a client has gone.
    """

    provider_names = ("Test.Recorder",)

    def __init__(self) -> None:
        self.calls: list[Call] = []
        self.released = threading.Condition()

    def note(self, call: Call) -> None:
        with self.released:
            self.calls.append(call)
            self.released.notify_all()

    def wait_for(self, call: Call, seconds: float = PATIENCE) -> bool:
        """Wait until a call has been made; False if it has not been in that time."""
        with self.released:
            return self.released.wait_for(lambda: call in self.calls, seconds)

    def make(self, interface: str, path: str) -> Any:
        made: Any = _CLASSES[interface](path)
        made.recorder, made.path, made.kind = self, path, interface
        return made

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        self.note(Call("Controller_Connect", "", (name, machine, option)))
        return self.make("Controller", name)


class WorkshopController(p.ControllerObject):
    """Executes commands that wait; see :class:`Workshop`."""

    def __init__(self, workshop: Workshop) -> None:
        super().__init__("Workshop")
        self._workshop = workshop

    def execute(self, command: str, parameter: Variant) -> Any:
        shop = self._workshop
        if command == "Echo":
            return parameter
        if command == "EchoLater":  # [value, how many turns of the event loop]
            return self._later(parameter)
        if command == "Wait":  # until the test opens the gate; the parameter comes back
            return self._wait(parameter)
        if command == "Block":  # the same in a worker thread
            return BlockingCall(lambda: shop.block(parameter))
        if command == "Tidy":  # takes its time to be cancelled
            return self._tidy()
        if command == "Fail":
            raise error_for(int(plain(parameter)) & 0xFFFFFFFF)
        if command == "Crash":
            raise RuntimeError("the device is broken")
        if command == "CrashLater":
            return self._crash()
        if command == "CrashBlocking":
            return BlockingCall(lambda: 1 // 0)
        if command == "Large":
            return bytes(int(plain(parameter)))
        raise p.not_implemented()

    async def _later(self, parameter: Variant) -> Any:
        value, turns = plain(parameter)
        for _ in range(int(turns)):
            await asyncio.sleep(0)
        return value

    async def _wait(self, parameter: Variant) -> Any:
        shop = self._workshop
        shop.at_work.release()
        try:
            while not shop.gate.is_set():  # noqa: ASYNC110 - the gate is opened by a thread
                await asyncio.sleep(0.002)
        except asyncio.CancelledError:
            shop.cancelled.release()
            raise
        return parameter

    async def _tidy(self) -> None:
        self._workshop.at_work.release()
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0.02)
            self._workshop.cancelled.release()

    async def _crash(self) -> None:
        await asyncio.sleep(0)
        raise RuntimeError("the device is broken")

    def get_variable(self, name: str, option: str) -> Any:
        shop = self._workshop
        if name.startswith("slow"):
            return BlockingCall(lambda: shop.slow_variable(name))
        return WorkshopVariable(name, shop)

    def release(self) -> None:
        self._workshop.released.append("Controller")


class WorkshopVariable(p.VariableObject):
    """A variable that keeps what is written to it."""

    def __init__(self, name: str, workshop: Workshop) -> None:
        super().__init__(name)
        self._workshop = workshop
        self._value = Variant(VarType.EMPTY)
        workshop.made.append(name)

    def get_value(self) -> Any:
        return self._value

    def put_value(self, value: Variant) -> None:
        self._value = value

    def release(self) -> None:
        self._workshop.released.append(self.name)
        self._workshop.let_go.release()


class Workshop(Provider):
    """A device whose commands wait until the test says go.

    Attributes:
        gate: handlers that wait go on when it is set.
        at_work: is released once for each handler that has begun to wait.
        cancelled: is released once for each ``async`` handler that has been cancelled.
        made, released: names of the objects, in order.
        let_go: is released once for each variable that has been released.
    """

    provider_names = ("Test.Workshop",)

    def __init__(self) -> None:
        self.gate = threading.Event()
        self.at_work = threading.Semaphore(0)
        self.cancelled = threading.Semaphore(0)
        self.made: list[str] = []
        self.released: list[str] = []
        self.let_go = threading.Semaphore(0)
        self.closed = 0

    def block(self, value: Any) -> Any:
        self.at_work.release()
        assert self.gate.wait(PATIENCE)
        return value

    def slow_variable(self, name: str) -> WorkshopVariable:
        self.block(None)
        return WorkshopVariable(name, self)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> WorkshopController:
        return WorkshopController(self)

    def close(self) -> None:
        self.closed += 1
        self.gate.set()
