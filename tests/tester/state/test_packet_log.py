"""The log of packets."""

from __future__ import annotations

from orinkit.tester.state.packet_log import PacketLog


def filled(count: int, **limits: int) -> PacketLog:
    log = PacketLog(**limits)
    for number in range(1, count + 1):
        log.add("a", "tcp", ">", number.to_bytes(4, "big"))
    return log


def test_the_oldest_packets_are_discarded():
    log = filled(25, capacity=10)
    assert [packet.number for packet in log] == list(range(16, 26))
    assert (len(log), log.first_number, log.total) == (10, 16, 25)
    assert log.get(15) is None
    assert log.get(26) is None
    assert log.get(16).data == (16).to_bytes(4, "big")


def test_the_number_of_bytes_is_limited():
    log = filled(25, max_bytes=40)
    assert len(log) == 10
    log.add("a", "tcp", ">", bytes(1000))
    assert [len(packet.data) for packet in log] == [1000]


def test_packets_since_a_number():
    log = filled(25, capacity=10)
    assert [packet.number for packet in log.since(22)] == [23, 24, 25]
    assert [packet.number for packet in log.since(0)] == list(range(16, 26))
    assert [packet.number for packet in log.since(0, 2)] == [24, 25]
    assert log.since(25) == []


def test_a_reply_knows_the_request_of_its_connection():
    log = PacketLog()
    log.tracer("a", "tcp")(">", b"request of a")
    log.tracer("b", "udp")(">", b"request of b")
    log.tracer("a", "tcp")("<", b"reply")
    assert log.get(3).request == b"request of a"
    assert log.get(1).request is None
    assert log.last("b", ">").data == b"request of b"
    assert log.last("b", "<") is None


def test_clear_keeps_counting():
    log = filled(3)
    log.clear()
    assert (len(log), log.first_number) == (0, 4)
    log.add("a", "tcp", "<", b"x")
    assert log.get(4).data == b"x"


def test_nothing_is_added_while_recording_is_off():
    log = filled(2)
    log.recording = False
    log.add("a", "tcp", ">", b"x")
    assert log.total == 2
