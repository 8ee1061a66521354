"""Hypothesis strategies that several tests share: any VARIANT, and how to compare two of them."""

from __future__ import annotations

import struct
from datetime import datetime
from decimal import Decimal
from typing import Any

from hypothesis import strategies as st

from orinkit.values.conversions import exact_date, ole_datetime, ole_days
from orinkit.values.types import TABLE
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType


def _as_utf16(text: str) -> str:
    """A high and a low surrogate side by side are one character as soon as a packet has carried them."""
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "surrogatepass")


def strings() -> st.SearchStrategy[str]:
    """Any text a VT_BSTR can hold: Japanese, control characters, lone surrogates, the signs of the notation."""
    return st.one_of(
        st.text(st.sampled_from('"(),8\t\r\n あポーズ姿勢　１ａ\U0001f916'), max_size=12),
        st.text(st.characters(exclude_categories=()), max_size=20).map(_as_utf16),
        st.sampled_from(
            ["", "P1", "@E P(1,2,3)[S=50]", "Sample,Test", '"', '""', "\ud800", "座標(基準", ":)", "8204,(3,1)"]
        ),
    )


def dates() -> st.SearchStrategy[datetime | float]:
    """What a VT_DATE is after a packet has carried it: a datetime where one fits exactly, else the days as float."""
    moments = st.datetimes(datetime(1, 1, 1), datetime(9999, 12, 30)).map(lambda moment: ole_datetime(ole_days(moment)))
    return st.one_of(moments, st.floats().map(exact_date))


CONTENTS: dict[VarType, st.SearchStrategy[Any]] = {
    **{VarType(row.code): st.integers(*row.bounds) for row in TABLE if row.bounds is not None},
    VarType.R4: st.floats(width=32),
    VarType.R8: st.floats(),
    VarType.CY: st.integers(-(2**63), 2**63 - 1).map(lambda units: Decimal(units).scaleb(-4)),
    VarType.DATE: dates(),
    VarType.BSTR: strings(),
    VarType.BOOL: st.booleans(),
}
"""One value of each type that an array can hold, VT_VARIANT aside."""


def scalars() -> st.SearchStrategy[Variant]:
    """A VARIANT that is no array."""
    nothing = st.sampled_from([Variant(VarType.EMPTY), Variant(VarType.NULL)])
    return st.one_of(
        nothing, *(content.map(lambda value, vt=vt: Variant(vt, value)) for vt, content in CONTENTS.items())
    )


def arrays() -> st.SearchStrategy[Variant]:
    """An array of one type, VT_VARIANT aside; often empty."""
    return st.one_of(
        *(
            st.lists(content, max_size=6).map(lambda values, vt=vt: Variant(ARRAY | vt, values))
            for vt, content in CONTENTS.items()
        )
    )


def variants() -> st.SearchStrategy[Variant]:
    """Any VARIANT of every type: scalars, arrays, VARIANT arrays nested a few deep."""
    return st.recursive(
        st.one_of(scalars(), arrays()),
        lambda inner: st.lists(inner, max_size=4).map(lambda items: Variant(VARIANT_ARRAY, items)),
        max_leaves=16,
    )


def same(one: Any, other: Any) -> bool:
    """Compare two :class:`Variant`, or their values: also their types, -0.0 and nan, which ``==`` gets wrong."""
    if type(one) is not type(other):
        return False
    if isinstance(one, Variant):
        return one.type == other.type and same(one.value, other.value)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and one == one:
        return struct.pack("<d", one) == struct.pack("<d", other)
    return bool(one == other) or (one != one and other != other)
