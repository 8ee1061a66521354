"""Assignable expressions: how a value is stored in them, and how they are passed by reference (ByRef)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.code import WORLD, Frame
from orinkit.virtual.rc8.pacscript.errors import CompileError
from orinkit.virtual.rc8.pacscript.expression_compiler import ExpressionCompiler
from orinkit.virtual.rc8.pacscript.keywords import POINT_KINDS
from orinkit.virtual.rc8.pacscript.scope import BY_CLASS, TypeOf, global_class, split_number, unknown
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


def store(expressions: ExpressionCompiler, target: Target) -> Store:
    """Return a function that converts a value to the type of the target and stores it there.

    Raises:
        CompileError: If the target is not assignable.
    """
    local = _local(expressions, target)
    if local is None:
        return _store_global(expressions, target)
    kind, refer = local
    convert = kind.convert
    variable = expressions.scope.variable(_name_of(target).key)
    if variable is not None and not variable.sizes and not variable.by_ref:
        slot = variable.slot

        def put(f: Frame, value: AnyValue) -> None:
            f[slot] = convert(value)

        return put

    def put_there(f: Frame, value: AnyValue) -> None:
        holder, key = refer(f)
        holder[key] = convert(value)

    return put_there


def reference(expressions: ExpressionCompiler, node: Expression) -> tuple[TypeOf, Refer] | None:
    """Return the type of a variable and a function that locates the variable.

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
    return BY_CLASS[kind], lambda f: (_Globals(f[WORLD], kind), rounded_to_integer(index(f)))


def _local(expressions: ExpressionCompiler, target: Target, *, strict: bool = True) -> tuple[TypeOf, Refer] | None:
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
    slot = variable.slot
    if isinstance(target, Apply):
        if not variable.sizes:
            if strict:
                raise CompileError(tr("{name} is not an array", name=name.text), name.at)
            return None
        offset = expressions.element_offset(variable, target)
        return variable.type, lambda f: (f[slot], offset(f))
    if variable.sizes:
        raise CompileError(
            tr("{name} is an array; only an element can be used here", name=name.text),
            name.at,
        )
    if variable.by_ref:
        return variable.type, lambda f: f[slot]
    return variable.type, lambda f: (f, slot)


def _store_global(expressions: ExpressionCompiler, target: Target) -> Store:
    found = _global_of(expressions, target)
    if found is None:
        raise unknown(_name_of(target), applied=isinstance(target, Apply))
    kind, index = found
    if kind in POINT_KINDS:
        return _store_point(kind, index)
    convert = BY_CLASS[kind].convert

    def put(f: Frame, value: AnyValue) -> None:
        f[0].write(kind, index(f), convert(value))

    return put


def _store_point(kind: str, index: Callable[[Frame], int]) -> Store:
    def put_bit(f: Frame, value: AnyValue) -> None:
        f[0].write_io(kind, index(f), 1 if truth(value) else 0)

    def put(f: Frame, value: AnyValue) -> None:
        f[0].write_io(kind, index(f), rounded_to_integer(value))

    return put_bit if kind == "IO" else put


def _global_of(expressions: ExpressionCompiler, target: Target) -> tuple[str, Callable[[Frame], int]] | None:
    if isinstance(target, GlobalRef):
        kind = global_class(target.name)
        value = expressions.value(target.index)
        return kind, lambda f: rounded_to_integer(value(f))
    numbered = split_number(target.key) if isinstance(target, Name) else None
    if numbered is None:
        return None
    kind, index = numbered
    return kind, lambda _: index


def _name_of(target: Target) -> Name:
    return target if isinstance(target, Name) else target.name
