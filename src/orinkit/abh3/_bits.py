"""The bits of all flag words of an ABH3, as data: name, both texts, and how input and terminal make the control flag.

A name with ``ay_`` and ``bx_`` (``a_`` and ``b_``) in front is of one axis; without them it means both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final


class Logic(Enum):
    """How a terminal of the driver and a bit from CAN together make the bit of the control flag."""

    AND = "and"
    OR = "or"
    NOT_AND = "not and"


@dataclass(frozen=True, slots=True)
class Bit:
    """One bit of a flag word.

    Attributes:
        number: 0 to 31.
        name: for programs.
        en: what it says when it is 1.
        ja: the same in Japanese.
        logic: how it is combined with a terminal; ``None`` where it is not.
    """

    number: int
    name: str
    en: str
    ja: str
    logic: Logic | None = None


def _axis(first: int, letter: str, names: tuple[tuple[int, str, str, str, Logic], ...]) -> tuple[Bit, ...]:
    small = letter.replace("/", "").lower()
    return tuple(
        Bit(first + offset, f"{small}_{name}", f"{letter} {en}", f"{letter} {ja}", logic)
        for offset, name, en, ja, logic in names
    )


def _pair(first: int, name: str, en: str, ja: str) -> tuple[Bit, ...]:
    return tuple(
        Bit(first + offset, f"{axis}_{name}", f"{axis.upper()} axis {en}", f"{axis.upper()} 軸 {ja}")
        for offset, axis in enumerate("ab")
    )


def _numbered(first: int, count: int, name: str, en: str, ja: str) -> tuple[Bit, ...]:
    return tuple(Bit(first + n, f"{name}_{n}", f"{en} {n}", f"{ja} {n}") for n in range(count))


def _terminals(first: int, numbers: tuple[int, ...]) -> tuple[Bit, ...]:
    return tuple(
        Bit(first + place, f"di_{n}", f"digital input #{n}", f"デジタル入力 #{n}") for place, n in enumerate(numbers)
    )


# --- what a host asks for, and what the driver makes of it ------------------------------------------------------------


def _of_an_axis(select: Logic) -> tuple[tuple[int, str, str, str, Logic], ...]:
    return (
        (0, "servo_on", "servo on", "サーボ ON", Logic.AND),
        (1, "start", "start", "スタート", Logic.AND),
        (2, "polarity", "command polarity inverted", "指令極性 反転", Logic.AND),
        (3, "correction", "correction added", "補正加算", Logic.AND),
        (4, "select_0", "data select 0", "データ選択 0", select),
        (5, "select_1", "data select 1", "データ選択 1", select),
        (6, "select_2", "data select 2", "データ選択 2", select),
    )


_POLARITY: Final = (7, "correction_polarity", "correction subtracted", "補正極性 減算", Logic.AND)
_POLARITY_BX_V1: Final = (11, "correction_polarity", "correction subtracted", "補正極性 減算", Logic.AND)

INPUTS_V1: Final = (
    *_axis(0, "A/Y", (*_of_an_axis(Logic.NOT_AND), _POLARITY)),
    Bit(8, "a_pulse_clear", "A axis pulse count cleared (0 to 1)", "A 軸積算クリア (0→1)", Logic.OR),
    *_axis(12, "B/X", (*_of_an_axis(Logic.NOT_AND), _POLARITY_BX_V1)),
    Bit(19, "b_pulse_clear", "B axis pulse count cleared (0 to 1)", "B 軸積算クリア (0→1)", Logic.OR),
    Bit(24, "ay_torque", "A/Y torque (0: speed)", "A/Y トルク (0: 速度)", Logic.AND),
    Bit(25, "bx_torque", "B/X torque (0: speed)", "B/X トルク (0: 速度)", Logic.AND),
    Bit(26, "slave", "slave (0: master)", "スレーブ (0: マスタ)", Logic.AND),
    Bit(28, "brake_release", "brake released (0: with servo and error)", "ブレーキ解放 (0: サーボ・異常に連動)", Logic.AND),
    Bit(31, "error_reset", "errors reset (0 to 1), servo off", "エラーリセット (0→1)、サーボ OFF", Logic.OR),
)  # fmt: skip
CONTROL_V1: Final = (
    *INPUTS_V1,
    Bit(27, "travel_model", "travel axis model (0: motor axis model)", "走行軸モデル (0: モータ軸モデル)"),
)

INPUTS_V2: Final = (
    *_axis(0, "A/Y", (*_of_an_axis(Logic.AND), _POLARITY)),
    *_axis(8, "B/X", (*_of_an_axis(Logic.AND), _POLARITY)),
    Bit(16, "ay_torque", "A/Y torque (0: speed)", "A/Y トルク (0: 速度)", Logic.AND),
    Bit(17, "bx_torque", "B/X torque (0: speed)", "B/X トルク (0: 速度)", Logic.AND),
    Bit(18, "slave", "master and slave", "マスタ/スレーブ 有効", Logic.AND),
    Bit(19, "brake_release", "brake released (0: with servo and error)", "ブレーキ解放 (0: サーボ・異常に連動)", Logic.AND),
    Bit(20, "a_pulse_clear", "A axis pulse count cleared (0 to 1)", "A 軸積算クリア (0→1)", Logic.OR),
    Bit(21, "b_pulse_clear", "B axis pulse count cleared (0 to 1)", "B 軸積算クリア (0→1)", Logic.OR),
    Bit(22, "error_reset", "errors reset (0 to 1), servo off while 1", "エラーリセット (0→1)、1 の間サーボ OFF", Logic.OR),
)  # fmt: skip
CONTROL_V2: Final = (
    *INPUTS_V2,
    Bit(25, "ay_ready", "A/Y ready", "A/Y レディ"),
    Bit(26, "ay_busy", "A/Y busy", "A/Y ビジー"),
    Bit(27, "bx_ready", "B/X ready", "B/X レディ"),
    Bit(28, "bx_busy", "B/X busy", "B/X ビジー"),
    Bit(29, "travel_model", "travel axis model (0: motor axis model)", "走行軸モデル (0: モータ軸モデル)"),
    Bit(30, "brake_released", "brake is released", "ブレーキ解放中"),
    Bit(31, "error", "an error is present", "エラー発生"),
)

# --- what is wrong ----------------------------------------------------------------------------------------------------

FAULTS_V1: Final = (
    *_pair(0, "mechanical_lock", "mechanical lock", "メカロック"),
    Bit(2, "overheat", "driver overheated", "ドライバ過熱"),
    Bit(3, "brake", "brake fault", "ブレーキ異常"),
    *_pair(4, "resolver", "resolver fault", "レゾルバ異常"),
    *_pair(6, "overcurrent", "overcurrent", "過電流"),
    Bit(8, "control_undervoltage", "control supply undervoltage", "制御電源 電圧低下"),
    Bit(9, "parameter", "parameter fault", "パラメータ異常"),
    *_pair(10, "pdu", "PDU fault", "PDU 異常"),
    *_pair(12, "electronic_thermal", "electronic thermal relay", "電子サーマル"),
    Bit(14, "main_undervoltage", "main supply undervoltage", "主電源 電圧低下"),
    Bit(15, "overvoltage", "control or main supply overvoltage", "制御電源・主電源 過電圧"),
    *_pair(16, "overspeed", "overspeed", "過速度"),
    *_pair(18, "speed_limit", "speed limit", "速度リミット"),
    *_pair(20, "current_limit", "current limit", "電流リミット"),
    Bit(22, "can_communication", "CAN communication time-out", "CAN 通信異常 (タイムアウト)"),
    Bit(23, "can_traffic", "CAN traffic overload", "CAN 通信トラフィック過大"),
)
ERRORS_V2: Final = (*FAULTS_V1, *_numbered(28, 4, "error_code", "error code bit", "エラーコード"))
WARNINGS_V2: Final = (*FAULTS_V1, *_numbered(28, 4, "alarm_code", "alarm code bit", "アラームコード"))

# --- terminals --------------------------------------------------------------------------------------------------------

IO_V1: Final = (
    Bit(0, "error", "an error is present", "エラー発生"),
    Bit(1, "alarm", "an alarm is present", "アラーム発生"),
    Bit(2, "ay_ready", "A/Y ready", "A/Y レディ"),
    Bit(3, "ay_busy", "A/Y busy", "A/Y ビジー"),
    Bit(4, "bx_ready", "B/X ready", "B/X レディ"),
    Bit(5, "bx_busy", "B/X busy", "B/X ビジー"),
    *_numbered(6, 4, "error_code", "error code bit", "エラーコード"),
    Bit(10, "brake_released", "brake is released", "ブレーキ解放中"),
    *_terminals(11, (0, 1, 2, 3, 12, 13, 14, 15, 16, 17, 18, 19, 4, 5, 6, 7, 8, 9, 10, 11)),
    Bit(31, "error_reset_input", "error reset terminal", "エラーリセット入力"),
)
IO_V2: Final = (
    *(Bit(n, f"do_{n}", f"digital output #{n}", f"デジタル出力 #{n}") for n in range(8)),
    *_terminals(8, tuple(range(20))),
    Bit(31, "error_reset_input", "error reset terminal", "エラーリセット入力"),
)
