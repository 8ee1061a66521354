"""``orinkit plot``: a recorded motion as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from orinkit.language import pick


def plot(
    file: Annotated[
        str,
        Parameter(help=pick("What orinkit move --record has written.", "orinkit move --record で保存した CSV ファイル。")),
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
    """Plot joints, velocities and accelerations of a recorded motion over time."""
    from orinkit.cli import _motion_plot
    from orinkit.cli._motion_record import read_csv

    source = Path(file)
    target = source.with_suffix(".png") if out is None and source.name else Path(out or file)
    if not show or out is not None:
        _motion_plot.check_format(target)
    recording = read_csv(source)
    if not show or out is not None:
        _motion_plot.save(recording, target)
        print(target)
    if show:
        _motion_plot.show(recording)
