"""Assignable expressions: how a value is stored in them, and how they are passed by reference (ByRef)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.code import WORLD, Evaluate, Frame, Recipe, maker
from orinkit.virtual.rc8.pacscript.errors import CompileError
from orinkit.virtual.rc8.pacscript.expression_compiler import ExpressionCompiler
from orinkit.virtual.rc8.pacscript.keywords import POINT_KINDS
from orinkit.virtual.rc8.pacscript.scope import BY_CLASS, TYPES_BY_NAME, TypeOf, global_class, split_number, unknown
from orinkit.virtual.rc8.pacscript.tree import Apply, Expression, GlobalRef, Name, Target
from orinkit.virtual.rc8.pacscript.values import AnyValue, rounded_to_integer, truth

Store: TypeAlias = Callable[[Frame, AnyValue], None]
"""Stores a value in the target of an assignment; the arguments are the frame and the value."""
Refer: TypeAlias = Callable[[Frame], tuple[Any, int]]
"""Locates a value: returns its container (a list, or an object with the same indexing) and its index there."""


class _Globals:
    """The global variables of a class as a list-like container, for passing by reference."""

    __slots__ = ("_convert", "_kind", "_world")

    def __init__(self, world: Any, kind: str) -> None:
        self._world = world
        self._kind = kind

    def __getitem__(self, index: int) -> AnyValue:
        value = self._world.read(self._kind, index)
        return tuple(value) if isinstance(value, tuple) else value

    def __setitem__(self, index: int, value: AnyValue) -> None:
        self._world.write(self._kind, index, value)


def as_target(node: Expression) -> Target:
    """Return an expression unchanged if it has the form of an assignment target.

    Raises:
        CompileError: If the expression is not a variable.
    """
    if isinstance(node, Name | Apply | GlobalRef):
        return node
    raise CompileError(tr("expected a variable"), node.at)


def store(expressions: ExpressionCompiler, target: Target) -> Recipe:
    """Return the recipe of a :data:`Store` that converts a value to the type of the target and stores it there.

    Raises:
        CompileError: If the target is not assignable.
    """
    local = _local(expressions, target)
    if local is None:
        return _store_global(expressions, target)
    kind, refer = local
    variable = expressions.scope.variable(_name_of(target).key)
    if variable is not None and not variable.sizes and not variable.by_ref:
        return put_local(variable.slot, kind.name)
    return put_referred(refer, kind.name)


def reference(expressions: ExpressionCompiler, node: Expression) -> tuple[TypeOf, Recipe] | None:
    """Return the type of a variable and the recipe of a :data:`Refer` that locates the variable.

    Return None for an expression that cannot be passed by reference.
    """
    if not isinstance(node, Name | Apply | GlobalRef):
        return None
    local = _local(expressions, node, strict=False)
    if local is not None:
        return local
    found = _global_of(expressions, node)
    if found is None or found[0] in POINT_KINDS:
        return None
    kind, index = found
    return BY_CLASS[kind], refer_to_global(kind, index)


def _local(expressions: ExpressionCompiler, target: Target, *, strict: bool = True) -> tuple[TypeOf, Recipe] | None:
    name = _name_of(target)
    if isinstance(target, GlobalRef):
        return None
    variable = expressions.scope.variable(name.key)
    if variable is None:
        if strict and expressions.scope.constant(name.key) is not None:
            raise CompileError(
                tr("the constant {name} cannot be changed", name=name.text),
                name.at,
            )
        return None
    if isinstance(target, Apply):
        if not variable.sizes:
            if strict:
                raise CompileError(tr("{name} is not an array", name=name.text), name.at)
            return None
        return variable.type, refer_to_element(variable.slot, expressions.element_offset(variable, target))
    if variable.sizes:
        raise CompileError(
            tr("{name} is an array; only an element can be used here", name=name.text),
            name.at,
        )
    return variable.type, refer_again(variable.slot) if variable.by_ref else refer_to_local(variable.slot)


def _store_global(expressions: ExpressionCompiler, target: Target) -> Recipe:
    found = _global_of(expressions, target)
    if found is None:
        raise unknown(_name_of(target), applied=isinstance(target, Apply))
    kind, index = found
    return put_point(kind, index) if kind in POINT_KINDS else put_global(kind, index)


def _global_of(expressions: ExpressionCompiler, target: Target) -> tuple[str, int | Recipe] | None:
    """Return class and index of a global variable, or None; the index is a number or the recipe of an expression."""
    if isinstance(target, GlobalRef):
        return global_class(target.name), expressions.value(target.index)
    return split_number(target.key) if isinstance(target, Name) else None


# --- the functions that store and locate values -----------------------------------------------------------------------


@maker
def put_local(slot: int, type_name: str) -> Store:
    """Return a function that sets a local variable."""
    convert = TYPES_BY_NAME[type_name].convert

    def put(f: Frame, value: AnyValue) -> None:
        f[slot] = convert(value)

    return put


@maker
def put_referred(refer: Refer, type_name: str) -> Store:
    """Return a function that sets a located variable."""
    convert = TYPES_BY_NAME[type_name].convert

    def put(f: Frame, value: AnyValue) -> None:
        holder, key = refer(f)
        holder[key] = convert(value)

    return put


@maker
def put_global(kind: str, index: int | Evaluate) -> Store:
    """Return a function that sets a global variable."""
    convert = BY_CLASS[kind].convert
    at = _whole(index)

    def put(f: Frame, value: AnyValue) -> None:
        f[0].write(kind, at(f), convert(value))

    return put


@maker
def put_point(kind: str, index: int | Evaluate) -> Store:
    """Return a function that sets an I/O point or a group of points."""
    at = _whole(index)

    def put_bit(f: Frame, value: AnyValue) -> None:
        f[0].write_io(kind, at(f), 1 if truth(value) else 0)

    def put(f: Frame, value: AnyValue) -> None:
        f[0].write_io(kind, at(f), rounded_to_integer(value))

    return put_bit if kind == "IO" else put


@maker
def refer_to_local(slot: int) -> Refer:
    """Return a function that locates a local variable."""
    return lambda f: (f, slot)


@maker
def refer_again(slot: int) -> Refer:
    """Return a function that locates the variable to which a parameter refers."""
    return lambda f: f[slot]


@maker
def refer_to_element(slot: int, place: Callable[[Frame], int]) -> Refer:
    """Return a function that locates an element of an array."""
    return lambda f: (f[slot], place(f))


@maker
def refer_to_global(kind: str, index: int | Evaluate) -> Refer:
    """Return a function that locates a global variable."""
    at = _whole(index)
    return lambda f: (_Globals(f[WORLD], kind), at(f))


def _whole(index: int | Evaluate) -> Callable[[Frame], int]:
    if isinstance(index, int):
        return lambda _: index
    return lambda f: rounded_to_integer(index(f))


def _name_of(target: Target) -> Name:
    return target if isinstance(target, Name) else target.name
