"""CAN frames and the steps of operations."""

from __future__ import annotations

import pytest

from orinkit.can.frame import MAX_DATA, MAX_ID, CanFrame, OperationStep, checked
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core


def test_a_frame() -> None:
    frame = CanFrame(0x00EF0102, bytes.fromhex("00 00 00 00 03 30 00 0a"))
    assert str(frame) == "00EF0102#000000000330000A"
    assert str(CanFrame(0x1CEAFF02, b"")) == "1CEAFF02#"
    assert frame.time == 0.0
    assert frame == CanFrame(0x00EF0102, frame.data, 0.0)
    assert CanFrame(1, b"", 2.5).time == 2.5


def test_a_step_continues_the_wait_by_default() -> None:
    assert OperationStep() == OperationStep(frames=(), seconds=None, fresh=False)


@pytest.mark.parametrize("frame", [CanFrame(0, b""), CanFrame(0x1FFFFFFF, bytes(8))])
def test_frames_that_can_be_sent(frame: CanFrame) -> None:
    assert checked(frame) is frame
    assert (MAX_ID, MAX_DATA) == (0x1FFFFFFF, 8)


@pytest.mark.parametrize(
    ("frame", "parts"),
    [
        (CanFrame(-1, b""), ("29", "-0x1")),
        (CanFrame(0x20000000, b""), ("29", "0x20000000")),
        (CanFrame(0, bytes(9)), ("8", "9")),
        (CanFrame(0, bytes(64)), ("8", "64")),
    ],
)
def test_frames_that_cannot_be_sent(frame: CanFrame, parts: tuple[str, ...]) -> None:
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(InvalidValue) as caught:
            checked(frame)
        assert all(part in str(caught.value) for part in parts)
        assert str(caught.value).isascii() == (tongue == "en")
