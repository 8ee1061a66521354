"""VARIANTs, the typed values of ORiN, as Python values (VE026A 3.2, table 3-1).

============================  =========================================================================
Python value                  VARIANT
============================  =========================================================================
``None``                      VT_EMPTY (VT_NULL is also read as ``None``)
``bool``                      VT_BOOL
``int``                       VT_I4; :class:`~orinkit.core.errors.InvalidValue` if it exceeds 32 bits
``float``                     VT_R8
``str``                       VT_BSTR
``bytes``, ``bytearray``      VT_UI1 array
``datetime``                  VT_DATE (days since 1899-12-30, local time; other time zones are converted)
``decimal.Decimal``           VT_CY (four decimals)
list of one of these types    array of that type (``[]`` is an empty VARIANT array)
any other list or tuple       VARIANT array, nested freely
numpy array, numpy scalar     by its dtype; 64-bit integers like ``int``; arrays of one dimension only
``Variant(VarType.I2, 1)``    exactly this type
============================  =========================================================================

Decoding a packet returns the same Python types. Unsigned and short integers become ``int``, VT_R4 becomes ``float``,
and VT_ERROR an unsigned ``int``. A VT_DATE outside the range of ``datetime`` becomes a ``float``: its number of days.
With ``exact=True``, :func:`orinkit.values.codec.decode` is lossless: it returns :class:`Variant` objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from decimal import Decimal
from typing import Any, Final, Protocol, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.conversions import to_datetime
from orinkit.values.type_row import no_type, shown
from orinkit.values.types import (
    ARRAY,
    BY_DTYPE,
    BY_PYTHON,
    R8_ARRAY,
    ROWS,
    UI1_ARRAY,
    VARIANT_ARRAY,
    VarType,
    misfit,
    type_name,
)

__all__ = [
    "ARRAY",
    "R8_ARRAY",
    "UI1_ARRAY",
    "VARIANT_ARRAY",
    "ArrayLike",
    "Value",
    "VarType",
    "Variant",
    "innermost",
    "is_floats",
    "nested_too_deep",
    "plain",
    "trusted",
    "type_name",
    "unwrapped",
    "variant",
]


class ArrayLike(Protocol):
    """Interface of a numpy array or scalar; numpy itself is never imported."""

    @property
    def dtype(self) -> Any:
        """Type of the elements."""

    @property
    def ndim(self) -> int:
        """Number of dimensions: 0 for a scalar."""

    def tolist(self) -> Any:
        """Return the value as plain Python."""


Value: TypeAlias = (
    "bool | int | float | str | bytes | bytearray | datetime | Decimal | Variant | ArrayLike | Sequence[Value] | None"
)
"""Values that can be sent as a VARIANT; the table in this module's docstring lists the resulting types."""


@record
class Variant:
    """A value with an explicit VARIANT type.

    ``value`` is a Python scalar, ``bytes`` for an array of VT_UI1, and a list for any other array. The elements of a
    VT_VARIANT array, and the value of a VT_VARIANT (e-CAP), are :class:`Variant` objects. The value of a VT_DATE may also be a ``float``: the number of days
    since 1899-12-30.

    Raises:
        InvalidValue: If the type is unknown, or the value does not fit the type.
    """

    type: int
    value: Any = None

    def __init__(self, type: int, value: Any = None) -> None:  # noqa: A002 - the name of the attribute
        code = int(type)
        object.__setattr__(self, "type", code)
        object.__setattr__(self, "value", _conform(code, value))

    def __repr__(self) -> str:
        return f"Variant({type_name(self.type)}, {self.value!r})"

    @property
    def plain(self) -> Any:
        """The value as plain Python, without :class:`Variant` objects.

        A VT_DATE is a ``datetime``, or a ``float`` (its number of days) if it is outside the range of ``datetime``.
        """
        if self.type == VARIANT_ARRAY:
            return [element.plain for element in self.value]
        if self.type == VarType.VARIANT:
            return self.value.plain
        if self.type == VarType.DATE:
            return to_datetime(self.value)
        if self.type == VarType.DATE | ARRAY:
            return [to_datetime(day) for day in self.value]
        return self.value


_R8: Final = int(VarType.R8)


def variant(value: Value) -> Variant:
    """Convert a value to a :class:`Variant`, by the rules of this module's docstring.

    Raises:
        InvalidValue: If the value cannot be converted to a VARIANT.
    """
    if isinstance(value, Variant):
        return value
    if type(value) is float:
        return trusted(_R8, value)
    try:
        vt, content = _infer(value)
        return trusted(vt, _conform(vt, content))
    except RecursionError:
        raise nested_too_deep() from None


def plain(value: Any) -> Any:
    """Return the plain Python value of a :class:`Variant`; return other values unchanged."""
    return value.plain if isinstance(value, Variant) else value


def innermost(item: Variant) -> Variant:
    """Return the value in a VT_VARIANT, or any other value unchanged."""
    while item.type == VarType.VARIANT:
        item = item.value
    return item


