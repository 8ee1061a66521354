"""Packets: all printed in the documents, decoded and encoded; and a stream of them, split and corrupted."""

from __future__ import annotations

import json
import re
import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.packet import SOH, Framer, Packet, check_frame, checksum, decode, decode_arguments, encode, pack
from orinkit.core import hresult, i18n
from orinkit.core.errors import InvalidValue, LimitExceeded, ProtocolError
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.paths import VECTORS
from support.strategies import same, variants

pytestmark = pytest.mark.core

PRINTED = json.loads((VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
EACH = pytest.mark.parametrize("row", PRINTED, ids=lambda row: f"{row['document'][:9]}-{row['line']}-{row['kind']}")


def of_row(argument: dict) -> Variant:
    parts = [VarType[name.removeprefix("VT_")] for name in argument["type"].split("|")]
    return Variant(sum(parts), argument["value"])


# --- the documents' packets -------------------------------------------------------------------------------------------


def test_all_packets_of_both_documents_are_here():
    assert len(PRINTED) == 75
    assert {row["document"] for row in PRINTED} == {"bcap-rc8.ja.txt", "bcap-ve026a.en.txt"}


@EACH
def test_the_meaning_of_a_printed_packet(row):
    data, crc = bytes.fromhex(row["hex"]), row["transport"] == "com"
    read = decode(data, exact=True, crc=crc)
    assert (read.serial, read.reserved, read.trailer) == (row["serial"], row["reserved"], b"")
    assert read.code == (row["function_id"] if row["kind"] == "request" else row["return_code"])
    wanted = [of_row(argument) for argument in row["arguments"]]
    assert [item.type for item in read.arguments] == [item.type for item in wanted]
    for item, printed in zip(read.arguments, wanted, strict=True):
        # The documents print about seven digits.
        assert item.value == pytest.approx(printed.value) if item.type & ARRAY else same(item, printed)
    assert same(decode(data, crc=crc).arguments, [item.plain for item in read.arguments])


@EACH
def test_a_printed_packet_is_encoded_byte_by_byte(row):
    data, crc = bytes.fromhex(row["hex"]), row["transport"] == "com"
    assert encode(decode(data, exact=True, crc=crc), crc=crc) == data
    written = encode(
        Packet(
            row["serial"],
            row["function_id"] if row["kind"] == "request" else row["return_code"],
            [of_row(argument) for argument in row["arguments"]],
            row["reserved"],
        ),
        crc=crc,
    )
    if not any("R8" in argument["type"] or "R4" in argument["type"] for argument in row["arguments"]):
        assert written == data


@pytest.mark.parametrize("row", [row for row in PRINTED if row["transport"] == "com"], ids=lambda row: str(row["line"]))
def test_the_crc_of_a_serial_line(row):
    data = bytes.fromhex(row["hex"])
    assert struct.unpack_from("<H", data, len(data) - 3)[0] == checksum(data[1:-3])
    for position in range(1, len(data) - 1):
        corrupted = bytearray(data)
        corrupted[position] ^= 0x40
        with pytest.raises(ProtocolError):
            check_frame(bytes(corrupted), crc=True)


def test_the_crc_is_ccitt():
    """CRC-CCITT with initial value 0xFFFF, not reflected: its check value is well known."""
    assert checksum(b"123456789") == 0x29B1
    assert checksum(b"") == 0xFFFF


# --- one packet -------------------------------------------------------------------------------------------------------


def test_the_smallest_packet():
    data = bytes.fromhex("01 10000000 0100 0000 02000000 0000 04")
    assert pack(1, 2, 0, b"") == data
    assert encode(Packet(1, 2)) == data
    assert decode(data) == Packet(1, 2, [], 0, b"")
    assert len(data) == packet.OVERHEAD


@given(
    st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1), st.lists(variants(), max_size=5), st.integers(0, 2**16 - 1),
    st.binary(max_size=9), st.booleans(),
)  # fmt: skip
def test_any_packet_both_ways(serial, code, arguments, reserved, trailer, crc):
    data = encode(Packet(serial, code, arguments, reserved, trailer), crc=crc)
    assert struct.unpack_from("<I", data, 1)[0] == len(data)
    again = decode(data, exact=True, crc=crc)
    assert (again.serial, again.code, again.reserved, again.trailer) == (serial, code, reserved, trailer)
    assert same(again.arguments, arguments)


def test_plain_arguments():
    written = Packet(7, 102, [3, "P1", None, [1.0, 2.0]], 6)
    assert decode(encode(written)) == written


def test_an_argument_that_cannot_be_sent():
    with pytest.raises(InvalidValue):
        encode(Packet(1, 1, [{}]))


@pytest.mark.parametrize("code", [-1, 2**32])
def test_a_code_is_unsigned(code):
    with pytest.raises(struct.error):
        pack(1, code, 0, b"")


GOOD = encode(Packet(1, 9, [2, "IO150", ""]))


@pytest.mark.parametrize(
    "corrupted",
    [b"", b"\1", GOOD[:-1], GOOD + b"\4", b"\2" + GOOD[1:], GOOD[:-1] + b"\5", GOOD[1:], GOOD * 2, b"\0" * 16,
     GOOD[:1] + b"\x43" + GOOD[2:]],
)  # fmt: skip
def test_invalid_packets(corrupted):
    for check in (check_frame, decode):
        with pytest.raises(ProtocolError, match=rf"{len(corrupted)} bytes .* are not a packet") as caught:
            check(corrupted)
        assert (caught.value.code, caught.value.fatal) == (hresult.E_INVALIDRCVPACKET, True)
    i18n.use("ja")
    with pytest.raises(ProtocolError, match="パケットではありません"):
        decode(corrupted)


def test_with_crc_a_packet_is_two_bytes_longer():
    check_frame(encode(Packet(1, 2)))
    with pytest.raises(ProtocolError, match="are not a packet"):
        check_frame(encode(Packet(1, 2)), crc=True)
    check_frame(encode(Packet(1, 2), crc=True), crc=True)


def test_the_error_of_a_wrong_crc_contains_the_correct_one():
    data = bytearray(encode(Packet(1, 2), crc=True))
    right = data[-3:-1].hex()
    data[-2] ^= 1
    with pytest.raises(ProtocolError, match=rf"CRC {data[-3:-1].hex()} is wrong, expected {right}") as caught:
        decode(bytes(data), crc=True)
    assert not caught.value.fatal
    i18n.use("ja")
    with pytest.raises(ProtocolError, match="正しくは"):
        decode(bytes(data), crc=True)


@pytest.mark.parametrize("count", [4, 5, 6, 7, 65535])
def test_a_count_that_exceeds_the_bytes(count):
    data = bytearray(GOOD)
    struct.pack_into("<H", data, 13, count)
    with pytest.raises(ProtocolError) as caught:
        decode(bytes(data))
    assert (caught.value.code, caught.value.fatal) == (hresult.E_INVALIDRCVPACKET, False)
    if count > 5:
        assert f"{count} arguments do not fit into 52 bytes" in str(caught.value)
    i18n.use("ja")
    with pytest.raises(ProtocolError):
        decode_arguments(bytes(data), count, len(data) - 1)


def test_a_count_that_is_too_small_leaves_a_trailer():
    data = bytearray(GOOD)
    struct.pack_into("<H", data, 13, 1)
    read = decode(bytes(data))
    assert read.arguments == [2]
    assert read.trailer == GOOD[29:-1]


def test_the_position_of_an_invalid_argument():
    data = bytearray(GOOD)
    struct.pack_into("<I", data, 29, 999)
    with pytest.raises(ProtocolError, match="argument length 999 at offset 29"):
        decode(bytes(data))
    struct.pack_into("<I", data, 29, 20)
    struct.pack_into("<H", data, 33, 99)
    with pytest.raises(ProtocolError, match="unknown type VT_99") as caught:
        decode(bytes(data))
    assert caught.value.code == hresult.E_INVALIDARGTYPE


def test_limits_of_one_packet():
    long = encode(Packet(1, 2, ["x" * 100]))
    with pytest.raises(LimitExceeded, match="packet of 230 bytes exceeds the limit of 229") as caught:
        decode(long, PacketLimits(packet=229))
    assert (caught.value.code, caught.value.fatal) == (hresult.E_PACKETSIZEOVER, True)
    assert decode(long, PacketLimits(packet=230)).arguments == ["x" * 100]
    with pytest.raises(LimitExceeded, match="nested deeper than 1"):
        decode(encode(Packet(1, 2, [[[1, None], None]])), PacketLimits(depth=1))


# --- a stream ---------------------------------------------------------------------------------------------------------

STREAM = [bytes.fromhex(row["hex"]) for row in PRINTED if row["transport"] == "tcp"]


def frames(framer: Framer, data: bytes, found: list[bytes] | None = None) -> list[bytes]:
    """Return the packets in a piece of data; ``found`` also receives those before an error."""
    found = [] if found is None else found
    frame = framer.feed(data)
    while frame is not None:
        found.append(frame)
        frame = framer.next_frame()
    return found


def test_one_complete_packet_is_returned_without_a_copy():
    framer = Framer()
    for data in STREAM:
        assert framer.feed(data) is data
        assert framer.next_frame() is None
        assert framer.pending == 0


def test_one_byte_at_a_time():
    framer = Framer()
    for data in STREAM:
        for position, byte in enumerate(data[:-1], 1):
            assert framer.feed(bytes([byte])) is None
            assert framer.pending == position
        assert framer.feed(data[-1:]) == data
        assert framer.pending == 0


def test_many_packets_at_once():
    framer = Framer()
    assert frames(framer, b"".join(STREAM)) == STREAM
    assert (framer.pending, framer.skipped_bytes) == (0, 0)


def test_a_packet_and_the_start_of_the_next():
    framer = Framer()
    for one, other in pairwise(STREAM):
        assert frames(framer, one + other[:7]) == [one]
        assert frames(framer, other[7:]) == [other]


def test_nothing_at_all():
    framer = Framer()
    assert framer.feed(b"") is None
    assert framer.next_frame() is None


@given(st.lists(st.sampled_from(STREAM), max_size=8), st.data())
def test_split_anywhere(packets, data):
    stream = b"".join(packets)
    framer, found = Framer(), []
    for chunk in chunks(stream, data):
        found += frames(framer, chunk)
    assert found == packets
    assert (framer.pending, framer.skipped_bytes) == (0, 0)


def chunks(stream: bytes, data: st.DataObject) -> list[bytes]:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    return [stream[start:end] for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)]


