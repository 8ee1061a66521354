"""``orinkit plot``: plot a recorded motion."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from orinkit.cli._shared.picture import Drawing


def plot(
    file: Annotated[
        str,
        Parameter(help=tr("Recording written by orinkit move --record or orinkit stream --record.")),
    ],
    /,
    *,
    out: Annotated[
        str | None,
        Parameter(help=tr("File for the picture: .png, .svg or .pdf; by default FILE with the extension .png.")),
    ] = None,
    show: Annotated[bool, Parameter(help=tr("Show the picture in a window instead of writing a file."))] = False,
) -> None:  # fmt: skip
    """Plot joints, velocities and accelerations of a recorded motion, or command and feedback of a stream."""
    from orinkit.cli._shared import picture

    source = Path(file)
    target = source.with_suffix(".png") if out is None and source.name else Path(out or file)
    if not show or out is not None:
        picture.check_format(target)
    drawing = _drawing(source)
    if not show or out is not None:
        picture.save(drawing, target)
        print(target)
    if show:
        picture.show(drawing)


def _drawing(source: Path) -> Drawing:
    from orinkit.cli._shared import motion_plot, stream_plot
    from orinkit.cli._shared.motion_record import read_csv
    from orinkit.cli._shared.stream_trace import is_recording, read_trace

    if is_recording(source):
        trace = read_trace(source)
        return lambda figure, label: stream_plot.draw(trace, figure, label)
    recording = read_csv(source)
    return lambda figure, label: motion_plot.draw(recording, figure, label)
