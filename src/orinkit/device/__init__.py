"""User-written devices: classes whose decorated methods clients can call over all protocols of a server.

::

    class Gripper(Device):
        @variable("width")
        def width(self) -> float: ...
"""

from __future__ import annotations

from orinkit.device.declarations import command, command_object, extension, file, robot, task, user_function, variable
from orinkit.device.device import Device, Part

__all__ = [
    "Device",
    "Part",
    "command",
    "command_object",
    "extension",
    "file",
    "robot",
    "task",
    "user_function",
    "variable",
]
