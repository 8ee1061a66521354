"""A recorded motion as a picture: joints, velocities and accelerations over time.

The labels are English unless there is a font that has Japanese.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from orinkit import language
from orinkit.cli._errors import Failure, unusable
from orinkit.cli._motion_record import Recording
from orinkit.language import pick

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS: Final = ("png", "svg", "pdf")
"""What a picture can be, by the end of its name."""

_SIZE: Final = (9.0, 9.0)  # inch
_DPI: Final = 120
_DASHES: Final[tuple[Any, ...]] = (  # a line that lies on another one leaves parts of it to be seen
    "-", (0, (6, 2)), (0, (4, 2)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (4, 2, 1, 2, 1, 2)), (0, (8, 3)), (0, (2, 2)),
)  # fmt: skip
_JAPANESE_FONTS: Final = (
    "Noto Sans CJK JP", "Noto Sans JP", "IPAexGothic", "IPAGothic", "TakaoGothic", "VL Gothic", "Yu Gothic", "Meiryo",
    "MS Gothic", "Hiragino Sans",
)  # fmt: skip


def check_format(path: Path) -> None:
    """Refuse a name that does not say what the picture is to be.

    Raises:
        Failure: it does not end in one of :data:`FORMATS`.
    """
    if path.suffix.lower().removeprefix(".") not in FORMATS:
        known = ", ".join(f".{name}" for name in FORMATS)
        raise unusable(
            f"{path}: a picture's name ends in {known}",
            f"{path}: 画像のファイル名は {known} のいずれかで終えてください",
        )


def save(recording: Recording, path: Path) -> None:
    """Write the picture of a recording.

    Args:
        recording: the motion.
        path: of the picture; its end says of which kind it is.

    Raises:
        Failure: there is no matplotlib, or the file cannot be written.
    """
    check_format(path)
    _library()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    _with_font(lambda label: draw(recording, figure, label))
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise Failure(
            pick(f"cannot write {path}: {error.strerror}", f"{path} に書き込めません: {error.strerror}")
        ) from None


def show(recording: Recording) -> None:
    """Show the picture in a window, and wait until it is closed.

    Raises:
        Failure: there is no matplotlib, or no screen.
    """
    _library()
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    if mpl.get_backend().lower() in ("agg", "pdf", "svg", "ps", "cairo", "template"):
        raise Failure(
            pick(
                "there is no screen to show a picture on; leave --show out to write a file",
                "画面がないため表示できません。ファイルに保存するには --show を外してください",
            )
        )
    figure = plt.figure(figsize=_SIZE, layout="constrained")
    _with_font(lambda label: draw(recording, figure, label))
    plt.show()


def draw(recording: Recording, figure: Figure, label: Callable[[str, str], str] = pick) -> None:
    """Draw a recording: three diagrams below each other, a line for each joint, dashed in ever other ways from the second.

    Args:
        recording: the motion.
        figure: an empty figure.
        label: picks the English or the Japanese label.
    """
    import numpy as np
    from matplotlib.lines import Line2D

    times = np.asarray(recording.times, dtype=float)
    command = np.asarray(recording.command, dtype=float)
    velocity = np.diff(command, axis=0) / np.diff(times)[:, None]
    middles = (times[1:] + times[:-1]) / 2
    panels: list[tuple[str, Any, Any]] = [
        (label("joints [deg]", "関節角度 [deg]"), times, command),
        (label("velocity [deg/s]", "速度 [deg/s]"), middles, velocity),
    ]
    if len(middles) > 1:
        acceleration = np.diff(velocity, axis=0) / np.diff(middles)[:, None]
        panels.append((label("acceleration [deg/s²]", "加速度 [deg/s²]"), times[1:-1], acceleration))
    axes: list[Axes] = list(figure.subplots(len(panels), 1, sharex=True))
    for each, (title, x, values) in zip(axes, panels, strict=True):
        for place, joint in enumerate(recording.joints):
            each.plot(
                x, values[:, place], label=f"J{joint}", linewidth=1.2, color=f"C{joint - 1}",
                linestyle=_DASHES[place % len(_DASHES)],
            )  # fmt: skip
        each.set_ylabel(title)
        each.grid(visible=True, alpha=0.3)
    if recording.encoder:
        for place, joint in enumerate(recording.joints):
            late = [row[place] for row in recording.encoder]
            axes[0].plot(times, late, linewidth=0.8, linestyle=":", color=f"C{joint - 1}")
    axes[-1].set_xlabel(label("time [s]", "時間 [s]"))
    figure.suptitle(_title(recording, label))
    handles = axes[0].get_lines()[: len(recording.joints)]
    if recording.encoder:
        dotted = label("dotted: encoders", "点線: エンコーダ")
        handles.append(Line2D([], [], color="gray", linewidth=0.8, linestyle=":", label=dotted))
    figure.legend(handles=handles, loc="outside lower center", ncols=9)


def _title(recording: Recording, label: Callable[[str, str], str]) -> str:
    if all(row == recording.command[0] for row in recording.command):
        return label("the arm did not move", "アームは動いていません")
    seconds = recording.times[-1] - recording.times[0]
    return label(f"recorded motion, {seconds:.2f} s", f"記録した動作 ({seconds:.2f} 秒)")


def _with_font(paint: Callable[[Callable[[str, str], str]], None]) -> None:
    """Paint in the language in force; in English where no font has Japanese."""
    import matplotlib as mpl
    from matplotlib.font_manager import fontManager

    if language.current() != "ja":
        paint(pick)
        return
    known = {font.name for font in fontManager.ttflist}
    font = next((name for name in _JAPANESE_FONTS if name in known), None)
    if font is None:
        paint(lambda en, _: en)
        return
    with mpl.rc_context({"font.family": [font, "sans-serif"]}):
        paint(pick)


def _library() -> None:
    try:
        import matplotlib as mpl  # noqa: F401 - is it there?
    except ImportError:
        raise Failure(
            pick(
                "plotting needs matplotlib: pip install 'orinkit[plot]'",
                "グラフの作成には matplotlib が必要です: pip install 'orinkit[plot]'",
            )
        ) from None
