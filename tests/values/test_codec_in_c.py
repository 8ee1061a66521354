"""The codec in C: for any value and any bytes, the same result or the same error as the codec in Python."""

from __future__ import annotations

import gc
import struct
import sys
from datetime import UTC, datetime
from decimal import Decimal
from enum import IntEnum, StrEnum
from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.core.speedups import PURE
from orinkit.values import codec, conversions
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, trusted, variant
from support.speedups import alike, check_same_outcome, needs_extension, outcome
from support.strategies import strings, variants

pytestmark = [pytest.mark.core, needs_extension]

LIMITS = st.builds(
    PacketLimits,
    packet=st.sampled_from([10, 100, DEFAULT_LIMITS.packet]),
    depth=st.sampled_from([0, 1, 2, 16, 100]),
    variants=st.sampled_from([0, 1, 5, 50_000]),
    vt_error_size=st.sampled_from([2, 4]),
)


class Number(IntEnum):
    ONE = 1


class Word(StrEnum):
    ONE = "one"


class Real(float):
    pass


class Texts(list):
    pass


class Strange:
    """An object that only the code in Python can convert."""

    def __index__(self) -> int:
        return 7

    def __float__(self) -> float:
        return 7.0


def plain_values() -> st.SearchStrategy[object]:
    """Return a strategy for values that programs may pass, also unusual and invalid ones."""
    scalars = st.one_of(
        st.none(), st.booleans(), st.integers(-(2**31), 2**31 - 1), st.integers(), st.floats(), strings(),
        st.binary(max_size=20), st.binary(max_size=4).map(bytearray), st.datetimes(), st.decimals(places=4),
        st.sampled_from([
            Number.ONE, Word.ONE, Real(1.5), Texts(["a"]), Strange(), object(), 1j, memoryview(b"ab"), {1: 2}, {1},
            datetime(2026, 1, 1, tzinfo=UTC), Decimal("1e400"), Decimal("NaN"), 10**400, "x" * 5000, b"x" * 17_000,
            [0.5] * 65, [0.5] * 3000, range(3), bool, "\ud800", inf, nan,
        ]),
        variants(),
    )  # fmt: skip
    same_type = st.one_of(
        *(st.lists(each, max_size=5) for each in (st.floats(), st.integers(), st.booleans(), strings(), st.none()))
    )
    return st.recursive(
        st.one_of(scalars, same_type),
        lambda inner: st.one_of(st.lists(inner, max_size=4), st.lists(inner, max_size=4).map(tuple)),
        max_leaves=12,
    )


# --- to bytes ---------------------------------------------------------------------------------------------------------


@given(plain_values())
def test_any_value_is_encoded_alike(value):
    expected = outcome(lambda: PURE["encode_variant"](variant(value)))  # in Python only
    assert alike(outcome(codec.encode, value), expected)
    check_same_outcome("encode", codec.encode, value)


@given(plain_values())
def test_any_value_is_encoded_alike_as_an_argument_of_one_type(value):
    for name in ("encode_integer", "encode_single", "encode_string"):
        check_same_outcome(name, getattr(codec, name), value)


@given(variants(), st.sampled_from([2, 4]))
def test_any_variant_is_encoded_alike(item, vt_error_size):
    check_same_outcome("encode_variant", codec.encode_variant, item, vt_error_size)


@given(
    st.sampled_from([*map(int, VarType), *(int(vt) | ARRAY for vt in VarType), 9, 99, -1, 2**16, 2**70]),
    plain_values(),
    st.sampled_from([0, 2, 3, 4, 2**70, None]),
)
def test_a_variant_whose_value_does_not_fit_its_type_is_encoded_alike(vt, value, vt_error_size):
    item = trusted(vt, value)
    inside = trusted(VARIANT_ARRAY, [trusted(VarType.EMPTY, None), item])
    for each in (item, inside, trusted(VarType.VARIANT, item)):
        check_same_outcome("encode_variant", codec.encode_variant, each, vt_error_size)


