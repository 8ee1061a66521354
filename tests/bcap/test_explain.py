"""Dissection of packets: all bytes covered, all packets of the documents, and errors in malformed packets."""

from __future__ import annotations

import json
import struct
from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.dissect import PacketField, explain, first_error, kind_of, one_line, show, split
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult, i18n
from orinkit.core.errors import ProtocolError
from orinkit.values.notation import format_variant
from orinkit.values.variant import Variant, VarType, type_name, variant
from support import paths
from support.strategies import variants

pytestmark = pytest.mark.core

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))


def ids(vector):
    return f"{vector['document'][:11]}:{vector['line']}"


def joined(fields: list[PacketField]) -> bytes:
    return b"".join(field.raw for field in fields)


def meanings(frame: bytes, **options) -> dict[str, str]:
    return {field.name: field.meaning for field in explain(frame, **options)}


def request(function_id: int, *arguments, serial: int = 1) -> bytes:
    return packet.encode(packet.Packet(serial, function_id, list(arguments)))


# --- the packets of the documents -------------------------------------------------------------------------------------


@pytest.mark.parametrize("vector", VECTORS, ids=ids)
def test_a_packet_of_the_documents_is_explained_as_printed(vector):
    frame = bytes.fromhex(vector["hex"])
    fields = explain(frame)
    assert joined(fields) == frame
    assert first_error(fields) is None
    meaning = {field.name: field.meaning for field in fields}
    assert meaning["serial"] == str(vector["serial"])
    assert meaning["reserved"].partition(":")[0] == str(vector["reserved"])
    assert meaning["arguments"] == str(len(vector["arguments"]))
    if vector["kind"] == "request":
        assert meaning["function id"].startswith(f"{vector['function_id']} {FUNCTIONS[vector['function_id']].name}")
    else:
        assert meaning["return code"].startswith(f"0x{vector['return_code']:08X}")
    assert ("CRC" in meaning) == (vector["transport"] == "com")
    types = [field.meaning for field in fields if field.level == 1 and field.name.endswith(": data type")]
    assert [text.partition(" ")[0] for text in types] == [argument["type"] for argument in vector["arguments"]]


@pytest.mark.parametrize("vector", VECTORS, ids=ids)
def test_every_value_of_the_documents_is_shown_in_notation(vector):
    frame = bytes.fromhex(vector["hex"])
    shown = [field.meaning for field in explain(frame) if field.level >= 1 and ": " not in field.name]
    for argument in packet.decode(frame, exact=True).arguments:
        if argument.type in (VarType.BSTR, VarType.I4, VarType.I2, VarType.BOOL) and argument.value != "":
            assert format_variant(argument) in shown


@pytest.mark.parametrize("vector", [vector for vector in VECTORS if "printed" in vector], ids=ids)
def test_a_misprinted_packet_is_explained_as_far_as_possible(vector):
    frame = bytes.fromhex(vector["printed"])
    fields = explain(frame)
    assert joined(fields) == frame
    assert first_error(fields) is not None
    assert one_line(frame).startswith("not a packet")


def test_one_line_of_each_kind():
    frames = {vector["line"]: bytes.fromhex(vector["hex"]) for vector in VECTORS}
    assert one_line(frames[270]) == 'Controller_GetVariable(2, "IO150", "")'
    assert one_line(frames[279], frames[270]) == "S_OK -> 3"
    lines = [one_line(frame) for frame in frames.values()]
    assert "Variable_PutValue(3, True)" in lines
    assert "S_OK" in lines
    assert 'Controller_Execute(2, "ClearError", VT_EMPTY)' in lines
    assert "S_OK -> VT_EMPTY" in lines


# --- fields -----------------------------------------------------------------------------------------------------------


def test_arguments_have_the_names_of_the_table():
    meaning = meanings(request(72, 3, 1, "P1", "NEXT"))
    assert meaning["function id"].startswith("72 Robot_Move: ")
    assert meaning["handle"] == "3,3"
    assert meaning["interpolation"] == "3,1"
    assert meaning["pose"] == "8,P1"
    assert meaning["option: string length"] == "8 bytes"
    assert meaning["option"] == "8,NEXT"


def test_more_arguments_than_the_function_has_are_numbered():
    meaning = meanings(request(2, 7, 8))
    assert meaning["argument 1"] == "3,7"
    assert meaning["argument 2"] == "3,8"


def test_an_unknown_function_is_not_an_error_of_the_packet():
    frame = request(200, 1)
    assert meanings(frame)["function id"] == "200 unknown function; a server returns E_NOTIMPL"
    assert first_error(explain(frame)) is None
    assert one_line(frame) == "unknown function 200(1)"