@given(st.lists(st.sampled_from(STREAM), max_size=6), st.binary(min_size=1, max_size=12), st.data())
def test_anything_but_soh_after_a_packet_is_refused(packets, junk, data):
    """No packet after it is accepted, regardless of when the error is detected."""
    if junk[0] == SOH:
        junk = b"\0" + junk
    stream = b"".join(packets) + junk + b"".join(STREAM)
    framer, found, errors = Framer(), [], []
    for chunk in chunks(stream, data):
        try:
            frames(framer, chunk, found)
        except ProtocolError as error:
            errors.append(error)
    assert errors
    assert {(error.code, error.fatal) for error in errors} == {(hresult.E_INVALIDRCVPACKET, True)}
    assert all(f"a packet must begin with SOH 01, not {junk[0]:02x}" in str(error) for error in errors)
    assert found == packets
    assert framer.pending == 0


@pytest.mark.parametrize(
    ("junk", "shown"),
    [
        (b"\0", r"'\x00' is not b-CAP: a packet must begin with SOH 01, not 00"),
        (b"\x1b[2J\r\n\xff", r"'\x1b[2J\r\n\xff' is not b-CAP: a packet must begin with SOH 01, not 1b"),
        (b"\x16\3\1" + bytes(500), r"'\x16\x03\x01" + r"\x00" * 29 + "'... is not b-CAP"),
        (b"POST / HTTP/1.1\r\nHost: a\r\n", r"'POST / HTTP/1.1\r\nHost: a\r\n' is not b-CAP"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "not 48. This is HTTP. Try: use an http:// address"),
        (b"OPTIONS * HTTP/1.1\r\n", "not 4f. This is HTTP. Try: use an http:// address"),
    ],
)
def test_invalid_bytes_are_quoted_in_short(junk, shown):
    lost(Framer(), junk, re.escape(shown))
    i18n.use("ja")
    lost(Framer(), junk, "は b-CAP ではありません")


