"""PACK_FLOAT: every line of the two lists of vectors, the quirks of its texts, and invariants."""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal
from typing import Any, NamedTuple

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.abh3.table import packfloat
from orinkit.abh3.table.packfloat import MINUS_INFINITY, NAN, PLUS_INFINITY, ZERO, PackFloat, Rounding
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from support import paths

pytestmark = pytest.mark.core

HUGE = 10**5000
VECTORS = paths.VECTORS
LINE = re.compile(
    r"(flt|str|raw) (.*?) *(?:->)? ?(?:rc=([01]) )?(0x[0-9A-F]{8}) k=(\S+) dp=(\S+) e=(\S+) str=(\S*) (?:flt|back)=(\S+)"
)


class Vector(NamedTuple):
    """A line of a list.

    ``flt``: a value, its word, and the value of that word. ``str``: a text, what ``str_to_pkflt`` returns, the word of
    the text and its value. ``raw``: a word and its value. The fields and the text of the word are in all of them.
    """

    rounding: Rounding
    kind: str
    given: str
    failed: bool
    word: int
    fields: PackFloat
    text: str
    value: float


def vectors(rounding: Rounding) -> list[Vector]:
    lines = (VECTORS / f"packfloat-{rounding}.txt").read_text().splitlines()
    found = [LINE.fullmatch(line) for line in lines]
    assert all(found)
    return [
        Vector(
            rounding,
            m[1],
            m[2],
            m[3] == "1",
            int(m[4], 16),
            PackFloat(int(m[5]), int(m[6]), int(m[7])),
            m[8],
            float(m[9]),
        )
        for m in found
        if m
    ]


ALL = [*vectors("round"), *vectors("trunc")]


def name(vector: Vector) -> str:
    return f"{vector.rounding} {vector.kind} {vector.given}"


def single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def same(one: float, other: float) -> bool:
    """Return True if two numbers are equal, including the sign of 0; NaN equals NaN."""
    return struct.pack("<f", one) == struct.pack("<f", other) or (math.isnan(one) and math.isnan(other))


def test_the_lists_are_read_whole() -> None:
    assert [sum(v.kind == kind for v in ALL) for kind in ("flt", "str", "raw")] == [84, 82, 32]


@pytest.mark.parametrize("vector", [v for v in ALL if v.kind == "flt"], ids=name)
def test_vectors_of_values(vector: Vector) -> None:
    if vector.given == "-inf":
        # The compiler of the lists has an isinf() without a sign: the value in the list is its defect.
        assert vector.word == PLUS_INFINITY
        assert packfloat.from_float(-math.inf, rounding=vector.rounding) == MINUS_INFINITY
    else:
        assert packfloat.from_float(float(vector.given), rounding=vector.rounding) == vector.word


@pytest.mark.parametrize("vector", [v for v in ALL if v.kind == "str"], ids=name)
def test_vectors_of_texts(vector: Vector) -> None:
    if not vector.failed:
        assert packfloat.from_text(vector.given) == vector.word
        return
    text = "1 " if vector.given == "1" else vector.given  # its trailing space is lost in the padding of the column
    with pytest.raises(InvalidValue, match="is not a PACK_FLOAT number"):
        packfloat.from_text(text)


@pytest.mark.parametrize("vector", [v for v in ALL if not v.failed], ids=name)
def test_vectors_of_words(vector: Vector) -> None:
    assert packfloat.unpack(vector.word) == vector.fields
    assert packfloat.to_text(vector.word) == vector.text
    assert same(packfloat.to_float(vector.word), single(vector.value))
    assert vector.kind != "raw" or int(vector.given) == vector.word


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ((0, 0, 0), ZERO),
        ((1, -8, -64), packfloat.pack(1, -8, -64)),
        ((1, -9, 0), packfloat.pack(1, -5, -4)),
        ((1, 8, 0), packfloat.pack(1, -5, 13)),
        ((1, -9, -60), packfloat.pack(1, -5, -64)),
        ((1, -9, -61), ZERO),
        ((1, 0, -65), ZERO),
        ((1, 0, 64), PLUS_INFINITY),
        ((-1, 0, 64), MINUS_INFINITY),
        ((0, 0, 64), ZERO),
        ((0, 8, 63), ZERO),
        ((999_999, 7, 63), 0x7EEF423F),
        ((-(2**20), -1, -1), MINUS_INFINITY),
        ((2**20 - 1, 0, 0), PLUS_INFINITY),
        ((-(2**20) + 1, -1, -1), NAN),
        pytest.param((1, HUGE, 0), PLUS_INFINITY, id="huge point"),
        pytest.param((1, 0, -HUGE), ZERO, id="huge exponent"),
    ],
)
def test_make(fields: tuple[int, int, int], word: int) -> None:
    assert packfloat.pack(*fields) == word


@pytest.mark.parametrize("mantissa", [2**20, -(2**20) - 1, pytest.param(HUGE, id="huge")])
def test_a_mantissa_that_does_not_fit(mantissa: int) -> None:
    with pytest.raises(InvalidValue, match="mantissa of a PACK_FLOAT must be -1048576 to 1048575, not "):
        packfloat.pack(mantissa, 0, 0)


