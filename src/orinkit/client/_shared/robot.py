"""Arguments of motions and results of commands, shared by the asynchronous and the synchronous client; no I/O."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, ForwardRef, TypedDict, TypeVar, get_overloads

from orinkit.client._shared.common import unexpected_value
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_amount, check_finite, is_number
from orinkit.values.pose_numbers import plain_decimal
from orinkit.values.poses import J, P, PassMark, PoseLike, T, Target, V, as_mark, parse_target, parse_targets, to_text
from orinkit.values.variant import Value, Variant, plain

PTP: Final = 1
LINE: Final = 2
ARC: Final = 3
CURVE: Final = 4

HOLDING_COMMANDS: Final = frozenset(("takearm", "givearm", "motor"))
"""Commands, in lower case, that never move the arm."""

_MISSING: Final = (hresult.E_NOTIMPL, hresult.E_INVALID_CMD_NAME, hresult.E_INVALIDARG, hresult.FUNCTION_NOT_DEFINED)
_MAX_DEPTH: Final = 32  # levels of nested lists; a VARIANT may have fewer
_PASSING: Final = re.compile(r"@\s*(?:[Pp]|[0-9.+]*[1-9])")
MAX_PERCENT: Final = 100.0
"""Largest value of ``speed``, ``accel`` and ``decel``."""
_MAX_SECONDS: Final = 3600.0
_JOINTS: Final = 6  # number of joints of most arms

Pose = TypeVar("Pose", P, T, J)
F = TypeVar("F", bound=Callable[..., Any])


class MoveOptions(TypedDict, total=False):
    """Keyword options of a motion. The controller's settings apply to omitted options.

    Attributes:
        speed: Speed in percent, above 0 and at most 100.
        accel: Acceleration in percent, above 0 and at most 100.
        decel: Deceleration in percent, above 0 and at most 100.
        time: Duration of the motion in s, above 0 and at most 3600.
        wait: True (the default) to wait for the end of the motion, False to return immediately (NEXT).
    """

    speed: float
    accel: float
    decel: float
    time: float
    wait: bool


class _Default:
    """Default of a motion option in a signature for ``help()``; it stands for the setting of the controller."""

    def __repr__(self) -> str:
        return "..."


def document_options(function: F) -> F:
    """Set the signature that ``help()`` shows for a function, and return the function.

    The signature is that of the last overload, in which each option of a motion is listed as a keyword argument.
    """
    *_, shown = get_overloads(function) or [function]
    signature = inspect.signature(shown)
    named = [each for each in signature.parameters.values() if each.kind is not inspect.Parameter.VAR_KEYWORD]
    options = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=True if name == "wait" else _Default(),
            annotation=annotation.__forward_arg__ if isinstance(annotation, ForwardRef) else annotation,
        )
        for name, annotation in MoveOptions.__annotations__.items()
    ]
    target: Any = function
    target.__signature__ = signature.replace(parameters=[*named, *options])
    return function


def option_text(options: MoveOptions, mark: str = "") -> tuple[str, bool]:
    """Return the option string of a motion (RC8 3.3.4), and True if the call waits for the end of the motion.

    Args:
        options: Keyword options.
        mark: Pass mark to put into the option string, as Robot_Rotate requires.

    Raises:
        TypeError: If an option is unknown.
        InvalidValue: If a value is not a number or is out of range.
    """
    if unknown := options.keys() - MoveOptions.__annotations__.keys():
        known = ", ".join(MoveOptions.__annotations__)
        raise TypeError(tr("unknown motion option {name!r}. Try: {known}", name=min(unknown), known=known))
    parts = [mark] if mark else []
    parts += [
        f"{name.upper()}={plain_decimal(check_amount(name, options.get(name), MAX_PERCENT, 'move'))}"
        for name in ("speed", "accel", "decel")
        if name in options
    ]
    if "time" in options:
        parts.append(f"TIME={max(1, round(check_amount('time', options['time'], _MAX_SECONDS, 'move') * 1000))}")
    wait = options.get("wait", True)
    return ",".join(parts if wait else [*parts, "NEXT"]), bool(wait)


def waits(option: str) -> bool:
    """Return True if the controller replies to a motion with this option string only at the end of the motion."""
    return all(part.strip().upper() not in ("NEXT", "NEXT=1") for part in str(option).split(","))


# --- the two forms of move and drive ----------------------------------------------------------------------------------


def is_raw(first: str, arguments: tuple[object, ...], named: Mapping[str, object]) -> bool:
    """Return True if a method was called in the form of CAO, in which the first argument is a number.

    Args:
        first: Name of the first argument in the form of CAO.
        arguments: Positional arguments of the call.
        named: Keyword arguments of the call.
    """
    return first in named or (bool(arguments) and isinstance(arguments[0], int))


def check_move(arguments: tuple[object, ...], named: Mapping[str, Any]) -> None:
    """Check that ``move`` was called in one of its two forms.

    Raises:
        TypeError: If the arguments match neither form; the message shows both.
    """
    if len(arguments) > 1 and not named and all(map(is_number, arguments)) and (len(arguments), arguments[0]) != (2, 4):
        numbers = ", ".join(f"{number:g}" for number in arguments)
        raise TypeError(
            tr(
                "Robot.move() takes a pose, not numbers. Try: move(J({numbers})) for joints, "
                "move(P({numbers})) for a position",
                numbers=numbers,
            )
        )
    form = _MOVE_RAW if is_raw("interpolation", arguments, named) else _MOVE
    _check_form("move", form, arguments, named, 'move(J(...), "@E", speed=20)', 'move(1, "@E P1", "SPEED=20")')


def check_drive(arguments: tuple[object, ...], named: Mapping[str, Any]) -> None:
    """Check that ``drive`` was called in one of its two forms.

    Raises:
        TypeError: If the arguments match neither form; the message shows both.
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
                "Robot.{name}(): {error}. Try: {usual} or, in the form of CAO, {raw}",
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


