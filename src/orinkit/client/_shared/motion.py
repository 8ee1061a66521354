"""Motion state shared by the asynchronous and the synchronous client: segments, progress and stop causes; no I/O."""

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
"""Polling interval of a motion in s."""
SETTLE: Final = 0.05
"""Time in s after which the position of the arm is read again if the arm is not at the end of its motion.

The second reading is necessary because encoders lag behind the command, and because a motion may not have begun yet.
"""
TOLERANCE: Final = 0.1
"""Maximum deviation of each joint from the end of a motion, in deg or mm, at which the arm has arrived there.

The value is ten times the deviation of controllers at standstill.
"""
UNFINISHED: Final = 0.999
"""Maximum progress of an unfinished motion."""

_DIRECTION: Final = 0.005  # tolerance of unit vectors, about 0.3 deg
_MAX_CHAIN: Final = 16  # number of motions that are tracked; controllers queue up to ten
_MANUAL: Final = 1
_TEACH_CHECK: Final = 2


class MotionSegment:
    """The start and the end of a motion, if they are known.

    DestJnt returns the end of the motion that is *executing*. While the previous motion may still be executing, the
    result of DestJnt belongs to the motion of this segment only if the result differs from the end of the previous
    motion.

    Attributes:
        target: End of the motion according to the commanded pose; ``None`` if the pose does not determine it.
        start: Joints at the start; ``None`` if unknown.
        end: Joints at the end, from the target or from DestJnt; ``None`` if unknown.
        before: Segment of the previous motion; ``None`` if it is unknown, or if this motion is known to have begun.
        begun: True if the motion is known to have begun.
    """

    __slots__ = ("before", "begun", "end", "start", "target")

    def __init__(self, target: J | P | None = None) -> None:
        self.target = target
        self.start: J | None = None
        self.end: J | None = target if isinstance(target, J) else None
        self.before: MotionSegment | None = None
        self.begun = False

    @classmethod
    def begun_to(cls, end: J) -> MotionSegment:
        """Create the segment of a motion that has begun and ends at the given joints."""
        segment = cls()
        segment.end, segment.begun = end, True
        return segment

    @property
    def awaits_start(self) -> bool:
        """True if the beginning of the motion has not been detected yet, but can still be detected."""
        return not self.begun and self.before is not None

    def begin(self, before: MotionSegment, start: J | None, destination: J) -> None:
        """Record the state immediately after the controller has accepted the motion.

        Args:
            before: Segment of the previous motion.
            start: Joints of the arm if no other motion is pending; otherwise ``None``.
            destination: Result of DestJnt.
        """
        chain: MotionSegment | None = before
        for _ in range(_MAX_CHAIN):
            if chain is None:
                break
            chain = chain.before
        if chain is not None:  # too many pending motions to track
            return
        self.before = before
        self.start = start
        self.see(destination)

    def see(self, destination: J) -> None:
        """Update the segment with a result of DestJnt that was read while the arm moved."""
        before = self.before
        if before is None or self.begun:
            return
        before.see(destination)
        if not before.begun or before.end is None or near(destination, before.end):
            return
        if self.end is None:
            self.end = destination
        if near(destination, self.end):
            self.begun = True
            self.start = self.start or before.end
            self.before = None

    def left_behind(self, destination: J) -> bool:
        """Return True if the arm certainly executes a later motion than that of this segment.

        This is certain if the motion of this segment has begun, and its end differs from ``destination``, the result of
        DestJnt.
        """
        return self.begun and self.end is not None and not near(destination, self.end)

    def fraction(self, now: J) -> float:
        """Return the progress of the motion, from 0 to slightly below 1, when the arm is at the joints ``now``.

        The result is 0 if the start or the end of the motion is unknown.

        The progress is the covered part of the distance in joint space. If the path is a line in joint space, this is
        also the covered part of the path; otherwise, it is an approximation.
        """
        if self.start is None or self.end is None:
            return 0.0
        whole = _distance(self.start, self.end)
        return min(UNFINISHED, max(0.0, 1.0 - _distance(now, self.end) / whole)) if whole else 0.0


def near(one: Iterable[float], other: Iterable[float], tolerance: float = TOLERANCE) -> bool:
    """Return True if two poses are equal within a tolerance.

    If one pose has more numbers than the other, the additional numbers are not compared.
    """
    return all(abs(a - b) <= tolerance for a, b in zip(one, other, strict=False))


def same_place(one: P, other: P) -> bool:
    """Return True if two positions are equal within TOLERANCE mm and about 0.3 deg; figures are not compared."""
    return near(one[:3], other[:3]) and near(_directions(one), _directions(other), _DIRECTION)


def _directions(pose: P) -> tuple[float, ...]:
    """Return the approach and orient vectors of the rotation Rz * Ry * Rx.

    An orientation has only one pair of these vectors, whereas several triples of angles may describe it.
    """
    (sa, ca), (sb, cb), (sc, cc) = ((math.sin(angle), math.cos(angle)) for angle in map(math.radians, pose[3:6]))
    approach = (cc * sb * ca + sc * sa, sc * sb * ca - cc * sa, cb * ca)
    orient = (cc * sb * sa - sc * ca, sc * sb * sa + cc * ca, cb * sa)
    return (*approach, *orient)


