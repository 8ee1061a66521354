"""Determine from a call whether the arm may still move after the reply to the call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.values.variant import Variant

MOVING: Final = frozenset(
    each.id
    for each in (f.robot_move, f.robot_rotate, f.robot_drive, f.robot_go_home, f.robot_execute, f.command_execute)
)
"""IDs of the functions with which a client begins motions or takes the arm semaphore."""

_MOTIONS: Final = (f.robot_move, f.robot_rotate, f.robot_drive, f.robot_go_home)
_TOGETHER: Final = ("synctimeend", "syncmoveend")  # cooperative control; with the option 1 (NEXT), they do not wait
_NEXT: Final = ("1", "1.0", "NEXT")
_AT_REST: Final = ("givearm",)  # GiveArm waits for the end of the motion


def leaves_moving(function: Function[..., Any], arguments: Sequence[Any]) -> bool | None:
    """Return True if the arm may still move after the reply to a call, False if it is at standstill.

    ``None`` means that the call neither begins nor ends a motion.

    Args:
        function: Entry of the function table.
        arguments: Arguments without the handle.
    """
    if function is f.robot_halt:
        return False
    if function in _MOTIONS:
        return _says_next(arguments)
    if function is not f.robot_execute:
        return None
    if _says_next(arguments[1:]):
        return True
    command = _command(arguments)
    if command in _TOGETHER:
        return any(str(each).strip() in _NEXT for each in _values(arguments[1:]))
    return False if command in _AT_REST else None


def begins_together(function: Function[..., Any], arguments: Sequence[Any]) -> bool:
    """Return True if a call begins the motions of several arms; the arguments are without the handle."""
    return function is f.robot_execute and _command(arguments) in _TOGETHER


def _command(arguments: Sequence[Any]) -> str:
    return str(getattr(arguments[0], "value", arguments[0])).strip().lower() if arguments else ""


def _says_next(arguments: Sequence[Any]) -> bool:
    return any("NEXT" in text.upper() for text in _texts(arguments))


def _texts(value: Any) -> Iterator[str]:
    return (each for each in _values(value) if isinstance(each, str))


def _values(value: Any) -> Iterator[Any]:
    if isinstance(value, Variant):
        value = value.value
    if isinstance(value, list | tuple):
        for each in value:
            yield from _values(each)
    else:
        yield value
