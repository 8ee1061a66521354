"""VARIANT: the typed values of ORiN as Python values (VE026A 3.2, table 3-1).

============================  =========================================================================
Python value                  VARIANT
============================  =========================================================================
``None``                      VT_EMPTY (VT_NULL is also read as ``None``)
``bool``                      VT_BOOL
``int``                       VT_I4; one that does not fit is an :class:`~orinkit.core.errors.InvalidValue`
``float``                     VT_R8
``str``                       VT_BSTR
``bytes``, ``bytearray``      VT_UI1 array
``datetime``                  VT_DATE (days since 1899-12-30, local time; an aware one is converted to local)
``decimal.Decimal``           VT_CY (four decimals)
list of one of these types    array of that type (``[]`` is an empty VARIANT array)
any other list or tuple       VARIANT array, nested freely
numpy array, numpy scalar     by its dtype; 64-bit integers as ``int``; one dimension
``Variant(VarType.I2, 1)``    exactly this type
============================  =========================================================================

Reading gives the same Python types back; an unsigned or short integer becomes ``int``, VT_R4 ``float``, VT_ERROR an
unsigned ``int``. A VT_DATE that no ``datetime`` can hold is given as the ``float`` of its days. With ``exact=True``
nothing is lost: :class:`Variant` objects with their types.
"""

from __future__ import annotations

import math
import operator
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from decimal import Context, Decimal
from enum import IntEnum
from typing import Any, Final, Protocol, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr


class VarType(IntEnum):
    """The VARIANT types (VE026A table 3-1; I1, I8 and UI8 are newer than the table). An array is ``ARRAY | type``."""

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


class ArrayLike(Protocol):
    """What is used of a numpy array or scalar; numpy itself is never imported."""

    @property
    def dtype(self) -> Any:
        """What the elements are."""

    @property
    def ndim(self) -> int:
        """How many dimensions: 0 for a scalar."""

    def tolist(self) -> Any:
        """The same as plain Python."""


Value: TypeAlias = (
    "bool | int | float | str | bytes | bytearray | datetime | Decimal | Variant | ArrayLike | Sequence[Value] | None"
)
"""What can be sent as a VARIANT; the table in this module's docstring says as which."""

ARRAY: Final = 0x2000
_BASE: Final = 0x1FFF
VARIANT_ARRAY: Final = int(VarType.VARIANT) | ARRAY
R8_ARRAY: Final = int(VarType.R8) | ARRAY

FORMATS: Final[dict[int, str]] = {
    VarType.I2: "h", VarType.I4: "i", VarType.R4: "f", VarType.R8: "d", VarType.CY: "q", VarType.DATE: "d",
    VarType.ERROR: "I", VarType.BOOL: "h", VarType.I1: "b", VarType.UI1: "B", VarType.UI2: "H", VarType.UI4: "I",
    VarType.I8: "q", VarType.UI8: "Q",
}  # fmt: skip
SIZES: Final = {int(vt): struct.calcsize("<" + code) for vt, code in FORMATS.items()}
_RANGES: Final = {
    int(vt): (0, 2 ** (8 * SIZES[vt]) - 1) if code.isupper() else (-(2 ** (8 * SIZES[vt] - 1)), 2 ** (8 * SIZES[vt] - 1) - 1)
    for vt, code in FORMATS.items() if code not in "fd" and vt not in (VarType.CY, VarType.BOOL)
}  # fmt: skip

CY_CONTEXT: Final = Context(prec=40, traps=[])
"""For VT_CY: the caller's own decimal context may round or raise."""
_CY_STEP: Final = Decimal("0.0001")
_EPOCH: Final = datetime(1899, 12, 30)
_DAY_US: Final = 86_400_000_000


def type_name(vt: int) -> str:
    """Return the documents' spelling of a type: ``VT_I4``, ``VT_R8|VT_ARRAY``; an unknown one with its number."""
    base = vt & ~ARRAY
    try:
        name = f"VT_{VarType(base).name}"
    except ValueError:
        name = f"VT_{base}?"
    return f"{name}|VT_ARRAY" if vt & ARRAY else name


