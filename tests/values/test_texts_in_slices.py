"""Long texts and arrays are read, searched and written in slices, with the same result as in one piece."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import FrameType

import pytest

from orinkit.cao.arguments import read_arguments
from orinkit.cao.coerce import to_integer
from orinkit.cao.functions import controller_get_variable
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.ecap import fields
from orinkit.ecap.fields import read_fields
from orinkit.ecap.message import read_request, write_reply
from orinkit.values.codec import decode, encode_variant
from orinkit.values.notation import format_variant, parse
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.watching import allowed

pytestmark = pytest.mark.core

TEXTS = [
    "a" * 20_000,
    "あ" * 20_000,
    "🤖" * 20_000,
    "x" + "🤖" * 20_000,
    "\ud800" * 20_000,
    "a\udc00" * 10_000,
    "🤖\ud800" * 10_000,
    "\udc00🤖" * 10_000,
]
IDS = [ascii(text[:2]) for text in TEXTS]


@pytest.mark.parametrize("text", TEXTS, ids=IDS)
def test_long_texts_as_bytes(text):
    assert decode(encode_variant(variant(text)), exact=True) == (variant(text), len(encode_variant(variant(text))))


@pytest.mark.parametrize("vt", [VarType.I2, VarType.R8, VarType.UI4, VarType.BOOL, VarType.CY])
def test_long_arrays_as_bytes(vt):
    given = Variant(vt | ARRAY, [number % 2 for number in range(10_001)])
    assert decode(encode_variant(given), exact=True)[0] == given


@pytest.mark.parametrize("text", TEXTS, ids=IDS)
def test_long_texts_in_an_e_cap_body(text):
    raw = text.encode("utf-8", "surrogatepass")
    escaped = "".join(f"%{byte:02x}" for byte in raw).encode()
    for body, expected in ((raw, text), (escaped, text), (b"+" + escaped, "+" + text)):
        assert read_fields(b"Func=102,Arg1=5,Arg2=" + body)["arg2"].text == expected
    assert read_fields(b"Func=102&Arg1=5&Arg2=+" + escaped)["arg2"].text == " " + text
    assert write_reply(0, variant(text)).decode("utf-8", "surrogatepass") == f"0x00000000,8,{text}"


def longest_call_into_c(function: Callable[[], object]) -> float:
    """Return the CPU time in s of the longest call into C: no other thread runs meanwhile, not even the event loop."""
    longest, began = 0.0, 0.0

    def look(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal longest, began
        now = time.thread_time()
        if event in ("c_return", "c_exception") and began:
            longest = max(longest, now - began)
        began = now if event == "c_call" else 0.0  # 0 if C has called back, as a join of a generator does

    sys.setprofile(look)
    try:
        function()
    finally:
        sys.setprofile(None)
    return longest


def test_no_call_into_c_is_long():
    """Otherwise decoding a packet in the worker would stop the event loop, too."""
    text = "\ud800" * 2_000_000
    item = variant(text)
    data = encode_variant(item)
    body = b"Func=102,Arg1=5,Arg2=" + text.encode("utf-8", "surrogatepass")
    for function in (
        lambda: decode(data, exact=True),
        lambda: encode_variant(item),
        lambda: read_fields(body),
        lambda: write_reply(0, item),
    ):
        assert longest_call_into_c(function) < allowed(5.0)


def test_no_search_of_a_long_body_is_long():
    body = b"Func=102,Arg2=" + b"," * 8_000_000
    assert longest_call_into_c(lambda: read_fields(body)) < allowed(5.0)


def test_a_body_of_separators_is_not_split_completely(monkeypatch):
    searches = []
    search = fields._search
    monkeypatch.setattr(fields, "_search", lambda *given: searches.append(1) or search(*given))
    for body in (b"&" * 100_000, b"Func=102" + b",arg1=" * 100_000):
        with pytest.raises(CallError, match="more than 32 fields"):
            read_fields(body)
    assert len(searches) < 100


def test_bytes_that_are_no_utf_8_far_behind():
    with pytest.raises(CallError, match="Arg2 is not UTF-8: bytes ff at 30000"):
        read_fields(b"Func=102,Arg2=" + b"a" * 30_000 + b"\xff")
    with pytest.raises(CallError, match="is not UTF-8"):
        read_fields(b"Func=102,Arg2=" + b"\x80" * 30_000)


def test_a_separator_and_a_percent_sign_far_behind():
    fields = read_fields(b"Func=102,Arg2=" + b"," * 100_000 + b" , Arg1 = 5")
    assert (fields["arg1"].text, len(fields["arg2"].text)) == (" 5", 100_001)
    assert read_fields(b"Func=102,Arg2=" + b"%41%%" * 30_000 + b"%zz")["arg2"].text == "A%%" * 30_000 + "%zz"


@pytest.mark.parametrize(
    "value",
    [
        ['"' * 9001], ["()" * 9000, " "], [" " * 9001, "a"], ["a" + " " * 9001], ["a,b" * 5000], ["(" * 5000], [""],
        ["x" * 70_000, "y"], list(map(str, range(20_000))),
    ],
    ids=range(9),
)  # fmt: skip
def test_long_strings_as_text(value):
    given = Variant(VarType.BSTR | ARRAY, value)
    assert parse(format_variant(given)) == given
    nested = variant([[text] for text in value[:100]])
    assert parse(format_variant(nested)) == nested


def test_long_arrays_of_numbers_as_text():
    text = "8197," + ",".join(["1.5"] * 50_000)
    assert parse(text).value == [1.5] * 50_000
    assert parse("8197,1," + " " * 5000 + "2").value == [1.0, 2.0]
    assert parse("8200,a" + " " * 9001).value == ["a"]
    for wrong in ("8197," + " " * 70_000 + "x", "3," + "1" * 70_000, "8197,1," + "1" * 70_000 + ",2"):
        with pytest.raises(ValueError, match="column"):
            parse(wrong)


def test_blanks_and_dates_before_a_type_cost_as_much_as_slow_types():
    body = b"Func=102,Arg1=5,Arg2=8204,(" + b" " * 100 + b"8199" + b",1" * 60_000 + b")"
    with pytest.raises(CallError):
        read_request(body)


def test_a_number_that_is_too_long():
    with pytest.raises(CallError, match="a number, not"):
        to_integer(variant("9" * 5000))
    with pytest.raises(CallError, match="a number, not"):
        to_integer(variant("9" * 4350))  # more digits than Python converts


def test_names_and_options_have_a_maximum_length():
    handle, name = variant(2), variant("x" * 1024)
    assert read_arguments(controller_get_variable, [handle, name, variant("y" * 4096)])[1] == "x" * 1024
    for arguments in ([handle, variant("x" * 1025), variant("")], [handle, name, variant("y" * 4097)]):
        with pytest.raises(CallError, match="characters exceeds the limit of") as caught:
            read_arguments(controller_get_variable, arguments)
        assert caught.value.code == hresult.E_INVALIDARG
    i18n.use("ja")
    with pytest.raises(CallError, match="上限 1024 文字"):
        read_arguments(controller_get_variable, [handle, variant("x" * 1025)])
