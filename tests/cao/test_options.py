"""Option strings: from the documents, from real clients, and arbitrary text."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.cao.options import Options
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError

pytestmark = pytest.mark.core


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("", {}),
        ("WDT=400", {"wdt": "400"}),
        (",WDT=400,InvokeTimeout=180000", {"wdt": "400", "invoketimeout": "180000"}),
        (" WDT = 400 , InvokeTimeout = 180000 ,", {"wdt": "400", "invoketimeout": "180000"}),
        ("@IfNotMember", {"@ifnotmember": "True"}),
        ("Server=192.168.0.1,@IfNotMember=True", {"server": "192.168.0.1", "@ifnotmember": "True"}),
        ("Conn=eth:192.168.0.1", {"conn": "eth:192.168.0.1"}),
        ("a=1=2", {"a": "1=2"}),
        ("a=", {"a": ""}),
        ("=1,,,", {}),
        ("a=(1,2),b=[3,4],c={5,6},d=<7,8>", {"a": "(1,2)", "b": "[3,4]", "c": "{5,6}", "d": "<7,8>"}),
        ("a=(1,[2,3]),b", {"a": "(1,[2,3])", "b": "True"}),
        ("a='x,y',b=\"z,'w\"", {"a": "x,y", "b": "z,'w"}),
        ('a="(",b=1', {"a": "(", "b": "1"}),
        ("a='", {"a": "'"}),
        ("a=''", {"a": ""}),
        ("a='x\"", {"a": "'x\""}),
        ("a=(1,2", {"a": "(1,2"}),
        ("a=),b=1", {"a": ")", "b": "1"}),
        ("a=1,A=2", {"a": "2"}),
        ("SPEED=50,NEXT", {"speed": "50", "next": "True"}),
    ],
)
def test_pairs(text, values):
    options = Options(text)
    assert options.text == text
    assert options._values == values


def test_names_are_case_insensitive():
    options = Options("WDT=400")
    assert "wdt" in options
    assert "WDT" in options
    assert "x" not in options
    assert options.text_of("Wdt") == "400"
    assert options.text_of("x") == ""
    assert options.text_of("x", "y") == "y"
    assert options.number("wDt") == 400


@pytest.mark.parametrize(
    ("text", "on"),
    [
        ("@IfNotMember", True), ("@ifnotmember=TRUE", True), ("@IfNotMember=1", True), ("@IfNotMember=-1", True),
        ("@IfNotMember=on", True), ("@IfNotMember=yes", True), ("@IfNotMember=False", False), ("@IfNotMember=0", False),
        ("@IfNotMember=", False), ("@IfNotMember=2", False), ("", False), ("x", False),
    ],
)  # fmt: skip
def test_flags(text, on):
    assert Options(text).flag("@IfNotMember") is on


@pytest.mark.parametrize(
    ("text", "number"), [("n=5", 5), ("n=-5", -5), ("n= 0x190 ", 400), ("n='7'", 7), ("m=5", None)]
)
def test_whole_numbers(text, number):
    assert Options(text).number("n") == number


@pytest.mark.parametrize("text", ["n", "n=", "n=x", "n=1.5", "n=1e3", "n=" + "9" * 4090 + "x"])
def test_invalid_whole_numbers(text):
    with pytest.raises(ValueError):
        Options(text).number("n")


def test_the_longest_text():
    """A client may send 16 MB of text: it is not parsed character by character."""
    longest = "x" * 4096
    assert Options(longest).flag(longest)
    assert Options("a=" + "(" * 4094).text_of("a") == "(" * 4094
    for text in (longest + "x", "a," * 4_000_000):
        with pytest.raises(
            CallError, match=f"option string of {len(text)} characters exceeds the limit of 4096"
        ) as caught:
            Options(text)
        assert caught.value.code == hresult.E_INVALIDARG
    i18n.use("ja")
    with pytest.raises(CallError, match="上限 4096 文字"):
        Options(longest + "x")


@given(st.text(st.sampled_from("aB=,()[]<>'\" 1"), max_size=40) | st.text())
def test_any_text_is_parsed(text):
    options = Options(text)
    for name in options.names:
        assert name in options
        assert name == name.strip().lower()
        assert name


@given(st.dictionaries(st.text("abc", min_size=1), st.text("123xyz"), max_size=5))
def test_formatted_pairs_are_parsed(pairs):
    text = ",".join(f"{name}={value}" for name, value in pairs.items())
    options = Options(text)
    assert {name: options.text_of(name) for name in options.names} == pairs
