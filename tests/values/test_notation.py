from __future__ import annotations

import struct
from datetime import datetime
from decimal import Decimal
from math import inf, nan

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.values.codec import encode_variant
from orinkit.values.notation import (
    MAX_DEPTH,
    MAX_LENGTH,
    format_variant,
    parse,
    parse_data,
    parse_elements,
    parse_lenient,
)
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, unwrapped
from support.strategies import same, strings, variants

pytestmark = pytest.mark.core

BSTRS = VarType.BSTR | ARRAY


@pytest.fixture(autouse=True)
def english():
    before = i18n.current()
    i18n.use("en")
    yield
    i18n.use(before)


def bstr(text):
    return Variant(VarType.BSTR, text)


def i4(number):
    return Variant(VarType.I4, number)


def single(number):
    return struct.unpack("<f", struct.pack("<f", number))[0]


# --- the documents' own texts -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2,100", Variant(VarType.I2, 100)),
        ("8,Sample", bstr("Sample")),
        ("8194,100,200,300", Variant(VarType.I2 | ARRAY, [100, 200, 300])),
        ("8200,Sample,Test", Variant(BSTRS, ["Sample", "Test"])),
        ("8,Sample,Test", bstr("Sample,Test")),
        ("8204,(8,Sample),(2,100)", Variant(VARIANT_ARRAY, [bstr("Sample"), Variant(VarType.I2, 100)])),
    ],
)
def test_examples_of_the_e_cap_document_both_ways(text, value):
    assert same(parse(text), value)
    assert format_variant(value) == text


@pytest.mark.field("5.3")
def test_a_single_variant_contains_the_value_in_its_brackets():
    value = parse("12,(8,Sample)")
    assert (value.type, value.value, value.plain) == (VarType.VARIANT, bstr("Sample"), "Sample")
    assert format_variant(value) == "12,(8,Sample)"
    assert format_variant(parse("8204,(12,(12,(3,1)))")) == "8204,(12,(12,(3,1)))"
    assert unwrapped(parse("8204,(12,(12,(3,1))),(8204,(12,(8,x)))")) == parse("8204,(3,1),(8204,(8,x))")
    assert Variant(VarType.VARIANT, 5).value == i4(5)
    assert encode_variant(value) == encode_variant(bstr("Sample")), "b-CAP has no such type"


@pytest.mark.field("5.3")
@pytest.mark.parametrize(
    ("text", "strings"),
    [
        ("8200, a , b", [" a ", " b"]),
        ("8200, ", [" "]),
        ("8200,", []),
        ('8200,""', [""]),
        ("8200,,", ["", ""]),
        ('8200,"a,b', ['"a', "b"]),
        ('8200,"a"', ['"a"']),
        ('8200,"a"b,c', ['"a"b', "c"]),
        ('8200,"a,b",c', ["a,b", "c"]),
        ("8200,a(,b", ["a(", "b"]),
        ("8200,a),b", ["a)", "b"]),
        ("8200,P(1,2),P2", ["P(1,2)", "P2"]),
        ("8200,a(b,c(,d)", ["a(b", "c(", "d)"]),
        ("8200,100%,a+b", ["100%", "a+b"]),
    ],
)
def test_strings_as_in_the_document(text, strings):
    assert parse(text, exact=True) == Variant(BSTRS, strings)


@pytest.mark.field("5.3")
def test_strings_in_brackets_as_in_the_document():
    elements = parse('8204,(8, a ),(8,"x"),(8,"5),(8200, a,b )', exact=True).value
    assert [each.value for each in elements] == [" a ", '"x"', '"5', [" a", "b "]]
    with pytest.raises(NotationError, match="unbalanced"):
        parse("8204,(8,a(b,(3,1)", exact=True)
    with pytest.raises(NotationError, match='column 13: "\\(" is unbalanced'):
        parse("8204,(8200,a(b", exact=True)


@given(variants())
def test_every_variant_comes_back_exactly(value):
    assert same(parse(format_variant(value, exact=True), exact=True), value)


@given(st.lists(st.text(alphabet=' "(),a', max_size=6), max_size=4))
@example([")", '"a'])
@example(['""a"', '"a', '"'])
def test_every_string_comes_back_exactly(strings):
    value = Variant(BSTRS, strings)
    assert parse(format_variant(value, exact=True), exact=True) == value
    nested = Variant(VARIANT_ARRAY, [value, *map(bstr, strings)])
    assert parse(format_variant(nested, exact=True), exact=True) == nested


