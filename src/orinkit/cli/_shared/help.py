"""Help pages in both languages: cyclopts formats them, this module translates the few words that cyclopts adds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from orinkit.core.i18n import current, tr

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel
    from cyclopts.help.formatters import DefaultFormatter
    from rich.console import Console, ConsoleOptions

_NO_DEFAULT: Final = ("False", "()")  # defaults that are not shown: an unset flag and an empty list


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
        _formatter().render_description(console, options, description)


def _formatter() -> DefaultFormatter:
    from cyclopts.help.formatters import DefaultFormatter

    return DefaultFormatter(show_metavar=False)


def _translated(entry: HelpEntry) -> HelpEntry:
    """Append a Japanese note, "required" or the default, to a description; the notes of cyclopts are in English."""
    if entry.required:
        note = tr("[required]")
    elif entry.default:
        note = tr("[default: {value}]", value=entry.default)
    else:
        return entry
    from rich.text import Text

    description = getattr(entry.description, "primary_renderable", entry.description)
    return entry.copy(description=Text(f"{description} {note}"), default=None, required=False)
