"""The option string of motions: ``"SPEED=50,NEXT"``, ``"@0,Pose=1,TIME=200,NEXT"`` (RC8 3.3.4).

===================================  ================================================================================
option                               meaning
===================================  ================================================================================
``SPEED=n``, ``S=n``                 speed in percent, above 0, at most 100
``ACCEL=n``, ``DECEL=n``             acceleration and deceleration in percent, above 0, at most 100
``TIME=n``                           duration of the motion in ms, above 0, at most 3,600,000
``NEXT``                             the call returns before the motion ends
``@0``, ``@E``, ``@P``, ``@n``       pass mark of functions without a pose: Rotate, Drive
``Pose=1``, ``Pose=2``               for Rotate. 1: while it moves about the axis of rotation, the tool turns about this
                                     axis too; 2: the tool keeps its orientation
===================================  ================================================================================

In SPEED, ACCEL, DECEL and TIME, a variable of class I, F or D may replace the number: ``SPEED=F2`` or ``SPEED=F[2]``.
Case, blanks and empty parts are ignored; a leading comma, for example, is allowed. If an option is repeated, the last
one counts. IF and UNTIL belong to PacScript and are refused, as are all other options.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final, Literal, TypeAlias

from orinkit.core import hresult
from orinkit.core.errors import CallError, NotationError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.core.record import record
from orinkit.values.poses import PassMark

MAX_PERCENT: Final = 100.0
"""Largest speed, acceleration and deceleration, percent."""
MAX_TIME: Final = 3_600_000.0
"""Longest duration of a motion, ms."""

_MAX_LENGTH: Final = 1024
_KNOWN: Final = "SPEED (S), ACCEL, DECEL, TIME, NEXT, POSE, @0, @E, @P, @n"
_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_VARIABLE: Final = re.compile(r"([IFDifd])[ \t]*(?:([0-9]{1,9})|\[[ \t]*([0-9]{1,9})[ \t]*\])")
_CONDITION: Final = re.compile(r"(?:IF|UNTIL)\b")
_FLAGS: Final = {"1": True, "TRUE": True, "0": False, "FALSE": False}
_FIELDS: Final = {"SPEED": "speed", "S": "speed", "ACCEL": "accel", "DECEL": "decel", "TIME": "time"}


VariableKind: TypeAlias = Literal["I", "F", "D"]
"""The classes of variables that hold one number."""


@record
class VariableRef:
    """A global variable that replaces the number of an option: ``F2``.

    Attributes:
        kind: Class of the variable: I, F or D.
        index: Index of the variable, from 0.
        most: Largest value that the variable may have, MAX_PERCENT or MAX_TIME.
    """

    kind: VariableKind
    index: int
    most: float = MAX_PERCENT

    def __str__(self) -> str:
        return f"{self.kind}{self.index}"


Amount: TypeAlias = float | VariableRef
"""A number, or a variable that holds the number."""


@record
class MotionOptions:
    """The options of one motion; an option that was not given is ``None`` or False.

    Attributes:
        speed: Speed, percent.
        accel: Acceleration, percent.
        decel: Deceleration, percent.
        time: Duration, ms.
        next: True if the call returns before the motion ends.
        mark: Pass mark.
        pose: For Rotate, 1 if the tool turns about the axis of rotation too, 2 if the tool keeps its orientation.
    """

    speed: Amount | None = None
    accel: Amount | None = None
    decel: Amount | None = None
    time: Amount | None = None
    next: bool = False
    mark: PassMark | None = None
    pose: int | None = None


def parse_options(text: str) -> MotionOptions:
    """Parse an option string; the module's docstring lists the options.

    Raises:
        CallError: MOTION_OPTION_INVALID if an option does not exist or is not valid; VALUE_OUT_OF_RANGE if a number is
            too small or too large.
    """
    if len(text) > _MAX_LENGTH:
        raise _invalid(
            tr(
                "option string of {count} characters exceeds the limit of {most}",
                count=len(text),
                most=_MAX_LENGTH,
            ),
        )
    found: dict[str, Any] = {}
    for part in text.split(","):
        if part.strip():
            field, value = _option(part.strip())
            found[field] = value
    return MotionOptions(**found)


def resolve(amount: Amount, read: Callable[[VariableKind, int], float]) -> float:
    """Return an amount as a number, reading its variable if necessary.

    Args:
        amount: An amount of :class:`MotionOptions`.
        read: Callback that returns the value of a variable for its class and index.

    Raises:
        CallError: VALUE_OUT_OF_RANGE if the variable's value is out of range. Exceptions of ``read`` are passed on.
    """
    if not isinstance(amount, VariableRef):
        return amount
    return _within(str(amount), float(read(amount.kind, amount.index)), amount.most)


def _option(part: str) -> tuple[str, Any]:
    """Return the name of the field that an option sets, and its value."""
    if part.startswith("@"):
        return "mark", _mark(part)
    name, equals, value = (piece.strip() for piece in part.partition("="))
    name = name.upper()
    if name in _FIELDS:
        field = _FIELDS[name]
        return field, _amount(part, value, MAX_TIME if field == "time" else MAX_PERCENT)
    if name == "NEXT":
        return "next", _flag(part, value if equals else "1")
    if name == "POSE":
        return "pose", _pose(part, value)
    if _CONDITION.match(name):
        raise _invalid(
            tr(
                "{part}: IF and UNTIL are only valid in PacScript programs. Try: {known}",
                part=quoted(part),
                known=_KNOWN,
            ),
        )
    raise _invalid(
        tr("{part} is not a motion option. Try: {known}", part=quoted(part), known=_KNOWN),
    )


def _mark(part: str) -> PassMark:
    try:
        return PassMark.parse(part)
    except NotationError as error:
        raise error_for(hresult.MOTION_OPTION_INVALID, f"{quoted(part)}: {error}") from None


def _amount(part: str, value: str, most: float) -> Amount:
    variable = _VARIABLE.fullmatch(value)
    if variable:
        kind: Any = variable[1].upper()
        return VariableRef(kind, int(variable[2] or variable[3]), most)
    return _within(part, _number(part, value), most)


def _flag(part: str, value: str) -> bool:
    flag = _FLAGS.get(value.upper())
    if flag is None:
        raise _invalid(
            tr("{part}: expected NEXT without a value, NEXT=1 or NEXT=0", part=quoted(part)),
        )
    return flag


def _pose(part: str, value: str) -> int:
    number = _number(part, value)
    if number not in (1, 2):
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{part}: expected 1 or 2", part=quoted(part)),
        )
    return int(number)


def _number(part: str, value: str) -> float:
    if _NUMBER.fullmatch(value) is None:
        raise _invalid(
            tr(
                "{part}: expected a number after the equals sign; options for speed, acceleration, deceleration "
                "and time also accept a variable such as F2",
                part=quoted(part),
            ),
        )
    return float(value)


def _within(part: str, number: float, most: float) -> float:
    if not 0 < number <= most:  # rejects NaN as well
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr(
                "{part:.40}: {number:.10g} is out of range; expected above 0 and at most {most:.0f}",
                part=part,
                number=number,
                most=most,
            ),
        )
    return number


def _invalid(text: str) -> CallError:
    return error_for(hresult.MOTION_OPTION_INVALID, text)
