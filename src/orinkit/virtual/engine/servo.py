"""The mechanics of the arm: loads, encoders that follow the command position, and the control log.

The encoders reach each command position :data:`LAG` cycles later. Loads are computed by a simple model, not by the
model of a real arm: a third of the rated torque at the largest acceleration, an eighth for friction, and gravity on the
axes that carry the arm.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from orinkit.arms import ArmModel
from orinkit.values.variant import Value
from orinkit.virtual.engine.control_loop import PERIOD

LAG: Final = 3
"""Cycles by which the encoders lag behind the command."""

AXES: Final = 8
LOG_LENGTH: Final = 12_500
"""Capacity of the control log in records (100 s); the oldest records are dropped first."""

_ACCELERATION_LOAD: Final = 33.3  # % of the rated torque
_FRICTION_LOAD: Final = 12.5  # % of the rated torque
_GRAVITY_LOADS: Final = (0.0, 30.0, 20.0, 0.0, 5.0, 0.0, 0.0, 0.0)  # % of the rated torque, for each axis
_RATED_CURRENT: Final = 3.0  # A
_COMPLIANCE: Final = 1e-4  # deg for each percent of load
_AT_REST: Final = 1e-9  # deg/s; a slower axis has no friction


@dataclass(frozen=True, slots=True)
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
    """

    def __init__(self, model: ArmModel, joints: Sequence[float]) -> None:
        self._model = model
        self.command = self.encoder = tuple(joints)
        self.frozen = False
        self._late: deque[tuple[float, ...]] = deque([self.command] * (LAG + 1), maxlen=LAG + 1)
        self._encoders: deque[tuple[float, ...]] = deque([self.encoder] * 3, maxlen=3)

    @property
    def settled(self) -> bool:
        """True if the encoders have reached the command, or the arm is frozen."""
        return self.frozen or self.encoder == self.command

    def step(self, command: tuple[float, ...]) -> bool:
        """Run one cycle; return True if the encoders still move."""
        self.command = command
        self._late.append(command)
        if not self.frozen:
            self.encoder = self._late[0]
        self._encoders.append(self.encoder)
        return not self.frozen and any(late != command for late in self._late)

    def place(self, joints: Sequence[float]) -> None:
        """Set command position and encoders to the same joints without a motion, while the arm is at standstill."""
        self.command = self.encoder = tuple(joints)
        self._late.extend([self.command] * (LAG + 1))
        self._encoders.extend([self.encoder] * 3)

    def velocity(self) -> tuple[float, ...]:
        """Return the velocities of the encoders, deg/s (mm/s for a linear axis)."""
        _, before, now = self._encoders
        return tuple((b - a) / PERIOD for a, b in zip(before, now, strict=True))

    def load(self, powered: bool) -> tuple[float, ...]:
        """Return the load of each axis, % of the rated torque; 0 if not ``powered``, because the brakes hold."""
        if not powered:
            return (0.0,) * len(self.encoder)
        first, before, now = self._encoders
        tilt = [math.sin(math.radians(sum(now[1 : axis + 1]))) for axis in range(len(now))]
        loads = []
        for axis, (a, b, c) in enumerate(zip(first, before, now, strict=True)):
            acceleration = (a - 2 * b + c) / PERIOD**2 / self._model.axes[axis].acceleration
            speed = (c - b) / PERIOD
            friction = math.copysign(_FRICTION_LOAD, speed) if abs(speed) > _AT_REST else 0.0
            loads.append(_ACCELERATION_LOAD * acceleration + friction + _GRAVITY_LOADS[axis] * tilt[axis])
        return tuple(loads)

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
    """The control log, one record for each cycle (RC8 provider guide, StartLog, ClearLog and GetLogRecord).

    ClearLog begins to record into a ring buffer. After StartLog, recording ends by itself when the log has received as
    many records as it can hold. StopLog ends it at any time.

    Attributes:
        running: True while cycles are recorded.
    """

    def __init__(self) -> None:
        self.running = False
        self._left: int | None = None  # records until recording ends by itself; None for a ring buffer
        self._records: deque[tuple[ServoSample, int, int, int]] = deque(maxlen=LOG_LENGTH)

    def __len__(self) -> int:
        return len(self._records)

    def start(self) -> None:
        """Record until the log has received as many further records as it can hold."""
        self.running, self._left = True, self._records.maxlen

    def clear(self) -> None:
        """Delete all records, and record into a ring buffer."""
        self._records.clear()
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
