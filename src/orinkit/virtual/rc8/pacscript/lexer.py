"""Lexer: converts the source to the tokens of the grammar in :mod:`orinkit.virtual.rc8.pacscript.grammar`.

Some words are commands only at the start of a statement: ``Speed`` is a command in ``Speed 50``, but not in
``Move P, P1, Speed = 50``. The lexer therefore tracks the starts of statements. The error for an unsupported word of
PacScript contains the word.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from lark import Token
from lark.lexer import Lexer, LexerState

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.errors import CompileError, not_supported
from orinkit.virtual.rc8.pacscript.keywords import DIRECTIVES, KEYWORDS, PAIRS, REFUSED, STARTERS, canonical

MAX_SOURCE: Final = 256 * 1024
"""Maximum length of a program, in characters."""

MAX_LINE: Final = 1024
"""Maximum length of a line, in bytes (RC8 manual, PacScript)."""

_TOKEN: Final = re.compile(
    r"""
    (?P<blank> [ \t\f\v\u3000]+ | '[^\n]* | _[ \t]*\n )
  | (?P<newline> \n )
  | (?P<number> &[hH][0-9a-fA-F]+ | &[bB][01]+ | (?: [0-9]+\.?[0-9]* | \.[0-9]+ ) (?: [eE][+-]?[0-9]+ )? )
  | (?P<word> [^\W\d_]\w* (?: \.[^\W\d_]\w* )* )
  | (?P<string> "[^"\n]* (?: ""[^"\n]* )* " (?!") )
  | (?P<sign> <= | >= | <> | => | =< | << | >> | [-+*/\\^&=<>(),@\[\]:\#] )
    """,
    re.VERBOSE,
)
_LABEL: Final = re.compile(r"\*[ \t]*([^\W\d_]\w*)([ \t]*:)?")
_PLAIN_LABEL: Final = re.compile(r"[^\W\d_]\w*:")
_SECOND_WORD: Final = re.compile(r"[ \t]+([^\W\d_]\w*)")
_OPENS: Final = re.compile(r"[ \t]*\(")
_DIRECTIVE: Final = re.compile(r"#[ \t]*(\w+)")
_PRAGMA: Final = re.compile(r'[ \t]*Encoding[ \t]*\([ \t]*"[^"\n]*"[ \t]*\)[ \t]*(?:\'[^\n]*)?(?=\n)', re.IGNORECASE)
_SIGNS: Final = {
    "+": "PLUS", "-": "MINUS", "*": "STAR", "/": "SLASH", "\\": "BACKSLASH", "^": "CARET", "&": "AMPERSAND",
    "=": "EQUAL", "<": "LESS", ">": "MORE", "<=": "AT_MOST", "=<": "AT_MOST", ">=": "AT_LEAST", "=>": "AT_LEAST",
    "<>": "UNLIKE", "<<": "LEFTWARDS", ">>": "RIGHTWARDS", "(": "_OPEN", ")": "_CLOSE", ",": "_COMMA", "@": "_AT",
    "[": "_OPEN_INDEX", "]": "_CLOSE_INDEX", ":": "_COLON",
}  # fmt: skip
_STARTS_STATEMENT: Final = frozenset(("_LINE", "_COLON", "THEN", "ELSE", "LABEL"))
_TAKES_LABEL: Final = frozenset(("GOTO", "GOSUB"))


class PacScriptLexer(Lexer):
    """The lexer, with the interface that lark requires."""

    __future_interface__ = 2  # for lark: lex() has the same signature as lark's lexers

    def __init__(self, _: Any) -> None:
        """Create the lexer; lark passes a configuration, which is ignored."""

    def lex(self, lexer_state: LexerState, parser_state: Any) -> Iterator[Token]:
        """Yield the tokens of a program; see :func:`tokens`."""
        return tokens(str(lexer_state.text.text))


def tokens(source: str) -> Iterator[Token]:
    """Yield the tokens of a program.

    Raises:
        CompileError: If a character or word is not allowed, or if a line or the program is too long.
    """
    return _Scan(_normal(source)).tokens()


class _Scan:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line = 1
        self.line_start = 0
        self.last = "_LINE"
        self.fresh_line = True
        self.command = ""

    def tokens(self) -> Iterator[Token]:
        text = self.text
        while self.at < len(text):
            found = _TOKEN.match(text, self.at)
            if found is None:
                raise self._stray()
            kind = found.lastgroup
            if kind == "blank":
                self._skip_blank(found)
                continue
            token = self._newline() if kind == "newline" else self._read(str(kind), found)
            if token is not None:
                self.last = token.type
                self.fresh_line = token.value == "\n"
                yield token

    @property
    def place(self) -> tuple[int, int]:
        return self.line, self.at - self.line_start + 1

    def _read(self, kind: str, found: re.Match[str]) -> Token | None:
        value = found.group()
        starts = self.last in _STARTS_STATEMENT
        if kind == "word":
            return self._word(value, starts)
        if kind == "number":
            return self._number(value)
        if kind == "string":
            return self._token("STRING", value)
        if value == "#":
            return self._directive()
        if value == "*" and (starts or self.last in _TAKES_LABEL):
            return self._label(starts)
        return self._token(_SIGNS[value], value)

    def _word(self, word: str, starts: bool) -> Token:
        if "." in word:
            raise not_supported(word, self.place)
        lower = word.lower()
        if starts:
            if lower == "rem":
                return self._remark()
            self.command = lower
            if self.fresh_line and lower not in KEYWORDS and _PLAIN_LABEL.match(self.text, self.at):
                return self._token("LABEL", word, len(word) + 1)
            if lower in REFUSED:
                raise not_supported(REFUSED[lower], self.place)
            if lower in STARTERS:
                return self._token(STARTERS[lower], word)
        if lower in KEYWORDS:
            return self._keyword(word, lower)
        if lower == "keep" and self.command == "takearm":
            return self._token("KEEP", word)
        if lower in ("ex", "exa") and _OPENS.match(self.text, self.at + len(word)):
            return self._token("EXTRA", word)
        return self._token("NAME", word)

    def _keyword(self, word: str, lower: str) -> Token:
        second = _SECOND_WORD.match(self.text, self.at + len(word))
        pair = PAIRS.get((lower, second.group(1).lower())) if second else None
        if pair is None or second is None:
            return self._token(KEYWORDS[lower], word)
        return self._token(pair, f"{canonical(word)} {canonical(second.group(1))}", second.end() - self.at)

    def _number(self, text: str) -> Token:
        end = self.at + len(text)
        if end < len(self.text) and (self.text[end].isalnum() or self.text[end] == "_"):
            raise CompileError(tr("{text} is not a number", text=self.text[self.at : end + 1]), self.place)
        return self._token("NUMBER", text)

    def _label(self, defines: bool) -> Token:
        found = _LABEL.match(self.text, self.at)
        if found is None:
            raise CompileError(tr("* must be followed by the name of a label"), self.place)
        end = found.end() if defines else found.end(1)
        return self._token("LABEL" if defines else "NAME", found.group(1), end - self.at)

    def _directive(self) -> Token | None:
        found = _DIRECTIVE.match(self.text, self.at)
        word = found.group(1).lower() if found else ""
        if self.last != "_LINE" or not found or (word != "pragma" and word not in DIRECTIVES):
            raise self._stray()
        if word != "pragma":
            raise not_supported(DIRECTIVES[word], self.place)
        pragma = _PRAGMA.match(self.text, found.end())
        if pragma is None:
            raise CompileError(
                tr('only #Pragma Encoding("...") is supported'),
                self.place,
            )
        self.at = pragma.end()
        return None

    def _remark(self) -> Token:
        end = self.text.index("\n", self.at)
        self.at = end
        return self._newline()

    def _newline(self) -> Token:
        token = self._token("_LINE", "\n")
        self._next_line()
        return token

    def _skip_blank(self, found: re.Match[str]) -> None:
        self.at = found.end()
        if found.group().endswith("\n"):  # an underscore at the end: the statement continues in the next line
            self._next_line()

    def _next_line(self) -> None:
        self.line += 1
        self.line_start = self.at

    def _token(self, kind: str, value: str, length: int | None = None) -> Token:
        line, column = self.place
        self.at += len(value) if length is None else length
        return Token(kind, value, line=line, column=column)

    def _stray(self) -> CompileError:
        sign = self.text[self.at]
        if sign == '"':
            return CompileError(tr("the string has no closing quotation mark"), self.place)
        shown = sign if sign.isprintable() else f"U+{ord(sign):04X}"
        return CompileError(tr("unexpected character {shown}", shown=shown), self.place)


def _normal(source: str) -> str:
    if len(source) > MAX_SOURCE:
        raise CompileError(
            tr("the program has more than {most} characters", most=MAX_SOURCE),
            (1, 1),
        )
    text = source.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > MAX_LINE or len(line.encode("utf-8", "replace")) > MAX_LINE:
            raise CompileError(tr("the line has more than {most} bytes", most=MAX_LINE), (number, 1))
    return text + "\n"
