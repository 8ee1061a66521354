"""pcapng files: blocks and headers, sequence numbers and checksums, read here and by tshark."""

from __future__ import annotations

import struct
from ipaddress import ip_address

import pytest

from orinkit.bcap.pcapng import LONGEST_DATAGRAM, LONGEST_SEGMENT, CaptureConnection, PcapngWriter
from orinkit.core.errors import InvalidValue
from support.tshark import START, TCP, UDP, Sent, Tshark, needs_tshark

TCP6 = CaptureConnection("tcp", ("2001:db8::1", 50000), ("2001:db8::2", 5007))
UDP6 = CaptureConnection("udp", ("::1", 50000), ("::1", 5007))
CONNECTIONS = [TCP, UDP, TCP6, UDP6]


def written(*packets: Sent) -> list[tuple[int, bytes]]:
    """Return the blocks of a file: type and body."""
    parts: list[bytes] = []
    writer = PcapngWriter(parts.append)
    for number, (direction, data, connection) in enumerate(packets):
        writer.packet(START + number, direction, data, connection=connection)
    content, blocks = b"".join(parts), []
    while content:
        kind, size = struct.unpack_from("<II", content)
        assert size % 4 == 0
        assert struct.unpack_from("<I", content, size - 4) == (size,)
        blocks.append((kind, content[8 : size - 4]))
        content = content[size:]
    return blocks


def frames(*packets: Sent) -> list[bytes]:
    """Return the IP packets in a file."""
    found = []
    for kind, body in written(*packets)[2:]:
        assert kind == 6
        interface, _, _, size, original = struct.unpack_from("<IIIII", body)
        assert (interface, size) == (0, original)
        found.append(body[20 : 20 + size])
    return found


def word_sum(data: bytes) -> int:
    """Return the ones' complement sum of RFC 1071, word by word."""
    total = 0
    for (word,) in struct.iter_unpack(">H", data + b"\0" * (len(data) % 2)):
        total += word
        total = (total & 0xFFFF) + (total >> 16)
    return total


@pytest.mark.core
def test_a_file_begins_with_a_section_and_an_interface():
    (section, header), (interface, description) = written()
    assert (section, interface) == (0x0A0D0D0A, 1)
    assert struct.unpack_from("<IHHq", header) == (0x1A2B3C4D, 1, 0, -1)
    assert b"orinkit" in header
    assert struct.unpack_from("<HHI", description) == (101, 0, 0)
    assert description[8:13] == struct.pack("<HHB", 9, 1, 9)  # if_tsresol: nanoseconds


@pytest.mark.core
def test_a_packet_has_its_time_and_its_direction():
    _, _, (_, sent), (_, received) = written((">", b"data", UDP), ("<", b"data", UDP))
    high, low = struct.unpack_from("<II", received, 4)
    assert high << 32 | low == START + 1
    assert (sent[-8:-4], received[-8:-4]) == (struct.pack("<I", 2), struct.pack("<I", 1))


@pytest.mark.core
@pytest.mark.parametrize("connection", CONNECTIONS)
@pytest.mark.parametrize("data", [b"\x01", b"even", b"odd", bytes(1000), b"\xff" * 999])
def test_headers_have_correct_addresses_and_checksums(connection, data):
    for direction, (source, target) in {
        ">": (connection.local, connection.remote),
        "<": (connection.remote, connection.local),
    }.items():
        (frame,) = frames((direction, data, connection))
        addresses = ip_address(source[0]).packed + ip_address(target[0]).packed
        if frame[0] == 0x45:
            assert word_sum(frame[:20]) == 0xFFFF
            head, (size,) = 20, struct.unpack_from(">H", frame, 2)
            assert size == len(frame)
            protocol = frame[9]
        else:
            head, (size,) = 40, struct.unpack_from(">H", frame, 4)
            assert size == len(frame) - 40
            protocol = frame[6]
        assert frame[head - len(addresses) : head] == addresses
        content = frame[head:]
        assert word_sum(addresses + struct.pack(">II", len(content), protocol) + content) == 0xFFFF
        assert struct.unpack_from(">HH", content) == (source[1], target[1])
        assert protocol == {"tcp": 6, "udp": 17}[connection.transport]
        assert content.endswith(data)


@pytest.mark.core
def test_a_datagram_whose_checksum_would_be_0_has_the_checksum_ffff():
    places = (("127.0.0.1", 0), ("127.0.0.1", 0))
    connection = CaptureConnection("udp", *places)
    rest = 0xFFFF - word_sum(b"\x7f\0\0\1" * 2 + struct.pack(">II", 10, 17) + struct.pack(">HHHH", 0, 0, 10, 0))
    (frame,) = frames((">", struct.pack(">H", rest), connection))
    assert frame[26:28] == b"\xff\xff"


