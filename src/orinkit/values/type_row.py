"""What a row of the table of VARIANT types holds; the table itself is in :mod:`orinkit.values.types`."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final, Literal, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.notation_numbers import TextForm

Number: TypeAlias = Literal["", "integer", "real", "decimal", "code"]
"""What kind of number a type holds: ``"code"`` is a whole number that counts nothing, ``""`` is no number."""

_SHOWN: Final = 60


def bounds_of(layout: str) -> tuple[int, int]:
    """Return the smallest and the largest number of an integer format of :mod:`struct`."""
    bits = 8 * struct.calcsize("<" + layout)
    return (0, 2**bits - 1) if layout.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def shown(value: object) -> str:
    """Return a value for a message: short, and never an exception."""
    try:
        text = repr(value)
        return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."
    except Exception:  # noqa: BLE001 - an int of 4300 digits, a list nested too deep, somebody's __repr__
        return f"<{type(value).__name__}>"


@dataclass(frozen=True, slots=True)
class TypeRow:
    """One VARIANT type: its code, its content in Python, its bytes, its text.

    Attributes:
        code: the member of :class:`~orinkit.values.types.VarType`.
        conform: check a Python value and return it in the form kept for the type; raises InvalidValue.
        format: how :mod:`struct` writes one element; ``None`` if the size of an element is not fixed.
        empty: the type has no data and no arrays; its value is ``None``.
        python: the Python type that becomes this type by itself.
        dtypes: the numpy dtypes that become it, kind and bytes: ``i2``; a kind alone covers all sizes: ``U``.
        number: what kind of number it holds.
        to_wire: make of the content what :mod:`struct` packs; ``None`` if it is the same.
        from_wire: the way back, to plain Python.
        from_wire_exact: the way back with nothing lost; ``None`` if ``from_wire`` loses nothing.
        elements_for_one: how many elements count as one against :attr:`~orinkit.values.codec.PacketLimits.variants`, by what
            they cost to read.
        text: how an element is written as text; ``None`` if the notation has a rule of its own for the type.
        size: bytes of one element; 0 if it is not fixed.
        bounds: the smallest and the largest value of a whole number, otherwise ``None``.
    """

    code: IntEnum
    conform: Callable[[TypeRow, Any], Any]
    format: str | None = None
    empty: bool = False
    python: type | None = None
    dtypes: tuple[str, ...] = ()
    number: Number = ""
    to_wire: Callable[[Any], Any] | None = None
    from_wire: Callable[[Any], Any] | None = None
    from_wire_exact: Callable[[Any], Any] | None = None
    elements_for_one: int = 16
    text: TextForm | None = None
    size: int = field(init=False)
    bounds: tuple[int, int] | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", struct.calcsize(f"<{self.format}") if self.format else 0)
        whole = self.format is not None and self.number in ("integer", "code")
        object.__setattr__(self, "bounds", bounds_of(str(self.format)) if whole else None)

    @property
    def name(self) -> str:
        """The documents' spelling: ``VT_I4``."""
        return f"VT_{self.code.name}"

    def misfit(self, value: object) -> InvalidValue:
        """Return the exception for a value that does not fit the type."""
        if self.bounds is None or not isinstance(value, int):
            return no_value(self.name, value)
        low, high = self.bounds
        text = tr(
            "{shown} does not fit {type} ({low} to {high})", shown=shown(value), type=self.name, low=low, high=high
        )
        wider = tr("; write it as a float, or as Variant(VarType.I8, ...)")
        return InvalidValue(text + (wider if self.python is int else ""))


def no_value(name: str, value: object) -> InvalidValue:
    """Return the exception for a value that is of another kind than the type of this name."""
    return InvalidValue(tr("{shown} is no value for {type}", shown=shown(value), type=name))


def no_type(name: str, number: int) -> InvalidValue:
    """Return the exception for a type that no value can have."""
    return InvalidValue(tr("{name} ({number}) is not a type that a value can have", name=name, number=int(number)))
