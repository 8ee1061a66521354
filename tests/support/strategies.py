"""Hypothesis strategies for VARIANTs, and an exact comparison of two of them."""

from __future__ import annotations

import struct
from datetime import datetime
from decimal import Decimal
from typing import Any

from hypothesis import strategies as st

from orinkit.values.conversions import lossless_datetime, ole_datetime, ole_days
from orinkit.values.types import TABLE
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType


def _as_utf16(text: str) -> str:
    """Combine adjacent high and low surrogates into one character, as a packet does."""
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "surrogatepass")


def strings() -> st.SearchStrategy[str]:
    """Return a strategy for all texts of VT_BSTR: Japanese, control characters, lone surrogates, notation characters."""
    return st.one_of(
        st.text(st.sampled_from('"(),8\t\r\n あポーズ姿勢　１ａ\U0001f916'), max_size=12),
        st.text(st.characters(exclude_categories=()), max_size=20).map(_as_utf16),
        st.sampled_from(
            ["", "P1", "@E P(1,2,3)[S=50]", "Sample,Test", '"', '""', "\ud800", "座標(基準", ":)", "8204,(3,1)"]
        ),
    )


def dates() -> st.SearchStrategy[datetime | float]:
    """Return a strategy for decoded values of VT_DATE: a datetime if it is exact, otherwise the days as float."""
    moments = st.datetimes(datetime(1, 1, 1), datetime(9999, 12, 30)).map(lambda moment: ole_datetime(ole_days(moment)))
    return st.one_of(moments, st.floats().map(lossless_datetime))


CONTENTS: dict[VarType, st.SearchStrategy[Any]] = {
    **{VarType(row.code): st.integers(*row.bounds) for row in TABLE if row.bounds is not None},
    VarType.R4: st.floats(width=32),
    VarType.R8: st.floats(),
    VarType.CY: st.integers(-(2**63), 2**63 - 1).map(lambda units: Decimal(units).scaleb(-4)),
    VarType.DATE: dates(),
    VarType.BSTR: strings(),
    VarType.BOOL: st.booleans(),
}
"""Strategies for the values of each element type of arrays, except VT_VARIANT."""


def scalars() -> st.SearchStrategy[Variant]:
    """Return a strategy for VARIANTs that are not arrays."""
    nothing = st.sampled_from([Variant(VarType.EMPTY), Variant(VarType.NULL)])
    return st.one_of(
        nothing, *(content.map(lambda value, vt=vt: Variant(vt, value)) for vt, content in CONTENTS.items())
    )


def arrays() -> st.SearchStrategy[Variant]:
    """Return a strategy for arrays of one type other than VT_VARIANT; often empty."""
    return st.one_of(
        *(
            st.lists(content, max_size=6).map(lambda values, vt=vt: Variant(ARRAY | vt, values))
            for vt, content in CONTENTS.items()
        )
    )


def variants() -> st.SearchStrategy[Variant]:
    """Return a strategy for all VARIANTs: scalars, arrays, and nested VARIANT arrays."""
    return st.recursive(
        st.one_of(scalars(), arrays()),
        lambda inner: st.lists(inner, max_size=4).map(lambda items: Variant(VARIANT_ARRAY, items)),
        max_leaves=16,
    )


def same(one: Any, other: Any) -> bool:
    """Compare two :class:`Variant` or two values exactly: including types, -0.0 and NaN, which ``==`` does not distinguish."""
    if type(one) is not type(other):
        return False
    if isinstance(one, Variant):
        return one.type == other.type and same(one.value, other.value)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and one == one:
        return struct.pack("<d", one) == struct.pack("<d", other)
    return bool(one == other) or (one != one and other != other)
