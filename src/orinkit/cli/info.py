"""``orinkit info``: what a controller is and how it is."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Any, Final

import orinkit
from orinkit.cli._connection import Connection, Json, Url
from orinkit.cli._terminal import one_line
from orinkit.errors import CallError, ProtocolError
from orinkit.language import pick

_CONNECTION: Final = Connection()
_CLASSES: Final = ("I", "F", "D", "V", "P", "J", "T", "S", "IO")
_SHOWN_NAMES: Final = 12


def info(url: Url, /, *, connection: Connection = _CONNECTION, json: Json = False) -> None:
    """Print type, version, mode, errors, counts and names; what a controller does not tell is left out."""
    from orinkit.cli._output import plain, print_json

    with connection.opened(url) as controller:
        facts = {key: _ask(question, controller) for key, question in _QUESTIONS.items()}
        facts["variables"] = {name: _ask(_reader(f"@VAR_{name}_LEN"), controller) for name in _CLASSES}
        facts["names"] = {key: _ask(question, controller) for key, question in _NAMES.items()}
    if json:
        print_json({"url": url, **plain_facts(facts, plain)})
    else:
        for line in lines(url, facts):
            print(line)


def plain_facts(facts: Any, plain: Callable[[Any], Any]) -> Any:
    """Return the facts as JSON can hold them."""
    if isinstance(facts, dict):
        return {key: plain_facts(value, plain) for key, value in facts.items()}
    return plain(facts)


def _reader(name: str) -> Callable[[orinkit.Controller], Any]:
    def read(controller: orinkit.Controller) -> Any:
        with controller.variable(name) as variable:
            return variable.value

    return read


def _errors(controller: orinkit.Controller) -> list[dict[str, Any]]:
    return [{"code": f"0x{error.code:08X}", "message": error.message} for error in controller.errors()]


_QUESTIONS: Final[dict[str, Callable[[orinkit.Controller], Any]]] = {
    "maker": _reader("@MAKER_NAME"),
    "type": _reader("@TYPE"),
    "version": _reader("@VERSION"),
    "serial_no": _reader("@SERIAL_NO"),
    "mode": _reader("@MODE"),
    "emergency_stop": _reader("@EMERGENCY_STOP"),
    "time": _reader("@CURRENT_TIME"),
    "errors": _errors,
}
_NAMES: Final[dict[str, Callable[[orinkit.Controller], Any]]] = {
    "robots": lambda controller: controller.robot_names(),
    "tasks": lambda controller: controller.task_names(),
    "files": lambda controller: controller.file_names(),
    "extensions": lambda controller: controller.extension_names(),
    "commands": lambda controller: controller.command_names(),
    "variables": lambda controller: controller.variable_names(),
}


def _ask(question: Callable[[orinkit.Controller], Any], controller: orinkit.Controller) -> Any:
    """Return the answer, ``None`` where the controller has none to give."""
    try:
        return question(controller)
    except (CallError, ProtocolError):  # it refuses, or answers with something else than it was asked for
        return None


# --- for people -------------------------------------------------------------------------------------------------------

_MODES: Final = {1: ("manual", "手動"), 2: ("teach check", "ティーチチェック"), 3: ("automatic", "自動")}
_LABELS: Final = {
    "maker": ("maker", "メーカ"), "type": ("type", "型式"), "version": ("version", "バージョン"),
    "serial_no": ("serial number", "シリアル番号"), "mode": ("mode", "モード"),
    "emergency_stop": ("emergency stop", "非常停止"), "time": ("time", "日時"), "errors": ("errors", "エラー"),
    "robots": ("robots", "ロボット"), "tasks": ("tasks", "タスク"), "files": ("files", "ファイル"),
    "extensions": ("extensions", "拡張ボード"), "commands": ("commands", "コマンド"), "variables": ("variables", "変数"),
}  # fmt: skip


def lines(url: str, facts: dict[str, Any]) -> list[str]:
    """Return the facts for people."""
    from orinkit.cli._output import table

    rows = [(pick("controller", "コントローラ"), url)]
    rows += [(pick(*_LABELS[key]), _fact(key, facts[key])) for key in _QUESTIONS if facts[key] is not None]
    counts = [f"{name} {count}" for name, count in facts["variables"].items() if count is not None]
    rows.append((pick("variable counts", "変数の個数"), "  ".join(counts) or "-"))
    rows += [(pick(*_LABELS[key]), _names(facts["names"][key])) for key in _NAMES if facts["names"][key] is not None]
    return table(rows)


def _fact(key: str, value: Any) -> str:
    if key == "mode" and isinstance(value, int) and value in _MODES:
        return f"{value} {pick(*_MODES[value])}"
    if key == "emergency_stop":
        return pick("pressed", "ON") if value else pick("released", "OFF")
    if key == "errors":
        return "\n".join(one_line(f"{error['code']} {error['message']}") for error in value) or pick("none", "なし")
    if isinstance(value, datetime):
        return value.isoformat(" ", "seconds")
    return one_line(str(value))


def _names(names: list[str]) -> str:
    more = len(names) - _SHOWN_NAMES
    shown = one_line(", ".join(names[:_SHOWN_NAMES]))
    return shown + (pick(f" and {more} more", f" 他 {more} 件") if more > 0 else "") if names else "-"
