"""What both clients' motions share: where they go, how far they are, why they were stopped. Plain data, no calls."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from orinkit.cao.transport_profile import TransportProfile
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, OrinError, ProtocolError, TransportError, error_for
from orinkit.core.i18n import tr
from orinkit.values.poses import J, P

POLL: Final = 0.03
"""Seconds between two looks at a motion."""
SETTLE: Final = 0.05
"""Seconds after which a look that found the arm somewhere else is repeated: encoders are late, a motion may just begin."""
TOLERANCE: Final = 0.1
"""How far, in degrees or mm, a joint may be from where the motion ends; ten times what controllers stand still with."""
UNFINISHED: Final = 0.999
"""The most that is said of a motion that is not over."""

_DIRECTION: Final = 0.005  # of vectors of length 1: about 0.3 degrees
_LONGEST_CHAIN: Final = 16  # motions that are followed back; controllers have room for ten
_MANUAL: Final = 1
_TEACH_CHECK: Final = 2


class MotionSegment:
    """From where to where a motion goes, as far as that is known.

    DestJnt tells where the motion that *runs* ends. As long as another one may run, what it tells counts for this motion
    only once it differs from where that one ends.

    Attributes:
        target: where it ends, as its pose itself says.
        start, end: joints; ``end`` is that of the target, or what DestJnt has told.
        before: the motion before, until this one is known to have begun; ``None`` where nobody can tell.
        begun: whether it is known to have begun.
    """

    __slots__ = ("before", "begun", "end", "start", "target")

    def __init__(self, target: J | P | None = None) -> None:
        self.target = target
        self.start: J | None = None
        self.end: J | None = target if isinstance(target, J) else None
        self.before: MotionSegment | None = None
        self.begun = False

    @classmethod
    def leading_to(cls, end: J) -> MotionSegment:
        """Return the way of a motion that ends at some joints, and of which nothing else counts any more."""
        way = cls()
        way.end, way.begun = end, True
        return way

    @property
    def waits(self) -> bool:
        """Whether it is still to be seen that it has begun."""
        return not self.begun and self.before is not None

    def begin(self, before: MotionSegment, start: J | None, told: J) -> None:
        """Note what is known when the controller has just taken the motion.

        Args:
            before: the motion before.
            start: joints of the arm if no other motion is to come first.
            told: DestJnt.
        """
        chain: MotionSegment | None = before
        for _ in range(_LONGEST_CHAIN):
            if chain is None:
                break
            chain = chain.before
        if chain is not None:  # too many to be followed back
            return
        self.before = before
        self.start = start
        self.see(told)

    def see(self, told: J) -> None:
        """Note what DestJnt tells while something moves."""
        before = self.before
        if before is None or self.begun:
            return
        before.see(told)
        if not before.begun or before.end is None or near(told, before.end):
            return
        if self.end is None:
            self.end = told
        if near(told, self.end):
            self.begun = True
            self.start = self.start or before.end
            self.before = None

    def left_behind(self, told: J) -> bool:
        """Return whether the arm is surely on its way to somewhere else: it has begun, and DestJnt tells another end."""
        return self.begun and self.end is not None and not near(told, self.end)

    def fraction(self, now: J) -> float:
        """Return how far an arm at these joints is, from 0 to a little below 1; 0 where that is not known.

        It is the part of the way that the joints have left behind. They go together, so it is that of the path too
        where the path is a line in joint space, and roughly elsewhere.
        """
        if self.start is None or self.end is None:
            return 0.0
        whole = _distance(self.start, self.end)
        return min(UNFINISHED, max(0.0, 1.0 - _distance(now, self.end) / whole)) if whole else 0.0


def near(one: Iterable[float], other: Iterable[float], tolerance: float = TOLERANCE) -> bool:
    """Return whether two poses are the same, as far as both have numbers."""
    return all(abs(a - b) <= tolerance for a, b in zip(one, other, strict=False))


def same_place(one: P, other: P) -> bool:
    """Return whether two positions are the same, whatever their figures: within TOLERANCE mm, turned alike."""
    return near(one[:3], other[:3]) and near(_directions(one), _directions(other), _DIRECTION)


def _directions(pose: P) -> tuple[float, ...]:
    """Return the approach and the orient vector of Rz * Ry * Rx: angles can be written in several ways, these cannot."""
    (sa, ca), (sb, cb), (sc, cc) = ((math.sin(angle), math.cos(angle)) for angle in map(math.radians, pose[3:6]))
    approach = (cc * sb * ca + sc * sa, sc * sb * ca - cc * sa, cb * ca)
    orient = (cc * sb * sa - sc * ca, sc * sb * sa + cc * ca, cb * sa)
    return (*approach, *orient)


def _distance(one: J, other: J) -> float:
    return math.sqrt(sum((a - b) ** 2 for a, b in zip(one, other, strict=False)))


# --- stops ------------------------------------------------------------------------------------------------------------


def may_have_moved(error: OrinError) -> bool:
    """Return whether a motion whose call failed may have begun, or may still begin: the error is no refusal."""
    if isinstance(error, CallError):
        return error.code == hresult.STOPPED_DURING_PC_MOTION
    return isinstance(error, CallTimeout | TransportError | ProtocolError)


class MotionStop(NamedTuple):
    """How a motion was stopped before its end.

    Attributes:
        at: where the arm stands.
        reason: why, in words.
    """

    at: J
    reason: str

    def error(self, subject: str, function: str, arguments: tuple[object, ...], way: MotionSegment) -> CallError:
        """Return it as an exception.

        Args:
            subject: name of the robot.
            function: the call that began the motion.
            arguments: of the call.
            way: of the motion.
        """
        detail = tr("the arm stands at {pose}", pose=_rounded(self.at))
        end = way.end if way.target is None else way.target
        if end is not None:
            detail += tr(", the motion ends at {pose}", pose=_rounded(end))
        detail += tr("; {reason}", reason=self.reason)
        error = error_for(hresult.STOPPED_DURING_PC_MOTION, detail, function, arguments)
        error.subject = subject
        return error


class StopDiagnosis(NamedTuple):
    """What may have stopped an arm; ``None`` where the controller does not tell."""

    emergency_stop: object
    protective_stop: object
    mode: object
    motor_on: object

    def reason(self, error: str, *, halted: bool) -> str:
        """Return in words why a motion was stopped.

        Args:
            error: the first of the errors that the controller reports, ``""`` for none.
            halted: whether this program has halted it.
        """
        parts = [
            self._state(),
            tr("the controller reports {error}", error=error) if error else "",
        ]
        if said := tr("; ").join(filter(None, parts)):
            return said
        if halted:
            return tr("it was halted")
        return tr("somebody halted it")

    def _state(self) -> str:
        if self.emergency_stop:
            return tr("the emergency stop is pressed")
        if self.protective_stop:
            return tr("the protective stop is on")
        if self.mode == _MANUAL:
            return tr("the controller is in manual mode")
        if self.mode == _TEACH_CHECK:
            return tr("the controller is in teach-check mode")
        if self.motor_on is not None and not self.motor_on:
            return tr("the motor is off")
        return ""


def _rounded(pose: J | P) -> J | P:
    return pose.of(round(value, 3) for value in pose)


# --- letting go -------------------------------------------------------------------------------------------------------


def note_failure(error: BaseException, problem: OrinError, profile: TransportProfile) -> None:
    """Note in an exception that a step of the clean-up has failed too; that the connection has gone is said once."""
    if not isinstance(problem, TransportError):
        error.add_note(tr("orinkit: while cleaning up: {problem}", problem=problem))
        return
    said = {note_broken_off(profile), note_closed(profile), _connection_gone(profile)}
    if said.isdisjoint(getattr(error, "__notes__", ())):
        error.add_note(_connection_gone(profile))


def note_broken_off(profile: TransportProfile) -> str:
    """Return the note that an exception gets that broke off a call which was to move the arm."""
    lost = _if_it_is_lost(profile)
    return tr(
        "orinkit: the motion was broken off, so the connection was closed; the arm stops and is "
        "free again{condition}; the motor may still be on",
        condition=lost,
    )


def note_closed(profile: TransportProfile) -> str:
    """Return the note that an exception gets where only closing the connection could stop the arm."""
    lost = _if_it_is_lost(profile)
    return tr(
        "orinkit: the controller is still busy with the call before, so the connection was "
        "closed to stop the arm{condition}; the motor may still be on",
        condition=lost,
    )


def _if_it_is_lost(profile: TransportProfile) -> str:
    """Return when the arm stops where what tells of a client's end may not arrive, in brackets."""
    if profile.shared:
        return tr(" (should the packet that says so be lost, only when the next client connects)")
    if profile.memory and not profile.lossy:
        return tr(
            " (should the server not hear of that, after {seconds:g} s of silence or later)", seconds=profile.memory
        )
    if profile.memory:
        return tr(
            " (should the packet that says so be lost, after {seconds:g} s of silence or later)", seconds=profile.memory
        )
    return ""


def _connection_gone(profile: TransportProfile) -> str:
    if profile.shared:
        return tr(
            "orinkit: the connection is gone, which a controller cannot notice on a serial line: the "
            "arm may go on moving, and stays taken, until the next client connects; press the "
            "emergency stop if it has to stop now"
        )
    if profile.memory:
        return tr(
            "orinkit: the connection is gone; the controller notices after {seconds:g} s of silence "
            "or later, and then stops the arm and takes it back by itself; the motor may still be on",
            seconds=profile.memory,
        )
    return tr(
        "orinkit: the connection is gone; the controller then stops the arm and takes it back by "
        "itself, the motor may still be on"
    )