# --- poses in requests ------------------------------------------------------------------------------------------------


def sendable(value: Value, depth: int = 0) -> Value:
    """Return a value of CAO in which each pose, also in lists, is replaced by its text.

    The numbers alone do not determine the type of a pose: a controller could interpret the numbers of a J as a P.
    """
    given: Any = value
    if isinstance(given, P | T | J | V | Target):
        return to_text(given)
    if isinstance(given, PassMark):
        return str(given)
    if isinstance(given, list | tuple) and depth < _MAX_DEPTH:
        return [sendable(each, depth + 1) for each in given]
    return value


def raw_pose(pose: Value) -> Value:
    """Check the pose of a motion in the form of CAO; return it with each pose object replaced by its text.

    Raises:
        InvalidValue: If the pose is 6 numbers, which may be joints or a position.
    """
    text = sendable(pose)
    values = plain(text)
    numbers = values.tolist() if hasattr(values, "tolist") else values  # numpy arrays
    if isinstance(numbers, list | tuple) and len(numbers) == _JOINTS and all(map(is_number, numbers)):
        raise InvalidValue(tr("{pose}: 6 numbers may be joints or a position. Try: J(...) or P(...)", pose=brief(pose)))
    return text


def pose_text(pose: PoseLike, mark: str | PassMark = "") -> str:
    """Return the text to send for a pose; a pose given as text is checked.

    Raises:
        InvalidValue: If the value is not a pose; for a text, the message gives the column.
        NotationError: If the mark is not a pass mark.
    """
    text = to_text(pose, mark)
    if isinstance(pose, str):
        try:
            parse_targets(pose)
        except NotationError as error:
            raise InvalidValue(
                tr(
                    "{pose} is not a pose: {error}. Try: move(1, text) to send a text without checking it",
                    pose=brief(pose),
                    error=error,
                )
            ) from None
    return text


def passes(arguments: object) -> bool:
    """Return True if the reply to a motion may arrive while the arm still moves.

    This is possible if the pass mark in the arguments is ``@P`` or a radius. A list or a Variant among the arguments is
    not examined; the result is then True.
    """
    if isinstance(arguments, str):
        return _PASSING.search(arguments) is not None
    if isinstance(arguments, list | tuple):
        return any(isinstance(each, list | tuple) or passes(each) for each in arguments)
    return isinstance(arguments, Variant)


