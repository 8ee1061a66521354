"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``motion.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.client._shared import motion as common
from orinkit.client._shared.common import error_count, error_info
from orinkit.client._shared.prepared import PreparedCommand, PreparedFunction
from orinkit.client._shared.robot import HOLDING_COMMANDS, is_missing, passes, read_number, read_pose, sendable
from orinkit.client._sync.client import Client
from orinkit.client._sync.objects import ObjectBase, ObjectContainer
from orinkit.core.errors import CallError, OrinError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.transport.runner import Deadline, sleep
from orinkit.values.poses import J, P, T
from orinkit.values.variant import Value

_ARM: Final = 1


class MotionTracker:
    """Tracks the motions of a robot object.

    Attributes:
        newest: Number of the newest motion that was commanded.
        replied: Number of the newest motion for which the controller replied at the end of the motion. This motion and
            all earlier ones are over.
        halted: Number of the newest motion that this program has halted.
        running: Newest motion whose call did not wait for its end; ``None`` if there is none, or if it is known to be
            over.
        passing: True if the controller replied to the newest motion at its pass mark, so that the arm may still move.
        sure: True if this object has recorded all motions that the arm may execute. False after a call without a reply,
            or after a command that may have moved the arm.
        paused: True if this program has paused the motion.
        at_rest: True if the arm is certainly at standstill, because it was halted and no motion has been commanded
            since.
        forgotten: True if ``sure`` and ``at_rest`` are False.
    """

    __slots__ = ("_at_rest", "_sure", "forgotten", "halted", "newest", "passing", "paused", "replied", "running")

    def __init__(self) -> None:
        self.newest = 0
        self.replied = 0
        self.halted = 0
        self.running: Motion | None = None
        self.passing = False
        self.paused = False
        self.forget()

    @property
    def sure(self) -> bool:
        return self._sure

    @sure.setter
    def sure(self, known: bool) -> None:
        self._sure = known
        self.forgotten = not (self._sure or self._at_rest)

    @property
    def at_rest(self) -> bool:
        return self._at_rest

    @at_rest.setter
    def at_rest(self, known: bool) -> None:
        self._at_rest = known
        self.forgotten = not (self._sure or self._at_rest)

    def forget(self) -> None:
        """Record that a command may move the arm."""
        self._at_rest = self._sure = False
        self.forgotten = True


