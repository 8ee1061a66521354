"""``orinkit stream``: execute a trajectory in slave mode, set-point by set-point."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

from cyclopts import Parameter

import orinkit
from orinkit.cli._shared.connection import ConnectionOptions, Json, RobotId, SlaveModeUrl, robot_option
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.cli._shared.interrupts import Interrupts
from orinkit.cli._shared.moving import ProgressBar, explain_errors, follow, rounded, show_notes, without_unused
from orinkit.client._shared.connection_string import url_of
from orinkit.client._shared.motion import POLL
from orinkit.core.errors import StreamError
from orinkit.core.i18n import tr
from orinkit.core.validation import check_range
from orinkit.transport.address import parse_address
from orinkit.transport.links import no_slave_mode
from orinkit.transport.registry import row_of
from orinkit.transport.runner import sleep

if TYPE_CHECKING:
    from collections.abc import Callable

    from orinkit import Progress
    from orinkit.cao.dialect import Dialect
    from orinkit.cli._shared.stream_report import StreamReport
    from orinkit.client._shared.stream_options import FeedbackField, StreamOptions
    from orinkit.client._sync.stream import Stream
    from orinkit.rc8.slave_formats import PoseKind
    from orinkit.streaming.planning.limits import Limits, PathLimits
    from orinkit.values.poses import J, P, T

Points: TypeAlias = "list[tuple[float, ...]]"

_CONNECTION: Final = ConnectionOptions()
_SUFFIXES: Final = (".csv", ".mcap")
_RECEIVED: Final[dict[str, tuple[FeedbackField, ...]]] = {
    "J": ("time", "joints"),
    "P": ("time", "position", "joints"),
    "T": ("time", "trans", "joints"),
}
_ROBOT_AXES: Final = 6
_ARRIVED: Final = 1e-3  # deg or mm
_UPDATE_EVERY: Final = 12  # set-points between two updates of the bar, about 0.1 s


def stream(
    url: SlaveModeUrl,
    trajectory: Annotated[
        str,
        Parameter(help=tr("CSV file with a set-point for every 8 ms, or with a time column.")),
    ],
    /,
    *,
    mode: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=tr(
"Slave mode: in modes 0 and 2 the controller queues set-points, in mode 1 it uses the newest one. The default is "
"2. A VE026A supports 0 and 1; its default is 1."),
        ),
    ] = None,
    pose: Annotated[
        str | None,
        Parameter(help=tr(
"Pose type of the set-points: J joints, P positions, T transformations; by default "
"determined from the file.")),
    ] = None,
    record: Annotated[
        str | None,
        Parameter(help=tr("Record set-points and feedback in this file, .csv or .mcap; see orinkit plot.")),
    ] = None,
    retime: Annotated[
        bool,
        Parameter(help=tr("Slow down the parts that exceed the limits.")),
    ] = False,
    speed: Annotated[
        float, Parameter(help=tr("Limits to apply, in percent of those of the arm."))
    ] = 100.0,
    model: Annotated[
        str | None,
        Parameter(help=tr("Model of the arm whose limits apply, or a TOML file; by default the model that the controller "
            "reports.")),
    ] = None,
    move: Annotated[
        bool,
        Parameter(help=tr("Before the trajectory, move to its first set-point: by a PTP motion, or in slave mode if the robot "
            "is a VE026A.")),
    ] = False,
    no_motor: Annotated[
        bool, Parameter(help=tr("Do not switch the motor on; it must be on already."))
    ] = False,
    robot_id: RobotId = None,
    connection: ConnectionOptions = _CONNECTION,
    json: Json = False,
) -> None:  # fmt: skip
    """Take the arm, check the trajectory, switch the motor on, stream the trajectory, and print a report.

    Nothing moves before the whole trajectory has been checked. Ctrl-C or SIGTERM stops the arm within its limits.
    """
    _check_transport(url)
    job = _job(
        connection.known_dialect(url), trajectory, mode, pose, record, speed, model,
        retime=retime, move=move, motor=not no_motor,
    )  # fmt: skip
    option = robot_option(robot_id)
    with (
        show_notes(),
        connection.open(url) as controller,
        controller.robot(option=option) as robot,
        ProgressBar() as bar,
    ):
        job.options = job.read(robot.client.dialect)
        try:
            with Interrupts() as interrupts, explain_errors(controller, url):
                report = _carry_out(robot, job, interrupts, bar)
        except KeyboardInterrupt as interrupt:
            if interrupt is job.interrupt:
                raise _interrupted(job) from None
            raise
        except StreamError as error:
            raise _ended(error) from None
    if json:
        from orinkit.cli._shared.output import print_json

        print_json(report.document())
    else:
        print("\n".join(report.lines()))


@dataclass(slots=True)
class _StreamRequest:
    """The stream that the command line requests.

    Attributes:
        path: File of the trajectory.
        pose_type: Pose type of the set-points of the trajectory.
        read: Function that returns the options of slave mode for a dialect.
        options: The options that ``read`` has returned.
        speed: Limits to apply, in percent of the limits of the arm.
        retime: True to retime the trajectory.
        move: True to move to the first set-point before the trajectory begins.
        motor: True to switch the motor on.
        progress: Progress of the stream; ``None`` before the stream begins.
        interrupt: The KeyboardInterrupt that ended the stream; ``None`` if there was none.
    """

    path: Path
    pose_type: PoseKind
    read: Callable[[Dialect], StreamOptions]
    options: StreamOptions
    speed: float
    retime: bool
    move: bool
    motor: bool
    progress: Progress | None = field(default=None)
    interrupt: KeyboardInterrupt | None = field(default=None)


def _job(
    dialect: Dialect, trajectory: str, mode: int | None, pose: str | None, record: str | None, speed: float,
    model: str | None, *, retime: bool, move: bool, motor: bool,
) -> _StreamRequest:  # fmt: skip
    """Return the request; errors of the command line are reported before connecting."""
    from orinkit.client._shared.stream_options import MAX_SPEED, MIN_SPEED, PERIOD, read_options
    from orinkit.streaming.trajectory.csv_file import load_csv

    path = Path(trajectory)
    pose_type: PoseKind = load_csv(path)[0] if pose is None else _pose_type(pose)
    if record is not None:
        _check_record(Path(record))
    check_range("--speed", speed, MIN_SPEED, MAX_SPEED)
    limits = None if model is None else _limits_of(model, pose_type)

    def read(dialect: Dialect) -> StreamOptions:
        return read_options(
            dialect, dialect.slave_mode if mode is None else mode, pose_type, _RECEIVED[pose_type],
            limits=limits, speed=speed, period=PERIOD, queue=100, idle=None, on_range="clamp", record=record,
        )  # fmt: skip

    return _StreamRequest(path, pose_type, read, read(dialect), speed, retime, move, motor)


def _check_transport(url: str) -> None:
    """Refuse an address over which slave mode is not available, before anything moves."""
    address = parse_address(url_of(url))
    if not row_of(address).adopt:
        raise usage_error(no_slave_mode(address.scheme, str(address)))


def _pose_type(pose: str) -> PoseKind:
    match pose.upper():
        case "J":
            return "J"
        case "P":
            return "P"
        case "T":
            return "T"
    raise usage_error(tr("--pose {pose}: must be J, P or T", pose=pose))


def _check_record(path: Path) -> None:
    from orinkit.cli._shared.motion_record import check_directory

    if path.suffix.lower() not in _SUFFIXES:
        first, second = _SUFFIXES
        raise usage_error(
            tr(
                "{path}: the name of a recording must end in {first} or {second}", path=path, first=first, second=second
            ),
        )
    check_directory(path)


def _limits_of(model: str, pose_type: PoseKind) -> Limits | PathLimits:
    from orinkit.arms import load_model
    from orinkit.streaming.planning.limits import Limits, PathLimits

    try:
        found = load_model(model)
    except ValueError as error:
        raise CommandError(str(error), 2) from None
    return Limits.of_model(found) if pose_type == "J" else PathLimits.of_model(found)


# --- with a controller ------------------------------------------------------------------------------------------------


def _carry_out(robot: orinkit.Robot, job: _StreamRequest, interrupts: Interrupts, bar: ProgressBar) -> StreamReport:
    from orinkit.client._shared.stream import POSE_TYPES

    with ExitStack() as held:
        held.enter_context(robot.arm())
        limits, points = _prepared(robot, job)
        interrupts.check()
        if job.motor and not robot.motor_on:
            held.enter_context(robot.motor())
        interrupts.check()
        lead = job.move and not robot.client.dialect.takes_arm
        first = POSE_TYPES[job.pose_type].of(points[0])
        if job.move and not lead:
            follow(robot, robot.move(first, "@E", speed=job.speed, wait=False), interrupts, bar)
        mode = robot.slave_mode(
            job.options.mode.buffering, job.pose_type, _RECEIVED[job.pose_type], limits=limits, idle=None,
            record=job.options.record,
        )  # fmt: skip
        with mode as entered:
            try:
                if lead:
                    _move_to_first(entered, first, interrupts, bar)
                return _streamed(entered, points, job, interrupts, bar)
            except KeyboardInterrupt as interrupt:
                job.interrupt = interrupt
                raise


def _prepared(robot: orinkit.Robot, job: _StreamRequest) -> tuple[Limits | PathLimits, Points]:
    """Return the limits, and the set-points after checking that they are within these limits.

    Raises:
        TrajectoryError: If a set-point exceeds a limit, or if the arm is not at the first set-point and will not be
            moved there.
    """
    from orinkit.client._shared.stream_options import limits_for
    from orinkit.streaming.planning.limits import Limits
    from orinkit.streaming.trajectory.limit_violations import TrajectoryError
    from orinkit.streaming.trajectory.retime import retime
    from orinkit.streaming.trajectory.trajectory import read_trajectory

    options, period = job.options, job.options.period
    if options.limits is not None:
        type_name = ""
    else:
        dialect = robot.client.dialect
        type_name = robot.execute("GetRobotTypeName") if dialect.slave_formats else dialect.name
    limits = limits_for(options, type_name)
    axes = len(limits.lower) if isinstance(limits, Limits) else _ROBOT_AXES
    points = read_trajectory(job.path, job.pose_type, axes, period=period)
    if job.retime:
        points = retime(points, limits, period, job.pose_type)
    _check(points, limits, None, job)
    if not job.move:
        where = {"J": orinkit.Robot.get_joints, "P": orinkit.Robot.get_position, "T": orinkit.Robot.get_trans}[
            job.pose_type
        ]
        try:
            _check(points, limits, tuple(where(robot)), job)
        except TrajectoryError as error:
            text = tr("{error}; the option --move does this", error=error)
            raise TrajectoryError(text, error.sample, error.axis) from None
    return limits, points


def _check(points: Points, limits: Limits | PathLimits, start: tuple[float, ...] | None, job: _StreamRequest) -> None:
    from orinkit.streaming.planning.limits import PathLimits
    from orinkit.streaming.trajectory.trajectory import check_path, check_trajectory

    if isinstance(limits, PathLimits):
        check_path(points, limits, start, job.options.period, job.pose_type)
    else:
        check_trajectory(points, limits, start, job.options.period)


def _move_to_first(entered: Stream, first: J | P | T, interrupts: Interrupts, bar: ProgressBar) -> None:
    """Move to the first set-point in slave mode, within the limits of the stream, if the arm has no other motions."""
    entered.target = first
    whole = _distance(entered, first)
    while (left := _distance(entered, first)) > _ARRIVED or not entered.at_rest:
        interrupts.check()
        if bar.seen:
            bar.show(tr("moving"), max(0.0, 1.0 - left / whole) if whole else 1.0, joints_text(entered))
        sleep(POLL)
    entered.wait()


def _distance(entered: Stream, goal: J | P | T) -> float:
    """Return the largest difference between a value of the last set-point of a stream and the same value of a pose."""
    return max(abs(a - b) for a, b in zip(entered.latest.command, goal, strict=False))


def _streamed(
    entered: Stream, points: Points, job: _StreamRequest, interrupts: Interrupts, bar: ProgressBar
) -> StreamReport:
    from orinkit import Progress
    from orinkit.cli._shared.stream_report import StreamReport
    from orinkit.cli._shared.stream_trace import trace_of

    display = StreamDisplay(entered, bar)

    job.progress = Progress(0, len(points))

    def on_progress(progress: Progress) -> None:
        job.progress = progress
        interrupts.check()
        display(progress)

    interrupts.check()
    result = entered.run(points, progress=on_progress)
    record = None if job.options.record is None else str(job.options.record)
    return StreamReport(result, entered.real_time, trace_of(result.samples, job.pose_type, job.options.period), record)


class StreamDisplay:
    """Shows the progress of a stream and its latest feedback in a bar.

    Args:
        entered: The stream.
        bar: The progress bar.
    """

    def __init__(self, entered: Stream, bar: ProgressBar) -> None:
        self._entered = entered
        self._bar = bar
        self._next = 0

    def __call__(self, progress: Progress) -> None:
        """Update the bar."""
        sent, total = progress
        if self._bar.seen and total and (sent >= self._next or sent == total):
            self._next = sent + _UPDATE_EVERY
            self._bar.show(tr("streaming"), sent / total, f"{sent}/{total}  {joints_text(self._entered)}")


def joints_text(entered: Stream) -> str:
    """Return the current joint position as text; ``""`` if the feedback does not contain it."""
    from orinkit.streaming.planning.limits import Limits

    joints, limits = entered.latest.joints, entered.limits
    count = min(_ROBOT_AXES, len(limits.lower)) if isinstance(limits, Limits) else _ROBOT_AXES
    return "" if joints is None else str(rounded(without_unused(joints, count), 1))


def _interrupted(job: _StreamRequest) -> CommandError:
    from orinkit.cli.app import INTERRUPTED

    sent, total = job.progress or (0, 0)
    return CommandError(
        tr(
            "interrupted after {sent} of {total} set-points: the arm was stopped, slave mode is off",
            sent=sent,
            total=total,
        ),
        INTERRUPTED,
    )


def _ended(error: StreamError) -> Exception:
    """Return the exception for a stream that has ended; its remedy is an option of the command."""
    if error.reason != "stopped":
        return error
    return CommandError(
        tr(
            "this program was stopped (SIGSTOP), so the arm was stopped and slave mode was ended. Try: run the command "
            "again, with --move"
        )
    )
