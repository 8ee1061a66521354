"""Execution of motions: a queue whose motions run one servo cycle at a time, with passing, halt and hold.

Each motion has its own time, the *elapsed* time. Normally the elapsed time increases by the length of a cycle in each
cycle. To stop the arm, this increment (the *pace*) is reduced from cycle to cycle, as fast as the acceleration limits
of the joints allow. The arm therefore stays on its path. An unchanged pace is always allowed, so a permitted pace
always exists.

With the pass marks ``@P`` and ``@n`` the next motion begins before the present one has ended; the remaining
displacement of the present motion is added to the next one. The time at which the next motion begins is computed
beforehand, so that no joint exceeds the velocity and acceleration that one of the two motions alone may have. At most
two motions run at a time.

Instead of motions, the queue can follow external commands: command positions set by the caller, one for each cycle
(:meth:`MotionQueue.follow`). When they end or are stopped, the arm brakes from its present velocity.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

import numpy as np

from orinkit.arms import ArmModel
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.motion.brake import Brake
from orinkit.virtual.engine.motion.coupling import Coupling, nearest_pace
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.planner import Motion

ROOM: Final = 10
"""Capacity of the queue in motions, including the running one."""

CYCLE: Final = 0.008
"""Length of a servo cycle in seconds."""

_ROUNDING: Final = 1 + 1e-9  # tolerance for motions that reach a limit exactly
_SAME_JOINTS: Final = 1e-6  # deg or mm
# deg or mm in a cycle: below the resolution of an encoder, above the rounding errors of the kinematics
_STILL: Final = 1e-5
_SAMPLE: Final = 0.004  # s between the samples of two overlapping motions
_MAX_SAMPLES: Final = 1024


class QueueState(Enum):
    """State of the queue."""

    IDLE = "idle"
    MOVING = "moving"
    HOLDING = "holding"
    HELD = "held"
    RESUMING = "resuming"
    STOPPING = "stopping"
    FOLLOWING = "following"
    """The arm moves and follows external commands."""
    BRAKING = "braking"
    """External commands have ended; the arm brakes to standstill."""


_COMING_TO_REST: Final = (QueueState.STOPPING, QueueState.BRAKING)
_AT_REST: Final = (QueueState.IDLE, QueueState.HELD)
_WITHOUT_PATH: Final = (QueueState.FOLLOWING, QueueState.BRAKING)
# for every cycle: in Python 3.11, access to a member of an enum takes ten times as long as to a constant
_MOVING: Final = QueueState.MOVING
_STOPPING: Final = QueueState.STOPPING
_HOLDING: Final = QueueState.HOLDING
_RESUMING: Final = QueueState.RESUMING


class TicketState(Enum):
    """State of a motion in the queue."""

    QUEUED = "queued"
    RUNNING = "running"
    PASSED = "passed"
    DONE = "done"
    STOPPED = "stopped"


class Ticket:
    """A motion in a queue.

    Attributes:
        motion: The motion.
        state: QUEUED, then RUNNING, then DONE when the command position has reached the end of the motion. STOPPED if
            the motion was dropped. A motion marked ``@P`` or ``@n`` is PASSED from its ``pass_time`` until it is DONE.
        elapsed: The motion's own time in seconds.
        on_change: Callback invoked with the ticket after its state has changed and the queue is consistent again;
            ``None`` for no callback.
    """

    __slots__ = ("elapsed", "motion", "on_change", "state")

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.state = TicketState.QUEUED
        self.elapsed = 0.0
        self.on_change: Callable[[Ticket], None] | None = None

    @property
    def progress(self) -> float:
        """Position along the path, 0 to 1."""
        if self.state is TicketState.DONE:
            return 1.0
        return self.motion.profile.at(self.elapsed) if self.elapsed > 0 else 0.0


class MotionQueue:
    """The motions of one arm.

    Args:
        model: The arm model, for its limits.
        joints: The initial joints, one for each axis.
        cycle: Length of a :meth:`step` in seconds.

    Attributes:
        joints: The command position, deg or mm.
        state: State of the queue.
        coupling: The queues in step with this one until standstill; ``None`` if there are none.
    """

    def __init__(self, model: ArmModel, joints: Sequence[float], cycle: float = CYCLE) -> None:
        if not (math.isfinite(cycle) and cycle > 0):
            raise ValueError(tr("a cycle must be above 0 s and finite, not {cycle!r}", cycle=cycle))
        self._model = model
        self._cycle = cycle
        self._steps = [axis.acceleration * cycle * cycle for axis in model.axes]
        self._active: list[Ticket] = []
        self._waiting: deque[Ticket] = deque()
        self._begin_at: float | None = None  # elapsed time of the newest motion at which the next one begins
        self._pace = 0.0  # seconds by which the elapsed times increased in the last cycle
        self._stop_fraction = 1.0  # acceleration of a stop, as a fraction of the limits of the arm model
        self._changed: deque[Ticket] = deque()
        self._followed: Joints | None = None  # external command for the next cycle
        self._brake: Brake | None = None
        self.coupling: Coupling | None = None
        self.state = QueueState.IDLE
        self.joints: Joints = ()
        self.place(joints)

    # --- state --------------------------------------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """True if the command position moves, or is about to move."""
        return self.state not in _AT_REST

    @property
    def pace(self) -> float:
        """Seconds by which the elapsed times of the motions increased in the last cycle."""
        return self._pace

    @property
    def standing(self) -> bool:
        """True if the velocity of the command position is zero, apart from rounding."""
        return all(abs(a - b) <= _STILL for a, b in zip(self.joints, self._before, strict=True))

    @property
    def previous_joints(self) -> Joints:
        """The command position one cycle ago."""
        return self._before

    @property
    def full(self) -> bool:
        """True if there is no room for another motion."""
        return len(self._active) + len(self._waiting) >= ROOM

    @property
    def tickets(self) -> tuple[Ticket, ...]:
        """The running and waiting motions, in order."""
        return (*self._active, *self._waiting)

    @property
    def end_joints(self) -> Joints:
        """Joints at which the next motion must start: those at the end of the last motion.

        If there is no motion, or the arm is stopping, they are the command position.
        """
        if self.state is QueueState.STOPPING:
            return self.joints
        last = self._waiting or self._active
        return last[-1].motion.end if last else self.joints

    @property
    def target(self) -> Joints:
        """Joints at the end of the motion that began last; the command position if no motion runs."""
        return self._active[-1].motion.end if self._active else self.joints

    def velocity_and_acceleration(self) -> tuple[Joints, Joints]:
        """Return velocity (deg/s) and acceleration (deg/s^2) of each joint in the last cycle; in mm for linear axes."""
        cycle = self._cycle
        samples = list(zip(self._earlier, self._before, self.joints, strict=True))
        velocity = tuple([(c - b) / cycle for _, b, c in samples])
        return velocity, tuple([((c - b) - (b - a)) / cycle**2 for a, b, c in samples])

    # --- operations ---------------------------------------------------------------------------------------------

    def add(self, motion: Motion) -> Ticket:
        """Append a motion; it begins with the next step if the queue is empty.

        Raises:
            ValueError: If the queue is full, the motion does not start at :attr:`end_joints`, or the queue follows
                external commands.
            CallError: STOPPING_MOTION while the arm is stopping.
        """
        self.require_accepting()
        if self.state is QueueState.FOLLOWING:
            raise ValueError(tr("the arm follows external commands, so no motion can be added"))
        if self.full:
            raise ValueError(tr("the queue is full, with {most} motions", most=ROOM))
        if any(abs(a - b) > _SAME_JOINTS for a, b in zip(motion.start, self.end_joints, strict=True)):
            raise ValueError(
                tr("the motion must start at {end}, not at {start}", start=motion.start, end=self.end_joints)
            )
        ticket = Ticket(motion)
        self._waiting.append(ticket)
        if self.state is QueueState.IDLE:
            self.state = QueueState.MOVING
            self._begin_next()
        elif len(self._waiting) == 1 and self._active:
            self._begin_at = self._time_to_begin()
        return ticket

    def require_accepting(self) -> None:
        """Raise an exception if no motion can be added because the arm is stopping.

        Raises:
            CallError: STOPPING_MOTION.
        """
        if self.state in _COMING_TO_REST:
            raise error_for(
                hresult.STOPPING_MOTION,
                tr("the arm is stopping. Try: repeat the call when the arm is at standstill"),
            )

    def place(self, joints: Sequence[float]) -> None:
        """Set the command position to other joints without a motion, while the arm is at standstill.

        Raises:
            ValueError: If a motion runs or waits, or the number of joints is not the number of axes.
        """
        if self.state is not QueueState.IDLE:
            raise ValueError(tr("the command position cannot be set while motions run or wait"))
        if len(joints) != len(self._model.axes):
            raise ValueError(
                tr(
                    "{name} has {count} axes, not {given}",
                    name=self._model.name,
                    count=len(self._model.axes),
                    given=len(joints),
                )
            )
        self.joints = self._before = self._earlier = tuple(map(float, joints))

    def follow(self, joints: Joints) -> None:
        """Set the external command of the next cycle; the caller must check the limits.

        Call it before each :meth:`step` while the command position moves; otherwise the arm brakes.

        Raises:
            ValueError: If a motion runs or waits, or the arm is stopping.
        """
        if self.state not in (QueueState.IDLE, QueueState.FOLLOWING):
            raise ValueError(tr("external commands cannot be followed while motions run or wait"))
        self._followed = joints
        self.state = QueueState.FOLLOWING

    def halt(self, *, as_set: bool = False) -> None:
        """Stop the arm on its path, as fast as the acceleration limits allow; then drop all motions.

        With ``as_set``, stop with the acceleration and deceleration of the running motions instead, unless the arm is
        already stopping. External commands have no path; in this case each joint brakes in its present direction (:class:`Brake`).
        """
        if self.state is QueueState.HELD:
            self._drop()
            self._call_back()
        elif self.state in _WITHOUT_PATH:
            self.state = QueueState.BRAKING
        elif self.state is not QueueState.IDLE:
            if not as_set:
                self._stop_fraction = 1.0
            elif self.state is not QueueState.STOPPING:
                self._stop_fraction = self._fraction_of_running()
            self.state = QueueState.STOPPING
            self._begin_at = None

    def hold(self) -> None:
        """Stop the arm on its path and keep the motions; without motions, do nothing."""
        if self.state in (QueueState.MOVING, QueueState.RESUMING):
            self.state = QueueState.HOLDING

    def unhold(self) -> None:
        """Resume the held motions on the same path."""
        if self.state in (QueueState.HOLDING, QueueState.HELD):
            self.state = QueueState.RESUMING

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Run one cycle."""
        if self.state in _WITHOUT_PATH:
            self._earlier, self._before = self._before, self.joints
            self._step_without_path()
        elif self.state in _AT_REST:
            self._earlier, self._before = self._before, self.joints
        else:
            self._pace = self._next_pace() if self.coupling is None else self.coupling.pace_of(self)
            self._earlier, self._before = self._before, self.joints
            self.joints = self._joints_after(self._pace)
            self._advance()
            self._change_state()
            self._call_back()

    def _step_without_path(self) -> None:
        followed, self._followed = self._followed, None
        if self.state is QueueState.FOLLOWING and followed is not None:
            self.joints = followed
        else:
            self.state = QueueState.BRAKING
            self._brake = self._brake or Brake(self._model, self._earlier, self._before, self._cycle)
            self.joints = self._brake.step()
        if self.standing:
            self.state, self._brake = QueueState.IDLE, None

    def _next_pace(self) -> float:
        if self.state is _MOVING:
            return self._cycle
        desired, fraction = self.intended_pace()
        return nearest_pace(desired, self._pace, lambda pace: self.allows(pace, fraction))

    def intended_pace(self) -> tuple[float, float]:
        """Return the pace that the state requires, s, and the acceleration allowed to reach it, as a fraction."""
        if self.state is QueueState.MOVING:
            return self._cycle, 1.0
        if self.state is QueueState.RESUMING:
            return self._cycle, self._fraction_of_running()
        return 0.0, self._stop_fraction if self.state is QueueState.STOPPING else 1.0

    def _fraction_of_running(self) -> float:
        """Return the largest acceleration of the running motions, as a fraction of the limits of the arm model."""
        running = [*self._active, self._waiting[0]] if self._begin_at is not None else self._active
        return max((max(each.motion.rates.accel, each.motion.rates.decel) for each in running), default=1.0)

    def allows(self, pace: float, fraction: float) -> bool:
        """Return True if a pace of the next cycle is within the acceleration limits, multiplied by a fraction."""
        fraction *= _ROUNDING
        for a, b, c, limit in zip(self._before, self.joints, self._joints_after(pace), self._steps, strict=True):
            if abs(c - 2 * b + a) > limit * fraction:
                return False
        return True

    def _joints_after(self, pace: float) -> Joints:
        running = [(each.motion, each.elapsed + pace) for each in self._active]
        if self._begin_at is not None and (late := running[-1][1] - self._begin_at) > 0:
            running.append((self._waiting[0].motion, late))
        motion, time = running.pop()
        joints = motion.joints_at(time)
        for earlier, time in running:
            if time < earlier.duration:
                left = zip(joints, earlier.joints_at(time), earlier.end, strict=True)
                joints = tuple([q + (a - end) for q, a, end in left])
        return joints

    def _advance(self) -> None:
        for ticket in self._active:
            ticket.elapsed += self._pace
            if ticket.motion.mark.mode in ("P", "n") and ticket.elapsed >= ticket.motion.pass_time:
                self._change(ticket, TicketState.PASSED)
        if self._begin_at is not None and (late := self._active[-1].elapsed - self._begin_at) > 0:
            self._begin_next(late)
        while self._active and self._active[0].elapsed >= self._active[0].motion.duration:
            self._change(self._active.pop(0), TicketState.DONE)

    def _change_state(self) -> None:
        if self.state is _STOPPING:
            if self._pace == 0 or not self._active:
                self._drop()
        elif not (self._active or self._waiting):
            self._rest(QueueState.IDLE)
        else:
            if not self._active:
                self._begin_next()
            if self.state is _HOLDING and self._pace == 0:
                self._rest(QueueState.HELD)
            elif self.state is _RESUMING and self._pace == self._cycle:
                self.state = _MOVING

    def _rest(self, state: QueueState) -> None:
        self.state = state
        self._pace = 0.0
        if state is QueueState.IDLE:
            self.coupling = None

    def _drop(self) -> None:
        for ticket in self.tickets:
            self._change(ticket, TicketState.STOPPED)
        self._active.clear()
        self._waiting.clear()
        self._begin_at = None
        self._rest(QueueState.IDLE)

    def _begin_next(self, late: float = 0.0) -> None:
        ticket = self._waiting.popleft()
        ticket.elapsed = late
        self._active.append(ticket)
        self._change(ticket, TicketState.RUNNING)
        self._begin_at = self._time_to_begin()

    def _change(self, ticket: Ticket, state: TicketState) -> None:
        if ticket.state is not state:
            ticket.state = state
            if ticket not in self._changed:
                self._changed.append(ticket)

    def _call_back(self) -> None:
        while self._changed:
            ticket = self._changed.popleft()
            if ticket.on_change is not None:
                ticket.on_change(ticket)

    # --- passing ------------------------------------------------------------------------------------------------

    def _time_to_begin(self) -> float | None:
        """Return the elapsed time of the newest running motion at which the next motion begins.

        Return ``None`` if the next motion begins only when the newest one has ended.
        """
        newest = self._active[-1]
        if not self._waiting or newest.motion.mark.mode not in ("P", "n"):
            return None
        first, follower = newest.motion, self._waiting[0].motion
        alone_in = max([0.0, *(each.motion.duration - each.elapsed for each in self._active[:-1])])
        earliest = max(first.pass_time, newest.elapsed + alone_in)
        possible = max(0, math.ceil((first.duration - earliest) / self._cycle))
        if possible and self._fit(first, follower, earliest):
            return earliest
        too_early = 0
        while possible - too_early > 1:
            middle = (too_early + possible) // 2
            if self._fit(first, follower, earliest + middle * self._cycle):
                possible = middle
            else:
                too_early = middle
        begin = earliest + possible * self._cycle
        return begin if begin < first.duration else None

    def _fit(self, first: Motion, follower: Motion, begin: float) -> bool:
        end = first.duration
        if begin >= end:
            return True
        count = min(_MAX_SAMPLES, math.ceil((end - begin) / _SAMPLE) + 1)
        knots = [knot.time for knot in first.profile.knots] + [begin + knot.time for knot in follower.profile.knots]
        times = np.array([*np.linspace(begin, end, count), *(time for time in knots if begin < time < end)])
        (q1, v1, a1), (q2, v2, a2) = first.states_at(times), follower.states_at(times - begin)
        joints = q1 + q2 - np.array(first.end)
        rates = (first.rates, follower.rates)
        fraction = max(max(rate.accel, rate.decel) for rate in rates) * _ROUNDING
        axes = self._model.axes
        velocity = np.array([axis.velocity for axis in axes]) * max(rate.speed for rate in rates) * _ROUNDING
        low, high = (np.array(side) for side in zip(*((axis.lower, axis.upper) for axis in axes), strict=True))
        return bool(
            np.all(np.abs(v1 + v2) <= velocity)
            and np.all(np.abs(a1 + a2) <= np.array([axis.acceleration for axis in axes]) * fraction)
            and np.all((joints >= low - _SAME_JOINTS) & (joints <= high + _SAME_JOINTS))
        )