@dataclass(frozen=True, slots=True)
class Variant:
    """A value with its VARIANT type, for when the type matters.

    ``value`` is a Python scalar, ``bytes`` for an array of VT_UI1, a list for any other array (of :class:`Variant` for
    an array of VT_VARIANT). A VT_DATE may also be given as ``float`` days.

    Raises:
        InvalidValue: the type is unknown, or the value does not fit it.
    """

    type: int
    value: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "type", int(self.type))
        object.__setattr__(self, "value", _conform(self.type, self.value))

    def __repr__(self) -> str:
        return f"Variant({type_name(self.type)}, {self.value!r})"

    @property
    def plain(self) -> Any:
        """The value as plain Python: no :class:`Variant` inside, a VT_DATE as ``datetime`` where one can hold it."""
        if self.type == VARIANT_ARRAY:
            return [element.plain for element in self.value]
        if self.type == VarType.DATE:
            return plain_date(self.value)
        if self.type == VarType.DATE | ARRAY:
            return [plain_date(day) for day in self.value]
        return self.value


def variant(value: Value) -> Variant:
    """Return the value as a :class:`Variant`, by the rules of this module's docstring.

    Raises:
        InvalidValue: no VARIANT can hold it.
    """
    if isinstance(value, Variant):
        return value
    try:
        vt, content = _infer(value)
        return trusted(vt, _conform(vt, content))
    except RecursionError:
        raise nested_too_deep() from None


def plain(value: Any) -> Any:
    """Return the plain Python value of a :class:`Variant`, anything else as it is."""
    return value.plain if isinstance(value, Variant) else value


def trusted(vt: int, value: Any) -> Variant:
    """Return a :class:`Variant` of a value that is known to fit its type."""
    new = Variant.__new__(Variant)
    object.__setattr__(new, "type", vt)
    object.__setattr__(new, "value", value)
    return new


# --- Python value -> type and content ---------------------------------------------------------------------------------

_INFERRED: Final[dict[type, int]] = {
    type(None): VarType.EMPTY, bool: VarType.BOOL, int: VarType.I4, float: VarType.R8, str: VarType.BSTR,
    datetime: VarType.DATE, Decimal: VarType.CY,
}  # fmt: skip
_SCALARS: Final = (bool, int, float, str, datetime, Decimal)
_DTYPES: Final[dict[str, int]] = {
    "b1": VarType.BOOL, "i1": VarType.I1, "i2": VarType.I2, "i4": VarType.I4, "i8": VarType.I4, "u1": VarType.UI1,
    "u2": VarType.UI2, "u4": VarType.UI4, "u8": VarType.I4, "f4": VarType.R4, "f8": VarType.R8, "U": VarType.BSTR,
}  # fmt: skip


def _infer(value: Any) -> tuple[int, Any]:
    kind = type(value)
    if kind in _INFERRED:
        return _INFERRED[kind], value
    if hasattr(value, "dtype") and hasattr(value, "tolist") and not isinstance(value, type):
        return _infer_numpy(value)
    if isinstance(value, bytes | bytearray | memoryview):
        return VarType.UI1 | ARRAY, value
    if isinstance(value, list | tuple):
        return _infer_list(value), value
    for base in _SCALARS:  # subclasses: IntEnum, StrEnum, ...
        if isinstance(value, base):
            return _INFERRED[base], value
    if isinstance(value, Sequence):
        items = list(value)
        return _infer_list(items), items
    raise InvalidValue(
        tr(
            "no VARIANT can hold a {type} ({shown}); give None, bool, int, float, str, bytes, "
            "datetime, Decimal, a list of these, or an explicit Variant(VarType...., value)",
            type=kind.__name__,
            shown=_shown(value),
        )
    )