def test_invalid_bytes_are_not_buffered():
    framer = Framer()
    for _ in range(100):
        lost(framer, b"\xff" * 10_000, "is not b-CAP")
        assert framer.pending == 0


def lost(framer: Framer, data: bytes, match: str, code: int = hresult.E_INVALIDRCVPACKET) -> None:
    with pytest.raises(ProtocolError, match=match) as caught:
        frames(framer, data)
    assert (caught.value.code, caught.value.fatal) == (code, True)


@pytest.mark.parametrize("length", [0, 1, 15])
def test_a_length_that_no_packet_can_have(length):
    data = b"\1" + struct.pack("<I", length) + GOOD[5:]
    lost(Framer(), data, f"packet of {length} bytes is below the minimum of 16 bytes")
    lost(Framer(), data[:5], f"packet of {length} bytes is below the minimum of 16 bytes")
    i18n.use("ja")
    lost(Framer(), data, f"パケット長 {length} バイトは最小の 16 バイト未満です")


@pytest.mark.parametrize("length", [2**24 + 1, 2**31, 2**32 - 1])
def test_a_length_beyond_the_limit_is_refused_immediately(length):
    """VE026A table 3-5: 16 MBytes."""
    framer = Framer()
    lost(
        framer,
        b"\1" + struct.pack("<I", length),
        f"packet of {length} bytes exceeds the limit of 16777216",
        hresult.E_PACKETSIZEOVER,
    )
    assert framer.pending == 0


