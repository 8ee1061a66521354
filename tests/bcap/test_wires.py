"""Packets in datagrams and on serial lines: packets found between noise, and bytes skipped."""

from __future__ import annotations

import json
import random
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.actions import Continue, Execute
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LEAST_ON_LINE, LINE, LONGEST_ON_LINE, STREAM, DatagramFramer, line_profile
from orinkit.bcap.requests import encode_request
from orinkit.bcap.serial_framer import LEAST, LineFramer
from orinkit.bcap.server import ServerConversation
from orinkit.cao import functions as f
from orinkit.cao.dialect import DIALECTS, VE026A
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.core.errors import InvalidValue, LimitExceeded
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits, decode, encode_variant
from orinkit.values.variant import ARRAY, Variant, VarType
from support.paths import VECTORS

pytestmark = pytest.mark.core

PACKETS = json.loads((VECTORS / "bcap-packets.json").read_text())
OF_VE026A = [each for each in PACKETS if each["transport"] == "com"]
ON_A_LINE = LINE.bound(DEFAULT_LIMITS)
WHOLE = packet.encode(Packet(7, 101, [3], 7), crc=True)


def frames(framer, *pieces):
    found = []
    for piece in pieces:
        frame = framer.feed(piece)
        while frame is not None:
            found.append(frame)
            frame = framer.next_frame()
    return found


def all_frames(framer, *pieces):
    """Return all packets, with silence after each piece, for any noise."""
    found = []

    def collect(take):
        while True:
            try:
                frame = take()
            except LimitExceeded:
                frame = framer.next_frame()
            if frame is None:
                return
            found.append(frame)
            take = framer.next_frame

    for piece in pieces:
        collect(partial(framer.feed, piece))
        while framer.pending:
            collect(framer.discard_incomplete)
    return found


# --- transport profiles -----------------------------------------------------------------------------------------------


def test_the_profiles():
    assert [wire.name for wire in (STREAM, DATAGRAM, LINE)] == ["tcp", "udp", "serial"]
    assert (STREAM.tail, DATAGRAM.tail, LINE.tail) == (1, 1, 3)
    assert DATAGRAM.packet == 503
    assert STREAM.bound(DEFAULT_LIMITS) is DEFAULT_LIMITS
    assert DATAGRAM.bound(DEFAULT_LIMITS) == PacketLimits(packet=503)
    assert DATAGRAM.bound(PacketLimits(packet=100)).packet == 100


def test_a_stream_never_abandons_an_incomplete_packet():
    framer = STREAM.framer(DEFAULT_LIMITS)
    assert framer.feed(WHOLE[:6]) is None
    assert framer.discard_incomplete() is None
    assert (framer.pending, framer.partial_serial) == (6, 0)


# --- datagrams --------------------------------------------------------------------------------------------------------


def test_a_datagram_is_one_packet_or_nothing():
    framer = DatagramFramer()
    good = packet.encode(Packet(7, 101, [3]))
    assert framer.feed(good) == good
    for bad in (b"", good[:-1], good + b"\x04", good + good, b"\x00" + good[1:], good[:-1] + b"\x05", b"\x01" * 16):
        assert framer.feed(bad) is None
    assert framer.skipped_bytes > 0
    assert framer.next_frame() is None
    assert framer.discard_incomplete() is None
    assert framer.pending == 0


def test_a_datagram_that_is_too_long_is_reported():
    long = packet.encode(Packet(7, 111, ["x" * 400]))
    assert len(long) > 503
    assert DatagramFramer(PacketLimits(packet=503)).feed(long) == long


# --- serial lines -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("each", OF_VE026A, ids=lambda each: f"{each['line']}")
def test_every_packet_of_the_ve026a_document(each):
    data = bytes.fromhex(each["hex"])
    assert frames(LineFramer(ON_A_LINE), data) == [data]
    assert frames(LineFramer(ON_A_LINE), *(bytes([byte]) for byte in data)) == [data]
    read = packet.decode(data, exact=True, crc=True)
    assert packet.encode(read, crc=True) == data
    if each["kind"] == "request":
        function = FUNCTIONS[read.code]
        plain = [value if argument.vt is VarType.VARIANT else value.value
                 for argument, value in zip(function.arguments, read.arguments, strict=False)]  # fmt: skip
        assert encode_request(function, tuple(plain), read.serial, read.reserved, crc=True, vt_error_size=2) == data
    else:
        body = b"".join(encode_variant(value, 2) for value in read.arguments)
        assert packet.pack(read.serial, read.code, len(read.arguments), body, read.reserved, crc=True) == data


