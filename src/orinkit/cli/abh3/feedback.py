"""Feedback of an ABH3 while it is driven: text lines, one live line on a terminal, or JSON."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, Final, Self, cast

from orinkit.core.background_writer import BackgroundWriter
from orinkit.core.i18n import tr, visible

if TYPE_CHECKING:
    from orinkit.abh3.table.records import BR0, BR3, BR4, DP0R, DP0RV2, Flags

_AXES: Final = {
    "a_velocity": "A",
    "b_velocity": "B",
    "y_velocity": "Y",
    "x_velocity": "X",
    "ay_velocity": "A/Y",
    "bx_velocity": "B/X",
}


def velocities_of(feedback: DP0R | DP0RV2) -> dict[str, float]:
    """Return the velocities in a feedback of either dialect, by their names, min^-1."""
    return {name: getattr(feedback, name) for name in _AXES if hasattr(feedback, name)}


def words(flags: Flags) -> str:
    """Return the texts of the flags, and the flag word in hex."""
    return f"{', '.join(flags.texts) or '-'} (0x{flags.value:08X})"


@dataclass(frozen=True, slots=True)
class DriverFeedback:
    """Feedback of a driver at one time.

    Attributes:
        time: Time since the start in s.
        velocities: Reply to a command; it contains the velocities.
        pulses: Pulse counts.
        currents: Currents and loads.
        faults: Errors and warnings.
    """

    time: float
    velocities: DP0R | DP0RV2
    pulses: BR4
    currents: BR3
    faults: BR0

    @property
    def line(self) -> str:
        """The feedback as a line for people."""
        speeds = "  ".join(f"{_AXES[name]} {value:.1f}" for name, value in velocities_of(self.velocities).items())
        pulses, currents = self.pulses, self.currents
        parts = (
            f"{self.time:.2f} s  {speeds} min^-1",
            tr("pulses A {a}  B {b}", a=pulses.a_pulses, b=pulses.b_pulses),
            tr("current A/Y {ay:.2f}  B/X {bx:.2f} %", ay=currents.ay_current_command, bx=currents.bx_current_command),
            tr("load A {a:g}  B {b:g} %", a=currents.a_load, b=currents.b_load),
        )
        return "  ".join(parts)

    @property
    def json(self) -> str:
        """The feedback as a JSON object on one line."""
        speeds, currents = velocities_of(self.velocities), self.currents
        percents = {
            "ay_current_command": currents.ay_current_command,
            "bx_current_command": currents.bx_current_command,
            "a_load": currents.a_load,
            "b_load": currents.b_load,
        }
        document = {
            "time": round(self.time, 6),
            "values": {**speeds, "a_pulses": self.pulses.a_pulses, "b_pulses": self.pulses.b_pulses, **percents},
            "units": {"time": "s", **dict.fromkeys(speeds, "min^-1"), **dict.fromkeys(percents, "%")},
            "errors": list(self.faults.errors),
            "warnings": list(self.faults.warnings),
        }
        return json.dumps(document, allow_nan=False)


class FeedbackDisplay:
    """Shows the feedback of a driver, and notes, while the ``with`` statement lasts.

    Feedback is written to stdout. Notes are written to stderr, or to stdout above the live line if it is shown.

    Output never blocks. Only at the end of the ``with`` statement, the display waits for the reader of the output; it
    stops waiting if the reader makes no progress for 1 s.

    Args:
        as_json: Print JSON, one object per line.
    """

    def __init__(self, *, as_json: bool) -> None:
        self._json = as_json
        self._live: Any = None
        self._warnings = 0
        self._out = BackgroundWriter(sys.stdout)
        self._notes = BackgroundWriter(sys.stderr)
        if not as_json and self._out.isatty():
            from rich.console import Console
            from rich.live import Live

            console = Console(file=cast("IO[str]", self._out))
            self._live = Live("", console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
        try:
            self._out.close()
            if self._out.dropped and self._out.error is None:
                number = self._out.dropped
                self.note(tr("{count} lines of stdout were not read and are lost", count=number))  # fmt: skip
        finally:
            self._notes.close()
        if kind is None:
            self._out.check()

    def show(self, feedback: DriverFeedback) -> None:
        """Show the feedback.

        Raises:
            OSError: If stdout cannot be written to.
        """
        self._out.check()
        if self._live is not None:
            from rich.text import Text

            self._live.start()
            self._live.update(Text(feedback.line), refresh=True)
        else:
            self._out.write(f"{feedback.json if self._json else feedback.line}\n")
        warnings = feedback.faults.warnings
        if warnings.value & ~self._warnings:
            text = words(warnings)
            self.note(tr("warning: the driver reports: {warnings}", warnings=text))
        self._warnings = warnings.value

    def note(self, text: str) -> None:
        """Print a line above the live line on stdout; to stderr if no live line is shown."""
        line = visible(f"orinkit: {' '.join(text.split())}")
        if self._live is not None and self._live.is_started:
            from rich.text import Text

            self._live.console.print(Text(line))
        else:
            self._notes.write(f"{line}\n")
