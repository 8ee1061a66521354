"""The trajectory of the page Slave Move: its source, the chosen range of time, and the check before a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from orinkit.arms import ArmModel, model_of_type
from orinkit.cao.dialect import Dialect
from orinkit.client._async.robot import AsyncRobot
from orinkit.client._shared.stream_options import PERIOD, limits_for, read_options
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.rc8.slave_formats import PoseKind
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.trajectory.control_log import ControlLog, LogColumns
from orinkit.streaming.trajectory.csv_file import load_csv
from orinkit.streaming.trajectory.preflight import Violation, find_violations
from orinkit.streaming.trajectory.resample import resample
from orinkit.streaming.trajectory.retime import retime
from orinkit.streaming.trajectory.trajectory import read_trajectory

Points = Sequence[tuple[float, ...]]

_ROBOT_AXES: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class SlaveTrajectory:
    """Set-points with the period of the controller.

    Attributes:
        kind: Pose type of the set-points.
        points: The set-points.
        source: Where they come from, for the user.
        period: Time between two set-points, s.
    """

    kind: PoseKind
    points: Points
    source: str
    period: float = PERIOD

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return (len(self.points) - 1) * self.period

    def part(self, start: float, end: float) -> SlaveTrajectory:
        """Return the set-points from one time to another, s.

        Raises:
            InvalidValue: If fewer than two set-points remain.
        """
        first, last = round(max(start, 0.0) / self.period), round(min(end, self.seconds) / self.period)
        if last <= first:
            raise InvalidValue(tr("the end time must be later than the start time"))
        if first == 0 and last >= len(self.points) - 1:
            return self
        return SlaveTrajectory(self.kind, self.points[first : last + 1], self.source, self.period)

    def retimed(self, limits: Limits | PathLimits) -> SlaveTrajectory:
        """Return the fastest motion on the same path within the limits (TOPP-RA).

        Raises:
            TrajectoryError: If a set-point is out of range, or no such motion was found.
        """
        return SlaveTrajectory(self.kind, retime(self.points, limits, self.period, self.kind), self.source, self.period)

    def violations(self, limits: Limits | PathLimits) -> list[Violation]:
        """Return all limit violations, earliest first."""
        return find_violations(self.points, limits, self.period, self.kind)


@dataclass(frozen=True, slots=True)
class SlaveArm:
    """The connected arm, on which a trajectory depends: its type, its limits, and its joints.

    Attributes:
        type_name: Type of the arm.
        model: Its model; ``None`` if it is not known.
        joints: Its joints, deg.
        speed: Percentage of the limits to use.
        dialect: Dialect of the controller.
    """

    type_name: str
    model: ArmModel | None
    joints: tuple[float, ...]
    dialect: Dialect
    speed: float = 100.0

    def limits(self, kind: PoseKind, mode: int) -> Limits | PathLimits:
        """Return the limits of a stream.

        Raises:
            InvalidValue: If the controller does not support the mode or the pose type.
            StreamError: If the type of the arm is not known.
        """
        options = read_options(
            self.dialect, mode, kind, (), limits=None, speed=self.speed, period=PERIOD, queue=1, idle=None,
            on_range="refuse", record=None,
        )  # fmt: skip
        return limits_for(options, self.type_name)

    def known_model(self) -> ArmModel:
        """Return the model.

        Raises:
            InvalidValue: If the type of the arm is not known.
        """
        if self.model is None:
            raise InvalidValue(tr("the dimensions of a {type} are not known", type=self.type_name[:60]))
        return self.model

    def start(self) -> tuple[float, ...]:
        """Return the joints at which a generated trajectory begins: as many as the arm has."""
        axes = len(self.model.axes) if self.model is not None else _ROBOT_AXES
        return self.joints[:axes]


async def read_arm(robot: AsyncRobot, speed: float = 100.0) -> SlaveArm:
    """Read the type and the joints of the arm from the controller.

    Raises:
        OrinError: If reading fails.
    """
    dialect = robot.client.dialect
    type_name = str(await robot.execute("GetRobotTypeName")) if dialect.slave_formats else dialect.name
    return SlaveArm(type_name, model_of_type(type_name), tuple(await robot.get_joints()), dialect, speed)


def load_trajectory(path: Path, name: str, axes: int = _ROBOT_AXES) -> SlaveTrajectory:
    """Load a trajectory in a format of :mod:`orinkit.streaming.trajectory.csv_file`.

    Args:
        path: Path of the file.
        name: Name of the file, for the user.
        axes: Number of joints of the arm.

    Raises:
        InvalidValue: If the file is not such a trajectory.
    """
    kind, interval, rows = load_csv(path)
    return _trajectory(kind, rows, interval, name, axes)


def trajectory_of_log(log: ControlLog, columns: LogColumns, name: str, axes: int = _ROBOT_AXES) -> SlaveTrajectory:
    """Return the command values of a control log.

    Raises:
        InvalidValue: If a column is missing, or a value is not a number.
    """
    points, interval = log.points(columns)
    return _trajectory("J", points, interval, name, axes)


def _trajectory(kind: PoseKind, rows: Points, interval: float | None, name: str, axes: int) -> SlaveTrajectory:
    if len(rows) < 2:
        raise InvalidValue(tr("a trajectory requires at least two set-points"))
    padded = [(*row, *(0.0,) * (axes - len(row))) for row in rows] if kind == "J" else rows
    points = read_trajectory(padded, kind, axes)
    return SlaveTrajectory(kind, points if interval is None else resample(points, interval, PERIOD, kind), name)
