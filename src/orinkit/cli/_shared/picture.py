"""Pictures as files and in a window: what all of them have in common.

The labels are English unless there is a font that has Japanese.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

from orinkit.cli._shared.errors import CommandError, unusable
from orinkit.core import i18n
from orinkit.core.i18n import tr, translate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Translate(Protocol):
    """Returns a message in the language of the picture, like :func:`orinkit.core.i18n.tr`."""

    def __call__(self, message: str, /, **values: object) -> str:
        """Return the message."""


Drawing: TypeAlias = "Callable[[Figure, Translate], None]"
"""Draws on an empty figure."""

FORMATS: Final = ("png", "svg", "pdf")
"""What a picture can be, by the end of its name."""

DASHES: Final[tuple[Any, ...]] = (
    "-", (0, (6, 2)), (0, (4, 2)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (4, 2, 1, 2, 1, 2)), (0, (8, 3)), (0, (2, 2)),
)  # fmt: skip
"""How lines are drawn: one that lies on another leaves parts of it to be seen."""

_SIZE: Final = (9.0, 9.0)  # inch
_DPI: Final = 120
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
        formats = ", ".join(f".{name}" for name in FORMATS)
        raise unusable(tr("{path}: a picture's name ends in {formats}", path=path, formats=formats))


def save(drawing: Drawing, path: Path) -> None:
    """Write a picture.

    Args:
        drawing: what is on it.
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
    _with_font(lambda label: drawing(figure, label))
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise CommandError(tr("cannot write {path}: {reason}", path=path, reason=error.strerror)) from None


def show(drawing: Drawing) -> None:
    """Show the picture in a window, and wait until it is closed.

    Raises:
        Failure: there is no matplotlib, or no screen.
    """
    _library()
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    if mpl.get_backend().lower() in ("agg", "pdf", "svg", "ps", "cairo", "template"):
        raise CommandError(tr("there is no screen to show a picture on; leave --show out to write a file"))
    figure = plt.figure(figsize=_SIZE, layout="constrained")
    _with_font(lambda label: drawing(figure, label))
    plt.show()


def _with_font(paint: Callable[[Translate], None]) -> None:
    """Paint in the current language; in English where no font has Japanese."""
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
        import matplotlib as mpl  # noqa: F401 - is it there?
    except ImportError:
        raise CommandError(tr("plotting needs matplotlib: pip install 'orinkit[plot]'")) from None
