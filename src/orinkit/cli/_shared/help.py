"""Help pages in both languages: cyclopts formats them, this module translates the few words that cyclopts adds.

Rich breaks lines at spaces only. Japanese text has hardly any, so this module breaks its lines between characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from orinkit.core.i18n import current, tr

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel
    from cyclopts.help.formatters import DefaultFormatter
    from rich.console import Console, ConsoleOptions, RenderResult

_NO_DEFAULT: Final = ("False", "()")  # defaults that are not shown: an unset flag and an empty list
_PIECES: Final = re.compile(r"\[[^][]*\]|\s+|[!-~]+|.")  # a note, spaces, a word of ASCII, or any other character
_NOT_FIRST: Final = frozenset("、。，．・：；？！）］｝」』】〉》ー々ぁぃぅぇぉっゃゅょァィゥェォッャュョ)]},.;:!?～%")
_NOT_LAST: Final = frozenset("（［｛「『【〈《([{")


class HelpFormatter:
    """The formatter of cyclopts in the current language; cyclopts' formatter is imported when a page is shown."""

    show_metavar = False

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Show one panel."""
        entries = [entry.copy(default=None) if entry.default in _NO_DEFAULT else entry for entry in panel.entries]
        if current() == "ja":
            entries = [_translated(entry) for entry in entries]
        _formatter()(console, options, panel.copy(entries=entries))

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Show the usage line of the command."""
        if current() == "ja":
            console.print(
                tr("Usage: {usage}", usage=str(usage).strip()) + "\n", style="bold", markup=False, highlight=False
            )
        else:
            _formatter().render_usage(console, options, usage)

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Show the description of the command."""
        if current() == "ja" and description:
            console.print(JapaneseText(str(getattr(description, "primary_renderable", description))), soft_wrap=False)
            console.print()
        else:
            _formatter().render_description(console, options, description)


def _formatter() -> DefaultFormatter:
    from cyclopts.help.formatters import DefaultFormatter

    return DefaultFormatter(show_metavar=False)


def _translated(entry: HelpEntry) -> HelpEntry:
    """Append the choices, and "required" or the default, to a description; the notes of cyclopts are in English."""
    description = str(getattr(entry.description, "primary_renderable", entry.description or ""))
    if entry.choices:
        description += " " + tr("[choices: {values}]", values=", ".join(entry.choices))
    if entry.required:
        description += " " + tr("[required]")
    elif entry.default:
        description += " " + tr("[default: {value}]", value=entry.default)
    return entry.copy(description=JapaneseText(description), choices=(), default=None, required=False)


class JapaneseText:
    """A text whose lines rich breaks by the rules of Japanese typesetting.

    Args:
        text: The text.
    """

    def __init__(self, text: str) -> None:
        self.text = text

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich.text import Text

        yield Text("\n".join(wrapped(self.text, options.max_width)))


def wrapped(text: str, most: int) -> list[str]:
    """Return the lines of a Japanese text.

    A line ends at a space or between two characters, but not within a word of ASCII characters or a note in square
    brackets, not before a closing bracket or punctuation mark, and not after an opening bracket.

    Args:
        text: The text.
        most: Largest width of a line in columns; a Japanese character takes two.
    """
    from rich.cells import cell_len

    lines = []
    for paragraph in text.split("\n"):
        line = ""
        for unit in _units(paragraph):
            if line and cell_len(line + unit.rstrip()) > most:
                lines.append(line.rstrip())
                line = unit.lstrip()
            else:
                line += unit
        lines.append(line.rstrip())
    return lines


def _units(text: str) -> Iterator[str]:
    """Yield the parts of a text that must stay on one line."""
    unit = ""
    for piece in _PIECES.findall(text):
        if unit and piece[0] not in _NOT_FIRST and unit[-1] not in _NOT_LAST:
            yield unit
            unit = ""
        unit += piece
    yield unit