def arc_text(via: PoseLike, end: PoseLike, mark: str | PassMark) -> str:
    """Return the two poses of an arc as text, with the pass mark of the end (RC8 3.3.4): ``P1, @E P2``."""
    return f"{pose_text(via)}, {pose_text(end, mark)}"


def curve_text(path: int | Sequence[PoseLike], mark: str | PassMark) -> str:
    """Return the path of a free curve as text: the number of a stored path, or its poses.

    Raises:
        InvalidValue: If a pose is invalid, the list is empty, or the number is below 0.
    """
    if isinstance(path, int):
        if path < 0:
            raise InvalidValue(tr("{path} is not a path number", path=path))
        return f"{as_mark(mark)} {path}" if mark else str(path)
    poses: object = path
    if not isinstance(poses, list | tuple) or isinstance(poses, P | T | J | V) or not poses:
        raise InvalidValue(tr("{path} is neither the number of a stored path nor a list of poses", path=brief(path)))
    *middle, last = path
    return ", ".join([*map(pose_text, middle), pose_text(last, mark)])


def distance_text(distance: float, mark: str | PassMark) -> str:
    """Return a distance in mm with its pass mark, as text for Approach and Depart: ``@P 10``."""
    return f"{as_mark(mark or '@0')} {plain_decimal(check_finite('distance', distance, 'move'))}"


def axes_text(axes: Mapping[int, float], mark: str | PassMark) -> str:
    """Return axes and their values as text for DriveEx and DriveAEx: ``@0 (1,10),(2,20)``.

    Raises:
        InvalidValue: If no axis is given, an axis is not an integer from 1 to 8, or a value is not a finite number.
    """
    given: object = axes
    if not isinstance(given, Mapping) or not given or not all(map(_is_axis, given)):
        raise InvalidValue(tr("{axes} does not have the form {{axis: value}} with axes from 1 to 8", axes=brief(axes)))
    pairs = ",".join(
        f"({axis},{plain_decimal(check_finite(f'J{axis}', value, 'drive'))})" for axis, value in axes.items()
    )
    return f"{as_mark(mark or '@0')} {pairs}"


def _is_axis(axis: object) -> bool:
    return isinstance(axis, int) and 1 <= axis <= 8


def kind_of(pose: PoseLike, wanted: str) -> str:
    """Return the type of a pose that is to be converted: P, T or J.

    Args:
        pose: Pose to convert.
        wanted: Type to convert it to.

    Raises:
        InvalidValue: If the pose already has that type, or is a vector.
        NotationError: If the text is not a pose.
    """
    pose_type = as_target(pose).kind or "P"
    if pose_type in (wanted, "V"):
        raise InvalidValue(tr("{pose} cannot be converted to {wanted}", pose=brief(pose), wanted=wanted))
    return pose_type


def as_target(pose: PoseLike) -> Target:
    """Return the target that a pose describes; a pose that is given as text is parsed.

    Raises:
        InvalidValue: If the value is not a pose.
        NotationError: If the text is not a pose.
    """
    return pose if isinstance(pose, Target) else parse_target(to_text(pose))


def literal_end(pose: PoseLike) -> J | P | None:
    """Return the end of a motion to a pose, if the pose contains the end as J or P.

    Otherwise, for example if the pose is the variable ``"P1"``, return ``None``.
    """
    try:
        end = as_target(pose)
    except ValueError:  # the controller reports the error
        return None
    if end.extra is not None:
        return None
    known = end.pose
    return known if isinstance(known, J | P) else None


# --- results ----------------------------------------------------------------------------------------------------------


def read_pose(pose_type: type[Pose], command: str, value: Any) -> Pose:
    """Return the result of a command as a pose.

    Raises:
        ProtocolError: If the value is not a pose of the given type.
    """
    try:
        return pose_type.of(value)
    except InvalidValue:
        raise unexpected_value(command, value) from None


def read_number(command: str, value: Any) -> float:
    """Return the result of a command as a number.

    Raises:
        ProtocolError: If the value is not a finite number.
    """
    if isinstance(value, int | float) and math.isfinite(value):
        return value
    raise unexpected_value(command, value)


def is_missing(error: CallError) -> bool:
    """Return True if the error means that the controller does not have the command."""
    return error.code in _MISSING
