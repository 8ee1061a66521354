"""The syntax tree of a program: expressions as trees, statements as a flat list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, TypeAlias

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.errors import CompileError

MAX_DEPTH: Final = 100
"""Maximum nesting depth of an expression."""


class Place(NamedTuple):
    """A position in the source; line and column are counted from 1."""

    line: int
    column: int


# --- expressions ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Literal:
    """A number or a string literal."""

    at: Place
    value: int | float | str
    depth: ClassVar[int] = 1


@dataclass(frozen=True, slots=True)
class Name:
    """A word: a variable, a constant, a function without arguments, ``P1``, ``IO128``."""

    at: Place
    text: str
    depth: ClassVar[int] = 1

    @property
    def key(self) -> str:
        """The word in lower case, because names are case-insensitive."""
        return self.text.lower()


@dataclass(frozen=True, slots=True)
class _Named:
    """An expression that begins with a name."""

    name: Name

    @property
    def at(self) -> Place:
        """The position of the name."""
        return self.name.at


@dataclass(frozen=True, slots=True)
class Apply(_Named):
    """``name(...)``: an element of an array, a pose, or a call of a function."""

    arguments: tuple[Expression, ...]
    depth: int


@dataclass(frozen=True, slots=True)
class GlobalRef(_Named):
    """``name[...]``: a global variable or an I/O point."""

    index: Expression
    depth: int


@dataclass(frozen=True, slots=True)
class Unary:
    """``-x``, ``+x``, ``Not x``; ``operator`` is the name of the token of the operator."""

    at: Place
    operator: str
    operand: Expression
    depth: int


@dataclass(frozen=True, slots=True)
class Binary:
    """``x + y`` or another operation with two operands; ``operator`` is the name of the token of the operator."""

    at: Place
    operator: str
    left: Expression
    right: Expression
    depth: int


@dataclass(frozen=True, slots=True)
class JointValue:
    """``(x, y)``: a joint and its value, as an argument of a motion."""

    at: Place
    items: tuple[Expression, ...]
    depth: int


Expression: TypeAlias = Literal | Name | Apply | GlobalRef | Unary | Binary | JointValue
"""An expression; all except :class:`JointValue` have a value."""
Target: TypeAlias = Name | Apply | GlobalRef
"""An expression with the form of an assignment target; the compiler checks that it is assignable."""


def depth_over(at: Place, *parts: Expression) -> int:
    """Return the nesting depth of an expression that consists of these parts.

    Raises:
        CompileError: If the depth exceeds MAX_DEPTH.
    """
    depth = 1 + max((part.depth for part in parts), default=0)
    if depth > MAX_DEPTH:
        raise CompileError(tr("the expression is nested too deeply"), at)
    return depth


# --- statements -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a Sub or Function; ``mode`` is ``"ByRef"``, ``"ByVal"`` or ``""``."""

    name: Name
    mode: str
    type: Name | None


@dataclass(frozen=True, slots=True)
class Routine:
    """``Sub name(...)`` or ``Function name(...) As type``; ``word`` is ``"Sub"`` or ``"Function"``."""

    at: Place
    word: str
    name: Name
    parameters: tuple[Parameter, ...]
    result: Name | None


@dataclass(frozen=True, slots=True)
class KeywordStatement:
    """A statement that consists only of a keyword: ``End Sub``, ``Else``, ``Exit For``, ``Return`` ..."""

    at: Place
    word: str


@dataclass(frozen=True, slots=True)
class Label:
    """``*name:`` or ``name:``."""

    at: Place
    name: Name


@dataclass(frozen=True, slots=True)
class Declared:
    """A variable in a Dim."""

    name: Name
    sizes: tuple[Expression, ...]
    type: Name | None
    value: Expression | None


@dataclass(frozen=True, slots=True)
class Declare:
    """``Dim a As Integer, b(3) As Position``; ``public`` is True for ``Public a As Integer``."""

    at: Place
    items: tuple[Declared, ...]
    public: bool = False


