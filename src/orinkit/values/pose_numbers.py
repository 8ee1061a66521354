"""The numbers of poses (names, count, checks, text form) and figures, for :mod:`orinkit.values.poses`."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from enum import IntFlag
from itertools import islice
from typing import Any, Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_finite
from orinkit.values.variant import plain

MAX_JOINTS: Final = 8
MAX_WHOLE: Final = 2**31 - 1
"""Largest index of a variable, and largest Fig."""
EXTRA_JOINTS: Final = (7, 8)
COUNTS: Final[dict[str, tuple[int, int]]] = {"P": (6, 7), "T": (9, 10), "J": (1, MAX_JOINTS), "V": (3, 3), "": (1, 10)}
"""For each pose type, the smallest and the largest count of numbers of a pose; ``""`` is an unspecified type."""
FIELDS: Final[dict[str, tuple[str, ...]]] = {
    "P": ("x", "y", "z", "rx", "ry", "rz", "fig"),
    "T": ("x", "y", "z", "ox", "oy", "oz", "ax", "ay", "az", "fig"),
    "V": ("x", "y", "z"),
    "J": tuple(f"J{joint}" for joint in range(1, MAX_JOINTS + 1)),
    "": tuple(f"value {place}" for place in range(1, 11)),
}

FIG_AUTO: Final = -1
"""Value of Fig for which the controller chooses the figure."""
FIG_NEAREST: Final = -2
"""Value of Fig for which the controller chooses the figure with the least change (RC9)."""
FIG_WITHIN_LIMITS: Final = -3
"""Value of Fig for which the controller chooses a figure within the soft limits (RC9)."""

_DECIMALS: Final = 6  # number of decimals of a displayed number


def listed(kind: str, values: object) -> list[Any]:
    """Return values as a list of a length that is valid for the pose type.

    Raises:
        InvalidValue: If the values are not a sequence, or their number is wrong.
    """
    least, most = COUNTS[kind]
    values = plain(values)
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise InvalidValue(
            tr("{kind}: {values} is not a sequence of numbers", kind=kind_name(kind), values=brief(values))
        )
    items = list(islice(values, most + 1))
    if not least <= len(items) <= most:
        name, wanted, count = kind_name(kind), counted(kind), len(items)
        if count > most:
            raise InvalidValue(
                tr(
                    "{kind}: got more than {most} values, expected {wanted}",
                    kind=name,
                    most=most,
                    wanted=wanted,
                )
            )
        raise InvalidValue(tr("{kind}: got {count} values, expected {wanted}", kind=name, count=count, wanted=wanted))
    return items


def to_floats(kind: str, values: Iterable[object]) -> list[float]:
    """Return the values of a pose type as finite ``float``; the figure must be a whole number.

    Raises:
        InvalidValue: If a value is not valid; the message contains its name.
    """
    return [
        (whole if name == "fig" else check_finite)(name, value, kind_name(kind))
        for name, value in zip(FIELDS[kind], values, strict=False)
    ]


def whole(name: str, value: object, owner: str) -> float:
    """Return a whole number of 32 bits as ``float``.

    Raises:
        InvalidValue: If the value is not a whole number of 32 bits.
    """
    number = check_finite(name, value, owner)
    if not is_whole(number):
        raise InvalidValue(
            tr(
                "{owner}: {name} must be a whole number of 32 bits, not {value}",
                owner=owner,
                name=name,
                value=brief(value),
            )
        )
    return number


def check_kind(kind: str) -> None:
    """Check the pose type of a target.

    Raises:
        InvalidValue: If the pose type is not valid.
    """
    if kind not in COUNTS:
        raise InvalidValue(
            tr('the pose type of a target must be "P", "T", "J", "V" or "" (unspecified), not {kind}', kind=brief(kind))
        )


def check_index(kind: str, index: int) -> None:
    """Check the pose type and the index of a variable.

    Raises:
        InvalidValue: If the pose type is unspecified, or the index is negative or too large for 32 bits.
    """
    if not kind or isinstance(index, bool) or not 0 <= index <= MAX_WHOLE:
        raise InvalidValue(
            tr(
                "invalid variable of kind {kind!r} and number {index}; a kind and a number of 0 or more are required",
                kind=kind,
                index=brief(index),
            )
        )


def is_whole(number: float) -> bool:
    """Return True if a number is a whole number in the range of a figure."""
    return number.is_integer() and abs(number) <= MAX_WHOLE


def written(kind: str, values: Iterable[float]) -> str:
    """Return numbers in the notation of the controller, with all digits: ``J(45, 30, 120)``."""
    return f"{kind}({', '.join(map(plain_decimal, values))})"


def rounded_text(kind: str, values: Iterable[float]) -> str:
    """Return numbers for display: like :func:`written`, but rounded to six decimals."""
    return written(kind, [round(value, _DECIMALS) for value in values])


def plain_decimal(number: float) -> str:
    """Return the shortest decimal text of the same number, without an exponent: ``45``, ``0.0001``."""
    text = repr(number)
    if "e" in text:
        text = f"{Decimal(text):f}"
    return "0" if number == 0 else text.removesuffix(".0")


def counted(kind: str) -> str:
    """Return the number of values of a pose type, as text."""
    least, most = COUNTS[kind]
    if least == most:
        return str(most)
    if most - least == 1:
        return tr("{least} or {most}", least=least, most=most)
    return tr("{least} to {most}", least=least, most=most)


def kind_name(kind: str) -> str:
    """Return the name of a pose type for messages."""
    return kind or tr("a pose")


# --- figures ----------------------------------------------------------------------------------------------------------


class Figure(IntFlag):
    """Bits of Fig; a bit that is 0 means RIGHTY, ABOVE, FLIP or SINGLE."""

    LEFTY = 1
    BELOW = 2
    NONFLIP = 4
    J6_DOUBLE = 8
    J4_DOUBLE = 16
    J1_DOUBLE = 32


_FIGURE_NAMES: Final = {FIG_AUTO: "AUTO", FIG_NEAREST: "NEAREST", FIG_WITHIN_LIMITS: "WITHIN LIMITS"}
_DOUBLES: Final = {Figure.J6_DOUBLE: "J6 DOUBLE", Figure.J4_DOUBLE: "J4 DOUBLE", Figure.J1_DOUBLE: "J1 DOUBLE"}


def describe_figure(fig: float) -> str:
    """Return a figure in words, for example ``LEFTY ABOVE NONFLIP`` for 5.

    Bits without a name are returned as a number (for example 256 of the COBOTTA).

    Args:
        fig: A whole number; -1, -2 and -3 are AUTO, NEAREST and WITHIN LIMITS.

    Raises:
        InvalidValue: If ``fig`` is not a whole number.
    """
    bits = int(whole("fig", fig, "Fig"))
    if bits < 0:
        return _FIGURE_NAMES.get(bits, str(bits))
    words = [
        "LEFTY" if bits & Figure.LEFTY else "RIGHTY",
        "BELOW" if bits & Figure.BELOW else "ABOVE",
        "NONFLIP" if bits & Figure.NONFLIP else "FLIP",
        *(name for bit, name in _DOUBLES.items() if bits & bit),
    ]
    unknown = bits & ~63
    return " ".join([*words, str(unknown)] if unknown else words)