def unwrapped(item: Variant) -> Variant:
    """Return the value in a VT_VARIANT; also replace the elements of VARIANT arrays that are VT_VARIANT.

    The argument comes from a packet or a text, in which the depth of arrays is limited.
    """
    item = innermost(item)
    if item.type == VARIANT_ARRAY and any(each.type in (VarType.VARIANT, VARIANT_ARRAY) for each in item.value):
        return trusted(VARIANT_ARRAY, [unwrapped(each) for each in item.value])
    return item


def trusted(vt: int, value: Any) -> Variant:
    """Return a :class:`Variant` without checking that the value fits its type."""
    new = _NEW(Variant)
    _SET(new, "type", vt)
    _SET(new, "value", value)
    return new


_NEW: Final = object.__new__
_SET: Final = object.__setattr__


# --- Python value -> type and content ---------------------------------------------------------------------------------

_SCALARS: Final = tuple(python for python in BY_PYTHON if python is not type(None))


def _infer(value: Any) -> tuple[int, Any]:
    kind = type(value)
    if kind in BY_PYTHON:
        return BY_PYTHON[kind], value
    if hasattr(value, "dtype") and hasattr(value, "tolist") and not isinstance(value, type):
        return _infer_numpy(value)
    if isinstance(value, bytes | bytearray | memoryview):
        return UI1_ARRAY, value
    if isinstance(value, list | tuple):
        return _infer_list(value), value
    for base in _SCALARS:  # the value may be of a subclass: IntEnum, StrEnum, ...
        if isinstance(value, base):
            return BY_PYTHON[base], value
    if isinstance(value, Sequence):
        items = list(value)
        return _infer_list(items), items
    raise InvalidValue(
        tr(
            "a {type} cannot be converted to a VARIANT: {shown}. Try: None, bool, int, float, str, bytes, "
            "datetime, Decimal, a list of these, or an explicit Variant(VarType...., value)",
            type=kind.__name__,
            shown=shown(value),
        )
    )


def _infer_list(items: Sequence[Any]) -> int:
    kinds = set(map(type, items))
    examples = dict.fromkeys(kinds) if kinds <= BY_PYTHON.keys() else {type(item): item for item in items}
    types = {_scalar_type(kind, item) for kind, item in examples.items()}
    vt = types.pop() if len(types) == 1 else VarType.EMPTY
    return VARIANT_ARRAY if vt == VarType.EMPTY else vt | ARRAY


def _scalar_type(kind: type, example: Any) -> int:
    """Return the VARIANT type of the values of a Python type; VT_EMPTY if these values are not scalars.

    ``example`` is a value of the Python type. A subclass has the VARIANT type of its base class: numpy.float64 is
    VT_R8, like float.
    """
    if kind in BY_PYTHON:
        return BY_PYTHON[kind]
    if issubclass(kind, _SCALARS) or (getattr(example, "ndim", None) == 0 and not hasattr(kind, "__setitem__")):
        return _infer(example)[0]
    return VarType.EMPTY


def _infer_numpy(value: Any) -> tuple[int, Any]:
    kind = getattr(value.dtype, "kind", "")  # arrays of other libraries also have a dtype, but it may have no kind
    vt = BY_DTYPE.get(kind if kind in ("U", "") else f"{kind}{value.dtype.itemsize}")
    if vt is None or value.ndim > 1:
        raise InvalidValue(
            tr(
                "a numpy value of dtype {dtype} with {dimensions} dimensions cannot be converted to a VARIANT. "
                "Try: one dimension of bool, integer, float32, float64 or str, or a list of such rows",
                dtype=value.dtype,
                dimensions=value.ndim,
            )
        )
    return (vt | ARRAY if value.ndim else vt), value.tolist()


# --- content conforms to its type -------------------------------------------------------------------------------------


def _conform(vt: int, value: Any) -> Any:
    """Return a value in the form that a Variant of the type stores; raise InvalidValue if the value does not fit."""
    if vt == R8_ARRAY and is_floats(value):  # poses and set-points
        return list(value)
    row = ROWS.get(vt & ~ARRAY)
    if row is None or (row.empty and vt & ARRAY):
        raise no_type(type_name(vt), vt)
    if vt == VarType.VARIANT:
        return variant(value)
    if not vt & ARRAY:
        return row.conform(row, value)
    if vt == UI1_ARRAY and isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    if hasattr(value, "tolist") and not isinstance(value, type):
        value = value.tolist()
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise misfit(vt, value)
    if vt == VARIANT_ARRAY:
        return [variant(item) for item in value]
    conform = row.conform
    items = [conform(row, plain(item)) for item in value]
    return bytes(items) if vt == UI1_ARRAY else items


def is_floats(value: object) -> bool:
    """Return True if a value is a list or a tuple of plain ``float`` objects; all elements are checked in one call."""
    kind = type(value)
    if kind is not list and kind is not tuple:
        return False
    items: Sequence[Any] = value  # type: ignore[assignment]  # kind is checked, which mypy does not see
    return list(map(type, items)).count(float) == len(items)


def nested_too_deep() -> InvalidValue:
    """Return the exception for a list that is nested too deep or contains itself."""
    return InvalidValue(tr("the value is nested too deep for a VARIANT, or contains itself"))
