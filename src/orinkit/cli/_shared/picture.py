"""Save pictures to files and show them in a window.

Labels are in the current language, or in English if no installed font supports Japanese.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.core import i18n
from orinkit.core.i18n import Translate, tr, translate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Drawing: TypeAlias = "Callable[[Figure, Translate], None]"
"""Function that draws on an empty figure; its second argument translates the labels."""

FORMATS: Final = ("png", "svg", "pdf")
"""File name extensions of the supported picture formats."""

DASHES: Final[tuple[Any, ...]] = (
    "-", (0, (6, 2)), (0, (4, 2)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (4, 2, 1, 2, 1, 2)), (0, (8, 3)), (0, (2, 2)),
)  # fmt: skip
"""Line styles; if two lines coincide, the gaps of the dashed one show the other."""

_SIZE: Final = (9.0, 9.0)  # inch
_DPI: Final = 120
_JAPANESE_FONTS: Final = (
    "Noto Sans CJK JP", "Noto Sans JP", "IPAexGothic", "IPAGothic", "TakaoGothic", "VL Gothic", "Yu Gothic", "Meiryo",
    "MS Gothic", "Hiragino Sans",
)  # fmt: skip


def check_format(path: Path) -> None:
    """Refuse a file name without the extension of a picture format.

    Raises:
        CommandError: If the name does not end in one of :data:`FORMATS`.
    """
    if path.suffix.lower().removeprefix(".") not in FORMATS:
        formats = ", ".join(f".{name}" for name in FORMATS)
        raise usage_error(tr("{path}: unknown picture format. Try: {formats}", path=path, formats=formats))


def save(drawing: Drawing, path: Path) -> None:
    """Write a picture.

    Args:
        drawing: Function that draws the picture.
        path: File to write; the extension selects the format.

    Raises:
        CommandError: If matplotlib is not installed, or the file cannot be written.
    """
    check_format(path)
    _library()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    _with_font(lambda label: drawing(figure, label))
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise CommandError(tr("cannot write {path}: {reason}", path=path, reason=error.strerror)) from None


def show(drawing: Drawing) -> None:
    """Show the picture in a window, and wait until it is closed.

    Raises:
        CommandError: If matplotlib is not installed, or there is no screen.
    """
    _library()
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    if mpl.get_backend().lower() in ("agg", "pdf", "svg", "ps", "cairo", "template"):
        raise CommandError(tr("no screen is available to show a picture. Try: omit --show to write a file"))
    figure = plt.figure(figsize=_SIZE, layout="constrained")
    _with_font(lambda label: drawing(figure, label))
    plt.show()


def _with_font(paint: Callable[[Translate], None]) -> None:
    """Paint in the current language, or in English if no font supports Japanese."""
    import matplotlib as mpl
    from matplotlib.font_manager import fontManager

    if i18n.current() != "ja":
        paint(tr)
        return
    known = {font.name for font in fontManager.ttflist}
    font = next((name for name in _JAPANESE_FONTS if name in known), None)
    if font is None:
        paint(partial(translate, "en"))
        return
    with mpl.rc_context({"font.family": [font, "sans-serif"]}):
        paint(tr)


def _library() -> None:
    try:
        import matplotlib as mpl  # noqa: F401 - only checks that it is installed
    except ImportError:
        raise CommandError(tr("plotting requires matplotlib. Try: pip install 'orinkit[plot]'")) from None
