"""What can be wrong with a command line, in both languages."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

import cyclopts

from orinkit.language import pick


class Failure(Exception):
    """Ends a command with a line on stderr.

    Args:
        text: the line.
        code: exit code; 2 for a command line that cannot be used.
    """

    def __init__(self, text: str, code: int = 1) -> None:
        super().__init__(text)
        self.code = code


def unusable(en: str, ja: str) -> Failure:
    """Return the exception for a command line that cannot be used."""
    return Failure(pick(en, ja), 2)


def usage_text(error: cyclopts.CycloptsError) -> str:
    """Return what is wrong with a command line, and where to read more."""
    command = " ".join(("orinkit", *(error.command_chain or ())))
    return _reason(error) + pick(f" (see {command} --help)", f" ({command} --help を参照)")


def _unknown_command(word: str, error: cyclopts.CycloptsError) -> str:
    known = [name for name in (error.app or ()) if not name.startswith("-")]
    near = ", ".join(get_close_matches(word, known, n=2) or known)
    return pick(f"there is no command {word}; did you mean {near}?", f"コマンド {word} はありません (候補: {near})")


def whole_number(_kind: object, tokens: Sequence[cyclopts.Token]) -> int:
    """Read a whole number: cyclopts by itself would round 10.7."""
    return int(tokens[0].value, 10)


def _reason(error: cyclopts.CycloptsError) -> str:
    name = error.argument.name if error.argument is not None else ""
    positional = error.argument is not None and error.argument.index is not None
    shown = name.lstrip("-").upper() if positional else name
    unused = " ".join(error.unused_tokens or ())
    match error:
        case cyclopts.MissingArgumentError():
            return pick(f"{shown} is missing", f"{shown} が指定されていません")
        case cyclopts.CoercionError(token=token):
            value = token.value if token is not None else ""
            return pick(f"{value!r} is no value for {shown}", f"{shown} の値 {value!r} が不正です")
        case cyclopts.UnknownOptionError(token=token):
            option = token.keyword or token.value
            return pick(f"there is no option {option}", f"オプション {option} はありません")
        case cyclopts.UnknownCommandError():
            return _unknown_command((error.unused_tokens or [""])[0], error)
        case cyclopts.UnusedCliTokensError():
            return pick(f"too many arguments: {unused}", f"余分な引数があります: {unused}")
        case cyclopts.RepeatArgumentError(token=token):
            return pick(f"{token.keyword} is given twice", f"{token.keyword} が二重に指定されています")
        case _:
            return pick(str(error), f"コマンドラインが不正です: {error}")