def test_a_reply_is_explained_with_its_request():
    asked = request(7, 2, "Arm", "")
    reply = packet.pack(1, 0, 1, bytes.fromhex("0a000000030001000000") + b"\x05\0\0\0")
    assert meanings(reply)["result"] == "3,5"
    assert meanings(reply, request=asked)["Robot handle"] == "3,5"
    assert meanings(reply, request=b"")["result"] == "3,5"


def test_several_results_are_numbered():
    meaning = meanings(packet.encode(packet.Packet(1, 0, [1, 2])))
    assert meaning["result"] == "3,1"
    assert meaning["result 2"] == "3,2"


@pytest.mark.parametrize(
    ("code", "kind"),
    [(0, "reply"), (1, "request"), (137, "request"), (255, "request"), (256, "reply"), (0x900, "reply"), (0x80004001, "reply")],
)  # fmt: skip
def test_a_code_distinguishes_requests_and_replies(code, kind):
    assert kind_of(code) == kind
    names = [field.name for field in explain(packet.pack(1, code, 0, b""))]
    assert ("function id" in names) == (kind == "request")


def test_the_kind_can_be_given():
    frame = packet.pack(1, 1, 0, b"")
    assert meanings(frame, kind="reply")["return code"].startswith("0x00000001 S_FALSE")
    assert meanings(packet.pack(1, 0, 0, b""), kind="request")["function id"].startswith("0 unknown function")
    assert one_line(frame, request(2)) == "S_FALSE"


def test_an_error_reply_has_name_number_and_text():
    frame = packet.pack(9, hresult.E_HANDLE, 0, b"")
    assert one_line(frame) == "0x80070006 E_HANDLE: Invalid handle"
    assert meanings(frame)["return code"] == "0x80070006 E_HANDLE: Invalid handle"
    assert one_line(packet.pack(9, 0x8F123456, 0, b"")).startswith("0x8F123456: ")


def test_the_elements_of_arrays_are_separate_fields():
    value = [1, "ab", [True, None], ["x", "y"]]
    fields = explain(request(64, 3, "Do", value))
    meaning = {field.name: (field.meaning, field.level) for field in fields}
    assert meaning["parameter: data type"] == ("VT_VARIANT|VT_ARRAY (8204)", 1)
    assert meaning["parameter: element count"] == ("4", 1)
    assert meaning["parameter[0]"] == ("3,1", 2)
    assert meaning["parameter[1]"] == ("8,ab", 2)
    assert meaning["parameter[2][0]"] == ("11,-1", 3)
    assert meaning["parameter[2][1]: data type"] == ("VT_EMPTY (0)", 3)
    assert meaning["parameter[3][1]"] == ("8,y", 3)


def test_a_long_value_is_shortened_but_its_bytes_are_complete():
    frame = request(102, 3, [1.5] * 1000)
    (value,) = [field for field in explain(frame) if field.name == "value"]
    assert len(value.meaning) == 400
    assert value.meaning.startswith("8197,1.5,1.5,")
    assert len(value.raw) == 8000
    assert len(one_line(frame)) < 120


def test_control_characters_are_escaped():
    frame = request(102, 3, "\x1b[2J\r\nP1\ud800")
    assert meanings(frame)["value"] == r"8,\x1b[2J\r\nP1\ud800"
    assert one_line(frame) == r'Variable_PutValue(3, "\x1b[2J\r\nP1\ud800")'


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (True, "True"),
        (-2125459453, "-2125459453 (0x81501003)"),
        (-1, "-1"),
        (1.5, "1.5"),
        (b"\x01\xff", "<01 ff>"),
        (datetime(2026, 11, 21, 10, 0), "2026-11-21 10:00:00"),
        ([1, "a", [None]], '[1, "a", [VT_EMPTY]]'),
        ("x" * 200, '"' + "x" * 78 + "…"),
    ],
)
def test_short_texts_of_values(value, expected):
    assert show(variant(value)) == expected


# --- the reserved area and the CRC ------------------------------------------------------------------------------------


def test_the_crc_of_a_serial_line_is_recognised():
    frame = packet.pack(3, 2, 0, b"", crc=True)
    last = explain(frame)[-2]
    assert (last.name, last.raw, last.meaning) == ("CRC", frame[-3:-1], "correct (serial line)")


