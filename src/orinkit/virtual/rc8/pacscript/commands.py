"""The commands other than motions: waiting, messages, arm semaphore, motor, speeds, I/O, LetX and similar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from orinkit.core.i18n import tr
from orinkit.rc8.motion_options import MAX_PERCENT
from orinkit.virtual.rc8.pacscript import functions, values
from orinkit.virtual.rc8.pacscript.code import MACHINE, WORLD, Evaluate, Frame, Op, Recipe, maker
from orinkit.virtual.rc8.pacscript.errors import CompileError, out_of_range
from orinkit.virtual.rc8.pacscript.expressions import Expressions, fixed
from orinkit.virtual.rc8.pacscript.host_interface import DelayWait, Wait
from orinkit.virtual.rc8.pacscript.keywords import CONSTANTS
from orinkit.virtual.rc8.pacscript.lvalues import Store, as_target, store
from orinkit.virtual.rc8.pacscript.robot_words import STATEMENTS
from orinkit.virtual.rc8.pacscript.scope import check_count
from orinkit.virtual.rc8.pacscript.tree import Apply, Command, Expression, LetPart, Name, SetOutput, TakeArm
from orinkit.virtual.rc8.pacscript.values import AnyValue, number, rounded_to_integer, truth

_TRUE: Final = CONSTANTS["true"]
_FALSE: Final = CONSTANTS["false"]
_MAX_PRINTED: Final = 16

_Run: TypeAlias = Callable[[Frame], None]


@dataclass(frozen=True, slots=True)
class _Row:
    least: int
    most: int
    emit: Callable[[Expressions, Command], None]


def compile_command(expressions: Expressions, node: Command) -> None:
    """Emit the instruction of a command.

    Raises:
        CompileError: If the number of arguments is wrong.
    """
    row = _COMMANDS[node.word]
    check_count(Name(node.at, node.word), len(node.arguments), row.least, row.most)
    row.emit(expressions, node)


def compile_take_arm(expressions: Expressions, node: TakeArm) -> None:
    """Emit the instruction of TakeArm; group and Keep default to 0."""
    group = _optional(expressions, node.group, 0)
    keep = _optional(expressions, node.keep, 0)
    simple(expressions, take_arm(group, keep))


def compile_set_reset(expressions: Expressions, node: SetOutput) -> None:
    """Emit the instruction of Set or Reset.

    Raises:
        CompileError: If the target is not an I/O point.
    """
    name = node.target if isinstance(node.target, Name) else node.target.name
    if isinstance(node.target, Apply) or not name.key.startswith("io"):
        raise CompileError(
            tr("expected an I/O point, for example IO[128], not {name}", name=name.text),
            name.at,
        )
    put = store(expressions, node.target)
    # -1 sets all points of an IOB, IOW or IOD, because all bits of -1 are 1.
    value = (1 if name.key == "io" or name.key[2:].isdigit() else -1) if node.on else 0
    simple(expressions, put_constant(put, value))


def compile_let_part(expressions: Expressions, node: LetPart) -> None:
    """Emit the instruction of LetX or of a similar command, which sets one element of a pose."""
    read, put = expressions.value(node.target), store(expressions, node.target)
    value = expressions.value(node.value)
    joint = expressions.value(node.joint) if node.joint else None
    simple(expressions, let_part(node.word, read, put, value, joint))


def simple(expressions: Expressions, run: Recipe) -> None:
    """Emit an instruction that calls ``run`` and continues with the next instruction."""
    expressions.code.emit(do(run))


def waiting(expressions: Expressions, begin: Recipe) -> None:
    """Emit an instruction that starts an operation with ``begin`` and waits until the operation is complete."""
    expressions.code.emit(wait_for(begin))


def percent(value: AnyValue) -> float:
    """Return a value as a percentage after checking that it is above 0 and at most 100.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number; VALUE_OUT_OF_RANGE if it is out of this range.
    """
    share = float(number(value))
    if 0 < share <= MAX_PERCENT:
        return share
    raise out_of_range(tr("a percentage must be above 0 and at most 100, not {share:g}", share=share))


def seconds_from_ms(value: AnyValue) -> float:
    """Convert a time from ms to s.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number; VALUE_OUT_OF_RANGE if it is negative or exceeds
            32 bits.
    """
    time = rounded_to_integer(value)
    if time >= 0:
        return time / 1000
    raise out_of_range(tr("the time is negative: {time} ms", time=time))


def _optional(expressions: Expressions, node: Expression | None, default: int) -> Recipe:
    return fixed(default) if node is None else expressions.value(node)


def _runs(expressions: Expressions, node: Command) -> tuple[Recipe, ...]:
    return tuple(expressions.value(argument) for argument in node.arguments)


def _with_values(expressions: Expressions, node: Command) -> None:
    """Emit a command that calls its function in _ACTIONS with the world and the values of the arguments."""
    simple(expressions, command(node.word, _runs(expressions, node)))


def _speed(world: Any, value: AnyValue) -> None:
    world.speed(percent(value))


def _accel(world: Any, accel: AnyValue, decel: AnyValue = None) -> None:
    world.accel(percent(accel), None if decel is None else percent(decel))


def _decel(world: Any, decel: AnyValue) -> None:
    world.accel(None, percent(decel))


def _ext_speed(world: Any, speed: AnyValue, *rest: AnyValue) -> None:
    accel, decel = (*map(percent, rest), None, None)[:2]
    world.ext_speed(percent(speed), accel, decel)


def _change_tool(world: Any, value: AnyValue) -> None:
    world.change_tool(rounded_to_integer(value))


def _change_work(world: Any, value: AnyValue) -> None:
    world.change_work(rounded_to_integer(value))


def _print_debug(world: Any, *parts: AnyValue) -> None:
    world.show("dbg", values.check_length(" ".join(map(values.text, parts))))


def _print_message(world: Any, text: AnyValue, style: AnyValue = 0, title: AnyValue = "") -> None:
    rounded_to_integer(style)  # the icon of the message is not displayed; the argument is only checked
    world.show("msg", values.check_length(values.text(text)), values.string(title))


_ACTIONS: Final[Mapping[str, Callable[..., None]]] = {
    "Accel": _accel,
    "ChangeTool": _change_tool,
    "ChangeWork": _change_work,
    "Decel": _decel,
    "ExtSpeed": _ext_speed,
    "PrintDbg": _print_debug,
    "PrintMsg": _print_message,
    "Speed": _speed,
}


def _motor(expressions: Expressions, node: Command) -> None:
    waiting(expressions, switch_motor(*_runs(expressions, node)))


def _give_arm(expressions: Expressions, _: Command) -> None:
    waiting(expressions, give_arm())


def _hold(expressions: Expressions, _: Command) -> None:
    waiting(expressions, hold())


def _delay(expressions: Expressions, node: Command) -> None:
    waiting(expressions, delay(*_runs(expressions, node)))


def _wait(expressions: Expressions, node: Command) -> None:
    expressions.polled = True
    met = expressions.condition(node.arguments[0])
    expressions.polled = False
    timeout = expressions.value(node.arguments[1]) if len(node.arguments) > 1 else None
    put = store(expressions, as_target(node.arguments[2])) if len(node.arguments) > 2 else None
    waiting(expressions, wait_until(met, timeout, put))


def _robot(expressions: Expressions, node: Command) -> None:
    """Emit a command of the robot that clients have, too."""
    waiting(expressions, robot_command(STATEMENTS[node.word].name, _runs(expressions, node)))


_COMMANDS: Final[Mapping[str, _Row]] = {
    "Accel": _Row(1, 2, _with_values),
    "ChangeTool": _Row(1, 1, _with_values),
    "ChangeWork": _Row(1, 1, _with_values),
    "Decel": _Row(1, 1, _with_values),
    "Delay": _Row(1, 1, _delay),
    "ExtSpeed": _Row(1, 3, _with_values),
    "GiveArm": _Row(0, 0, _give_arm),
    "Hold": _Row(0, 0, _hold),
    "Motor": _Row(1, 1, _motor),
    "PrintDbg": _Row(1, _MAX_PRINTED, _with_values),
    "PrintMsg": _Row(1, 3, _with_values),
    "Speed": _Row(1, 1, _with_values),
    "Wait": _Row(1, 3, _wait),
    **{word: _Row(each.least, each.most, _robot) for word, each in STATEMENTS.items()},
}


# --- instructions and their parts -------------------------------------------------------------------------------------


@maker
def do(following: int, run: _Run) -> Op:
    """Return an instruction that calls a function and continues with the next instruction."""

    def op(f: Frame) -> int:
        run(f)
        return following

    return op


@maker
def wait_for(following: int, begin: Callable[[Frame], Wait]) -> Op:
    """Return an instruction that starts an operation and waits until the operation is complete."""
    return lambda f: int(f[MACHINE].wait_for(begin(f), following))


@maker
def take_arm(group: Evaluate, keep: Evaluate) -> _Run:
    """Return the function of TakeArm."""
    return lambda f: f[WORLD].take_arm(rounded_to_integer(group(f)), truth(keep(f)))


@maker
def put_constant(put: Store, value: AnyValue) -> _Run:
    """Return a function that stores a constant."""
    return lambda f: put(f, value)


@maker
def let_part(word: str, read: Evaluate, put: Store, value: Evaluate, joint: Evaluate | None) -> _Run:
    """Return the function of LetX or of a similar command."""
    take, place = functions.LET_PARTS[word]

    def run(f: Frame) -> None:
        elements = list(take(read(f)))
        index = functions.joint_index(joint(f)) if joint else place
        elements[index] = float(rounded_to_integer(value(f)) if word == "LetF" else number(value(f)))
        put(f, tuple(elements))

    return run


@maker
def command(word: str, runs: tuple[Evaluate, ...]) -> _Run:
    """Return the function of a command in _ACTIONS."""
    act = _ACTIONS[word]
    return lambda f: act(f[WORLD], *[run(f) for run in runs])


@maker
def robot_command(name: str, runs: tuple[Evaluate, ...]) -> Callable[[Frame], Wait]:
    """Return the function of a command of the robot."""
    return lambda f: f[WORLD].robot_command(name, tuple(run(f) for run in runs))


@maker
def switch_motor(on: Evaluate) -> Callable[[Frame], Wait]:
    """Return the function of Motor."""
    return lambda f: f[WORLD].motor(truth(on(f)))


@maker
def give_arm() -> Callable[[Frame], Wait]:
    """Return the function of GiveArm."""
    return lambda f: f[WORLD].give_arm()


@maker
def hold() -> Callable[[Frame], Wait]:
    """Return the function of Hold."""
    return lambda f: f[WORLD].hold()


@maker
def delay(time: Evaluate) -> Callable[[Frame], Wait]:
    """Return the function of Delay."""

    def begin(f: Frame) -> Wait:
        world = f[WORLD]
        return DelayWait(world.now, world.now() + seconds_from_ms(time(f)))

    return begin


@maker
def wait_until(met: Callable[[Frame], bool], timeout: Evaluate | None, put: Store | None) -> Callable[[Frame], Wait]:
    """Return the function of Wait; it stores True or False if there is a target."""

    def begin(f: Frame) -> Wait:
        world = f[WORLD]
        until = None if timeout is None else world.now() + seconds_from_ms(timeout(f))

        def over() -> bool:
            result = bool(met(f))
            if not result and (until is None or world.now() < until):
                return False
            if put is not None:
                put(f, _TRUE if result else _FALSE)
            return True

        return over

    return begin
