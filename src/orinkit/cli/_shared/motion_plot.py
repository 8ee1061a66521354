"""Plots of a recorded motion: joints, velocities and accelerations over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from orinkit.cli._shared.motion_record import MotionRecording
from orinkit.cli._shared.picture import DASHES
from orinkit.core.i18n import N_, Translate, tr

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw(recording: MotionRecording, figure: Figure, label: Translate = tr) -> None:
    """Draw a recording: three diagrams, one above the other, with a line for each joint.

    In each diagram, all lines except the first one are dashed.

    Args:
        recording: The motion.
        figure: An empty figure.
        label: Function that translates the labels.
    """
    import numpy as np
    from matplotlib.lines import Line2D

    times = np.asarray(recording.times, dtype=float)
    command = np.asarray(recording.command, dtype=float)
    velocity = np.diff(command, axis=0) / np.diff(times)[:, None]
    middles = (times[1:] + times[:-1]) / 2
    panels: list[tuple[str, Any, Any]] = [
        (label(N_("joints [deg]")), times, command),
        (label(N_("velocity [deg/s]")), middles, velocity),
    ]
    if len(middles) > 1:
        acceleration = np.diff(velocity, axis=0) / np.diff(middles)[:, None]
        panels.append((label(N_("acceleration [deg/s²]")), times[1:-1], acceleration))
    axes: list[Axes] = list(figure.subplots(len(panels), 1, sharex=True))
    for each, (title, x, values) in zip(axes, panels, strict=True):
        for place, joint in enumerate(recording.joints):
            each.plot(
                x, values[:, place], label=f"J{joint}", linewidth=1.2, color=f"C{joint - 1}",
                linestyle=DASHES[place % len(DASHES)],
            )  # fmt: skip
        each.set_ylabel(title)
        each.grid(visible=True, alpha=0.3)
    if recording.encoder:
        for place, joint in enumerate(recording.joints):
            encoder = [row[place] for row in recording.encoder]
            axes[0].plot(times, encoder, linewidth=0.8, linestyle=":", color=f"C{joint - 1}")
    axes[-1].set_xlabel(label(N_("time [s]")))
    figure.suptitle(_title(recording, label))
    handles = axes[0].get_lines()[: len(recording.joints)]
    if recording.encoder:
        dotted = label(N_("dotted: encoders"))
        handles.append(Line2D([], [], color="gray", linewidth=0.8, linestyle=":", label=dotted))
    figure.legend(handles=handles, loc="outside lower center", ncols=9)


def _title(recording: MotionRecording, label: Translate) -> str:
    if all(row == recording.command[0] for row in recording.command):
        return label(N_("the arm did not move"))
    seconds = recording.times[-1] - recording.times[0]
    return label(N_("recorded motion, {seconds:.2f} s"), seconds=seconds)
