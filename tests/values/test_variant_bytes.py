"""Binary encoding of VARIANTs: known packets both ways, every type, every limit, and no reads beyond it."""

from __future__ import annotations

import struct
from datetime import datetime
from decimal import Decimal, Inexact, localcontext
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import hresult, i18n
from orinkit.core.errors import InvalidValue, LimitExceeded, ProtocolError
from orinkit.values import codec
from orinkit.values.codec import (
    PacketLimits,
    decode,
    encode,
    encode_handle,
    encode_integer,
    encode_single,
    encode_string,
)
from orinkit.values.types import FORMATS, SIZES
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, variant
from support.strategies import same, variants

pytestmark = pytest.mark.core

I4 = "0a000000 0300 01000000 "
BOOL = "08000000 0b00 01000000 "


def raw(text: str) -> bytes:
    return bytes.fromhex(text)


def argument(vt: int, count: int, data: bytes, length: int | None = None) -> bytes:
    return struct.pack("<IHI", 6 + len(data) if length is None else length, vt, count) + data


def element(vt: int, count: int, data: bytes) -> bytes:
    return struct.pack("<HI", vt, count) + data


def refused(data: bytes, code: int, match: str, **options: object) -> ProtocolError:
    for exact in (False, True):
        with pytest.raises(ProtocolError, match=match) as caught:
            decode(data, exact=exact, **options)
        assert caught.value.code == code
        assert not caught.value.fatal
    return caught.value


# --- known bytes ------------------------------------------------------------------------------------------------------

KNOWN = [
    (Variant(VarType.EMPTY), "06000000 0000 01000000"),
    (Variant(VarType.NULL), "06000000 0100 01000000"),
    (Variant(VarType.I2, -2), "08000000 0200 01000000 feff"),
    (Variant(VarType.I4, 2), I4 + "02000000"),
    (Variant(VarType.I4, -(2**31)), I4 + "00000080"),
    (Variant(VarType.R4, 1.0), "0a000000 0400 01000000 0000803f"),
    (Variant(VarType.R8, 1.0), "0e000000 0500 01000000 000000000000f03f"),
    (Variant(VarType.CY, Decimal("1.0000")), "0e000000 0600 01000000 1027000000000000"),
    (Variant(VarType.CY, Decimal("-0.0001")), "0e000000 0600 01000000 ffffffffffffffff"),
    (Variant(VarType.DATE, datetime(1900, 1, 1, 12)), "0e000000 0700 01000000 0000000000000440"),
    (Variant(VarType.DATE, datetime(1899, 12, 29, 12)), "0e000000 0700 01000000 000000000000f8bf"),
    (Variant(VarType.BSTR, "P1"), "0e000000 0800 01000000 04000000 50003100"),
    (Variant(VarType.BSTR, ""), "0a000000 0800 01000000 00000000"),
    (Variant(VarType.BSTR, "あ"), "0c000000 0800 01000000 02000000 4230"),
    (Variant(VarType.BSTR, "\U0001f916"), "0e000000 0800 01000000 04000000 3ed816dd"),
    (Variant(VarType.BSTR, "\ud800"), "0c000000 0800 01000000 02000000 00d8"),
    (Variant(VarType.BSTR, "a\0b"), "10000000 0800 01000000 06000000 610000006200"),
    (Variant(VarType.ERROR, 0x80004005), "0a000000 0a00 01000000 05400080"),
    (Variant(VarType.BOOL, True), BOOL + "ffff"),
    (Variant(VarType.BOOL, False), BOOL + "0000"),
    (Variant(VarType.I1, -1), "07000000 1000 01000000 ff"),
    (Variant(VarType.UI1, 255), "07000000 1100 01000000 ff"),
    (Variant(VarType.UI2, 65535), "08000000 1200 01000000 ffff"),
    (Variant(VarType.UI4, 2**32 - 1), "0a000000 1300 01000000 ffffffff"),
    (Variant(VarType.I8, -1), "0e000000 1400 01000000 ffffffffffffffff"),
    (Variant(VarType.UI8, 2**64 - 1), "0e000000 1500 01000000 ffffffffffffffff"),
    (Variant(VarType.I4 | ARRAY, [0, 1]), "0e000000 0320 02000000 00000000 01000000"),
    (Variant(VarType.R8 | ARRAY, [1.0]), "0e000000 0520 01000000 000000000000f03f"),
    (Variant(VarType.R8 | ARRAY, []), "06000000 0520 00000000"),
    (Variant(VarType.UI1 | ARRAY, b"\x01\x02\x03"), "09000000 1120 03000000 010203"),
    (Variant(VarType.BOOL | ARRAY, [True, False]), "0a000000 0b20 02000000 ffff 0000"),
    (Variant(VarType.BSTR | ARRAY, ["a", ""]), "10000000 0820 02000000 02000000 6100 00000000"),
    (Variant(VARIANT_ARRAY, []), "06000000 0c20 00000000"),
    (
        Variant(VARIANT_ARRAY, [Variant(VarType.I2, 1), Variant(VarType.BSTR, "a"), Variant(VarType.EMPTY)]),
        "20000000 0c20 03000000  0200 01000000 0100  0800 01000000 02000000 6100  0000 01000000",
    ),
    (
        Variant(VARIANT_ARRAY, [Variant(VARIANT_ARRAY, [Variant(VarType.R4 | ARRAY, [1.0])])]),
        "16000000 0c20 01000000  0c20 01000000  0420 01000000 0000803f",
    ),
]


