"""The interface between a program and its controller: variables, I/O, time, the robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol, TypeAlias

from orinkit.rc8.motion_options import MotionOptions
from orinkit.values.poses import PassMark, Target

Value: TypeAlias = int | float | str | tuple[float, ...]
"""A value of a program: a number, a string, or a pose.

A pose is a tuple of 3 (V), 7 (P), 8 (J) or 10 (T) numbers, in mm and deg."""

Wait: TypeAlias = Callable[[], bool]
"""A function that is polled until it returns True, which means that the operation is complete.

It may raise :class:`orinkit.core.errors.CallError`."""


class DelayWait:
    """The wait of Delay: complete when a time has come.

    Args:
        now: Callback that returns the controller's time, s.
        until: The time, s.
    """

    def __init__(self, now: Callable[[], float], until: float) -> None:
        self._now = now
        self._until = until

    def __call__(self) -> bool:
        """Return True if the time has come."""
        return self._now() >= self._until


VariableKind: TypeAlias = Literal["I", "F", "D", "V", "P", "J", "T", "S"]
"""The classes of global variables."""
PointKind: TypeAlias = Literal["IO", "IOB", "IOW", "IOD"]
"""The classes of I/O: IO is one point; IOB, IOW and IOD are groups of 8, 16 and 32 points."""
Plane: TypeAlias = Literal["XY", "YZ", "ZX", "XYH", "YZH", "ZXH"]
"""Planes of the work frame; the names with H are planes of the tool frame."""


class HostInterface(Protocol):
    """The functions of the controller that a program can call.

    Every method may raise :class:`orinkit.core.errors.CallError`. A method that starts a motion returns a :data:`Wait`
    immediately; the program continues when the wait is complete. With the option ``Next``, the wait is complete as soon
    as the motion has been accepted. The interpolations are 1 (P: PTP), 2 (L: linear), 3 (C: arc) and 4 (S: free
    curve). Lengths are in mm, angles in deg, times in s, speeds in %.
    """

    def read(self, kind: VariableKind, index: int) -> Value:
        """Return the value of a global variable."""

    def write(self, kind: VariableKind, index: int, value: Value) -> None:
        """Set a global variable: ``int`` for I, ``float`` for F and D, ``str`` for S, a tuple for the others."""

    def read_io(self, kind: PointKind, point: int) -> int:
        """Return the state of an I/O point, 0 or 1, or the states of 8, 16 or 32 points as the bits of a number.

        The points of a group are counted from ``point`` on, which is the lowest bit.
        """

    def write_io(self, kind: PointKind, point: int, value: int) -> None:
        """Set an I/O point to 0 or 1, or set 8, 16 or 32 points to the bits of a number.

        The points of a group are counted from ``point`` on, which is the lowest bit; higher bits are ignored.
        """

    def now(self) -> float:
        """Return the controller's time in s."""

    def show(self, kind: Literal["msg", "dbg"], text: str, title: str = "") -> None:
        """Show a message (PrintMsg) or a line of debugging output (PrintDbg)."""

    def take_arm(self, group: int, keep: bool) -> None:
        """Take an arm group; without ``keep``, speeds, tool and work are reset to their defaults."""

    def give_arm(self) -> Wait:
        """Release the arm group at the end of its motions."""

    def motor(self, on: bool) -> Wait:
        """Switch the motor on or off."""

    def move(self, interpolation: int, targets: tuple[Target, ...], options: MotionOptions) -> Wait:
        """Move to a target.

        With interpolation C, move on an arc through the first target to the second. With S, move along the stored path
        whose number is the target.
        """

    def approach(
        self, interpolation: int, target: Target, distance: float, mark: PassMark | None, options: MotionOptions
    ) -> Wait:
        """Move to the pose that is a distance away from the target, in the -Z direction of the tool at the target."""

    def depart(self, interpolation: int, distance: float, mark: PassMark | None, options: MotionOptions) -> Wait:
        """Move by a distance in the direction opposite to the tool's Z axis."""

    def drive(
        self, pairs: tuple[tuple[int, float], ...], absolute: bool, mark: PassMark | None, options: MotionOptions
    ) -> Wait:
        """Move joints to positions (``absolute``) or by distances; each pair is a joint number and its value."""

    def rotate(self, plane: Plane, angle: float, pivot: Target | None, options: MotionOptions) -> Wait:
        """Rotate about the axis that passes through the pivot and is perpendicular to a plane.

        The pivot is a V in the frame of the plane; ``None`` for the tool's origin. The pass mark is in the options.
        """

    def speed(self, percent: float) -> None:
        """Set the internal speed."""

    def accel(self, accel: float | None, decel: float | None) -> None:
        """Set the internal acceleration and deceleration; ``None`` leaves the value unchanged."""

    def ext_speed(self, speed: float, accel: float | None, decel: float | None) -> None:
        """Set the external speed, acceleration and deceleration; ``None`` sets the default, speed squared / 100."""

    def change_tool(self, number: int) -> None:
        """Select a tool."""

    def change_work(self, number: int) -> None:
        """Select a work."""

    def hold(self) -> Wait:
        """Pause the program; the wait is complete when the program is started again."""

    def current(self, kind: Literal["P", "J", "T", "FIG"], dest: bool = False) -> Value:
        """Return the current pose in the pose type ``kind``, or only its figure for FIG.

        With ``dest``, return the pose or the figure at the destination of the motion.
        """

    def convert(self, name: str, arguments: tuple[Value, ...]) -> Value:
        """Return the result of J2P, J2T, P2J, P2T, T2J, T2P, Dev, DevH or OutRange.

        The arguments are poses; for OutRange, one pose and optionally the numbers of the tool and the work.
        """

    def robot_command(self, name: str, arguments: tuple[Value, ...]) -> Wait:
        """Execute a command of Robot_Execute; the wait is complete at its end."""

    def robot_value(self, name: str, arguments: tuple[Value, ...]) -> Value:
        """Return the result of a command of Robot_Execute that only reads."""