def test_unclosed_brackets_take_no_longer():
    assert parse("8200," + "(," * 50_000, exact=True).value == ["("] * 50_000 + [""]


def test_the_pose_printed_in_the_tester():
    pose = [Variant(VarType.R8 | ARRAY, [0, 0, 0, 0, 0, 0, 5]), i4(0), i4(-2)]
    printed = "(8197, 0, 0, 0, 0, 0, 0, 5), (3, 0), (3, -2)"
    assert all(map(same, parse_elements(printed), pose))
    assert len(parse_elements(printed)) == 3
    assert same(parse(f"8204, {printed}"), Variant(VARIANT_ARRAY, pose))
    assert format_variant(Variant(VARIANT_ARRAY, pose)) == "8204,(8197,0,0,0,0,0,0,5),(3,0),(3,-2)"


@pytest.mark.parametrize("text", ["", "  ", "\n"])
def test_no_elements(text):
    assert parse_elements(text) == []


# --- each type --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0,", Variant(VarType.EMPTY)),
        ("1,", Variant(VarType.NULL)),
        ("2,-32768", Variant(VarType.I2, -32768)),
        ("3,2147483647", i4(2147483647)),
        ("4,0.1", Variant(VarType.R4, single(0.1))),
        ("4,16777216", Variant(VarType.R4, 16777216.0)),
        ("4,3.4028235e+38", Variant(VarType.R4, single(3.4028234663852886e38))),
        ("4,1e-45", Variant(VarType.R4, 2.0**-149)),
        ("4,-0", Variant(VarType.R4, -0.0)),
        ("4,-inf", Variant(VarType.R4, -inf)),
        ("4,nan", Variant(VarType.R4, nan)),
        ("5,100", Variant(VarType.R8, 100.0)),
        ("5,-1.5", Variant(VarType.R8, -1.5)),
        ("5,-0", Variant(VarType.R8, -0.0)),
        ("5,1e+16", Variant(VarType.R8, 1e16)),
        ("5,5e-324", Variant(VarType.R8, 5e-324)),
        ("5,inf", Variant(VarType.R8, inf)),
        ("5,nan", Variant(VarType.R8, nan)),
        ("6,12.5", Variant(VarType.CY, Decimal("12.5"))),
        ("6,1200", Variant(VarType.CY, Decimal("1.2e3"))),
        ("6,-922337203685477.5808", Variant(VarType.CY, Decimal("-922337203685477.5808"))),
        ("7,2026-11-21 10:00:00", Variant(VarType.DATE, datetime(2026, 11, 21, 10))),
        ("7,0001-01-01 00:00:00.000001", Variant(VarType.DATE, datetime(1, 1, 1, microsecond=1))),
        ("7,46347.5", Variant(VarType.DATE, 46347.5)),
        ("7,1", Variant(VarType.DATE, 1.0)),
        ("8,", bstr("")),
        ("8, Sample ", bstr(" Sample ")),
        ("10,0x80070057", Variant(VarType.ERROR, 0x80070057)),
        ("11,-1", Variant(VarType.BOOL, True)),
        ("11,0", Variant(VarType.BOOL, False)),
        ("16,-128", Variant(VarType.I1, -128)),
        ("17,255", Variant(VarType.UI1, 255)),
        ("18,65535", Variant(VarType.UI2, 65535)),
        ("19,4294967295", Variant(VarType.UI4, 2**32 - 1)),
        ("20,-9223372036854775808", Variant(VarType.I8, -(2**63))),
        ("21,18446744073709551615", Variant(VarType.UI8, 2**64 - 1)),
        ("8197,", Variant(VarType.R8 | ARRAY, [])),
        ("8196,0.1,0.5", Variant(VarType.R4 | ARRAY, [single(0.1), 0.5])),
        ("8203,-1,0", Variant(VarType.BOOL | ARRAY, [True, False])),
        ("8199,2026-11-21 10:00:00,2.5", Variant(VarType.DATE | ARRAY, [datetime(2026, 11, 21, 10), 2.5])),
        ("8209,0,255", Variant(VarType.UI1 | ARRAY, b"\x00\xff")),
        ("8209,", Variant(VarType.UI1 | ARRAY, b"")),
        ("8204,", Variant(VARIANT_ARRAY, [])),
        ("8204,(0,),(1,),(8,),(8197,)",
         Variant(VARIANT_ARRAY, [Variant(VarType.EMPTY), Variant(VarType.NULL), bstr(""), Variant(VarType.R8 | ARRAY, [])])),
        ("8204,(8204,(3,1),(8197,1,2)),(8,x)",
         Variant(VARIANT_ARRAY, [
             Variant(VARIANT_ARRAY, [i4(1), Variant(VarType.R8 | ARRAY, [1.0, 2.0])]), bstr("x")])),
    ],
)  # fmt: skip
def test_canonical_text_both_ways(text, value):
    assert format_variant(value) == text
    assert same(parse(text), value)
    assert same(parse_lenient(text), value)


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("0", "0,"),
        (" 1 ", "1,"),
        ("0, ", "0,"),
        ("8197", "8197,"),
        ("8209", "8209,"),
        ("8200 ", "8200,"),
        ("8204", "8204,"),
        ("8204,(8197),(0)", "8204,(8197,),(0,)"),
        (" 3 , 0x1F ", "3,31"),
        ("3,-0X10", "3,-16"),
        ("3,+007", "3,7"),
        ("10,-2147024809", "10,0x80070057"),
        ("10,2147942487", "10,0x80070057"),
        ("4,0.100000001", "4,0.1"),
        ("5,1.", "5,1"),
        ("5,.5E1", "5,5"),
        ("5,-Infinity", "5,-inf"),
        ("5,NaN", "5,nan"),
        ("6,.5", "6,0.5"),
        ("6,1.50000000", "6,1.5"),
        ("6,922337203685477.58070", "6,922337203685477.5807"),
        ("7,2026/11/21 10:00:00", "7,2026-11-21 10:00:00"),
        ("7,2026-11-21T10:00:00.5", "7,2026-11-21 10:00:00.500000"),
        ("7,2026-1-2 3:04", "7,2026-01-02 03:04:00"),
        ("7,2026-11-21", "7,2026-11-21 00:00:00"),
        ("11,1", "11,-1"),
        ("11,TRUE", "11,-1"),
        ("11,False", "11,0"),
        ("8194, 1 ,\t2\r\n", "8194,1,2"),
        ("8204 , ( 8 , Sample ) , ( 2 , 100 ) ", "8204,(8,Sample),(2,100)"),
    ],
)
def test_other_spellings(text, canonical):
    assert format_variant(parse(text)) == canonical


