"""Execution: a queue of motions carried out one servo cycle at a time, with passing, halt, hold and skip.

A motion has a time of its own, its *elapsed* time, which goes on by a cycle in each cycle while nothing is held or
stopped. To bring the arm to rest it goes on by less and less: the arm stays on its path, and each cycle takes as much
away as the joints' accelerations allow. Going on at the same pace is always allowed, so there is always a way.

Where a motion passes its end (``@P``, ``@n``), the next one begins before it is over, and what is left of the one is
added to the other. When it begins is decided beforehand, so that no joint becomes faster, or accelerates more, than one
of the two motions alone may. At most two motions run at a time.

Instead of motions, commands may come from outside, one for each cycle (:meth:`MotionQueue.follow`). When they are to
end, or do, the arm brakes from the velocity that it has then.
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
from orinkit.virtual.engine.motion.joint_path import Joints
from orinkit.virtual.engine.motion.planner import Motion

ROOM: Final = 10
"""How many motions there is room for, with the one that runs."""

CYCLE: Final = 0.008
"""Seconds of a servo cycle."""

_ROUNDING: Final = 1 + 1e-9  # of a limit that a motion makes full use of
_SAME_JOINTS: Final = 1e-6  # deg or mm
_STILL: Final = (
    1e-5  # deg or mm in a cycle, less than an encoder can tell: what is left of a pose through its kinematics
)
_HALVINGS: Final = 12
_SAMPLE: Final = 0.004  # s between the places where two motions at a time are looked at
_MOST_SAMPLES: Final = 1024


class QueueState(Enum):
    """What the queue does."""

    IDLE = "idle"
    MOVING = "moving"
    HOLDING = "holding"
    HELD = "held"
    RESUMING = "resuming"
    STOPPING = "stopping"
    FOLLOWING = "following"
    """Commands come from outside, and they move."""
    BRAKING = "braking"
    """They came from outside; now the arm is being brought to rest."""


_AT_REST_SOON: Final = (QueueState.STOPPING, QueueState.BRAKING)


class TicketState(Enum):
    """What has become of a motion."""

    QUEUED = "queued"
    RUNNING = "running"
    PASSED = "passed"
    DONE = "done"
    STOPPED = "stopped"


class Ticket:
    """A motion in a queue.

    Attributes:
        motion: the motion.
        state: QUEUED, RUNNING, then DONE when the command is at its end, or STOPPED when it was dropped; PASSED before
            that, once a motion marked ``@P`` or ``@n`` has reached its ``pass_time``.
        elapsed: seconds of the motion's own time.
        on_change: is called with the ticket after its state has changed, when the queue is in order again.
    """

    __slots__ = ("elapsed", "motion", "on_change", "state")

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.state = TicketState.QUEUED
        self.elapsed = 0.0
        self.on_change: Callable[[Ticket], None] | None = None

    @property
    def progress(self) -> float:
        """How far along its path it is, 0 to 1."""
        if self.state is TicketState.DONE:
            return 1.0
        return self.motion.profile.at(self.elapsed) if self.elapsed > 0 else 0.0


class MotionQueue:
    """The motions of one arm.

    Args:
        model: of the arm, for its limits.
        joints: where it stands, one for each axis.
        cycle: seconds of a :meth:`step`.

    Attributes:
        joints: the command, degrees or mm.
        state: what it does.
    """

    def __init__(self, model: ArmModel, joints: Sequence[float], cycle: float = CYCLE) -> None:
        if not (math.isfinite(cycle) and cycle > 0):
            raise ValueError(tr("a cycle is a number of seconds above 0, not {cycle!r}", cycle=cycle))
        self._model = model
        self._cycle = cycle
        self._steps = [axis.acceleration * cycle * cycle for axis in model.axes]
        self._active: list[Ticket] = []
        self._waiting: deque[Ticket] = deque()
        self._begin_at: float | None = None  # elapsed time of the newest one when the next one begins beside it
        self._pace = 0.0  # seconds by which the elapsed times went on in the last cycle
        self._changed: deque[Ticket] = deque()
        self._followed: Joints | None = None  # from outside, for the next cycle
        self._brake: Brake | None = None
        self.state = QueueState.IDLE
        self.joints: Joints = ()
        self.place(joints)

    # --- what there is ------------------------------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """Whether the command moves, or is about to."""
        return self.state not in (QueueState.IDLE, QueueState.HELD)

    @property
    def standing(self) -> bool:
        """Whether the command was the same in the last two cycles, but for rounding: its velocity is zero."""
        return all(abs(a - b) <= _STILL for a, b in zip(self.joints, self._before, strict=True))

    @property
    def before(self) -> Joints:
        """The command one cycle ago."""
        return self._before

    @property
    def full(self) -> bool:
        """Whether there is no room for another motion."""
        return len(self._active) + len(self._waiting) >= ROOM

    @property
    def tickets(self) -> tuple[Ticket, ...]:
        """The motions that run and wait, in their order."""
        return (*self._active, *self._waiting)

    @property
    def end_joints(self) -> Joints:
        """Where the next motion has to start: the end of the last one, or where the command is."""
        if self.state is QueueState.STOPPING:
            return self.joints
        last = self._waiting or self._active
        return last[-1].motion.end if last else self.joints

    @property
    def target(self) -> Joints:
        """Where the running motion ends; where the command is if none runs."""
        return self._active[-1].motion.end if self._active else self.joints

    def speed(self) -> tuple[Joints, Joints]:
        """Return velocity (deg/s) and acceleration (deg/s^2) of each joint in the last cycle, of linear axes in mm."""
        cycle = self._cycle
        samples = list(zip(self._earlier, self._before, self.joints, strict=True))
        velocity = tuple([(c - b) / cycle for _, b, c in samples])
        return velocity, tuple([((c - b) - (b - a)) / cycle**2 for a, b, c in samples])

    # --- what can be done ---------------------------------------------------------------------------------------

    def add(self, motion: Motion) -> Ticket:
        """Put a motion at the end; it begins with the next step if nothing else is there.

        Raises:
            ValueError: the queue is full, or the motion does not start at :attr:`end_joints`.
            CallError: STOPPING_MOTION while the arm is being brought to rest.
        """
        if self.state in _AT_REST_SOON:
            raise error_for(
                hresult.STOPPING_MOTION,
                tr("try again when the arm is at rest"),
            )
        if self.state is QueueState.FOLLOWING:
            raise ValueError(tr("the command comes from outside"))
        if self.full:
            raise ValueError(tr("there is room for {most} motions", most=ROOM))
        if any(abs(a - b) > _SAME_JOINTS for a, b in zip(motion.start, self.end_joints, strict=True)):
            raise ValueError(tr("the motion starts at {start}, not at {end}", start=motion.start, end=self.end_joints))
        ticket = Ticket(motion)
        self._waiting.append(ticket)
        if self.state is QueueState.IDLE:
            self.state = QueueState.MOVING
            self._begin_next()
        elif len(self._waiting) == 1 and self._active:
            self._begin_at = self._time_to_begin()
        return ticket

    def place(self, joints: Sequence[float]) -> None:
        """Put the command to other joints, at rest.

        Raises:
            ValueError: a motion runs or waits, or there are not as many joints as axes.
        """
        if self.state is not QueueState.IDLE:
            raise ValueError(tr("the command cannot be placed while there are motions"))
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
        """Have the command be at joints in the next cycle; whoever calls this sees to the limits.

        To be called before each :meth:`step` while the command moves: without it the arm brakes.

        Raises:
            ValueError: there are motions, or it is being brought to rest.
        """
        if self.state not in (QueueState.IDLE, QueueState.FOLLOWING):
            raise ValueError(tr("the command cannot be led while there are motions"))
        self._followed = joints
        self.state = QueueState.FOLLOWING

    def halt(self) -> None:
        """Bring the arm to rest on its path, as fast as its joints can; then drop all motions.

        Commands from outside have no path; it then goes straight on in the direction of its joints (:class:`Brake`).
        """
        if self.state is QueueState.HELD:
            self._drop()
            self._call_back()
        elif self.state in (QueueState.FOLLOWING, QueueState.BRAKING):
            self.state = QueueState.BRAKING
        elif self.state is not QueueState.IDLE:
            self.state = QueueState.STOPPING
            self._begin_at = None

    def abort(self) -> None:
        """Halt for an emergency stop or a lost connection; the limits hold for it too."""
        self.halt()

    def skip(self) -> None:
        """Give up the running motion. What follows started from its end, so it is dropped too: the same as halt."""
        self.halt()

    def hold(self) -> None:
        """Bring the arm to rest on its path and keep the motions; nothing happens if there are none."""
        if self.state in (QueueState.MOVING, QueueState.RESUMING):
            self.state = QueueState.HOLDING

    def unhold(self) -> None:
        """Go on with the motions that were held, on the same path."""
        if self.state in (QueueState.HOLDING, QueueState.HELD):
            self.state = QueueState.RESUMING

    # --- a cycle ------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Carry out one cycle."""
        self._earlier, self._before = self._before, self.joints
        if self.state is QueueState.FOLLOWING or self.state is QueueState.BRAKING:
            self._step_without_path()
        elif self.moving:
            self._pace = self._next_pace()
            self.joints = self._ahead(self._pace)
            self._go_on()
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
        if self.state is QueueState.MOVING:
            return self._cycle
        if self.state is QueueState.RESUMING:
            running = [*self._active, self._waiting[0]] if self._begin_at is not None else self._active
            part = max(max(each.motion.rates.accel, each.motion.rates.decel) for each in running)
            return self._nearest_to(self._cycle, part)
        return self._nearest_to(0.0, 1.0)

    def _nearest_to(self, wanted: float, part: float) -> float:
        # The last pace is possible, whatever the rounding says: the motions alone are within the limits.
        if self._possible(wanted, part):
            return wanted
        possible = self._pace
        for _ in range(_HALVINGS):
            middle = (wanted + possible) / 2
            if self._possible(middle, part):
                possible = middle
            else:
                wanted = middle
        return possible

    def _possible(self, pace: float, part: float) -> bool:
        part *= _ROUNDING
        for a, b, c, most in zip(self._earlier, self._before, self._ahead(pace), self._steps, strict=True):
            if abs(c - 2 * b + a) > most * part:
                return False
        return True

    def _ahead(self, pace: float) -> Joints:
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

    def _go_on(self) -> None:
        for ticket in self._active:
            ticket.elapsed += self._pace
            if ticket.motion.mark.mode in ("P", "n") and ticket.elapsed >= ticket.motion.pass_time:
                self._change(ticket, TicketState.PASSED)
        if self._begin_at is not None and (late := self._active[-1].elapsed - self._begin_at) > 0:
            self._begin_next(late)
        while self._active and self._active[0].elapsed >= self._active[0].motion.duration:
            self._change(self._active.pop(0), TicketState.DONE)

    def _change_state(self) -> None:
        if self.state is QueueState.STOPPING:
            if self._pace == 0 or not self._active:
                self._drop()
        elif not (self._active or self._waiting):
            self._rest(QueueState.IDLE)
        else:
            if not self._active:
                self._begin_next()
            if self.state is QueueState.HOLDING and self._pace == 0:
                self._rest(QueueState.HELD)
            elif self.state is QueueState.RESUMING and self._pace == self._cycle:
                self.state = QueueState.MOVING

    def _rest(self, state: QueueState) -> None:
        self.state = state
        self._pace = 0.0

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
        """Return when the first waiting motion begins beside the newest one; ``None`` for after it."""
        newest = self._active[-1]
        if not self._waiting or newest.motion.mark.mode not in ("P", "n"):
            return None
        first, follower = newest.motion, self._waiting[0].motion
        alone_in = max([0.0, *(each.motion.duration - each.elapsed for each in self._active[:-1])])
        earliest = max(first.pass_time, newest.elapsed + alone_in)
        possible = max(0, math.ceil((first.duration - earliest) / self._cycle))
        if possible and self._fit(first, follower, earliest):
            return earliest
        refused = 0
        while possible - refused > 1:
            middle = (refused + possible) // 2
            if self._fit(first, follower, earliest + middle * self._cycle):
                possible = middle
            else:
                refused = middle
        begin = earliest + possible * self._cycle
        return begin if begin < first.duration else None

    def _fit(self, first: Motion, follower: Motion, begin: float) -> bool:
        end = first.duration
        if begin >= end:
            return True
        count = min(_MOST_SAMPLES, math.ceil((end - begin) / _SAMPLE) + 1)
        knots = [knot.time for knot in first.profile.knots] + [begin + knot.time for knot in follower.profile.knots]
        times = np.array([*np.linspace(begin, end, count), *(time for time in knots if begin < time < end)])
        (q1, v1, a1), (q2, v2, a2) = first.sampled(times), follower.sampled(times - begin)
        joints = q1 + q2 - np.array(first.end)
        rates = (first.rates, follower.rates)
        part = max(max(rate.accel, rate.decel) for rate in rates) * _ROUNDING
        axes = self._model.axes
        velocity = np.array([axis.velocity for axis in axes]) * max(rate.speed for rate in rates) * _ROUNDING
        low, high = (np.array(side) for side in zip(*((axis.lower, axis.upper) for axis in axes), strict=True))
        return bool(
            np.all(np.abs(v1 + v2) <= velocity)
            and np.all(np.abs(a1 + a2) <= np.array([axis.acceleration for axis in axes]) * part)
            and np.all((joints >= low - _SAME_JOINTS) & (joints <= high + _SAME_JOINTS))
        )