@given(before=st.binary(max_size=40), between=st.binary(max_size=40), cut=st.integers(0, 200))
def test_packets_are_found_between_noise(before, between, cut):
    """Any noise lies between them; a packet that seems to be in the noise is found when the line is silent."""
    stream = before + WHOLE + between + WHOLE
    framer = LINE.server_framer(ON_A_LINE)
    found = all_frames(framer, stream[:cut]) if cut < len(before) else []
    found += all_frames(framer, stream[cut:] if cut < len(before) else stream)
    assert found.count(WHOLE) == 2


def test_noise_inside_a_packet_costs_that_packet_only():
    rng = random.Random(5)
    for _ in range(300):
        place = rng.randrange(1, len(WHOLE))
        noise = rng.randbytes(rng.randrange(1, 4))
        broken = WHOLE[:place] + noise + WHOLE[place + rng.randrange(2) :]
        found = all_frames(LineFramer(ON_A_LINE), broken, WHOLE)
        assert found[-1] == WHOLE
        assert len(found) <= 2


def test_a_packet_with_a_wrong_crc_is_skipped():
    broken = bytearray(WHOLE)
    broken[-2] ^= 1
    framer = LineFramer(ON_A_LINE)
    assert all_frames(framer, bytes(broken) + WHOLE) == [WHOLE]
    assert framer.skipped_bytes == len(WHOLE)


def test_a_length_caused_by_noise_delays_packets_until_silence():
    framer = LineFramer(ON_A_LINE)
    noise = b"\x01\xff\x00\x00\x00"
    assert frames(framer, noise + WHOLE) == []
    assert framer.pending == len(noise) + len(WHOLE)
    assert framer.discard_incomplete() == WHOLE
    assert framer.pending == 0
    assert framer.discard_incomplete() is None


def test_an_incomplete_packet_is_abandoned_after_silence():
    framer = LineFramer(ON_A_LINE)
    assert frames(framer, WHOLE[:9]) == []
    assert framer.discard_incomplete() is None
    assert framer.pending == 0
    assert frames(framer, WHOLE) == [WHOLE]


@pytest.mark.parametrize("length", [0, 1, 16, LEAST - 1])
def test_a_length_that_no_packet_has(length):
    assert frames(LineFramer(ON_A_LINE), b"\x01" + length.to_bytes(4, "little") + WHOLE) == [WHOLE]


def test_a_request_that_is_announced_too_long():
    framer = LINE.server_framer(PacketLimits(packet=1000))
    head = packet.HEADER.pack(1, 1001, 5, 5, 64, 3)
    assert framer.feed(head[:10]) is None
    with pytest.raises(LimitExceeded) as caught:
        framer.feed(head[10:])
    assert caught.value.code == hresult.E_PACKETSIZEOVER
    assert not caught.value.fatal
    assert frames(framer, WHOLE) == [WHOLE]


@pytest.mark.parametrize("head", [(1, 9999, 0, 0, 64, 3), (1, 9999, 5, 5, 138, 3), (1, 9999, 5, 5, 64, 9)])
def test_noise_that_looks_like_a_long_packet_is_noise(head):
    for framer in (LineFramer(PacketLimits(packet=1000)), LINE.server_framer(PacketLimits(packet=1000))):
        assert frames(framer, packet.HEADER.pack(*head) + WHOLE) == [WHOLE]


def test_repeated_announcements_are_reported_once():
    framer = LINE.server_framer(PacketLimits(packet=1000))
    noise = (b"\x01" + b"\x01" * 7) * 20 + b"\x00" * 40
    with pytest.raises(LimitExceeded):
        framer.feed(packet.HEADER.pack(1, 0x01010101, 1, 1, 1, 1) * 10 + noise)
    assert all_frames(framer, WHOLE) == [WHOLE]
    with pytest.raises(LimitExceeded):
        framer.feed(packet.HEADER.pack(1, 1001, 5, 5, 64, 3))


def test_a_client_takes_it_for_noise():
    assert frames(LineFramer(PacketLimits(packet=1000)), packet.HEADER.pack(1, 1001, 5, 5, 64, 3) + WHOLE) == [WHOLE]


