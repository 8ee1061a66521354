"""The virtual ABH3: it receives frames and returns frames."""

from __future__ import annotations

import math
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
from orinkit.core.validation import brief, check_range, check_whole, real, rounded_to_single
from orinkit.virtual.abh3.answers import ReportBuilder
from orinkit.virtual.abh3.driver import CURRENT_CODES, CYCLES, DriverModel
from orinkit.virtual.abh3.flags import FAULTS, named
from orinkit.virtual.abh3.memory import ParameterMemory
from orinkit.virtual.abh3.parameters import Parameters
from orinkit.virtual.abh3.schedule import Schedule
from orinkit.virtual.abh3.state import MONITORS, DriverState
from orinkit.virtual.clock import Clock

_COMMAND_SIZE: Final = 8  # bytes
_REQUEST_SIZE: Final = 3  # bytes
_ROUNDING: Final = 1e-3  # of a cycle: tolerance for the rounding of sums of seconds
_MAX_LOAD: Final = 327.67  # %


class VirtualABH3:
    """A motor driver with two axes. It is not connected to a bus: it receives frames and returns frames.

    The driver's time is the time of its clock. The program that uses the driver must call :meth:`advance` at the time
    that :meth:`due` returns. All methods are thread-safe.

    Args:
        parameters: Parameters of the driver; by default those of section 1 of the manufacturer's document.
        clock: Clock of the driver; by default real time.

    Attributes:
        clock: Clock of the driver.
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
        """The present parameters, including changes by hosts."""
        with self._lock:
            return self._driver.parameters

    @property
    def address(self) -> int:
        """Address of the driver on the bus."""
        return self.parameters.address

    def close(self) -> None:
        """Switch the driver off: it sends no more frames, and its state no longer changes."""
        with self._lock:
            self._closed = True

    # --- bus ----------------------------------------------------------------------------------------------------

    def receive(self, frame: CanFrame) -> list[CanFrame]:
        """Process a frame from the bus.

        Returns:
            The immediate replies; empty if the frame is not for this driver, or is not valid.
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
        """Advance the driver to the time of its clock; return the frames that are due by then.

        These are periodic frames and further frames of a multi-packet message. A periodic frame is returned once,
        even if several periods were missed.
        """
        with self._lock:
            if self._closed:
                return []
            cycle = self._catch_up()
            frames = [self._frame(name, self._driver.parameters.host) for name in self._schedule.take(cycle)]
            return frames + self._multi(self._responder.tick(self.clock.now()))

    def due(self) -> float | None:
        """Return the time of the clock, in s, at which :meth:`advance` must be called next; ``None`` for never."""
        with self._lock:
            if self._closed:
                return None
            cycle = self._schedule.next()
            times = [] if cycle is None else [self._began + cycle / CYCLES]
            if self._responder.next_time is not None:
                times.append(self._responder.next_time)
            return min(times, default=None)

    # --- access from outside the bus ----------------------------------------------------------------------------

    def state(self) -> DriverState:
        """Return the present state."""
        with self._lock:
            self._catch_up()
            return self._driver.state()

    def set_terminal(self, name: str, on: bool) -> None:
        """Switch a terminal on or off.

        Args:
            name: Name of an input bit of one axis, for example ``"ay_servo_on"``, or of both axes, for example
                ``"servo_on"``. ``"di_0"`` to ``"di_19"`` are digital inputs without a function; they only appear in the
                I/O flags.
            on: True for on. Initially the terminals that are combined with an input by AND are on; the others are off.

        Raises:
            InvalidValue: If there is no such terminal.
        """
        with self._lock:
            self._catch_up()
            self._driver.set_terminal(name, on, self._next_cycle())

    def set_analog(self, number: int, volts: float) -> None:
        """Apply a voltage to analog input 0 or 1.

        Raises:
            InvalidValue: If there is no such input, or the voltage is not -327.68 to 327.67 V.
        """
        with self._lock:
            check_whole(tr("analog input"), number, 1)
            self._driver.analog[number] = ANALOG.decode(ANALOG.encode(volts))

    def set_monitor(self, number: int, source: str | float) -> None:
        """Set the quantity or value that monitor 0 or 1 shows.

        Args:
            number: Number of the monitor.
            source: A quantity of :data:`~orinkit.virtual.abh3.state.MONITORS`, or a constant number.

        Raises:
            InvalidValue: If there is no such monitor or quantity, or the number is not finite in single precision.
        """
        with self._lock:
            check_whole(tr("monitor"), number, 1)
            if isinstance(source, str):
                named(dict.fromkeys(MONITORS, 0), source, tr("quantity"))
            self._driver.monitors[number] = source if isinstance(source, str) else _single(source)

    def set_load(self, axis: str, percent: float) -> None:
        """Apply an external load to an axis.

        Args:
            axis: ``"ay"`` or ``"bx"``.
            percent: Current that is needed to hold the load, % of the rated current; its sign is the direction.

        Raises:
            InvalidValue: If there is no such axis, or the load is not -327.67 to 327.67 %.
        """
        with self._lock:
            named(dict.fromkeys(self._driver.drive.axes, 0), axis, tr("axis"))
            check_range("load", percent, -_MAX_LOAD, _MAX_LOAD)
            self._catch_up()
            self._driver.drive.axes[axis].load = round(percent * CURRENT_CODES)

    def inject(self, fault: str, *, stays: bool = False) -> None:
        """Raise an error as a real fault does: the motors stop, and the error is latched until it is reset.

        Args:
            fault: Name of a bit of the error flags, for example ``"a_overcurrent"``; ``"overcurrent"`` for both motors.
            stays: True if the cause of the error remains, so that the error cannot be reset before :meth:`repair`.

        Raises:
            InvalidValue: If there is no such fault.
        """
        mask = _fault_mask(fault)
        with self._lock:
            self._catch_up()
            self._driver.fail(mask, stays=stays)

    def repair(self, fault: str) -> None:
        """Remove the cause of an error raised by :meth:`inject`; the error remains until it is reset.

        Args:
            fault: The name that was passed to :meth:`inject`.

        Raises:
            InvalidValue: If there is no such fault.
        """
        causes = _fault_mask(fault)
        with self._lock:
            self._catch_up()
            self._driver.watch.causes &= ~causes

    # --- helpers ------------------------------------------------------------------------------------------------

    def _catch_up(self) -> int:
        """Advance the driver to the present time; return the number of the last completed cycle."""
        cycle = math.floor((self.clock.now() - self._began) * CYCLES + _ROUNDING)
        if not self._closed:
            self._driver.run(cycle)
        return cycle

    def _next_cycle(self) -> int:
        """Return the number of the cycle that begins now or next; a time-out counted from it never ends too early."""
        return math.ceil((self.clock.now() - self._began) * CYCLES - _ROUNDING)

    def _is_host(self, source: int) -> bool:
        host = self._driver.parameters.host
        return source not in (self.address, EVERYONE) if host is None else source == host

    def _command(self, data: bytes, source: int) -> list[CanFrame]:
        if len(data) < _COMMAND_SIZE:
            return []
        command = self._answers.codec.read(DP0S, "DP0S", bytes(data))
        self._driver.command(command, self._next_cycle())
        return self._single(source)

    def _request(self, data: bytes, source: int) -> list[CanFrame]:
        if len(data) < _REQUEST_SIZE:
            return []
        ps, pf, dp = data[:_REQUEST_SIZE]
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
            assert destination is not None  # without a fixed host it is only sent on request
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
        """Return ``frames``; if they complete the reply to a write request, apply the written parameters."""
        written = self._memory.written
        if written is not None and self._responder.next_time is None:
            self._memory.written = None
            self._driver.set(written)
            self._schedule.set(_periods(written), self._catch_up())
            self._responder = self._new_responder()
        return frames


def _periods(parameters: Parameters) -> dict[str, int]:
    """Return the period of each frame in cycles, 0 or less for none; broadcast 7 has no data and is never sent."""
    modes = enumerate(parameters.broadcast_modes[: BROADCASTS - 1])
    return {"DP0R": parameters.single_mode or 0, **{f"BR{number}": period for number, period in modes}}


def _single(number: float) -> float:
    """Return a number rounded to single precision.

    Raises:
        InvalidValue: If the number is not finite in single precision.
    """
    given = real(number)
    try:
        if given is not None:
            return rounded_to_single(given)
    except OverflowError:
        pass
    raise InvalidValue(tr("a monitor must be a finite single-precision number, not {number}", number=brief(number)))


def _fault_mask(fault: str) -> int:
    return named(FAULTS.masks, fault, tr("fault"))
