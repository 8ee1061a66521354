"""Calls that stop motions, and calls that begin them."""

from __future__ import annotations

import pytest

from orinkit.cao import functions as f
from orinkit.rc8.stopping import MAY_MOVE, MAY_STOP, begins_motion, is_stop
from orinkit.values.variant import Variant, VarType, variant

pytestmark = pytest.mark.core

NO_COMMANDS = [
    (), (variant(3),), (variant(3), variant(5)), (variant(3), variant(None)), (variant(3), variant(["Stop"])),
    (variant(3), Variant(VarType.VARIANT, variant("Stop"))),
]  # fmt: skip


@pytest.mark.parametrize("function", [f.robot_halt, f.robot_hold, f.task_stop, f.command_cancel])
def test_functions_that_stop_motions_for_any_arguments(function):
    for arguments in NO_COMMANDS:
        assert is_stop(function.id, arguments)
    assert not begins_motion(function.id, ())


@pytest.mark.parametrize(
    "function",
    [f.robot_move, f.robot_rotate, f.robot_go_home, f.robot_unhold, f.task_start, f.file_run, f.command_execute],
)
def test_functions_that_begin_motions_for_any_arguments(function):
    for arguments in NO_COMMANDS:
        assert begins_motion(function.id, arguments)
    assert not is_stop(function.id, ())


@pytest.mark.parametrize(
    ("function", "command", "stops", "begins"),
    [
        (f.controller_execute, "KillAll", True, False),
        (f.controller_execute, "RunAllTsr", False, True),
        (f.controller_execute, "GetPublicValue", False, False),
        (f.robot_execute, " motionSKIP ", True, False),
        (f.robot_execute, "slvMove", False, True),
        (f.robot_execute, "CurPos", False, False),
        (f.extension_execute, "Stop", True, False),
        (f.extension_execute, "MoveP", False, True),
        (f.extension_execute, "KillAll", False, False),
        (f.robot_execute, "RunAllTsr", False, False),
        (f.variable_put_value, "KillAll", False, False),
    ],
)
def test_commands(function, command, stops, begins):
    """A command counts only for the function that executes it; case and blanks around it are ignored."""
    arguments = (variant(3), variant(command), variant(None))
    assert (is_stop(function.id, arguments), begins_motion(function.id, arguments)) == (stops, begins)


@pytest.mark.parametrize("function", [f.controller_execute, f.robot_execute, f.extension_execute])
@pytest.mark.parametrize("arguments", NO_COMMANDS)
def test_a_call_without_a_command_neither_stops_nor_begins_motions(function, arguments):
    assert function.id in MAY_STOP & MAY_MOVE
    assert not is_stop(function.id, arguments)
    assert not begins_motion(function.id, arguments)
