"""The mechanics of the arm: loads, encoders that follow the command position, and the control log.

The encoders reach each command position :data:`LAG` cycles later. The loads are estimates
(:mod:`orinkit.virtual.engine.dynamics`), not those of a real arm.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from orinkit.arms import ArmModel
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.variant import Value
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.engine.motor_loads import RATED_SPEED, MotorLoads

LAG: Final = 3
"""Cycles by which the encoders lag behind the command."""

AXES: Final = 8
LOG_TIME: Final = 100
"""Initial duration of the control log, s; the oldest records are dropped first."""
LOG_INTERVAL: Final = 8
"""Initial interval of the control log, ms: the length of a cycle."""
_LONGEST_LOG: Final = 600  # s
_LONGEST_INTERVAL: Final = 1000  # ms

ACCURATE_LAG: Final = 1
"""Cycles by which the encoders lag behind the command with HighPathAccuracy."""

_RATED_CURRENT: Final = 3.0  # A
_COMPLIANCE: Final = 1e-4  # deg for each percent of load
_SPACING: Final = 62  # cycles between the samples of the load factor: about 0.5 s
_SAMPLES: Final = 20  # of the load factor: 10 s


@record
class ServoSample:
    """State of the arm in one cycle.

    Attributes:
        command: Command position of each axis, deg (mm for a linear axis).
        encoder: Encoder value of each axis, deg (mm for a linear axis).
        load: Load of each axis in percent of the rated torque, signed.
        current: Motor current of each axis in A, signed.
    """

    command: tuple[float, ...]
    encoder: tuple[float, ...]
    load: tuple[float, ...]
    current: tuple[float, ...]


class Servo:
    """The encoders of an arm, which follow the command position cycle by cycle.

    Attributes:
        command: The newest command position, deg (mm for a linear axis).
        encoder: The newest encoder values, deg (mm for a linear axis).
        frozen: True if the arm does not follow the command (machine lock).
        braked: True if the brakes hold the axes, because the motor is off: no axis yields to its current limit.
        lag: Cycles by which the encoders lag behind the command; it may change at standstill only.
        loads: Loads of the motors.
        travelled: Distance that each axis has moved since the controller was switched on, deg (mm for a linear axis).
    """

    def __init__(self, model: ArmModel, joints: Sequence[float]) -> None:
        self._model = model
        self.command = self.encoder = tuple(joints)
        self.frozen = self.braked = False
        self.lag = LAG
        self.loads = MotorLoads(model)
        self.travelled = [0.0] * len(self.encoder)
        self._late: deque[tuple[float, ...]] = deque([self.command] * (LAG + 3), maxlen=LAG + 3)
        self._encoders: deque[tuple[float, ...]] = deque([self.encoder] * 3, maxlen=3)
        self._factor: deque[tuple[tuple[float, ...], ...]] = deque(maxlen=_SAMPLES)
        self._count = 0

    @property
    def settled(self) -> bool:
        """True if the encoders have reached the command, or the arm is frozen."""
        return self.frozen or self.encoder == self.command

    @property
    def earlier_command(self) -> tuple[float, ...]:
        """The command position one cycle ago."""
        return self._late[-2]

    @property
    def earlier_encoder(self) -> tuple[float, ...]:
        """The encoder values one cycle ago."""
        return self._encoders[-2]

    def step(self, command: tuple[float, ...]) -> bool:
        """Run one cycle; return True if the encoders still move."""
        self.command = command
        late = self._late
        late.append(command)
        if not self.frozen:
            encoder = late[-1 - self.lag]
            if self.loads.limiting:
                encoder = self._limited(encoder)
            if encoder != self.encoder:
                self.travelled = [
                    way + abs(b - a) for way, a, b in zip(self.travelled, self.encoder, encoder, strict=True)
                ]
                self.encoder = encoder
        self._encoders.append(self.encoder)
        self._count += 1
        if self._count >= _SPACING:
            self._count = 0
            self._factor.append(tuple(self._encoders))
        if self.frozen:
            return False
        return self._encoders[0] != command or late[-2] != command or late[-3] != command or self.encoder != command

    def place(self, joints: Sequence[float]) -> None:
        """Set command position and encoders to the same joints without a motion, while the arm is at standstill."""
        self.command = self.encoder = tuple(joints)
        self._late.extend([self.command] * (LAG + 3))
        self._encoders.extend([self.encoder] * 3)
        self.loads.forget()

    def power_on(self) -> None:
        """Reset the lag and the settings of the motors, at standstill; the payload is kept."""
        self.lag = LAG
        self.loads.gravity_control, self.loads.offsets = False, None
        self.loads.limits.clear()

    def _limited(self, encoder: tuple[float, ...]) -> tuple[float, ...]:
        late, end = self._late, len(self._late) - self.lag
        if not self.braked:
            self.loads.yield_to(self.loads.commanded(late[end - 3], late[end - 2], late[end - 1]))
        return tuple([joint - gone for joint, gone in zip(encoder, self.loads.yielded, strict=True)])

    def velocity(self) -> tuple[float, ...]:
        """Return the velocities of the encoders, deg/s (mm/s for a linear axis)."""
        _, before, now = self._encoders
        return tuple((b - a) / PERIOD for a, b in zip(before, now, strict=True))

    def motor_speed(self) -> tuple[float, ...]:
        """Return the speed of each motor, min^-1."""
        return tuple(
            RATED_SPEED * rate / axis.velocity for rate, axis in zip(self.velocity(), self._model.axes, strict=True)
        )

    def load(self, powered: bool) -> tuple[float, ...]:
        """Return the load of each axis, % of the rated torque; 0 if not ``powered``, because the brakes hold."""
        if not powered:
            return (0.0,) * len(self.encoder)
        return self.loads.required(*self._encoders)

    def torque_command(self, powered: bool) -> tuple[float, ...]:
        """Return the torque command of each axis, %: its load without what the controller compensates."""
        if not powered:
            return (0.0,) * len(self.encoder)
        return self.loads.commanded(*self._encoders)

    def load_factor(self, powered: bool) -> tuple[float, ...]:
        """Return the effective load of each axis in the last 10 s of operation, %."""
        if not powered:
            return (0.0,) * len(self.encoder)
        loads = [self.loads.required(*each) for each in (*self._factor, tuple(self._encoders))]
        return tuple(math.sqrt(sum(load * load for load in axis) / len(axis)) for axis in zip(*loads, strict=True))

    def deviation(self, powered: bool) -> tuple[float, ...]:
        """Return the following error of each motor, deg: the lag of its encoder plus the compliance under load.

        The error is 0 without power. With power, gravity always causes a small error, which shows that the motor is on.
        """
        if not powered:
            return (0.0,) * len(self.encoder)
        loads = self.load(powered)
        return tuple(a - b + _COMPLIANCE * load for a, b, load in zip(self.command, self.encoder, loads, strict=True))

    def sample(self, powered: bool) -> ServoSample:
        """Return the record of this cycle for the log."""
        load = self.load(powered)
        return ServoSample(self.command, self.encoder, load, tuple(each / 100 * _RATED_CURRENT for each in load))


class ControlLog:
    """The control log (RC8 provider guide, StartLog, ClearLog, GetLogRecord and SetCtrlLogMaxTime).

    ClearLog begins to record into a ring buffer. After StartLog, recording ends by itself when the log has received as
    many records as it can hold. StopLog ends it at any time.

    Attributes:
        running: True while cycles are recorded.
        max_time: Duration of the log, s.
        interval: Time between two records, ms.
    """

    def __init__(self) -> None:
        self.running = False
        self.max_time = LOG_TIME
        self.interval = LOG_INTERVAL
        self._skipped = 0
        self._left: int | None = None  # records until recording ends by itself; None for a ring buffer
        self._records: deque[tuple[ServoSample, int, int, int]] = deque(maxlen=self.capacity)

    @property
    def capacity(self) -> int:
        """Capacity in records."""
        return self.max_time * 1000 // self.interval

    def configure(self, max_time: int, interval: int) -> None:
        """Set duration and interval; the newest records are kept.

        Args:
            max_time: Duration of the log, s.
            interval: Time between two records, ms.

        Raises:
            CallError: VALUE_OUT_OF_RANGE.
        """
        if not 1 <= max_time <= _LONGEST_LOG:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("the duration of the log is 1 to {most} s, not {time}", most=_LONGEST_LOG, time=max_time),
            )
        if interval % LOG_INTERVAL or not LOG_INTERVAL <= interval <= _LONGEST_INTERVAL:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("the interval of the log is a multiple of 8 ms up to {most} ms, not {time}", most=_LONGEST_INTERVAL,
                   time=interval),
            )  # fmt: skip
        self.max_time, self.interval = max_time, interval
        self._records = deque(self._records, maxlen=self.capacity)

    def __len__(self) -> int:
        return len(self._records)

    def copy(self) -> ControlLog:
        """Return a log that is not running, with the present records, which another thread may read."""
        copied = ControlLog()
        copied.max_time, copied.interval = self.max_time, self.interval
        copied._records = self._records.copy()
        return copied

    def start(self) -> None:
        """Record until the log has received as many further records as it can hold."""
        self.running, self._left = True, self._records.maxlen

    def empty(self) -> None:
        """Delete all records; recording continues or remains off."""
        self._records.clear()

    def clear(self) -> None:
        """Delete all records, and record into a ring buffer."""
        self.empty()
        self.running, self._left = True, None

    def add(self, take: Callable[[], ServoSample], cycle: int, tool: int, work: int) -> None:
        """Record a cycle if the log is running.

        Args:
            take: Callback that returns the state of the arm; only called if the log is running.
            cycle: Number of the cycle.
            tool: Number of the current tool.
            work: Number of the current work.
        """
        if not self.running:
            return
        self._skipped += 1
        if self._skipped * LOG_INTERVAL < self.interval:
            return
        self._skipped = 0
        self._records.append((take(), cycle, tool, work))
        if self._left is not None:
            self._left -= 1
            self.running = self._left > 0

    def record(self, index: int) -> list[Value]:
        """Return a record; index 0 is the oldest.

        A record consists of command (deg), encoder (deg), current (A) and load (%) for each of 8 joints, followed by
        user data, program number, file number and line (these four are always 0), cycle number, tool number and work
        number.

        Raises:
            IndexError: If there is no such record.
        """
        if not 0 <= index < len(self._records):
            raise IndexError(index)
        sample, cycle, tool, work = self._records[index]
        columns = (sample.command, sample.encoder, sample.current, sample.load)
        values: list[Value] = [
            float(column[axis]) if axis < len(column) else 0.0 for axis in range(AXES) for column in columns
        ]
        return [*values, 0, 0, 0, 0, cycle & 0x7FFF_FFFF, tool, work]
