"""Devices for tests of clients and servers.

:class:`Recorder` implements every function of the table. It records each call, and its result depends on function, object
and arguments, so a misrouted reply is detected. :class:`Workshop` has handlers that are slow, wait, or fail.
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
    """A call as received by the device: name in the document, path of the object, arguments as plain values."""

    function: str
    path: str
    arguments: tuple[Any, ...]


def answer(function: Function[..., Any], path: str, arguments: Sequence[Any]) -> Any:
    """Return the result of a call of :class:`Recorder`."""
    text = f"{function.name}|{path}|{list(arguments)!r}"
    if function.result is VarType.I4:
        return zlib.crc32(text.encode()) - 2**31
    if function.result is VarType.BSTR:
        return text
    return [text, float(len(text)), True] if function.result is VarType.VARIANT else None


class Recorded:
    """Mixin of the objects of a :class:`Recorder`."""

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
        calls: the calls in order, including releases; objects are also released when a client disconnects.
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
        """Wait for a call; return False after a time-out."""
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
    """The controller object of :class:`Workshop`."""

    def __init__(self, workshop: Workshop) -> None:
        super().__init__("Workshop")
        self._workshop = workshop

    def execute(self, command: str, parameter: Variant) -> Any:
        shop = self._workshop
        if command == "Echo":
            return parameter
        if command == "EchoLater":  # [value, number of iterations of the event loop]
            return self._later(parameter)
        if command == "Wait":  # until the test opens the gate; returns the parameter
            return self._wait(parameter)
        if command == "Block":  # the same in a worker thread
            return BlockingCall(lambda: shop.block(parameter))
        if command == "Tidy":  # takes 20 ms to be cancelled
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
    """A variable that stores the value written to it."""

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
    """A device whose commands wait until the test opens the gate.

    Attributes:
        gate: set to let waiting handlers continue.
        at_work: released once for each handler that has begun to wait.
        cancelled: released once for each ``async`` handler that has been cancelled.
        made, released: names of the objects, in order.
        let_go: released once for each variable that has been released.
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
