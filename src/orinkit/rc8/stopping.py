"""Determine from a call whether it stops motions, or begins them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.values.variant import Variant, VarType

_STOP_COMMANDS: Final[dict[int, frozenset[str]]] = {
    f.controller_execute.id: frozenset(("killall", "killalltsr", "suspendall", "stepstopall")),
    f.robot_execute.id: frozenset(("motionskip",)),
    f.extension_execute.id: frozenset(("stop",)),
}
"""Commands that stop motions, by the function that executes them."""
_STOPS: Final = frozenset(each.id for each in (f.robot_halt, f.robot_hold, f.task_stop, f.command_cancel))
MAY_STOP: Final = _STOPS | frozenset(_STOP_COMMANDS)
"""IDs of the functions that may stop motions."""

_MOTION_COMMANDS: Final[dict[int, frozenset[str]]] = {
    f.robot_execute.id: frozenset(
        (
            "approach", "depart", "draw", "driveex", "driveaex", "rotateh", "archmove", "slvmove", "synctimeend",
            "syncmoveend", "gohome", "drive", "move", "rotate",
        )
    ),
    f.controller_execute.id: frozenset(("continuestartall", "runalltsr")),
    f.extension_execute.id: frozenset(
        ("chuck", "unchuck", "org", "movep", "movea", "mover", "moveah", "moverh", "moveh", "movezh")
    ),
}  # fmt: skip
"""Commands that begin motions, by the function that executes them."""
_MOTIONS: Final = frozenset(
    each.id
    for each in (
        f.robot_move, f.robot_rotate, f.robot_drive, f.robot_go_home, f.robot_unhold, f.robot_chuck, f.robot_unchuck,
        f.task_start, f.file_run, f.command_execute,
    )
)  # fmt: skip
MAY_MOVE: Final = _MOTIONS | frozenset(_MOTION_COMMANDS)
"""IDs of the functions that may begin motions."""


def is_stop(function_id: int, arguments: Sequence[Any]) -> bool:
    """Return True if a call stops motions.

    Args:
        function_id: ID of the function.
        arguments: arguments with the handle.
    """
    return function_id in _STOPS or _command(arguments) in _STOP_COMMANDS.get(function_id, ())


def begins_motion(function_id: int, arguments: Sequence[Any]) -> bool:
    """Return True if a call begins motions, of the arm or of a program.

    Args:
        function_id: ID of the function.
        arguments: arguments with the handle.
    """
    return function_id in _MOTIONS or _command(arguments) in _MOTION_COMMANDS.get(function_id, ())


def _command(arguments: Sequence[Any]) -> str:
    """Return the name of the command that a call of Execute contains, in lower case; an empty text without one."""
    given = arguments[1] if len(arguments) > 1 else None
    if isinstance(given, Variant) and given.type == VarType.BSTR:
        return str(given.value).strip().lower()
    return ""
