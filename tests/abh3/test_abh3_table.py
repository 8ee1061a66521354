"""The table of ABH3 against independent copies of the document's and the vendor's tables."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import re
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.table import records
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import RECORDS, Flags
from orinkit.abh3.table.signals import (
    ANALOG,
    CURRENT,
    DIALECTS,
    LOAD,
    LOAD_TENTHS,
    MONITOR,
    PULSES,
    V1,
    V2,
    VELOCITY,
    VOLTAGE,
    Bit,
    Dialect,
    Quantity,
    TerminalGate,
    Word,
    dialect_of,
    real,
)
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue
from support.abh3_frames import FRAMES, FRAMES_ALIKE, QUANTITIES, TENTHS

pytestmark = pytest.mark.core

BOTH = [pytest.param(V1, id="v1"), pytest.param(V2, id="v2")]


def _spaceless(text: str) -> str:
    """Remove spaces: the document writes one name with and without them."""
    return text.replace(" ", "")


@pytest.mark.parametrize("dialect", BOTH)
def test_every_frame_of_the_document_is_there(dialect: Dialect) -> None:
    frames = FRAMES[dialect.name]
    assert set(dialect.layouts) == set(frames)
    for name, (section, dp, number, fields) in frames.items():
        layout = dialect.layouts[name]
        assert (layout.name, layout.section, layout.dp, layout.broadcast) == (name, section, dp, number), name
        assert layout.from_host == (name == "DP0S")
        assert layout.undocumented == (name == "DP1R")
        assert layout.struct.size == 8
        found = [
            (
                field.name,
                _spaceless(i18n.translate("ja", field.title)),
                start // 8 + 1,
                struct.calcsize("<" + field.code),
                field.code,
            )
            for field, start in layout.starts
        ]
        assert found == [(key, _spaceless(title), *rest) for key, title, *rest in fields], name


@pytest.mark.parametrize("dialect", BOTH)
def test_the_broadcasts_by_their_numbers(dialect: Dialect) -> None:
    assert {number: layout.name for number, layout in dialect.broadcasts.items()} == {n: f"BR{n}" for n in range(7)}


def test_the_unchanged_frames() -> None:
    for name in FRAMES_ALIKE:
        if name != "DP0S" and name != "BR0":
            assert V1.layouts[name] is V2.layouts[name]


@pytest.mark.parametrize("dialect", BOTH)
def test_the_quantities_of_the_fields(dialect: Dialect) -> None:
    for layout in dialect.layouts.values():
        for field in layout.fields:
            if field.code == "I":
                assert field.quantity is None
                assert field.word is not None
            else:
                assert field.word is None
                assert field.quantity is not None
                assert (field.quantity.unit, field.quantity.steps) == QUANTITIES[field.name]
            assert field.torque_input == {"ay_command": "ay_torque", "bx_command": "bx_torque"}.get(field.name, "")


@pytest.mark.parametrize("dialect", BOTH)
def test_the_words_of_the_fields(dialect: Dialect) -> None:
    def word(frame: str, field: str) -> Word:
        (found,) = (each.word for each in dialect.layouts[frame].fields if each.name == field)
        assert found is not None
        return found

    assert word("DP0S", "inputs") is dialect.inputs
    assert word("BR0", "errors") is dialect.errors
    assert word("BR0", "warnings") is dialect.warnings
    assert word("BR1", "io") is dialect.io
    assert word("BR1" if dialect is V1 else "DP0R", "control") is dialect.control
    if dialect is V2:
        assert word("BR1", "external").bits == dialect.inputs.bits
        assert word("BR1", "external").name == "external"
    names = [each.name for each in (dialect.inputs, dialect.control, dialect.errors, dialect.warnings, dialect.io)]
    assert names == ["inputs", "control", "errors", "warnings", "io"]


def test_the_dialects() -> None:
    assert list(DIALECTS) == ["v1", "v2"]
    assert DIALECTS["v1"] is V1 is dialect_of("v1") is dialect_of(V1)
    assert DIALECTS["v2"] is V2 is dialect_of("v2") is dialect_of(V2)
    for tongue in ("en", "ja"):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=r"'v3'.*v1.*v2"):
            dialect_of("v3")
        for wrong in (["v1"], {}, None, 1, b"v1", ("v1",), "V1", ""):
            with pytest.raises(InvalidValue, match="v1"):
                dialect_of(wrong)


@pytest.mark.parametrize("dialect", [*BOTH, V1.with_load_unit(0.1)])
def test_a_dialect_can_be_pickled(dialect: Dialect) -> None:
    """Cached properties are pickled too, or computed again."""
    assert dialect.inputs.masks
    assert [layout.struct.size for layout in dialect.layouts.values()] == [8] * len(dialect.layouts)
    for again in (pickle.loads(pickle.dumps(dialect)), copy.copy(dialect), copy.deepcopy(dialect)):
        assert again == dialect
        assert again.layouts["DP0S"].struct.pack(1, -1, 3) == bytes.fromhex("0100 FFFF 03000000")
        assert again.inputs.masks == dialect.inputs.masks
        assert again.broadcasts == dialect.broadcasts


@pytest.mark.parametrize("dialect", BOTH)
def test_the_fields_of_the_records_are_those_of_the_frames(dialect: Dialect) -> None:
    assert set(RECORDS[dialect.name]) == set(dialect.layouts)
    for name, kind in RECORDS[dialect.name].items():
        fields = [field.name for field in dataclasses.fields(kind) if field.name != "codes"]
        assert fields == [field.name for field in dialect.layouts[name].fields], name
        assert kind.__name__ in (name, f"{name}V2")
        assert kind.__doc__
    assert len(set(RECORDS[dialect.name].values())) == len(
        dialect.layouts
    )  # the class of a record identifies its frame
    assert set(records.ALIKE) == set(FRAMES_ALIKE)


def test_the_table_cannot_be_changed() -> None:
    field = V1.layouts["BR2"].fields[0]
    for thing in (V1, V1.layouts["BR2"], field, field.quantity, V1.inputs, V1.inputs.bits[0]):
        with pytest.raises(dataclasses.FrozenInstanceError):
            thing.name = "other"


# --- texts ------------------------------------------------------------------------------------------------------------


def _both(title: str) -> tuple[str, str]:
    return title, i18n.translate("ja", title)


def _japanese(bit: Bit) -> str:
    return i18n.translate("ja", bit.title, **dict(bit.title_args))


def _texts(dialect: Dialect) -> Iterator[tuple[str, str]]:
    yield _both(dialect.title)
    for layout in dialect.layouts.values():
        yield _both(layout.title)
        for field in layout.fields:
            yield _both(field.title)
            if field.quantity is not None:
                yield _both(field.quantity.title)
            if field.word is not None:
                yield _both(field.word.title)
                yield from ((bit.english, _japanese(bit)) for bit in field.word.bits)


@pytest.mark.parametrize("dialect", BOTH)
def test_every_text_is_there_in_both_languages(dialect: Dialect) -> None:
    for en, ja in _texts(dialect):
        assert en.strip() == en != ""
        assert en.isascii()
        assert ja.strip() == ja != ""
        assert en != ja
        assert re.findall(r"\d+", en) == re.findall(r"\d+", ja)
        if not ja.startswith("PDU"):
            assert not ja.isascii(), ja


# --- quantities (section 3) -------------------------------------------------------------------------------------------

# unit, lowest and highest value as in the document, value of a code, decimal places
RANGES: list[tuple[Quantity, str, float, float, float, int]] = [
    (VELOCITY, "min^-1", -6553.6, 6553.4, 0.2, 1),
    (CURRENT, "%", -327.68, 327.67, 0.01, 2),
    (PULSES, "pulse", -2147483648, 2147483647, 1, 0),
    (VOLTAGE, "V", 0, 6553.5, 0.1, 1),
    (ANALOG, "V", -327.68, 327.67, 0.01, 2),
    (LOAD, "%", 0, 65535, 1, 0),  # the document has 0 to 255 of the 16 bits
    (LOAD_TENTHS, "%", 0, 6553.5, 0.1, 1),
]


@pytest.mark.parametrize(("quantity", "unit", "low", "high", "step", "digits"), RANGES)
def test_units_and_ranges(quantity: Quantity, unit: str, low: float, high: float, step: float, digits: int) -> None:
    assert quantity.unit == unit
    assert quantity.decode(quantity.low) == low
    assert quantity.decode(quantity.high) == high
    assert quantity.decode(1) == step
    assert quantity.decode(0) == 0
    assert quantity.encode(low) == quantity.low
    assert quantity.encode(high) == quantity.high
    assert quantity.encode(step) == 1
    assert quantity.digits == digits
    assert quantity.whole == (quantity is PULSES)
    assert isinstance(quantity.decode(1), int if quantity is PULSES else float)


@pytest.mark.parametrize(("quantity", "unit", "low", "high", "step", "digits"), RANGES)
def test_values_out_of_range_are_refused(
    quantity: Quantity, unit: str, low: float, high: float, step: float, digits: int
) -> None:
    for tongue, name in zip(("en", "ja"), _both(quantity.title), strict=True):
        i18n.use(tongue)
        for value in (low - step, high + step, low - 0.51 * step, high + 0.51 * step, 1e300, -1.7e308):
            with pytest.raises(InvalidValue) as caught:
                quantity.encode(value)
            for part in (name, repr(value), f"{low:.{digits}f}", f"{high:.{digits}f} {unit}"):
                assert part in str(caught.value)
        for code in (quantity.low - 1, quantity.high + 1, 1 << 99999):
            with pytest.raises(InvalidValue) as caught:
                quantity.decode(code)
            for part in (
                name,
                f"{code:#x}"[:20] if code > 1 << 64 else str(code),
                str(quantity.low),
                str(quantity.high),
            ):
                assert part in str(caught.value)


@pytest.mark.parametrize(("quantity", "unit", "low", "high", "step", "digits"), RANGES)
def test_values_just_in_range_are_accepted(
    quantity: Quantity, unit: str, low: float, high: float, step: float, digits: int
) -> None:
    assert quantity.encode(low - 0.49 * step) == quantity.low
    assert quantity.encode(high + 0.49 * step) == quantity.high


@pytest.mark.parametrize(
    ("value", "code"),
    [
        (0.1, 1),  # as near to 0.0 as to 0.2: further from zero
        (-0.1, -1),
        (0.3, 2),
        (-0.3, -2),
        (0.0999, 0),
        (-0.0999, 0),
        (0.11, 1),
        (1000, 5000),
        (-14.8, -74),
        (-0.0, 0),
    ],
)
def test_velocities_become_the_nearest_code(value: float, code: int) -> None:
    assert VELOCITY.encode(value) == code


def test_a_monitor_is_the_number_itself() -> None:
    assert MONITOR.decode(0.25) == 0.25
    assert MONITOR.decode(math.inf) == math.inf
    assert (MONITOR.unit, MONITOR.steps, MONITOR.digits) == ("", 0, 6)


class _Half:
    def __float__(self) -> float:
        return 0.5


class _Broken:
    def __float__(self) -> float:
        raise ValueError


@pytest.mark.parametrize(("value", "number"), [(1, 1.0), (-2.5, -2.5), (_Half(), 0.5), (0, 0.0)])
def test_numbers_of_any_type(value: object, number: float) -> None:
    assert real(value) == number
    assert CURRENT.encode(value) == number * 100


NO_NUMBERS = [math.nan, math.inf, -math.inf, 10**400, 10**5000, True, "1", b"1", None, [1], 1j, _Broken()]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: f"{type(value).__name__}")
def test_values_that_are_not_numbers(value: Any) -> None:
    assert real(value) is None
    with pytest.raises(InvalidValue, match="velocity") as caught:
        VELOCITY.encode(value)
    assert len(str(caught.value)) < 200


def test_load_units() -> None:
    for dialect in (V1, V2):
        tenths = dialect.with_load_unit(0.1)
        kinds = {field.name: field.quantity for field in tenths.layouts["BR3"].fields}
        assert kinds == {
            "ay_current_command": CURRENT, "bx_current_command": CURRENT, "a_load": LOAD_TENTHS, "b_load": LOAD_TENTHS,
        }  # fmt: skip
        assert tenths.with_load_unit(1) == dialect
        assert dialect.with_load_unit(1.0) == dialect
        assert tenths.broadcasts[3] is tenths.layouts["BR3"]
        assert [name for name in dialect.layouts if tenths.layouts[name] != dialect.layouts[name]] == ["BR3"]
        for unit in (0, 10, 0.01, math.nan, "0.1", None):
            for tongue in ("en", "ja"):
                i18n.use(tongue)
                with pytest.raises(InvalidValue, match=r"1 .*0\.1 %"):
                    dialect.with_load_unit(unit)


# --- flag words -------------------------------------------------------------------------------------------------------

AND, OR, NOT, NONE = TerminalGate.AND, TerminalGate.OR, TerminalGate.NOT_AND, None
Rows = list[tuple[int, str, str, TerminalGate | None]]

INPUTS_V1: Rows = [
    (0, "ay_servo_on", "A/Y サーボ", AND),
    (1, "ay_start", "A/Y スタート", AND),
    (2, "ay_polarity", "A/Y 指令極性", AND),
    (3, "ay_correction", "A/Y 補正加算", AND),
    (4, "ay_select_0", "A/Y データ選択 0", NOT),
    (5, "ay_select_1", "A/Y データ選択 1", NOT),
    (6, "ay_select_2", "A/Y データ選択 2", NOT),
    (7, "ay_correction_polarity", "A/Y 補正極性", AND),
    (8, "a_pulse_clear", "A 軸積算クリア", OR),
    (12, "bx_servo_on", "B/X サーボ", AND),
    (13, "bx_start", "B/X スタート", AND),
    (14, "bx_polarity", "B/X 指令極性", AND),
    (15, "bx_correction", "B/X 補正加算", AND),
    (16, "bx_select_0", "B/X データ選択 0", NOT),
    (17, "bx_select_1", "B/X データ選択 1", NOT),
    (18, "bx_select_2", "B/X データ選択 2", NOT),
    (19, "b_pulse_clear", "B 軸積算クリア", OR),
    (23, "bx_correction_polarity", "B/X 補正極性", AND),
    (24, "ay_torque", "A/Y トルク", AND),
    (25, "bx_torque", "B/X トルク", AND),
    (26, "slave", "スレーブ", AND),
    (28, "brake_release", "ブレーキ", AND),
    (31, "error_reset", "エラーリセット", OR),
]
CONTROL_V1: Rows = [*INPUTS_V1, (27, "travel_model", "走行軸モデル", NONE)]
INPUTS_V2: Rows = [
    (0, "ay_servo_on", "A/Y サーボ", AND),
    (1, "ay_start", "A/Y スタート", AND),
    (2, "ay_polarity", "A/Y 指令極性", AND),
    (3, "ay_correction", "A/Y 補正加算", AND),
    (4, "ay_select_0", "A/Y データ選択 0", AND),
    (5, "ay_select_1", "A/Y データ選択 1", AND),
    (6, "ay_select_2", "A/Y データ選択 2", AND),
    (7, "ay_correction_polarity", "A/Y 補正極性", AND),
    (8, "bx_servo_on", "B/X サーボ", AND),
    (9, "bx_start", "B/X スタート", AND),
    (10, "bx_polarity", "B/X 指令極性", AND),
    (11, "bx_correction", "B/X 補正加算", AND),
    (12, "bx_select_0", "B/X データ選択 0", AND),
    (13, "bx_select_1", "B/X データ選択 1", AND),
    (14, "bx_select_2", "B/X データ選択 2", AND),
    (15, "bx_correction_polarity", "B/X 補正極性", AND),
    (16, "ay_torque", "A/Y トルク", AND),
    (17, "bx_torque", "B/X トルク", AND),
    (18, "slave", "マスタ/スレーブ", AND),
    (19, "brake_release", "ブレーキ", AND),
    (20, "a_pulse_clear", "A 軸積算クリア", OR),
    (21, "b_pulse_clear", "B 軸積算クリア", OR),
    (22, "error_reset", "エラーリセット", OR),
]
CONTROL_V2: Rows = [
    *INPUTS_V2,
    (25, "ay_ready", "A/Y レディ", NONE),
    (26, "ay_busy", "A/Y ビジー", NONE),
    (27, "bx_ready", "B/X レディ", NONE),
    (28, "bx_busy", "B/X ビジー", NONE),
    (29, "travel_model", "走行軸モデル", NONE),
    (30, "brake_released", "ブレーキ解放", NONE),
    (31, "error", "エラー発生", NONE),
]
FAULTS: Rows = [
    (0, "a_mechanical_lock", "A 軸 メカロック", NONE),
    (1, "b_mechanical_lock", "B 軸 メカロック", NONE),
    (2, "overheat", "過熱", NONE),
    (3, "brake", "ブレーキ異常", NONE),
    (4, "a_resolver", "A 軸 レゾルバ", NONE),
    (5, "b_resolver", "B 軸 レゾルバ", NONE),
    (6, "a_overcurrent", "A 軸 過電流", NONE),
    (7, "b_overcurrent", "B 軸 過電流", NONE),
    (8, "control_undervoltage", "制御電源 電圧低下", NONE),
    (9, "parameter", "パラメータ", NONE),
    (10, "a_pdu", "A 軸 PDU", NONE),
    (11, "b_pdu", "B 軸 PDU", NONE),
    (12, "a_electronic_thermal", "A 軸 電子サーマル", NONE),
    (13, "b_electronic_thermal", "B 軸 電子サーマル", NONE),
    (14, "main_undervoltage", "主電源 電圧低下", NONE),
    (15, "overvoltage", "過電圧", NONE),
    (16, "a_overspeed", "A 軸 過速度", NONE),
    (17, "b_overspeed", "B 軸 過速度", NONE),
    (18, "a_speed_limit", "A 軸 速度リミット", NONE),
    (19, "b_speed_limit", "B 軸 速度リミット", NONE),
    (20, "a_current_limit", "A 軸 電流リミット", NONE),
    (21, "b_current_limit", "B 軸 電流リミット", NONE),
    (22, "can_communication", "CAN 通信異常", NONE),
    (23, "can_traffic", "CAN 通信トラフィック過大", NONE),
]
ERRORS_V2: Rows = [*FAULTS, *((28 + n, f"error_code_{n}", f"エラーコード {n}", NONE) for n in range(4))]
WARNINGS_V2: Rows = [*FAULTS, *((28 + n, f"alarm_code_{n}", f"アラームコード {n}", NONE) for n in range(4))]
IO_V1: Rows = [
    (0, "error", "エラー発生", NONE),
    (1, "alarm", "アラーム発生", NONE),
    (2, "ay_ready", "A/Y レディ", NONE),
    (3, "ay_busy", "A/Y ビジー", NONE),
    (4, "bx_ready", "B/X レディ", NONE),
    (5, "bx_busy", "B/X ビジー", NONE),
    (6, "error_code_0", "エラーコード 0", NONE),
    (7, "error_code_1", "エラーコード 1", NONE),
    (8, "error_code_2", "エラーコード 2", NONE),
    (9, "error_code_3", "エラーコード 3", NONE),
    (10, "brake_released", "ブレーキ解放", NONE),
    (11, "di_0", "#0", NONE),
    (12, "di_1", "#1", NONE),
    (13, "di_2", "#2", NONE),
    (14, "di_3", "#3", NONE),
    (15, "di_12", "#12", NONE),
    (16, "di_13", "#13", NONE),
    (17, "di_14", "#14", NONE),
    (18, "di_15", "#15", NONE),
    (19, "di_16", "#16", NONE),
    (20, "di_17", "#17", NONE),
    (21, "di_18", "#18", NONE),
    (22, "di_19", "#19", NONE),
    (23, "di_4", "#4", NONE),
    (24, "di_5", "#5", NONE),
    (25, "di_6", "#6", NONE),
    (26, "di_7", "#7", NONE),
    (27, "di_8", "#8", NONE),
    (28, "di_9", "#9", NONE),
    (29, "di_10", "#10", NONE),
    (30, "di_11", "#11", NONE),
    (31, "error_reset_input", "エラーリセット入力", NONE),
]
IO_V2: Rows = [
    *((n, f"do_{n}", f"デジタル出力 #{n}", NONE) for n in range(8)),
    *((8 + n, f"di_{n}", f"デジタル入力 #{n}", NONE) for n in range(20)),
    (31, "error_reset_input", "エラーリセット入力", NONE),
]
PER_AXIS_V1 = {
    "servo_on": 0x00001001, "start": 0x00002002, "polarity": 0x00004004, "correction": 0x00008008,
    "select_0": 0x00010010, "select_1": 0x00020020, "select_2": 0x00040040, "correction_polarity": 0x00800080,
    "pulse_clear": 0x00080100, "torque": 0x03000000,
}  # fmt: skip
PER_AXIS_V2 = {
    "servo_on": 0x0101, "start": 0x0202, "polarity": 0x0404, "correction": 0x0808, "select_0": 0x1010,
    "select_1": 0x2020, "select_2": 0x4040, "correction_polarity": 0x8080, "pulse_clear": 0x00300000,
    "torque": 0x00030000,
}  # fmt: skip
PER_AXIS_FAULTS = {
    "mechanical_lock": 0x3, "resolver": 0x30, "overcurrent": 0xC0, "pdu": 0xC00, "electronic_thermal": 0x3000,
    "overspeed": 0x30000, "speed_limit": 0xC0000, "current_limit": 0x300000,
}  # fmt: skip
WORDS = [
    pytest.param(V1.inputs, INPUTS_V1, PER_AXIS_V1, id="v1 inputs"),
    pytest.param(V1.control, CONTROL_V1, PER_AXIS_V1, id="v1 control"),
    pytest.param(V1.errors, FAULTS, PER_AXIS_FAULTS, id="v1 errors"),
    pytest.param(V1.warnings, FAULTS, PER_AXIS_FAULTS, id="v1 warnings"),
    pytest.param(V1.io, IO_V1, {"ready": 0x14, "busy": 0x28}, id="v1 io"),
    pytest.param(V2.inputs, INPUTS_V2, PER_AXIS_V2, id="v2 inputs"),
    pytest.param(V2.control, CONTROL_V2, {**PER_AXIS_V2, "ready": 0x0A000000, "busy": 0x14000000}, id="v2 control"),
    pytest.param(V2.errors, ERRORS_V2, PER_AXIS_FAULTS, id="v2 errors"),
    pytest.param(V2.warnings, WARNINGS_V2, PER_AXIS_FAULTS, id="v2 warnings"),
    pytest.param(V2.io, IO_V2, {}, id="v2 io"),
]


@pytest.mark.parametrize(("word", "rows", "per_axis"), WORDS)
def test_the_bits_are_those_of_the_reference(word: Word, rows: Rows, per_axis: Mapping[str, int]) -> None:
    assert sorted((bit.number, bit.name, bit.gate) for bit in word.bits) == sorted(
        ((number, name, logic) for number, name, _, logic in rows), key=lambda row: row[0]
    )
    for number, name, words, _ in rows:
        bit = word.by_number[number]
        assert bit is word.by_name[name]
        assert words in _japanese(bit)
        assert word.mask(name) == word.mask(number) == 1 << number


@pytest.mark.parametrize(("word", "rows", "per_axis"), WORDS)
def test_no_bits_and_no_names_clash(word: Word, rows: Rows, per_axis: Mapping[str, int]) -> None:
    assert len({bit.number for bit in word.bits}) == len(word.bits) == len(rows)
    assert len({bit.name for bit in word.bits}) == len(word.bits)
    assert len({bit.english for bit in word.bits}) == len(word.bits)
    assert len({_japanese(bit) for bit in word.bits}) == len(word.bits)
    assert all(0 <= bit.number <= 31 for bit in word.bits)
    assert all(bit.name.isidentifier() and bit.name.islower() for bit in word.bits)


@pytest.mark.parametrize(("word", "rows", "per_axis"), WORDS)
def test_a_name_without_an_axis_means_both(word: Word, rows: Rows, per_axis: Mapping[str, int]) -> None:
    single = {name: 1 << number for number, name, _, _ in rows}
    assert dict(word.masks) == {**single, **per_axis}
    for name, mask in per_axis.items():
        assert word.mask(name) == mask


@pytest.mark.parametrize(
    "name",
    [-1, 32, True, False, "", "servo", "AY_SERVO_ON", "bit_3", "x" * 1000, 1.0, None, ["servo_on"], 10**5000],
    ids=lambda name: f"{type(name).__name__} {name!s:.12}" if not isinstance(name, int) else f"{name:#x}"[:12],
)
def test_unknown_bits(name: Any) -> None:
    check_unknown_bit(name)


def check_unknown_bit(name: Any) -> None:
    for tongue, text in (("en", "inputs"), ("ja", "入力")):
        i18n.use(tongue)
        with pytest.raises(InvalidValue) as caught:
            V1.inputs.mask(name)
        assert text in str(caught.value)
        assert "bx_servo_on" in str(caught.value)
        assert len(str(caught.value)) < 1000


def test_undefined_bits_have_masks_by_number() -> None:
    assert [V1.inputs.mask(n) for n in range(32)] == [1 << n for n in range(32)]


def test_bits_by_numpy_numbers() -> None:
    np = pytest.importorskip("numpy")
    assert [V1.inputs.mask(np.uint8(n)) for n in range(32)] == [1 << n for n in range(32)]
    check_unknown_bit(np.True_)


def test_the_name_of_a_bit_does_not_mean_both_axes() -> None:
    bits = (Bit(0, "error", "x", "x"), Bit(1, "a_error", "x", "x"), Bit(2, "b_error", "x", "x"))
    assert Word("word", ("x", "x"), bits).masks == {"error": 1, "a_error": 2, "b_error": 4}


# Words sent by the vendor's programs.
def test_words_of_the_vendors_samples() -> None:
    assert V1.inputs.mask("servo_on") | V1.inputs.mask("start") == 0x00003003
    assert V1.inputs.mask("error_reset") == 0x80000000
    assert V2.inputs.mask("servo_on") | V2.inputs.mask("start") == 0x00000303
    selects = V2.inputs.mask("select_0") | V2.inputs.mask("select_1") | V2.inputs.mask("select_2")
    assert 0x00000303 | selects == 0x00007373
    assert V2.inputs.mask("error_reset") == 0x00400000


# --- round trips -----------------------------------------------------------------------------------------------------


@given(st.binary(min_size=8, max_size=8), st.sampled_from(list(DIALECTS)), st.data())
def test_every_frame_survives(data: bytes, dialect_name: str, drawn: st.DataObject) -> None:
    dialect = drawn.draw(st.sampled_from([DIALECTS[dialect_name], TENTHS[dialect_name]]))
    name = drawn.draw(st.sampled_from([each for each in dialect.layouts if each != "BR6"]))
    record = Codec(dialect).decode(name, data)
    assert type(record) is RECORDS[dialect.name][name]
    assert Codec(dialect).encode(record) == Codec(dialect).encode(record, name) == data
    for field, _, first, size, code in FRAMES[dialect.name][name][3]:
        number = int.from_bytes(data[first - 1 : first - 1 + size], "little", signed=code in "hi")
        assert record.raw_values[field] == number
        if code == "I":
            assert getattr(record, field) == Flags(number, Word("", ("", ""), ()))
        if code == "i":
            assert getattr(record, field) == number
            assert isinstance(getattr(record, field), int)


PULSE_COUNTS = [0, 1, -1, 0x7FFFFFFF, -0x80000000]


@pytest.mark.parametrize("name", ["DP1R", "BR4"])
@pytest.mark.parametrize("count", PULSE_COUNTS)
def test_pulse_counts(name: str, count: int) -> None:
    record = Codec(V1).decode(name, struct.pack("<ii", count, -1 - count))
    assert (record.a_pulses, record.b_pulses) == (count, -1 - count)
    assert Codec(V1).encode(record) == struct.pack("<ii", count, -1 - count)


def _loud(word: int) -> bool:
    """Return True for a signalling NaN as a single float: computers turn it into a quiet one."""
    return word & 0x7F800000 == 0x7F800000 and word & 0x007FFFFF != 0 and not word & 0x00400000


SINGLES = st.integers(0, 0xFFFFFFFF) | st.sampled_from(
    [0x7F800000, 0xFF800000, 0x7FC00000, 0xFFC00001, 0x7FFFFFFF, 0x80000000, 1, 0x7F7FFFFF, 0x7F800001]
)


@given(SINGLES, SINGLES)
def test_every_single_float_survives(first: int, second: int) -> None:
    data = struct.pack("<II", first, second)
    record = Codec(V1).decode("BR6", data)
    again = struct.unpack("<II", Codec(V1).encode(record))
    for before, after, value in zip((first, second), again, (record.monitor_0, record.monitor_1), strict=True):
        if _loud(before):
            assert math.isnan(value)
            assert after in (before, before | 0x00400000)
        else:
            assert after == before