def test_two_bytes_that_are_not_the_crc_are_the_reserved_area():
    good = packet.pack(3, 2, 0, b"", crc=True)
    bad = good[:-3] + b"\xab\xcd\x04"
    area = explain(bad)[-2]
    assert (area.name, area.raw) == ("reserved area", b"\xab\xcd")
    assert (
        area.meaning
        == f"2 bytes after the arguments; if these bytes are a CRC, the correct value is {good[-3:-1].hex(' ')}"
    )
    assert first_error(explain(bad)) is None


def test_a_reserved_area_before_a_crc():
    frame = packet.encode(packet.Packet(3, 2, [], 0, b"xyz"), crc=True)
    assert [(field.name, field.raw) for field in explain(frame)][-3:-1] == [
        ("reserved area", b"xyz"),
        ("CRC", frame[-3:-1]),
    ]


# --- invalid packets --------------------------------------------------------------------------------------------------


def error_of(frame: bytes) -> PacketField:
    fields = explain(frame)
    assert joined(fields) == frame
    error = first_error(fields)
    assert error is not None
    return error


GOOD = request(9, 2, "IO150", "")


@pytest.mark.parametrize(
    ("frame", "offset", "name", "meaning"),
    [
        (b"", 0, "not a packet", "a packet must begin with SOH 01"),
        (b"\x02" + GOOD[1:], 0, "not a packet", "a packet must begin with SOH 01"),
        (GOOD[:9], 1, "header", "the header of 15 bytes is incomplete"),
        (GOOD[:1], 1, "header", "the header of 15 bytes is incomplete"),
        (GOOD[:15], 1, "length", "68 bytes, but the packet has 15 bytes"),
        (GOOD[:40], 1, "length", "68 bytes, but the packet has 40 bytes"),
        (GOOD[:-1] + b"\x05", 67, "end (EOT)", "the final EOT 04 is missing"),
        (GOOD + b"\xff", 1, "length", "68 bytes, but the packet has 69 bytes"),
        (GOOD[:1] + b"\xff\xff\xff\x7f" + GOOD[5:], 1, "length", "2147483647 bytes exceed the limit of 16777216 bytes"),
        (GOOD[:1] + b"\x01\0\0\0" + GOOD[5:], 1, "length", "1 byte, but the packet has 68 bytes"),
        (GOOD[:13] + b"\x04\0" + GOOD[15:], 67, "argument 4", "an argument requires 10 bytes or more, 0 are left at offset 67 (1 missing according to the argument count)"),
        (GOOD[:15] + b"\x0b" + GOOD[16:], 29, "handle", "at offset 15, 5 bytes of data do not match 1 x VT_I4"),
        (GOOD[:15] + b"\xff" + GOOD[16:], 15, "handle: length", "argument length 255 at offset 15 does not match the 48 bytes that follow"),
        (GOOD[:15] + b"\x05" + GOOD[16:], 15, "handle: length", "argument length 5 at offset 15 does not match the 48 bytes that follow"),
        (GOOD[:19] + b"\x63" + GOOD[20:], 25, "handle", "unknown type VT_99? at offset 25"),
        (GOOD[:21] + b"\x02" + GOOD[22:], 25, "handle", "at offset 25, 4 bytes of data do not match 2 x VT_I4"),
        (GOOD[:39] + b"\x0b" + GOOD[40:], 39, "name", "the length of the string at offset 39 must be even and at most 10 bytes, not 11"),
        (GOOD[:39] + b"\x09" + GOOD[40:], 39, "name", "the length of the string at offset 39 must be even and at most 10 bytes, not 9"),
    ],
)  # fmt: skip
def test_the_position_of_an_error(frame, offset, name, meaning):
    error = error_of(frame)
    assert (error.offset, error.name, error.meaning) == (offset, name, meaning)


def test_the_arguments_after_an_invalid_one_are_explained():
    frame = GOOD[:19] + b"\x63" + GOOD[20:]
    meaning = meanings(frame)
    assert meaning["name"] == "8,IO150"
    assert meaning["end (EOT)"] == ""


def test_an_error_in_a_nested_element():
    frame = bytearray(request(64, 3, "Do", [1, [2, "ab"]]))
    at = frame.index("ab".encode("utf-16-le")) - 4
    frame[at] = 0x7F
    error = error_of(bytes(frame))
    assert error.offset == at
    assert "must be even and at most 4 bytes, not 127" in error.meaning
    assert meanings(bytes(frame))["parameter[1][0]"] == "3,2"


def test_nesting_deeper_than_allowed_is_an_error_at_that_depth():
    value = Variant(VarType.I4, 1)
    for _ in range(17):
        value = Variant(VarType.VARIANT | VarType.ARRAY, [value])
    error = error_of(request(102, 3, value))
    assert error.meaning == "VARIANT arrays nested deeper than 16"
    assert error.level == 1


