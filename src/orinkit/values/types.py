"""The table of VARIANT types: each row defines one type completely (VE026A 3.2, table 3-1).

The codec, the notation, the conversion of Python and numpy values, and the sets of types that arguments may have are
derived from the table. A new type requires a member of :class:`VarType` and a row of :data:`TABLE`;
:class:`~.type_row.TypeRow` describes the columns.
"""

from __future__ import annotations

from datetime import datetime
from decimal import Decimal
from enum import IntEnum
from types import NoneType
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.values import conversions, notation_numbers
from orinkit.values.type_row import TypeRow, bounds_of, no_value


class VarType(IntEnum):
    """VARIANT types (VE026A table 3-1; I1, I8 and UI8 are newer than the table). An array is ``ARRAY | type``."""

    EMPTY = 0
    NULL = 1
    I2 = 2
    I4 = 3
    R4 = 4
    R8 = 5
    CY = 6
    DATE = 7
    BSTR = 8
    ERROR = 10
    BOOL = 11
    VARIANT = 12
    I1 = 16
    UI1 = 17
    UI2 = 18
    UI4 = 19
    I8 = 20
    UI8 = 21
    ARRAY = 0x2000


ARRAY: Final = 0x2000


def _integer(
    code: VarType, layout: str, *dtypes: str, python: type | None = None, elements_per_unit: int = 16
) -> TypeRow:
    return TypeRow(
        code, conversions.integer, layout, python=python, dtypes=dtypes, number_kind="integer",
        elements_per_unit=elements_per_unit, text=notation_numbers.whole(*bounds_of(layout)),
    )  # fmt: skip


TABLE: Final = (
    TypeRow(VarType.EMPTY, conversions.nothing, empty=True, python=NoneType),
    TypeRow(VarType.NULL, conversions.nothing, empty=True),
    _integer(VarType.I2, "h", "i2"),
    _integer(VarType.I4, "i", "i4", "i8", "u8", python=int),  # the default for whole numbers
    TypeRow(VarType.R4, conversions.single, "f", dtypes=("f4",), number_kind="real", text=notation_numbers.SINGLE),
    TypeRow(VarType.R8, conversions.real, "d", python=float, dtypes=("f8",), number_kind="real", text=notation_numbers.DOUBLE),
    TypeRow(
        VarType.CY, conversions.currency, "q", python=Decimal, number_kind="decimal", to_wire=conversions.amount_to_wire,
        from_wire=conversions.amount_from_wire, elements_per_unit=1, text=notation_numbers.AMOUNT,
    ),
    TypeRow(
        VarType.DATE, conversions.date, "d", python=datetime, to_wire=conversions.date_to_wire,
        from_wire=conversions.to_datetime, from_wire_exact=conversions.lossless_datetime, elements_per_unit=1,
        text=notation_numbers.MOMENT,
    ),
    TypeRow(VarType.BSTR, conversions.string, python=str, dtypes=("U",), elements_per_unit=1),
    TypeRow(VarType.ERROR, conversions.code, "I", number_kind="code", text=notation_numbers.ERROR),
    TypeRow(
        VarType.BOOL, conversions.boolean, "h", python=bool, dtypes=("b1",), to_wire=conversions.flag_to_wire,
        from_wire=bool, text=notation_numbers.FLAG,
    ),
    TypeRow(VarType.VARIANT, conversions.any_variant, elements_per_unit=1),
    _integer(VarType.I1, "b", "i1"),
    _integer(VarType.UI1, "B", "u1", elements_per_unit=1 << 32),  # an array is bytes; elements are not processed individually
    _integer(VarType.UI2, "H", "u2"),
    _integer(VarType.UI4, "I", "u4"),
    _integer(VarType.I8, "q"),
    _integer(VarType.UI8, "Q"),
)  # fmt: skip
"""The table, one row for each type."""


# --- derived from the table -------------------------------------------------------------------------------------------

ROWS: Final[dict[int, TypeRow]] = {int(row.code): row for row in TABLE}
"""The rows by type code."""
FORMATS: Final[dict[int, str]] = {int(row.code): row.format for row in TABLE if row.format is not None}
"""The :mod:`struct` format of one element, for types with elements of a fixed size."""
SIZES: Final[dict[int, int]] = {int(row.code): row.size for row in TABLE if row.format is not None}
"""Size of one element in bytes, for types with elements of a fixed size."""

EMPTIES: Final = frozenset(int(row.code) for row in TABLE if row.empty)
"""The types without data: VT_EMPTY and VT_NULL."""
INTEGERS: Final = frozenset(int(row.code) for row in TABLE if row.number_kind == "integer")
REALS: Final = frozenset(int(row.code) for row in TABLE if row.number_kind == "real")
NUMERIC: Final = INTEGERS | REALS | {int(row.code) for row in TABLE if row.number_kind == "decimal"}
"""The numeric types: whole numbers, real numbers and VT_CY, but not VT_BOOL and VT_ERROR."""

BY_PYTHON: Final[dict[type, int]] = {row.python: row.code for row in TABLE if row.python is not None}
"""Default VARIANT type of a Python value, by its Python type."""
BY_DTYPE: Final[dict[str, int]] = {dtype: row.code for row in TABLE for dtype in row.dtypes}
"""Default VARIANT type of a numpy value, by its dtype as in :attr:`~.type_row.TypeRow.dtypes`."""

VARIANT_ARRAY: Final = int(VarType.VARIANT) | ARRAY
R8_ARRAY: Final = int(VarType.R8) | ARRAY
UI1_ARRAY: Final = int(VarType.UI1) | ARRAY
"""The type of a VT_UI1 array. The content of this array is ``bytes``; the content of any other array is a list."""


def type_name(vt: int) -> str:
    """Return the name of a type as in the documents, ``VT_I4`` or ``VT_R8|VT_ARRAY``; an unknown type as ``VT_99?``."""
    base = vt & ~ARRAY
    row = ROWS.get(base)
    name = row.name if row else f"VT_{base}?"
    return f"{name}|VT_ARRAY" if vt & ARRAY else name


def misfit(vt: int, value: object) -> InvalidValue:
    """Return the exception for a value that does not fit a type."""
    row = ROWS.get(vt)
    return row.misfit(value) if row else no_value(type_name(vt), value)
