"""Helpers for commands that move an arm: a progress bar, and details in error messages."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from shlex import quote
from typing import Any, Final, Self

import orinkit
from orinkit.cli._shared.interrupts import Interrupts
from orinkit.client._shared.motion import POLL
from orinkit.core.errors import CallError, OrinError
from orinkit.core.i18n import tr
from orinkit.transport.runner import Deadline, sleep
from orinkit.values.poses import J, P

_JOINTS: Final = 6
_SETTLING: Final = 2.0  # maximum time in s by which the encoders may lag behind the command


def follow(robot: orinkit.Robot, motion: orinkit.Motion, interrupts: Interrupts, bar: ProgressBar) -> None:
    """Show the progress of a motion; return when it has ended and the arm is at standstill.

    Args:
        robot: The robot that moves.
        motion: The motion of this robot.
        interrupts: Signals, which are checked during the motion.
        bar: Bar that shows the progress and the joints.

    Raises:
        KeyboardInterrupt: If a signal has arrived.
        CallError: If the motion was stopped.
    """
    count = joint_count(robot) if bar.seen else _JOINTS
    for fraction in motion:
        interrupts.check()
        if bar.seen:
            bar.show(tr("moving"), fraction, str(rounded(without_unused(robot.joints, count), 1)))
    deadline = Deadline(_SETTLING)
    while not robot.motion_complete(1) and not deadline.passed:
        interrupts.check()
        sleep(POLL)


@contextmanager
def explain_errors(controller: orinkit.Controller, url: str) -> Iterator[None]:
    """Add the error that the controller reports, and how to clear it, to the exception of a failed call."""
    try:
        yield
    except CallError as error:
        try:
            errors = controller.errors()
        except OrinError:  # the details are only a hint
            errors = []
        if errors:
            first = str(errors[-1])
            reported = (
                ""
                if first in error.detail or errors[-1].code == error.code
                else tr("the controller reports {error}", error=first)
            )
            clear = tr("to clear the error: orinkit call {url} Controller_Execute ClearError", url=quote(url))
            error.detail = "; ".join(filter(None, (error.detail, reported, clear)))
        raise


@contextmanager
def show_notes() -> Iterator[None]:
    """Print the notes of an exception to stderr: errors that occurred while arm and motor were released."""
    try:
        yield
    except BaseException as error:
        for note in getattr(error, "__notes__", ()):
            print(" ".join(note.split()), file=sys.stderr)
        raise


class ProgressBar:
    """Progress bars for operations that take a while; nothing is shown if the output is not a terminal.

    Args:
        on_stderr: True to show the bars on stderr instead of stdout.

    Attributes:
        seen: True if the output is a terminal.
    """

    def __init__(self, *, on_stderr: bool = True) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        console = Console(stderr=on_stderr)
        self.seen = console.is_terminal
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[beside]}"),
            console=console,
            disable=not self.seen,
        )
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, what: str, fraction: float, beside: str = "") -> None:
        """Show the progress of an operation.

        Args:
            what: Name of the operation; each has its own bar.
            fraction: Completed fraction, 0 to 1.
            beside: Text next to the bar.
        """
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=1.0, beside="")
        self._progress.update(self._tasks[what], completed=fraction, beside=beside)


def reading_progress(bar: ProgressBar) -> Callable[[int, int], None]:
    """Return a callback that shows how many records of the control log have been read."""
    return lambda count, of: bar.show(tr("reading the record"), count / of)


def joint_count(robot: orinkit.Robot) -> int:
    """Return the number of joints that move the flange: 4 if the arm is a known SCARA, otherwise 6."""
    from orinkit.arms import model_of_type

    if not robot.client.dialect.slave_formats:  # a VE026A does not report its type
        return _JOINTS
    try:
        model = model_of_type(str(robot.execute("GetRobotTypeName")))
    except CallError:
        return _JOINTS
    return model.robot_axes if model is not None else _JOINTS


def without_unused(joints: J, count: int = _JOINTS) -> J:
    """Return the first ``count`` joints if all joints after the sixth are 0, otherwise all of them."""
    return joints if any(joints[_JOINTS:]) else J.of(joints[:count])


def rounded(pose: J | P, digits: int = 3) -> J | P:
    """Return a pose with rounded values, for display."""
    return pose.of(round(value, digits) + 0.0 for value in pose)