def _infer_list(items: Sequence[Any]) -> int:
    kinds = set(map(type, items))
    examples = dict.fromkeys(kinds) if kinds <= _INFERRED.keys() else {type(item): item for item in items}
    types = {_scalar_type(kind, item) for kind, item in examples.items()}
    vt = types.pop() if len(types) == 1 else VarType.EMPTY
    return VARIANT_ARRAY if vt == VarType.EMPTY else vt | ARRAY


def _scalar_type(kind: type, example: Any) -> int:
    """The type of all scalars of a kind (numpy.float64 and float are both VT_R8), VT_EMPTY for anything else."""
    if kind in _INFERRED:
        return _INFERRED[kind]
    if issubclass(kind, _SCALARS) or (getattr(example, "ndim", None) == 0 and not hasattr(kind, "__setitem__")):
        return _infer(example)[0]
    return VarType.EMPTY


def _infer_numpy(value: Any) -> tuple[int, Any]:
    kind = getattr(value.dtype, "kind", "")  # other libraries' arrays have a dtype too
    vt = _DTYPES.get(kind if kind in ("U", "") else f"{kind}{value.dtype.itemsize}")
    if vt is None or value.ndim > 1:
        raise InvalidValue(
            tr(
                "a numpy value of dtype {dtype} with {dimensions} dimensions has no VARIANT; use one dimension "
                "of bool, integer, float32, float64 or str, or a list of such rows",
                dtype=value.dtype,
                dimensions=value.ndim,
            )
        )
    return (vt | ARRAY if value.ndim else vt), value.tolist()


# --- content conforms to its type -------------------------------------------------------------------------------------


def _conform(vt: int, value: Any) -> Any:
    """Return the value in the form kept for its type; raise InvalidValue where it does not fit."""
    base = vt & ~ARRAY
    if base not in _CONFORM or (vt & ARRAY and base in (VarType.EMPTY, VarType.NULL)) or vt == VarType.VARIANT:
        raise InvalidValue(tr("{name} ({number}) is not a type that a value can have", name=type_name(vt), number=vt))
    if not vt & ARRAY:
        return _CONFORM[base](base, value)
    if base == VarType.UI1 and isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    if hasattr(value, "tolist") and not isinstance(value, type):
        value = value.tolist()
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise misfit(vt, value)
    conform = _CONFORM[base]
    items = [conform(base, plain(item) if base != VarType.VARIANT else item) for item in value]
    return bytes(items) if base == VarType.UI1 else items


def misfit(vt: int, value: object) -> InvalidValue:
    """Return the exception for a value that does not fit a type."""
    shown = _shown(value)
    bounds = _RANGES.get(vt)
    if bounds and isinstance(value, int):
        wider = tr("; write it as a float, or as Variant(VarType.I8, ...)")
        return InvalidValue(
            tr(
                "{shown} does not fit {type} ({low} to {high})",
                shown=shown,
                type=type_name(vt),
                low=bounds[0],
                high=bounds[1],
            )
            + (wider if vt == VarType.I4 else "")
        )
    return InvalidValue(tr("{shown} is no value for {type}", shown=shown, type=type_name(vt)))


def _shown(value: object) -> str:
    """The value for a message: short, and whatever the value is."""
    try:
        text = repr(value)
        return text if len(text) <= 60 else f"{text[:57]}..."
    except Exception:  # noqa: BLE001 - an int of 4300 digits, a list nested too deep, somebody's __repr__
        return f"<{type(value).__name__}>"


def nested_too_deep() -> InvalidValue:
    """Return the exception for a list in a list in a list ..., or one that contains itself."""
    return InvalidValue(tr("the value is nested too deep for a VARIANT, or contains itself"))


def _nothing(vt: int, value: Any) -> None:
    if value is not None:
        raise misfit(vt, value)


def _integer(vt: int, value: Any) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        if not isinstance(value, float) or not value.is_integer():
            raise misfit(vt, value) from None
        number = int(value)
    low, high = _RANGES[vt]
    if vt == VarType.ERROR and number < 0:
        number += 2**32 if number >= -(2**31) else 0
    if not low <= number <= high:
        raise misfit(vt, number)
    return number