def test_arguments_of_encode_variant():
    item = Variant(VarType.I4, 1)
    check_same_outcome("encode_variant", codec.encode_variant, item, vt_error_size=2)
    check_same_outcome("encode_variant", codec.encode_variant, item=item)
    for arguments in ((), (item, 4, 4), (1,), (None,)):
        assert outcome(codec.encode_variant, *arguments)[0] is outcome(PURE["encode_variant"], *arguments)[0]


@pytest.mark.parametrize("depth", [1, 31, 32, 33, 34, 100, 100_000])
def test_nesting(depth):
    value: object = 1
    item = Variant(VarType.I4, 1)
    for _ in range(depth):
        value, item = [value], trusted(VARIANT_ARRAY, [item])
    check_same_outcome("encode", codec.encode, value)
    check_same_outcome("encode_variant", codec.encode_variant, item)
    while isinstance(value, list):  # released step by step: some versions of Python cannot free such a deep chain
        (value,), (item,) = value, item.value


def test_a_list_in_itself():
    value: list[object] = []
    value.append(value)
    check_same_outcome("encode", codec.encode, value)


def test_a_list_that_becomes_shorter_while_it_is_encoded():
    """A conversion in Python may change the list that is being encoded."""
    items: list[Decimal] = []

    class Amount(Decimal):
        def scaleb(self, *arguments):
            items.clear()
            return super().scaleb(*arguments)

    items += [Amount(2)] * 100
    assert codec.encode_variant(trusted(VarType.CY | ARRAY, items)) == codec.encode(Variant(VarType.CY | ARRAY, []))


@pytest.mark.parametrize("size", [1, 100, 511, 512, 2046, 2047, 2048, 4095, 4096, 8190, 8192, 16_374, 16_384, 20_000])
def test_sizes_around_the_limits(size):
    for value in (
        [0.5] * size, [1] * size, [True] * size, ["a"] * size, [None] * size, "a" * size, "あ" * size,
        "\U0001f916" * size, bytes(size), [1, "a"] * size, [bytes(size), 1],
    ):  # fmt: skip
        check_same_outcome("encode", codec.encode, value)
        data = codec.encode(value)
        check_same_outcome("decode", codec.decode, data)
        check_same_outcome("decode", codec.decode, data, exact=True)


# --- from bytes -------------------------------------------------------------------------------------------------------


def check_decoded_alike(data: bytes, *arguments: object, left: int | None = None, **named: object) -> None:
    budgets = [None if left is None else [left] for _ in range(2)]
    results = [
        outcome(function, data, *arguments, budget=budget, **named)
        for function, budget in zip((codec.decode, PURE["decode"]), budgets, strict=True)
    ]
    assert alike(*results), f"{data[:200].hex()} {arguments} {named} {left}: {results}"
    assert budgets[0] == budgets[1]


BUDGETS = st.none() | st.integers(-1, 20) | st.just(50_000)


@given(st.binary(max_size=80), LIMITS, st.booleans(), BUDGETS)
def test_any_bytes_are_decoded_alike(data, limits, exact, left):
    check_decoded_alike(data, 0, None, limits, exact=exact, left=left)


@given(variants(), LIMITS, st.booleans(), BUDGETS)
def test_any_variant_is_decoded_alike(item, limits, exact, left):
    data = PURE["encode_variant"](item, 4)
    check_decoded_alike(data, 0, None, limits, exact=exact, left=left)


def argument(vt: int, count: int, content: bytes) -> bytes:
    return struct.pack("<IHI", 6 + len(content), vt, count) + content