@pytest.mark.core
def test_sequence_and_acknowledgement_numbers_count_bytes():
    exchange = [
        (">", b"abc", TCP),
        ("<", b"12345", TCP),
        (">", b"d", TCP),
        (">", b"", TCP),
        ("<", b"6", TCP),
        (">", b"e", TCP6),
    ]
    numbers = [struct.unpack_from(">II", frame, (20 if frame[0] == 0x45 else 40) + 4) for frame in frames(*exchange)]
    assert numbers == [(1, 1), (1, 4), (4, 6), (6, 5), (1, 1)]


@pytest.mark.core
def test_large_data_is_divided_into_segments():
    data = bytes(range(256)) * 600
    found = frames((">", data, TCP), (">", data[:LONGEST_SEGMENT], TCP))
    assert [len(frame) for frame in found] == [65535, 65535, len(data) - 2 * LONGEST_SEGMENT + 40, 65535]
    assert b"".join(frame[40:] for frame in found[:3]) == data
    assert [frame[33] for frame in found] == [0x10, 0x10, 0x18, 0x18]  # PSH in the last segment of each packet


@pytest.mark.core
def test_invalid_values_are_refused():
    writer = PcapngWriter(lambda _data: None)
    with pytest.raises(InvalidValue, match="65508 bytes exceed the limit of 65507 bytes of a datagram"):
        writer.packet(START, ">", bytes(LONGEST_DATAGRAM + 1), connection=UDP)
    with pytest.raises(InvalidValue, match="must be > or <, not 'sent'"):
        writer.packet(START, "sent", b"", connection=UDP)
    with pytest.raises(InvalidValue, match="'localhost' is not an IP address"):
        CaptureConnection("tcp", ("localhost", 1), ("127.0.0.1", 2))
    with pytest.raises(InvalidValue, match="different IP versions"):
        CaptureConnection("tcp", ("::1", 1), ("127.0.0.1", 2))
    with pytest.raises(InvalidValue, match="port 65536 must be 0 to 65535"):
        CaptureConnection("tcp", ("::1", 1), ("::1", 65536))
    with pytest.raises(InvalidValue, match="not 'com'"):
        CaptureConnection("com", ("::1", 1), ("::1", 2))


@needs_tshark
def test_tshark_reads_times_directions_and_checksums_without_a_complaint(tmp_path):
    """16 MB in segments, both directions, IPv4 and IPv6: nothing is missing, repeated or wrong for the analysis of TCP."""
    packets = [
        (way, data, connection) for data in (b"x" * 5, b"y" * 200_000) for connection in (TCP, TCP6) for way in "><>"
    ]
    packets += [(way, b"z" * LONGEST_DATAGRAM, connection) for connection in (UDP, UDP6) for way in "><"]
    packets.append((">", bytes(16 * 1024 * 1024), TCP))
    capture = tmp_path / "capture.pcapng"
    with capture.open("wb") as file:
        writer = PcapngWriter(file.write)
        for number, (direction, data, connection) in enumerate(packets):
            writer.packet(START + number, direction, data, connection=connection)
    fields = [
        "frame.time_epoch", "frame.packet_flags_direction", "ip.checksum.status", "tcp.checksum.status",
        "udp.checksum.status", "tcp.analysis.flags", "_ws.expert", "tcp.len",
    ]  # fmt: skip
    options = [option for name in ("ip", "tcp", "udp") for option in ("-o", f"{name}.check_checksum:TRUE")]
    selected = [option for name in fields for option in ("-e", name)]
    output = Tshark(tmp_path).run(capture, "--disable-protocol", "bcap", *options, "-T", "fields", *selected)
    rows = [dict(zip(fields, line.split("\t"), strict=True)) for line in output.splitlines()]
    assert rows[0]["frame.time_epoch"] == "1700000000.000000000"
    assert rows[-1]["frame.time_epoch"] == f"1700000000.{len(packets) - 1:09d}"
    assert [int(row["frame.packet_flags_direction"], 16) for row in rows[:3]] == [2, 1, 2]
    assert {row["ip.checksum.status"] for row in rows} == {"1", ""}
    assert {row["tcp.checksum.status"] or row["udp.checksum.status"] for row in rows} == {"1"}
    assert {row["tcp.analysis.flags"] + row["_ws.expert"] for row in rows} == {""}
    assert sum(int(row["tcp.len"] or 0) for row in rows) == sum(
        len(data) for _, data, each in packets if each in (TCP, TCP6)
    )
