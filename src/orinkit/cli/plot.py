"""``orinkit plot``: a recorded motion as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from orinkit.language import pick

if TYPE_CHECKING:
    from orinkit.cli._picture import Drawing


def plot(
    file: Annotated[
        str,
        Parameter(help=pick("What orinkit move --record or orinkit stream --record has written.",
                            "orinkit move --record または orinkit stream --record で保存したファイル。")),
    ],
    /,
    *,
    out: Annotated[
        str | None,
        Parameter(help=pick("The picture: .png, .svg or .pdf; by default FILE with .png.",
                            "画像ファイル (.png, .svg, .pdf)。既定は FILE の拡張子を .png にしたもの。")),
    ] = None,
    show: Annotated[bool, Parameter(help=pick("Show it in a window instead.", "保存せずウィンドウに表示する。"))] = False,
) -> None:  # fmt: skip
    """Plot joints, velocities and accelerations of a recorded motion over time; command and feedback of a stream."""
    from orinkit.cli import _picture

    source = Path(file)
    target = source.with_suffix(".png") if out is None and source.name else Path(out or file)
    if not show or out is not None:
        _picture.check_format(target)
    drawing = _drawing(source)
    if not show or out is not None:
        _picture.save(drawing, target)
        print(target)
    if show:
        _picture.show(drawing)


def _drawing(source: Path) -> Drawing:
    from orinkit.cli import _motion_plot, _stream_plot
    from orinkit.cli._motion_record import read_csv
    from orinkit.cli._stream_trace import is_recording, read_trace

    if is_recording(source):
        trace = read_trace(source)
        return lambda figure, label: _stream_plot.draw(trace, figure, label)
    recording = read_csv(source)
    return lambda figure, label: _motion_plot.draw(recording, figure, label)
