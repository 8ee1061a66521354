"""All commands of the robot that clients and programs share, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from orinkit.virtual.rc8.robot.accuracy_commands import ACCURACY_COMMANDS
from orinkit.virtual.rc8.robot.force_commands import FORCE_COMMANDS
from orinkit.virtual.rc8.robot.frame_commands import FRAME_COMMANDS
from orinkit.virtual.rc8.robot.progress_commands import PROGRESS_COMMANDS
from orinkit.virtual.rc8.robot.servo_commands import SERVO_COMMANDS
from orinkit.virtual.rc8.robot.shared_command import SharedCommand

SHARED_COMMANDS: Final[Mapping[str, SharedCommand]] = {
    each.name: each
    for each in (*PROGRESS_COMMANDS, *ACCURACY_COMMANDS, *FRAME_COMMANDS, *SERVO_COMMANDS, *FORCE_COMMANDS)
}
"""The commands."""
