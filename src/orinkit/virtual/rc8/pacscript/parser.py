"""Parser: converts the source to statements."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import Any, Final, cast

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedToken

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript import tree
from orinkit.virtual.rc8.pacscript.errors import CompileError, ProgramLoadError
from orinkit.virtual.rc8.pacscript.grammar import GRAMMAR
from orinkit.virtual.rc8.pacscript.keywords import canonical
from orinkit.virtual.rc8.pacscript.lexer import PacScriptLexer, tokens
from orinkit.virtual.rc8.pacscript.tree import Expression, Place, Statement, depth_over

_INTEGER_BITS: Final = 32
_LONGEST_INTEGER: Final = 10
_LARGEST: Final = 2**31 - 1

#: Tokens that may be missing at a syntax error. The message suggests the first one that is allowed at the position.
_MISSING: Final = (
    ("THEN", "Then"), ("TO", "To"), ("_CLOSE", ")"), ("_CLOSE_INDEX", "]"), ("_COMMA", ","),
)  # fmt: skip


def parse(source: str, file: str) -> tuple[Statement, ...]:
    """Return the statements of a program; see :func:`parse_lines`."""
    return tuple(statement for line in parse_lines(source, file) for statement in line)


def parse_lines(source: str, file: str) -> Iterator[tuple[Statement, ...]]:
    """Yield the statements of a program, one line after the other; lines without statements are omitted.

    A statement never extends beyond its line, except with ``_`` at the end of the line.

    Args:
        source: Source; at most 256 Ki characters, at most 1,024 bytes in a line.
        file: Name of the file, for errors.

    Raises:
        ProgramLoadError: If the source has a syntax error or an unsupported statement.
    """
    begin = _lark().parse_interactive
    parser: Any = begin()  # lark's methods have no types
    try:
        for token in tokens(source):
            parser.feed_token(token)
            if token.type == "_LINE":
                statements = cast("tuple[Statement, ...]", parser.feed_eof(token))
                if statements:
                    yield statements
                parser = begin()
    except UnexpectedToken as error:
        line, column = _place(error.token)
        raise ProgramLoadError(_unexpected(error, parser), file, line, column) from None
    except CompileError as error:
        raise ProgramLoadError(error.message, file, *error.at) from None


def prepare() -> None:
    """Build the parser, which takes 0.1 s; otherwise it is built when the first program is loaded."""
    _lark()


@cache
def _lark() -> Lark:
    return Lark(GRAMMAR, parser="lalr", lexer=PacScriptLexer, transformer=_Builder(), maybe_placeholders=True)


def _place(token: Token) -> Place:
    return Place(token.line or 1, token.column or 1)


def _unexpected(error: UnexpectedToken, parser: Any) -> str:
    token = cast("Token", error.token)
    possible = parser.accepts()  # not error.expected, which includes tokens that are not allowed at this position
    missing = next((shown for name, shown in _MISSING if name in possible), "")
    if token.type in ("_LINE", "$END"):
        problem = tr("unexpected end of line")
    else:
        problem = tr("unexpected {word}", word=_shorten(token))
    if missing and token.type != "LABEL":
        return tr('{problem}; "{missing}" may be missing', problem=problem, missing=missing)
    return problem


def _shorten(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


@v_args(inline=True)
class _Builder(Transformer[Token, Any]):
    """Creates the nodes of the syntax tree during parsing, without recursion."""

    # --- the program and its routines

    def start(self, *entries: Statement) -> tuple[Statement, ...]:
        return entries

    def label(self, name: Token) -> tree.Label:
        return tree.Label(_place(name), _name(name))

    def sub(self, word: Token, name: Token, parameters: tuple[tree.Parameter, ...] = ()) -> tree.Routine:
        return tree.Routine(_place(word), "Sub", _name(name), parameters, None)

    def function(self, word: Token, name: Token, *rest: Any) -> tree.Routine:
        parameters = next((part for part in rest if isinstance(part, tuple)), ())
        return tree.Routine(_place(word), "Function", _name(name), parameters, _optional_name(rest[-1]))

    def parameters(self, *items: tree.Parameter | None) -> tuple[tree.Parameter, ...]:
        return tuple(item for item in items if item is not None)

    def parameter(self, mode: Token | None, name: Token, _: Token | None, kind: Token | None) -> tree.Parameter:
        return tree.Parameter(_name(name), canonical(mode) if mode else "", _optional_name(kind))

    def declare(self, word: Token, *items: tree.Declared) -> tree.Declare:
        return tree.Declare(_place(word), items, word.type == "PUBLIC")

    def declared(self, name: Token, sizes: Any, _: Any, kind: Token | None, __: Any, value: Any) -> tree.Declared:
        return tree.Declared(_name(name), sizes or (), _optional_name(kind), value)

    def sizes(self, *items: Expression) -> tuple[Expression, ...]:
        return items

    def constants(self, word: Token, *items: tree.Constant) -> tree.Constants:
        return tree.Constants(_place(word), items)

    def constant(self, name: Token, _: Any, kind: Token | None, __: Token, value: Expression) -> tree.Constant:
        return tree.Constant(_name(name), _optional_name(kind), value)

    # --- flow

    def marker(self, word: Token) -> tree.KeywordStatement:
        return tree.KeywordStatement(
            _place(word), str(word) if " " in word else _MARKERS.get(word.type, canonical(word))
        )

    lone = marker
    leave = marker

    def if_(self, word: Token, condition: Expression, _: Token) -> tree.If:
        return tree.If(_place(word), "If", condition)

    def else_if(self, word: Token, condition: Expression, _: Token) -> tree.If:
        return tree.If(_place(word), "ElseIf", condition)

    def if_line(self, word: Token, condition: Expression, _: Token, *branches: Any) -> tree.IfLine:
        return tree.IfLine(_place(word), condition, branches[0], branches[-1] or ())

    def inline(self, *statements: Statement) -> tuple[Statement, ...]:
        return statements

    def for_(self, word: Token, target: tree.Target, *parts: Any) -> tree.For:
        _, first, _, last, _, step = parts
        return tree.For(_place(word), target, first, last, step)

    def next_(self, word: Token, target: tree.Target | None) -> tree.Next:
        return tree.Next(_place(word), target)

    def do(self, word: Token, test: tree.Test | None) -> tree.Loop:
        return tree.Loop(_place(word), "Do", test)

    def loop(self, word: Token, test: tree.Test | None) -> tree.Loop:
        return tree.Loop(_place(word), "Loop", test)

    def while_(self, word: Token, condition: Expression) -> tree.Loop:
        return tree.Loop(_place(word), "While", tree.Test(until=False, condition=condition))

    def test(self, word: Token, condition: Expression) -> tree.Test:
        return tree.Test(word.type == "UNTIL", condition)

    def select(self, word: Token, value: Expression) -> tree.Select:
        return tree.Select(_place(word), value)

    def case(self, word: Token, *items: tree.CaseItem) -> tree.Case:
        return tree.Case(_place(word), items)

    def case_value(self, value: Expression) -> tree.CaseItem:
        return tree.CaseItem("EQUAL", value)

    def case_range(self, low: Expression, _: Token, high: Expression) -> tree.CaseItem:
        return tree.CaseItem("TO", low, high)

    def case_relation(self, _: Token, relation: Token, value: Expression) -> tree.CaseItem:
        return tree.CaseItem(relation.type, value)

    def relation(self, sign: Token) -> Token:
        return sign

    def jump(self, word: Token, label: Token) -> tree.Jump:
        return tree.Jump(_place(word), "Goto" if word.type == "GOTO" else "Gosub", _name(label))

    # --- simple statements

    def assign(self, _: Token | None, target: tree.Target, __: Token, value: Expression) -> tree.Assign:
        return tree.Assign(target.at, target, value)

    def call(self, word: Token | None, target: tree.Target) -> tree.Call:
        at = _place(word) if word else target.at
        if isinstance(target, tree.Apply):
            return tree.Call(at, target.name, target.arguments)
        return tree.Call(at, target, ())

    def call_values(self, target: tree.Target, values: tuple[Expression, ...]) -> tree.Call:
        return tree.Call(target.at, target, values)

    def call_more(self, target: tree.Target, values: tuple[Expression, ...]) -> tree.Call:
        if isinstance(target, tree.Apply) and len(target.arguments) == 1:
            return tree.Call(target.at, target.name, (*target.arguments, *values))
        raise CompileError(tr("unexpected comma"), target.at)

    def motion(self, word: Token, *items: tree.Item) -> tree.Motion:
        return tree.Motion(_place(word), canonical(word), items)

    def item(self, mark: tree.PassMarkNode | None, value: Expression, extra: tree.ExtraJoints | None) -> tree.Item:
        return tree.Item(mark.at if mark else value.at, mark, value, extra)

    def item_next(self, word: Token) -> tree.Item:
        return tree.Item(_place(word), None, None, None)

    def mark(self, what: Any) -> tree.PassMarkNode:
        if isinstance(what, Token):
            at = _place(what)
            if what.type == "NUMBER":
                return tree.PassMarkNode(at, "n", tree.Literal(at, _number(what)))
            if what.upper() in ("P", "E"):
                return tree.PassMarkNode(at, what.upper(), None)
        elif not isinstance(what, tree.JointValue):
            return tree.PassMarkNode(what.at, "n", what)
        raise CompileError(
            tr("a pass mark must be @0, @P, @E or @ with a radius in mm"),
            _place(what) if isinstance(what, Token) else what.at,
        )

    def extra(self, word: Token, values: tuple[Expression, ...]) -> tree.ExtraJoints:
        return tree.ExtraJoints(_place(word), word.upper() == "EXA", values)

    def command(self, word: Token, values: tuple[Expression, ...] | None) -> tree.Command:
        return tree.Command(_place(word), canonical(word), values or ())

    def takearm(self, word: Token, group: Expression | None, keep: Expression | None) -> tree.TakeArm:
        return tree.TakeArm(_place(word), group, keep)

    def keep(self, _: Token, __: Token, value: Expression) -> Expression:
        return value

    def point(self, word: Token, target: tree.Target) -> tree.SetOutput:
        return tree.SetOutput(_place(word), word.lower() == "set", target)

    def letpart(self, word: Token, target: tree.Target, _: Token, value: Expression) -> tree.LetPart:
        return tree.LetPart(_place(word), canonical(word), None, target, value)

    def letjoint(self, word: Token, joint: Expression, target: tree.Target, _: Token, value: Any) -> tree.LetPart:
        return tree.LetPart(_place(word), canonical(word), joint, target, value)

    # --- expressions

    def name(self, word: Token) -> tree.Name:
        return _name(word)

    def apply(self, word: Token, values: tuple[Expression, ...] | None) -> tree.Apply:
        return tree.Apply(_name(word), values or (), depth_over(_place(word), *(values or ())))

    def index(self, word: Token, value: Expression) -> tree.GlobalRef:
        return tree.GlobalRef(_name(word), value, depth_over(_place(word), value))

    def values(self, *items: Expression) -> tuple[Expression, ...]:
        return items

    def unary(self, sign: Token, operand: Expression) -> tree.Unary:
        at = _place(sign)
        return tree.Unary(at, sign.type, operand, depth_over(at, operand))

    def binary(self, left: Expression, sign: Token, right: Expression) -> tree.Binary:
        return tree.Binary(_place(sign), sign.type, left, right, depth_over(_place(sign), left, right))

    def group(self, value: Expression) -> Expression:
        return value

    def listed(self, *items: Expression) -> tree.JointValue:
        return tree.JointValue(items[0].at, items, depth_over(items[0].at, *items))

    def number(self, token: Token) -> tree.Literal:
        return tree.Literal(_place(token), _number(token))

    def text(self, token: Token) -> tree.Literal:
        return tree.Literal(_place(token), token[1:-1].replace('""', '"'))


_MARKERS: Final = {"END_IF": "End If", "WEND": "Wend", "ELSE": "Else", "RETURN": "Return", "END": "End"}


def _name(token: Token) -> tree.Name:
    return tree.Name(_place(token), str(token))


def _optional_name(token: Token | None) -> tree.Name | None:
    return None if token is None else _name(token)


def _number(token: Token) -> int | float:
    text = token.lower()
    if text.startswith("&"):
        bits = int(text[2:], 16 if text[1] == "h" else 2)
        if bits >> _INTEGER_BITS == 0:
            return bits - (bits >> _INTEGER_BITS - 1 << _INTEGER_BITS)
    elif text.isdigit() and len(text) <= _LONGEST_INTEGER and int(text) <= _LARGEST:
        return int(text)
    else:
        value = float(text)
        if math.isfinite(value):
            return value
    raise CompileError(tr("{token} is too large", token=_shorten(token)), _place(token))
