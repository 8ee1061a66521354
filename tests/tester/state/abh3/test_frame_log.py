"""The log of CAN frames, its filter, and the explanation of frames."""

from __future__ import annotations

import pytest

from orinkit.abh3.table import ids
from orinkit.abh3.table.decoder import Decoder
from orinkit.abh3.table.signals import DIALECTS
from orinkit.abh3.table.transfer_fields import KINDS as CONTROL_KINDS
from orinkit.can.frame import CanFrame
from orinkit.tester.state.abh3.frame_filter import FrameFilter, FrameView
from orinkit.tester.state.abh3.frame_text import KINDS, as_text, detail_of, kind_of, row_of
from orinkit.tester.state.frame_log import EchoFilter, FrameLog

COMMAND = CanFrame(ids.single(1, 2), bytes.fromhex("F4010CFE03300000"))
FEEDBACK = CanFrame(ids.single(2, 1), bytes.fromhex("F401000000000000"))
REQUEST = CanFrame(ids.request(1, 2), ids.pgn(ids.BROADCAST, 42))
VELOCITIES = CanFrame(ids.broadcast(5, 2, 1), bytes(8))
STRANGE = CanFrame(0x18FEF100, bytes(8))
SHORT = CanFrame(ids.single(1, 2), b"\x01")


def filled() -> FrameLog:
    log = FrameLog()
    log.add(">", COMMAND)
    log.add("<", FEEDBACK)
    log.add(">", REQUEST, polled=True)
    log.add("<", VELOCITIES, polled=True)
    log.add("<", STRANGE)
    log.add(">", SHORT)
    return log


def found(log: FrameLog, **conditions: object) -> list[int]:
    view = FrameView(log, FrameFilter(**conditions), Decoder())  # type: ignore[arg-type]  # loosely typed by the table of the test
    while view.advance():
        pass
    return list(view.numbers())


def test_the_oldest_frames_are_discarded():
    log = FrameLog(capacity=10)
    for _ in range(25):
        log.add(">", COMMAND)
    assert (len(log), log.first_number, log.total) == (10, 16, 25)
    assert (log.get(15), log.get(26)) == (None, None)
    assert log.get(16).number == 16  # type: ignore[union-attr]  # it exists here
    assert [each.number for each in log] == list(range(16, 26))
    log.clear()
    assert (len(log), log.first_number, log.cleared, log.start_ns) == (0, 26, 1, 0)
    log.recording = False
    log.add(">", COMMAND)
    assert log.total == 25


def test_the_filter():
    log = filled()
    assert found(log) == [1, 2, 3, 4, 5, 6]
    assert found(log, direction="<") == [2, 4, 5]
    assert found(log, polled=False) == [1, 2, 5, 6]
    assert [found(log, kind=kind) for kind in KINDS] == [[1, 2, 6], [3], [4], [], [5]]
    assert found(log, data=b"\xf4\x01") == [1, 2]
    assert found(log, text="00ef0102") == [1, 6]
    assert found(log, text="A/Y COMMAND = 100.0") == [1]
    assert found(log, text="servo on", direction=">") == [1]


def test_every_frame_of_the_protocol_has_a_kind():
    for number in range(256):
        assert kind_of(CanFrame(number << 16, b"")) in KINDS
    assert kind_of(CanFrame(ids.CONTROL << 16, b"")) == kind_of(CanFrame(ids.TRANSFER << 16, b"")) == "multi"


def test_a_row():
    log, decoder = filled(), Decoder()
    row = row_of(log.get(1), None, "relative", log.start_ns, decoder)  # type: ignore[arg-type]  # loosely typed by the table of the test
    assert row[:5] == [1, "0.000", "00EF0102", ">", "F4 01 0C FE 03 30 00 00"]
    assert row[5].startswith(
        "DP0S 2 -> 1: A/Y command = 100.0 min^-1, B/X command = -100.0 min^-1, inputs = 0x00003003"
    )
    assert row[6:] == ["", []]
    assert row_of(log.get(6), log.get(5), "delta", log.start_ns, decoder)[6:] == ["bad", ["invalid"]]  # type: ignore[arg-type]  # loosely typed by the table of the test


def test_the_fields_cover_the_data_of_every_frame():
    for name, dialect in DIALECTS.items():
        for layout in dialect.layouts.values():
            if layout.broadcast is not None:
                number = ids.broadcast(5, layout.broadcast, 1)
            else:
                number = ids.single(1, 2, dp=layout.dp) if layout.from_host else ids.single(2, 1, dp=layout.dp)
            check(CanFrame(number, bytes(range(8))), Decoder(name), len(layout.fields))
    for kind in CONTROL_KINDS:
        check(CanFrame(ids.CONTROL << 16 | 0x0102, bytes([kind, 20, 0, 3, 3, 0, 0xEF, 0])), Decoder(), None)
    check(CanFrame(ids.TRANSFER << 16 | 0x0102, bytes(range(8))), Decoder(), 2)


def check(frame: CanFrame, decoder: Decoder, count: int | None) -> None:
    detail = detail_of(frame, decoder)
    assert detail.data == frame.id.to_bytes(4, "big") + frame.data
    fields = [each for each in detail.fields if each.offset >= 4]
    assert not any(each.error for each in fields), fields
    if count is not None:
        assert len(fields) == count
        assert b"".join(each.raw for each in fields) == frame.data
    for each in detail.fields:
        assert each.raw == detail.data[each.offset : each.offset + len(each.raw)]
        assert each.name
        assert each.meaning


def test_the_fields_of_the_identifier():
    fields = detail_of(CanFrame(0x08FF2A01, bytes(8)), Decoder()).fields
    assert [(each.offset, len(each.raw), each.meaning) for each in fields[:5]] == [
        (0, 4, "08FF2A01, PGN 0FF2A"),
        (0, 1, "priority 2, DP 0"),
        (1, 1, "FF: Broadcasts (FF)"),
        (2, 1, "group 5, broadcast 2"),
        (3, 1, "1"),
    ]
    assert detail_of(REQUEST, Decoder()).fields[0].meaning == "00EA0102, PGN 0EA00"
    everyone = CanFrame(ids.request(ids.EVERYONE, 2), REQUEST.data)
    assert detail_of(everyone, Decoder()).fields[3].meaning == "all"
    assert [each.meaning for each in detail_of(REQUEST, Decoder()).fields[5:]] == ["BR2", "5"]


@pytest.mark.parametrize("frame", [STRANGE, SHORT, CanFrame(ids.request(1, 2), b""), CanFrame(0x1FFFFFFF, b"")])
def test_a_wrong_frame_is_explained(frame):
    detail = detail_of(frame, Decoder())
    assert any(each.error and each.meaning for each in detail.fields)
    assert all(each.offset + len(each.raw) <= len(detail.data) for each in detail.fields)


def test_the_text_to_copy():
    lines = as_text(filled(), Decoder()).splitlines()
    assert lines[0].partition(" ")[2].startswith("sent 00EF0102#F4010CFE03300000 DP0S 2 -> 1: A/Y command = 100.0")
    assert " received 00EF0201#" in lines[1]
    assert len(lines) == 6


def test_each_echo_is_recognized_once():
    echoes = EchoFilter()
    echoes.sent(COMMAND)
    echoes.sent(COMMAND)
    assert [echoes.is_echo(COMMAND._replace(time=number)) for number in range(3)] == [True, True, False]
    assert not echoes.is_echo(FEEDBACK)
    for _ in range(1000):
        echoes.sent(COMMAND)
    assert sum(echoes.is_echo(COMMAND) for _ in range(1000)) == 256
