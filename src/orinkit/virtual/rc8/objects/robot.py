"""Robot objects: the functions in section 3.3 of the b-CAP specification for RC8."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from orinkit.cao.provider import Deferred, RobotObject, VariableObject
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.motion_options import MotionOptions, parse_options
from orinkit.rc8.pose_arguments import line_type_as_position, read_parts, read_targets
from orinkit.values.poses import PassMark, Target
from orinkit.values.types import NUMERIC
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.hand.gripper import Gripper
from orinkit.virtual.rc8.objects import robot_commands
from orinkit.virtual.rc8.objects.motion_calls import MotionResult, begin_motions
from orinkit.virtual.rc8.objects.robot_variables import find_robot_variable, robot_variable_names
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.motion_planner import Plans
from orinkit.virtual.rc8.robot.moves import CURVE
from orinkit.virtual.rc8.variables import conversion

_PATH: Final = re.compile(r"\s*(?:(@\s*(?:[PE]|[0-9.]+))\s+)?([0-9]{1,9})\s*", re.IGNORECASE)
_FRAME: Final = re.compile(r"\s*(tool|work)\s*([0-9]{1,9})?\s*", re.IGNORECASE)
_BETWEEN: Final = re.compile(r"(V\s*(?:[0-9]+|\[[^\]]*\]|\([^)]*\)))[ \t]+(?=V)", re.IGNORECASE)
_PLANE: Final = re.compile(r"\s*(?:XY|YZ|ZX)H?\s*", re.IGNORECASE)
_TIP: Final = -1
_ALL_AXES: Final = 0
_PLANE_POINTS: Final = 3
_VECTOR: Final = 3
_PATH_PARTS: Final = 3  # number, type and pass mark
_ON_A_LINE: Final = 1e-6  # sine of the angle between two sides; below it, three points are collinear


class RC8Robot(RobotObject):
    """The Robot object of one client; when the client's last Robot object is released, the arm is released too."""

    def __init__(self, caller: ClientContext, name: str) -> None:
        text = caller.state.say("Robot of a virtual RC8")
        super().__init__(name, attribute=int(caller.access), help=f"{text} ({caller.robot.arm.model.name})")
        self._caller = caller
        self._state = caller.state
        self._arm = caller.robot.arm
        self._moves = caller.robot.moves
        self._arm.add_robot_object(caller)

    # --- motion -------------------------------------------------------------------------------------------------

    def move(self, interpolation: int, pose: Variant, option: str) -> MotionResult:
        """Move to a pose (RC8 3.3.4); the call completes at the end of the motion, or immediately with option NEXT."""
        self._require("Move")
        options = parse_options(option)
        if self._state.switches.loose_poses:
            pose = line_type_as_position(pose)
        number = path_number(pose) if interpolation == CURVE else None
        if number is not None:
            return self._begin(self._moves.follow(*number, options), options)
        return self._begin(self._moves.move(interpolation, read_targets(pose), options), options)

    def drive(self, axis: int, value: float, option: str) -> MotionResult:
        """Refuse the call, as a real controller does; DriveEx and DriveAEx move single joints.

        Raises:
            CallError: E_NOTIMPL.
        """
        raise error_for(hresult.E_NOTIMPL, tr("Drive is not supported. Try: DriveEx or DriveAEx"))

    def rotate(self, plane: Variant, angle: float, pivot: Variant, option: str) -> MotionResult:
        """Rotate by an angle in deg about a pivot, in a plane of the work frame or in a plane through three points."""
        self._require("Rotate")
        options = parse_options(option)
        name = _plane_name(plane)
        axis = self._moves.plane(name) if name else self._normal(plane)
        return self._begin(self._moves.rotate(axis, self._moves.pivot(name, _pivot(pivot)), angle, options), options)

    def chuck(self, option: str) -> Deferred[None]:
        """Hold with the first gripper as the data of a point say (GRASP); the option is its number, 0 by default."""
        return self._gripper().move_to_point(_point_number(option, 0), must_hold=True)

    def unchuck(self, option: str) -> Deferred[None]:
        """Move the first gripper as the data of a point say (RELEASE); the option is its number, 1 by default."""
        return self._gripper().move_to_point(_point_number(option, 1))

    def go_home(self) -> MotionResult:
        """Move to the home pose."""
        self._require("GoHome")
        return self._begin(self._moves.home(), MotionOptions())

    def halt(self, option: str) -> Deferred[None]:
        """Stop and discard the motions, also those of another client; the call completes at standstill.

        Waiting starts of programs are cancelled, because a program may move the arm. If a program holds the arm, the
        call fails at standstill, because such a motion is to be stopped with Task_Stop.

        Raises:
            CallError: NO_WRITE_RIGHT; ARM_TAKEN_BY_PACSCRIPT if a program holds the arm.
        """
        require("Halt", self._arm, self._caller)
        holder = self._arm.holder
        self._caller.state.tasks.starts.cancel()
        self._arm.stop(hresult.STOPPED_DURING_PC_MOTION)
        still = self._arm.when_still()
        if holder is None or not holder.program:
            return still
        refused = Deferred[None]()
        error = error_for(
            hresult.ARM_TAKEN_BY_PACSCRIPT,
            tr("the arm is stopped, but the program {program} holds it. Try: Task_Stop", program=holder),
        )
        still.add_done_callback(lambda: refused.set_exception(error))
        return refused

    def hold(self, option: str) -> Deferred[None]:
        """Pause the motion, also a motion of another client; the call completes at standstill."""
        self._require("Hold")
        self._arm.hold()
        return self._arm.when_still()

    def unhold(self, option: str) -> None:
        """Continue a paused motion."""
        self._require("Unhold")
        for arm in self._arm.companions:
            if arm.holder is not None:
                require("Unhold", arm, arm.holder)
        self._arm.unhold()

    # --- settings -----------------------------------------------------------------------------------------------

    def speed(self, axis: int, speed: float) -> None:
        """Set the internal speed in %, for all motions (axis -1) or only for point-to-point motions (axis 0)."""
        self._require("Speed")
        self._arm.speeds.set_internal(speed, joint_only=_axis(axis))

    def accelerate(self, axis: int, accel: float, decel: float) -> None:
        """Set internal acceleration and deceleration in %; -1 keeps a value. For the axis see :meth:`speed`."""
        self._require("Accelerate")
        self._arm.speeds.set_acceleration(accel, decel, joint_only=_axis(axis))

    def change(self, name: str) -> None:
        """Change to a tool or work frame: ``Tool1``, ``Work2``."""
        self._require("Change")
        found = _FRAME.fullmatch(name)
        if found is None:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("invalid frame {name}. Try: Tool1 or Work2", name=quoted(name)),
            )
        frames = self._arm.space.tools if found[1].lower() == "tool" else self._arm.space.works
        frames.current = frames.check(int(found[2] or 0))

    # --- commands and variables ---------------------------------------------------------------------------------

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute an extended command (:mod:`orinkit.virtual.rc8.objects.robot_commands`)."""
        return robot_commands.execute(self._caller, command, parameter)

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Connect to a system variable of the robot."""
        return find_robot_variable(self._caller, name)

    def get_variable_names(self, option: str) -> Sequence[str]:
        """Return the names of the robot's system variables."""
        return robot_variable_names()

    def release(self) -> None:
        """Release the object; if it is the client's last one, stop the client's motions and release the arm."""
        self._arm.remove_robot_object(self._caller)

    # --- helpers ------------------------------------------------------------------------------------------------

    def _require(self, name: str) -> None:
        """Check the conditions of a function; a client that is in slave mode with another arm may not use it either."""
        self._caller.require_not_slave()
        require(name, self._arm, self._caller)

    def _begin(self, plans: Plans, options: MotionOptions) -> MotionResult:
        return begin_motions(self._caller, plans, options)

    def _gripper(self) -> Gripper:
        self._caller.require_write()
        gripper = next(iter(self._state.hands.grippers.values()), None)
        if gripper is None:
            raise error_for(hresult.E_NOTIMPL, tr("the controller has no electric gripper"))
        return gripper

    def _normal(self, plane: Variant) -> np.ndarray[Any, np.dtype[np.float64]]:
        if isinstance(plane.value, str):
            plane = Variant(VarType.BSTR, _BETWEEN.sub(r"\1,", parameters.check_length(plane.value)))
        points = [self._moves.point(target) for target in read_targets(plane)]
        if len(points) != _PLANE_POINTS:
            raise _no_plane()
        across, along = points[1] - points[0], points[2] - points[0]
        normal = np.cross(across, along)
        length = float(np.linalg.norm(normal))
        if not length > _ON_A_LINE * float(np.linalg.norm(across) * np.linalg.norm(along)):
            raise _no_plane()
        return np.asarray(normal / length)