def test_any_python_value_is_formatted_by_the_rules_of_variant():
    assert format_variant([1, "a"]) == "8204,(3,1),(8,a)"
    assert format_variant(None) == "0,"
    assert format_variant(b"\x01") == "8209,1"
    assert format_variant([1.0, 2.5]) == "8197,1,2.5"
    with pytest.raises(InvalidValue):
        format_variant(2**31)


# --- strings ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "strings"),
    [
        ("8200,", []),
        ('8200,""', [""]),
        ("8200,,", ["", ""]),
        ("8200,a,,b", ["a", "", "b"]),
        ('8200,"a,b",c', ["a,b", "c"]),
        ('8200," a","b ",","', [" a", "b ", ","]),
        ('8200,"""","a"', ['"', "a"]),
        ('8200,5" pipe,"""x"""', ['5" pipe', '"x"']),
        ("8200,main(1).pcs,　全角　", ["main(1).pcs", "　全角　"]),
        ('8200,"(",")("', ["(", ")("]),
        ("8200, Sample , Test", ["Sample", "Test"]),
        ("8200,P(1,2),J(3,(4,5))", ["P(1,2)", "J(3,(4,5))"]),
        ('8200, "a" , b', ["a", "b"]),
    ],
)
def test_string_arrays(text, strings):
    assert same(parse(text), Variant(BSTRS, strings))
    assert same(parse(f"8204,({text}),(3,1)"), Variant(VARIANT_ARRAY, [Variant(BSTRS, strings), i4(1)]))


