"""The longest texts and bodies are parsed in one pass; quadratic code would take hours."""

from __future__ import annotations

import time
from contextlib import suppress

import pytest

from orinkit.core.errors import CallError, NotationError, ProtocolError
from orinkit.ecap.message import explain_request, read_reply, read_request
from orinkit.values.notation import parse, parse_elements, parse_lenient

MIB = 1 << 20
PUT = b"Func=102,Arg1=3,Arg2="  # Variable_PutValue


@pytest.mark.parametrize(
    "piece", ["(", ")", "()", '"', '""', ",", "(8,", "(8,(", "(8,)", "(3,1),", "8204,(", "(8200,\"", "9", "0x", " ", "1e", "1 "]
)  # fmt: skip
@pytest.mark.parametrize("start", ["", "3,", "5,", "6,", "7,", "8200,", "8204,", "8204,(8,", "8204,(8200,", "8197,"])
def test_long_repetitions_are_read_in_one_pass(start, piece):
    # Exceeds the test time-out if the code is quadratic.
    text = start + piece * (200_000 // len(piece))
    for read in (parse, parse_elements, parse_lenient):
        try:
            read(text)
        except NotationError as error:
            assert len(str(error)) < 250  # noqa: PT017 - not every case raises


@pytest.mark.parametrize(
    ("start", "unit"),
    [
        (b"", b"&"),
        (b"Func=9", b"="),
        (b"Func=9,Arg1=2,Arg2=", b","),
        (b"Func=9,Arg1=2,Arg2=", b",arg1"),
        (b"Func=9,Arg1=2,Arg2=,", b" "),
        (b"Func=9,Arg1=2,Arg2=", b"%41"),
        (b"Func=", b"9"),
        (b"Func=9", b"%2C"),
        (b"Func%3D9", b"%2C"),
        (b"Func=20,Arg1=", b"1"),
        (PUT + b"8200", b","),
        (PUT + b"8204,", b"(0),"),
        (PUT + b"8204,", b"("),
        (b"", b"\n"),
    ],
)
def test_the_longest_bodies_are_parsed_quickly(start, unit):
    """Each takes a second or less on the development machine; quadratic code would take hours."""
    body = start + unit * (4 * MIB // len(unit))
    began = time.process_time()
    with suppress(CallError):
        read_request(body)
    assert len(explain_request(body)) < 1000
    with pytest.raises(ProtocolError):
        read_reply(body)
    assert time.process_time() - began < 20.0
