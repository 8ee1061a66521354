"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``robot.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

from orinkit.cao import functions as f
from orinkit.client._shared import robot as common
from orinkit.client._shared.common import ObjectFunctions
from orinkit.client._shared.motion import MotionSegment
from orinkit.client._shared.robot import MoveOptions, pose_text
from orinkit.client._sync.leases import Arm, Motor
from orinkit.client._sync.motion import ArmBase, Motion
from orinkit.transport.links import require_handover
from orinkit.values.poses import J, P, PassMark, PoseLike, T
from orinkit.values.variant import Value

if TYPE_CHECKING:
    from orinkit.client._shared.stream_options import FeedbackField, OnRange
    from orinkit.client._sync.stream import Stream
    from orinkit.streaming.planning.limits import Limits, PathLimits


class Robot(ArmBase):
    """A robot of a controller (RC8 3.3). The client never repeats a motion by itself.

    Motions take a pose (``P(...)``, ``J(...)``, ``T(...)``, or a text such as ``"P1"``), a pass mark (``"@0"``,
    ``"@E"``, ``"@P"``, ``"@10"``) and keyword options: ``speed``, ``accel``, ``decel`` in percent, ``time`` in s, and
    ``wait``. By default, the call returns at the end of the motion, which the pass mark defines; with ``wait=False``,
    the call returns immediately. In both cases, it returns the motion, an :class:`~orinkit.Motion`.
    """

    __slots__ = ()

    functions = ObjectFunctions(
        f.robot_release, f.robot_get_attribute, f.robot_get_help, f.robot_get_name,
        f.robot_get_tag, f.robot_put_tag, f.robot_get_id, f.robot_put_id,
        f.robot_get_variable, f.robot_get_variable_names, f.robot_execute,
    )  # fmt: skip

    # --- arm, motor and slave mode ------------------------------------------------------------------------------

    def arm(self, keep: bool = False, group: int = 0) -> Arm:
        """Take the arm semaphore for the duration of a block: ``with robot.arm(), robot.motor():``.

        At the end of the block, the current motion is completed. If the block raises an exception, the arm is halted.

        Args:
            keep: True to keep the internal speeds, tool and work; otherwise they are set to 100 %, 0 and 0 (RC8 3.3.2).
            group: Number of the arm group, 0 to 31.
        """
        return Arm(self, self._track, group, keep)

    def motor(self) -> Motor:
        """Switch the motor on for the duration of a block; afterwards the motor is off, even if it was on before.

        At the end of the block, the current motion is completed. If the block raises an exception, the arm is halted.
        """
        return Motor(self, self._track)

    def slave_mode(
        self,
        mode: int | None = None,
        pose: str = "J",
        recv: Iterable[FeedbackField] = ("time", "joints"),
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
        user_io_unit: Literal["bits", "bytes"] = "bits",
    ) -> Stream:
        """Stream set-points in slave mode for the duration of a block (RC8 4).

        The arm must be taken, and the motor must be on.

        ::

            with robot.slave_mode() as stream:
                stream.run(trajectory)

        Args:
            mode: Slave mode, 0 to 2 (RC8 4.3). In modes 0 and 2, the controller queues three set-points. If the queue
                is full, mode 2 (the default) delays the reply until there is room; mode 0 returns an error code. In
                mode 1, the controller keeps only the newest set-point. A VE026A supports only mode 0, with a set-point
                in every cycle, and mode 1, its default (VE026A 2.2.1).
            pose: Pose type: ``"J"`` joints, ``"P"`` positions, ``"T"`` homogeneous transformations.
            recv: Feedback for each set-point: ``"joints"``, ``"position"`` or ``"trans"``, ``"mini"`` I/O, ``"hand"``
                I/O, ``"current"`` of the motors. Joints can be combined with either position or trans. The controller's
                time is always included.
            limits: Limits of all motions; by default, those of the arm type that the controller reports.
            speed: Percentage of the limits to use.
            period: Cycle time of the controller in s.
            queue: Maximum number of set-points that :meth:`Stream.push` queues.
            idle: Time in s without a pushed set-point after which slave mode is left; ``None`` for no limit.
            on_range: Handling of a target (:attr:`Stream.target`) beyond the range of an axis: ``"clamp"`` moves
                the axis to the end of its range, ``"refuse"`` raises InvalidValue.
            record: File for recording all set-points and their feedback, ``.csv`` or ``.mcap``.
            mini: Mini I/O outputs to send with every set-point.
            hand: Hand I/O outputs to send with every set-point.
            user: User I/O outputs to send with every set-point: the number of the first output, and the bytes.
            user_window: User I/O in the feedback: the number of the first one, and the number of bytes.
            user_io_unit: Unit in which the size of user I/O is sent; the b-CAP document does not define it. DENSO's ROS
                driver sends bits.

        Raises:
            InvalidValue: If an option is invalid.
            StreamError: If the transport does not support slave mode (HTTP).
        """
        from orinkit.client._shared.stream_options import read_options
        from orinkit.client._sync.stream import Stream  # slow import, not needed by most programs

        require_handover(self.client.profile.name)
        dialect = self.client.dialect
        options = read_options(
            dialect, dialect.slave_mode if mode is None else mode, pose, recv, mini=mini, hand=hand, user=user, user_window=user_window, limits=limits, speed=speed,
            period=period, queue=queue, idle=idle, on_range=on_range, record=record,
            user_io_unit=user_io_unit,
        )  # fmt: skip
        return Stream(self, options)

    # --- motions ------------------------------------------------------------------------------------------------

    @overload
    def move(self, interpolation: int, pose: Value, option: str = "") -> None: ...
    @overload
    def move(self, pose: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]) -> Motion: ...
    @common.document_options
    def move(self, *arguments: Any, **named: Any) -> Motion | None:  # noqa: D417 - named by the overloads
        """Move to a pose, point to point: ``move(J(45, 30, 120, 0, -60, 0), "@E", speed=20)``.

        If the first argument is a number, the call has the form of CAO, ``move(interpolation, pose, option)``, for
        example ``move(1, "@E P1", "SPEED=20,TIME=1500")``. This form rejects bare lists of 6 numbers and checks nothing
        else. ``interpolation`` is 1 (point to point), 2 (line), 3 (arc) or 4 (free curve). ``pose`` is any value of
        CAO, with its pass mark; ``P(...)``, ``J(...)`` and ``T(...)`` in it are sent as text. ``option`` is an option
        string such as ``"SPEED=20,NEXT"``: SPEED, ACCEL and DECEL in percent, TIME in ms.

        Args:
            pose: ``P(...)`` (mm, deg), ``J(...)`` (deg), ``T(...)``, or a text such as ``"P1"``.
            mark: Pass mark, which defines the end of the motion: ``"@0"`` (the controller's default) when the command
                position is at the pose, ``"@E"`` when the encoders are at the pose, ``"@P"`` near the pose, ``"@10"``
                within 10 mm of the pose.
            options: ``speed``, ``accel`` and ``decel`` in percent, ``time`` in s, and ``wait``, see
                :class:`MoveOptions`.

        Returns:
            The motion; ``None`` in the form of CAO. The motion is over, unless ``wait`` is False, or the pass mark
            (``"@P"``, ``"@10"``) allows the call to return while the arm still moves.

        Raises:
            TypeError: If the arguments match neither form.
            InvalidValue: If the pose, the mark or an option is invalid.
            NotationError: If the mark is not a pass mark.
            CallError: If the controller refuses, or the motion was stopped.
        """
        common.check_move(arguments, named)
        if common.is_raw("interpolation", arguments, named):
            self._move_raw(*arguments, **named)
            return None
        return self._move_to(common.PTP, *arguments, **named)

    @common.document_options
    def move_l(self, pose: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]) -> Motion:
        """Move the tool to a pose in a straight line."""
        return self._move_to(common.LINE, pose, mark, **options)

    @common.document_options
    def move_c(self, via: PoseLike, end: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]) -> Motion:
        """Move the tool along an arc from its current position through ``via`` to ``end``."""
        segment = MotionSegment(common.literal_end(end))
        return self._interpolate(common.ARC, common.arc_text(via, end, mark), options, segment)

    @common.document_options
    def move_s(
        self, path: int | Sequence[PoseLike], mark: str | PassMark = "", **options: Unpack[MoveOptions]
    ) -> Motion:
        """Move the tool along a free curve.

        Args:
            path: Number of a path stored on the controller (AddPathPoint), or a list of poses.
            mark: Pass mark at the end of the curve.
            options: The options of :meth:`move`.
        """
        return self._interpolate(common.CURVE, common.curve_text(path, mark), options, MotionSegment())

    @common.document_options
    def approach(
        self,
        pose: PoseLike,
        distance: float,
        mark: str | PassMark = "",
        *,
        line: bool = False,
        **options: Unpack[MoveOptions],
    ) -> Motion:
        """Move to the point that is ``distance`` mm away from a pose, in the -Z direction of the tool at that pose.

        The motion is point to point; with ``line``, the tool moves in a straight line.
        """
        comp = common.LINE if line else common.PTP
        return self._extended("Approach", [comp, pose_text(pose), common.distance_text(distance, mark)], options)

    @common.document_options
    def depart(
        self, distance: float, mark: str | PassMark = "", *, line: bool = False, **options: Unpack[MoveOptions]
    ) -> Motion:
        """Move back ``distance`` mm against the tool's Z axis.

        The motion is point to point; with ``line``, the tool moves in a straight line.
        """
        comp = common.LINE if line else common.PTP
        return self._extended("Depart", [comp, common.distance_text(distance, mark)], options)

    @overload
    def drive(self, axis: int, value: float, option: str = "") -> None: ...
    @overload
    def drive(
        self,
        axes: Mapping[int, float],
        mark: str | PassMark = "",
        *,
        absolute: bool = False,
        **options: Unpack[MoveOptions],
    ) -> Motion: ...
    @common.document_options
    def drive(self, *arguments: Any, **named: Any) -> Motion | None:  # noqa: D417 - named by the overloads
        """Move axes by relative values: ``drive({1: 10, 2: -5})``. With ``absolute``, move them to absolute values.

        If the first argument is a number, the call has the form of CAO, ``drive(axis, value, option)``, which moves one
        axis by a relative value: ``drive(1, 10.0, "SPEED=20,TIME=1500")``. ``axis`` is 1 to 8, ``value`` is in deg (mm
        for a linear axis), and ``option`` is an option string, as for :meth:`move`.

        Args:
            axes: Mapping from axes, 1 to 8, to values in deg (mm for linear axes).
            mark: Pass mark, as for :meth:`move`.
            absolute: True if the values are absolute; by default they are relative to the current position.
            options: The options of :meth:`move`.

        Returns:
            The motion, as for :meth:`move`; ``None`` in the form of CAO.

        Raises:
            TypeError: If the arguments match neither form.
            InvalidValue: If an axis, a value, the mark or an option is invalid.
            CallError: If the controller refuses, or the motion was stopped.
        """
        common.check_drive(arguments, named)
        if common.is_raw("axis", arguments, named):
            self._drive_raw(*arguments, **named)
            return None
        return self._drive(*arguments, **named)

    def rotate(self, plane: Value, angle: float, pivot: Value, option: str = "") -> None:
        """Rotate the tool in a plane around a pivot.

        Args:
            plane: ``"XY"``, ``"XYH"``, or a value of CAO; poses in this value are sent as text.
            angle: Angle in deg.
            pivot: ``V(...)``, ``"P1"``, or a value of CAO.
            option: Pass mark and options as text: ``"@E,SPEED=20,NEXT"``.
        """
        arguments = common.sendable(plane), angle, common.sendable(pivot)
        self._begin(f.robot_rotate, *arguments, option, wait=common.waits(option))

    def go_home(self) -> None:
        """Move to the home pose."""
        self._begin(f.robot_go_home, wait=True)

    def chuck(self, option: str = "") -> None:
        """Close the chuck.

        A virtual RC8 has no chuck and returns E_NOTIMPL; its hand is ``controller.extension("Hand0")``.
        """
        self._call(f.robot_chuck, option)

    def unchuck(self, option: str = "") -> None:
        """Open the chuck.

        A virtual RC8 has no chuck and returns E_NOTIMPL; its hand is ``controller.extension("Hand0")``.
        """
        self._call(f.robot_unchuck, option)

    # --- settings -----------------------------------------------------------------------------------------------

    def speed(self, axis: int, speed: float) -> None:
        """Set the internal speed. The arm must be taken and at standstill.

        Args:
            axis: -1 for all motions, 0 for point-to-point motions only.
            speed: Speed in percent, above 0 and at most 100.
        """
        self._call(f.robot_speed, axis, speed)

    def accelerate(self, axis: int, accel: float, decel: float = -1.0) -> None:
        """Set the internal acceleration and deceleration. The arm must be taken and at standstill.

        Args:
            axis: -1 for all motions, 0 for point-to-point motions only.
            accel: Acceleration in percent, above 0 and at most 100; -1 leaves it unchanged.
            decel: Deceleration in percent, above 0 and at most 100; -1 leaves it unchanged.
        """
        self._call(f.robot_accelerate, axis, accel, decel)

    def change(self, name: str) -> None:
        """Change to a tool or work frame: ``"Tool1"``, ``"Work2"``."""
        self._call(f.robot_change, name)

    def get_ext_speed(self) -> float:
        """Return the external speed in percent, which applies to all motions (CurExtSpd)."""
        return common.read_number("CurExtSpd", self._ask("CurExtSpd"))

    def put_ext_speed(self, percent: float) -> None:
        """Set the external speed in percent, and the external acceleration and deceleration to speed * speed / 100.

        These are settings of the controller, which remain after the connection is closed.
        """
        self._ask("ExtSpeed", [float(percent)])

    def get_tool(self) -> int:
        """Return the number of the current tool, 0 for the flange (CurTool)."""
        return int(common.read_number("CurTool", self._ask("CurTool")))

    def put_tool(self, number: int) -> None:
        """Change to a tool."""
        self.change(f"Tool{number}")

    def get_work(self) -> int:
        """Return the number of the current work frame, 0 for the base (CurWork)."""
        return int(common.read_number("CurWork", self._ask("CurWork")))

    def put_work(self, number: int) -> None:
        """Change to a work frame."""
        self.change(f"Work{number}")

    def set_tool(self, number: int, frame: PoseLike) -> None:
        """Define a tool relative to the flange: ``set_tool(1, P(0, 0, 100, 0, 0, 0))``.

        The definition is lost when the controller is switched off.
        """
        self._ask("SetToolDef", [number, pose_text(frame)])

    def set_work(self, number: int, frame: PoseLike) -> None:
        """Define a work frame relative to the base. The definition is lost when the controller is switched off."""
        self._ask("SetWorkDef", [number, pose_text(frame)])

    # --- state --------------------------------------------------------------------------------------------------

    def get_figure(self) -> int:
        """Return the figure of the arm (CurFig); :func:`orinkit.values.poses.describe_figure` describes it as text."""
        return int(common.read_number("CurFig", self._ask("CurFig")))

    def get_motor_on(self) -> bool:
        """Return True if the motor is on (@SERVO_ON)."""
        return bool(self._read("@SERVO_ON"))

    def get_moving(self) -> bool:
        """Return True if a motion of any client or program is executing (@BUSY_STATUS)."""
        return bool(self._read("@BUSY_STATUS"))

    # --- conversions --------------------------------------------------------------------------------------------

    def to_joints(self, pose: PoseLike) -> J:
        """Return the joints of a pose of type P or T, in the current tool and work frames (P2J, T2J).

        Raises:
            CallError: If the arm cannot reach the pose.
        """
        return self._convert(J, "J", pose)

    def to_position(self, pose: PoseLike) -> P:
        """Convert joints or a homogeneous transformation to a position (J2P, T2P)."""
        return self._convert(P, "P", pose)

    def to_trans(self, pose: PoseLike) -> T:
        """Convert joints or a position to a homogeneous transformation (J2T, P2T)."""
        return self._convert(T, "T", pose)

    def out_of_range(self, pose: PoseLike) -> int:
        """Check if the arm can reach a pose (OutRange). The arm does not move.

        Returns:
            0 if the pose is reachable; the sum of 1, 2, 4, ... for axes 1, 2, 3, ... beyond their soft limits; -1 if
            the pose is out of reach; -2 if it is a singular point.
        """
        return int(common.read_number("OutRange", self._ask("OutRange", pose_text(pose))))

    # --- helpers ------------------------------------------------------------------------------------------------

    def _move_raw(self, interpolation: int, pose: Value, option: str = "") -> None:
        self._begin(f.robot_move, interpolation, common.raw_pose(pose), option, wait=common.waits(option))

    def _drive_raw(self, axis: int, value: float, option: str = "") -> None:
        self._begin(f.robot_drive, axis, value, option, wait=common.waits(option))

    def _drive(
        # Also in client._sync.robot: the overload of drive repeats its signature.
        self,
        axes: Mapping[int, float],
        mark: str | PassMark = "",
        *,
        absolute: bool = False,
        **options: Unpack[MoveOptions],
    ) -> Motion:
        return self._extended("DriveAEx" if absolute else "DriveEx", [common.axes_text(axes, mark)], options)

    def _move_to(
        self, interpolation: int, pose: PoseLike, mark: str | PassMark = "", **options: Unpack[MoveOptions]
    ) -> Motion:
        segment = MotionSegment(common.literal_end(pose))
        return self._interpolate(interpolation, pose_text(pose, mark), options, segment)

    def _interpolate(self, interpolation: int, pose: str, options: MoveOptions, segment: MotionSegment) -> Motion:
        option, wait = common.option_text(options)
        return self._begin(f.robot_move, interpolation, pose, option, wait=wait, segment=segment)

    def _extended(self, name: str, parameter: list[Any], options: MoveOptions) -> Motion:
        option, wait = common.option_text(options)
        whole = [*parameter, option] if option else parameter
        return self._begin(f.robot_execute, name, whole, wait=wait, segment=MotionSegment())

    def _convert(self, pose_type: type[common.Pose], wanted: str, pose: PoseLike) -> common.Pose:
        command = f"{common.kind_of(pose, wanted)}2{wanted}"
        return common.read_pose(pose_type, command, self._ask(command, pose_text(pose)))

    @property
    def ext_speed(self) -> float:
        """Return the external speed in percent, which applies to all motions (CurExtSpd)."""
        return self.get_ext_speed()

    @ext_speed.setter
    def ext_speed(self, new: float) -> None:
        self.put_ext_speed(new)

    @property
    def tool(self) -> int:
        """Return the number of the current tool, 0 for the flange (CurTool)."""
        return self.get_tool()

    @tool.setter
    def tool(self, new: int) -> None:
        self.put_tool(new)

    @property
    def work(self) -> int:
        """Return the number of the current work frame, 0 for the base (CurWork)."""
        return self.get_work()

    @work.setter
    def work(self, new: int) -> None:
        self.put_work(new)

    @property
    def figure(self) -> int:
        """Return the figure of the arm (CurFig); :func:`orinkit.values.poses.describe_figure` describes it as text."""
        return self.get_figure()

    @property
    def motor_on(self) -> bool:
        """Return True if the motor is on (@SERVO_ON)."""
        return self.get_motor_on()

    @property
    def moving(self) -> bool:
        """Return True if a motion of any client or program is executing (@BUSY_STATUS)."""
        return self.get_moving()
