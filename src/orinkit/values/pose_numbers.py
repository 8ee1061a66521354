"""What the numbers of poses are and mean, how many a pose has, how they are checked and written (:mod:`orinkit.values.poses`)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from decimal import Decimal
from enum import IntFlag
from itertools import islice
from typing import Any, Final, SupportsFloat, SupportsIndex

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.variant import plain

MAX_JOINTS: Final = 8
MAX_WHOLE: Final = 2**31 - 1
"""The largest number of a variable, and the largest Fig."""
EXTRA_JOINTS: Final = (7, 8)
COUNTS: Final[dict[str, tuple[int, int]]] = {"P": (6, 7), "T": (9, 10), "J": (1, MAX_JOINTS), "V": (3, 3), "": (1, 10)}
"""The fewest and the most numbers of each kind; ``""`` is that of a pose whose kind is not said."""
FIELDS: Final[dict[str, tuple[str, ...]]] = {
    "P": ("x", "y", "z", "rx", "ry", "rz", "fig"),
    "T": ("x", "y", "z", "ox", "oy", "oz", "ax", "ay", "az", "fig"),
    "V": ("x", "y", "z"),
    "J": tuple(f"J{joint}" for joint in range(1, MAX_JOINTS + 1)),
    "": tuple(f"value {place}" for place in range(1, 11)),
}

FIG_AUTO: Final = -1
"""Fig: the controller chooses the figure."""
FIG_NEAREST: Final = -2
"""Fig: the figure that changes least (RC9)."""
FIG_WITHIN_LIMITS: Final = -3
"""Fig: a figure within the software limits (RC9)."""

_SURELY_FINITE: Final = 1e300
_DECIMALS: Final = 6  # of a number that people see: a millionth of a mm or degree
_GREAT: Final = 10_000  # bits of a whole number whose decimal digits Python may refuse to write
_SHOWN: Final = 40  # characters of a value that an error message quotes


def listed(kind: str, values: object) -> list[Any]:
    """Return values as a list of a length that the kind can have.

    Raises:
        InvalidValue: they are no sequence, or too few or too many.
    """
    least, most = COUNTS[kind]
    values = plain(values)
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise InvalidValue(tr("{kind}: {values} is no sequence of numbers", kind=named(kind), values=brief(values)))
    items = list(islice(values, most + 1))
    if not least <= len(items) <= most:
        name, wanted, count = named(kind), counted(kind), len(items)
        if count > most:
            raise InvalidValue(
                tr(
                    "{kind}: more than {most} values were given, {wanted} are wanted",
                    kind=name,
                    most=most,
                    wanted=wanted,
                )
            )
        raise InvalidValue(
            tr("{kind}: {count} values were given, {wanted} are wanted", kind=name, count=count, wanted=wanted)
        )
    return items


def conform(kind: str, values: Iterable[object]) -> list[float]:
    """Return values of a kind as finite ``float``, the figure as a whole one.

    Raises:
        InvalidValue: one is not, by its name.
    """
    return [
        (whole if name == "fig" else finite)(named(kind), name, value)
        for name, value in zip(FIELDS[kind], values, strict=False)
    ]


def finite(owner: str, name: str, value: Any) -> float:
    """Return a number as finite ``float``.

    Raises:
        InvalidValue: it is none, or NaN, infinite or too large.
    """
    if type(value) in (float, int) and -_SURELY_FINITE < value < _SURELY_FINITE:  # the quick way for most
        return float(value)
    try:
        if isinstance(value, SupportsFloat | SupportsIndex) and not isinstance(value, bool):
            number = float(value)
            if math.isfinite(number):
                return number
    except (TypeError, ValueError, OverflowError):  # an array of several numbers, an int of hundreds of digits
        pass
    raise InvalidValue(
        tr("{owner}: {name} is {value}, a finite number is wanted", owner=owner, name=name, value=brief(value))
    )


def whole(owner: str, name: str, value: object) -> float:
    """Return a whole number of 32 bits as ``float``.

    Raises:
        InvalidValue: it is none.
    """
    number = finite(owner, name, value)
    if not is_whole(number):
        raise InvalidValue(
            tr(
                "{owner}: {name} is {value}, a whole number of 32 bits is wanted",
                owner=owner,
                name=name,
                value=brief(value),
            )
        )
    return number


def check_kind(kind: str) -> None:
    """Make sure that a target can be of this kind.

    Raises:
        InvalidValue: it cannot.
    """
    if kind not in COUNTS:
        raise InvalidValue(tr('a target of kind {kind}: "P", "T", "J", "V" or "" is wanted', kind=brief(kind)))


def check_index(kind: str, index: int) -> None:
    """Make sure that there can be such a variable.

    Raises:
        InvalidValue: no kind is said, or the number is negative or beyond 32 bits.
    """
    if not kind or isinstance(index, bool) or not 0 <= index <= MAX_WHOLE:
        raise InvalidValue(
            tr(
                "a target of kind {kind!r} with variable number {index}: a kind and a number from 0 are wanted",
                kind=kind,
                index=brief(index),
            )
        )


def is_whole(number: float) -> bool:
    """Tell whether a number can be a figure."""
    return number.is_integer() and abs(number) <= MAX_WHOLE


def written(kind: str, values: Iterable[float]) -> str:
    """Return numbers as a controller reads them: ``J(45, 30, 120)``."""
    return f"{kind}({', '.join(map(plain_decimal, values))})"


def rounded(kind: str, values: Iterable[float]) -> str:
    """Return numbers for people: as :func:`written`, but no more than six decimals of each."""
    return written(kind, [round(value, _DECIMALS) for value in values])


def plain_decimal(number: float) -> str:
    """Return the shortest decimal digits that are read as the same number, without an exponent: ``45``, ``0.0001``."""
    text = repr(number)
    if "e" in text:
        text = f"{Decimal(text):f}"
    return "0" if number == 0 else text.removesuffix(".0")


def counted(kind: str) -> str:
    """Return how many numbers a kind has, in words."""
    least, most = COUNTS[kind]
    if least == most:
        return str(most)
    if most - least == 1:
        return tr("{least} or {most}", least=least, most=most)
    return tr("{least} to {most}", least=least, most=most)


def named(kind: str) -> str:
    """Return what a message calls a kind."""
    return kind or tr("a pose")


def brief(value: object) -> str:
    """Return a value for a message: short, and whatever the value is."""
    try:
        text = f"{value:#x}" if isinstance(value, int) and value.bit_length() > _GREAT else repr(value)
    except Exception:  # noqa: BLE001 - somebody's __repr__
        return f"<{type(value).__name__}>"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


# --- figures ----------------------------------------------------------------------------------------------------------


class Figure(IntFlag):
    """The bits of Fig; a bit that is not set is RIGHTY, ABOVE, FLIP, SINGLE."""

    LEFTY = 1
    BELOW = 2
    NONFLIP = 4
    J6_DOUBLE = 8
    J4_DOUBLE = 16
    J1_DOUBLE = 32


_FIGURE_NAMES: Final = {FIG_AUTO: "AUTO", FIG_NEAREST: "NEAREST", FIG_WITHIN_LIMITS: "WITHIN LIMITS"}
_DOUBLES: Final = {Figure.J6_DOUBLE: "J6 DOUBLE", Figure.J4_DOUBLE: "J4 DOUBLE", Figure.J1_DOUBLE: "J1 DOUBLE"}


def describe_figure(fig: float) -> str:
    """Return a figure in words, ``LEFTY ABOVE NONFLIP`` for 5; bits without a name as their number (COBOTTA's 256).

    Args:
        fig: a whole number; negative ones are AUTO, NEAREST, WITHIN LIMITS.

    Raises:
        InvalidValue: no whole number.
    """
    bits = int(whole("Fig", "fig", fig))
    if bits < 0:
        return _FIGURE_NAMES.get(bits, str(bits))
    words = [
        "LEFTY" if bits & Figure.LEFTY else "RIGHTY",
        "BELOW" if bits & Figure.BELOW else "ABOVE",
        "NONFLIP" if bits & Figure.NONFLIP else "FLIP",
        *(name for bit, name in _DOUBLES.items() if bits & bit),
    ]
    unknown = bits & ~63  # those above
    return " ".join([*words, str(unknown)] if unknown else words)
