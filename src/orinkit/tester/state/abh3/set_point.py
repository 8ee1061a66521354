"""Set-points as users enter them: :func:`parse_set_point`."""

from __future__ import annotations

import re
from typing import Final

from orinkit.abh3.table.signals import Quantity
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

LONGEST_ENTRY: Final = 20
"""Maximum number of characters of a set-point."""
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)", re.ASCII)


def parse_set_point(text: str, quantity: Quantity) -> float:
    """Return the set-point that a user has entered.

    Args:
        text: The number, in the unit of the quantity.
        quantity: Velocity, or current in torque mode.

    Raises:
        InvalidValue: If the text is not a number, or the number is out of range.
    """
    entry = text[: LONGEST_ENTRY + 1].strip().replace("−", "-")
    if len(text) > LONGEST_ENTRY or _NUMBER.fullmatch(entry) is None:
        raise InvalidValue(tr("not a number. Try: 100"))
    value = float(entry)
    quantity.encode(value)
    return value


def sent_text(text: str, quantity: Quantity) -> str:
    """Return the value that will be sent for an entry, with its code; the range if the entry is empty or invalid."""
    try:
        code = quantity.encode(parse_set_point(text, quantity))
    except InvalidValue:
        return range_text(quantity)
    value = f"{quantity.decode(code):.{quantity.digits}f}"
    return tr("sends {value} {unit} (code {code})", value=value, unit=unit_text(quantity.unit), code=code)


def range_text(quantity: Quantity) -> str:
    """Return the range of a quantity."""
    low, high = quantity.decode(quantity.low), quantity.decode(quantity.high)
    return tr(
        "{low:.{digits}f} to {high:.{digits}f} {unit}",
        low=low,
        high=high,
        digits=quantity.digits,
        unit=unit_text(quantity.unit),
    )


def unit_text(unit: str) -> str:
    """Return a unit for display."""
    return unit.replace("^-1", "⁻¹")
