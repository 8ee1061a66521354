"""The motions: Move, Approach, Depart, Drive, DriveA, Rotate, RotateH."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from orinkit.core.i18n import tr
from orinkit.rc8.motion_options import MAX_TIME, MotionOptions
from orinkit.values.poses import AT_COMMAND, AT_ENCODER, PASSING, Extra, Kind, PassMark, Target
from orinkit.virtual.rc8.pacscript import values
from orinkit.virtual.rc8.pacscript.code import WORLD, Evaluate, Frame
from orinkit.virtual.rc8.pacscript.commands import percent, waiting
from orinkit.virtual.rc8.pacscript.errors import CompileError, not_supported, out_of_range
from orinkit.virtual.rc8.pacscript.expressions import Expressions
from orinkit.virtual.rc8.pacscript.functions import joint_index
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


@dataclass(slots=True)
class _Options:
    """The options of a motion that is being compiled: for each option, a function that evaluates it."""

    fields: dict[str, Evaluate] = field(default_factory=dict)
    next: bool = False

    def build(self, f: Frame, mark: PassMark | None = None, pose: int | None = None) -> MotionOptions:
        """Return the values of the options and a pass mark; ``pose`` is used if the option Pose was not given."""
        given = self.fields
        return MotionOptions(
            speed=percent(given["speed"](f)) if "speed" in given else None,
            accel=percent(given["accel"](f)) if "accel" in given else None,
            decel=percent(given["decel"](f)) if "decel" in given else None,
            time=_time(given["time"](f)) if "time" in given else None,
            next=self.next,
            mark=mark,
            pose=_pose_option(given["pose"](f)) if "pose" in given else pose,
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
        waiting(
            expressions,
            lambda f: f[WORLD].depart(interpolation, float(number(length(f))), mark(f), options.build(f)),
        )
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
    targets = [_target(expressions, part) for part in parts]
    waiting(
        expressions,
        lambda f: f[WORLD].move(interpolation, tuple(target(f) for target in targets), options.build(f)),
    )


def _move_path(expressions: Expressions, part: Item, options: _Options) -> None:
    _reject_extra_joints(part)
    path, mark = _amount(expressions, part)
    waiting(
        expressions,
        lambda f: f[WORLD].move(
            _INTERPOLATIONS["s"], (Target("", (float(rounded_to_integer(path(f))),), mark(f)),), options.build(f)
        ),
    )


def _approach(expressions: Expressions, interpolation: int, parts: Sequence[Item], options: _Options) -> None:
    if parts[0].mark is not None:
        raise CompileError(
            tr("the pass mark of Approach must precede the length"),
            parts[0].at,
        )
    pose, extra = _pose(expressions, parts[0]), _extra(expressions, parts[1].extra or parts[0].extra)
    length, mark = _amount(expressions, parts[1])

    def begin(f: Frame) -> Callable[[], bool]:
        value = _POSE(pose(f))
        target = Target(_kind(value), value, None, extra(f))
        wait: Callable[[], bool] = f[WORLD].approach(
            interpolation, target, float(number(length(f))), mark(f), options.build(f)
        )
        return wait

    waiting(expressions, begin)


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
    waiting(expressions, lambda f: f[WORLD].drive(pairs(f), absolute, mark(f), options.build(f)))


def _pairs(expressions: Expressions, items: list[Item]) -> Callable[[Frame], tuple[tuple[int, float], ...]]:
    first = items[0].value
    if len(items) == 1 and first is not None and not isinstance(first, JointValue):
        joints, take = expressions.value(first), values.pose("J")
        return lambda f: tuple(enumerate(take(joints(f)), 1))
    runs = [_pair(expressions, item.value, item.at) for item in items]
    return lambda f: tuple(dict(run(f) for run in runs).items())  # if a joint occurs twice, the last value counts


def _pair(expressions: Expressions, node: object, at: Place) -> Callable[[Frame], tuple[int, float]]:
    if not isinstance(node, JointValue) or len(node.items) != 2:
        raise CompileError(tr("expected a joint and a value, for example (1, 10)"), at)
    joint, value = (expressions.value(item) for item in node.items)

    def run(f: Frame) -> tuple[int, float]:
        index, amount = joint_index(joint(f)), value(f)
        if isinstance(amount, tuple):
            amount = values.pose("J")(amount)[index]
        return index + 1, float(number(amount))

    return run


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

    def begin(f: Frame) -> Callable[[], bool]:
        turn = float(number(angle(f)))
        about = None if pivot is None else Target("V", _VECTOR(pivot(f)))
        wait: Callable[[], bool] = f[WORLD].rotate(name, turn, about, options.build(f, mark(f)))
        return wait

    waiting(expressions, begin)


def _rotate_hand(expressions: Expressions, node: Motion, items: list[Item], options: _Options) -> None:
    """Emit RotateH as a Rotate in the tool's XY plane about the tool's origin; the orientation turns too."""
    _require(node, items, 1, 1, tr("an angle"))
    _reject_extra_joints(items[0])
    angle, mark = _amount(expressions, items[0])
    waiting(
        expressions,
        lambda f: f[WORLD].rotate("XYH", float(number(angle(f))), _ORIGIN, options.build(f, mark(f), _RIGID)),
    )


# --- parts ------------------------------------------------------------------------------------------------------------


def _target(expressions: Expressions, item: Item) -> Callable[[Frame], Target]:
    pose, mark, extra = _pose(expressions, item), _mark(expressions, item.mark), _extra(expressions, item.extra)

    def run(f: Frame) -> Target:
        value = _POSE(pose(f))
        return Target(_kind(value), value, mark(f), extra(f))

    return run


def _pose(expressions: Expressions, item: Item) -> Evaluate:
    assert item.value is not None
    return expressions.value(item.value)


def _amount(expressions: Expressions, item: Item) -> tuple[Evaluate, Callable[[Frame], PassMark | None]]:
    """Return a function that evaluates a length or an angle, and a function that evaluates its pass mark."""
    return _pose(expressions, item), _mark(expressions, item.mark)


def _mark(expressions: Expressions, node: PassMarkNode | None) -> Callable[[Frame], PassMark | None]:
    if node is None:
        return lambda _: None
    if node.radius is None:
        fixed = PASSING if node.mode == "P" else AT_ENCODER
        return lambda _: fixed
    radius = expressions.value(node.radius)
    return lambda f: _radius(radius(f))


def _radius(value: AnyValue) -> PassMark:
    radius = float(number(value))
    if radius < 0:
        raise out_of_range(tr("the radius of a pass mark is negative: {radius:g} mm", radius=radius))
    return PassMark("n", radius) if radius else AT_COMMAND


def _extra(expressions: Expressions, node: ExtraJoints | None) -> Callable[[Frame], Extra | None]:
    if node is None:
        return lambda _: None
    absolute = node.absolute
    items = node.items
    if len(items) == 1 and not isinstance(items[0], JointValue):
        joints, take = expressions.value(items[0]), values.pose("J")
        return lambda f: Extra(absolute, tuple((n, take(joints(f))[n - 1]) for n in _EXTRA_JOINTS))
    pairs = items if isinstance(items[0], JointValue) else (JointValue(node.at, items, 1),)
    runs = [_pair(expressions, pair, node.at) for pair in pairs]

    def run(f: Frame) -> Extra:
        given = dict(one(f) for one in runs)
        for joint in given:
            if joint not in _EXTRA_JOINTS:
                raise out_of_range(tr("joint {joint} is not an extended joint (7 or 8)", joint=joint))
        return Extra(absolute, tuple(given.items()))

    return run


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
