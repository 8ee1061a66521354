"""The commands of Controller_Execute for all programs, and for their Public variables (provider guide 5.2.11.3 to 14).

A supervisory task is a program whose file name begins with ``TSR``. The guide does not say what makes a task a
supervisory one; this is a decision of this project.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar

from orinkit.cao.provider import Deferred, not_found
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.rc8.task_modes import StopMode, TaskMode
from orinkit.values.types import ARRAY, VarType
from orinkit.values.variant import Value, Variant, variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.files.names import SEPARATOR
from orinkit.virtual.rc8.pacscript.values import LENGTHS
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.waiting_calls import all_of
from orinkit.virtual.rc8.task import Task, is_supervisory
from orinkit.virtual.rc8.variables import conversion

if TYPE_CHECKING:
    from orinkit.virtual.rc8.pacscript.compiler import Program
    from orinkit.virtual.rc8.pacscript.scope import PublicVariable, TypeOf

T = TypeVar("T")

Run = Callable[[ClientContext, Variant], Any]
_ROOT_ONLY: Final = 0
_NO_PROGRAM: Final = ""


# --- all programs -----------------------------------------------------------------------------------------------------


def stop_group(mode: StopMode, *, supervisory: bool = False) -> Run:
    """Return a command that stops all tasks except supervisory ones, or only supervisory ones.

    With the parameter 1, the command completes when no such task runs and the arm is at standstill.
    """

    def run(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
        (waits,) = parameters.whole_numbers(parameter, 0)
        stopped = caller.state.tasks.stop_group(mode, supervisory=supervisory)
        return _at_standstill(caller, stopped) if parameters.flag(waits) else None

    return run


def _at_standstill(caller: ClientContext, stopped: Deferred[None]) -> Deferred[None]:
    done = Deferred[None]()

    def wait_for_arm() -> None:
        try:
            stopped.result()
        except CallError as error:  # the controller has been switched off
            done.set_exception(error)
            return
        still = [robot.arm.when_still() for robot in caller.state.robots]
        all_of(still).add_done_callback(done.set_result)

    stopped.add_done_callback(wait_for_arm)
    return done


def continue_all(caller: ClientContext, _: Variant) -> None:
    """Continue all suspended tasks (ContinueStartAll)."""
    require("Task_Start", caller.state.arm, caller)
    caller.state.tasks.continue_all()


def run_supervisors(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    """Start the supervisory tasks of the root folder, or with the parameter 1 all of them (RunAllTsr)."""
    (mode,) = parameters.whole_numbers(parameter, _ROOT_ONLY)
    everywhere = parameters.flag(mode)
    require("RunAllTsr", caller.state.arm, caller)
    tasks = caller.state.tasks

    def run(done: Deferred[None]) -> None:
        for name in tasks.names():
            if not is_supervisory(name) or (SEPARATOR in name and not everywhere):
                continue
            task = tasks.find(name)
            program = caller.state.load_program(task, caller.origin)
            with caller.state.cycles:
                if done.done():  # cancelled
                    return
                if not task.running:
                    tasks.start(task, program, TaskMode.CONTINUOUS)

    return _in_thread(caller, run, starts=True)


# --- Public variables -------------------------------------------------------------------------------------------------


def get_public(caller: ClientContext, parameter: Variant) -> Value | Deferred[Value]:
    """Return the value of a Public variable: ``[task, variable, index ...]`` (GetPublicValue)."""
    given = parameters.elements(parameter)
    task, name, indices = _public_names(given)
    return _with_public(caller, task, name, lambda values, variable: _read(values, variable, indices))


def set_public(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    """Set a Public variable: ``[value, task, variable, index ...]`` (SetPublicValue)."""
    given = parameters.elements(parameter)
    task, name, indices = _public_names(given[1:])
    value = given[0]
    return _with_public(caller, task, name, lambda values, variable: _write(values, variable, indices, value))


def _public_names(given: Sequence[Variant]) -> tuple[str, str, list[int]]:
    if len(given) < 2 or not all(isinstance(each.value, str) for each in given[:2]):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("expected 2 names, those of a task and of a Public variable, and optionally indices"),
        )
    return given[0].value, given[1].value, [conversion.whole(each) for each in given[2:]]


def _with_public(
    caller: ClientContext, name: str, variable: str, job: Callable[[list[Any], PublicVariable], T]
) -> T | Deferred[T]:
    """Return the result of a function of the values of all Public variables, and of one of them."""
    state = caller.state

    def run(_: Deferred[T]) -> T:
        task = state.tasks.find(name)
        program = state.load_program(task, caller.origin)
        with state.cycles:
            return job(task.publics(program), _find(task, program, variable))

    return _in_thread(caller, run)


def _find(task: Task, program: Program, name: str) -> PublicVariable:
    found = program.publics.get(name.strip().lower())
    if found is None:
        raise not_found(f"{task.name}.{name:.40}")
    return found


_R4_ARRAY: Final = int(VarType.R4) | ARRAY
_TYPES: Final[dict[str, int]] = {
    "integer": VarType.I4, "single": VarType.R4, "double": VarType.R8, "string": VarType.BSTR, "boolean": VarType.BOOL,
    "vector": _R4_ARRAY, "position": _R4_ARRAY, "joint": _R4_ARRAY, "trans": _R4_ARRAY,
}  # fmt: skip
_READERS: Final[dict[str, Callable[[Variant], Any]]] = {
    "integer": conversion.whole_within(-(2**31), 2**31 - 1), "single": conversion.single, "double": conversion.double,
    "string": conversion.string, "boolean": conversion.boolean,
    "vector": conversion.singles(LENGTHS["V"]), "position": conversion.singles(LENGTHS["P"]),
    "joint": conversion.singles(LENGTHS["J"]), "trans": conversion.singles(LENGTHS["T"]),
}  # fmt: skip


def _read(values: list[Any], variable: PublicVariable, indices: list[int]) -> Value:
    value = values[variable.place]
    if not variable.sizes:
        _check_indices(variable, indices)
        return _typed(variable.type, value)
    _require_elements(variable)
    if indices:
        return _typed(variable.type, value[_place(variable, indices)])
    step = math.prod(variable.sizes[1:])  # of more dimensions, only the first
    vt = _TYPES.get(variable.type.name)
    listed = [bool(each) if vt == VarType.BOOL else each for each in value[::step]]
    return variant(listed) if vt is None else Variant(vt | ARRAY, listed)


def _typed(kind: TypeOf, value: Any) -> Variant:
    vt = _TYPES.get(kind.name)
    if vt is None:
        return variant(list(value) if isinstance(value, tuple) else value)
    if vt == VarType.BOOL:
        return Variant(vt, bool(value))
    return Variant(vt, list(value) if isinstance(value, tuple) else value)


def _write(values: list[Any], variable: PublicVariable, indices: list[int], given: Variant) -> None:
    if not variable.sizes:
        _check_indices(variable, indices)
        values[variable.place] = _converted(variable, given)
        return
    _require_elements(variable)
    array = values[variable.place]
    if indices:
        array[_place(variable, indices)] = _converted(variable, given)
        return
    if len(variable.sizes) > 1:
        raise error_for(hresult.E_INVALIDARG, tr("{name} has several dimensions", name=variable.name))
    vt = _TYPES.get(variable.type.name)
    if vt is not None and given.type != vt | ARRAY:
        raise error_for(
            hresult.DISP_E_TYPEMISMATCH, tr("the elements must have the type of {name}", name=variable.name)
        )
    elements = parameters.elements(given) if len(given.value) <= parameters.MOST_ELEMENTS else _elements(given)
    if len(elements) != len(array):
        raise error_for(
            hresult.E_INVALIDARG,
            tr("got {count} values, expected {length}", count=len(elements), length=len(array)),
        )
    array[:] = [_converted(variable, each) for each in elements]


def _elements(given: Variant) -> list[Variant]:
    return [Variant(given.type & ~ARRAY, each) for each in given.value]


def _converted(variable: PublicVariable, given: Variant) -> Any:
    reader = _READERS.get(variable.type.name)
    if reader is not None:
        return variable.type.convert(reader(given))
    if given.type == VarType.BSTR:
        return conversion.string(given)
    return conversion.number(given)


def _require_elements(variable: PublicVariable) -> None:
    if variable.type.name in ("vector", "position", "joint", "trans"):
        raise error_for(hresult.E_INVALIDARG, tr("{name}: arrays of poses are not available", name=variable.name))


def _check_indices(variable: PublicVariable, indices: list[int]) -> None:
    if len(indices) != len(variable.sizes):
        raise error_for(
            hresult.DISP_E_BADINDEX,
            tr("{name} has {count} dimensions", name=variable.name, count=len(variable.sizes)),
        )


def _place(variable: PublicVariable, indices: list[int]) -> int:
    _check_indices(variable, indices)
    place = 0
    for index, size in zip(indices, variable.sizes, strict=True):
        if not 0 <= index < size:
            raise error_for(
                hresult.DISP_E_BADINDEX,
                tr("{name}: index {index} is not in 0 to {last}", name=variable.name, index=index, last=size - 1),
            )
        place = place * size + index
    return place


def _in_thread(caller: ClientContext, job: Callable[[Deferred[T]], T], *, starts: bool = False) -> T | Deferred[T]:
    """Run a function in the thread that loads programs; if it starts programs, a stop of all tasks cancels it."""
    state = caller.state
    lane, done = state.compiling, Deferred[T](brief=True, revocable=True)
    if lane.immediate:
        return job(done)
    with state.cycles:
        lane.submit(lambda: job(done), done, caller)
        if starts:
            state.tasks.starts.add(caller, _NO_PROGRAM, done)
    return done
