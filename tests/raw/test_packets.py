"""Packets typed in hex."""

from __future__ import annotations

import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM
from orinkit.cao import functions as f
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.raw.hex_text import hex_text
from orinkit.raw.packets import (
    MOST_PROBLEMS,
    ProblemKind,
    assemble,
    assemble_reply,
    assemble_request,
    parse_packets,
    with_crc,
)
from orinkit.values.variant import Variant, VarType
from support import paths

START = "01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04"
PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
PROFILES = {"tcp": STREAM, "udp": DATAGRAM, "com": LINE}


def kinds(text, profile=STREAM, kind="request"):
    """Return the kinds of the problems, each with its text."""
    return [(each.kind.name, text[each.start : each.end]) for each in parse_packets(text, profile, kind).problems]


@pytest.mark.parametrize(
    "text",
    [
        START,
        START.replace(" ", ""),
        START.lower().replace(" ", ", 0x").replace("01", "0x01", 1),
        "\n\n  " + START.replace(" ", "\n", 8) + "  \r\n \r\n",
        "{0x1, 0x10, 0x0, 00, 00 01 00 00 00 01 00 00 00 00 00 04}",
        "\\x01\\x10&h00 &H00 [00] '01' \"00\"; 00:00 01 00 00 00 00 00 04",
    ],
)
def test_any_notation(text):
    found = parse_packets(text)
    assert [each.data for each in found.packets] == [bytes.fromhex(START)]
    assert found.problems == []
    assert found.can_be_sent


def test_blank_lines_separate_packets():
    text = f"\r\n{START}\r\n\r\n \t\r\n{START}\n{START}"
    found = parse_packets(text)
    assert [len(each.data) for each in found.packets] == [16, 32]
    assert [text[each.start : each.end] for each in found.packets] == [START, f"{START}\n{START}"]
    assert [each.packet for each in found.problems] == [1]  # two packets in one: the length does not match


@pytest.mark.parametrize(
    ("text", "problems"),
    [
        (START.replace("01", "02", 1), [("SOH", "02")]),
        (START.replace("10", "11", 1), [("LENGTH", "11 00 00 00")]),
        (START[:-2] + "03", [("EOT", "03")]),
        (START.replace("01 00 00 00 00 00 04", "FE 00 00 00 00 00 04"), [("FUNCTION", "FE 00 00 00")]),
        ("01 02 03", [("TOO_SHORT", "01 02 03")]),
        ("02 02 03 04 05 06", [("SOH", "02"), ("LENGTH", "02 03 04 05"), ("TOO_SHORT", "02 02 03 04 05 06")]),
        ("01 1z 00", [("NOT_HEX", "1z")]),
        ("01 100 0g", [("ODD_DIGITS", "100"), ("NOT_HEX", "0g")]),
        ("0", [("ODD_DIGITS", "0")]),
        ("é", [("NOT_HEX", "é")]),
        ("٣٤", [("NOT_HEX", "٣٤")]),
        ("01,,10;1", [("ODD_DIGITS", "1")]),
    ],
)
def test_problems_and_their_positions(text, problems):
    assert kinds(text) == problems


def test_problems_of_arguments():
    data = bytearray(assemble("Variable_GetValue", ["3"]))
    data[13:15] = b"\x02\x00"
    ((name, _),) = kinds(hex_text(bytes(data)))
    assert name == "ARGUMENTS"


def test_a_malformed_packet_can_be_sent_and_other_text_cannot():
    assert parse_packets("01 02").sendable() == [b"\x01\x02"]
    for text in ("", " \n\n", "xy", f"{START}\n\n01 2", "1"):
        assert not parse_packets(text).can_be_sent
        with pytest.raises(InvalidValue):
            parse_packets(text).sendable()
    with pytest.raises(InvalidValue, match="packet 2: '2' has an odd number"):
        parse_packets(f"{START}\n\n01 2").sendable()


def test_the_crc_of_a_serial_line():
    data = with_crc(bytes.fromhex(START))
    assert packet.decode(data, crc=True).code == 1
    assert kinds(data.hex(" "), LINE) == []
    wrong = data[:-3] + bytes([data[-3] ^ 1]) + data[-2:]
    assert kinds(wrong.hex(" "), LINE) == [("CRC", wrong[-3:-1].hex(" "))]
    assert data[-3:-1].hex(" ") in parse_packets(wrong.hex(" "), LINE).problems[0].text  # the correct value
    assert kinds(START, LINE) == [("TOO_SHORT", START)]


def test_the_limit_of_a_datagram():
    long = assemble("Controller_Execute", ["1", "Do", "8," + "x" * 400])
    assert kinds(long.hex(" "), STREAM) == []
    assert [name for name, _ in kinds(long.hex(" "), DATAGRAM)] == ["LENGTH"]


def test_a_reply_has_no_function():
    reply = packet.encode(packet.Packet(7, 0x80004001))
    assert kinds(reply.hex(), kind="reply") == []
    assert [name for name, _ in kinds(reply.hex())] == ["FUNCTION"]


