"""The table of built-in functions: names, numbers of arguments, implementations.

Angles are in deg, as on the controller. Positions in strings are counted from 1; lengths of strings are in characters.
``Rnd`` returns the same sequence after every start of the program.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript import values
from orinkit.virtual.rc8.pacscript.errors import out_of_range
from orinkit.virtual.rc8.pacscript.robot_words import VALUES
from orinkit.virtual.rc8.pacscript.values import AnyValue, number, rounded_to_integer, string

_LEADING_NUMBER: Final = re.compile(
    r"[ \t]*(?:&[hH](?P<hex>[0-9a-fA-F]{1,8})|&[bB](?P<bin>[01]{1,32})"
    r"|(?P<real>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?))"
)
_MAX_ARGUMENTS: Final = 16


@dataclass(frozen=True, slots=True)
class Function:
    """A built-in function.

    Attributes:
        name: Name as documented.
        least: Minimum number of arguments.
        most: Maximum number of arguments.
        run: Calculates the result from the arguments.
        framed: If True, ``run`` takes the frame, which contains the interface to the controller, before the arguments.
    """

    name: str
    least: int
    most: int
    run: Callable[..., AnyValue]
    framed: bool = False


# --- numbers ----------------------------------------------------------------------------------------------------------


def _absolute(value: AnyValue) -> AnyValue:
    return values.negate(value) if number(value) < 0 else value


def _sign(value: AnyValue) -> int:
    given = number(value)
    return (given > 0) - (given < 0)


def _floor(value: AnyValue) -> int:
    return rounded_to_integer(math.floor(number(value)))


def _truncate(value: AnyValue) -> int:
    return rounded_to_integer(math.trunc(number(value)))


def _real(calculate: Callable[..., float]) -> Callable[..., float]:
    def run(*arguments: AnyValue) -> float:
        try:
            return values.finite(calculate(*(float(number(value)) for value in arguments)))
        except (ValueError, OverflowError):
            shown = ", ".join(map(values.text, arguments))
            raise out_of_range(tr("the function is undefined for {shown}", shown=shown)) from None

    return run


def _of_angle(calculate: Callable[[float], float]) -> Callable[..., float]:
    return _real(lambda angle: calculate(math.radians(angle)))


def _to_angle(calculate: Callable[..., float]) -> Callable[..., float]:
    return _real(lambda *arguments: math.degrees(calculate(*arguments)))


def _largest(*arguments: AnyValue) -> AnyValue:
    return max(map(number, arguments))


def _smallest(*arguments: AnyValue) -> AnyValue:
    return min(map(number, arguments))


# --- strings ----------------------------------------------------------------------------------------------------------


def _count(value: AnyValue) -> int:
    count = rounded_to_integer(value)
    if count >= 0:
        return count
    raise out_of_range(tr("the number of characters is negative: {count}", count=count))


def _position(value: AnyValue) -> int:
    position = rounded_to_integer(value)
    if position >= 1:
        return position - 1
    raise out_of_range(tr("position {position} is less than 1", position=position))


def _left(text: AnyValue, count: AnyValue) -> str:
    return string(text)[: _count(count)]


def _right(text: AnyValue, count: AnyValue) -> str:
    whole_text = string(text)
    return whole_text[max(len(whole_text) - _count(count), 0) :]


def _middle(text: AnyValue, start: AnyValue, count: AnyValue = values.MAX_TEXT) -> str:
    first = _position(start)
    return string(text)[first : first + _count(count)]


def _value_of(text: AnyValue) -> AnyValue:
    found = _LEADING_NUMBER.match(string(text))
    if found is None:
        return 0
    if found["real"] is None:
        bits = int(found["hex"], 16) if found["hex"] else int(found["bin"], 2)
        return bits if bits <= values.LARGEST else bits - 2**32
    return values.finite(float(found["real"]))


def _character(code: AnyValue) -> str:
    code = rounded_to_integer(code)
    try:
        return bytes([code]).decode("cp932")
    except (ValueError, UnicodeDecodeError):
        raise out_of_range(tr("{code} is not a character code", code=code)) from None


def _code(text: AnyValue) -> int:
    text = string(text)
    try:
        return int.from_bytes(text[:1].encode("cp932"), "big") if text else _no_text()
    except UnicodeEncodeError:
        raise out_of_range(tr("the character has no code in Shift_JIS")) from None


def _no_text() -> int:
    raise out_of_range(tr("the string is empty"))


def _find(*arguments: AnyValue) -> int:
    first = _position(arguments[0]) if len(arguments) > 2 else 0
    text, wanted = string(arguments[-2]), string(arguments[-1])
    return text.find(wanted, first) + 1


def _digits(form: str) -> Callable[[AnyValue], str]:
    return lambda value: format(rounded_to_integer(value) % 2**32, form)


def _of_text(change: Callable[[str], str]) -> Callable[[AnyValue], str]:
    return lambda text: values.check_length(change(string(text)))


# --- poses ------------------------------------------------------------------------------------------------------------

_PLACED: Final = values.pose("P", "T", "V")
_POSITION: Final = values.pose("P")
_JOINTS: Final = values.pose("J")
_TRANSFORM: Final = values.pose("T")
_FIGURED: Final = values.pose("P", "T")
_VECTOR: Final = values.pose("V")
_ANY_POSE: Final = values.pose("P", "J", "T")


def _element(take: Callable[[AnyValue], tuple[float, ...]], place: int) -> Callable[[AnyValue], float]:
    return lambda value: take(value)[place]


def _figure(value: AnyValue) -> int:
    return rounded_to_integer(_FIGURED(value)[-1])


def joint_index(value: AnyValue) -> int:
    """Return the index of a joint, 0 to 7, from its number, 1 to 8.

    Raises:
        CallError: VARIABLE_CHANGE_FAILED if the value is not a number; VALUE_OUT_OF_RANGE if the number is not 1 to 8.
    """
    joint = rounded_to_integer(value)
    if 1 <= joint <= values.J_LENGTH:
        return joint - 1
    raise out_of_range(tr("joint {joint} is not in 1 to 8", joint=joint))


def _joint(joint: AnyValue, value: AnyValue) -> float:
    return _JOINTS(value)[joint_index(joint)]


def _part(start: int) -> Callable[[AnyValue], tuple[float, ...]]:
    return lambda value: _TRANSFORM(value)[start : start + values.V_LENGTH]


def _make(kind: str, least: int, *, fig: bool) -> Function:
    length = values.LENGTHS[kind]
    rest = [0.0] * length
    if fig:
        rest[-1] = -1.0  # Fig: the controller chooses the figure

    def run(*elements: AnyValue) -> tuple[float, ...]:
        given = [float(number(element)) for element in elements]
        if fig and len(given) == length:
            given[-1] = float(rounded_to_integer(given[-1]))
        return tuple(given + rest[len(given) :])

    return Function(kind, least, length, run)


POSES: Final[Mapping[str, Function]] = {
    "p": _make("P", 1, fig=True),
    "j": _make("J", 1, fig=False),
    "t": _make("T", 9, fig=True),
    "v": _make("V", 1, fig=False),
}
"""The constructors of poses ``P(...)``, ``J(...)``, ``T(...)`` and ``V(...)``, by name in lower case.