def _real(vt: int, value: Any) -> float:
    if isinstance(value, bool | str | bytes | bytearray | memoryview):
        raise misfit(vt, value)
    try:
        number = float(value)
        if vt == VarType.R4:
            struct.pack("<f", number)
    except (TypeError, ValueError, OverflowError):
        raise misfit(vt, value) from None
    if math.isinf(number) and number != value:  # float(Decimal("1E+999")) is inf, no error
        raise misfit(vt, value)
    return number


def _boolean(vt: int, value: Any) -> bool:
    if isinstance(value, int | float) or (getattr(value, "ndim", None) == 0 and not isinstance(value, str)):
        return bool(value)
    raise misfit(vt, value)


def _string(vt: int, value: Any) -> str:
    if not isinstance(value, str):
        raise misfit(vt, value)
    return str.__str__(value)  # the text itself, also of an Enum whose own str() is its name


def _currency(vt: int, value: Any) -> Decimal:
    if isinstance(value, bool | float | str | bytes) or not isinstance(value, Decimal | int):
        raise misfit(vt, value)
    amount = Decimal(value)
    if amount.is_finite() and (not amount or amount.adjusted() < 15):
        rounded = amount.quantize(_CY_STEP, context=CY_CONTEXT)
        if rounded == amount and -(2**63) <= rounded.scaleb(4, CY_CONTEXT) < 2**63:
            return amount
    raise InvalidValue(
        tr(
            "{shown} does not fit VT_CY: at most four decimals, -922337203685477.5808 to 922337203685477.5807",
            shown=_shown(value),
        )
    )


def _date(vt: int, value: Any) -> datetime | float:
    if isinstance(value, datetime):
        try:
            return value if value.tzinfo is None else value.astimezone().replace(tzinfo=None)
        except (OverflowError, ValueError, OSError):  # in local time it is before the year 1 or after 9999
            raise misfit(vt, value) from None
    return _real(vt, value)


def _element(_vt: int, value: Any) -> Variant:
    return variant(value)


_CONFORM: Final[dict[int, Callable[[int, Any], Any]]] = {
    VarType.EMPTY: _nothing, VarType.NULL: _nothing, VarType.R4: _real, VarType.R8: _real, VarType.CY: _currency,
    VarType.DATE: _date, VarType.BSTR: _string, VarType.BOOL: _boolean, VarType.VARIANT: _element,
    **dict.fromkeys(_RANGES, _integer),
}  # fmt: skip


# --- VT_DATE ----------------------------------------------------------------------------------------------------------


def ole_days(moment: datetime) -> float:
    """Return a local time as OLE days since 1899-12-30 (before that day the time of day still counts forward)."""
    us = (moment - _EPOCH) // timedelta(microseconds=1)
    if us >= 0:
        return us / _DAY_US
    day, rest = divmod(us, _DAY_US)
    return (day * _DAY_US - rest) / _DAY_US


def ole_datetime(days: float) -> datetime:
    """Return OLE days as local time, rounded to a microsecond.

    Raises:
        OverflowError: outside the years 1 to 9999, infinite, or not a number.
    """
    if days != days:
        raise OverflowError("NaN")
    top, bottom = abs(days).as_integer_ratio()
    whole, part = divmod(top, bottom)
    us = (part * _DAY_US * 2 + bottom) // (2 * bottom)  # exact, half up: a double product would lose the microsecond
    return _EPOCH + timedelta(days=whole if days >= 0 else -whole, microseconds=us)


def plain_date(value: datetime | float) -> datetime | float:
    """Return a VT_DATE's content as ``datetime``, as it is where none can hold it."""
    if isinstance(value, datetime):
        return value
    try:
        return ole_datetime(value)
    except OverflowError:
        return value


def exact_date(days: float) -> datetime | float:
    """Return OLE days as ``datetime`` where it gives the very same bytes again, else as they are."""
    moment = plain_date(days)
    return (
        moment
        if isinstance(moment, datetime) and struct.pack("<d", ole_days(moment)) == struct.pack("<d", days)
        else days
    )