@pytest.mark.parametrize("entry", PRINTED, ids=lambda entry: f"{entry['document']}:{entry['line']}")
def test_printed_packets(entry):
    """The packets of the documents are valid as intended, and what is misprinted is found."""
    profile = PROFILES[entry["transport"]]
    kind = entry["kind"]
    text = hex_text(bytes.fromhex(entry["hex"]))
    assert kinds(text, profile, kind) == []
    if entry.get("printed", entry["hex"]) != entry["hex"]:
        assert kinds(entry["printed"], profile, kind) != []


@given(st.text(max_size=200), st.sampled_from(list(PROFILES.values())))
def test_any_text(text, profile):
    found = parse_packets(text, profile)
    assert all(0 <= each.start < each.end <= len(text) for each in (*found.problems, *found.packets))


@given(st.binary(min_size=1, max_size=60))
def test_any_bytes(data):
    found = parse_packets(hex_text(data))
    assert [each.data for each in found.packets] == [data]
    assert all(each.kind not in (ProblemKind.NOT_HEX, ProblemKind.ODD_DIGITS) for each in found.problems)


def test_the_number_of_problems_is_bounded():
    begin = time.monotonic()
    for text in ("zz " * 3_000_000, "1\n\n" * 100_000, "01\n\n" * 100_000, "01" * 5_000_000):
        assert 0 < len(parse_packets(text).problems) <= MOST_PROBLEMS
    assert time.monotonic() - begin < 60  # not quadratic


def test_no_packet_is_omitted_silently_if_there_are_many_problems():
    found = parse_packets("\n\n".join(["01 02"] * 60))
    assert not found.is_complete
    with pytest.raises(InvalidValue, match="more than 50 problems"):
        found.sendable()
    assert len(parse_packets("\n\n".join([START] * 60)).sendable()) == 60


def test_too_many_bytes():
    found = parse_packets("01" * (16 * 1024 * 1024 + 1))
    assert [each.kind for each in found.problems] == [ProblemKind.TOO_LONG]
    assert not found.can_be_sent


def test_assemble():
    data = assemble("Controller_Execute", ["2", "SysInfo", "3,0"], serial=9)
    decoded = packet.decode(data, exact=True)
    assert (decoded.serial, decoded.code, decoded.reserved) == (9, 17, 0)
    assert [Variant(VarType.I4, 2), Variant(VarType.BSTR, "SysInfo"), Variant(VarType.I4, 0)] == decoded.arguments
    assert assemble(17, ["2", "SysInfo", "3,0"], serial=9) == data
    assert assemble("controller_execute", ["2", "SysInfo", "0"], serial=9) == data
    serial = packet.decode(assemble("Service_Start", [], 5, LINE), crc=True)
    assert (serial.serial, serial.reserved, serial.code) == (5, 5, 1)


@pytest.mark.parametrize(
    ("function", "arguments", "serial", "message"),
    [
        ("Frobnicate", [], 1, "Frobnicate"),
        ("Variable_GetValue", [], 1, "handle"),
        ("Variable_GetValue", ["3", "4"], 1, "1 arguments"),
        ("Variable_GetValue", ["P1"], 1, "not a valid number"),
        ("Variable_GetValue", ["3"], 65536, "0 to 65535"),
    ],
)
def test_assembling_fails(function, arguments, serial, message):
    with pytest.raises(InvalidValue, match=message):
        assemble(function, arguments, serial)


def test_assembling_from_values():
    data = assemble_request(f.controller_execute, [2, "SysInfo", Variant(VarType.I4, 0)], 9, LINE)
    assert data == assemble("Controller_Execute", ["2", "SysInfo", "3,0"], 9, LINE)
    with pytest.raises(InvalidValue, match="handle"):
        assemble_request(f.variable_get_value, [])
    with pytest.raises(InvalidValue, match="0 to 65535"):
        assemble_request(f.service_start, [], 65536)


@pytest.mark.parametrize(("code", "sent"), [(0, 0), (0x80004001, 0x80004001), (-0x7FFFBFFF, 0x80004001)])
def test_assembling_a_reply(code, sent):
    decoded = packet.decode(assemble_reply(code, [1.5], 9, LINE), crc=True)
    assert (decoded.code, decoded.arguments, decoded.serial, decoded.reserved) == (sent, [1.5], 9, 9)
    assert assemble_reply(code, (), 9) == packet.encode(packet.Packet(9, sent))


def test_assembling_a_reply_fails():
    with pytest.raises(InvalidValue, match="32 bits"):
        assemble_reply(0x1_0000_0000)
    with pytest.raises(InvalidValue, match="0 to 65535"):
        assemble_reply(0, (), -1)


def test_invalid_notation():
    with pytest.raises(NotationError):
        assemble("Variable_PutValue", ["3", "8197,x"])
