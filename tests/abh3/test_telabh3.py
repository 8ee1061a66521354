"""TelABH3: requests and replies in every form, and the tables of monitors and parameters."""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.session import telabh3
from orinkit.abh3.session.telabh3 import ACK, MONITORS, NAK, PARAMETERS, TelItem, TelReply, TelRequest
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, ParameterRefused, ProtocolError

pytestmark = pytest.mark.core

ADDRESSES = st.integers(0, 0xFFFF)
WORDS = st.integers(0, 0xFFFFFFFF)
REQUESTS = st.builds(TelRequest, st.just("CP"), ADDRESSES, st.none() | WORDS) | st.builds(
    TelRequest, st.sampled_from(["CM", "BI"]), ADDRESSES, st.none()
)


def serial(text: bytes, header: bytes = b"FFFF") -> bytes:
    """Return a text as it is sent over a serial line."""
    return b"\x02" + header + text + telabh3.checksum(header + text) + b"\x03"


def test_the_known_request() -> None:
    assert telabh3.read_parameter(0) == b"CP000095"
    assert telabh3.parse_request(b"CP000095") == TelRequest("CP", 0)


def test_requests() -> None:
    assert telabh3.read_monitor(0x1054)[:-2] == b"CM1054"
    assert telabh3.read_identification(telabh3.VERSION)[:-2] == b"BI0002"
    assert telabh3.write_parameter(0x5180, 0xFFFFFFFF)[:-2] == b"CP5180FFFFFFFF"


@given(asked=REQUESTS, filled=st.integers(0, 7))
def test_requests_are_read_in_every_form(asked: TelRequest, filled: int) -> None:
    text = bytes(asked)
    for form in (text, b"FFFF" + text, serial(text[:-2]), serial(text[:-2], b"0001"), text[:-2] + text[-2:].lower()):
        assert telabh3.parse_request(form + b"\x16" * filled) == asked


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\x16" * 9,
        b"CP0000",
        b"CP00009",
        b"CPxyz195",
        b"cp000095",
        b"CQ000094",
        b"CP7001",
        b"\x02\x03",
        b"\xff" * 14,
        b"CP0000 5",
    ],
)
def test_invalid_requests(message: bytes) -> None:
    with pytest.raises(ProtocolError, match="not a valid TelABH3 text"):
        telabh3.parse_request(message)


def test_only_parameters_are_written() -> None:
    text = b"CM100400000001"
    with pytest.raises(ProtocolError, match="not a valid TelABH3 text"):
        telabh3.parse_request(text + telabh3.checksum(b"FFFF" + text))


@pytest.mark.parametrize(
    "message", [b"CP000096", b"CP0000AD", b"FFFFCP0000AD", serial(b"CP0000").replace(b"95", b"94")]
)
def test_a_wrong_checksum_of_a_request(message: bytes) -> None:
    with pytest.raises(ProtocolError, match="checksum"):
        telabh3.parse_request(message)


@pytest.mark.parametrize("number", [-1, 0x10000, 1.0, "0", None, pytest.param(10**5000, id="huge")])
def test_invalid_addresses(number: int) -> None:
    for function in (telabh3.read_parameter, telabh3.read_monitor, telabh3.read_identification):
        with pytest.raises(InvalidValue, match="0 to 0xFFFF, not"):
            function(number)
    with pytest.raises(InvalidValue):
        telabh3.write_parameter(number, 0)


@pytest.mark.parametrize("word", [-1, 1 << 32, 1.5, None])
def test_invalid_words(word: int) -> None:
    with pytest.raises(InvalidValue, match="0 to 0xFFFFFFFF, not"):
        telabh3.write_parameter(0, word)


@given(WORDS | st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=40), st.integers(0, 7))
def test_replies_are_read_in_every_form(value: int | str, filled: int) -> None:
    answer = telabh3.reply(value)
    data = f"{value:08X}" if isinstance(value, int) else value
    text = bytes((ACK,)) + data.encode()
    forms = [
        answer,
        b"FFFF" + answer,
        b"0001" + text + telabh3.checksum(b"0001" + text),
        serial(text),
        serial(text, b"0001"),
    ]
    forms += [text + telabh3.checksum(text), b"\x02" + answer + b"\x03", serial(b"0" + data.encode())]
    for form in forms:
        reply = telabh3.parse_reply(form + b"\x16" * filled)
        assert reply == TelReply(refused=False, data=data)
        assert reply.confirmed() == data
        if isinstance(value, int):
            assert reply.word == value


def test_a_status_without_a_header_may_be_any_character() -> None:
    text = b"000000005"
    assert telabh3.parse_reply(text + telabh3.checksum(b"FFFF" + text)).word == 5


@pytest.mark.parametrize("form", [telabh3.refusal(), serial(bytes((NAK,))), serial(bytes((NAK,)) + b"01")])
def test_a_refusal(form: bytes) -> None:
    reply = telabh3.parse_reply(form)
    assert reply.refused
    for read in (reply.confirmed, lambda: reply.word):
        with pytest.raises(ParameterRefused, match="the driver refused the request") as caught:
            read()
        assert (f"({reply.data})" in str(caught.value)) == bool(reply.data)
        assert "Try: " in str(caught.value)
    i18n.use("ja")
    with pytest.raises(ParameterRefused, match=r"拒否.*対処"):
        reply.confirmed()


@pytest.mark.parametrize("data", ["", "1234567", "1234567G", "V1.2.3", "ａ" * 8])
def test_data_that_is_not_a_value(data: str) -> None:
    with pytest.raises(ProtocolError, match="not a valid TelABH3 text"):
        _ = TelReply(refused=False, data=data).word


