"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``motion.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.client._shared import motion as common
from orinkit.client._shared.common import error_count, error_info
from orinkit.client._shared.robot import HOLDING_COMMANDS, is_missing, passes, read_number, read_pose, sendable
from orinkit.client._sync.client import Client
from orinkit.client._sync.objects import ObjectBase, ObjectContainer
from orinkit.core.errors import CallError, OrinError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.transport.runner import Deadline, pause
from orinkit.values.poses import J, P, T
from orinkit.values.variant import Value

_ARM: Final = 1


class MotionTracker:
    """What a robot object knows of its motions.

    Attributes:
        newest: number of the last motion that was commanded.
        answered: number of the last one that was answered at its end, so that all before it are over.
        halted: number of the last one that this program has halted.
        running: the last one that is not answered at its end, until it is known to be over.
        passing: whether the last one was answered at its pass mark, while the arm may still have moved.
        sure: whether all that was commanded is known; not where a call had no answer, or a command may have moved the arm.
        paused: whether this program has paused it.
        at_rest: whether the arm surely stands: it was halted, and nothing has been commanded since.
    """

    __slots__ = ("answered", "at_rest", "halted", "newest", "passing", "paused", "running", "sure")

    def __init__(self) -> None:
        self.newest = 0
        self.answered = 0
        self.halted = 0
        self.running: Motion | None = None
        self.passing = False
        self.sure = False
        self.paused = False
        self.at_rest = False


