"""The asynchronous robot: motions in Python's own manner, beside the functions as CAO has them.

The synchronous twin is made from this file, as that of :mod:`orinkit.client._async.controller` is.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Unpack, overload

from orinkit.cao import functions as f
from orinkit.client._async.leases import AsyncArm, AsyncMotor
from orinkit.client._async.motion import AsyncArmBase, AsyncMotion
from orinkit.client._shared import robot as common
from orinkit.client._shared.common import ObjectFunctions
from orinkit.client._shared.motion import MotionSegment
from orinkit.client._shared.robot import MoveOptions, pose_text
from orinkit.values.poses import J, P, PassMark, PoseLike, T
from orinkit.values.variant import Value

if TYPE_CHECKING:
    from orinkit.client._async.stream import AsyncStream
    from orinkit.client._shared.stream_options import OnRange, Wanted
    from orinkit.streaming.planning.limits import Limits, PathLimits


class AsyncRobot(AsyncArmBase):
    """A robot (RC8 3.3). A motion is never repeated by the client.

    Motions take a pose (``P(...)``, ``J(...)``, ``T(...)``, or a text such as ``"P1"``), a pass mark (``"@0"``, ``"@E"``,
    ``"@P"``, ``"@10"``) and options by name: ``speed``, ``accel``, ``decel`` in percent, ``time`` in seconds, and ``wait``.
    By default the controller answers when the motion is over as its pass mark has it; with ``wait=False`` it answers at
    once. Both give the motion, :class:`~orinkit.aio.AsyncMotion`.
    """

    __slots__ = ()

    functions = ObjectFunctions(
        f.robot_release, f.robot_get_attribute, f.robot_get_help, f.robot_get_name,
        f.robot_get_tag, f.robot_put_tag, f.robot_get_id, f.robot_put_id,
        f.robot_get_variable, f.robot_get_variable_names, f.robot_execute,
    )  # fmt: skip

    # --- holding it ---------------------------------------------------------------------------------------------

    def arm(self, keep: bool = False, group: int = 0) -> AsyncArm:
        """Take the arm for as long as a block lasts: ``async with robot.arm(), robot.motor():``.

        At the end of the block a motion that runs is waited for; when an exception ends it, the arm is halted.

        Args:
            keep: keep internal speeds, tool and work; otherwise they are set to 100 %, 0 and 0 (RC8 3.3.2).
            group: number of the arm group, 0 to 31.
        """
        return AsyncArm(self, self._track, group, keep)

    def motor(self) -> AsyncMotor:
        """Switch the motor on for as long as a block lasts; afterwards it is off, whatever it was before.

        At the end of the block a motion that runs is waited for; when an exception ends it, the arm is halted.
        """
        return AsyncMotor(self, self._track)

    def slave_mode(
        self,
        mode: int | None = None,
        pose: str = "J",
        recv: Iterable[Wanted] = ("time", "joints"),
        *,
        limits: Limits | PathLimits | None = None,
        speed: float = 100.0,
        period: float = 0.008,
        queue: int = 100,
        idle: float | None = 5.0,
        on_range: OnRange = "clamp",
        record: str | os.PathLike[str] | None = None,
        mini: int | None = None,
        hand: int | None = None,
        user: tuple[int, bytes] | None = None,
        user_window: tuple[int, int] | None = None,
    ) -> AsyncStream:
        """Move the arm set-point by set-point for as long as a block lasts (RC8 4), with arm and motor taken.

        ::

            async with robot.slave_mode() as stream:
                await stream.run(trajectory)

        Args:
            mode: 0 and 2 have the controller queue three set-points: 2, the default, lets its answers wait until there is
                room, 0 says that there is none; 1 has it keep the newest one only (RC8 4.3). A VE026A has 0, a set-point
                in every cycle, and 1, its default (VE026A 2.2.1).
            pose: ``"J"`` joints, ``"P"`` positions, ``"T"`` homogeneous transformations.
            recv: what comes back with each set-point: ``"joints"``, ``"position"`` or ``"trans"`` (joints can come with
                either), ``"mini"``, ``"hand"`` I/O, ``"current"`` of the motors; the controller's time always.
            limits: within which everything stays; by default those of the arm as the controller names it.
            speed: percent of these limits.
            period: seconds of the controller's cycle.
            queue: most set-points that :meth:`AsyncStream.push` queues.
            idle: seconds without a pushed set-point after which slave mode is left; ``None`` for never.
            on_range: what to do with a live target beyond the arm's range: ``"clamp"`` or ``"refuse"``.
            record: file that every set-point and what came back is written to, ``.csv`` or ``.mcap``.
            mini: mini I/O outputs that go with every set-point.
            hand: hand I/O outputs.
            user: number and bytes of user I/O outputs.
            user_window: number of the first user I/O that comes back, and how many bytes.

        Raises:
            InvalidValue: an option is none.
        """
        from orinkit.client._async.stream import AsyncStream  # most programs need none of this
        from orinkit.client._shared.stream_options import read_options

        dialect = self.client.dialect
        options = read_options(
            dialect, dialect.slave_mode if mode is None else mode, pose, recv, mini=mini, hand=hand, user=user, user_window=user_window, limits=limits, speed=speed,
            period=period, queue=queue, idle=idle, on_range=on_range, record=record,
        )  # fmt: skip
        return AsyncStream(self, options)

    # --- motions ------------------------------------------------------------------------------------------------

    @overload
    async def move(self, interpolation: int, pose: Value, option: str = "") -> None: ...
    @overload
    async def move(self, pose: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]) -> AsyncMotion: ...
    async def move(self, *arguments: Any, **named: Any) -> AsyncMotion | None:
        """Move to a pose, point to point: ``move(J(45, 30, 120, 0, -60, 0), "@E", speed=20)``.

        As CAO has it, where the first argument is a number: ``move(1, "@E P1", "SPEED=20,TIME=1500")``. That form checks
        nothing but bare lists of 6 numbers, and returns nothing.

        Args:
            *arguments: ``pose``: ``P(...)`` (mm, degrees), ``J(...)`` (degrees), ``T(...)``, or a text such as ``"P1"``; then
                ``mark``: the pass mark, ``"@0"`` the command is there (the controller's default), ``"@E"`` the encoders
                are, ``"@P"`` near, ``"@10"`` within 10 mm. Of CAO's form: ``interpolation``, 1 point to point, 2 line, 3
                arc, 4 free curve; ``pose``, any value of CAO with its pass mark, in which ``P(...)``, ``J(...)`` and
                ``T(...)`` go out as their texts; ``option``, a text such as ``"SPEED=20,NEXT"``: SPEED, ACCEL, DECEL in
                percent, TIME in ms.
            **named: the same by name, and the options ``speed``, ``accel``, ``decel`` in percent, ``time`` in seconds,
                ``wait``.

        Returns:
            the motion; it is over unless ``wait=False``, or the arm still passes (``"@P"``, ``"@10"``).

        Raises:
            TypeError: the arguments are of neither form.
            InvalidValue: the pose, the mark or an option cannot be sent.
            NotationError: the mark is a text that is none.
            CallError: the controller refuses, or the motion was stopped.
        """
        common.check_move(arguments, named)
        if common.is_raw("interpolation", arguments, named):
            await self._move_raw(*arguments, **named)
            return None
        return await self._move_to(common.PTP, *arguments, **named)

    async def move_l(self, pose: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]) -> AsyncMotion:
        """Move the tool to a pose along a line."""
        return await self._move_to(common.LINE, pose, mark, **options)

    async def move_c(
        self, via: PoseLike, end: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]
    ) -> AsyncMotion:
        """Move the tool along the arc through one pose to another."""
        way = MotionSegment(common.literal_end(end))
        return await self._interpolate(common.ARC, common.arc_text(via, end, mark), options, way)

    async def move_s(
        self, path: int | Sequence[PoseLike], mark: str | PassMark = "", **options: Unpack[MoveOptions]
    ) -> AsyncMotion:
        """Move the tool along a free curve.

        Args:
            path: number of a path that is stored in the controller (AddPathPoint), or a list of poses.
            mark: pass mark of its end.
            options: of every motion.
        """
        return await self._interpolate(common.CURVE, common.curve_text(path, mark), options, MotionSegment())

    async def approach(
        self,
        pose: PoseLike,
        distance: float,
        mark: str | PassMark = "",
        *,
        line: bool = False,
        **options: Unpack[MoveOptions],
    ) -> AsyncMotion:
        """Move to before a pose, ``distance`` mm back along its tool's Z; point to point, or along a line."""
        comp = common.LINE if line else common.PTP
        return await self._extended("Approach", [comp, pose_text(pose), common.distance_text(distance, mark)], options)

    async def depart(
        self, distance: float, mark: str | PassMark = "", *, line: bool = False, **options: Unpack[MoveOptions]
    ) -> AsyncMotion:
        """Move back ``distance`` mm along the tool's Z; point to point, or along a line."""
        comp = common.LINE if line else common.PTP
        return await self._extended("Depart", [comp, common.distance_text(distance, mark)], options)

    @overload
    async def drive(self, axis: int, value: float, option: str = "") -> None: ...
    @overload
    async def drive(
        self,
        axes: Mapping[int, float],
        mark: str | PassMark = "",
        *,
        absolute: bool = False,
        **options: Unpack[MoveOptions],
    ) -> AsyncMotion: ...
    async def drive(self, *arguments: Any, **named: Any) -> AsyncMotion | None:
        """Move joints by degrees (mm for linear ones), or to them: ``drive({1: 10, 2: -5}, absolute=False)``.

        As CAO has it, one joint, where the first argument is a number: ``drive(1, 10.0, "SPEED=20,TIME=1500")``.

        Args:
            *arguments: ``axes``: for each joint, 1 to 8, by how many degrees or mm, or with ``absolute`` to which; then
                ``mark``: the pass mark, as of :meth:`move`. Of CAO's form: ``axis``, 1 to 8; ``value``, degrees or mm;
                ``option``, a text such as ``"SPEED=20,NEXT"``: SPEED, ACCEL, DECEL in percent, TIME in ms.
            **named: the same by name, ``absolute``, and the options ``speed``, ``accel``, ``decel`` in percent, ``time`` in
                seconds, ``wait``.

        Raises:
            TypeError: the arguments are of neither form.
            InvalidValue: a joint, the mark or an option cannot be sent.
            CallError: the controller refuses, or the motion was stopped.
        """
        common.check_drive(arguments, named)
        if common.is_raw("axis", arguments, named):
            await self._drive_raw(*arguments, **named)
            return None
        return await self._drive(*arguments, **named)

    async def rotate(self, plane: Value, angle: float, pivot: Value, option: str = "") -> None:
        """Rotate by degrees in a plane about a pivot.

        Args:
            plane: ``"XY"``, ``"XYH"``, or a value of CAO; poses in it go out as their texts.
            angle: degrees.
            pivot: ``V(...)``, ``"P1"``, or a value of CAO.
            option: pass mark and options as a text: ``"@E,SPEED=20,NEXT"``.
        """
        places = common.sendable(plane), angle, common.sendable(pivot)
        await self._begin(f.robot_rotate, *places, option, wait=common.waits(option))

    async def go_home(self) -> None:
        """Move to the home pose."""
        await self._begin(f.robot_go_home, wait=True)

    async def chuck(self, option: str = "") -> None:
        """Close the chuck. A virtual RC8 has none and answers E_NOTIMPL; its hand is ``controller.extension("Hand0")``."""
        await self._call(f.robot_chuck, option)

    async def unchuck(self, option: str = "") -> None:
        """Open the chuck. A virtual RC8 has none and answers E_NOTIMPL; its hand is ``controller.extension("Hand0")``."""
        await self._call(f.robot_unchuck, option)

    # --- settings -----------------------------------------------------------------------------------------------

    async def speed(self, axis: int, speed: float) -> None:
        """Set the internal speed, with the arm taken and nothing moving.

        Args:
            axis: -1 all motions, 0 point-to-point ones only.
            speed: percent, above 0, at most 100.
        """
        await self._call(f.robot_speed, axis, speed)

    async def accelerate(self, axis: int, accel: float, decel: float) -> None:
        """Set internal acceleration and deceleration, with the arm taken and nothing moving.

        Args:
            axis: -1 all motions, 0 point-to-point ones only.
            accel: percent, above 0, at most 100; -1 keeps it.
            decel: the same.
        """
        await self._call(f.robot_accelerate, axis, accel, decel)

    async def change(self, name: str) -> None:
        """Change to a tool or work frame: ``"Tool1"``, ``"Work2"``."""
        await self._call(f.robot_change, name)

    async def get_ext_speed(self) -> float:
        """External speed in percent, which holds for every motion (CurExtSpd)."""
        return common.read_number("CurExtSpd", await self._ask("CurExtSpd"))

    async def put_ext_speed(self, percent: float) -> None:
        """Set the external speed in percent; the accelerations become its square by 100.

        It is the controller's and stays after the connection has ended.
        """
        await self._ask("ExtSpeed", [float(percent)])

    async def get_tool(self) -> int:
        """Number of the tool in use, 0 for the flange (CurTool)."""
        return int(common.read_number("CurTool", await self._ask("CurTool")))

    async def put_tool(self, number: int) -> None:
        """Change to a tool."""
        await self.change(f"Tool{number}")

    async def get_work(self) -> int:
        """Number of the work frame in use, 0 for the base (CurWork)."""
        return int(common.read_number("CurWork", await self._ask("CurWork")))

    async def put_work(self, number: int) -> None:
        """Change to a work frame."""
        await self.change(f"Work{number}")

    async def set_tool(self, number: int, frame: PoseLike) -> None:
        """Define a tool, until the controller is switched off: ``set_tool(1, P(0, 0, 100, 0, 0, 0))``, in the flange."""
        await self._ask("SetToolDef", [number, pose_text(frame)])

    async def set_work(self, number: int, frame: PoseLike) -> None:
        """Define a work frame, until the controller is switched off; in the base."""
        await self._ask("SetWorkDef", [number, pose_text(frame)])

    # --- how it is ----------------------------------------------------------------------------------------------

    async def get_figure(self) -> int:
        """Figure of the arm (CurFig); :func:`orinkit.values.poses.describe_figure` says it in words."""
        return int(common.read_number("CurFig", await self._ask("CurFig")))

    async def get_motor_on(self) -> bool:
        """Whether the motor is on (@SERVO_ON)."""
        return bool(await self._read("@SERVO_ON"))

    async def get_moving(self) -> bool:
        """Whether a motion runs, whoever commanded it (@BUSY_STATUS)."""
        return bool(await self._read("@BUSY_STATUS"))

    # --- conversions --------------------------------------------------------------------------------------------

    async def to_joints(self, pose: PoseLike) -> J:
        """Return the joints of a pose of type P or T, in the tool and work frames in use (P2J, T2J).

        Raises:
            CallError: the arm does not reach it.
        """
        return await self._convert(J, "J", pose)

    async def to_position(self, pose: PoseLike) -> P:
        """Return joints, or a homogeneous transformation, as a position (J2P, T2P)."""
        return await self._convert(P, "P", pose)

    async def to_trans(self, pose: PoseLike) -> T:
        """Return joints, or a position, as a homogeneous transformation (J2T, P2T)."""
        return await self._convert(T, "T", pose)

    async def out_of_range(self, pose: PoseLike) -> int:
        """Return whether the arm cannot take a pose (OutRange).

        Returns:
            0 if it can; the sum of 1, 2, 4, ... for axes 1, 2, 3, ... that would be beyond their limits; -1 out of
            reach; -2 at a singular point.
        """
        return int(common.read_number("OutRange", await self._ask("OutRange", pose_text(pose))))

    # --- helpers ------------------------------------------------------------------------------------------------

    async def _move_raw(self, interpolation: int, pose: Value, option: str = "") -> None:
        await self._begin(f.robot_move, interpolation, common.raw_pose(pose), option, wait=common.waits(option))

    async def _drive_raw(self, axis: int, value: float, option: str = "") -> None:
        await self._begin(f.robot_drive, axis, value, option, wait=common.waits(option))

    async def _drive(
        self,
        axes: Mapping[int, float],
        mark: str | PassMark = "",
        *,
        absolute: bool = False,
        **options: Unpack[MoveOptions],
    ) -> AsyncMotion:
        return await self._extended("DriveAEx" if absolute else "DriveEx", [common.axes_text(axes, mark)], options)

    async def _move_to(
        self, interpolation: int, pose: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]
    ) -> AsyncMotion:
        way = MotionSegment(common.literal_end(pose))
        return await self._interpolate(interpolation, pose_text(pose, mark), options, way)

    async def _interpolate(
        self, interpolation: int, pose: str, options: MoveOptions, way: MotionSegment
    ) -> AsyncMotion:
        option, wait = common.option_text(options)
        return await self._begin(f.robot_move, interpolation, pose, option, wait=wait, way=way)

    async def _extended(self, name: str, parameter: list[Any], options: MoveOptions) -> AsyncMotion:
        option, wait = common.option_text(options)
        whole = [*parameter, option] if option else parameter
        return await self._begin(f.robot_execute, name, whole, wait=wait, way=MotionSegment())

    async def _convert(self, kind: type[common.Pose], wanted: str, pose: PoseLike) -> common.Pose:
        command = f"{common.kind_of(pose, wanted)}2{wanted}"
        return common.read_pose(kind, command, await self._ask(command, pose_text(pose)))
