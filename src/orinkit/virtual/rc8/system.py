"""The controller's system variables: THE TABLE of names, types, where each value comes from, and what may be set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit import hresult
from orinkit.errors import error_for
from orinkit.language import pick
from orinkit.variant import Variant, VarType
from orinkit.virtual.rc8 import classes, conversion
from orinkit.virtual.rc8.caller import Caller
from orinkit.virtual.rc8.state import Operation, State


@dataclass(frozen=True, slots=True)
class SystemVariable:
    """One entry.

    Attributes:
        name: with its ``@``, in capitals.
        vt: VARIANT type of its value.
        read: takes the value from the controller.
        en: what it is, in English.
        ja: the same in Japanese.
        write: sets it for a client; ``None`` for one that cannot be set.
    """

    name: str
    vt: int
    read: Callable[[State], Any]
    en: str
    ja: str
    write: Callable[[Caller, Variant], None] | None = None


def _milliseconds(state: State) -> int:
    """Milliseconds since power-on; after 24.8 days it goes on from the lowest VT_I4, as a 32-bit counter does."""
    return (int(state.seconds * 1000) + 2**31) % 2**32 - 2**31


def _clear_error(caller: Caller, given: Variant) -> None:
    code = conversion.whole(given)
    if code != 0:
        raise error_for(
            hresult.E_INVALIDARG,
            pick(
                f"only 0, which clears the errors, can be written, not {code}",
                f"書き込めるのは 0 (エラークリア) だけです: {code}",
            ),
        )
    caller.state.clear_errors(caller.origin)


def _set_time(caller: Caller, given: Variant) -> None:
    state = caller.state
    moment = conversion.moment(given)
    state.calendar.set(moment)
    text = state.say(f"Time set to {moment:%Y-%m-%d %H:%M:%S}", f"時刻を {moment:%Y-%m-%d %H:%M:%S} に設定")
    state.log(Operation.SET_TIME, text, caller.origin)


def _set_lock(caller: Caller, given: Variant) -> None:
    caller.state.machine_lock(conversion.boolean(given), caller.origin)


def _count(name: str) -> SystemVariable:
    return SystemVariable(
        f"@VAR_{name}_LEN",
        VarType.I4,
        lambda state: state.variables.counts[name],
        f"Number of {name} variables",
        f"{name} 型変数の個数",
    )


SYSTEM_VARIABLES: Final[dict[str, SystemVariable]] = {
    entry.name: entry
    for entry in (
        SystemVariable("@MODE", VarType.I4, lambda s: s.switches.mode,
                       "Mode: 1 manual, 2 teach check, 3 automatic", "モード: 1 手動、2 ティーチチェック、3 自動"),
        SystemVariable("@ERROR_CODE", VarType.I4, lambda s: hresult.signed(s.faults.code),
                       "Newest current error, 0 none; writing 0 clears the errors",
                       "最新のエラーコード (0 はなし)。0 の書き込みでエラークリア", _clear_error),
        SystemVariable("@ERROR_CODE_HEX", VarType.BSTR, lambda s: f"{s.faults.code:08X}",
                       "Newest current error as eight hexadecimal digits", "最新のエラーコード (16 進 8 桁)"),
        SystemVariable("@ERROR_DESCRIPTION", VarType.BSTR, lambda s: s.faults.message,
                       "Text of the newest current error", "最新のエラーの内容"),
        SystemVariable("@EMERGENCY_STOP", VarType.BOOL, lambda s: s.switches.emergency_stop,
                       "Emergency stop is pressed", "非常停止状態"),
        SystemVariable("@DEADMAN_SW", VarType.BOOL, lambda s: s.switches.deadman,
                       "Enable (deadman) switch is held", "イネーブル (デッドマン) スイッチの状態"),
        SystemVariable("@AUTO_ENABLE", VarType.BOOL, lambda s: s.switches.auto_enable,
                       "Auto-enable input is on", "自動イネーブル入力の状態"),
        SystemVariable("@PROTECTIVE_STOP", VarType.BOOL, lambda s: s.switches.protective_stop,
                       "Protective stop is on", "防護停止状態"),
        SystemVariable("@LOCK", VarType.BOOL, lambda s: s.switches.machine_lock,
                       "Machine lock: the robot does not really move", "マシンロックの状態", _set_lock),
        SystemVariable("@BUSY_STATUS", VarType.BOOL, lambda s: s.programs_running > 0,
                       "A program task is running", "プログラム実行中"),
        SystemVariable("@NORMAL_STATUS", VarType.BOOL, lambda s: s.faults.code == 0,
                       "There is no error", "エラーなし (正常状態)"),
        SystemVariable("@TSR_BUSY_STATUS", VarType.BOOL, lambda s: s.supervisors_running > 0,
                       "A supervisory task (TSR) is running", "TSR 実行中"),
        SystemVariable("@TIME", VarType.I4, _milliseconds,
                       "Milliseconds since power-on", "電源投入からの経過時間 [ms]"),
        SystemVariable("@CURRENT_TIME", VarType.DATE, lambda s: s.calendar.now(),
                       "Local date and time", "現在の日時", _set_time),
        SystemVariable("@MAKER_NAME", VarType.BSTR, lambda s: s.identity.maker, "Maker", "製造者名"),
        SystemVariable("@TYPE", VarType.BSTR, lambda s: s.identity.type, "Type of the controller", "コントローラの型式"),
        SystemVariable("@VERSION", VarType.BSTR, lambda s: s.identity.version, "Software version", "ソフトウェアのバージョン"),
        SystemVariable("@SERIAL_NO", VarType.BSTR, lambda s: s.identity.serial_no, "Serial number", "シリアル番号"),
        SystemVariable("@IO_ALLOC_MODE", VarType.I4, lambda _: classes.IO_ALLOCATION_MINI,
                       "I/O allocation: 0 mini", "I/O 割り付けモード: 0 ミニ"),
        *map(_count, classes.USER_CLASSES),
        SystemVariable("@VAR_IO_LEN", VarType.I4, lambda s: s.variables.io_points, "Number of I/O points", "I/O の点数"),
    )
}  # fmt: skip
