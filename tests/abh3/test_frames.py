"""The codec between the data of frames and records, and the records themselves."""

from __future__ import annotations

import copy
import math
import pickle
import struct
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import (
    BR0,
    BR1,
    BR1V2,
    BR2,
    BR3,
    BR4,
    BR5,
    BR6,
    BUF,
    DP0R,
    DP0RV2,
    DP0S,
    DP1R,
    RECORDS,
    Flags,
    Record,
)
from orinkit.abh3.table.signals import V1, V2, Dialect
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue, ProtocolError

pytestmark = pytest.mark.core

ONE = Codec(V1)
TWO = Codec(V2)
TENTHS = Codec(V1.with_load_unit(0.1))


def flags(value: int, dialect: Dialect = V1) -> Flags:
    return Flags(value, dialect.inputs)


# --- frames of real drivers -------------------------------------------------------------------------------------------

# Captured replies to 00EF0102 00 00 00 00 03 30 00 00: A, B, Y, X in min^-1.
CAPTURED = [
    ("b6 ff 00 00 db ff db ff", (-14.8, 0.0, -7.4, -7.4)),
    ("c2 ff ad ff b8 ff 0b 00", (-12.4, -16.6, -14.4, 2.2)),
    ("00 00 34 00 1a 00 e6 ff", (0.0, 10.4, 5.2, -5.2)),
    ("e7 ff 14 00 fe ff e9 ff", (-5.0, 4.0, -0.4, -4.6)),
    ("f4 ff e1 ff ea ff 09 00", (-2.4, -6.2, -4.4, 1.8)),
    ("0c 00 39 00 23 00 ea ff", (2.4, 11.4, 7.0, -4.4)),
]


@pytest.mark.parametrize(("data", "values"), CAPTURED)
def test_captured_feedback(data: str, values: tuple[float, ...]) -> None:
    record = ONE.decode("DP0R", bytes.fromhex(data))
    assert record == DP0R(*values)
    assert isinstance(record, DP0R)
    assert (record.a_velocity, record.b_velocity, record.y_velocity, record.x_velocity) == values
    assert [record.raw_values[name] / 5 for name in ("a_velocity", "b_velocity", "y_velocity", "x_velocity")] == list(
        values
    )
    assert abs(record.y_velocity - (record.a_velocity + record.b_velocity) / 2) <= 0.2
    assert abs(record.x_velocity - (record.a_velocity - record.b_velocity) / 2) <= 0.2
    assert ONE.encode(DP0R(*values)) == bytes.fromhex(data)


def test_the_captured_command() -> None:
    data = bytes.fromhex("00 00 00 00 03 30 00 00")
    record = ONE.decode("DP0S", data)
    assert record == DP0S(0, 0, flags(0x3003))
    assert isinstance(record, DP0S)
    assert list(record.inputs) == ["ay_servo_on", "ay_start", "bx_servo_on", "bx_start"]
    assert ONE.encode(record) == data


# The state of a driver that received nothing for a second, as the vendor's programs print it.
def test_a_driver_that_received_nothing() -> None:
    record = ONE.read(BR0, "BR0", bytes.fromhex("00 00 40 00 00 00 40 00"))
    assert (int(record.errors), int(record.warnings)) == (0x00400000, 0x00400000)
    assert list(record.errors) == list(record.warnings) == ["can_communication"]
    states = ONE.read(BR1, "BR1", bytes.fromhex("70 00 07 08 c3 00 00 00"))
    assert (int(states.control), int(states.io)) == (0x08070070, 0x000000C3)
    assert set(states.control) == {
        "ay_select_0", "ay_select_1", "ay_select_2", "bx_select_0", "bx_select_1", "bx_select_2", "travel_model",
    }  # fmt: skip
    assert list(states.io) == ["error", "alarm", "error_code_0", "error_code_1"]
    assert ONE.decode("BR5", struct.pack("<hhHH", 21, 14, 237, 237)) == BR5(0.21, 0.14, 23.7, 23.7)
    assert ONE.decode("BR3", struct.pack("<hhHH", 0, 0, 6, 2)) == BR3(0, 0, 6, 2)
    assert TENTHS.decode("BR3", struct.pack("<hhHH", 0, 0, 6, 2)) == BR3(0, 0, 0.6, 0.2)
    monitors = ONE.read(BR6, "BR6", struct.pack("<ff", 0.011930, 0.106096))
    assert f"{monitors.monitor_0:.6f} {monitors.monitor_1:.6f}" == "0.011930 0.106096"


