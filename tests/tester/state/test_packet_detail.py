"""The explanation of packets for display, and packets as text."""

from __future__ import annotations

import itertools
import json
import re
from datetime import datetime  # noqa: F401 - for the evaluated calls

import pytest

from orinkit import Variant, VarType, functions
from orinkit.bcap import packet as bcap
from orinkit.bcap.requests import encode_request
from orinkit.core.errors import InvalidValue
from orinkit.ecap.message import write_request
from orinkit.tester.state.packet_detail import SHOWN_BYTES, SHOWN_FIELDS, detail_of
from orinkit.tester.state.packet_facts import summary
from orinkit.tester.state.packet_log import LoggedPacket
from orinkit.tester.state.packet_text import LONGEST_COPY, as_bytes_literal, as_c_array, as_call, as_hex, transcript
from support import paths

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
REQUESTS = [each for each in PRINTED if each["kind"] == "request"]
BIG = Variant(VarType.ARRAY | VarType.UI1, bytes(1024 * 1024))


def logged(data: bytes, direction=">", scheme="tcp", request=None) -> LoggedPacket:
    return LoggedPacket(1, 1_700_000_000_123_456_789, "a", scheme, direction, data, request)


def of_document(printed) -> LoggedPacket:
    scheme = printed["transport"] if printed["transport"] in ("tcp", "udp") else "serial"
    return logged(bytes.fromhex(printed["hex"]), ">" if printed["kind"] == "request" else "<", scheme)


class Client:
    """Has ``call`` like a client, and returns the packet instead of sending it."""

    def __init__(self, serial, reserved, crc):
        self.last, self.reserved, self.crc = serial, reserved, crc

    def call(self, function, *arguments):
        return encode_request(function, function.bind(arguments, {}), self.last, self.reserved, crc=self.crc)


@pytest.mark.parametrize("printed", PRINTED, ids=lambda each: f"{each['document'].split('.')[0]}-{each['line']}")
def test_the_fields_of_the_printed_packets_cover_all_bytes(printed):
    detail = detail_of(of_document(printed))
    assert b"".join(each.raw for each in detail.fields) == detail.data == bytes.fromhex(printed["hex"])
    assert not any(each.error for each in detail.fields)
    assert not detail.is_partial


@pytest.mark.parametrize("printed", REQUESTS, ids=lambda each: f"{each['document'].split('.')[0]}-{each['line']}")
def test_the_copied_call_produces_the_printed_packet(printed):
    packet = of_document(printed)
    client = Client(printed["serial"], printed["reserved"], packet.scheme == "serial")
    names = {"client": client, "functions": functions, "Variant": Variant, "VarType": VarType}
    assert eval(as_call(packet), names) == packet.data
    assert eval(as_bytes_literal(packet)) == packet.data
    assert bytes.fromhex(as_hex(packet)) == packet.data
    assert bytes(int(byte, 16) for byte in re.findall("0x(..)", as_c_array(packet))) == packet.data


def test_the_call_of_an_ecap_body():
    body = write_request(functions.variable_put_value, (3, Variant(VarType.ARRAY | VarType.R4, [1.5, float("inf")])))
    text = as_call(logged(body, scheme="http"))
    found = eval(text, {"client": Client(1, 0, False), "functions": functions, "Variant": Variant, "VarType": VarType})
    assert found == encode_request(
        functions.variable_put_value, (3, Variant(VarType.ARRAY | VarType.R4, [1.5, float("inf")])), 1
    )


@pytest.mark.parametrize(
    "data", [b"", b"\x01", bytes(100), bcap.encode(bcap.Packet(1, 0)), bcap.encode(bcap.Packet(1, 200))]
)
def test_what_is_not_a_request_has_no_call(data):
    with pytest.raises(InvalidValue):
        as_call(logged(data))


@pytest.mark.parametrize("convert", [as_hex, as_bytes_literal, as_c_array, as_call])
def test_large_packets_are_not_copied(convert):
    with pytest.raises(InvalidValue, match="pcapng"):
        convert(logged(bytes(LONGEST_COPY + 1)))


def test_a_large_packet_is_shown_in_part():
    data = bcap.encode(bcap.Packet(9, 102, [Variant(VarType.I4, 3), BIG]))
    detail = detail_of(logged(data))
    assert detail.is_partial
    assert (detail.data, detail.size) == (data[:SHOWN_BYTES], len(data))
    assert b"".join(each.raw for each in detail.fields) == data
    assert "Variable_PutValue" in summary(logged(data))
    assert [each.offset for each in detail.fields][:7] == [0, 1, 5, 7, 9, 13, 15]


@pytest.mark.parametrize("cut", [0, 5, 11, 40])
def test_a_large_malformed_packet_is_marked(cut):
    data = bytearray(bcap.encode(bcap.Packet(9, 102, [Variant(VarType.I4, 3), BIG])))
    data[cut or len(data) - 1] ^= 0xFF
    if cut == 40:
        data[15:19] = b"\xff\xff\xff\x7f"
    fields = detail_of(logged(bytes(data))).fields
    assert any(each.error for each in fields) is (cut in (0, 40))


def test_the_number_of_fields_is_limited():
    data = bcap.encode(bcap.Packet(1, 0, [Variant(VarType.ARRAY | VarType.VARIANT, [Variant(VarType.EMPTY)] * 1000)]))
    detail = detail_of(logged(data, "<"))
    assert len(detail.fields) == SHOWN_FIELDS
    assert detail.omitted > 0


@pytest.mark.parametrize(("direction", "body"), [
    (">", b"Func=101,Arg1=3,Arg2="), (">", b"Func=101&Arg1=3"), ("<", b"0x00000000,8,IO150,x"), ("<", b"<html>"), (">", b""),
    (">", b"Func=17," + b"x" * 100_000), ("<", b"0x00000000,8," + b"\xff" * 100_000),
])  # fmt: skip
def test_ecap_bodies(direction, body):
    detail = detail_of(logged(body, direction, "http"))
    assert b"".join(each.raw for each in detail.fields) == body
    assert summary(logged(body, direction, "http"))


def test_the_saved_text_of_a_packet():
    data = bcap.encode(bcap.Packet(7, 101, [3]))
    lines = list(transcript(logged(data), "Variable_GetValue(3)"))
    assert lines[0].startswith("#1 2023-11-")
    assert lines[0].endswith("a > 30 Variable_GetValue(3)")
    assert bytes.fromhex("".join(lines[1:])) == data
    assert all(len(line.split()) <= 16 for line in itertools.islice(lines, 1, None))
