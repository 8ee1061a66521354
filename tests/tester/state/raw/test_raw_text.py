"""The text with the packets to send."""

from __future__ import annotations

import pytest

from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM
from orinkit.core.errors import InvalidValue
from orinkit.raw.hex_text import hex_text
from orinkit.raw.packets import MOST_PROBLEMS, assemble, assemble_reply
from orinkit.tester.state.packet_detail import detail_of
from orinkit.tester.state.raw.text import LONGEST_TEXT, SHOWN_PACKETS, check_text

START = "01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04"
READ = hex_text(assemble("Variable_GetValue", ["3"], 2))


def test_valid_packets_are_named_and_explained():
    found = check_text(f"{START}\n\n{READ}\n", STREAM)
    assert [each.summary for each in found.packets] == ["Service_Start()", "Variable_GetValue(3)"]
    assert (found.count, found.size, found.problems, found.refusal, found.malformed) == (2, 46, [], "", "")
    assert [(each.place.line, each.place.column) for each in found.packets] == [(1, 1), (3, 1)]
    assert "function id" in [each.name for each in detail_of(found.packets[1].logged).fields]
    assert found.sendable(as_is=False) == [bytes.fromhex(START), bytes.fromhex(READ)]


def test_text_that_is_not_hex_has_a_place_and_is_never_sent():
    text = f"{START}\n\n01 10 0y 00\n02 zz"
    found = check_text(text, STREAM)
    assert [(each.number, each.place.line, each.place.column) for each in found.problems] == [(2, 3, 7), (2, 4, 4)]
    assert text[found.problems[1].place.start : found.problems[1].place.end] == "zz"
    assert all(each.prevents_sending for each in found.problems)
    for as_is in (False, True):
        with pytest.raises(InvalidValue, match="packet 2: '0y' is not hex"):
            found.sendable(as_is=as_is)


def test_places_are_those_of_the_browser():
    found = check_text("𝟘𝟙\n\nzz", STREAM)
    assert [(each.place.start, each.place.end) for each in found.problems] == [(0, 4), (6, 8)]  # UTF-16


@pytest.mark.parametrize(
    ("text", "profile", "message"),
    [
        (START.replace("10", "12", 1), STREAM, "the length is 18, but 16 bytes are present"),
        ("02" + START[2:], STREAM, "must begin with SOH"),
        (START[:-2] + "05", STREAM, "must end with EOT"),
        (
            hex_text(assemble("Service_Start", [], 1, LINE)).replace("01 00 01 00", "02 00 01 00", 1),
            LINE,
            "CRC is wrong",
        ),
        (hex_text(assemble("Controller_Execute", ["1", "Do", "8," + "x" * 400])), DATAGRAM, "over udp"),
        (START.replace("01 00 00 00 00 00 04", "FE 00 00 00 00 00 04"), STREAM, "function id 254 is unknown"),
    ],
)
def test_a_malformed_packet_is_sent_only_as_it_is(text, profile, message):
    found = check_text(text, profile)
    assert message in found.problems[0].text
    assert not found.problems[0].prevents_sending
    with pytest.raises(InvalidValue, match="Send as it is"):
        found.sendable(as_is=False)
    assert found.sendable(as_is=True) == [bytes.fromhex(text)]


def test_the_number_of_a_packet_after_one_that_is_not_hex():
    found = check_text(f"zz\n\n{START}\n\n{READ}", STREAM)
    assert [each.number for each in found.packets] == [2, 3]


def test_the_packets_of_a_server_are_replies():
    reply = hex_text(assemble_reply(0, [5], 9))
    assert check_text(reply, STREAM, "reply").packets[0].summary == "S_OK -> 5"
    assert check_text(reply, STREAM, "reply").problems == []
    assert check_text(reply, STREAM, "request").malformed


def test_nothing_is_cut():
    for text in ("", " \n\n "):
        with pytest.raises(InvalidValue, match="no packet given"):
            check_text(text, STREAM).sendable(as_is=True)
    with pytest.raises(InvalidValue, match="exceeds 300,000 characters"):
        check_text("01" * LONGEST_TEXT, STREAM).sendable(as_is=True)
    many = check_text("\n\n".join([START] * 1000), STREAM)
    assert (len(many.packets), len(many.sendable(as_is=False))) == (SHOWN_PACKETS, 1000)
    with pytest.raises(InvalidValue, match="more than 50 problems"):
        check_text("\n\n".join(["01 02"] * (MOST_PROBLEMS + 1)), STREAM).sendable(as_is=True)