@pytest.mark.parametrize("word", [-1, 2**32, pytest.param(HUGE, id="huge")])
def test_words_have_32_bits(word: int) -> None:
    for function in (packfloat.unpack, packfloat.to_text, packfloat.to_float):
        with pytest.raises(InvalidValue, match="32-bit word"):
            function(word)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="32 ビット"):
        packfloat.unpack(word)


@pytest.mark.parametrize(
    ("text", "word_of"),
    [
        ("+", "0"),
        (".", "0"),
        ("-.e-", "0"),
        ("-.5", "-0.5"),
        ("1e+", "1"),
        ("1e-", "1"),
        ("e5", "0e5"),
        ("1e00000000000005", "1e5"),
        ("123456.789", "123456"),
        ("12345.678", "12345.6"),
        ("1234567.89", "1234560"),
        ("0.00123456789", "0.00123456"),
        ("12.00", "12.00"),
        ("000012.5", "12.5"),
        ("1e9999999", "1e99"),
        ("-1e9999999", "-1e99"),
        ("1e-9999999", "0"),
    ],
)
def test_equivalent_texts(text: str, word_of: str) -> None:
    assert packfloat.from_text(text) == packfloat.from_text(word_of)


@pytest.mark.parametrize(
    "text",
    [
        " 1",
        "1 ",
        "1\n",
        "--1",
        "+-1",
        "1,5",
        "0x10",
        "1_0",
        "１",
        "²",
        "inf",
        "nan",
        "+#INF",
        "1\0",
        "1f",
        "1e1e1",
        "1e+-1",
    ],
)
def test_invalid_texts(text: str) -> None:
    with pytest.raises(InvalidValue):
        packfloat.from_text(text)


def test_huge_texts_are_fast() -> None:
    huge = 10**6
    assert packfloat.to_text(packfloat.from_text("9" * huge)) == "+#INF"
    assert packfloat.from_text("0." + "0" * huge + "1") == ZERO
    assert packfloat.from_text("0" * huge + "7") == 7
    assert packfloat.from_text("1." + "9" * huge) == packfloat.from_text("1.99999")
    assert packfloat.from_text("1e" + "9" * huge) == PLUS_INFINITY
    assert packfloat.from_text("1e-" + "9" * huge) == ZERO
    with pytest.raises(InvalidValue) as caught:
        packfloat.from_text("1" * huge + "x")
    assert len(str(caught.value)) < 200


def test_an_unknown_rounding() -> None:
    wrong: Any = "up"
    with pytest.raises(InvalidValue, match='"round" or "trunc"'):
        packfloat.from_float(1.0, rounding=wrong)


@pytest.mark.parametrize(("value", "word"), [(1e39, PLUS_INFINITY), (-1e39, MINUS_INFINITY), (10**400, PLUS_INFINITY)])
def test_values_beyond_single_precision(value: float, word: int) -> None:
    assert packfloat.from_float(value) == word


@given(st.integers(0, 0xFFFFFFFF))
@example(NAN)
@example(0x00F00000)
def test_every_word_is_its_fields(word: int) -> None:
    mantissa, point, exponent = packfloat.unpack(word)
    assert packfloat.pack(mantissa, point, exponent) == word
    finite = abs(mantissa) <= 999_999
    text, value = packfloat.to_text(word), packfloat.to_float(word)
    assert finite == (text not in ("+#INF", "-#INF", "#NAN"))
    if not finite:
        return
    exact = Decimal(mantissa).scaleb(point + exponent)
    assert Decimal(text) == exact
    if Decimal("1e-30") < abs(exact) < Decimal("1e38"):  # the vendor's arithmetic loses some units in the last place
        assert math.isclose(value, exact, rel_tol=1e-6)
    assert math.copysign(1, value) == (-1 if mantissa < 0 else 1)


@given(st.integers(-999_999, 999_999), st.integers(-8, 0), st.integers(-64, 63))
def test_texts_of_words_are_read_again(mantissa: int, point: int, exponent: int) -> None:
    word = packfloat.pack(mantissa, point, exponent)
    assert packfloat.from_text(packfloat.to_text(word)) == word


@given(st.floats(width=32, allow_nan=False, allow_infinity=False), st.sampled_from(["round", "trunc"]))
def test_six_digits_of_every_value(value: float, rounding: Rounding) -> None:
    word = packfloat.from_float(value, rounding=rounding)
    mantissa, point, exponent = packfloat.unpack(word)
    assert packfloat.pack(mantissa, point, exponent) == word
    assert abs(mantissa) <= 999_999
    if abs(value) > 1e-30:  # one unit of the sixth digit, and the error of the divisions
        assert math.isclose(Decimal(packfloat.to_text(word)), value, rel_tol=1.1e-5)
    assert packfloat.from_float(-value, rounding=rounding) == packfloat.pack(-mantissa, point, exponent)


@given(st.integers(-999_999, 999_999))
def test_whole_numbers_of_six_digits_are_exact(number: int) -> None:
    for rounding in ("round", "trunc"):
        assert packfloat.to_float(packfloat.from_float(number, rounding=rounding)) == number
