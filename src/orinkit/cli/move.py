"""``orinkit move``: move a robot to a pose."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, Final, Self

from cyclopts import Parameter

import orinkit
from orinkit.cli._connection import Connection, Json, Url
from orinkit.client._motion_common import POLL
from orinkit.client._robot_common import MoveOptions, option_text
from orinkit.errors import CallError, OrinError
from orinkit.language import pick
from orinkit.poses import J, P, parse_target, to_text
from orinkit.transport.drive import Deadline, pause

if TYPE_CHECKING:
    from orinkit.cli._motion_record import Recorder

_CONNECTION: Final = Connection()
_SETTLING: Final = 2.0  # s that the encoders may be behind the command


def move(
    url: Url,
    pose: Annotated[
        str,
        Parameter(help=pick('Where to: "J(45,30,120,0,-60,0)", "P(400,0,300,180,0,180,5)", P1.',
                            '移動先: "J(45,30,120,0,-60,0)", "P(400,0,300,180,0,180,5)", P1。')),
    ],
    /,
    *,
    line: Annotated[bool, Parameter(help=pick("Move the tool along a line.", "直線補間で動作する。"))] = False,
    speed: Annotated[
        float | None, Parameter(help=pick("Speed in percent; 100 by default.", "速度 (%)。既定は 100。"))
    ] = None,
    mark: Annotated[
        str | None, Parameter(help=pick("Pass mark: @0, @E, @P or @10.", "パス指定: @0, @E, @P, @10。"))
    ] = None,
    record: Annotated[
        str | None,
        Parameter(help=pick("Record the motion in this CSV file, a row for each 8 ms; see orinkit plot.",
                            "動作を 8 ms 周期でこの CSV ファイルに記録する (orinkit plot で表示)。")),
    ] = None,
    no_motor: Annotated[
        bool, Parameter(help=pick("Do not switch the motor on; it has to be.", "モータを ON にしない (ON である必要あり)。"))
    ] = False,
    connection: Connection = _CONNECTION,
    json: Json = False,
) -> None:  # fmt: skip
    """Take the arm, switch the motor on if it is off, move, and give everything back.

    Ctrl-C halts the arm, then gives everything back as well. Prints where the arm is at the end.
    """
    from orinkit.cli._motion_record import Recorder

    options: MoveOptions = {"wait": False}
    if speed is not None:
        options["speed"] = speed
    option_text(options)  # what cannot be is said before anything moves
    mark = mark or ""
    parse_target(to_text(pose, mark))
    with _notes_shown(), connection.open(url) as controller, controller.robot() as robot, ExitStack() as stack:
        bar = stack.enter_context(_Bar(robot))
        recorder = None
        if record is not None:
            recorder = stack.enter_context(Recorder(robot, Path(record), bar.reading))
        with _Interrupts() as interrupts, _errors_told(controller, url):
            _move(robot, pose, mark, options, interrupts, bar, recorder, line=line, motor=not no_motor)
        joints, position = _shown(robot.joints), robot.position
    if json:
        from orinkit.cli._output import print_json

        print_json({"joints": list(joints), "position": list(position), "record": record})
    else:
        print(f"{_rounded(joints)}\n{_rounded(position)}")


def _move(
    robot: orinkit.Robot,
    pose: str,
    mark: str,
    options: MoveOptions,
    interrupts: _Interrupts,
    bar: _Bar,
    recorder: Recorder | None,
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
        for fraction in motion:
            interrupts.check()
            bar.moved(fraction)
        deadline = Deadline(_SETTLING)
        while not robot.motion_complete(1) and not deadline.passed:
            interrupts.check()
            pause(POLL)
        if recorder is not None:
            recorder.stop()


@contextmanager
def _errors_told(controller: orinkit.Controller, url: str) -> Iterator[None]:
    """Say in an error which one the controller reports, and how it is cleared."""
    try:
        yield
    except CallError as error:
        try:
            errors = controller.errors()
        except OrinError:  # it is only a hint
            errors = []
        if errors:
            first = str(errors[-1])
            told = (
                ""
                if first in error.detail
                else pick(f"the controller reports {first}", f"コントローラのエラー: {first}")
            )
            clear = pick(
                f"to clear it: orinkit call {url} Controller_Execute ClearError",
                f"エラー解除: orinkit call {url} Controller_Execute ClearError",
            )
            error.detail = "; ".join(filter(None, (error.detail, told, clear)))
        raise


@contextmanager
def _notes_shown() -> Iterator[None]:
    """Show what else went wrong while everything was given back."""
    try:
        yield
    except BaseException as error:
        for note in getattr(error, "__notes__", ()):
            print(" ".join(note.split()), file=sys.stderr)
        raise


class _Interrupts:
    """Ctrl-C is noted instead of breaking off a call, which would cost the connection; the second one is as ever."""

    def __init__(self) -> None:
        self._noted = False

    def __enter__(self) -> Self:
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def check(self) -> None:
        """Raise KeyboardInterrupt if there was one."""
        if self._noted:
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal wants it
        if self._noted:
            raise KeyboardInterrupt
        self._noted = True


class _Bar:
    """A bar on stderr with the joints as they are; nothing where nobody sees it."""

    def __init__(self, robot: orinkit.Robot) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        console = Console(stderr=True)
        self._robot = robot
        self._seen = console.is_terminal
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[joints]}"),
            console=console,
            disable=not self._seen,
        )
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def moved(self, fraction: float) -> None:
        """Show how far the motion is."""
        if self._seen:
            self._show(pick("moving", "動作中"), fraction, str(_rounded(_shown(self._robot.joints), 1)))

    def reading(self, count: int, of: int) -> None:
        """Show how much of the record has been read."""
        if self._seen:
            self._show(pick("reading the record", "記録の読み出し"), count / of, "")

    def _show(self, what: str, fraction: float, joints: str) -> None:
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=1.0, joints="")
        self._progress.update(self._tasks[what], completed=fraction, joints=joints)


def _shown(joints: J) -> J:
    """Leave out joints 7 and 8 where there are none."""
    return joints if any(joints[6:]) else J.of(joints[:6])


def _rounded(pose: J | P, digits: int = 3) -> J | P:
    return pose.of(round(value, digits) + 0.0 for value in pose)