@pytest.mark.parametrize(
    ("string", "in_brackets", "in_array"),
    [
        ("Sample", "Sample", "Sample"),
        ("Sample,Test", "Sample,Test", '"Sample,Test"'),
        ("@E P(1,2)", "@E P(1,2)", '"@E P(1,2)"'),
        ("main(1).pcs", "main(1).pcs", "main(1).pcs"),
        ("", "", '""'),
        (" a", '" a"', '" a"'),
        ("a\n", '"a\n"', '"a\n"'),
        ('5"', '5"', '5"'),
        ('"5', '"""5"', '"""5"'),
        (":)", '":)"', '":)"'),
        (")(", '")("', '")("'),
        ("((", '"(("', '"(("'),
    ],
)
def test_quotes_only_where_needed(string, in_brackets, in_array):
    assert format_variant(string) == f"8,{string}"
    assert format_variant([string, 1]) == f"8204,(8,{in_brackets}),(3,1)"
    assert format_variant([string]) == f"8200,{in_array}"


def test_blanks_around_a_bracketed_string_do_not_count():
    assert parse_elements("(8, P1 ), (8, @E )") == [bstr("P1"), bstr("@E")]


@given(strings())
def test_a_string_by_itself_is_never_changed(string):
    assert format_variant(string) == f"8,{string}"
    assert parse(f"8,{string}") == bstr(string)


# --- command lines ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2,100", Variant(VarType.I2, 100)),
        (" 2 ,100", Variant(VarType.I2, 100)),
        ("8204,(8,Sample)", Variant(VARIANT_ARRAY, [bstr("Sample")])),
        ("100", i4(100)),
        (" -5 ", i4(-5)),
        ("0x1F", i4(31)),
        ("1.5", Variant(VarType.R8, 1.5)),
        (" 1e3 ", Variant(VarType.R8, 1000.0)),
        ("true", Variant(VarType.BOOL, True)),
        (" False", Variant(VarType.BOOL, False)),
        ("P1", bstr("P1")),
        ("J(1,2,3)", bstr("J(1,2,3)")),
        ("a,b", bstr("a,b")),
        ("", bstr("")),
        (" a ", bstr(" a ")),
        ("inf", bstr("inf")),
        ("nan", bstr("nan")),
        ("9,5", bstr("9,5")),
        ("99999,5", bstr("99999,5")),
        ("１００", bstr("１００")),
        ("1_000", bstr("1_000")),
        ("8204", i4(8204)),
        ("8,100", bstr("100")),
        ("8,2,100", bstr("2,100")),
        ("9" * 5000, bstr("9" * 5000)),
    ],
)
def test_lenient(text, value):
    assert same(parse_lenient(text), value)


@pytest.mark.parametrize("text", ["2147483648", "0xFFFFFFFF", "1e999", "2,x", "0,1"])
def test_lenient_refuses_what_does_not_fit(text):
    with pytest.raises(NotationError, match="column"):
        parse_lenient(text)


