"""e-CAP bodies: encoding and decoding are inverse; arbitrary input raises only the documented exceptions."""

from __future__ import annotations

import struct
from unicodedata import category

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orinkit.cao.arguments import read_arguments
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.core.errors import CallError, ProtocolError
from orinkit.ecap.fields import read_fields
from orinkit.ecap.message import explain_reply, explain_request, read_reply, read_request, write_reply, write_request
from orinkit.values.codec import PacketLimits, encode_variant
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, variant
from support.ecap_bodies import BAD_BODIES, BODIES
from support.strategies import CONTENTS, same, strings, variants

pytestmark = pytest.mark.core

SINGLES = st.floats(width=32, allow_nan=False, allow_infinity=False)
OF_TYPE = {
    VarType.I4: st.integers(-(2**31), 2**31 - 1),
    VarType.R4: SINGLES,
    VarType.BSTR: strings(),
    VarType.VARIANT: variants(),
}
CODES = {hresult.E_INVALIDARG, hresult.E_NOTIMPL}


def single(value):
    """Round to single precision: an R4 is written with the digits that distinguish it from its neighbours."""
    return struct.pack("<f", value) if isinstance(value, float) else value


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=lambda function: function.name)
@given(data=st.data())
@settings(max_examples=15)
def test_any_call_arrives_unchanged(function, data):
    count = data.draw(st.integers(function.required, len(function.arguments)))
    arguments = tuple(data.draw(OF_TYPE[argument.vt]) for argument in function.arguments[:count])
    bound = function.bind(arguments, {})
    request = read_request(write_request(function, bound))
    assert request.function is function
    values = read_arguments(function, request.arguments)
    wanted = [*bound, *("" for _ in function.arguments[len(bound) :])]
    for argument, value, sent in zip(function.arguments, values, wanted, strict=True):
        if argument.vt is VarType.VARIANT:
            assert same(value, variant(sent))
        else:
            assert single(value) == single(sent)


@given(code=st.integers(0, 2**31 - 1), result=st.none() | variants())
@settings(max_examples=500)
def test_any_result_arrives_unchanged(code, result):
    answered, read = read_reply(write_reply(code, result))
    assert answered == code
    if result is None or result.type == VarType.EMPTY:
        assert read is None
    else:
        assert read is not None
        assert same(read, result)
        assert encode_variant(read) == encode_variant(one_nan(result))


def one_nan(item: Variant) -> Variant:
    """Replace NaNs with the only NaN that is received."""
    if item.type == VARIANT_ARRAY:
        return Variant(item.type, [one_nan(each) for each in item.value])
    values = item.value if item.type & ARRAY else [item.value]
    values = [float("nan") if isinstance(value, float) and value != value else value for value in values]
    return Variant(item.type, values if item.type & ARRAY else values[0])


@pytest.mark.parametrize("vt", list(CONTENTS), ids=lambda vt: vt.name)
@given(data=st.data())
@settings(max_examples=50)
def test_each_type_arrives_bit_by_bit(vt, data):
    values = data.draw(st.lists(CONTENTS[vt], min_size=1, max_size=5))
    for item in (Variant(vt, values[0]), Variant(vt | ARRAY, values), Variant(VARIANT_ARRAY, [Variant(vt, values[0])])):
        _, read = read_reply(write_reply(0, item))
        assert read is not None
        assert encode_variant(read) == encode_variant(one_nan(item))


@given(strings(), strings())
def test_splitting_and_decoding_reverse_the_encoding(one, other):
    fields = read_fields(write_request(FUNCTIONS[9], (2, one, other)))
    assert {name: field.text for name, field in fields.items()} == {
        "func": "9", "arg1": "2", "arg2": one, "arg3": other, "arg4": "", "arg5": "",
    }  # fmt: skip


SMALL = PacketLimits(packet=400, variants=20)


def refused(kind, read, body, limits):
    try:
        read(body, limits)
    except kind as error:
        return error
    return None


def is_harmless(text: str) -> bool:
    """Return True if a terminal shows the text in one line, unchanged."""
    return all(sign.isprintable() or category(sign) == "Zs" or sign in "\u200c\u200d" for sign in text)


def harmless(body: bytes) -> None:
    for limits in (PacketLimits(), SMALL):
        refusal = refused(CallError, read_request, body, limits)
        assert refusal is None or (refusal.code in CODES and 0 < len(refusal.detail) < 500)
        refusal = refused(ProtocolError, read_reply, body, limits)
        assert refusal is None or 0 < len(str(refusal)) < 500
    assert is_harmless(explain_request(body))
    assert is_harmless(explain_reply(body))


@given(
    st.binary(max_size=60),
    st.sampled_from(
        [b"", b"Func=", b"Func=102,Arg1=3,Arg2=", b"Func=9,Arg1=", b"Func=68&Arg1=1&Arg2=", b"0x00000000,", b"0,"]
    ),
)
@settings(max_examples=500)
def test_any_body_is_explained(data, start):
    harmless(start + data)


@given(
    st.sampled_from([b"", b"Func=", b"Func=102,Arg1=3,Arg2=", b"0x00000000,"]),
    st.text('0123456789,()"& %+=x-.eEFuncArg\n', max_size=80),
)
@settings(max_examples=500)
def test_any_body_of_significant_characters_is_explained(start, text):
    harmless(start + text.encode())


@st.composite
def mutated(draw):
    """A body with some bytes changed, deleted, duplicated or inserted."""
    replies = [
        b"0x00000000,8204,(8,Sample),(2,100)",
        b"0x00000000,8194,100,200,300",
        b"0x80070006",
        b"-2147024890",
        b"\n\n0,8,a",
    ]
    data = bytearray(draw(st.sampled_from([*(each.body for each in (*BODIES, *BAD_BODIES)), *replies])))
    for _ in range(draw(st.integers(1, 4))):
        position = draw(st.integers(0, max(len(data) - 1, 0)))
        match draw(st.sampled_from(["set", "flip", "cut", "insert", "double"])):
            case "set":
                data[position : position + 1] = bytes([draw(st.sampled_from(b'\0%&+,=()"0128xF \n\x80\xff'))])
            case "flip":
                data[position : position + 1] = bytes([(data[position] if data else 0) ^ 1 << draw(st.integers(0, 7))])
            case "cut":
                del data[position : position + draw(st.integers(1, 8))]
            case "insert":
                data[position:position] = draw(st.binary(max_size=8))
            case "double":
                data += data[position:]
    return bytes(data)


@given(mutated())
@settings(max_examples=1000)
def test_corrupted_bodies_are_explained(body):
    harmless(body)
