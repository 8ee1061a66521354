"""The virtual ABH3: what it takes from a bus and gives to it."""

from __future__ import annotations

import math
import struct
import threading
from typing import Final

from orinkit.abh3.session.multipacket import Responder
from orinkit.abh3.table.ids import (
    BROADCAST,
    BROADCASTS,
    CONTROL,
    EVERYONE,
    REQUEST,
    SINGLE,
    TRANSFER,
    FrameId,
    broadcast,
    single,
)
from orinkit.abh3.table.records import DP0S
from orinkit.abh3.table.signals import ANALOG
from orinkit.can.frame import MAX_DATA, MAX_ID, CanFrame
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.virtual.abh3.answers import ReportBuilder
from orinkit.virtual.abh3.driver import CURRENT_CODES, CYCLES, DriverModel
from orinkit.virtual.abh3.flags import FAULTS, named
from orinkit.virtual.abh3.memory import ParameterMemory
from orinkit.virtual.abh3.parameters import Parameters, check_number
from orinkit.virtual.abh3.schedule import Schedule
from orinkit.virtual.abh3.state import MONITORS, DriverState
from orinkit.virtual.clock import Clock

_FULL: Final = 8  # bytes of a command
_REQUESTED: Final = 3  # bytes of a request
_EARLY: Final = 1e-3  # of a cycle: a sum of seconds may be a little less than what it should be
_MOST_LOAD: Final = 327.67