@pytest.mark.parametrize(("item", "text"), KNOWN, ids=lambda part: repr(part) if isinstance(part, Variant) else "")
def test_known_bytes_both_ways(item, text):
    data = raw(text)
    assert encode(item) == data
    value, after = decode(data, exact=True)
    assert after == len(data)
    assert same(value, item)
    assert same(decode(data)[0], item.plain)


def test_every_type_is_among_the_known_bytes():
    scalars = {item.type for item, _ in KNOWN if not item.type & ARRAY}
    assert scalars == {int(vt) for vt in VarType} - {VarType.VARIANT, VarType.ARRAY}


@given(variants())
def test_any_variant_is_given_back_exactly(item):
    data = encode(item)
    assert len(data) == 4 + struct.unpack_from("<I", data)[0]
    again, after = decode(data, exact=True)
    assert after == len(data)
    assert same(again, item)
    assert same(decode(data)[0], item.plain)


@given(variants(), st.binary(max_size=20), st.binary(max_size=20))
def test_an_argument_is_read_where_it_lies(item, before, behind):
    data = encode(item)
    whole = before + data + behind
    assert same(decode(whole, len(before), len(before) + len(data), exact=True)[0], item)
    again, after = decode(whole, len(before), exact=True)
    assert (same(again, item), after) == (True, len(before) + len(data))


# --- to bytes: the short ways do what the long one does --------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [
        None, 0, -(2**31), 2**31 - 1, True, 1.5, nan, "", "P1", "x" * 63, "x" * 64, "あ" * 5000, "\U0001f916" * 64, b"",
        b"\0\1", [], (), [1.0], (1.0, 2.0), [0.5] * 64, [0.5] * 65, [1.0, 2], [1, 2], [True], ["a"], [[1.0, 2.0], "J"],
        datetime(2026, 1, 1), Decimal("1.5"), Variant(VarType.I2, 5),
    ],
    ids=lambda value: f"{type(value).__name__}",
)  # fmt: skip
def test_any_value_is_encoded_like_its_variant(value):
    assert encode(value) == codec.encode_variant(variant(value))


def test_numpy_values_are_encoded_like_their_variants():
    np = pytest.importorskip("numpy")
    for value in (np.array([1.0, 2.0]), [np.float64(1), 2.0], np.float64(1)):
        assert encode(value) == codec.encode_variant(variant(value))
    assert encode_integer(np.int16(2)) == encode(2)
    assert encode_string(np.str_("P1")) == encode("P1")
    assert encode_single(np.float32(1)) == encode(Variant(VarType.R4, 1))


def test_the_fast_paths_one_by_one():
    assert encode_integer(2) == encode_handle(2) == encode(2)
    assert encode_integer(True) == encode(1)
    assert encode_string("P1") == encode("P1")
    assert encode_single(1) == encode(Variant(VarType.R4, 1))


@pytest.mark.parametrize("short", [encode, encode_integer, encode_handle])
@pytest.mark.parametrize("number", [2**31, -(2**31) - 1, 10**5000], ids=lambda number: number.bit_length())
def test_an_int_beyond_vt_i4_is_refused(short, number):
    with pytest.raises(InvalidValue, match="does not fit VT_I4"):
        short(number)


@pytest.mark.parametrize("value", [1.0, "1", None, b"1", 1j])
def test_invalid_ints(value):
    for short in (encode_integer, encode_handle):
        with pytest.raises(InvalidValue, match="is not a valid value for VT_I4"):
            short(value)


@pytest.mark.parametrize("value", [1e39, -1e39, 10**400, "1", None, [1.0]], ids=lambda value: type(value).__name__)
def test_invalid_singles(value):
    with pytest.raises(InvalidValue, match=r"is not a valid value for VT_R4"):
        encode_single(value)