def _plane_name(plane: Variant) -> str:
    """Return the name of a plane of the work frame or of the tool; an empty string for three vectors.

    Raises:
        CallError: E_INVALIDARG if a string is neither.
    """
    if not isinstance(plane.value, str) or any(sign.isdecimal() for sign in plane.value):
        return ""
    if _PLANE.fullmatch(plane.value) is None:
        raise _no_plane()
    return plane.value.strip().upper()


def path_number(pose: Variant) -> tuple[int, PassMark | None] | None:
    """Return the number and the pass mark of a stored path, or None if the argument does not refer to a stored path.

    The argument refers to a stored path if it is a number, a string such as ``"@E 1"``, or an array of a number, no type
    and optionally a pass mark, such as ``[1, "", "@E"]`` and ``[1, -1, -2]``.
    """
    if isinstance(pose.value, str):
        found = _PATH.fullmatch(pose.value)
        return found and (int(found[2]), parameters.pass_mark(found[1]) if found[1] else None)
    if pose.type & ARRAY:
        given = parameters.elements(pose)
        if not 1 <= len(given) <= _PATH_PARTS or given[0].type not in NUMERIC or given[-1].type & ARRAY:
            return None
        parts = read_parts(given)
        return None if parts.kind else (conversion.whole(parts.value), parts.mark)
    return (conversion.whole(pose), None) if isinstance(pose.value, int | float) else None


def _pivot(given: Variant) -> Target:
    """Return the pivot of a rotation: a pose, a vector, or three plain numbers as a vector."""
    if given.type & ARRAY and given.type != VARIANT_ARRAY and len(given.value) == _VECTOR:
        return Target("V", tuple(conversion.singles(_VECTOR)(given)))
    targets = read_targets(given)
    if len(targets) != 1:
        raise error_for(hresult.E_INVALIDARG, tr("expected 1 pose, got {count}", count=len(targets)))
    return targets[0]


def _point_number(option: str, missing: int) -> int:
    return conversion.whole(Variant(VarType.BSTR, option)) if option.strip() else missing


def _axis(axis: int) -> bool:
    """Check the axis of Speed and Accelerate; return True if it selects point-to-point motions only."""
    if axis not in (_TIP, _ALL_AXES):
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "axis {axis} is not supported: the axis must be -1 (all motions) or 0 (point-to-point motions)",
                axis=axis,
            ),
        )
    return axis == _ALL_AXES


def _no_plane() -> Exception:
    return error_for(
        hresult.E_INVALIDARG,
        tr("a plane must be XY, YZ, ZX, XYH, YZH, ZXH or three points that are not on a line"),
    )
