"""The motions: Move, Approach, Depart, Drive, DriveA, Rotate, RotateH."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias, TypeVar

from orinkit.core.i18n import tr
from orinkit.rc8.motion_options import MAX_TIME, MotionOptions
from orinkit.values.poses import AT_COMMAND, AT_ENCODER, PASSING, Extra, Kind, PassMark, Target
from orinkit.virtual.rc8.pacscript import values
from orinkit.virtual.rc8.pacscript.code import WORLD, Evaluate, Frame, Recipe, maker
from orinkit.virtual.rc8.pacscript.commands import percent, waiting
from orinkit.virtual.rc8.pacscript.errors import CompileError, not_supported, out_of_range
from orinkit.virtual.rc8.pacscript.expressions import Expressions
from orinkit.virtual.rc8.pacscript.functions import joint_index
from orinkit.virtual.rc8.pacscript.host_interface import Wait
from orinkit.virtual.rc8.pacscript.tree import Binary, ExtraJoints, Item, JointValue, Motion, Name, PassMarkNode, Place
from orinkit.virtual.rc8.pacscript.values import AnyValue, number, rounded_to_integer

_INTERPOLATIONS: Final = {"p": 1, "ptp": 1, "l": 2, "c": 3, "s": 4}
_POSES_ON_ARC: Final = 2
_PLANES: Final = ("XY", "YZ", "ZX", "XYH", "YZH", "ZXH")
_FIELDS: Final[Mapping[str, str]] = {
    "speed": "speed", "s": "speed", "accel": "accel", "decel": "decel", "time": "time", "pose": "pose"
}  # fmt: skip
_REFUSED_OPTIONS: Final = {"static": "Static"}
_POSE: Final = values.pose("P", "J", "T")
_VECTOR: Final = values.pose("V")
_EXTRA_JOINTS: Final = (7, 8)
_KIND_OF: Final[Mapping[int, Kind]] = {values.P_LENGTH: "P", values.J_LENGTH: "J", values.T_LENGTH: "T"}
_RIGID: Final = 1  # value of the option Pose: the orientation turns with the position
_ORIGIN: Final = Target("V", (0.0, 0.0, 0.0))


_Mark: TypeAlias = Callable[[Frame], PassMark]
T = TypeVar("T")


@dataclass(slots=True)
class _Options:
    """The options of a motion that is being compiled: for each option, the recipe of its value."""

    fields: dict[str, Recipe] = field(default_factory=dict)
    next: bool = False

    @property
    def recipe(self) -> Recipe:
        """The recipe of an :class:`_Evaluated`."""
        return motion_options(self.next, *(self.fields.get(name) for name in _VALUES))


_VALUES: Final = ("speed", "accel", "decel", "time", "pose")


@dataclass(frozen=True, slots=True)
class _Evaluated:
    """The options of a motion: for each option that was given, a function that evaluates it."""

    next: bool
    speed: Evaluate | None
    accel: Evaluate | None
    decel: Evaluate | None
    time: Evaluate | None
    pose: Evaluate | None

    def build(self, f: Frame, mark: PassMark | None = None, pose: int | None = None) -> MotionOptions:
        """Return the values of the options and a pass mark; ``pose`` is used if the option Pose was not given."""
        return MotionOptions(
            speed=percent(self.speed(f)) if self.speed else None,
            accel=percent(self.accel(f)) if self.accel else None,
            decel=percent(self.decel(f)) if self.decel else None,
            time=_time(self.time(f)) if self.time else None,
            next=self.next,
            mark=mark,
            pose=_pose_option(self.pose(f)) if self.pose else pose,
        )


def compile_motion(expressions: Expressions, node: Motion) -> None:
    """Emit the instructions of a motion.

    Raises:
        CompileError: If arguments are missing, superfluous or wrong.
    """
    items, options = _split(expressions, node)
    if node.word in ("Drive", "DriveA"):
        _drive(expressions, node, items, options)
    elif node.word == "Rotate":
        _rotate(expressions, node, items, options)
    elif node.word == "RotateH":
        _rotate_hand(expressions, node, items, options)
    else:
        _straight(expressions, node, items, options)


def _split(expressions: Expressions, node: Motion) -> tuple[list[Item], _Options]:
    """Split the arguments of a motion into positional arguments and options."""
    options = _Options()
    items: list[Item] = []
    for item in node.items:
        value = item.value
        if value is None:
            options.next = True
        elif isinstance(value, Binary) and value.operator == "EQUAL" and isinstance(value.left, Name):
            _add_option(expressions, node, value.left, value, options)
        elif options.next or options.fields:
            raise CompileError(tr("poses must come before options"), item.at)
        else:
            items.append(item)
    return items, options


def _add_option(expressions: Expressions, node: Motion, name: Name, value: Binary, options: _Options) -> None:
    option_field = _FIELDS.get(name.key)
    if name.key in _REFUSED_OPTIONS:
        raise not_supported(f"{node.word} {_REFUSED_OPTIONS[name.key]} =", name.at)
    if option_field is None or (option_field == "pose" and node.word != "Rotate"):
        raise CompileError(
            tr("{option} is not an option of {word}", option=name.text, word=node.word),
            name.at,
        )
    options.fields[option_field] = expressions.value(value.right)


# --- Move, Approach, Depart -------------------------------------------------------------------------------------------


def _straight(expressions: Expressions, node: Motion, items: list[Item], options: _Options) -> None:
    interpolation = _interpolation(node, items)
    parts = items[1:]
    if node.word == "Approach":
        _require(node, parts, 2, 2, tr("a pose and a length"))
        _approach(expressions, interpolation, parts, options)
    elif node.word == "Depart":
        _require(node, parts, 1, 1, tr("a length"))
        _reject_extra_joints(parts[0])
        length, mark = _amount(expressions, parts[0])
        waiting(expressions, depart(interpolation, length, mark, options.recipe))
    elif interpolation == _INTERPOLATIONS["c"]:
        _require(node, parts, _POSES_ON_ARC, _POSES_ON_ARC, tr("a relay pose and a target"))
        _move(expressions, interpolation, parts, options)
    elif interpolation == _INTERPOLATIONS["s"]:
        _require(node, parts, 1, 1, tr("the number of a path"))
        _move_path(expressions, parts[0], options)
    else:
        _require(node, parts, 1, len(parts), tr("a pose"))
        for part in parts:  # each pose is a separate motion
            _move(expressions, interpolation, [part], options)


def _move(expressions: Expressions, interpolation: int, parts: Sequence[Item], options: _Options) -> None:
    targets = tuple(_target(expressions, part) for part in parts)
    waiting(expressions, move(interpolation, targets, options.recipe))


def _move_path(expressions: Expressions, part: Item, options: _Options) -> None:
    _reject_extra_joints(part)
    path, mark = _amount(expressions, part)
    waiting(expressions, move_along_path(path, mark, options.recipe))


def _approach(expressions: Expressions, interpolation: int, parts: Sequence[Item], options: _Options) -> None:
    if parts[0].mark is not None:
        raise CompileError(
            tr("the pass mark of Approach must precede the length"),
            parts[0].at,
        )
    target = pose_target(_pose(expressions, parts[0]), None, _extra(expressions, parts[1].extra or parts[0].extra))
    length, mark = _amount(expressions, parts[1])
    waiting(expressions, approach(interpolation, target, length, mark, options.recipe))


def _interpolation(node: Motion, items: list[Item]) -> int:
    first = items[0] if items else node.items[0]
    name = first.value
    number_of = _INTERPOLATIONS.get(name.key) if isinstance(name, Name) and not first.mark and not first.extra else None
    allowed = _INTERPOLATIONS.values() if node.word == "Move" else (1, 2)
    if number_of is None or number_of not in allowed:
        letters = "P, L, C, S" if node.word == "Move" else "P, L"
        raise CompileError(
            tr("the first argument of {word} must be one of {letters}", word=node.word, letters=letters),
            first.at,
        )
    return number_of


# --- Drive, DriveA ----------------------------------------------------------------------------------------------------


def _drive(expressions: Expressions, node: Motion, items: list[Item], options: _Options) -> None:
    _require(node, items, 1, values.J_LENGTH, tr("joints with values, for example (1, 10)"))
    absolute = node.word == "DriveA"
    mark = _mark(expressions, items[0].mark)
    for item in items:
        _reject_extra_joints(item)
        if item.mark is not None and item is not items[0]:
            raise CompileError(tr("a pass mark is not allowed here"), item.at)
    pairs = _pairs(expressions, items)
    waiting(expressions, drive(pairs, absolute, mark, options.recipe))


def _pairs(expressions: Expressions, items: list[Item]) -> Recipe:
    first = items[0].value
    if len(items) == 1 and first is not None and not isinstance(first, JointValue):
        return all_joints(expressions.value(first))
    return joint_values(tuple(_pair(expressions, item.value, item.at) for item in items))


def _pair(expressions: Expressions, node: object, at: Place) -> Recipe:
    if not isinstance(node, JointValue) or len(node.items) != 2:
        raise CompileError(tr("expected a joint and a value, for example (1, 10)"), at)
    return joint_value(*(expressions.value(item) for item in node.items))


# --- Rotate, RotateH --------------------------------------------------------------------------------------------------


def _rotate(expressions: Expressions, node: Motion, items: list[Item], options: _Options) -> None:
    _require(node, items, 2, 3, tr("a plane, an angle and optionally a pivot"))
    plane = items[0].value
    if isinstance(plane, JointValue):
        raise not_supported(tr("Rotate in a plane given by three points"), plane.at)
    name = plane.text.upper() if isinstance(plane, Name) else ""
    if name not in _PLANES:
        raise CompileError(
            tr("the plane of Rotate must be one of {planes}", planes=", ".join(_PLANES)),
            items[0].at,
        )
    for item in items:
        _reject_extra_joints(item)
    if items[0].mark or (len(items) > 2 and items[2].mark):
        raise CompileError(tr("the pass mark of Rotate must precede the angle"), node.at)
    angle, mark = _amount(expressions, items[1])
    centre = items[2].value if len(items) > 2 else None
    pivot = expressions.value(centre) if centre is not None else None
    if pivot is None and name.endswith("H"):
        raise CompileError(tr("Rotate {name} requires a pivot", name=name), node.at)

    waiting(expressions, rotate(name, angle, pivot, mark, options.recipe))


def _rotate_hand(expressions: Expressions, node: Motion, items: list[Item], options: _Options) -> None:
    """Emit RotateH as a Rotate in the tool's XY plane about the tool's origin; the orientation turns too."""
    _require(node, items, 1, 1, tr("an angle"))
    _reject_extra_joints(items[0])
    angle, mark = _amount(expressions, items[0])
    waiting(expressions, rotate_hand(angle, mark, options.recipe))


# --- parts ------------------------------------------------------------------------------------------------------------


def _target(expressions: Expressions, item: Item) -> Recipe:
    return pose_target(_pose(expressions, item), _mark(expressions, item.mark), _extra(expressions, item.extra))


def _pose(expressions: Expressions, item: Item) -> Recipe:
    assert item.value is not None
    return expressions.value(item.value)


def _amount(expressions: Expressions, item: Item) -> tuple[Recipe, Recipe | None]:
    """Return the recipes of a length or an angle, and of its pass mark."""
    return _pose(expressions, item), _mark(expressions, item.mark)


def _mark(expressions: Expressions, node: PassMarkNode | None) -> Recipe | None:
    if node is None:
        return None
    return fixed_mark(node.mode == "P") if node.radius is None else radius_mark(expressions.value(node.radius))


def _extra(expressions: Expressions, node: ExtraJoints | None) -> Recipe | None:
    if node is None:
        return None
    items = node.items
    if len(items) == 1 and not isinstance(items[0], JointValue):
        return extra_joints_of(node.absolute, expressions.value(items[0]))
    pairs = items if isinstance(items[0], JointValue) else (JointValue(node.at, items, 1),)
    return extra_joints(node.absolute, tuple(_pair(expressions, pair, node.at) for pair in pairs))


def _kind(value: tuple[float, ...]) -> Kind:
    return _KIND_OF[len(value)]


def _time(value: AnyValue) -> float:
    time = float(number(value))
    if 0 < time <= MAX_TIME:
        return time
    raise out_of_range(tr("invalid duration of a motion: {time:g} ms", time=time))


def _pose_option(value: AnyValue) -> int:
    value = rounded_to_integer(value)
    if value in (1, 2):
        return int(value)
    raise out_of_range(tr("Pose must be 1 or 2, not {value}", value=value))


def _require(node: Motion, items: Sequence[Item], least: int, most: int, what: str) -> None:
    if least <= len(items) <= most:
        return
    at = items[most].at if len(items) > most else node.at
    raise CompileError(tr("{word} requires {what}", word=node.word, what=what), at)


def _reject_extra_joints(item: Item) -> None:
    if item.extra is not None:
        raise CompileError(tr("Ex and ExA are not allowed here"), item.extra.at)


# --- the functions that begin motions ---------------------------------------------------------------------------------

_Begin: TypeAlias = Callable[[Frame], Wait]
_Pair: TypeAlias = Callable[[Frame], tuple[int, float]]


def _value_of(part: Callable[[Frame], T] | None, f: Frame) -> T | None:
    return None if part is None else part(f)


@maker
def motion_options(
    next_: bool, speed: Evaluate | None, accel: Evaluate | None, decel: Evaluate | None, time: Evaluate | None,
    pose: Evaluate | None,
) -> _Evaluated:  # fmt: skip
    """Return the options of a motion."""
    return _Evaluated(next_, speed, accel, decel, time, pose)


@maker
def pose_target(
    pose: Evaluate, mark: _Mark | None, extra: Callable[[Frame], Extra] | None
) -> Callable[[Frame], Target]:
    """Return a function that returns a target."""

    def run(f: Frame) -> Target:
        value = _POSE(pose(f))
        return Target(_kind(value), value, _value_of(mark, f), _value_of(extra, f))

    return run


@maker
def fixed_mark(passing: bool) -> _Mark:
    """Return a function that returns @P or @E."""
    mark = PASSING if passing else AT_ENCODER
    return lambda _: mark


@maker
def radius_mark(radius: Evaluate) -> _Mark:
    """Return a function that returns a pass mark with a radius."""

    def run(f: Frame) -> PassMark:
        value = float(number(radius(f)))
        if value < 0:
            raise out_of_range(tr("the radius of a pass mark is negative: {radius:g} mm", radius=value))
        return PassMark("n", value) if value else AT_COMMAND

    return run


@maker
def joint_value(joint: Evaluate, value: Evaluate) -> _Pair:
    """Return a function that returns the number of a joint and its value."""

    def run(f: Frame) -> tuple[int, float]:
        index, amount = joint_index(joint(f)), value(f)
        if isinstance(amount, tuple):
            amount = values.pose("J")(amount)[index]
        return index + 1, float(number(amount))

    return run


@maker
def joint_values(runs: tuple[_Pair, ...]) -> Callable[[Frame], tuple[tuple[int, float], ...]]:
    """Return a function that returns joints and their values; if a joint occurs twice, the last value counts."""
    return lambda f: tuple(dict(run(f) for run in runs).items())


@maker
def all_joints(joints: Evaluate) -> Callable[[Frame], tuple[tuple[int, float], ...]]:
    """Return a function that returns the joints of a J and their values."""
    take = values.pose("J")
    return lambda f: tuple(enumerate(take(joints(f)), 1))


@maker
def extra_joints_of(absolute: bool, joints: Evaluate) -> Callable[[Frame], Extra]:
    """Return a function that returns the extended joints of a J."""
    take = values.pose("J")
    return lambda f: Extra(absolute, tuple((n, take(joints(f))[n - 1]) for n in _EXTRA_JOINTS))


@maker
def extra_joints(absolute: bool, runs: tuple[_Pair, ...]) -> Callable[[Frame], Extra]:
    """Return a function that returns extended joints."""

    def run(f: Frame) -> Extra:
        given = dict(one(f) for one in runs)
        for joint in given:
            if joint not in _EXTRA_JOINTS:
                raise out_of_range(tr("joint {joint} is not an extended joint (7 or 8)", joint=joint))
        return Extra(absolute, tuple(given.items()))

    return run


@maker
def move(interpolation: int, targets: tuple[Callable[[Frame], Target], ...], options: _Evaluated) -> _Begin:
    """Return a function that begins Move."""
    return lambda f: f[WORLD].move(interpolation, tuple(target(f) for target in targets), options.build(f))


@maker
def move_along_path(path: Evaluate, mark: _Mark | None, options: _Evaluated) -> _Begin:
    """Return a function that begins Move along a stored path."""

    def begin(f: Frame) -> Wait:
        target = Target("", (float(rounded_to_integer(path(f))),), _value_of(mark, f))
        wait: Wait = f[WORLD].move(_INTERPOLATIONS["s"], (target,), options.build(f))
        return wait

    return begin


@maker
def approach(
    interpolation: int, target: Callable[[Frame], Target], length: Evaluate, mark: _Mark | None, options: _Evaluated
) -> _Begin:
    """Return a function that begins Approach."""
    return lambda f: f[WORLD].approach(
        interpolation, target(f), float(number(length(f))), _value_of(mark, f), options.build(f)
    )


@maker
def depart(interpolation: int, length: Evaluate, mark: _Mark | None, options: _Evaluated) -> _Begin:
    """Return a function that begins Depart."""
    return lambda f: f[WORLD].depart(interpolation, float(number(length(f))), _value_of(mark, f), options.build(f))


@maker
def drive(
    pairs: Callable[[Frame], tuple[tuple[int, float], ...]], absolute: bool, mark: _Mark | None, options: _Evaluated
) -> _Begin:
    """Return a function that begins Drive or DriveA."""
    return lambda f: f[WORLD].drive(pairs(f), absolute, _value_of(mark, f), options.build(f))


@maker
def rotate(plane: str, angle: Evaluate, pivot: Evaluate | None, mark: _Mark | None, options: _Evaluated) -> _Begin:
    """Return a function that begins Rotate."""

    def begin(f: Frame) -> Wait:
        turn = float(number(angle(f)))
        about = None if pivot is None else Target("V", _VECTOR(pivot(f)))
        wait: Wait = f[WORLD].rotate(plane, turn, about, options.build(f, _value_of(mark, f)))
        return wait

    return begin


@maker
def rotate_hand(angle: Evaluate, mark: _Mark | None, options: _Evaluated) -> _Begin:
    """Return a function that begins RotateH."""
    return lambda f: f[WORLD].rotate(
        "XYH", float(number(angle(f))), _ORIGIN, options.build(f, _value_of(mark, f), _RIGID)
    )