def test_noise_that_is_slow_to_search_is_discarded():
    """Beginnings of packets within packets, none of them valid: the buffer is discarded before the search costs more."""
    size = 60_000
    noise = (b"\x01" + (size - 0).to_bytes(4, "little") + b"\x04" * 3) * (size // 8)
    framer = LineFramer(PacketLimits(packet=65536))
    assert frames(framer, noise * 3) == []
    assert framer.skipped_bytes >= size
    while framer.pending:
        framer.discard_incomplete()
    assert frames(framer, WHOLE) == [WHOLE]


def test_the_search_in_an_incomplete_packet_is_limited():
    header = b"\x01" + (50_000).to_bytes(4, "little")
    inner = b"\x01" + (4000).to_bytes(4, "little") + b"\x04" * 3
    framer = LineFramer(ON_A_LINE)
    assert frames(framer, header + inner * 5000) == []
    pending = framer.pending
    assert framer.resync() is None
    assert framer.pending == 0
    assert framer.skipped_bytes >= pending
    assert frames(framer, WHOLE) == [WHOLE]


@pytest.mark.parametrize("noise", [b"\x01" * 3000, b"\x01\x12\0\0\0" * 3000])
def test_a_server_searches_in_slices(noise):
    server = ServerConversation(profile=LINE)
    actions = list(server.receive(noise + WHOLE, 1.0))
    while server.discardable_bytes:
        actions += server.discard_incomplete(2.0)
    assert len([each for each in actions if isinstance(each, Continue)]) > 3
    (call,) = (each for each in actions if isinstance(each, Execute))
    assert (call.serial, call.function_id) == (7, 101)


# --- the dialect ------------------------------------------------------------------------------------------------------


def test_dialects():
    assert DIALECTS["ve026a"] is VE026A
    assert VE026A.code_replacements[hresult.E_BUSY_PROC] == hresult.E_ROBOTISBUSY


@pytest.mark.parametrize(("vt", "value"), [(VarType.ERROR, 0x600B), (VarType.ERROR | ARRAY, [1, 2, 0xFFFF])])
def test_a_short_error(vt, value):
    """VE026A table 3-1."""
    short = PacketLimits(vt_error_size=2)
    data = encode_variant(Variant(vt, value), 2)
    assert decode(data, limits=short) == (value, len(data))
    assert len(data) == len(encode_variant(Variant(vt, value))) - 2 * (len(value) if vt & ARRAY else 1)
    nested = Variant(VarType.VARIANT | ARRAY, [Variant(vt, value), Variant(VarType.I2, 3)])
    assert decode(encode_variant(nested, 2), limits=short)[0] == [value, 3]
    assert decode(data, limits=short, exact=True)[0] == Variant(vt, value)


def test_an_error_that_is_too_long_for_a_short_one():
    with pytest.raises(InvalidValue, match="2 bytes"):
        encode_variant(Variant(VarType.ERROR, 0x80004005), 2)


def test_a_request_with_a_short_error():
    code = Variant(VarType.ERROR, 0x600B)
    sent = encode_request(f.controller_execute, (1, "ClearError", code), 5, 5, crc=True, vt_error_size=2)
    assert packet.decode(sent, PacketLimits(vt_error_size=2), exact=True, crc=True).arguments[2] == code
    with pytest.raises(InvalidValue, match="Controller_Execute"):
        encode_request(f.controller_execute, (1, "ClearError", Variant(VarType.ERROR, 1 << 20)), 5, vt_error_size=2)


def test_the_packet_size_of_a_serial_line_can_be_set():
    assert line_profile(LONGEST_ON_LINE) is LINE
    for longest in (LEAST_ON_LINE, 503):
        profile = line_profile(longest)
        assert profile.bound(DEFAULT_LIMITS).packet == longest
        assert (profile.crc, profile.lossy, profile.shared, profile.timeout) == (True, True, True, LINE.timeout)
    for wrong in (LEAST_ON_LINE - 1, LONGEST_ON_LINE + 1, 0, True, 503.0):
        with pytest.raises(InvalidValue, match="serial_packet"):
            line_profile(wrong)


def test_a_framer_is_empty_if_no_packet_is_incomplete():
    for profile in (LINE, STREAM):
        framer = profile.framer(DEFAULT_LIMITS)
        assert framer.is_empty
        assert framer.feed(WHOLE[:9]) is None
        assert not framer.is_empty
        assert framer.feed(WHOLE[9:]) == WHOLE
        assert framer.is_empty
    datagrams = DATAGRAM.framer(DEFAULT_LIMITS)
    assert datagrams.feed(WHOLE[:9]) is None
    assert datagrams.is_empty, "an incomplete datagram is dropped"