@pytest.mark.parametrize("value", [1, None, b"P1", ["P1"]])
def test_invalid_strings(value):
    with pytest.raises(InvalidValue, match="is not a valid value for VT_BSTR"):
        encode_string(value)


def test_a_variant_that_is_nested_without_end():
    deep = Variant(VarType.EMPTY)
    for _ in range(100_000):
        deep = Variant(VARIANT_ARRAY, [deep])
    with pytest.raises(InvalidValue, match="nested too deep"):
        encode(deep)
    while deep.value:  # released step by step: some versions of Python cannot free such a deep chain
        deep = deep.value[0]


def test_the_callers_decimal_context_has_no_effect():
    item = Variant(VarType.CY, Decimal("922337203685477.5807"))
    with localcontext() as context:
        context.prec = 3
        context.traps[Inexact] = True
        data = encode(item)
        assert data[10:] == struct.pack("<q", 2**63 - 1)
        assert str(decode(data)[0]) == "922337203685477.5807"


# --- from bytes: what may be read -------------------------------------------------------------------------------------


def test_types_of_plain_values():
    assert same(decode(raw("08000000 0b00 01000000 0100"))[0], True)
    assert same(decode(raw("0a000000 1300 01000000 ffffffff"))[0], 2**32 - 1)
    assert same(decode(raw("06000000 0100 01000000"))[0], None)
    assert same(decode(raw("0e000000 0500 01000000 000000000000f07f"))[0], inf)


def test_a_date_outside_the_range_of_datetime_is_its_days():
    for days in (inf, nan, 1e300, -1e300):
        data = argument(VarType.DATE, 1, struct.pack("<d", days))
        assert same(decode(data)[0], days)
        assert same(decode(data, exact=True)[0], Variant(VarType.DATE, days))
        assert encode(decode(data, exact=True)[0]) == data


def test_any_bits_of_a_date_are_given_back_by_exact():
    for days in (-0.5, -0.0, 45000.00000000001, 2958465.999999999, 5e-324):
        data = argument(VarType.DATE | ARRAY, 2, struct.pack("<2d", days, days))
        assert encode(decode(data, exact=True)[0]) == data


# --- from bytes: what may not -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", range(10))
def test_an_argument_has_ten_bytes_at_least(size):
    refused(b"\6\0\0\0\0\0\1\0\0\0"[:size], hresult.E_INVALIDRCVPACKET, f"requires 10 bytes or more, {size} are left")


def test_the_message_contains_the_offset():
    data = encode(1) + encode(2)[:-1]
    with pytest.raises(ProtocolError, match="at offset 14 does not match the 9 bytes that follow"):
        decode(data, 14)
    with pytest.raises(ProtocolError, match="-4 are left at offset 14"):
        decode(data, 14, 10)
    i18n.use("ja")
    with pytest.raises(ProtocolError, match="オフセット 14"):
        decode(data, 14)


@pytest.mark.parametrize("length", [0, 5, 11, 2**24, 2**24 - 1])
def test_a_length_that_does_not_fit(length):
    data = argument(VarType.I4, 1, b"\0" * 4, length)
    refused(
        data,
        hresult.E_INVALIDRCVPACKET,
        f"argument length {length} at offset 0 does not match the 10 bytes that follow",
    )


@pytest.mark.parametrize("length", [2**24 + 1, 2**32 - 1])
def test_an_argument_beyond_the_limit(length):
    data = argument(VarType.I4, 1, b"\0" * 4, length)
    error = refused(data, hresult.E_ARGSIZEOVER, f"argument of {length} bytes at offset 0, at most 16777216")
    assert isinstance(error, LimitExceeded)


@pytest.mark.parametrize(("vt", "size"), SIZES.items(), ids=lambda value: str(value))
def test_a_count_that_does_not_agree_with_the_bytes(vt, size):
    name = f"VT_{VarType(vt).name}"
    wrong = hresult.E_INVALIDRCVPACKET
    refused(
        argument(vt, 1, b"\0" * (size - 1)), wrong, rf"at offset \d+, {size - 1} bytes of data do not match 1 x {name}"
    )
    refused(
        argument(vt, 1, b"\0" * (size + 1)), wrong, rf"at offset \d+, {size + 1} bytes of data do not match 1 x {name}"
    )
    refused(argument(vt, 0, b""), wrong, rf"at offset \d+, 0 bytes of data do not match 0 x {name}")
    refused(
        argument(vt, 2, b"\0" * (2 * size)), wrong, rf"at offset \d+, {2 * size} bytes of data do not match 2 x {name}"
    )
    for count in (1, 3, 2**32 - 1):
        refused(
            argument(vt | ARRAY, count, b"\0" * (2 * size)),
            wrong,
            rf"at offset \d+, {2 * size} bytes of data do not match {count} x {name}\|VT_ARRAY",
        )


