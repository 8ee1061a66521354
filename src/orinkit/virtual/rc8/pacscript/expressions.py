"""Compiles each expression to the recipe of a function that evaluates it in a frame.

A call of a Function of the program is compiled to separate instructions before the statement that contains the call.
They store the result of the call in a slot of the frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript import functions, values
from orinkit.virtual.rc8.pacscript.calls import emit_call
from orinkit.virtual.rc8.pacscript.code import Code, Evaluate, Frame, Recipe, build, maker
from orinkit.virtual.rc8.pacscript.errors import CompileError
from orinkit.virtual.rc8.pacscript.functions import Function
from orinkit.virtual.rc8.pacscript.keywords import POINT_KINDS
from orinkit.virtual.rc8.pacscript.scope import (
    Routine,
    Scope,
    Variable,
    check_count,
    global_class,
    split_number,
    unknown,
)
from orinkit.virtual.rc8.pacscript.tree import (
    Apply,
    Binary,
    Expression,
    GlobalRef,
    JointValue,
    Literal,
    Name,
    Place,
    Unary,
)
from orinkit.virtual.rc8.pacscript.values import AnyValue, rounded_to_integer, truth

_OPERATORS: Final[Mapping[str, Callable[[AnyValue, AnyValue], AnyValue]]] = {
    "PLUS": values.add,
    "MINUS": values.subtract,
    "STAR": values.multiply,
    "SLASH": values.divide,
    "BACKSLASH": values.divide_whole,
    "MOD": values.remainder,
    "CARET": values.power,
    "AMPERSAND": values.join,
    "LEFTWARDS": values.shift,
    "RIGHTWARDS": lambda value, count: values.shift(value, -rounded_to_integer(count)),
    "AND": lambda left, right: rounded_to_integer(left) & rounded_to_integer(right),
    "OR": lambda left, right: rounded_to_integer(left) | rounded_to_integer(right),
    "XOR": lambda left, right: rounded_to_integer(left) ^ rounded_to_integer(right),
}
RELATIONS: Final[Mapping[str, Callable[[AnyValue, AnyValue], bool]]] = {
    "EQUAL": values.equal,
    "UNLIKE": lambda left, right: not values.equal(left, right),
    "LESS": values.less,
    "MORE": lambda left, right: values.less(right, left),
    "AT_MOST": lambda left, right: not values.less(right, left),
    "AT_LEAST": lambda left, right: not values.less(left, right),
}
"""Comparison operators by the name of their token."""

_BITWISE: Final = frozenset(("AND", "OR", "XOR"))
_POINT_COMPARED: Final = frozenset(("EQUAL", "UNLIKE"))


@dataclass(frozen=True, slots=True)
class Compiled:
    """An expression that can be evaluated.

    Attributes:
        run: Recipe of a function that evaluates the expression.
        logical: True if the value is a truth value: -1 or 0; for an I/O point, 1 or 0.
        point: True if the expression is an I/O point.
        constant: The value of a constant expression, else None.
    """

    run: Recipe
    logical: bool = False
    point: bool = False
    constant: AnyValue = None


class Expressions:
    """Compiles the expressions of a program.

    Attributes:
        polled: True while the condition of Wait is compiled. The condition cannot call Functions of the program,
            because it is evaluated repeatedly.
    """

    def __init__(self, scope: Scope, code: Code) -> None:
        self.scope = scope
        self.code = code
        self.polled = False

    def compile(self, node: Expression) -> Compiled:
        """Compile an expression.

        Raises:
            CompileError: If a name is not declared, the number of arguments of a call is wrong, or a function is not
                supported.
        """
        match node:
            case Literal():
                return constant(node.value)
            case Name():
                return self._name(node)
            case GlobalRef():
                return self._index(node)
            case Apply():
                return self._apply(node)
            case Unary():
                return self._unary(node)
            case Binary():
                return self._binary(node)
            case JointValue():
                raise CompileError(tr("a list in parentheses is not allowed here"), node.at)

    def value(self, node: Expression) -> Recipe:
        """Return the recipe of a function that evaluates an expression."""
        return self.compile(node).run

    def condition(self, node: Expression) -> Recipe:
        """Return the recipe of a function that returns True if a condition is met."""
        compiled = self.compile(node)
        return compiled.run if compiled.logical else is_met(compiled.run)

    def known(self, node: Expression) -> AnyValue:
        """Return the value of a constant expression.

        Raises:
            CompileError: If the expression is not constant.
        """
        compiled = self.compile(node)
        if compiled.constant is None:
            raise CompileError(tr("expected a constant"), node.at)
        return compiled.constant

    def call(self, routine: Routine, at: Place, arguments: tuple[Expression, ...], *, result: bool) -> int:
        """Emit the call of a Sub or Function.

        Returns:
            The index in the caller's frame at which the result is stored; -1 if the result is not used.
        """
        if self.polled:
            raise CompileError(
                tr("{name} cannot be called in the condition of Wait", name=routine.name.text),
                at,
            )
        return emit_call(self, routine, at, arguments, result=result)

    def element_offset(self, variable: Variable, node: Apply) -> Recipe:
        """Return the recipe of a function that calculates the position of an array element in the list of the array."""
        check_count(node.name, len(node.arguments), len(variable.sizes), len(variable.sizes))
        return offset(variable.name, variable.sizes, tuple(map(self.value, node.arguments)))

    # --- names

    def _name(self, node: Name) -> Compiled:
        variable = self.scope.variable(node.key)
        if variable is not None:
            return self._variable(variable, node)
        known = self.scope.constant(node.key)
        if known is not None:
            return constant(known, logical=node.key in ("true", "false"))
        numbered = split_number(node.key)
        if numbered is not None:
            return read_global(*numbered)
        if node.key in functions.FUNCTIONS:
            return self._function(functions.FUNCTIONS[node.key], node, ())
        routine = self.scope.routines.get(node.key)
        if routine is not None:
            return self._routine(routine, node, ())
        raise unknown(node, applied=False)

    def _variable(self, variable: Variable, node: Name) -> Compiled:
        slot = variable.slot
        if variable.sizes:
            raise CompileError(
                tr("{name} is an array. Try: an element, {name}(0)", name=node.text),
                node.at,
            )
        return Compiled(referenced(slot) if variable.by_ref else local(slot))

    def _index(self, node: GlobalRef) -> Compiled:
        kind = global_class(node.name)
        index = self.compile(node.index)
        if index.constant is not None:
            return read_global(kind, whole_at(index.constant, node.index.at))
        return read_global(kind, index.run)

    def _apply(self, node: Apply) -> Compiled:
        key = node.name.key
        variable = self.scope.variable(key)
        if variable is not None and variable.sizes:
            return Compiled(element(variable.slot, self.element_offset(variable, node)))
        function = functions.POSES.get(key) or functions.FUNCTIONS.get(key)
        if function is not None:
            return self._function(function, node.name, node.arguments)
        routine = self.scope.routines.get(key)
        if routine is not None:
            return self._routine(routine, node.name, node.arguments)
        raise unknown(node.name, applied=True)

    def _function(self, function: Function, name: Name, arguments: tuple[Expression, ...]) -> Compiled:
        check_count(name, len(arguments), function.least, function.most)
        compiled = [self.compile(argument) for argument in arguments]
        run = called(function.name.lower(), tuple(one.run for one in compiled))
        if not function.framed and all(one.constant is not None for one in compiled):
            return folded(run)
        return Compiled(run)

    def _routine(self, routine: Routine, name: Name, arguments: tuple[Expression, ...]) -> Compiled:
        if routine.result is None:
            raise CompileError(tr("{name} is a Sub and returns no value", name=name.text), name.at)
        return Compiled(local(self.call(routine, name.at, arguments, result=True)))

    # --- operators

    def _unary(self, node: Unary) -> Compiled:
        operand = self.compile(node.operand)
        if node.operator == "NOT" and operand.logical:
            return Compiled(logical_not(operand.run), logical=True)
        result = unary(node.operator, operand.run)
        return folded(result) if operand.constant is not None else Compiled(result)

    def _binary(self, node: Binary) -> Compiled:
        left, right = self.compile(node.left), self.compile(node.right)
        if node.operator in RELATIONS:
            return self._relation(node.operator, left, right)
        logical = node.operator in _BITWISE and left.logical and right.logical
        if right.constant is None:
            return Compiled(binary(node.operator, left.run, right.run), logical)
        result = binary_with_constant(node.operator, left.run, right.constant)
        return Compiled(result, logical) if left.constant is None else folded(result, logical=logical)

    def _relation(self, operator: str, left: Compiled, right: Compiled) -> Compiled:
        if operator in _POINT_COMPARED and (left.point or right.point):  # an I/O point that is on equals True and On
            return Compiled(same_state(operator == "EQUAL", left.run, right.run), logical=True)
        return Compiled(relation(operator, left.run, right.run), logical=True)


def constant(value: AnyValue, *, logical: bool = False) -> Compiled:
    """Return a value as a constant expression; ``logical`` is True for a truth value."""
    return Compiled(fixed(value), logical, constant=value)


def folded(run: Recipe, *, logical: bool = False) -> Compiled:
    """Calculate a value from constants at compile time, and return it as a constant expression.

    If the calculation fails, return an expression that raises the error at run time.
    """
    try:
        return constant(build(run)([]), logical=logical)
    except CallError:
        return Compiled(run, logical)


def read_global(kind: str, index: int | Recipe) -> Compiled:
    """Return an expression that reads a global variable or I/O point, given by its class and index."""
    if kind in POINT_KINDS:
        is_bit = kind == "IO"
        return Compiled(point_state(kind, index), logical=is_bit, point=is_bit)
    return Compiled(global_variable(kind, index))


# --- the functions that evaluate expressions --------------------------------------------------------------------------


@maker
def fixed(value: AnyValue) -> Evaluate:
    """Return a function that returns a constant."""
    return lambda _: value


@maker
def is_met(value: Evaluate) -> Callable[[Frame], bool]:
    """Return a function that returns True if a value is a number other than 0."""
    return lambda f: truth(value(f))


@maker
def local(slot: int) -> Evaluate:
    """Return a function that reads a local variable."""
    return itemgetter(slot)


@maker
def referenced(slot: int) -> Evaluate:
    """Return a function that reads a parameter passed by reference."""

    def run(f: Frame) -> Any:
        holder, key = f[slot]
        return holder[key]

    return run


@maker
def element(slot: int, place: Callable[[Frame], int]) -> Evaluate:
    """Return a function that reads an element of an array."""
    return lambda f: f[slot][place(f)]


@maker
def offset(name: str, sizes: tuple[int, ...], indices: tuple[Evaluate, ...]) -> Callable[[Frame], int]:
    """Return a function that calculates the position of an array element in the list that stores the array."""
    if len(indices) == 1:
        (only,), (size,) = indices, sizes

        def offset_of_one(f: Frame) -> int:
            index = rounded_to_integer(only(f))
            return index if 0 <= index < size else _raise_bad_index(name, sizes, index)

        return offset_of_one
    pairs = tuple(zip(indices, sizes, strict=True))

    def offset_of_many(f: Frame) -> int:
        place = 0
        for run, size in pairs:
            index = rounded_to_integer(run(f))
            place = place * size + (index if 0 <= index < size else _raise_bad_index(name, sizes, index))
        return place

    return offset_of_many


@maker
def called(key: str, runs: tuple[Evaluate, ...]) -> Evaluate:
    """Return a function that calls a built-in function, given by its name in lower case."""
    function = functions.POSES.get(key) or functions.FUNCTIONS[key]
    run = function.run
    if function.framed:
        return lambda f: run(f, *[one(f) for one in runs])
    if len(runs) == 1:
        only = runs[0]
        return lambda f: run(only(f))
    return lambda f: run(*[one(f) for one in runs])


@maker
def logical_not(value: Evaluate) -> Evaluate:
    """Return a function that inverts a truth value."""
    return lambda f: 0 if value(f) else -1


@maker
def unary(operator: str, value: Evaluate) -> Evaluate:
    """Return a function that applies a unary operator."""
    if operator == "NOT":
        return lambda f: ~rounded_to_integer(value(f))
    if operator == "MINUS":
        return lambda f: values.negate(value(f))
    return lambda f: values.number(value(f))


@maker
def binary(operator: str, first: Evaluate, second: Evaluate) -> Evaluate:
    """Return a function that applies a binary operator, except a comparison."""
    operate = _OPERATORS[operator]
    return lambda f: operate(first(f), second(f))


@maker
def binary_with_constant(operator: str, first: Evaluate, second: AnyValue) -> Evaluate:
    """Return a function that applies a binary operator to a value and a constant."""
    operate = _OPERATORS[operator]
    return lambda f: operate(first(f), second)


@maker
def relation(operator: str, first: Evaluate, second: Evaluate) -> Evaluate:
    """Return a function that compares two values."""
    compare = RELATIONS[operator]
    return lambda f: -1 if compare(first(f), second(f)) else 0


@maker
def same_state(equal: bool, first: Evaluate, second: Evaluate) -> Evaluate:
    """Return a function that compares the states of I/O points."""
    if equal:
        return lambda f: -1 if truth(first(f)) is truth(second(f)) else 0
    return lambda f: 0 if truth(first(f)) is truth(second(f)) else -1


@maker
def global_variable(kind: str, index: int | Evaluate) -> Evaluate:
    """Return a function that reads a global variable."""
    if kind in ("V", "P", "J", "T"):
        if isinstance(index, int):
            return lambda f: tuple(f[0].read(kind, index))
        return lambda f: tuple(f[0].read(kind, rounded_to_integer(index(f))))
    if isinstance(index, int):
        return lambda f: f[0].read(kind, index)
    return lambda f: f[0].read(kind, rounded_to_integer(index(f)))


@maker
def point_state(kind: str, index: int | Evaluate) -> Evaluate:
    """Return a function that reads an I/O point or a group of points."""
    is_bit = kind == "IO"
    if isinstance(index, int):
        if is_bit:
            return lambda f: 1 if f[0].read_io(kind, index) else 0
        return lambda f: f[0].read_io(kind, index)
    if is_bit:
        return lambda f: 1 if f[0].read_io(kind, rounded_to_integer(index(f))) else 0
    return lambda f: f[0].read_io(kind, rounded_to_integer(index(f)))


def whole_at(value: AnyValue, at: Place) -> int:
    """Return a constant, rounded to a whole number of 32 bits.

    Raises:
        CompileError: If the constant is not a number, or if it exceeds 32 bits.
    """
    try:
        return rounded_to_integer(value)
    except CallError as error:
        raise CompileError(error.detail, at) from None


def _raise_bad_index(name: str, sizes: tuple[int, ...], index: int) -> int:
    """Raise the error for an index outside of an array.

    Raises:
        CallError: DISP_E_BADINDEX.
    """
    ranges = ", ".join(f"0..{size - 1}" for size in sizes)
    raise error_for(
        hresult.DISP_E_BADINDEX,
        tr("index {index} of {name} is out of range: {sizes}", index=index, name=name, sizes=ranges),
    )
