"""Plots of a stream: command and feedback of each value that changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from orinkit.cli._shared.picture import DASHES
from orinkit.cli._shared.stream_trace import StreamTrace
from orinkit.core.i18n import N_, Translate, tr

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH: Final = 9.0  # inch
_HEIGHT: Final = 2.2  # inch, of a diagram
_MARGIN: Final = 1.2  # inch, in total above and below the diagrams


def draw(trace: StreamTrace, figure: Figure, label: Translate = tr) -> None:
    """Draw a stream: a diagram for each value that changes, and a diagram of the deviations.

    Args:
        trace: Command and feedback.
        figure: An empty figure; its height is adapted to the number of diagrams.
        label: Function that translates the labels.
    """
    changing = trace.changing()
    drawn = changing or range(len(trace.names))
    count = len(drawn) + bool(trace.actual)
    figure.set_size_inches(_WIDTH, _HEIGHT * count + _MARGIN)
    axes: list[Axes] = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for each, index in zip(axes, drawn, strict=False):
        _draw_value(trace, index, each, label)
    if trace.actual:
        for number, index in enumerate(drawn):
            axes[-1].plot(
                trace.times, trace.deviations(index), linewidth=1.0, linestyle=DASHES[number % len(DASHES)],
                label=trace.names[index],
            )  # fmt: skip
        axes[-1].set_ylabel(label(N_("actual - command")))
        axes[-1].legend(loc="upper right", ncols=4, fontsize="small")
    for each in axes:
        each.grid(visible=True, alpha=0.3)
    axes[-1].set_xlabel(label(N_("time [s]")))
    seconds = trace.times[-1] - trace.times[0]
    figure.suptitle(
        label(N_("streamed motion, {seconds:.2f} s"), seconds=seconds)
        if changing
        else label(N_("the arm did not move"))
    )
    figure.legend(handles=axes[0].get_lines(), loc="outside lower center", ncols=2)


def _draw_value(trace: StreamTrace, index: int, axes: Axes, label: Translate) -> None:
    command = [row[index] for row in trace.command]
    axes.plot(trace.times, command, linewidth=1.4, color="C0", label=label(N_("command")))
    if trace.actual:
        actual = [row[index] for row in trace.actual]
        axes.plot(trace.times, actual, linewidth=1.2, color="C1", linestyle=DASHES[2], label=label(N_("actual")))
    unit = trace.unit(index)
    axes.set_ylabel(f"{trace.names[index]} [{unit}]" if unit else trace.names[index])
