"""Calls of Subs and Functions of the program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.code import (
    MACHINE,
    WORLD,
    Evaluate,
    Frame,
    Op,
    Recipe,
    RoutineCode,
    maker,
    routine_recipe,
)
from orinkit.virtual.rc8.pacscript.errors import CompileError
from orinkit.virtual.rc8.pacscript.expression_compiler import ExpressionCompiler
from orinkit.virtual.rc8.pacscript.lvalues import Refer, reference
from orinkit.virtual.rc8.pacscript.scope import TYPES_BY_NAME, Routine, Variable, check_count
from orinkit.virtual.rc8.pacscript.tree import Expression, Name, Place

NO_RESULT: Final = -1
"""Used instead of the index in the frame at which the result of a call is stored, if the result is discarded."""


def emit_call(
    expressions: ExpressionCompiler, routine: Routine, at: Place, arguments: tuple[Expression, ...], *, result: bool
) -> int:
    """Emit the instructions of a call.

    Args:
        expressions: Compiles the arguments.
        routine: The Sub or Function to call.
        at: Position of the call in the source.
        arguments: Arguments, one for each parameter.
        result: True if the result is used.

    Returns:
        The index in the caller's frame at which the result is stored, or NO_RESULT if the result is not used.

    Raises:
        CompileError: If the number of arguments is wrong, or if a parameter is declared ByRef and the argument is a
            variable of another type than the parameter.
    """
    count = len(routine.parameters)
    check_count(Name(at, routine.name.text), len(arguments), count, count)
    binds = tuple(
        (parameter.slot, _bind(expressions, routine, parameter, argument))
        for parameter, argument in zip(routine.parameters, arguments, strict=True)
    )
    slot = expressions.scope.current_routine.new_slot() if result else NO_RESULT
    expressions.code.emit(call_routine(routine_recipe(routine.name.key), binds, slot))
    return slot


def _bind(expressions: ExpressionCompiler, routine: Routine, parameter: Variable, argument: Expression) -> Recipe:
    kind = parameter.type
    referred = reference(expressions, argument) if parameter.by_ref else None
    if referred is None:
        value = expressions.value(argument)
    elif referred[0] is kind:
        return referred[1]
    elif parameter.name.lower() in routine.explicit_refs:
        raise _wrong_type(routine, parameter, argument)
    else:
        value = referred_value(referred[1])
    return bind_copy(kind.name, value) if parameter.by_ref else bind_value(kind.name, value)


@maker
def call_routine(
    following: int, routine: RoutineCode, binds: tuple[tuple[int, Callable[[Frame], Any]], ...], slot: int
) -> Op:
    """Return an instruction that calls a Sub or Function.

    Args:
        following: Index of the following instruction.
        routine: The Sub or Function.
        binds: For each parameter, its index in the frame, and a function that evaluates it in the caller's frame.
        slot: Index in the caller's frame at which the result is stored, or NO_RESULT.
    """
    entry, elements, new_frame = routine

    def run(f: Frame) -> int:
        machine = f[MACHINE]
        frame = new_frame(f[WORLD], machine)
        for place, bind in binds:
            frame[place] = bind(f)
        machine.enter(frame, following, slot, elements)
        return entry

    return run


@maker
def referred_value(refer: Refer) -> Evaluate:
    """Return a function that reads a located variable."""

    def run(f: Frame) -> Any:
        holder, key = refer(f)
        return holder[key]

    return run


@maker
def bind_value(type_name: str, value: Evaluate) -> Callable[[Frame], Any]:
    """Return a function that evaluates a parameter passed by value."""
    convert = TYPES_BY_NAME[type_name].convert
    return lambda f: convert(value(f))


@maker
def bind_copy(type_name: str, value: Evaluate) -> Callable[[Frame], Any]:
    """Return a function that evaluates a parameter passed by reference whose argument is not a variable of its type."""
    convert = TYPES_BY_NAME[type_name].convert
    return lambda f: ([convert(value(f))], 0)


def _wrong_type(routine: Routine, parameter: Variable, argument: Expression) -> CompileError:
    kind = parameter.type.name.capitalize()
    return CompileError(
        tr(
            "parameter {name} of {routine} is ByRef and requires a variable of type {kind}",
            name=parameter.name,
            routine=routine.name.text,
            kind=kind,
        ),
        argument.at,
    )