@dataclass(frozen=True, slots=True)
class Constant:
    """A name in a Const."""

    name: Name
    type: Name | None
    value: Expression


@dataclass(frozen=True, slots=True)
class Constants:
    """``Const a = 1, b = 2``."""

    at: Place
    items: tuple[Constant, ...]


@dataclass(frozen=True, slots=True)
class Assign:
    """``target = value``."""

    at: Place
    target: Target
    value: Expression


@dataclass(frozen=True, slots=True)
class Call:
    """``Call name(...)``, ``name(...)`` or ``name ...``."""

    at: Place
    target: Target
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Jump:
    """``Goto *label`` or ``Gosub *label``."""

    at: Place
    word: str
    label: Name


@dataclass(frozen=True, slots=True)
class PassMarkNode:
    """A pass mark: ``@P``, ``@E``, ``@0`` or ``@10``; ``radius`` in mm if the mode is ``"n"``, otherwise ``None``."""

    at: Place
    mode: str
    radius: Expression | None


@dataclass(frozen=True, slots=True)
class ExtraJoints:
    """``Ex(...)``, or ``ExA(...)`` if absolute."""

    at: Place
    absolute: bool
    items: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Item:
    """One comma-separated argument of a motion; ``value`` is None for ``Next``."""

    at: Place
    mark: PassMarkNode | None
    value: Expression | None
    extra: ExtraJoints | None


@dataclass(frozen=True, slots=True)
class Motion:
    """``Move P, @E P1, Speed = 50, Next`` and the other motions."""

    at: Place
    word: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class Command:
    """A command that has no class of its own, with its arguments: ``Delay 100``."""

    at: Place
    word: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class TakeArm:
    """``TakeArm [group] [Keep = value]``."""

    at: Place
    group: Expression | None
    keep: Expression | None


@dataclass(frozen=True, slots=True)
class SetOutput:
    """``Set IO[128]`` or ``Reset IO[128]``."""

    at: Place
    on: bool
    target: Target


@dataclass(frozen=True, slots=True)
class LetPart:
    """``LetX P1 = 5`` and similar commands; ``joint`` is None except for LetJ."""

    at: Place
    word: str
    joint: Expression | None
    target: Target
    value: Expression


@dataclass(frozen=True, slots=True)
class If:
    """``If condition Then`` at the end of a line, or ``ElseIf condition Then``."""

    at: Place
    word: str
    condition: Expression


@dataclass(frozen=True, slots=True)
class IfLine:
    """``If condition Then a : b Else c`` on one line."""

    at: Place
    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class For:
    """``For target = first To last Step step``."""

    at: Place
    target: Target
    first: Expression
    last: Expression
    step: Expression | None


@dataclass(frozen=True, slots=True)
class Next:
    """``Next [target]``."""

    at: Place
    target: Target | None


@dataclass(frozen=True, slots=True)
class Test:
    """``While condition`` or ``Until condition``."""

    until: bool
    condition: Expression


@dataclass(frozen=True, slots=True)
class Loop:
    """``Do [test]``, ``Loop [test]`` or ``While condition``; ``word`` is the keyword."""

    at: Place
    word: str
    test: Test | None


@dataclass(frozen=True, slots=True)
class Select:
    """``Select Case value``."""

    at: Place
    value: Expression


@dataclass(frozen=True, slots=True)
class CaseItem:
    """``value``, ``low To high`` or ``Is < value``.

    ``relation`` is ``"EQUAL"`` for a value, ``"TO"`` for a range, otherwise the name of the token after ``Is``.
    """

    relation: str
    value: Expression
    high: Expression | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """``Case item, item``."""

    at: Place
    items: tuple[CaseItem, ...]


Statement: TypeAlias = (
    Routine | KeywordStatement | Label | Declare | Constants | Assign | Call | Jump | Motion | Command | TakeArm | SetOutput
    | LetPart | If | IfLine | For | Next | Loop | Select | Case
)  # fmt: skip
"""A statement, or the opening or closing line of a block."""
