"""Identifiers against the tables of the document, section 2."""

from __future__ import annotations

import re
from enum import IntEnum
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.table import ids
from orinkit.abh3.table.ids import FrameId
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from orinkit.core.validation import check_whole, whole

pytestmark = pytest.mark.core


def test_the_identifiers_of_the_document() -> None:
    assert ids.single(1, 2) == 0x00EF0102
    assert ids.single(2, 1) == 0x00EF0201
    assert ids.single(1, 2, dp=1) == 0x01EF0102
    assert ids.single(2, 1, dp=1) == 0x01EF0201
    assert ids.request(1, 2) == 0x00EA0102
    assert ids.request(ids.EVERYONE, 2) == 0x00EAFF02
    assert [ids.broadcast(5, n, 1) for n in range(7)] == [
        0x00FF2801, 0x00FF2901, 0x00FF2A01, 0x00FF2B01, 0x00FF2C01, 0x00FF2D01, 0x00FF2E01,
    ]  # fmt: skip


def test_the_identifiers_of_other_groups() -> None:
    assert [ids.broadcast(16, n, 3) for n in range(8)] == [0x00FF8003 + 0x100 * n for n in range(8)]
    assert ids.broadcast(0, 0, 0) == 0x00FF0000
    assert ids.broadcast(31, 7, 253) == 0x00FFFFFD


def test_the_identifiers_of_multi_packets() -> None:
    assert int(FrameId(ids.CONTROL, 1, 2)) == 0x00EC0102
    assert int(FrameId(ids.TRANSFER, 2, 1)) == 0x00EB0201


def test_priorities() -> None:
    assert ids.single(1, 2, priority=7) == 0x1CEF0102
    assert ids.single(1, 2, dp=1, priority=1) == 0x05EF0102
    assert ids.request(1, 2, priority=3) == 0x0CEA0102
    assert ids.broadcast(5, 0, 1, priority=2) == 0x08FF2801
    assert FrameId.parse(0x08FF2801) == FrameId(0xFF, 0x28, 1, priority=2)
    assert FrameId.parse(0x00FF2801).with_priority(2) == 0x08FF2801
    assert FrameId.parse(0x1FEF0102).with_priority(0) == 0x03EF0102


def test_the_parts() -> None:
    assert FrameId.parse(0x01EF0201) == FrameId(pf=0xEF, ps=2, sa=1, dp=1, priority=0, reserved=0)
    assert FrameId.parse(0x02EF0201) == FrameId(pf=0xEF, ps=2, sa=1, reserved=1)
    assert FrameId.parse(0x1FFFFFFF) == FrameId(0xFF, 0xFF, 0xFF, 1, 7, 1)
    assert FrameId.parse(0) == FrameId(0, 0, 0)


@given(st.integers(0, 0x1FFFFFFF), st.integers(0, 7))
def test_every_identifier_survives(number: int, priority: int) -> None:
    parts = FrameId.parse(number)
    assert int(parts) == number
    assert (parts.sa, parts.ps, parts.pf) == tuple(number.to_bytes(4, "little")[:3])
    assert parts.with_priority(priority) == number & 0x03FFFFFF | priority << 26


def test_pgns_of_requests() -> None:
    assert ids.pgn(ids.BROADCAST, 0x28) == bytes.fromhex("28 FF 00")
    assert ids.pgn(ids.BROADCAST, 0x2E) == bytes.fromhex("2E FF 00")
    assert ids.pgn(ids.SINGLE, 0) == bytes.fromhex("00 EF 00")
    assert ids.pgn(ids.SINGLE, 0, dp=1) == bytes.fromhex("00 EF 01")


NUMBERS = [
    (lambda value: ids.check_address("host", value), 253, "host"),
    (ids.check_group, 31, "group"),
    (ids.check_priority, 7, "priority"),
    (lambda value: check_whole("x", value, 12), 12, "x"),
]


@pytest.mark.parametrize(("check", "highest", "name"), NUMBERS)
def test_bounds(check: Any, highest: int, name: str) -> None:
    for good in (0, 1, highest):
        assert check(good) == good
    for bad in (-1, highest + 1, 255, 1 << 100, 10**5000, True, 1.0, "1", None, b"\1"):
        for tongue in ("en", "ja"):
            i18n.use(tongue)
            with pytest.raises(InvalidValue) as caught:
                check(bad)
            assert str(caught.value).startswith(f"{name} ")
            assert str(highest) in str(caught.value)
            assert len(str(caught.value)) < 120


def test_numbers_of_broadcasts() -> None:
    assert [ids.broadcast_number(n, 5) for n in range(8)] == list(range(0x28, 0x30))
    assert [ids.broadcast_number(n, 0) for n in range(8)] == list(range(8))
    assert [ids.broadcast_number(0x28 + n, 5) for n in range(8)] == list(range(0x28, 0x30))
    assert ids.broadcast_number(8, 1) == 8
    assert ids.broadcast_number(0xFF, 31) == 0xFF
    for tongue, text in (("en", "broadcast"), ("ja", "ブロードキャスト")):
        i18n.use(tongue)
        for bad in (-1, 256, True, 0.0, "0"):
            with pytest.raises(InvalidValue, match=text):
                ids.broadcast_number(bad, 5)


@pytest.mark.parametrize(
    ("number", "group", "other", "place"),
    [(0x28, 9, 5, 0), (8, 5, 1, 0), (0xFF, 5, 31, 7), (8, 0, 1, 0), (0x2A, 4, 5, 2)],
)
def test_a_broadcast_of_another_group(number: int, group: int, other: int, place: int) -> None:
    """No driver of this group would reply to it; the caller probably forgot the group."""
    for tongue, text in (
        ("en", f"0x{number:02X} is broadcast {place} of group {other}, but the group of this host is {group}"),
        ("ja", f"0x{number:02X} はグループ {other} のブロードキャスト {place} です"),
    ):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=re.escape(text)):
            ids.broadcast_number(number, group)


class Counted(IntEnum):
    """A user-defined integer type."""

    ONE = 1


def test_whole_numbers_of_any_type() -> None:
    for value in (1, Counted.ONE, np.int8(1), np.uint64(1), np.array(1)):
        found = whole(value)
        assert (found, type(found)) == (1, int)
        assert type(ids.check_address("host", value)) is int
    for value in (True, np.True_, np.array(True), 1.0, np.float64(1), np.array([1, 2]), "1", None, int):
        assert whole(value) is None