class ArmBase(ObjectContainer):
    """Base class of robots: position of the arm, and start and stop of motions, as required by :class:`Motion`."""

    __slots__ = ("_track",)

    def __init__(self, client: Client, handle: int, label: str, parent: ObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._track = MotionTracker()

    def _begin(
        self, function: Function[..., None], *arguments: Any, wait: bool, segment: common.MotionSegment | None = None
    ) -> Motion:
        """Call a function that starts a motion; return the motion.

        If the call is interrupted, by Ctrl-C or by cancelling its task, the connection is closed, so that the
        controller stops the arm instead of completing an unsupervised motion. On UDP and serial lines, the closing
        packet is sent only once. If this packet is lost, the controller detects the end of the connection late (UDP),
        or only when the next client connects (serial line).

        Args:
            function: Function that starts the motion.
            arguments: Arguments of the call, without the handle.
            wait: True if the controller replies at the end of the motion.
            segment: Object in which the start and the end of the motion are recorded; ``None`` if they are not
                required. The controller is queried for them only if ``wait`` is False.
        """
        track = self._track
        before = None if wait or segment is None else self._previous(track)
        previous, track.newest, track.at_rest = track.newest, track.newest + 1, False
        number = track.newest
        try:
            self._call(function, *arguments)
        except OrinError as error:
            if common.may_have_moved(error):
                track.sure = False
            else:
                track.newest = previous
            raise
        except BaseException as error:
            self.client.close()
            error.add_note(common.broken_off_note(self.client.profile))
            raise
        call = (self._label, function.name, arguments)
        motion = Motion(self, track, number, call, segment or common.MotionSegment(), over=wait)
        track.running = None if wait else motion
        track.passing = wait and passes(arguments)
        if wait:
            track.replied, track.sure = number, True
        elif before is not None:
            self._begin_segment(motion.segment, *before)
        return motion

    def _previous(self, track: MotionTracker) -> tuple[common.MotionSegment, bool] | None:
        """Return the segment of the previous motion, and True if that motion is over; ``None`` if they are unknown.

        The segment contains the start and the end of the previous motion.
        """
        running = track.running
        replied = track.sure and running is None and track.newest == track.replied
        try:
            if replied or self.motion_complete():
                track.sure = True
                return common.MotionSegment.begun_to(self.get_destination()), True
            if running is None or not track.sure:
                return None
            running.segment.see(self.get_destination())
        except CallError as error:
            if not is_missing(error):
                raise
            return None
        return running.segment, False

    def _begin_segment(self, segment: common.MotionSegment, before: common.MotionSegment, over: bool) -> None:
        try:
            segment.begin(before, self.get_joints() if over else None, self.get_destination())
        except CallError as error:
            if not is_missing(error):
                raise

    def _command(self, prepared: PreparedFunction, command: str) -> PreparedCommand:
        holding = str(command).strip().lower() in HOLDING_COMMANDS
        return PreparedCommand(prepared, None if holding else self._track, sendable)

    def halt(self, option: str = "") -> None:
        """Stop and abort the motion.

        While one connection waits for the end of a motion, a program can call this method over a second connection.

        The reply arrives when the command position is at standstill. The arm itself follows a few cycles later: joints
        that are read immediately may still change by a fraction of a degree.
        """
        track = self._track
        track.halted = track.newest
        if self.client.dialect.takes_arm:
            self._call(f.robot_halt, option)
        else:  # this arm moves in slave mode only
            self._call(f.robot_execute, "slvChangeMode", 0)
        track.at_rest = track.sure = True
        track.paused = track.passing = False

    def hold(self, option: str = "") -> None:
        """Pause the motion."""
        self._track.paused = True
        self._call(f.robot_hold, option)

    def unhold(self, option: str = "") -> None:
        """Resume a paused motion."""
        self._call(f.robot_unhold, option)
        self._track.paused = False

    # --- position -----------------------------------------------------------------------------------------------

    def motion_complete(self, mode: int = 0) -> bool:
        """Return True if all motions have ended (MotionComplete).

        Args:
            mode: 0 checks the command position; 1 also checks the actual position (encoders).
        """
        return bool(read_number("MotionComplete", self._ask("MotionComplete", [-1, mode])))

    def get_joints(self) -> J:
        """Return the joints of the arm in deg (CurJnt)."""
        return read_pose(J, "CurJnt", self._ask("CurJnt"))

    def get_position(self) -> P:
        """Return the position of the tool in the current work frame: mm, deg, figure (CurPos)."""
        return read_pose(P, "CurPos", self._ask("CurPos"))

    def get_trans(self) -> T:
        """Return the pose of the tool as a homogeneous transformation (CurTrn)."""
        return read_pose(T, "CurTrn", self._ask("CurTrn"))

    def get_destination(self) -> J:
        """Return the joints at the end of the current motion in deg (DestJnt); at standstill, the joints of the arm."""
        return read_pose(J, "DestJnt", self._ask("DestJnt"))

    def _locked(self) -> bool:
        """Return True if the machine lock is on: the controller then executes motions without moving the arm."""
        return bool(_value_or_none(self._controller(), "@LOCK"))

    def _reason(self, *, halted: bool) -> str:
        """Return the cause of a stop as text; ``halted`` is True if this program halted the motion."""
        owner = self._controller()
        try:
            count = error_count(owner.execute("GetCurErrorCount"))
            error = str(error_info(owner.execute("GetCurErrorInfo", count - 1))) if count else ""
        except (CallError, ProtocolError):  # the error is only a hint
            error = ""
        stops = _value_or_none(owner, "@EMERGENCY_STOP"), _value_or_none(owner, "@PROTECTIVE_STOP")
        diagnosis = common.StopDiagnosis(*stops, _value_or_none(owner, "@MODE"), _value_or_none(self, "@SERVO_ON"))
        return diagnosis.reason(error, halted=halted, monitored=self.client.alive is not None)

    def _controller(self) -> ObjectContainer:
        return self._parent if isinstance(self._parent, ObjectContainer) else self

    def _ask(self, name: str, parameter: Value = None) -> Any:
        variable = self.client.dialect.command_variables.get(name)
        if variable is not None:
            return self._read(variable)
        return self._call(f.robot_execute, name, parameter)

    def _read(self, name: str) -> Any:
        with self.variable(name) as variable:
            return variable.get_value()

    @property
    def joints(self) -> J:
        """Return the joints of the arm in deg (CurJnt)."""
        return self.get_joints()

    @property
    def position(self) -> P:
        """Return the position of the tool in the current work frame: mm, deg, figure (CurPos)."""
        return self.get_position()

    @property
    def trans(self) -> T:
        """Return the pose of the tool as a homogeneous transformation (CurTrn)."""
        return self.get_trans()

    @property
    def destination(self) -> J:
        """Return the joints at the end of the current motion in deg (DestJnt); at standstill, the joints of the arm."""
        return self.get_destination()


def _value_or_none(owner: ObjectContainer, name: str) -> Any:
    """Return the value of a variable of an object; ``None`` if the variable does not exist or cannot be read."""
    try:
        with owner.variable(name) as variable:
            return variable.get_value()
    except (CallError, ProtocolError):
        return None


class Motion:
    """A commanded motion. Wait for its end, or iterate over it for its progress.

    Each query calls the controller: MotionComplete for the end, CurJnt and DestJnt for the progress. If this or another
    program stopped the motion, all queries raise an error, so that a program cannot continue as if the arm had arrived.
    If another motion follows, this motion is over as soon as the robot executes the next one.

    Attributes:
        segment: Start and end of the motion.
    """

    __slots__ = ("_call", "_fraction", "_number", "_over", "_robot", "_stop", "_track", "segment")

    def __init__(
        self,
        robot: ArmBase,
        track: MotionTracker,
        number: int,
        call: tuple[str, str, tuple[Any, ...]],
        segment: common.MotionSegment,
        *,
        over: bool,
    ) -> None:
        self.segment = segment
        self._robot = robot
        self._track = track
        self._number = number
        self._call = call  # (name of the robot, name of the function, arguments)
        self._over = over
        self._fraction = float(over)
        self._stop: common.MotionStop | None = None

    def __repr__(self) -> str:
        state = "over" if self._over else "stopped" if self._stop is not None else "running"
        return f"<{type(self).__name__} {self._call[1]} of {self._call[0]!r}: {state}, {self._fraction:.0%}>"

    def __iter__(self) -> MotionProgress:
        """Iterate over the progress, 0 to 1, until the motion is over; the last value is 1."""
        return MotionProgress(self)

    def wait(self, timeout: float | None = None) -> None:
        """Wait for the end of the motion.

        Args:
            timeout: Maximum time to wait in s; the default is no limit. After the time-out, the motion continues.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, if the motion was stopped before its end.
            TimeoutError: If the motion is not over after the time-out.
        """
        deadline = Deadline(timeout)
        while not self.get_done():
            if timeout is not None and deadline.passed:
                raise TimeoutError(tr("the motion is not over after {seconds:g} s", seconds=timeout))
            sleep(min(common.POLL, deadline.left))

    def halt(self) -> None:
        """Stop and abort the motion, which then counts as stopped before its end."""
        self._robot.halt()

    def get_done(self) -> bool:
        """Return True if the motion is over.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, if the motion was stopped before its end.
        """
        if self._stop is None and not self._over:
            self._update()
        if self._stop is not None:
            subject, function, arguments = self._call
            raise self._stop.error(subject, function, (self._robot.handle, *arguments), self.segment)
        return self._over

    def get_progress(self) -> float:
        """Return the part of the distance in joint space that the arm has covered, from 0 to 1.

        The value never decreases.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, if the motion was stopped before its end.
        """
        if not self.get_done():
            self._fraction = max(self._fraction, self.segment.fraction(self._robot.get_joints()))
        return self._fraction

    def _update(self) -> None:
        """Query the controller; record if the motion is over or was stopped."""
        robot, segment, track = self._robot, self.segment, self._track
        followed = track.newest != self._number
        complete = False
        if self._number < track.replied:
            self._over = True
        elif followed or segment.awaits_start:
            destination = robot.get_destination()
            complete = robot.motion_complete()
            if not complete:  # at standstill, DestJnt is the position of the arm
                segment.see(destination)
                self._over = followed and segment.left_behind(destination)
        else:
            complete = robot.motion_complete()
        if not self._over and complete:
            self._over = followed or bool(self._arrived()) or self._arrived_late()
        if self._over:
            self._fraction = 1.0
        if (self._over or self._stop is not None) and track.running is self:
            track.running = None

    def _arrived(self) -> bool | None:
        """Return True if the arm is at the end of the motion; ``None`` if the end is unknown."""
        robot, segment = self._robot, self.segment
        if segment.end is not None and common.near(robot.get_joints(), segment.end):
            return True
        if isinstance(segment.target, P):
            return common.same_place(robot.get_position(), segment.target)
        return None if segment.end is None else False

    def _arrived_late(self) -> bool:
        """Check again after a short time if the arm has arrived; if the arm has stopped elsewhere, record the stop.

        The second check is necessary because encoders lag behind the command, and because a motion that was just
        accepted may not have begun.
        """
        robot = self._robot
        sleep(common.SETTLE)
        if not robot.motion_complete(_ARM):
            return False
        if self._arrived() is not False or robot._locked():
            return True
        reason = robot._reason(halted=self._number <= self._track.halted)
        self._stop = common.MotionStop(robot.get_joints(), reason)
        return False

    @property
    def done(self) -> bool:
        """Return True if the motion is over.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, if the motion was stopped before its end.
        """
        return self.get_done()

    @property
    def progress(self) -> float:
        """Return the part of the distance in joint space that the arm has covered, from 0 to 1.

        The value never decreases.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, if the motion was stopped before its end.
        """
        return self.get_progress()


class MotionProgress:
    """Iterates over the progress of a motion until it is over."""

    __slots__ = ("_begun", "_ended", "_motion")

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._begun = False
        self._ended = False

    def __iter__(self) -> MotionProgress:
        return self

    def __next__(self) -> float:
        if self._ended:
            raise StopIteration
        if self._begun:
            sleep(common.POLL)
        self._begun = True
        fraction = self._motion.get_progress()
        self._ended = fraction >= 1.0
        return fraction
