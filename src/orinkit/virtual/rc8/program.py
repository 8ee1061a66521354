"""The functions of the controller that a running program calls: variables, I/O, arm, time.

They implement :class:`~orinkit.virtual.rc8.pacscript.host_interface.HostInterface`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Literal

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.rc8.motion_options import MotionOptions
from orinkit.values.poses import PassMark, Target
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.engine.motion.queue import Ticket
from orinkit.virtual.rc8.pacscript.host_interface import Plane, PointKind, Value, VariableKind, Wait
from orinkit.virtual.rc8.pacscript.keywords import CONSTANTS
from orinkit.virtual.rc8.robot import queries, state_report
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.motion_planner import Plans
from orinkit.virtual.rc8.robot.moves import CURVE, Moves
from orinkit.virtual.rc8.robot.shared_commands import SHARED_COMMANDS
from orinkit.virtual.rc8.robot.speeds import KEEP, SQUARE
from orinkit.virtual.rc8.variables.table import VariableTable
from orinkit.virtual.rc8.variables.types import CLASSES

_VT: Final = {"I": VarType.I4, "F": VarType.R8, "D": VarType.R8, "S": VarType.BSTR}
_R8_ARRAY: Final = int(VarType.R8) | ARRAY
_PTP: Final = 1
_TYPES: Final = {int: VarType.I4, bool: VarType.I4, float: VarType.R8, str: VarType.BSTR}
_SKIPPED: Final = Deferred[Any]()
_SKIPPED.set_result()


class TaskHost:
    """The functions of the controller for the program of one task.

    Args:
        operator: The task, as an operator of the arm.
        suspend: Callback that suspends the task.
        arm, moves: The arm, and the planner of its motions.
        variables: Global variables and I/O.
        seconds: Callback that returns the controller's time, s.
        show: Callback invoked for each printed text; its arguments are the name of the task, ``"msg"`` (PrintMsg) or
            ``"dbg"`` (PrintDbg), and the text.
        takes_arm: False for a supervisory task, which cannot take the arm.
    """

    def __init__(
        self, operator: Operator, suspend: Callable[[], None], arm: RC8Arm, moves: Moves, variables: VariableTable, seconds: Callable[[], float],
        show: Callable[[str, str, str], None], *, takes_arm: bool = True,
    ) -> None:  # fmt: skip
        self._operator = operator
        self._suspend = suspend
        self._arm = arm
        self._moves = moves
        self._variables = variables
        self._seconds = seconds
        self._show = show
        self._takes_arm = takes_arm
        self._paused = False  # pause_motion() has stopped the arm
        self._holding = False  # the program has executed Hold

    # --- suspend, continue, end ---------------------------------------------------------------------------------

    def pause_motion(self) -> None:
        """If this program holds the arm, bring the arm to standstill on its path."""
        if self._arm.holder is self._operator and self._arm.busy and not self._arm.held:
            self._paused = True
            self._arm.hold()

    def resume_motion(self) -> None:
        """Continue the motion paused by :meth:`pause_motion`."""
        if self._paused and self._arm.holder is self._operator:
            self._arm.unhold()
        self._paused = self._holding = False

    def leave(self, *, halt: bool) -> None:
        """If this program holds the arm, release the arm.

        With ``halt``, also stop the arm; otherwise the arm completes its motion.
        """
        self._paused = self._holding = False
        if self._arm.holder is self._operator:
            if halt:
                self._arm.stop(hresult.STOPPED_DURING_PC_MOTION)
            self._arm.give()

    @property
    def joints(self) -> tuple[float, ...]:
        """The command position of the arm, deg."""
        return self._arm.queue.joints

    def return_to(self, joints: tuple[float, ...]) -> Wait | None:
        """Begin to move the arm to a joint position; None if this program does not hold the arm, or if it is there."""
        if self._arm.holder is not self._operator or self._arm.queue.joints == joints:
            return None
        target = Target("J", joints)
        return self._motion("Move", MotionOptions(), lambda: self._moves.move(_PTP, (target,), MotionOptions()))

    # --- variables, time, output --------------------------------------------------------------------------------

    def read(self, kind: VariableKind, index: int) -> Value:
        """Return the value of a global variable."""
        value: Value | list[float] = self._global(lambda: self._variables.read(CLASSES[kind], index).value)
        return tuple(value) if isinstance(value, list) else value

    def write(self, kind: VariableKind, index: int, value: Value) -> None:
        """Set a global variable."""
        given = Variant(_VT.get(kind, _R8_ARRAY), list(value) if isinstance(value, tuple) else value)
        self._global(lambda: self._variables.write(CLASSES[kind], index, given))

    def read_io(self, kind: PointKind, point: int) -> int:
        """Return the state of an I/O point, or the states of a group of points as the bits of a number.

        The lowest bit is ``point``, the first point of the group.
        """
        value = int(self._global(lambda: self._variables.read(CLASSES[kind], point).value))
        return value & 0xFF if kind == "IOB" else value

    def write_io(self, kind: PointKind, point: int, value: int) -> None:
        """Set an I/O point to 0 or 1, or set a group of points to the bits of a number.

        The lowest bit is ``point``, the first point of the group.
        """
        bits = CLASSES[kind].bits
        lowest = value & (1 << bits) - 1
        if kind in ("IOW", "IOD") and lowest >> bits - 1:
            lowest -= 1 << bits
        self._global(lambda: self._variables.write(CLASSES[kind], point, Variant(VarType.I4, lowest)))

    def now(self) -> float:
        """Return the controller's time, s."""
        return self._seconds()

    def show(self, kind: Literal["msg", "dbg"], text: str, title: str = "") -> None:
        """Add a printed text to the operation log; if it is a message (PrintMsg), also send it to the clients."""
        self._show(str(self._operator), kind, f"{title}: {text}" if title else text)

    # --- the robot ----------------------------------------------------------------------------------------------

    def take_arm(self, group: int, keep: bool) -> None:
        """Acquire the arm semaphore."""
        if not self._takes_arm:
            raise error_for(hresult.E_ACCESSDENIED, tr("a supervisory task cannot take the arm"))
        require("TakeArm", self._arm, self._operator)
        self._arm.take(self._operator, keep=keep)

    def give_arm(self) -> Wait:
        """Release the arm semaphore at the end of the motions."""
        require("GiveArm", self._arm, self._operator)
        return _until(self._arm.give_at_end(self._operator)) if self._arm.holder is self._operator else lambda: True

    def motor(self, on: bool) -> Wait:
        """Switch the motor on or off."""
        name = "Motor on" if on else "Motor off"
        require(name, self._arm, self._operator)
        return _until(self._arm.switch_motor(on, self._operator, lambda: require(name, self._arm, self._operator)))

    def move(self, interpolation: int, targets: tuple[Target, ...], options: MotionOptions) -> Wait:
        """Move to one or more poses, or along a stored path."""
        if interpolation == CURVE and len(targets) == 1 and not targets[0].kind:
            return self._curve(targets[0], options)
        return self._motion("Move", options, lambda: self._moves.move(interpolation, targets, options))

    def approach(
        self, interpolation: int, target: Target, distance: float, mark: PassMark | None, options: MotionOptions
    ) -> Wait:
        """Move to the pose that is a distance away from a target, in the -Z direction of the tool at the target."""
        return self._motion(
            "Approach", options, lambda: self._moves.approach(interpolation, target, distance, mark, options)
        )

    def depart(self, interpolation: int, distance: float, mark: PassMark | None, options: MotionOptions) -> Wait:
        """Move by a distance in the -Z direction of the tool."""
        return self._motion("Depart", options, lambda: self._moves.depart(interpolation, distance, mark, options))

    def drive(
        self, pairs: tuple[tuple[int, float], ...], absolute: bool, mark: PassMark | None, options: MotionOptions
    ) -> Wait:
        """Move axes by distances, or with ``absolute`` to positions."""
        name = "DriveAEx" if absolute else "DriveEx"
        return self._motion(name, options, lambda: self._moves.drive(pairs, absolute, mark, options))

    def rotate(self, plane: Plane, angle: float, pivot: Target | None, options: MotionOptions) -> Wait:
        """Rotate about the axis that passes through the pivot and is perpendicular to a plane.

        If ``pivot`` is ``None``, the axis passes through the tool's origin.
        """

        def plans() -> Plans:
            return self._moves.rotate(self._moves.plane(plane), self._moves.pivot(plane, pivot), angle, options)

        return self._motion("Rotate", options, plans)

    def speed(self, percent: float) -> None:
        """Set the internal speed."""
        require("Speed", self._arm, self._operator)
        self._arm.speeds.set_internal(percent)

    def accel(self, accel: float | None, decel: float | None) -> None:
        """Set internal acceleration and deceleration; ``None`` leaves a value unchanged."""
        require("Accelerate", self._arm, self._operator)
        self._arm.speeds.set_acceleration(*(KEEP if value is None else value for value in (accel, decel)))

    def ext_speed(self, speed: float, accel: float | None, decel: float | None) -> None:
        """Set the external speed, acceleration and deceleration; ``None`` sets the default, speed squared / 100."""
        require("ExtSpeed", self._arm, self._operator)
        self._arm.speeds.set_external(speed, *(SQUARE if value is None else value for value in (accel, decel)))

    def change_tool(self, number: int) -> None:
        """Select a tool."""
        require("Change", self._arm, self._operator)
        self._arm.space.tools.current = self._arm.space.tools.check(number)

    def change_work(self, number: int) -> None:
        """Select a work frame."""
        require("Change", self._arm, self._operator)
        self._arm.space.works.current = self._arm.space.works.check(number)

    def hold(self) -> Wait:
        """Suspend the program until it is started again (Hold)."""
        self._holding = True
        self._suspend()
        return lambda: not self._holding

    def current(self, kind: Literal["P", "J", "T", "FIG"], dest: bool = False) -> Value:
        """Return the present pose of the robot in the pose type ``kind``, or only its figure for FIG.

        With ``dest``, return the pose or the figure at the destination of the motion.
        """
        source = state_report.destination(self._arm) if dest else state_report.current(self._arm)
        if kind == "FIG":
            return source.figure()
        return tuple({"P": source.position, "J": source.angles, "T": source.trans}[kind]())

    def convert(self, name: str, arguments: tuple[Value, ...]) -> Value:
        """Return the result of a pose function such as J2P, Dev or OutRange."""
        given = [
            Variant(_R8_ARRAY, list(each)) if isinstance(each, tuple) else Variant(VarType.I4, each)
            for each in arguments
            if isinstance(each, tuple | int)
        ]
        value = queries.calculate(self._arm, name, given).value
        return tuple(value) if isinstance(value, list) else int(value)

    def robot_command(self, name: str, arguments: tuple[Value, ...]) -> Wait:
        """Execute a command that programs share with clients."""
        result = self._run_shared(name, arguments)
        return _until(result) if isinstance(result, Deferred) else _complete

    def robot_value(self, name: str, arguments: tuple[Value, ...]) -> Value:
        """Return the result of a command that programs share with clients."""
        result = self._run_shared(name, arguments)
        value = result.value if isinstance(result, Variant) else result
        if isinstance(value, bool):
            return CONSTANTS["true" if value else "false"]
        return tuple(value) if isinstance(value, list) else value

    def _run_shared(self, name: str, arguments: tuple[Value, ...]) -> Any:
        given = [
            Variant(_R8_ARRAY, list(each)) if isinstance(each, tuple) else Variant(_TYPES[type(each)], each)
            for each in arguments
        ]
        return SHARED_COMMANDS[name].run(self._arm, self._operator, Variant(VARIANT_ARRAY, given))

    # --- helpers ------------------------------------------------------------------------------------------------

    def _curve(self, target: Target, options: MotionOptions) -> Wait:
        values = target.value
        number = values if isinstance(values, int) else int(values[0])
        return self._motion("Move", options, lambda: self._moves.follow(number, target.mark, options))

    def _motion(self, name: str, options: MotionOptions, plans: Callable[[], Plans]) -> Wait:
        """Return a wait that begins a motion as soon as the queue has room.

        The wait is complete when the motion has ended or has reached its pass mark. With the option ``Next``, the
        wait is complete when the motion is in the queue.
        """
        require(name, self._arm, self._operator)
        begun: list[Deferred[Any]] = []

        def completion(tickets: Sequence[Ticket]) -> Deferred[None]:
            return self._arm.when_done(tickets[-1])

        def over() -> bool:
            if not begun:
                if self._arm.queue.full:
                    return False
                require(name, self._arm, self._operator)
                begun.append(self._moves.begin(plans(), completion, pauses=True))
            if begun[0].brief:  # the motion is being planned
                if not begun[0].done():
                    return False
                begun[0] = begun[0].result() or _SKIPPED
            return options.next or _until(begun[0])()

        over()
        return over

    def _global(self, access: Callable[[], Value | list[float] | None]) -> Any:
        try:
            return access()
        except CallError as error:
            if error.code == hresult.VARIABLE_INDEX_INVALID:  # programs have another code for it
                raise error_for(hresult.GLOBAL_VARIABLE_OUT_OF_RANGE, error.detail) from None
            if error.code == hresult.DISP_E_TYPEMISMATCH:
                raise error_for(
                    hresult.VARIABLE_CHANGE_FAILED, tr("the type of the value does not match the type of the variable")
                ) from None
            raise


def _complete() -> bool:
    return True


def _until(done: Deferred[None]) -> Wait:
    def over() -> bool:
        if done.done():
            done.result()
        return done.done()

    return over