@given(
    st.sampled_from([*map(int, VarType), *(int(vt) | ARRAY for vt in VarType), 9, 22, 0x3FFF, 0x4003, 0xFFFF]),
    st.integers(0, 5) | st.integers(0, 2**32 - 1),
    st.binary(max_size=60),
    LIMITS,
    st.booleans(),
    BUDGETS,
)
def test_any_type_count_and_content_are_decoded_alike(vt, count, content, limits, exact, left):
    check_decoded_alike(argument(vt, count, content), 0, None, limits, exact=exact, left=left)
    inside = argument(VARIANT_ARRAY, 2, struct.pack("<HIHI", 0, 1, vt, count) + content)
    check_decoded_alike(inside, 0, None, limits, exact=exact, left=left)


@given(variants(), st.data(), LIMITS, st.booleans())
def test_a_damaged_argument_is_decoded_alike(item, data, limits, exact):
    damaged = bytearray(PURE["encode_variant"](item, 4))
    for _ in range(data.draw(st.integers(1, 3))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    keep = data.draw(st.integers(0, len(damaged)))
    for each in (bytes(damaged), bytes(damaged[:keep])):
        check_decoded_alike(each, 0, None, limits, exact=exact)


@given(variants(), st.integers(-3, 12), st.integers(-3, 5) | st.none(), st.binary(max_size=12), st.binary(max_size=5))
def test_any_position_and_end_are_treated_alike(item, shift, cut, before, behind):
    data = before + PURE["encode_variant"](item, 4) + behind
    end = None if cut is None else len(data) - cut
    check_decoded_alike(data, shift, end)
    check_decoded_alike(data, len(before), end)


def test_arguments_of_decode():
    data = codec.encode([1.0, "a"])
    check_same_outcome("decode", codec.decode, data=data, position=0, end=len(data), limits=DEFAULT_LIMITS, exact=True)
    for unusual in (bytearray(data), memoryview(data)):
        check_same_outcome("decode", codec.decode, unusual)
    check_same_outcome("decode", codec.decode, data, True)
    check_same_outcome("decode", codec.decode, data, exact=1)
    for budget in ([], [1, 2], (3,), [1.5], [None], [2**70]):
        check_same_outcome("decode", codec.decode, data, budget=budget)
    for arguments, named in (((), {}), ((data, 0), {"position": 0}), ((data,), {"depth": 1}), ((data, 0, 1, 2, 3), {})):
        assert outcome(codec.decode, *arguments, **named)[0] is TypeError
    for position, end in ((2**70, None), (0, 2**70), (-(2**70), None), (0, -1)):
        check_same_outcome("decode", codec.decode, data, position, end)
    check_same_outcome("decode", codec.decode, data, limits=PacketLimits(depth=2**70))
    check_same_outcome("decode", codec.decode, data, limits=PacketLimits(vt_error_size=3))
    for least in (-(2**63), -(2**62), -(2**60)):
        check_same_outcome("decode", codec.decode, data, limits=PacketLimits(variants=least))


@pytest.mark.parametrize("depth", [1, 15, 16, 17, 31, 32, 33, 40, 900, 100_000])
def test_nested_arrays_are_decoded_alike(depth):
    data = b"\0\0\1\0\0\0"
    head = struct.pack("<HI", VARIANT_ARRAY, 1)
    data = struct.pack("<I", 6 * (depth + 1)) + head * depth + data
    for limits in (DEFAULT_LIMITS, PacketLimits(depth=50), PacketLimits(depth=100)):
        check_decoded_alike(data, 0, None, limits)
        check_decoded_alike(data, 0, None, limits, exact=True)


@pytest.mark.parametrize("vt", [VarType.R8, VarType.BSTR, VarType.VARIANT, VarType.CY, VarType.DATE, VarType.UI1])
def test_a_count_without_the_bytes_allocates_nothing(vt):
    """An array of 2**32 elements is refused before it is allocated, in a packet of a few bytes."""
    check_decoded_alike(argument(vt | ARRAY, 2**32 - 1, bytes(40)), 0, None, PacketLimits(variants=2**40))


@pytest.mark.parametrize("exact", [False, True])
def test_python_code_that_runs_meanwhile_sees_no_incomplete_list(exact):
    """The conversion of a date is Python code; it would crash if it read an element that is not yet present."""
    dates = Variant(VarType.DATE | ARRAY, [0.5] * 77)
    data = codec.encode(Variant(VARIANT_ARRAY, [dates] + [Variant(VarType.DATE, 1.5)] * 76))
    seen: list[int] = []

    def lists() -> int:
        return sum(type(each) is list and len(each) == 77 and each is not seen for each in gc.get_objects())

    def profile(frame, event, argument):
        if event == "call" and frame.f_code is conversions.to_datetime.__code__:
            seen.append(lists() - before)

    before = lists()
    sys.setprofile(profile)
    try:
        value, _ = codec.decode(data, exact=exact)
    finally:
        sys.setprofile(None)
    assert seen == [0] * 77 + [1] * 76  # the inner list after it is complete, the outer one never
    assert gc.is_tracked(value.value if exact else value)


# --- references -------------------------------------------------------------------------------------------------------

SAMPLE = [
    None, True, 5, -0.5, "P1", "あ\U0001f916\ud800", b"abc", [1.0, 2.0], [1, 2], ["a", "b"], [True], [], [None, [1.5, "x"]],
    Variant(VarType.CY | ARRAY, [1, 2]), Variant(VarType.DATE, datetime(2026, 1, 1)), Variant(VarType.UI8, 2**64 - 1),
    Variant(VARIANT_ARRAY, [Variant(VarType.R4 | ARRAY, [1.0]), Variant(VarType.ERROR, 5)]), 2**40, object(), [2**40, 1],
]  # fmt: skip


def use_everything() -> None:
    for value in SAMPLE:
        outcome(codec.encode, value)
        outcome(codec.encode_integer, value)
        outcome(codec.encode_string, value)
        outcome(codec.encode_single, value)
        outcome(codec.encode_variant, value)
    for value in SAMPLE[:-3]:
        data = codec.encode(value)
        for exact in (False, True):
            codec.decode(data, exact=exact, budget=[100])
            outcome(codec.decode, data[:-1], exact=exact)
            outcome(codec.decode, data, exact=exact, limits=PacketLimits(variants=0, depth=1))


def check_no_growth(rounds: int) -> None:
    use_everything()
    gc.collect()
    watched = [None, True, False, Variant, PacketLimits, DEFAULT_LIMITS, *SAMPLE]
    blocks, references = sys.getallocatedblocks(), list(map(sys.getrefcount, watched))
    for _ in range(rounds):
        use_everything()
    gc.collect()
    assert sys.getallocatedblocks() - blocks < 200 + rounds / 100
    grown = [after - before for before, after in zip(references, map(sys.getrefcount, watched), strict=True)]
    assert max(grown) < 20 + rounds / 10, grown  # pytest's assert above refers to None a few times


def test_no_reference_is_leaked():
    check_no_growth(500)


@pytest.mark.soak
def test_no_reference_is_leaked_in_a_million_calls():
    resource = pytest.importorskip("resource")
    check_no_growth(100)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    check_no_growth(6000)  # 170 calls each
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # KiB


@pytest.mark.soak
@settings(max_examples=20_000)
@given(st.binary(max_size=300), LIMITS, st.booleans(), BUDGETS)
def test_any_bytes_are_decoded_alike_for_long(data, limits, exact, left):
    check_decoded_alike(data, 0, None, limits, exact=exact, left=left)


@pytest.mark.soak
@settings(max_examples=5_000)
@given(variants(), st.data(), LIMITS, st.booleans())
def test_a_damaged_argument_is_decoded_alike_for_long(item, data, limits, exact):
    damaged = bytearray(PURE["encode_variant"](item, 4))
    for _ in range(data.draw(st.integers(1, 5))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    check_decoded_alike(bytes(damaged), 0, None, limits, exact=exact)


@pytest.mark.soak
@settings(max_examples=5_000)
@given(plain_values())
def test_any_value_is_encoded_alike_for_long(value):
    check_same_outcome("encode", codec.encode, value)
