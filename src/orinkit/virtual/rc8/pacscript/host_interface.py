"""What a program needs of the controller around it: variables, I/O, time, the robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol, TypeAlias

from orinkit.rc8.motion_options import MotionOptions
from orinkit.values.poses import PassMark, Target

Value: TypeAlias = int | float | str | tuple[float, ...]
"""A value of a program: a number, a text, or a pose (V 3, P 7, J 8, T 10 numbers: mm, degrees)."""

Wait: TypeAlias = Callable[[], bool]
"""Asked again and again: True when it is over. May raise :class:`orinkit.core.errors.CallError`."""

VariableKind: TypeAlias = Literal["I", "F", "D", "V", "P", "J", "T", "S"]
"""The classes of global variables."""
PointKind: TypeAlias = Literal["IO", "IOB", "IOW", "IOD"]
"""The classes of I/O: 1, 8, 16, 32 points."""
Plane: TypeAlias = Literal["XY", "YZ", "ZX", "XYH", "YZH", "ZXH"]
"""Planes of the work frame, or with H of the tool's."""


class HostInterface(Protocol):
    """The controller as a program sees it. Every method may raise :class:`orinkit.core.errors.CallError`.

    What starts a motion returns at once, and the program goes on when the :data:`Wait` that it returns is over; with
    the option ``Next`` that is as soon as the motion has been taken. Interpolations are 1 P, 2 L, 3 C, 4 S. Lengths are
    in mm, angles in degrees, times in seconds, speeds in per cent.
    """

    def read(self, kind: VariableKind, index: int) -> Value:
        """Return the value of a global variable."""

    def write(self, kind: VariableKind, index: int, value: Value) -> None:
        """Set a global variable: ``int`` for I, ``float`` for F and D, ``str`` for S, a tuple for the others."""

    def read_io(self, kind: PointKind, point: int) -> int:
        """Return 0 or 1 of an I/O point, or the number in 8, 16 or 32 points from it on."""

    def write_io(self, kind: PointKind, point: int, value: int) -> None:
        """Set an I/O point to 0 or 1, or 8, 16 or 32 points from it on to the lowest bits of a number."""

    def now(self) -> float:
        """Return the controller's time, s."""

    def show(self, kind: Literal["msg", "dbg"], text: str, title: str = "") -> None:
        """Show a message (PrintMsg) or a line of debugging output (PrintDbg)."""

    def take_arm(self, group: int, keep: bool) -> None:
        """Take an arm group; unless ``keep``, speeds, tool and work return to their defaults."""

    def give_arm(self) -> None:
        """Give the arm group back."""

    def motor(self, on: bool) -> Wait:
        """Switch the motor."""

    def move(self, interpolation: int, targets: tuple[Target, ...], options: MotionOptions) -> Wait:
        """Move to a target; to the second of two on an arc (C); along the path whose number is the value (S)."""

    def approach(
        self, interpolation: int, target: Target, distance: float, mark: PassMark | None, options: MotionOptions
    ) -> Wait:
        """Move to the place a distance from the target, against the tool's Z axis at the target."""

    def depart(self, interpolation: int, distance: float, mark: PassMark | None, options: MotionOptions) -> Wait:
        """Move by a distance against the tool's Z axis."""

    def drive(
        self, pairs: tuple[tuple[int, float], ...], absolute: bool, mark: PassMark | None, options: MotionOptions
    ) -> Wait:
        """Move joints, numbers and values, to or by the values."""

    def rotate(self, plane: Plane, angle: float, pivot: Target | None, options: MotionOptions) -> Wait:
        """Turn about the normal of a plane through a pivot, a V; the mark is that of the options."""

    def speed(self, percent: float) -> None:
        """Set the internal speed."""

    def accel(self, accel: float | None, decel: float | None) -> None:
        """Set the internal acceleration and deceleration; ``None`` leaves one as it is."""

    def ext_speed(self, speed: float, accel: float | None, decel: float | None) -> None:
        """Set the external speed, acceleration and deceleration; ``None`` where none was given."""

    def change_tool(self, number: int) -> None:
        """Select a tool."""

    def change_work(self, number: int) -> None:
        """Select a work."""

    def hold(self) -> Wait:
        """Pause the program; the wait is over when it is started again."""

    def current(self, kind: Literal["P", "J", "T", "FIG"], dest: bool = False) -> Value:
        """Return where the robot is, or with ``dest`` where it was sent."""

    def convert(self, name: str, arguments: tuple[Value, ...]) -> Value:
        """Return J2P, J2T, P2J, P2T, T2J, T2P, Dev, DevH (values of these kinds) or OutRange (a pose, tool, work)."""
