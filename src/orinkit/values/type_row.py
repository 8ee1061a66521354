"""Rows of the table of VARIANT types; the table itself is in :mod:`orinkit.values.types`."""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum
from typing import Any, Final, Literal, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.notation_numbers import ElementFormat

NumberKind: TypeAlias = Literal["", "integer", "real", "decimal", "code"]
"""Kind of number that a type contains.

``"code"`` is a whole number that is not a quantity, such as an error code; ``""`` means that the type does not contain
a number.
"""

_SHOWN: Final = 60


def bounds_of(layout: str) -> tuple[int, int]:
    """Return the smallest and the largest number of an integer format of :mod:`struct`."""
    bits = 8 * struct.calcsize("<" + layout)
    return (0, 2**bits - 1) if layout.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def shown(value: object) -> str:
    """Return a value as text for a message, shortened to 60 characters; this function never raises an exception."""
    try:
        text = repr(value)
        return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."
    except Exception:  # noqa: BLE001 - for example an int of 4300 digits, a list nested too deep, a user's __repr__
        return f"<{type(value).__name__}>"


@record
class TypeRow:
    """One VARIANT type: its code, its content in Python, its encoding as bytes and as text.

    The *content* is the Python value that a :class:`~orinkit.values.variant.Variant` of the type stores.

    Attributes:
        code: The member of :class:`~orinkit.values.types.VarType`.
        conform: Function that checks a Python value and returns the content; raises InvalidValue.
        format: The :mod:`struct` format of one element; ``None`` if the type has no data or no fixed size.
        empty: True if the type has no data, so that its only content is ``None``. There are no arrays of such a type.
        python: The Python type that is converted to this VARIANT type by default; ``None`` if there is none.
        dtypes: The numpy dtypes that are converted to this type by default. A dtype is given as its kind and its size
            in bytes (``i2``), or as its kind alone, which stands for all sizes (``U``).
        number_kind: Kind of number that the type contains.
        to_wire: Function that converts the content to the value that :mod:`struct` packs; ``None`` if no conversion is
            necessary.
        from_wire: Function that returns the plain Python value for a value that :mod:`struct` has unpacked; ``None`` if
            no conversion is necessary.
        from_wire_exact: Lossless version of ``from_wire``; ``None`` if ``from_wire`` itself is lossless or ``None``.
        elements_per_unit: Number of array elements of this type that together count as one value towards the limit
            :attr:`~orinkit.values.codec.PacketLimits.variants`. The number is larger for types that are faster to read.
        text: Form of an element in :mod:`orinkit.values.notation`; ``None`` if it has a special rule for the type.
        size: Size of one element in bytes; 0 if it is not fixed. It follows from ``format``.
        bounds: The smallest and the largest value of a whole-number type; ``None`` for other types. They follow from ``format``.
    """

    code: IntEnum
    conform: Callable[[TypeRow, Any], Any]
    format: str | None = None
    empty: bool = False
    python: type | None = None
    dtypes: tuple[str, ...] = ()
    number_kind: NumberKind = ""
    to_wire: Callable[[Any], Any] | None = None
    from_wire: Callable[[Any], Any] | None = None
    from_wire_exact: Callable[[Any], Any] | None = None
    elements_per_unit: int = 16
    text: ElementFormat | None = None
    size: int = 0
    bounds: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", struct.calcsize(f"<{self.format}") if self.format else 0)
        whole = self.format is not None and self.number_kind in ("integer", "code")
        object.__setattr__(self, "bounds", bounds_of(str(self.format)) if whole else None)

    @property
    def name(self) -> str:
        """Name of the type as in the documents: ``VT_I4``."""
        return f"VT_{self.code.name}"

    def misfit(self, value: object) -> InvalidValue:
        """Return the exception for a value that does not fit the type."""
        if self.bounds is None or not isinstance(value, int):
            return no_value(self.name, value)
        low, high = self.bounds
        text = tr(
            "{shown} does not fit {type} ({low} to {high})", shown=shown(value), type=self.name, low=low, high=high
        )
        wider = tr(". Try: a float, or Variant(VarType.I8, ...)")
        return InvalidValue(text + (wider if self.python is int else ""))


def no_value(name: str, value: object) -> InvalidValue:
    """Return the exception for a value that cannot be converted to the named type."""
    return InvalidValue(tr("{shown} is not a valid value for {type}", shown=shown(value), type=name))


def no_type(name: str, number: int) -> InvalidValue:
    """Return the exception for a type that no value has: unknown, VT_VARIANT, or an array of VT_EMPTY or VT_NULL."""
    return InvalidValue(tr("{name} ({number}) is not a valid type of a value", name=name, number=int(number)))