@pytest.mark.parametrize("vt", [VarType.EMPTY, VarType.NULL])
def test_nothing_has_one_element_and_no_bytes(vt):
    refused(argument(vt, 0, b""), hresult.E_INVALIDRCVPACKET, "0 x VT_")
    refused(argument(vt, 1, b"\0"), hresult.E_INVALIDRCVPACKET, "1 bytes of data do not match")


@pytest.mark.parametrize(
    "vt", [9, 13, 14, 15, 22, 64, 99, 0x4003, 0xFFFF, VarType.VARIANT, ARRAY, ARRAY | 1, ARRAY | 9]
)
def test_unknown_types(vt):
    refused(argument(vt, 1, b"\0" * 16), hresult.E_INVALIDARGTYPE, "unknown type VT_.* at offset 10")
    inside = argument(VARIANT_ARRAY, 1, element(vt, 1, b"\0" * 16))
    refused(inside, hresult.E_INVALIDARGTYPE, "unknown type VT_.* at offset 16")


@pytest.mark.parametrize(
    ("count", "data", "match"),
    [
        (1, b"", "1 x VT_BSTR"),
        (1, b"\2\0\0", "1 x VT_BSTR"),
        (1, b"\2\0\0\0a", "the length of the string at offset 10 must be even and at most 1 bytes, not 2"),
        (1, b"\1\0\0\0a", "the length of the string at offset 10 must be even and at most 1 bytes, not 1"),
        (1, b"\3\0\0\0abc", "must be even and at most 3 bytes, not 3"),
        (1, b"\xff\xff\xff\xffab", "must be even and at most 2 bytes, not 4294967295"),
        (1, b"\0\0\0\0ab", "6 bytes of data do not match"),
        (2, b"\0\0\0\0", "2 x VT_BSTR"),
        (0, b"", "0 x VT_BSTR"),
    ],
)
def test_broken_strings(count, data, match):
    refused(argument(VarType.BSTR, count, data), hresult.E_INVALIDRCVPACKET, match)


def test_broken_string_arrays():
    wrong = hresult.E_INVALIDRCVPACKET
    refused(
        argument(VarType.BSTR | ARRAY, 2, b"\0" * 4), wrong, "at offset 14, 0 bytes of data do not match 2 x VT_BSTR"
    )
    refused(argument(VarType.BSTR | ARRAY, 1, b"\0" * 8), wrong, r"8 bytes of data do not match")
    refused(argument(VarType.BSTR | ARRAY, 0, b"\0"), wrong, r"1 bytes of data do not match")


def test_broken_variant_arrays():
    wrong = hresult.E_INVALIDRCVPACKET
    inside = element(VarType.I2, 1, b"\0\0")
    refused(
        argument(VARIANT_ARRAY, 2, inside),
        wrong,
        r"at offset 18, 0 bytes of data do not match 2 x VT_VARIANT\|VT_ARRAY",
    )
    refused(argument(VARIANT_ARRAY, 1, inside + b"\0"), wrong, "9 bytes of data do not match")
    refused(argument(VARIANT_ARRAY, 1, inside[:-1]), wrong, "at offset 16, 1 bytes of data do not match 1 x VT_I2")
    refused(
        argument(VARIANT_ARRAY, 1, inside[:5]),
        wrong,
        r"at offset 10, 5 bytes of data do not match 1 x VT_VARIANT\|VT_ARRAY",
    )
    refused(argument(VARIANT_ARRAY, 1, element(VarType.I2, 2, b"\0" * 4)), wrong, "2 x VT_I2")


def test_an_element_may_not_reach_beyond_its_argument():
    """The following bytes exist, but they belong to the next argument."""
    data = argument(VARIANT_ARRAY, 1, element(VarType.R8 | ARRAY, 2, b"\0" * 8)) + encode(1.5)
    refused(data, hresult.E_INVALIDRCVPACKET, r"2 x VT_R8\|VT_ARRAY")
    text = argument(VarType.BSTR, 1, struct.pack("<I", 20) + b"\0" * 4) + encode("a long text behind it")
    refused(
        text,
        hresult.E_INVALIDRCVPACKET,
        "the length of the string at offset 10 must be even and at most 4 bytes, not 20",
    )


# --- limits -----------------------------------------------------------------------------------------------------------