GOLDEN: list[tuple[Codec, str, str, Record]] = [
    (ONE, "DP0S", "88 13 78 ec 03 30 00 00", DP0S(1000, -1000, flags(0x3003))),
    (ONE, "DP0S", "88 13 78 ec 00 00 00 01", DP0S(50, -1000, flags(0x01000000))),  # A/Y torque: 0.01 %
    (ONE, "DP0S", "88 13 78 ec 00 00 00 02", DP0S(1000, -50, flags(0x02000000))),
    (ONE, "DP0S", "88 13 78 ec 00 00 00 03", DP0S(50, -50, flags(0x03000000))),
    (ONE, "DP0S", "88 13 78 ec 00 00 03 00", DP0S(1000, -1000, flags(0x00030000))),  # bits of the other dialect
    (TWO, "DP0S", "88 13 78 ec 00 00 01 00", DP0S(50, -1000, flags(0x00010000))),
    (TWO, "DP0S", "88 13 78 ec 00 00 02 00", DP0S(1000, -50, flags(0x00020000))),
    (TWO, "DP0S", "88 13 78 ec 00 00 00 03", DP0S(1000, -1000, flags(0x03000000))),
    (TWO, "DP0R", "b6 ff 01 00 01 02 03 94", DP0RV2(-14.8, 0.2, flags(0x94030201))),
    (ONE, "DP1R", "ff ff ff ff 00 00 00 80", DP1R(-1, -0x80000000)),
    (ONE, "BR0", "01 02 03 04 05 06 07 08", BR0(flags(0x04030201), flags(0x08070605))),
    (ONE, "BR1", "01 02 03 04 05 06 07 08", BR1(flags(0x04030201), flags(0x08070605))),
    (TWO, "BR1", "01 02 03 04 05 06 07 08", BR1V2(flags(0x04030201), flags(0x08070605))),
    (ONE, "BR2", "05 00 fb ff 00 80 ff 7f", BR2(1, -1, -6553.6, 6553.4)),
    (ONE, "BR3", "00 80 ff 7f ff 00 ff ff", BR3(-327.68, 327.67, 255, 65535)),
    (TENTHS, "BR3", "00 80 ff 7f ff 00 ff ff", BR3(-327.68, 327.67, 25.5, 6553.5)),
    (ONE, "BR4", "01 00 00 00 ff ff ff 7f", BR4(1, 0x7FFFFFFF)),
    (ONE, "BR5", "00 80 ff 7f 00 80 ff ff", BR5(-327.68, 327.67, 3276.8, 6553.5)),
    (ONE, "BR6", "00 00 80 3f 00 00 00 c0", BR6(1.0, -2.0)),
    (ONE, "BR6", "00 00 80 7f 00 00 80 ff", BR6(math.inf, -math.inf)),
]


@pytest.mark.parametrize(("codec", "name", "data", "record"), GOLDEN)
def test_golden_frames(codec: Codec, name: str, data: str, record: Record) -> None:
    found = codec.decode(name, bytes.fromhex(data))
    assert found == record
    assert type(found) is type(record)
    assert codec.encode(record) == codec.encode(record, name) == bytes.fromhex(data)
    assert list(found.raw_values) == [field.name for field in codec.dialect.layouts[name].fields]
    assert record.raw_values == {}


def test_the_first_dialect_is_that_of_the_document() -> None:
    assert Codec().dialect is V1
    assert TWO.dialect is V2


def test_raw_values() -> None:
    record = ONE.decode("DP0S", bytes.fromhex("88 13 78 ec 00 00 00 03"))
    assert record.raw_values == {"ay_command": 5000, "bx_command": -5000, "inputs": 0x03000000}
    assert ONE.decode("BR6", bytes.fromhex("00 00 80 3f 00 00 00 c0")).raw_values == {
        "monitor_0": 1.0,
        "monitor_1": -2.0,
    }
    assert ONE.decode("BR3", struct.pack("<hhHH", -1, 2, 3, 4)).raw_values == {
        "ay_current_command": -1, "bx_current_command": 2, "a_load": 3, "b_load": 4,
    }  # fmt: skip


@pytest.mark.parametrize("name", list(V1.layouts))
@pytest.mark.parametrize("size", [0, 1, 7, 9, 64])
def test_wrong_lengths(name: str, size: int) -> None:
    for tongue, text in (("en", f"8 bytes, not {size}"), ("ja", f"8 バイトです ({size} バイト)")):
        i18n.use(tongue)
        with pytest.raises(ProtocolError) as caught:
            ONE.decode(name, bytes(size))
        assert name in str(caught.value)
        assert text in str(caught.value)


def test_a_record_of_a_type() -> None:
    assert ONE.read(DP0R, "DP0R", bytes(8)) == DP0R(0, 0, 0, 0)
    with pytest.raises(ProtocolError):
        ONE.read(DP0R, "DP0R", b"")
    with pytest.raises(AssertionError):
        ONE.read(BR0, "DP0R", bytes(8))


