"""Errors of commands and of the command line, in the current language."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

import cyclopts

from orinkit.core.i18n import tr


class CommandError(Exception):
    """Ends a command with a line on stderr.

    Args:
        text: The line.
        code: Exit code; 2 for an invalid command line.
    """

    def __init__(self, text: str, code: int = 1) -> None:
        super().__init__(text)
        self.code = code


def usage_error(text: str) -> CommandError:
    """Return the exception for an invalid command line; the text is in the current language."""
    return CommandError(text, 2)


def usage_text(error: cyclopts.CycloptsError) -> str:
    """Return the description of an error in a command line, with a reference to the help page."""
    command = " ".join(("orinkit", *(error.command_chain or ())))
    return _reason(error) + tr(" (see {command} --help)", command=command)


def _unknown_command(word: str, error: cyclopts.CycloptsError) -> str:
    known = [name for name in (error.app or ()) if not name.startswith("-")]
    names = ", ".join(get_close_matches(word, known, n=2) or known)
    return tr("unknown command {word}; did you mean {names}?", word=word, names=names)


def _unknown_option(option: str, arguments: Iterable[cyclopts.Argument]) -> str:
    known = [name for argument in arguments for name in argument.names]
    if nearest := get_close_matches(option, known, n=1, cutoff=0.75):
        return tr("unknown option {option}; did you mean {name}?", option=option, name=nearest[0])
    return tr("unknown option {option}", option=option)


def whole_number(_kind: object, tokens: Sequence[cyclopts.Token]) -> int:
    """Parse a whole number; cyclopts' own conversion would round 10.7."""
    return int(tokens[0].value, 10)


def _reason(error: cyclopts.CycloptsError) -> str:
    name = error.argument.name if error.argument is not None else ""
    positional = error.argument is not None and error.argument.index is not None
    shown = name.lstrip("-").upper() if positional else name
    unused = " ".join(error.unused_tokens or ())
    match error:
        case cyclopts.MissingArgumentError():
            return tr("{argument} is missing", argument=shown)
        case cyclopts.CoercionError(token=token):
            value = token.value if token is not None else ""
            choices = error.argument.get_choices(force=True) if error.argument is not None else None
            text = tr("{value!r} is not a valid value for {argument}", value=value, argument=shown)
            return text + (tr(". Try: one of {choices}", choices=", ".join(choices)) if choices else "")
        case cyclopts.UnknownOptionError(token=token):
            return _unknown_option(token.keyword or token.value, error.argument_collection)
        case cyclopts.UnknownCommandError():
            return _unknown_command((error.unused_tokens or [""])[0], error)
        case cyclopts.UnusedCliTokensError():
            return tr("too many arguments: {words}", words=unused)
        case cyclopts.RepeatArgumentError(token=token):
            return tr("{option} is given twice", option=token.keyword)
        case _:
            return tr("invalid command line: {error}", error=error)