def nested(depth: int) -> bytes:
    data = element(VARIANT_ARRAY, 1, b"") * depth + element(VarType.EMPTY, 1, b"")
    return struct.pack("<I", len(data)) + data


def test_depth_to_the_limit_and_not_beyond():
    value, _ = decode(nested(16))
    assert str(value).count("[") == 16
    for depth in (17, 1000, 100_000):
        error = refused(nested(depth), hresult.E_INVALIDARGTYPE, "nested deeper than 16")
        assert isinstance(error, LimitExceeded)
    assert decode(nested(2), limits=PacketLimits(depth=2))[0] == [[None]]
    refused(nested(3), hresult.E_INVALIDARGTYPE, "nested deeper than 2", limits=PacketLimits(depth=2))


@pytest.mark.parametrize(
    "value",
    [
        ["", "a", ""], [None, None, None], [Decimal(0)] * 3, [datetime(2026, 1, 1)] * 3, [["a"], None],
        [Variant(VarType.CY | ARRAY, [1, 2]), None], [datetime(2026, 1, 1), None],
    ],
    ids=repr,
)  # fmt: skip
def test_elements_that_cost_more_than_their_bytes_are_counted(value):
    data = encode(value)
    spent = {VarType.CY | ARRAY: 3, VarType.DATE | ARRAY: 3}.get(variant(value).type)
    assert same(decode(data, limits=PacketLimits(variants=spent or 4))[0], variant(value).plain)
    assert isinstance(
        refused(data, hresult.E_ARGSIZEOVER, "more than 2 elements in one packet", limits=PacketLimits(variants=2)),
        LimitExceeded,
    )


def test_plain_numbers_cost_little_and_bytes_nothing():
    assert (
        decode(encode([0.5] * 1000), limits=PacketLimits(variants=7))[0] == [0.5] * 1000
    )  # set-points are not counted
    assert decode(encode([5] * 1000), limits=PacketLimits(variants=62))[0] == [5] * 1000
    assert decode(encode(bytes(100_000)), limits=PacketLimits(variants=0))[0] == bytes(100_000)
    assert decode(encode([True] * 1000), limits=PacketLimits(variants=62))[0] == [True] * 1000
    refused(encode([5] * 1024), hresult.E_ARGSIZEOVER, "more than 61 elements", limits=PacketLimits(variants=61))
    refused(encode([True] * 1000), hresult.E_ARGSIZEOVER, "more than 61 elements", limits=PacketLimits(variants=61))


@pytest.mark.parametrize(
    ("vt", "size"), [(VARIANT_ARRAY, 6), (VarType.BSTR | ARRAY, 4), (VarType.CY | ARRAY, 8), (VarType.DATE | ARRAY, 8)]
)
def test_a_full_packet_of_costly_elements_is_refused_before_it_is_read(vt, size):
    count = (2**24 - 100) // size
    refused(argument(vt, count, bytes(size) * count), hresult.E_ARGSIZEOVER, "more than 50000 elements")


def test_limits_in_japanese():
    i18n.use("ja")
    refused(nested(17), hresult.E_INVALIDARGTYPE, "入れ子が上限 16")
    refused(argument(VARIANT_ARRAY, 200_001, bytes(1_200_006)), hresult.E_ARGSIZEOVER, "要素数が上限 50000")
    refused(argument(VarType.I4, 1, b"", 2**31), hresult.E_ARGSIZEOVER, "上限 16777216 バイト")


# --- anything ---------------------------------------------------------------------------------------------------------


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data):
    codes = set()
    for exact in (False, True):
        try:
            _, after = decode(data, exact=exact)
        except ProtocolError as error:
            codes.add(error.code)
        else:
            assert after <= len(data)
    assert codes <= {hresult.E_INVALIDRCVPACKET, hresult.E_INVALIDARGTYPE, hresult.E_ARGSIZEOVER}


TYPES = st.sampled_from([*map(int, VarType), *(int(vt) | ARRAY for vt in VarType), 9, 99])


@given(TYPES, st.integers(0, 5) | st.integers(0, 2**32 - 1), st.binary(max_size=60))
def test_any_type_count_and_content_are_read_alike_plain_and_exact(vt, count, content):
    data = argument(vt, count, content)
    try:
        item, _ = decode(data, exact=True)
    except ProtocolError:
        with pytest.raises(ProtocolError):
            decode(data)
        return
    assert (item.type, same(decode(data)[0], item.plain)) == (vt, True)
    lossy = {VarType.BOOL, VarType.R4}  # a BOOL other than 0 and -1, a signalling NaN
    if vt & ~ARRAY in FORMATS.keys() - lossy or vt & ~ARRAY == VarType.BSTR:
        assert encode(item) == data