# --- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("", 1, "number of a type"),
        ("abc", 1, "found 'abc'"),
        ("  x", 3, "number of a type"),
        ("9,1", 1, "found '9'"),
        ("8192,1", 1, "found '8192'"),
        ("8193,", 1, "number of a type"),
        ("123456,1", 1, "number of a type"),
        ("-3,1", 1, "number of a type"),
        ("3", 2, 'expected "," and the value of VT_I4 (3), the text ends here'),
        ("8", 2, "VT_BSTR"),
        ("12", 3, "VT_VARIANT"),
        ("3 5", 3, "found '5'"),
        ("3,", 3, "the text ends here"),
        ("3, ", 4, "the text ends here"),
        ("3,x", 3, "expected a whole number from -2147483648 to 2147483647 (VT_I4), found 'x'"),
        ("3,1.0", 3, "found '1.0'"),
        ("3,1,2", 3, "found '1,2'"),
        ("3,2147483648", 3, "VT_I4"),
        ("3,0x", 3, "found '0x'"),
        ("3,1_0", 3, "found '1_0'"),
        ("3,１", 3, "VT_I4"),
        ("17,-1", 4, "from 0 to 255"),
        ("19,4294967296", 4, "from 0 to 4294967295"),
        ("3," + "0" * 2000, 3, "found '00000000000000000000'"),
        ("8195,1," + "9" * 2000, 8, "VT_I4"),
        ("8194,1,,2", 8, "found ',2'"),
        ("8194,1, x ,2", 9, "found 'x'"),
        ("8194,1,", 8, "the text ends here"),
        ("4,1e39", 3, "in the range of single precision"),
        ("4,x", 3, "in the range of single precision"),
        ("5,1e999", 3, "in the range of double precision"),
        ("5,\u0131nf", 3, "in the range of double precision"),
        ("5,1 2", 3, "found '1 2'"),
        ("6,0.00001", 3, "four decimals"),
        ("6,922337203685477.5808", 3, "four decimals"),
        ("6,1e3", 3, "four decimals"),
        ("7,2026-13-01", 3, "a date like"),
        ("7,2026-11/21", 3, "a date like"),
        ("7,2026-11-21 10:00:00+09:00", 3, "a date like"),
        ("7,yesterday", 3, "a date like"),
        ("10,4294967296", 4, "32-bit code"),
        ("10,E_FAIL", 4, "32-bit code"),
        ("11,2", 4, "True"),
        ("0,x", 3, "expected the end of the text, found 'x'"),
        ("12,8,Sample", 4, "expected a VARIANT in parentheses, for example (3,100)"),
        ("12,(3,1),(3,2)", 9, "the end of the text"),
        ("8204,3,1", 6, "expected a VARIANT in parentheses, for example (3,100)"),
        ("8204,(3,1),", 12, "expected a VARIANT in parentheses, for example (3,100)"),
        ("8204,(3,1)x", 11, "the end of the text"),
        ("8204,(3,1", 10, 'expected ")", the text ends here'),
        ("8204,(8,a", 10, 'expected ")"'),
        ("8204,(3", 8, "VT_I4"),
        ("8204,(0 x)", 9, 'expected ")"'),
        ("8204,(3,(1))", 9, "found '(1'"),
        ("8204,(3,)", 9, "found ')'"),
        ("8204,()", 7, "number of a type"),
        ("8204,(8,a(b", 10, '"(" is unbalanced'),
        ("8204,(8,a))", 11, "the end of the text"),
        ("8200,a(b(,c)", 7, '"(" is unbalanced'),
        ("8200,a,:)", 9, '")" is unbalanced'),
        ('8200,a,"b', 8, "quote is not closed"),
        ('8200,"a""', 6, "quote is not closed"),
        ('8200,"a"b', 9, "the end of the text"),
        ('8204,(8,"a"b)', 12, 'expected ")"'),
    ],
)
def test_errors_name_the_column_and_what_was_expected(text, column, says):
    with pytest.raises(NotationError) as caught:
        parse(text)
    assert str(caught.value).startswith(f"column {column}: ")
    assert says in str(caught.value)


@pytest.mark.parametrize(("text", "column"), [("3,0", 1), ("(3,0)(3,1)", 6), ("(3,0),", 7), ("8204,(3,0)", 1)])
def test_errors_of_elements(text, column):
    with pytest.raises(NotationError, match=rf"^column {column}: "):
        parse_elements(text)


@pytest.mark.parametrize("text", ["", "3", "3,x", "8204,3", "8204,(8,a", "8200,:)", '8200,"', "8204,(" * 17, "0,x"])
def test_errors_in_japanese(text):
    i18n.use("ja")
    with pytest.raises(NotationError, match=r"^\d+ 文字目: .*(必要です|括弧|引用符|入れ子|続いています)"):
        parse(text)


def test_error_messages_stay_short():
    with pytest.raises(NotationError) as caught:
        parse("3," + "x" * 100_000)
    assert len(str(caught.value)) < 200


# --- limits -----------------------------------------------------------------------------------------------------------


def nested(levels, innermost):
    for _ in range(levels):
        innermost = Variant(VARIANT_ARRAY, [innermost])
    return innermost


@pytest.mark.parametrize("innermost", [i4(1), Variant(BSTRS, ["a"])])
def test_nesting_up_to_the_limit(innermost):
    deepest = nested(MAX_DEPTH, innermost)
    assert same(parse(format_variant(deepest)), deepest)
    with pytest.raises(InvalidValue, match="16"):
        format_variant(nested(MAX_DEPTH + 1, innermost))
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="16 段"):
        format_variant(nested(MAX_DEPTH, Variant(VARIANT_ARRAY, [])))


@pytest.mark.parametrize("opening", ["8204,(", "12,("])
@pytest.mark.parametrize("levels", [MAX_DEPTH + 1, 100_000])
def test_nesting_beyond_the_limit(opening, levels):
    text = opening * levels + "8204," + ")" * levels
    with pytest.raises(NotationError, match=rf"^column {MAX_DEPTH * len(opening) + len(opening)}: nested deeper"):
        parse(text)


