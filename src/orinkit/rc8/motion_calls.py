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
    command = str(getattr(arguments[0], "value", arguments[0])).strip().lower() if arguments else ""
    return False if command in _AT_REST else None


def _says_next(arguments: Sequence[Any]) -> bool:
    return any("NEXT" in text.upper() for text in _texts(arguments))


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, Variant):
        value = value.value
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _texts(each)