class VirtualABH3:
    """A motor driver with its two axes, which knows no bus: frames are given to it, and it gives frames.

    It moves as its clock does. Whoever has it calls :meth:`advance` when it is :meth:`due`. All methods may be called from
    any thread.

    Args:
        parameters: of the driver; by default those of section 1.
        clock: by default real time.

    Attributes:
        clock: as given.
    """

    def __init__(self, parameters: Parameters | None = None, *, clock: Clock | None = None) -> None:
        parameters = parameters or Parameters()
        self.clock = clock or Clock()
        self._lock = threading.RLock()
        self._began = self.clock.now()
        self._driver = DriverModel(parameters)
        self._answers = ReportBuilder(self._driver.dialect.with_load_unit(parameters.load_unit))
        self._schedule = Schedule()
        self._schedule.set(_periods(parameters), 0)
        self._memory = ParameterMemory(
            self._driver, lambda name, on: self._driver.set_terminal(name, on, self._next_cycle())
        )
        self._responder = self._new_responder()
        self._closed = False

    @property
    def parameters(self) -> Parameters:
        """Those in force; a host may have changed some."""
        with self._lock:
            return self._driver.parameters

    @property
    def address(self) -> int:
        """Its address on the bus."""
        return self.parameters.address

    def close(self) -> None:
        """Switch it off: it answers nothing from now on, and stays as it is."""
        with self._lock:
            self._closed = True

    # --- on the bus ---------------------------------------------------------------------------------------------

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        """Take a frame from the bus, whatever it is.

        Returns:
            What it answers, at once; nothing where the frame is not for it, or cannot be used.
        """
        with self._lock:
            if self._closed or not 0 <= frame.id <= MAX_ID or len(frame.data) > MAX_DATA:
                return []
            self._catch_up()
            parts = FrameId.parse(frame.id)
            if parts.reserved or parts.dp or not self._is_host(parts.sa):
                return []
            if parts.pf == SINGLE and parts.ps == self.address:
                return self._command(frame.data, parts.sa)
            if parts.pf == REQUEST and parts.ps in (self.address, EVERYONE):
                return self._request(frame.data, parts.sa)
            if parts.pf in (CONTROL, TRANSFER):
                return self._multi(self._responder.receive(frame, self.clock.now()))
            return []

    def advance(self) -> list[CanFrame]:
        """Bring it up to the time of its clock; returns what it sends unasked.

        A frame that it sends every so many ms comes once, however many periods were missed.
        """
        with self._lock:
            if self._closed:
                return []
            cycle = self._catch_up()
            frames = [self._frame(name, self._driver.parameters.host) for name in self._schedule.take(cycle)]
            return frames + self._multi(self._responder.tick(self.clock.now()))

    def due(self) -> float | None:
        """Return the time of its clock, in s, at which :meth:`advance` has something to send next; ``None`` for never."""
        with self._lock:
            if self._closed:
                return None
            cycle = self._schedule.next()
            times = [] if cycle is None else [self._began + cycle / CYCLES]
            if self._responder.next_time is not None:
                times.append(self._responder.next_time)
            return min(times, default=None)

    # --- for tests and for people -------------------------------------------------------------------------------

    def state(self) -> DriverState:
        """Return what it looks like now."""
        with self._lock:
            self._catch_up()
            return self._driver.state()

    def set_terminal(self, name: str, on: bool) -> None:
        """Switch what a terminal asks for.

        Args:
            name: of an input bit, ``"ay_servo_on"``, or of both axes, ``"servo_on"``; also ``"di_0"`` to ``"di_19"``, digital
                inputs that have no function and are only shown in the I/O flags.
            on: whether it is on. At first those are that an input is combined with by AND, and the others are not.

        Raises:
            InvalidValue: there is no such terminal.
        """
        with self._lock:
            self._catch_up()
            self._driver.set_terminal(name, on, self._next_cycle())

    def set_analog(self, number: int, volts: float) -> None:
        """Apply a voltage to analog input 0 or 1.

        Raises:
            InvalidValue: there is no such input, or the voltage is beyond -327.68 to 327.67 V.
        """
        with self._lock:
            _check_number(number, tr("analog input"))
            self._driver.analog[number] = ANALOG.decode(ANALOG.encode(volts))

    def set_monitor(self, number: int, source: str | float) -> None:
        """Choose what monitor 0 or 1 shows.

        Args:
            number: of the monitor.
            source: a quantity of :data:`~orinkit.virtual.abh3.state.MONITORS`, or a number.

        Raises:
            InvalidValue: there is no such monitor or quantity, or the number is no single float.
        """
        with self._lock:
            _check_number(number, tr("monitor"))
            if isinstance(source, str):
                named(dict.fromkeys(MONITORS, 0), source, tr("quantity"))
            self._driver.monitors[number] = source if isinstance(source, str) else _single(source)

    def set_load(self, axis: str, percent: float) -> None:
        """Let something from outside pull at an axis.

        Args:
            axis: ``"ay"`` or ``"bx"``.
            percent: of the rated current that holds it; positive where that current is.

        Raises:
            InvalidValue: there is no such axis, or it is more than 327.67 %.
        """
        with self._lock:
            named(dict.fromkeys(self._driver.drive.axes, 0), axis, tr("axis"))
            check_number("load", percent, -_MOST_LOAD, _MOST_LOAD)
            self._catch_up()
            self._driver.drive.axes[axis].load = round(percent * CURRENT_CODES)

    def inject(self, fault: str, *, stays: bool = False) -> None:
        """Raise an error as if it were a real one: the motors stop, and it is latched until it is reset.

        Args:
            fault: bit of the error flags, ``"a_overcurrent"``; ``"overcurrent"`` of both.
            stays: its cause stays, so that it cannot be reset before :meth:`repair`.

        Raises:
            InvalidValue: there is no such fault.
        """
        with self._lock:
            mask = named(FAULTS.masks, fault, tr("fault"))
            self._catch_up()
            self._driver.fail(mask, stays=stays)

    def repair(self, fault: str) -> None:
        """Take the cause of an error away; the error stays until it is reset.

        Raises:
            InvalidValue: there is no such fault.
        """
        with self._lock:
            mask = named(FAULTS.masks, fault, tr("fault"))
            self._catch_up()
            self._driver.watch.causes &= ~mask

    # --- helpers ------------------------------------------------------------------------------------------------

    def _catch_up(self) -> int:
        """Bring the driver up to the time; returns the number of the cycle that has ended last."""
        cycle = math.floor((self.clock.now() - self._began) * CYCLES + _EARLY)
        if not self._closed:
            self._driver.run(cycle)
        return cycle

    def _next_cycle(self) -> int:
        """The cycle that begins now, or else next: what takes a time takes no less."""
        return math.ceil((self.clock.now() - self._began) * CYCLES - _EARLY)

    def _is_host(self, source: int) -> bool:
        host = self._driver.parameters.host
        return source not in (self.address, EVERYONE) if host is None else source == host

    def _command(self, data: bytes, source: int) -> list[CanFrame]:
        if len(data) < _FULL:
            return []
        command = self._answers.codec.read(DP0S, "DP0S", bytes(data))
        self._driver.command(command, self._next_cycle())
        return self._single(source)

    def _request(self, data: bytes, source: int) -> list[CanFrame]:
        if len(data) < _REQUESTED:
            return []
        ps, pf, dp = data[:_REQUESTED]
        if (pf, ps, dp) == (SINGLE, 0, 0):
            return self._single(source)
        group, number = divmod(ps, BROADCASTS)
        known = number in self._driver.dialect.broadcasts and group == self._driver.parameters.group
        return [self._frame(f"BR{number}", source)] if (pf, dp) == (BROADCAST, 0) and known else []

    def _single(self, destination: int) -> list[CanFrame]:
        return [] if self._driver.parameters.single_mode is None else [self._frame("DP0R", destination)]

    def _frame(self, name: str, destination: int | None) -> CanFrame:
        parameters = self._driver.parameters
        if name == "DP0R":
            assert destination is not None  # parameters without a fixed host send it only when asked
            number = single(destination, parameters.address, priority=parameters.single_priority)
        else:
            layout = self._driver.dialect.layouts[name]
            assert layout.broadcast is not None
            number = broadcast(
                parameters.group, layout.broadcast, parameters.address, priority=parameters.broadcast_priority
            )
        return CanFrame(number, self._answers.data(name, self._driver.state()))

    def _new_responder(self) -> Responder:
        parameters = self._driver.parameters
        return Responder(parameters.address, self._memory.answer, priority=parameters.multi_priority)

    def _multi(self, frames: list[CanFrame]) -> list[CanFrame]:
        """Return the frames; what was written takes effect once the answer to it is through."""
        written = self._memory.written
        if written is not None and self._responder.next_time is None:
            self._memory.written = None
            self._driver.set(written)
            self._schedule.set(_periods(written), self._catch_up())
            self._responder = self._new_responder()
        return frames


def _periods(parameters: Parameters) -> dict[str, int]:
    """Return in how many cycles each frame is sent unasked. Broadcast 7 has no data, and is not."""
    modes = enumerate(parameters.broadcast_modes[: BROADCASTS - 1])
    return {"DP0R": parameters.single_mode or 0, **{f"BR{number}": period for number, period in modes}}


def _check_number(number: int, kind: str) -> None:
    if type(number) is not int or number not in (0, 1):
        raise InvalidValue(tr("there is {kind} 0 and 1, not {number!r:.40}", kind=kind, number=number))


def _single_error(number: object) -> InvalidValue:
    return InvalidValue(tr("a monitor shows a single float, not {number!r:.40}", number=number))


def _single(number: float) -> float:
    """Return a number as the single float that it is on the wire."""
    try:
        found = float(struct.unpack("<f", struct.pack("<f", number))[0])
    except (OverflowError, struct.error):
        raise _single_error(number) from None
    if not math.isfinite(found):
        raise _single_error(number)
    return found
