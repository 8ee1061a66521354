"""Which arms of a controller may still move after the calls of one client."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.options import Options
from orinkit.cao.table import Function
from orinkit.rc8.motion_calls import begins_together, leaves_moving

_FIRST: Final = "0"


class MovingArms:
    """The arms that may execute a motion that was forwarded for a client, by the option ``ID`` of their robots."""

    def __init__(self) -> None:
        self._arm_of: dict[int, str] = {}  # by the handle of a robot
        self._moving: set[str] = set()

    def __bool__(self) -> bool:
        return bool(self._moving)

    def connected(self, function: Function[..., Any], arguments: Sequence[Any], handle: object) -> None:
        """Note the handle that a call has returned, if it is that of a robot.

        Args:
            function: Entry of the function table.
            arguments: Arguments without the handle.
            handle: Result of the call.
        """
        if function is f.controller_get_robot and isinstance(handle, int):
            option = arguments[1] if len(arguments) > 1 and isinstance(arguments[1], str) else ""
            self._arm_of[handle] = Options(option).text_of("ID", _FIRST).strip()

    def before(self, function: Function[..., Any], handle: int, arguments: Sequence[Any]) -> None:
        """Note a call that is about to be sent; without a reply, the arm may move."""
        if leaves_moving(function, arguments) is not None:
            self._moving.add(self._arm_of.get(handle, _FIRST))

    def after(self, function: Function[..., Any], handle: int, arguments: Sequence[Any]) -> None:
        """Note a call that has succeeded."""
        moving = leaves_moving(function, arguments)
        if moving is False:
            self._moving.discard(self._arm_of.get(handle, _FIRST))
        elif moving and begins_together(function, arguments):
            self._moving.update(self._arm_of.values())

    def clear(self) -> None:
        """Note that the connection is lost; the controller has stopped all arms of the client."""
        self._arm_of.clear()
        self._moving.clear()