def test_a_packet_of_16_mib_is_accepted():
    body = argument_of(2**24 - 16)
    data = pack(1, 102, 1, body)
    assert len(data) == 2**24
    framer = Framer()
    assert framer.feed(data[:-1]) is None
    assert framer.feed(data[-1:]) == data
    assert Framer().feed(data) is data
    assert len(decode(data).arguments[0]) == 2**24 - 26
    over = pack(1, 102, 1, argument_of(2**24 - 15))
    lost(Framer(), over, "packet of 16777217 bytes", hresult.E_PACKETSIZEOVER)


def argument_of(size: int) -> bytes:
    """Return an argument of a given size: a VT_UI1 array."""
    return struct.pack("<IHI", size - 4, VarType.UI1 | ARRAY, size - 10) + bytes(size - 10)


def test_a_packet_of_16_mib_byte_by_byte_at_its_end():
    """Buffered data is not copied or searched again with every byte."""
    data = pack(1, 102, 1, argument_of(2**24 - 16))
    framer = Framer()
    assert framer.feed(data[:-10_000]) is None
    for position in range(len(data) - 10_000, len(data) - 1):
        assert framer.feed(data[position : position + 1]) is None
    assert framer.feed(data[-1:]) == data


def test_a_wrong_terminator():
    data = GOOD[:-1] + b"\5"
    lost(Framer(), data, f"a packet of {len(data)} bytes must end with EOT 04, not 05")
    lost(Framer(), GOOD + data + GOOD, "must end with EOT 04, not 05")
    i18n.use("ja")
    lost(Framer(), data, "末尾が EOT 04 ではなく 05")


@pytest.mark.parametrize(
    ("corrupted", "code"),
    [
        (GOOD[:-1] + b"\5", hresult.E_INVALIDRCVPACKET),
        (b"\1\0\0\0\0", hresult.E_INVALIDRCVPACKET),
        (b"\1\xff\xff\xff\xff", hresult.E_PACKETSIZEOVER),
    ],
)
def test_a_stream_with_an_error_stays_unusable(corrupted, code):
    framer = Framer()
    for data in (corrupted, GOOD, b"", b"\0" * 1000, GOOD * 100):
        lost(framer, data, "packet", code)
        assert framer.pending == 0
    with pytest.raises(ProtocolError):
        framer.next_frame()


def test_packets_before_an_invalid_one_are_returned():
    framer = Framer()
    assert framer.feed(GOOD + GOOD + b"\1\0\0\0\0") == GOOD
    assert framer.next_frame() == GOOD
    with pytest.raises(ProtocolError):
        framer.next_frame()


def test_the_limit_can_be_set():
    framer = Framer(PacketLimits(packet=len(GOOD)))
    assert framer.feed(GOOD) is GOOD
    lost(framer, encode(Packet(1, 2, ["x" * 100])), f"exceeds the limit of {len(GOOD)} bytes", hresult.E_PACKETSIZEOVER)


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_any_stream_gives_packets_or_one_error(chunks_of_noise):
    framer, errors = Framer(), []
    for chunk in chunks_of_noise:
        try:
            for frame in frames(framer, chunk):
                assert not errors
                check_frame(frame)
        except ProtocolError as error:
            errors.append(error)
    assert len(set(errors)) <= 1
    assert all(error.fatal for error in errors)


def test_variant_and_plain_of_the_same_packet():
    data = encode(Packet(1, 102, [3, Variant(VarType.I2, 5)]))
    assert decode(data).arguments == [3, 5]
    assert decode(data, exact=True).arguments == [variant(3), Variant(VarType.I2, 5)]


def test_packets_are_compared_and_shown():
    one = Packet(5, 101, [3], 7, b"x")
    assert repr(one) == "Packet(serial=5, code=101, arguments=[3], reserved=7, trailer=b'x')"
    assert one == Packet(5, 101, [3], 7, b"x")
    for other in (Packet(6, 101, [3], 7, b"x"), Packet(5, 101, [3], 7), "Packet", None):
        assert one != other
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)