@pytest.mark.parametrize(
    ("codec", "record"),
    [
        (ONE, DP0RV2(0, 0, flags(0))),
        (ONE, BR1V2(flags(0), flags(0))),
        (TWO, DP0R(0, 0, 0, 0)),
        (TWO, BR1(flags(0), flags(0))),
        (ONE, Record()),
    ],
)
def test_records_of_another_dialect(codec: Codec, record: Record) -> None:
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(InvalidValue) as caught:
            codec.encode(record)
        for part in (codec.dialect.name, type(record).__name__, "DP0S", "BR6"):
            assert part in str(caught.value)


def test_bytes_of_an_unknown_frame() -> None:
    assert ONE.encode(BUF(b"\x01\x02")) == b"\x01\x02"


# --- values without a code --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("record", "named"),
    [
        (DP0S(6553.6, 0, flags(0)), ("velocity", "速度")),
        (DP0S(0, -6553.8, flags(0)), ("velocity", "速度")),
        (DP0S(328, 0, flags(0x01000000)), ("current", "電流")),
        (DP0S(0, 328, flags(0x02000000)), ("current", "電流")),
        (DP0S(0, 0, flags(1 << 32)), ("inputs", "入力")),
        (DP0S(0, 0, flags(-1)), ("inputs", "入力")),
        (DP0S(0, 0, "1"), ("inputs", "入力")),
        (BR0(flags(0), flags(1 << 32)), ("warning flags", "警告フラグ")),
        (BR0(None, flags(0)), ("error flags", "異常フラグ")),
        (BR3(0, 0, -1, 0), ("load", "負荷率")),
        (BR4(1 << 31, 0), ("pulse count", "パルス積算値")),
        (BR5(0, 0, -0.1, 0), ("supply voltage", "電源電圧")),
        (BR6(1e39, 0), ("monitor 0", "モニタ 0")),
        (BR6(0, -1e300), ("monitor 1", "モニタ 1")),
        (BR6(0, "1"), ("monitor 1", "モニタ 1")),
        (BR6(Decimal("sNaN"), 0), ("monitor 0", "モニタ 0")),
    ],
)
def test_values_without_a_code(record: Record, named: tuple[str, str]) -> None:
    for tongue, name in zip(("en", "ja"), named, strict=True):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=name):
            ONE.encode(record)


def test_torque_is_a_current_only_with_its_own_bit() -> None:
    assert ONE.encode(DP0S(327.67, 6553.4, flags(0x01000000))) == bytes.fromhex("ff 7f ff 7f 00 00 00 01")
    assert ONE.encode(DP0S(6553.4, 327.67, flags(0x02000000))) == bytes.fromhex("ff 7f ff 7f 00 00 00 02")


def test_the_words_may_be_numbers() -> None:
    assert ONE.encode(DP0S(0, 0, 0xFFFFFFFF)) == bytes.fromhex("00 00 00 00 ff ff ff ff")
    assert ONE.encode(DP0S(50, 0, 0x01000000))[:2] == bytes.fromhex("88 13")


def test_monitors_are_rounded_to_single_floats() -> None:
    assert ONE.encode(BR6(0.1, 1 / 3)) == struct.pack("<ff", 0.1, 1 / 3)
    assert math.isnan(ONE.read(BR6, "BR6", ONE.encode(BR6(math.nan, 0))).monitor_0)
    record = ONE.read(BR6, "BR6", ONE.encode(BR6(1e-50, -0.0)))
    assert (record.monitor_0, math.copysign(1, record.monitor_1)) == (0.0, -1.0)


# --- flags ------------------------------------------------------------------------------------------------------------


def test_flags_by_name_and_number() -> None:
    both = flags(0x80003001)  # both servos, B/X start, error reset
    assert "ay_servo_on" in both
    assert "bx_servo_on" in both
    assert "servo_on" in both
    assert "bx_start" in both
    assert "ay_start" not in both
    assert "start" not in both  # it needs both
    assert "error_reset" in both
    assert 0 in both
    assert 1 not in both
    assert both["servo_on"] is True
    assert both["start"] is False
    assert both["bx_start"] is True
    assert both[0] is True
    assert both[1] is False
    assert both[31] is True
    for name in ("servo", 32, -1):
        with pytest.raises(InvalidValue, match="inputs"):
            both[name]


def test_a_mistyped_name_raises() -> None:
    both = flags(0x80003001)
    for nothing in ("", "bit_0", "servo", "start ", 32, -1, None, 1.5, True):
        for tongue, text in (("en", "inputs"), ("ja", "入力")):
            i18n.use(tongue)
            with pytest.raises(InvalidValue, match=text):
                _ = nothing in both