def _distance(one: J, other: J) -> float:
    return math.sqrt(sum((a - b) ** 2 for a, b in zip(one, other, strict=False)))


# --- stops ------------------------------------------------------------------------------------------------------------


def may_have_moved(error: OrinError) -> bool:
    """Return True if a motion may have begun, or may still begin, although its call failed with the error."""
    if isinstance(error, CallError):
        return error.code == hresult.STOPPED_DURING_PC_MOTION
    return isinstance(error, CallTimeout | TransportError | ProtocolError)


class MotionStop(NamedTuple):
    """Details of a motion that was stopped before its end.

    Attributes:
        at: Joints of the arm at standstill.
        reason: Cause of the stop, as text.
    """

    at: J
    reason: str

    def error(self, subject: str, function: str, arguments: tuple[object, ...], segment: MotionSegment) -> CallError:
        """Create the exception for the stop.

        Args:
            subject: Name of the robot.
            function: Function that started the motion.
            arguments: Arguments of the call.
            segment: Start and end of the motion.
        """
        detail = tr("the arm stopped at {pose}", pose=_rounded(self.at))
        end = segment.end if segment.target is None else segment.target
        if end is not None:
            detail += tr(", target {pose}", pose=_rounded(end))
        detail += tr("; {reason}", reason=self.reason)
        error = error_for(hresult.STOPPED_DURING_PC_MOTION, detail, function, arguments)
        error.subject = subject
        return error


class StopDiagnosis(NamedTuple):
    """Controller states that can stop an arm; ``None`` for a state that the controller does not report."""

    emergency_stop: object
    protective_stop: object
    mode: object
    motor_on: object

    def reason(self, error: str, *, halted: bool, monitored: bool = False) -> str:
        """Return the cause of a stop as text.

        Args:
            error: Oldest error that the controller reports, as text; ``""`` if it reports none.
            halted: True if this program halted the motion.
            monitored: True if the server stops the arm if this client is silent (``alive=``).
        """
        parts = [
            self._state(),
            tr("the controller reports {error}", error=error) if error else "",
        ]
        if text := tr("; ").join(filter(None, parts)):
            return text
        if halted:
            return tr("halted by this program")
        if monitored:
            return tr(
                "halted by another client or program, or by the server because this client was silent for longer than "
                "alive"
            )
        return tr("halted by another client or program")

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


# --- clean-up ---------------------------------------------------------------------------------------------------------


def note_failure(error: BaseException, problem: OrinError, profile: TransportProfile) -> None:
    """Add a note about a failed step of the clean-up to an exception; a lost connection is noted only once.

    Args:
        error: Exception that receives the note.
        problem: Exception that the step raised.
        profile: Properties of the transport.
    """
    if not isinstance(problem, TransportError):
        error.add_note(tr("orinkit: error during clean-up: {problem}", problem=problem))
        return
    said = {broken_off_note(profile), closed_note(profile), _lost_note(profile)}
    if said.isdisjoint(getattr(error, "__notes__", ())):
        error.add_note(_lost_note(profile))


def broken_off_note(profile: TransportProfile) -> str:
    """Return the note for an exception that interrupted a motion call."""
    condition = _if_packet_lost(profile)
    return tr(
        "orinkit: the motion call was interrupted, so the connection was closed; the arm stops and its semaphore is "
        "released{condition}; the motor may still be on",
        condition=condition,
    )


def closed_note(profile: TransportProfile) -> str:
    """Return the note for an exception after which the arm could only be stopped by closing the connection."""
    condition = _if_packet_lost(profile)
    return tr(
        "orinkit: the controller is still executing the previous call, so the connection was closed to stop the "
        "arm{condition}; the motor may still be on",
        condition=condition,
    )


def _if_packet_lost(profile: TransportProfile) -> str:
    """Return a text, in brackets, on when the arm stops if the controller receives no notice of the client's end.

    The text is empty if the controller always detects the end of the client.
    """
    if profile.shared:
        return tr(" (if the closing packet is lost, the arm stops only when the next client connects)")
    if profile.session_timeout and not profile.lossy:
        return tr(
            " (if the server is not notified, the arm stops only after at least {seconds:g} s without a request)",
            seconds=profile.session_timeout,
        )
    if profile.session_timeout:
        return tr(
            " (if the closing packet is lost, the arm stops only after at least {seconds:g} s without a request)",
            seconds=profile.session_timeout,
        )
    return ""


def _lost_note(profile: TransportProfile) -> str:
    if profile.shared:
        return tr(
            "orinkit: the connection is lost, and a controller cannot detect this on a serial line: the arm may keep "
            "moving, and its semaphore stays taken, until the next client connects. Press the emergency stop if the arm "
            "must stop now"
        )
    if profile.session_timeout:
        return tr(
            "orinkit: the connection is lost; the controller detects this after {seconds:g} s or more without a request, "
            "then stops the arm and releases its semaphore; the motor may still be on",
            seconds=profile.session_timeout,
        )
    return tr(
        "orinkit: the connection is lost; the controller stops the arm and releases its semaphore; the motor may still "
        "be on"
    )