@pytest.mark.parametrize(
    "message", [b"", b"\x16" * 9, b"1", b"\x06\x06", b"\x02\x03", b"\x06xy", b"\x0600000005FF", b"\xff" * 1785]
)
def test_invalid_replies(message: bytes) -> None:
    with pytest.raises(ProtocolError, match="checksum"):
        telabh3.parse_reply(message)


@pytest.mark.parametrize("text", [b"", b"FFFF", b"\x02" + b"0001"])
def test_replies_without_a_status(text: bytes) -> None:
    with pytest.raises(ProtocolError, match="not a valid TelABH3 text"):
        telabh3.parse_reply(text + telabh3.checksum(text.removeprefix(b"\x02")))


@given(st.binary(max_size=40), st.booleans())
def test_bytes_of_any_kind(message: bytes, checked: bool) -> None:
    text = message + telabh3.checksum(message) if checked else message
    with contextlib.suppress(ProtocolError):
        telabh3.parse_request(text)
    with contextlib.suppress(ProtocolError):
        telabh3.parse_reply(text)


def test_messages_of_errors_are_short() -> None:
    with pytest.raises(ProtocolError) as caught:
        telabh3.parse_reply(b"\xff" * 1785)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("value", ["\n", "速度", "\x03", -1, 1 << 32])
def test_replies_that_cannot_be_built(value: int | str) -> None:
    with pytest.raises(InvalidValue):
        telabh3.reply(value)


def test_the_tables() -> None:
    assert [f"{address:04X}" for address in MONITORS][:7] == ["0000", "0001", "0002", "0003", "0004", "0005", "1004"]
    assert (len(MONITORS), len(PARAMETERS)) == (16, 188)
    for table in (MONITORS, PARAMETERS):
        assert all(item.address == address and item.english.isascii() for address, item in table.items())
        assert list(table) == sorted(table)
        assert len({item.english for item in table.values()}) == len(table)


@pytest.mark.parametrize(
    ("address", "kind", "english"),
    [
        (20704, "int", "A/Y data source #0 (0: driver, 2: CAN)"),
        (20720, "int", "B/X data source #0 (0: driver, 2: CAN)"),
        (0x5007, "pack", "A/Y velocity #7"),
        (0x5008, "pack", "B/X velocity #0"),
        (0x50D7, "pack", "B/X I gain #7"),
        (0x5129, "int", "B/X data select 2"),
        (0x5187, "bits", "digital output #7"),
        (16663, "int", "command time-out after which the driver sets its commands to 0, 0 for none"),
        (16656, "int", "broadcast reception 1"),
        (24960, "int", "PDU format of single packets"),
    ],
)
def test_parameters(address: int, kind: str, english: str) -> None:
    item = PARAMETERS[address]
    assert (item.kind, item.english, item.text) == (kind, english, english)


def test_texts_are_in_both_languages() -> None:
    assert MONITORS[0x1004].text == "main voltage"
    i18n.use("ja")
    assert MONITORS[0x1004].text == "主電源電圧"
    assert PARAMETERS[0x50D7].text == "B/X I ゲイン #7"
    assert PARAMETERS[0x50D7].english == "B/X I gain #7"
    for table in (MONITORS, PARAMETERS):
        assert all(item.text != item.english for item in table.values())


@pytest.mark.parametrize(
    ("kind", "value", "word"),
    [
        ("pack", 0.25, 0x01C00019),
        ("pack", -50, 0x003FFFFB),
        ("int", -1, 0xFFFFFFFF),
        ("int", 0x7FFFFFFF, 0x7FFFFFFF),
        ("int", -0x80000000, 0x80000000),
        ("bits", 0xFFFFFFFF, 0xFFFFFFFF),
        ("bits", 0, 0),
    ],
)
def test_values_of_items(kind: telabh3.Kind, value: float, word: int) -> None:
    item = TelItem(0, kind, "something")
    assert item.encode(value) == word
    assert item.decode(word) == value


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("pack", math.nan),
        ("pack", math.inf),
        ("pack", 1e39),
        pytest.param("pack", 10**5000, id="huge value"),
        ("int", 0x80000000),
        ("int", -0x80000001),
        ("int", 1.0),
        ("bits", -1),
        ("bits", 1 << 32),
        pytest.param("bits", 10**5000, id="huge bits"),
    ],
)
def test_values_that_cannot_be_written(kind: telabh3.Kind, value: float) -> None:
    with pytest.raises(InvalidValue, match="something"):
        TelItem(0, kind, "something").encode(value)


@pytest.mark.parametrize("kind", ["pack", "int", "bits"])
def test_words_of_items_have_32_bits(kind: telabh3.Kind) -> None:
    with pytest.raises(InvalidValue):
        TelItem(0, kind, "something").decode(1 << 32)


def test_requests_for_people() -> None:
    assert str(telabh3.parse_request(telabh3.read_parameter(0x4102))) == "parameter 0x4102"
    assert str(telabh3.parse_request(telabh3.write_parameter(0x4102, 7))) == "parameter 0x4102 = 0x00000007"
    assert str(telabh3.parse_request(telabh3.read_monitor(0x1004))) == "monitor 0x1004"
    i18n.use("ja")
    assert str(telabh3.parse_request(telabh3.read_identification(2))) == "識別情報 0x0002"


def test_a_refusal_names_the_request() -> None:
    with pytest.raises(ParameterRefused, match=r"^parameter 0x1234: the driver refused the request\. Try"):
        telabh3.parse_reply(telabh3.refusal(), "parameter 0x1234").confirmed()