def test_the_names_of_the_flags_that_are_set() -> None:
    assert list(flags(0)) == []
    assert list(flags(0xA0000100)) == ["a_pulse_clear", "bit_29", "error_reset"]
    assert list(flags(1 << 27)) == ["bit_27"]
    assert list(Flags(1 << 27, V1.control)) == ["travel_model"]
    assert flags(0xA0000100).set_bits == (V1.inputs.by_number[8], V1.inputs.by_number[31])


def test_texts_of_flags_in_both_languages() -> None:
    wrong = Flags(0x10400000, V1.errors)
    assert wrong.texts == ("CAN communication time-out",)
    i18n.use("ja")
    assert wrong.texts == ("CAN 通信異常 (タイムアウト)",)
    assert Flags(0x10400000, V2.errors).texts == ("CAN 通信異常 (タイムアウト)", "エラーコード 0")


def test_flags_are_a_number() -> None:
    assert int(flags(0x3003)) == 0x3003
    assert hex(flags(0x3003)) == "0x3003"
    assert bool(flags(0)) is False
    assert bool(flags(0x20000000)) is True
    assert str(flags(0)) == "0x00000000"
    assert str(flags(0xA0000000)) == "0xA0000000 (bit_29, error_reset)"
    assert flags(1) == Flags(1, V2.control)
    assert flags(1) != flags(2)
    assert hash(flags(1)) == hash(Flags(1, V2.control))
    assert repr(flags(3)) == "<0x00000003 (ay_servo_on, ay_start)>"
    assert repr(flags(0)) == "<0x00000000>"
    assert repr(Flags(0x00400000, V1.errors)) == "<0x00400000 (can_communication)>"
    assert repr(BR0(Flags(0x00400000, V1.errors), Flags(0, V1.warnings))) == (
        "BR0(errors=<0x00400000 (can_communication)>, warnings=<0x00000000>)"
    )
    assert not hasattr(flags(3), "__dict__")
    with pytest.raises(AttributeError):
        flags(3).value = 4


@given(st.integers(0, 0xFFFFFFFF), st.sampled_from([V1, V2]))
def test_every_bit_is_one_name(value: int, dialect: Dialect) -> None:
    for word in (dialect.inputs, dialect.control, dialect.errors, dialect.warnings, dialect.io):
        found = Flags(value, word)
        names = list(found)
        masks = [1 << int(name[4:]) if name.startswith("bit_") else word.masks[name] for name in names]
        assert sum(masks) == value
        assert len(names) == value.bit_count()
        assert len(found.set_bits) == len(found.texts) == sum(not name.startswith("bit_") for name in names)
        assert all(found[name] and name in found for name in names if not name.startswith("bit_"))


def test_flags_of_a_codec_have_32_bits() -> None:
    assert int(TWO.flags(V2.inputs, -1)) == 0xFFFFFFFF
    assert int(TWO.flags(V2.inputs, (1 << 32) + 5)) == 5
    assert TWO.flags(V2.inputs, 5).word is V2.inputs


# --- records ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("codec", [ONE, TWO, TENTHS], ids=["v1", "v2", "tenths"])
def test_records_survive_pickle_and_copy(codec: Codec) -> None:
    for name in codec.dialect.layouts:
        record = codec.decode(name, bytes(range(1, 9)))
        for again in (pickle.loads(pickle.dumps(record)), copy.copy(record), copy.deepcopy(record)):
            assert again == record
            assert type(again) is RECORDS[codec.dialect.name][name]
            assert again.raw_values == record.raw_values
            assert codec.encode(again) == bytes(range(1, 9))
    word = pickle.loads(pickle.dumps(Flags(0x3003, V1.inputs)))
    assert list(word) == ["ay_servo_on", "ay_start", "bx_servo_on", "bx_start"]
    assert pickle.loads(pickle.dumps(BUF(b"12"))) == BUF(b"12")


@pytest.mark.parametrize("kind", [*RECORDS["v1"].values(), DP0RV2, BR1V2, BUF])
def test_records_cannot_be_changed(kind: Any) -> None:
    names = [name for name in kind.__dataclass_fields__ if name != "codes"]
    record = kind(*range(len(names)))
    assert [getattr(record, name) for name in names] == list(range(len(names)))
    for name in (*names, "codes"):
        with pytest.raises(AttributeError):
            setattr(record, name, 0)
    assert not hasattr(record, "__dict__")
    assert record == kind(*range(len(names)), codes=(1,))  # the codes are not compared
    assert "codes" not in repr(record)
