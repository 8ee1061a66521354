"""``orinkit info``: show information about a controller and its state."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Any, Final

import orinkit
from orinkit.cli._shared.connection import ConnectionOptions, Json, Url
from orinkit.cli._shared.terminal import one_line
from orinkit.core.errors import CallError, ProtocolError
from orinkit.core.i18n import N_, tr

_CONNECTION: Final = ConnectionOptions()
_CLASSES: Final = ("I", "F", "D", "V", "P", "J", "T", "S", "IO")
_SHOWN_NAMES: Final = 12


def info(url: Url, /, *, connection: ConnectionOptions = _CONNECTION, json: Json = False) -> None:
    """Print type, version, mode, errors, variable counts and object names; omit what the controller does not report."""
    from orinkit.cli._shared.output import jsonable, print_json

    with connection.opened(url) as controller:
        facts = {key: _ask(question, controller) for key, question in _QUESTIONS.items()}
        facts["variables"] = {name: _ask(_reader(f"@VAR_{name}_LEN"), controller) for name in _CLASSES}
        facts["names"] = {key: _ask(question, controller) for key, question in _NAMES.items()}
    if json:
        print_json({"url": url, **jsonable_facts(facts, jsonable)})
    else:
        for line in lines(url, facts):
            print(line)


def jsonable_facts(facts: Any, jsonable: Callable[[Any], Any]) -> Any:
    """Convert the information about a controller to types that JSON supports."""
    if isinstance(facts, dict):
        return {key: jsonable_facts(value, jsonable) for key, value in facts.items()}
    return jsonable(facts)


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
    """Return one item of information about a controller; ``None`` if the controller does not report it."""
    try:
        return question(controller)
    except (CallError, ProtocolError):  # the controller refuses, or its reply has an unexpected form
        return None


# --- for people -------------------------------------------------------------------------------------------------------

_MODES: Final = {1: N_("manual"), 2: N_("teach check"), 3: N_("automatic")}
_LABELS: Final = {
    "maker": N_("maker"), "type": N_("type"), "version": N_("version"),
    "serial_no": N_("serial number"), "mode": N_("mode"),
    "emergency_stop": N_("emergency stop"), "time": N_("date and time"), "errors": N_("current errors"),
    "robots": N_("robots"), "tasks": N_("tasks"), "files": N_("files"),
    "extensions": N_("extensions"), "commands": N_("commands"), "variables": N_("variables"),
}  # fmt: skip


def lines(url: str, facts: dict[str, Any]) -> list[str]:
    """Return the information about a controller as lines for people."""
    from orinkit.cli._shared.output import table

    rows = [(tr("controller"), url)]
    rows += [(tr(_LABELS[key]), _fact(key, facts[key])) for key in _QUESTIONS if facts[key] is not None]
    counts = [f"{name} {count}" for name, count in facts["variables"].items() if count is not None]
    rows.append((tr("variable counts"), "  ".join(counts) or "-"))
    rows += [(tr(_LABELS[key]), _names(facts["names"][key])) for key in _NAMES if facts["names"][key] is not None]
    return table(rows)


def _fact(key: str, value: Any) -> str:
    if key == "mode" and isinstance(value, int) and value in _MODES:
        return f"{value} {tr(_MODES[value])}"
    if key == "emergency_stop":
        return tr("pressed") if value else tr("released")
    if key == "errors":
        return "\n".join(one_line(f"{error['code']} {error['message']}") for error in value) or tr("none")
    if isinstance(value, datetime):
        return value.isoformat(" ", "seconds")
    return one_line(str(value))


def _names(names: list[str]) -> str:
    more = len(names) - _SHOWN_NAMES
    shown = one_line(", ".join(names[:_SHOWN_NAMES]))
    return shown + (tr(" and {count} more", count=more) if more > 0 else "") if names else "-"