def test_an_array_without_elements_counts_as_a_level_too():
    with pytest.raises(NotationError, match="nested deeper"):
        parse("8204,(" * MAX_DEPTH + "8204," + ")" * MAX_DEPTH)


@pytest.mark.parametrize("read", [parse, parse_elements, parse_lenient])
def test_length_beyond_the_limit(read):
    with pytest.raises(NotationError, match="16777216"):
        read("8," + "x" * (MAX_LENGTH - 1))


def test_length_at_the_limit():
    assert len(parse("8," + "x" * (MAX_LENGTH - 2)).value) == MAX_LENGTH - 2


def test_large_arrays():
    numbers = Variant(VarType.R8 | ARRAY, [index / 8 for index in range(100_000)])
    assert same(parse(format_variant(numbers)), numbers)
    rows = Variant(VARIANT_ARRAY, [Variant(BSTRS, ["a,b", f"{row}"]) for row in range(20_000)])
    assert same(parse(format_variant(rows)), rows)


# --- properties -------------------------------------------------------------------------------------------------------


@given(variants())
@example(Variant(BSTRS, [""]))
@example(Variant(VarType.DATE, 1.0))
@example(Variant(VarType.CY, Decimal("0E-50")))
def test_every_variant_comes_back(value):
    text = format_variant(value)
    assert same(parse(text), value)
    assert same(parse_lenient(text), value)


@given(st.lists(variants(), max_size=4))
def test_elements_come_back(values):
    text = format_variant(Variant(VARIANT_ARRAY, values)).removeprefix("8204,")
    assert same(parse_elements(text), values)


@given(st.datetimes())
def test_every_microsecond_comes_back(moment):
    assert parse(format_variant(moment)).value == moment


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_single_precision_is_written_as_short_as_possible(number):
    text = format_variant(Variant(VarType.R4, number)).removeprefix("4,")
    digits = len(f"{Decimal(text).normalize():e}".split("e")[0].strip("-").replace(".", ""))
    assert single(float(text)) == number
    if digits > 1:
        assert single(float(f"{number:.{digits - 2}e}")) != number


TEXTS = st.one_of(
    st.text(max_size=40),
    st.text(st.characters(exclude_categories=()), max_size=40),
    st.lists(
        st.sampled_from(
            ["8204", "8200", "8197", "8209", "8199", "12", "3", "8", "7", "5", "0", "11", ",", ",", ",", "(", "(", ")", ")",
             '"', '""', " ", "a", "-1", "1.5", "1e5", "0x", "2026-11-21 10:00:00", "inf", "\ud800", "あ", "\u0130", "１"]
        ),
        max_size=30,
    ).map("".join),
)  # fmt: skip


@given(TEXTS)
def test_any_text_is_a_variant_or_a_notation_error(text):
    for read in (parse, lambda text: Variant(VARIANT_ARRAY, parse_elements(text)), parse_lenient):
        try:
            value = read(text)
        except NotationError:
            continue
        assert same(parse(format_variant(value)), value)


@given(variants(), st.data())
def test_damaged_notation_is_a_variant_or_a_notation_error(value, data):
    text = format_variant(value)
    at = data.draw(st.integers(0, len(text)))
    damaged = text[:at] + data.draw(st.sampled_from(["", "(", ")", ",", '"', "x", " ", "9"])) + text[at + 1 :]
    try:
        other = parse(damaged)
    except NotationError as error:
        assert str(error).startswith("column ")  # noqa: PT017 - not every case raises
    else:
        assert same(parse(format_variant(other)), other)


@given(variants())
def test_the_data_alone_is_a_value_of_a_known_type(value):
    """The type is known from the field in which the text was entered."""
    kind, _, data = format_variant(value).partition(",")
    assert same(parse_data(int(kind), data), value)


def test_errors_of_the_data_alone():
    with pytest.raises(NotationError, match="column 1:"):
        parse_data(VarType.I2, "x")
    with pytest.raises(NotationError, match='column 5: "\\)" is unbalanced'):
        parse_data(BSTRS, "a,b:)")
    with pytest.raises(InvalidValue, match="999"):
        parse_data(999, "1")