class ArmBase(ObjectContainer):
    """Where an arm is, and how its motions are started and stopped: what :class:`Motion` needs of a robot."""

    __slots__ = ("_track",)

    def __init__(self, client: Client, handle: int, label: str, parent: ObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._track = MotionTracker()

    def _begin(
        self, function: Function[..., None], *arguments: Any, wait: bool, way: common.MotionSegment | None = None
    ) -> Motion:
        """Make the call that starts a motion, and return the motion.

        A call that is broken off, by Ctrl-C or because its task is cancelled, closes the connection: the controller
        then stops the arm, which would otherwise go on with nobody to wait for it. With UDP and on a serial line it is
        only told so once, and does not notice by itself, or late.

        Args:
            function: the call.
            arguments: of the call, without the handle.
            wait: whether the controller answers at the end of the motion.
            way: is filled in with where the motion begins and ends; by default nothing more is asked of the controller.
        """
        track = self._track
        before = None if wait or way is None else self._before(track)
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
            error.add_note(common.note_broken_off(self.client.profile))
            raise
        call = (self._label, function.name, arguments)
        motion = Motion(self, track, number, call, way or common.MotionSegment(), over=wait)
        track.running = None if wait else motion
        track.passing = wait and passes(arguments)
        if wait:
            track.answered, track.sure = number, True
        elif before is not None:
            self._note_way(motion.way, *before)
        return motion

    def _before(self, track: MotionTracker) -> tuple[common.MotionSegment, bool] | None:
        """Return the way of the motion before, and whether that one is as good as over; None where it is not known."""
        running = track.running
        answered = track.sure and running is None and track.newest == track.answered
        try:
            if answered or self.motion_complete():
                track.sure = True
                return common.MotionSegment.leading_to(self.get_destination()), True
            if running is None or not track.sure:
                return None
            running.way.see(self.get_destination())
        except CallError as error:
            if not is_missing(error):
                raise
            return None
        return running.way, False

    def _note_way(self, way: common.MotionSegment, before: common.MotionSegment, over: bool) -> None:
        try:
            way.begin(before, self.get_joints() if over else None, self.get_destination())
        except CallError as error:
            if not is_missing(error):
                raise

    def execute(self, command: str, parameter: Value = None) -> Any:
        """Execute an extended command, for example ``execute("CurJnt")``, and return its result.

        Args:
            command: its name.
            parameter: a value of CAO; ``P(...)``, ``J(...)``, ``T(...)`` and ``V(...)`` in it go out as their texts.
        """
        if str(command).strip().lower() not in HOLDING_COMMANDS:
            self._track.at_rest = self._track.sure = False
        return super().execute(command, sendable(parameter))

    def halt(self, option: str = "") -> None:
        """Stop the motion and abandon it; works from a second connection while the first waits for its motion.

        It is answered when the command stands. The encoders follow a few cycles later: joints that are read at once may
        still change by a fraction of a degree.
        """
        track = self._track
        track.halted = track.newest
        if self.client.dialect.takes_arm:
            self._call(f.robot_halt, option)
        else:  # nothing but slave mode moves it
            self._call(f.robot_execute, "slvChangeMode", 0)
        track.at_rest = track.sure = True
        track.paused = track.passing = False

    def hold(self, option: str = "") -> None:
        """Pause the motion."""
        self._track.paused = True
        self._call(f.robot_hold, option)

    def unhold(self, option: str = "") -> None:
        """Go on with a paused motion."""
        self._call(f.robot_unhold, option)
        self._track.paused = False

    # --- where it is --------------------------------------------------------------------------------------------

    def motion_complete(self, mode: int = 0) -> bool:
        """Return whether all motions are over (MotionComplete): 0 the command's, 1 the arm's too."""
        return bool(read_number("MotionComplete", self._ask("MotionComplete", [-1, mode])))

    def get_joints(self) -> J:
        """Joints of the arm, degrees (CurJnt)."""
        return read_pose(J, "CurJnt", self._ask("CurJnt"))

    def get_position(self) -> P:
        """Where the tool is: mm, degrees, figure (CurPos), in the work frame in use."""
        return read_pose(P, "CurPos", self._ask("CurPos"))

    def get_trans(self) -> T:
        """Where the tool is, as a homogeneous transformation (CurTrn)."""
        return read_pose(T, "CurTrn", self._ask("CurTrn"))

    def get_destination(self) -> J:
        """Where the motion that runs ends, degrees (DestJnt); where the arm is, when nothing moves."""
        return read_pose(J, "DestJnt", self._ask("DestJnt"))

    def _locked(self) -> bool:
        """Return whether the machine lock is on: motions run, the arm stays."""
        return bool(_told(self._controller(), "@LOCK"))

    def _reason(self, *, halted: bool) -> str:
        """Return in words why a motion was stopped; ``halted``: this program has halted it."""
        owner = self._controller()
        try:
            count = error_count(owner.execute("GetCurErrorCount"))
            error = str(error_info(owner.execute("GetCurErrorInfo", count - 1))) if count else ""
        except (CallError, ProtocolError):  # it is only a hint
            error = ""
        stops = _told(owner, "@EMERGENCY_STOP"), _told(owner, "@PROTECTIVE_STOP")
        known = common.StopDiagnosis(*stops, _told(owner, "@MODE"), _told(self, "@SERVO_ON"))
        return known.reason(error, halted=halted)

    def _controller(self) -> ObjectContainer:
        return self._parent if isinstance(self._parent, ObjectContainer) else self

    def _ask(self, name: str, parameter: Value = None) -> Any:
        variable = self.client.dialect.variables.get(name)
        if variable is not None:
            return self._read(variable)
        return self._call(f.robot_execute, name, parameter)

    def _read(self, name: str) -> Any:
        with self.variable(name) as variable:
            return variable.get_value()

    @property
    def joints(self) -> J:
        """Joints of the arm, degrees (CurJnt)."""
        return self.get_joints()

    @property
    def position(self) -> P:
        """Where the tool is: mm, degrees, figure (CurPos), in the work frame in use."""
        return self.get_position()

    @property
    def trans(self) -> T:
        """Where the tool is, as a homogeneous transformation (CurTrn)."""
        return self.get_trans()

    @property
    def destination(self) -> J:
        """Where the motion that runs ends, degrees (DestJnt); where the arm is, when nothing moves."""
        return self.get_destination()


def _told(owner: ObjectContainer, name: str) -> Any:
    """Return the value of a variable; None where an object has no such variable, or does not tell."""
    try:
        with owner.variable(name) as variable:
            return variable.get_value()
    except (CallError, ProtocolError):
        return None


class Motion:
    """A motion that was commanded: wait for it, or iterate over it to see how far it is.

    The controller is asked each time: MotionComplete tells whether it is over, CurJnt and DestJnt how far it is. A motion
    that was stopped, by whomever, is an error wherever it is asked for, so that no program goes on as if it had arrived.
    A motion that another one follows is over when the robot is on its way to where that one ends.

    Attributes:
        way: from where to where it goes.
    """

    __slots__ = ("_call", "_fraction", "_number", "_over", "_robot", "_stop", "_track", "way")

    def __init__(
        self,
        robot: ArmBase,
        track: MotionTracker,
        number: int,
        call: tuple[str, str, tuple[Any, ...]],
        way: common.MotionSegment,
        *,
        over: bool,
    ) -> None:
        self.way = way
        self._robot = robot
        self._track = track
        self._number = number
        self._call = call  # the robot's name, the function, its arguments
        self._over = over
        self._fraction = float(over)
        self._stop: common.MotionStop | None = None

    def __repr__(self) -> str:
        state = "over" if self._over else "stopped" if self._stop is not None else "running"
        return f"<{type(self).__name__} {self._call[1]} of {self._call[0]!r}: {state}, {self._fraction:.0%}>"

    def __iter__(self) -> MotionProgress:
        """Give how far it is, 0 to 1, until it is over; the last one is 1."""
        return MotionProgress(self)

    def wait(self, timeout: float | None = None) -> None:
        """Wait until it is over.

        Args:
            timeout: seconds; by default as long as it takes. The motion goes on when they have passed.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, it was stopped before its end.
            TimeoutError: it is not over yet.
        """
        deadline = Deadline(timeout)
        while not self.get_done():
            if timeout is not None and deadline.passed:
                raise TimeoutError(tr("the motion is not over after {seconds:g} s", seconds=timeout))
            pause(min(common.POLL, deadline.left))

    def halt(self) -> None:
        """Stop it and abandon it; from then on it is a motion that was stopped."""
        self._robot.halt()

    def get_done(self) -> bool:
        """Whether it is over.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, it was stopped before its end.
        """
        if self._stop is None and not self._over:
            self._look()
        if self._stop is not None:
            subject, function, arguments = self._call
            raise self._stop.error(subject, function, (self._robot.handle, *arguments), self.way)
        return self._over

    def get_progress(self) -> float:
        """How far it is: the part of its way that the joints have left behind, 1 when it is over; never goes back.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, it was stopped before its end.
        """
        if not self.get_done():
            self._fraction = max(self._fraction, self.way.fraction(self._robot.get_joints()))
        return self._fraction

    def _look(self) -> None:
        """Ask how it goes, and note it if it is over or was stopped."""
        robot, way, track = self._robot, self.way, self._track
        followed = track.newest != self._number
        complete = False
        if self._number < track.answered:
            self._over = True
        elif followed or way.waits:
            told = robot.get_destination()
            complete = robot.motion_complete()
            if not complete:  # an arm that stands says where it stands
                way.see(told)
                self._over = followed and way.left_behind(told)
        else:
            complete = robot.motion_complete()
        if not self._over and complete:
            self._over = followed or bool(self._arrived()) or self._arrived_late()
        if self._over:
            self._fraction = 1.0
        if (self._over or self._stop is not None) and track.running is self:
            track.running = None

    def _arrived(self) -> bool | None:
        """Return whether the arm is where the motion ends; None where nobody knows where that is."""
        robot, way = self._robot, self.way
        if way.end is not None and common.near(robot.get_joints(), way.end):
            return True
        if isinstance(way.target, P):
            return common.same_place(robot.get_position(), way.target)
        return None if way.end is None else False

    def _arrived_late(self) -> bool:
        """DrainInput again: the encoders are behind the command, and a motion that was just taken may not have begun."""
        robot = self._robot
        pause(common.SETTLE)
        if not robot.motion_complete(_ARM):
            return False
        if self._arrived() is not False or robot._locked():
            return True
        reason = robot._reason(halted=self._number <= self._track.halted)
        self._stop = common.MotionStop(robot.get_joints(), reason)
        return False

    @property
    def done(self) -> bool:
        """Whether it is over.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, it was stopped before its end.
        """
        return self.get_done()

    @property
    def progress(self) -> float:
        """How far it is: the part of its way that the joints have left behind, 1 when it is over; never goes back.

        Raises:
            CallError: STOPPED_DURING_PC_MOTION, it was stopped before its end.
        """
        return self.get_progress()


class MotionProgress:
    """How far a motion is, again and again, until it is over."""

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
            pause(common.POLL)
        self._begun = True
        fraction = self._motion.get_progress()
        self._ended = fraction >= 1.0
        return fraction
