"""What both clients' robots share: what is sent for a motion, what is read from answers. Plain data, no calls."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypedDict, TypeVar

from orinkit.client._shared.common import not_understood
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import brief, finite, plain_decimal
from orinkit.values.poses import J, P, PassMark, PoseLike, T, Target, V, as_mark, parse_target, parse_targets, to_text
from orinkit.values.variant import Value, Variant, plain

PTP: Final = 1
LINE: Final = 2
ARC: Final = 3
CURVE: Final = 4

HOLDING_COMMANDS: Final = frozenset(("takearm", "givearm", "motor"))
"""Commands, in small letters, that surely move nothing."""

_MISSING: Final = (hresult.E_NOTIMPL, hresult.E_INVALID_CMD_NAME, hresult.E_INVALIDARG, hresult.FUNCTION_NOT_DEFINED)
_DEEPEST: Final = 32  # of lists that are looked through for poses; a VARIANT has fewer
_PASSING: Final = re.compile(r"@\s*(?:[Pp]|[0-9.+]*[1-9])")
_MOST_PERCENT: Final = 100.0
_MOST_SECONDS: Final = 3600.0
_JOINTS: Final = 6  # of most arms

Pose = TypeVar("Pose", P, T, J)


class MoveOptions(TypedDict, total=False):
    """The options of a motion, as keywords; what is left out is as the controller has it.

    Attributes:
        speed: percent, above 0, at most 100.
        accel: acceleration in percent.
        decel: deceleration in percent.
        time: how long it is to take, in seconds, at most 3600.
        wait: True, the default, waits for the end; False returns at once (NEXT).
    """

    speed: float
    accel: float
    decel: float
    time: float
    wait: bool


def option_text(options: MoveOptions, mark: str = "") -> tuple[str, bool]:
    """Return the option string of a motion (RC8 3.3.4), and whether to wait for its end.

    Args:
        options: as given.
        mark: a pass mark that belongs to the option string, as that of Rotate does.

    Raises:
        TypeError: an option that there is not.
        InvalidValue: an amount is no number, or out of range.
    """
    if unknown := options.keys() - MoveOptions.__annotations__.keys():
        known = ", ".join(MoveOptions.__annotations__)
        raise TypeError(tr("a motion has no option {name!r}; there are {known}", name=min(unknown), known=known))
    parts = [mark] if mark else []
    parts += [
        f"{name.upper()}={plain_decimal(_amount(name, options.get(name), _MOST_PERCENT))}"
        for name in ("speed", "accel", "decel")
        if name in options
    ]
    if "time" in options:
        parts.append(f"TIME={max(1, round(_amount('time', options['time'], _MOST_SECONDS) * 1000))}")
    wait = options.get("wait", True)
    return ",".join(parts if wait else [*parts, "NEXT"]), bool(wait)


def waits(option: str) -> bool:
    """Return whether a motion with this option string is answered at its end."""
    return all(part.strip().upper() not in ("NEXT", "NEXT=1") for part in str(option).split(","))


def _amount(name: str, value: object, most: float) -> float:
    number = finite("move", name, value)
    if not 0 < number <= most:
        raise InvalidValue(
            tr("{name}: {number:g} is not above 0 and at most {most:.0f}", name=name, number=number, most=most)
        )
    return number


# --- the two forms of move and drive ----------------------------------------------------------------------------------


def is_raw(first: str, arguments: tuple[object, ...], named: Mapping[str, object]) -> bool:
    """Return whether a method was called as CAO has it: its first argument is a number.

    Args:
        first: name of that argument.
        arguments: of the call.
        named: of the call.
    """
    return first in named or (bool(arguments) and isinstance(arguments[0], int))


def check_move(arguments: tuple[object, ...], named: Mapping[str, Any]) -> None:
    """Make sure that ``move`` was called in one of its forms.

    Raises:
        TypeError: it was not; the message has what to write.
    """
    if (
        len(arguments) > 1
        and not named
        and all(map(_is_number, arguments))
        and (len(arguments), arguments[0]) != (2, 4)
    ):
        numbers = ", ".join(f"{number:g}" for number in arguments)
        raise TypeError(
            tr(
                "Robot.move() takes a pose, not numbers: move(J({numbers})) for joints, "
                "move(P({numbers})) for a position",
                numbers=numbers,
            )
        )
    form = _MOVE_RAW if is_raw("interpolation", arguments, named) else _MOVE
    _check_form("move", form, arguments, named, 'move(J(...), "@E", speed=20)', 'move(1, "@E P1", "SPEED=20")')


def check_drive(arguments: tuple[object, ...], named: Mapping[str, Any]) -> None:
    """Make sure that ``drive`` was called in one of its forms.

    Raises:
        TypeError: it was not; the message has what to write.
    """
    form = _DRIVE_RAW if is_raw("axis", arguments, named) else _DRIVE
    _check_form("drive", form, arguments, named, "drive({1: 10, 2: -5}, speed=20)", 'drive(1, 10.0, "SPEED=20")')


def _check_form(
    name: str, form: inspect.Signature, arguments: tuple[object, ...], named: Mapping[str, Any], usual: str, raw: str
) -> None:
    try:
        form.bind(*arguments, **named)
    except TypeError as error:
        raise TypeError(
            tr(
                "Robot.{name}(): {error}; the forms are {usual} and, as CAO has it, {raw}",
                name=name,
                error=error,
                usual=usual,
                raw=raw,
            )
        ) from None


def _form(*names: str, options: bool, **defaults: object) -> inspect.Signature:
    kinds = inspect.Parameter
    parameters = [kinds(name, kinds.POSITIONAL_OR_KEYWORD, default=defaults.get(name, kinds.empty)) for name in names]
    return inspect.Signature([*parameters, kinds("options", kinds.VAR_KEYWORD)] if options else parameters)


_MOVE: Final = _form("pose", "mark", options=True, mark="")
_MOVE_RAW: Final = _form("interpolation", "pose", "option", options=False, option="")
_DRIVE: Final = _form("axes", "mark", options=True, mark="")
_DRIVE_RAW: Final = _form("axis", "value", "option", options=False, option="")


# --- poses that are sent ----------------------------------------------------------------------------------------------


def sendable(value: Value, depth: int = 0) -> Value:
    """Return a value of CAO with the text of each pose in place of the pose, also in lists.

    The numbers of a pose alone do not say what they are: a controller could read those of a J as a P.
    """
    given: Any = value
    if isinstance(given, P | T | J | V | Target):
        return to_text(given)
    if isinstance(given, PassMark):
        return str(given)
    if isinstance(given, list | tuple) and depth < _DEEPEST:
        return [sendable(each, depth + 1) for each in given]
    return value


def raw_pose(pose: Value) -> Value:
    """Return the pose of a motion as CAO has it.

    Raises:
        InvalidValue: 6 numbers, of which nobody knows what they are.
    """
    text = sendable(pose)
    values = plain(text)
    numbers = values.tolist() if hasattr(values, "tolist") else values  # of numpy
    if isinstance(numbers, list | tuple) and len(numbers) == _JOINTS and all(map(_is_number, numbers)):
        raise InvalidValue(tr("{pose}: 6 numbers may be joints or a position: J(...) or P(...)", pose=brief(pose)))
    return text


def pose_text(pose: PoseLike, mark: str | PassMark = "") -> str:
    """Return the text that is sent for a pose; one that is given as text is read first.

    Raises:
        InvalidValue: no pose, or a text that is none; the message names the column.
        NotationError: the mark is none.
    """
    text = to_text(pose, mark)
    if isinstance(pose, str):
        try:
            parse_targets(pose)
        except NotationError as error:
            raise InvalidValue(
                tr(
                    "{pose} is no pose: {error}; what is to be sent as it is: move(1, text)",
                    pose=brief(pose),
                    error=error,
                )
            ) from None
    return text


def passes(arguments: object) -> bool:
    """Return whether a motion may be answered while the arm still moves: its pass mark is ``@P``, or a radius."""
    if isinstance(arguments, str):
        return _PASSING.search(arguments) is not None
    if isinstance(arguments, list | tuple):
        return any(isinstance(each, list | tuple) or passes(each) for each in arguments)
    return isinstance(arguments, Variant)


def arc_text(via: PoseLike, end: PoseLike, mark: str | PassMark) -> str:
    """Return the two poses of an arc (RC8 3.3.4): ``P1, @E P2``."""
    return f"{pose_text(via)}, {pose_text(end, mark)}"


def curve_text(path: int | Sequence[PoseLike], mark: str | PassMark) -> str:
    """Return the path of a free curve: the number of a stored one, or its poses.

    Raises:
        InvalidValue: no pose, or a number below 0.
    """
    if isinstance(path, int):
        if path < 0:
            raise InvalidValue(tr("{path} is no number of a path", path=path))
        return f"{as_mark(mark)} {path}" if mark else str(path)
    poses: object = path
    if not isinstance(poses, list | tuple) or isinstance(poses, P | T | J | V) or not poses:
        raise InvalidValue(
            tr("{path}: a free curve takes the number of a stored path, or a list of poses", path=brief(path))
        )
    *middle, last = path
    return ", ".join([*map(pose_text, middle), pose_text(last, mark)])


def distance_text(distance: float, mark: str | PassMark) -> str:
    """Return a distance with its pass mark, as Approach and Depart take it: ``@P 10``."""
    return f"{as_mark(mark or '@0')} {plain_decimal(finite('move', 'distance', distance))}"


def axes_text(axes: Mapping[int, float], mark: str | PassMark) -> str:
    """Return joints and values as DriveEx takes them: ``@0 (1,10),(2,20)``.

    Raises:
        InvalidValue: no joint, or one that is no number from 1 to 8, or a value that is no finite number.
    """
    given: object = axes
    if not isinstance(given, Mapping) or not given or not all(map(_is_axis, given)):
        raise InvalidValue(tr("{axes}: joints are given as {{number: value}}, numbers from 1 to 8", axes=brief(axes)))
    pairs = ",".join(f"({axis},{plain_decimal(finite('drive', f'J{axis}', value))})" for axis, value in axes.items())
    return f"{as_mark(mark or '@0')} {pairs}"


def _is_axis(axis: object) -> bool:
    return isinstance(axis, int) and 1 <= axis <= 8


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def kind_of(pose: PoseLike, wanted: str) -> str:
    """Return the kind of a pose that is to be converted, P, T or J, from what its text says.

    Args:
        pose: the pose.
        wanted: the kind that it is to become.

    Raises:
        InvalidValue: it is of that kind already, or a vector.
        NotationError: the text is no pose.
    """
    kind = target_of(pose).kind or "P"
    if kind in (wanted, "V"):
        raise InvalidValue(tr("{pose} cannot be converted to {wanted}", pose=brief(pose), wanted=wanted))
    return kind


def target_of(pose: PoseLike) -> Target:
    """Return a pose as a target.

    Raises:
        InvalidValue: no pose.
        NotationError: the text is none.
    """
    return pose if isinstance(pose, Target) else parse_target(to_text(pose))


def literal_end(pose: PoseLike) -> J | P | None:
    """Return where a motion to a pose surely ends, if the pose itself says it."""
    try:
        end = target_of(pose)
    except ValueError:  # the controller will say what is wrong with it
        return None
    if end.extra is not None:
        return None
    known = end.pose
    return known if isinstance(known, J | P) else None


# --- answers ----------------------------------------------------------------------------------------------------------


def read_pose(kind: type[Pose], command: str, answer: Any) -> Pose:
    """Return the pose that a command was answered with.

    Raises:
        ProtocolError: it is none.
    """
    try:
        return kind.of(answer)
    except InvalidValue:
        raise not_understood(command, answer) from None


def read_number(command: str, answer: Any) -> float:
    """Return the number that a command was answered with.

    Raises:
        ProtocolError: it is none.
    """
    if isinstance(answer, int | float) and math.isfinite(answer):
        return answer
    raise not_understood(command, answer)


def is_missing(error: CallError) -> bool:
    """Return whether a controller says that it does not have a command."""
    return error.code in _MISSING
