"""``orinkit move``: move a robot to a pose."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

import orinkit
from orinkit.cli._shared.connection import ConnectionOptions, Json, RobotId, Url, robot_option
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli._shared.interrupts import Interrupts
from orinkit.cli._shared.moving import (
    ProgressBar,
    explain_errors,
    follow,
    joint_count,
    reading_progress,
    rounded,
    show_notes,
    without_unused,
)
from orinkit.client._shared.common import MAX_ALIVE, MIN_ALIVE
from orinkit.client._shared.robot import MAX_PERCENT, MoveOptions, option_text
from orinkit.core.i18n import tr
from orinkit.core.validation import check_amount
from orinkit.values.poses import parse_target, to_text

if TYPE_CHECKING:
    from orinkit.cli._shared.motion_record import ControlLogRecorder

_CONNECTION: Final = ConnectionOptions()


def move(
    url: Url,
    pose: Annotated[
        str,
        Parameter(help=tr("Target pose: \"J(45,30,120,0,-60,0)\", \"P(400,0,300,180,0,180,5)\" or P1.")),
    ],
    /,
    *,
    line: Annotated[bool, Parameter(help=tr("Move the tool along a straight line (default: point to point)."))] = False,
    speed: Annotated[
        float | None, Parameter(help=tr("Speed in percent; 100 by default."))
    ] = None,
    mark: Annotated[
        str | None, Parameter(help=tr("Pass mark: @0, @E, @P or @10."))
    ] = None,
    record: Annotated[
        str | None,
        Parameter(help=tr("Record the motion in this CSV file, one row every 8 ms; see orinkit plot.")),
    ] = None,
    no_motor: Annotated[
        bool, Parameter(help=tr("Do not switch the motor on; it must be on already."))
    ] = False,
    alive: Annotated[
        float,
        Parameter(help=tr(
"Seconds without signs of life of this command after which the server stops the arm, 0.3 to 3600, or 0: the option Alive "
"of Service_Start is then omitted, because controllers of other manufacturers may refuse this option.")),
    ] = 1.0,
    robot_id: RobotId = None,
    connection: ConnectionOptions = _CONNECTION,
    json: Json = False,
) -> None:  # fmt: skip
    """Take the arm, switch the motor on if it is off, move, and finally restore the states of the motor and the arm.

    Print the final joint position and pose. Ctrl-C halts the arm; the states are then restored, too.
    """
    from orinkit.cli._shared.motion_record import ControlLogRecorder

    options: MoveOptions = {"wait": False}
    if speed is not None:
        options["speed"] = speed
    if speed is not None:
        check_amount("--speed", speed, MAX_PERCENT)
    option_text(options)  # reports invalid options before anything moves
    _check_alive(alive)
    mark = mark or ""
    parse_target(to_text(pose, mark))
    with (
        show_notes(),
        connection.opened(url, alive or None) as controller,
        controller.robot(option=robot_option(robot_id)) as robot,
        ExitStack() as stack,
    ):
        _require_motions(robot)
        bar = stack.enter_context(ProgressBar())
        recorder = None
        if record is not None:
            recorder = stack.enter_context(ControlLogRecorder(robot, Path(record), reading_progress(bar)))
        with Interrupts() as interrupts, explain_errors(controller, url):
            _move(robot, pose, mark, options, interrupts, bar, recorder, line=line, motor=not no_motor)
        joints, position = without_unused(robot.joints, joint_count(robot)), robot.position
    if json:
        from orinkit.cli._shared.output import print_json

        print_json({"joints": list(joints), "position": list(position), "record": record})
    else:
        print(f"{rounded(joints)}\n{rounded(position)}")


def _check_alive(seconds: float) -> None:
    if seconds and not MIN_ALIVE <= seconds <= MAX_ALIVE:
        raise usage_error(
            tr(
                "--alive must be 0 or {least:g} to {most:g} s, not {value}",
                least=MIN_ALIVE,
                most=MAX_ALIVE,
                value=seconds,
            )
        )


def _require_motions(robot: orinkit.Robot) -> None:
    """Refuse an arm that supports slave mode only, before anything is done."""
    if robot.client.dialect.takes_arm:
        return
    raise CommandError(tr("a VE026A moves in slave mode only. Try: orinkit stream --move"))


def _move(
    robot: orinkit.Robot,
    pose: str,
    mark: str,
    options: MoveOptions,
    interrupts: Interrupts,
    bar: ProgressBar,
    recorder: ControlLogRecorder | None,
    *,
    line: bool,
    motor: bool,
) -> None:
    with ExitStack() as held:
        held.enter_context(robot.arm())
        if motor and not robot.motor_on:
            held.enter_context(robot.motor())
        interrupts.check()
        if recorder is not None:
            recorder.start()
        motion = (robot.move_l if line else robot.move)(pose, mark, **options)
        follow(robot, motion, interrupts, bar)
        if recorder is not None:
            recorder.stop()
