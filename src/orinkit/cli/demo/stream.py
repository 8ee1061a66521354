"""Stream set-points in the demo: through the client API, over the connection of the demo, with every reply checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from time import monotonic, sleep
from typing import TYPE_CHECKING, Final

import orinkit
from orinkit.cli._shared.moving import ProgressBar
from orinkit.cli._shared.stream_report import StreamReport
from orinkit.cli._shared.stream_trace import trace_of
from orinkit.cli.commands.stream import StreamDisplay
from orinkit.client._shared.stream_options import PERIOD
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from orinkit import Progress, StreamResult
    from orinkit.client._sync.stream import Stream

_TOLERANCE: Final = 1.0  # deg, for the encoders at the end, which lag by a few cycles
_TRIES: Final = 3
_SWITCH_OFF_TIMEOUT: Final = 5.0  # s
_POLL: Final = 0.05  # s
_LINES: Final = 25  # set-points between two printed lines
_ANSWERS: Final = (hresult.S_OK, hresult.S_BUF_FULL)


def carry_out(
    client: orinkit.Client,
    handles: tuple[int, int],
    points: Sequence[tuple[float, ...]],
    mode: int,
    say: Callable[[str], None],
    entered: Callable[[], None],
) -> tuple[StreamReport, str]:
    """Stream joint positions.

    Args:
        client: The connection.
        handles: Handles of controller and robot.
        points: The set-points.
        mode: Slave mode: 0, 1 or 2.
        say: Callback invoked with lines that show the joint position, if there is no terminal for a progress bar.
        entered: Callback invoked when slave mode is on; the packets after that are not traced.

    Returns:
        The report, and a text that describes how the stream differs from the document; ``""`` if it does not differ.

    Raises:
        OrinError: If the controller refuses or ends the stream.
    """
    controller = orinkit.Controller(client, handles[0], "b-CAP")
    robot = orinkit.Robot(client, handles[1], "Robot", controller)
    tries = 0
    while True:
        tries += 1
        try:
            with robot.slave_mode(mode, "J", ("time", "joints"), idle=None) as stream:
                entered()
                result = _run(stream, points, say)
            return StreamReport(
                result, stream.real_time, trace_of(result.samples, "J", PERIOD)
            ), deviation_from_document(result, points)
        except CallError as error:
            if error.code != hresult.COMMAND_DELAY or tries == _TRIES:
                raise
            say(f"      {error}")
        say(
            tr(
                "      This computer was too busy to send in time. Retrying as RC8 4.7 describes: clear "
                "errors, motor on."
            )
        )
        controller.clear_error()
        _motor_on(robot)
        robot.move(orinkit.J.of(points[0]), "@E")


def _motor_on(robot: orinkit.Robot) -> None:
    """Switch the motor on; retry while the controller is still switching it off after an error."""
    end = monotonic() + _SWITCH_OFF_TIMEOUT
    while True:
        try:
            robot.execute("Motor", [1, 0])
        except CallError as error:
            if error.code != hresult.MOTOR_SWITCHING_OFF or monotonic() > end:
                raise
        else:
            return
        sleep(_POLL)


def _run(stream: Stream, points: Sequence[tuple[float, ...]], say: Callable[[str], None]) -> StreamResult:
    with ProgressBar() as bar:
        return stream.run(points, progress=StreamDisplay(stream, bar) if bar.seen else _Lines(stream, say))


def deviation_from_document(result: StreamResult, points: Sequence[tuple[float, ...]]) -> str:
    """Return how a stream differs from the document (RC8 4.3.1, table 4-3), as text; ``""`` if it does not differ."""
    if result.underflows or result.missed or result.sent != len(points):
        return tr(
            "{sent} of {count} set-points sent, {underflows} underflows, {missed} samples overwritten before they "
            "were read",
            sent=result.sent,
            count=len(points),
            underflows=result.underflows,
            missed=result.missed,
        )
    commands = [sample.command for sample in result.samples]
    wanted = [tuple(point) for point in points]
    if not any(commands[place : place + len(wanted)] == wanted for place in range(len(commands) - len(wanted) + 1)):
        return tr("the set-points sent differ from those given")
    for sample in result.samples:
        if sample.code not in _ANSWERS or sample.joints is None:
            return tr("unexpected reply to set-point {number}: {answer}", number=sample.number, answer=sample)
    if any(
        after.time is None or before.time is None or after.time < before.time
        for before, after in pairwise(result.samples)
    ):
        return tr("the time of the controller runs backwards")
    last = result.samples[-1].joints or ()
    if any(abs(joint - wanted_joint) > _TOLERANCE for joint, wanted_joint in zip(last, wanted[-1], strict=False)):
        return tr("the final joint position is wrong: {joints}", joints=last)
    return ""


class _Lines:
    """Prints the joint position every 25 set-points, and once after the last set-point."""

    def __init__(self, stream: Stream, say: Callable[[str], None]) -> None:
        self._stream = stream
        self._say = say
        self._next = 0

    def __call__(self, progress: Progress) -> None:
        sample = self._stream.latest
        if progress.sent < self._next or sample.joints is None:
            return
        sent, total = progress
        self._next = sent + _LINES if total in (None, sent) else min(sent + _LINES, total)
        self._say(f"{joints_line(sample.joints[:6])}  {sent:5}/{total}")


def joints_line(joints: Sequence[float]) -> str:
    """Return joints as a line, indented like the packets."""
    return "      " + "  ".join(f"J{number} {value:8.3f}" for number, value in enumerate(joints, 1))
