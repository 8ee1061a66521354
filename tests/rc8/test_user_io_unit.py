"""The unit of the size of user I/O: bits or bytes, shown by the bytes that are sent along, or a setting."""

from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue
from orinkit.rc8.slave_formats import (
    ReceiveFormat,
    SendBits,
    SetPoint,
    UserIoUnit,
    UserWindow,
    encode_set_point,
    read_set_point,
)
from orinkit.rc8.user_io_unit import read_unit
from orinkit.values.variant import ARRAY, R8_ARRAY, VARIANT_ARRAY, Variant, VarType, plain

pytestmark = pytest.mark.core

JOINTS = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0)
WINDOW = ReceiveFormat(0x202)
BITS, BYTES = UserIoUnit.BITS, UserIoUnit.BYTES


def i4(number: int) -> Variant:
    return Variant(VarType.I4, number)


def states(*numbers: int) -> Variant:
    return Variant(VarType.UI1 | ARRAY, bytes(numbers))


def read(*parts: Variant, send: SendBits, receive: ReceiveFormat, unit: UserIoUnit) -> SetPoint:
    parameter = Variant(VARIANT_ARRAY, [Variant(R8_ARRAY, JOINTS), *parts])
    return read_set_point("J", parameter, send, receive, unit)


def test_the_setting_is_given_as_such_or_as_text():
    assert [read_unit("bits"), read_unit("bytes"), read_unit(BITS)] == [BITS, BYTES, BITS]
    with pytest.raises(InvalidValue, match='is "bits" or "bytes", not \'words\''):
        read_unit("words")


@pytest.mark.parametrize("unit", UserIoUnit)
@pytest.mark.parametrize("size", [2, 16])
def test_the_bytes_that_are_sent_show_the_unit(unit, size):
    """Two bytes are a size of 2 bytes or 16 bits, regardless of the setting."""
    point = read(i4(24), i4(size), states(1, 255), send=SendBits.USER, receive=ReceiveFormat(), unit=unit)
    assert point.user == (24, b"\1\xff")


@pytest.mark.parametrize("unit", UserIoUnit)
@pytest.mark.parametrize("size", [1, 8])
def test_one_byte_may_be_a_number(unit, size):
    point = read(
        i4(24), i4(size), Variant(VarType.UI1, 5), send=SendBits.USER, receive=ReceiveFormat(), unit=unit
    )  # fmt: skip
    assert point.user == (24, b"\5")


@pytest.mark.parametrize(("size", "window"), [(2, 16), (16, 128)])
def test_the_unit_of_the_bytes_that_are_sent_is_that_of_the_window_too(size, window):
    for unit in UserIoUnit:
        point = read(
            i4(24), i4(size), states(1, 255), i4(128), i4(window), send=SendBits.USER, receive=WINDOW, unit=unit
        )
        assert (point.user, point.window) == ((24, b"\1\xff"), UserWindow(128, 16))


def test_without_bytes_the_setting_is_the_unit():
    for unit, size in ((BITS, 32), (BYTES, 4)):
        point = read(i4(24), i4(size), send=SendBits(0), receive=WINDOW, unit=unit)
        assert point.window == UserWindow(24, 4)


def test_a_number_of_bits_must_be_a_multiple_of_8():
    with pytest.raises(CallError, match="is 12 bits, expected a multiple of 8") as caught:
        read(i4(24), i4(12), send=SendBits(0), receive=WINDOW, unit=BITS)
    assert caught.value.code == hresult.E_INVALIDARG


@pytest.mark.parametrize("unit", UserIoUnit)
def test_a_set_point_that_is_sent_is_the_one_that_is_read(unit):
    point = SetPoint(JOINTS, user=(24, b"\1\xff"), window=UserWindow(128, 4))
    sent = encode_set_point("J", point, SendBits.USER, WINDOW, unit)
    factor = 8 if unit is BITS else 1
    assert [plain(each) for each in sent.value[1:]] == [24, 2 * factor, b"\1\xff", 128, 4 * factor]
    for setting in UserIoUnit:  # the bytes show the unit
        read_back = read_set_point("J", sent, SendBits.USER, WINDOW, setting)
        assert (read_back.user, read_back.window) == (point.user, point.window)