def test_bytes_after_a_packet():
    last = explain(GOOD + b"\xff\xff")[-1]
    assert (last.name, last.raw, last.meaning) == ("not a packet", b"\xff\xff", "2 bytes after the end of the packet")


def test_a_crc_is_separate_from_invalid_arguments():
    frame = packet.pack(3, 9, 1, b"\xff\0\0\0\x03\0\x01\0\0\0\x02\0\0\0", crc=True)
    names = [field.name for field in explain(frame)]
    assert names[-2:] == ["CRC", "end (EOT)"]
    assert joined(explain(frame)) == frame


def test_the_bytes_of_an_argument_are_not_a_crc():
    """The last two bytes happen to be the CRC of the bytes before them, and one of them belongs to the last argument."""
    frame = bytes.fromhex(
        "0155000000070000004800000004000a000000030001000c00030000000a000000030001000000010000000e00000008000100000004"
        "0000005000310012000000080001000000080000004e004500580050540004"
    )
    assert [(field.name, field.raw) for field in explain(frame)][-2:] == [
        ("reserved area", b"\0"),
        ("end (EOT)", b"\x04"),
    ]
    assert joined(explain(frame)) == frame


@given(st.binary(max_size=80))
def test_any_bytes_are_explained_completely(data):
    assert joined(explain(data)) == data
    assert isinstance(one_line(data), str)
    assert b"".join(split(data)) == data


@given(st.lists(variants(), max_size=4), st.booleans(), st.sampled_from([0, 9, 64, 0x80004001]))
def test_every_valid_packet_is_explained_completely(arguments, crc, code):
    frame = packet.encode(packet.Packet(7, code, list(arguments)), crc=crc)
    fields = explain(frame)
    assert joined(fields) == frame
    assert first_error(fields) is None
    types = [field.meaning for field in fields if field.level == 1 and field.name.endswith(": data type")]
    assert types == [f"{type_name(argument.type)} ({argument.type})" for argument in arguments]


@given(st.lists(variants(), max_size=3), st.data())
def test_a_mutated_packet_has_an_error_exactly_when_the_decoder_refuses_it(arguments, data):
    frame = bytearray(packet.encode(packet.Packet(7, 64, list(arguments))))
    for _ in range(data.draw(st.integers(1, 3))):
        frame[data.draw(st.integers(0, len(frame) - 1))] = data.draw(st.integers(0, 255))
    mutated = bytes(frame)
    fields = explain(mutated)
    assert joined(fields) == mutated
    try:
        packet.decode(mutated)
    except ProtocolError:
        assert first_error(fields) is not None
    else:
        assert first_error(fields) is None


# --- several packets --------------------------------------------------------------------------------------------------


def test_successive_packets_are_split():
    frames = [bytes.fromhex(vector["hex"]) for vector in VECTORS]
    assert split(b"".join(frames)) == frames


def test_bytes_between_packets_are_separate_pieces():
    assert split(b"\x01\xff" + GOOD + b"\x01noise" + GOOD + b"\x04") == [b"\x01\xff", GOOD, b"\x01noise", GOOD, b"\x04"]
    assert split(b"") == []
    assert split(GOOD[:-1]) == [GOOD[:-1]]


# --- in Japanese ------------------------------------------------------------------------------------------------------


def test_everything_is_translated_to_japanese():
    i18n.use("ja")
    meaning = meanings(GOOD)
    assert meaning["関数 ID"].startswith("9 Controller_GetVariable: ")
    assert meaning["name: 文字列長"] == "10 バイト"
    assert error_of(GOOD[:-1] + b"\x05").meaning == "末尾に EOT 04 がありません"
    assert error_of(GOOD + b"\xff").meaning == "68 バイト (実際は 69 バイト)"
    assert one_line(b"\x02").startswith("不正なパケット: ")


@pytest.mark.parametrize("vt", [2, 3, 5, 11, 16, 17])
def test_a_value_longer_than_its_declared_length(vt):
    """The declared length of the argument ends before its value does."""
    argument = struct.pack("<IHI", 6, vt, 1)
    assert "0 bytes of data do not match" in error_of(packet.pack(1, 101, 1, argument)).meaning


def test_a_list_with_too_few_elements():
    frame = bytearray(packet.encode(packet.Packet(1, 64, [Variant(0x200C, [Variant(VarType.I4, 5)])])))
    count = frame.index(b"\x0c\x20") + 2
    assert frame[count] == 1
    frame[count] = 2
    assert first_error(explain(bytes(frame))) is not None