Omitted values are 0, an omitted Fig is -1."""


# --- the controller ---------------------------------------------------------------------------------------------------


def _current(kind: str, *, dest: bool) -> Callable[..., AnyValue]:
    if kind == "FIG":
        return lambda frame: rounded_to_integer(frame[0].current("FIG", dest))
    return lambda frame: tuple(frame[0].current(kind, dest))


def _convert(name: str, *takes: Callable[[AnyValue], AnyValue]) -> Callable[..., AnyValue]:
    def run(frame: list[Any], *arguments: AnyValue) -> AnyValue:
        result = frame[0].convert(name, tuple(take(value) for take, value in zip(takes, arguments, strict=False)))
        return tuple(result) if isinstance(result, tuple) else rounded_to_integer(result)

    return run


def _robot_value(name: str) -> Callable[..., AnyValue]:
    """Return a function that reads a value of the robot; six numbers become a position without a figure."""

    def run(frame: list[Any], *arguments: AnyValue) -> AnyValue:
        value = frame[0].robot_value(name, arguments)
        if not isinstance(value, tuple):
            return value
        return (*value, -1.0) if len(value) == values.P_LENGTH - 1 else value

    return run


def _timer(frame: list[Any]) -> int:
    return int(frame[0].now() * 1000) % 2**31


def _random(frame: list[Any]) -> float:
    return float(frame[1].random())


def _tool(value: AnyValue) -> AnyValue:
    return value if isinstance(value, tuple) and len(value) == values.P_LENGTH else rounded_to_integer(value)


def _table() -> Mapping[str, Function]:
    fixed: tuple[tuple[str, int, int, Callable[..., AnyValue]], ...] = (
        ("Abs", 1, 1, _absolute), ("Sgn", 1, 1, _sign), ("Int", 1, 1, _floor), ("Fix", 1, 1, _truncate),
        ("Sqr", 1, 1, _real(math.sqrt)), ("Exp", 1, 1, _real(math.exp)), ("Log", 1, 1, _real(math.log)),
        ("Log10", 1, 1, _real(math.log10)), ("Pow", 2, 2, values.power),
        ("Sin", 1, 1, _of_angle(math.sin)), ("Cos", 1, 1, _of_angle(math.cos)), ("Tan", 1, 1, _of_angle(math.tan)),
        ("Asin", 1, 1, _to_angle(math.asin)), ("Acos", 1, 1, _to_angle(math.acos)),
        ("Atn", 1, 1, _to_angle(math.atan)), ("Atn2", 2, 2, _to_angle(math.atan2)),
        ("DegRad", 1, 1, _real(math.radians)), ("RadDeg", 1, 1, _real(math.degrees)),
        ("Max", 2, _MAX_ARGUMENTS, _largest), ("Min", 2, _MAX_ARGUMENTS, _smallest),
        ("Len", 1, 1, lambda text: len(string(text))), ("Left", 2, 2, _left), ("Right", 2, 2, _right),
        ("Mid", 2, 3, _middle), ("Str", 1, 1, values.text), ("Val", 1, 1, _value_of), ("Chr", 1, 1, _character),
        ("Asc", 1, 1, _code), ("Ord", 1, 1, _code), ("InStr", 2, 3, _find), ("StrPos", 2, 2, _find),
        ("Hex", 1, 1, _digits("X")), ("Bin", 1, 1, _digits("b")),
        ("UCase", 1, 1, _of_text(str.upper)), ("LCase", 1, 1, _of_text(str.lower)),
        ("Trim", 1, 1, _of_text(lambda text: text.strip(" "))),
        ("LTrim", 1, 1, _of_text(lambda text: text.lstrip(" "))),
        ("RTrim", 1, 1, _of_text(lambda text: text.rstrip(" "))),
        ("PosX", 1, 1, _element(_PLACED, 0)), ("PosY", 1, 1, _element(_PLACED, 1)),
        ("PosZ", 1, 1, _element(_PLACED, 2)), ("PosRX", 1, 1, _element(_POSITION, 3)),
        ("PosRY", 1, 1, _element(_POSITION, 4)), ("PosRZ", 1, 1, _element(_POSITION, 5)),
        ("Fig", 1, 1, _figure), ("Joint", 2, 2, _joint),
        ("PVec", 1, 1, lambda value: _FIGURED(value)[:3]), ("OVec", 1, 1, _part(3)), ("AVec", 1, 1, _part(6)),
        ("Magnitude", 1, 1, lambda value: values.finite(math.hypot(*_VECTOR(value)))),
    )  # fmt: skip
    framed: tuple[tuple[str, int, int, Callable[..., AnyValue]], ...] = (
        ("CurPos", 0, 0, _current("P", dest=False)), ("CurJnt", 0, 0, _current("J", dest=False)),
        ("CurTrn", 0, 0, _current("T", dest=False)), ("CurFig", 0, 0, _current("FIG", dest=False)),
        ("DestPos", 0, 0, _current("P", dest=True)), ("DestJnt", 0, 0, _current("J", dest=True)),
        ("DestTrn", 0, 0, _current("T", dest=True)),
        ("J2P", 1, 1, _convert("J2P", _JOINTS)), ("J2T", 1, 1, _convert("J2T", _JOINTS)),
        ("P2J", 1, 1, _convert("P2J", _POSITION)), ("P2T", 1, 1, _convert("P2T", _POSITION)),
        ("T2J", 1, 1, _convert("T2J", _TRANSFORM)), ("T2P", 1, 1, _convert("T2P", _TRANSFORM)),
        ("Dev", 2, 2, _convert("Dev", _POSITION, _POSITION)), ("DevH", 2, 2, _convert("DevH", _POSITION, _POSITION)),
        ("OutRange", 1, 3, _convert("OutRange", _ANY_POSE, _tool, _tool)),
        ("Timer", 0, 0, _timer), ("Rnd", 0, 0, _random),
        *((word, each.least, each.most, _robot_value(each.name)) for word, each in VALUES.items()),
    )  # fmt: skip
    every = [Function(*row) for row in fixed] + [Function(*row, framed=True) for row in framed]
    return {function.name.lower(): function for function in every}


FUNCTIONS: Final = _table()
"""All functions except the constructors of poses, by name in lower case."""


LET_PARTS: Final[Mapping[str, tuple[Callable[[AnyValue], tuple[float, ...]], int]]] = {
    "LetX": (_PLACED, 0), "LetY": (_PLACED, 1), "LetZ": (_PLACED, 2), "LetRX": (_POSITION, 3), "LetRY": (_POSITION, 4),
    "LetRZ": (_POSITION, 5), "LetF": (_FIGURED, -1), "LetJ": (_JOINTS, 0),
}  # fmt: skip
"""For ``LetX P1 = ...`` and similar commands: the function that checks the pose, and the index of the element to set.

The index of LetJ is not used, because the command itself contains the number of the joint."""
