"""The tables of extended commands: they name exactly the commands of the virtual controllers, with valid examples."""

from __future__ import annotations

import pytest

from orinkit.rc8 import commands
from orinkit.values.notation import parse_data
from orinkit.values.variant import VarType
from orinkit.virtual.rc8.objects import controller_commands, extension, robot_commands
from orinkit.virtual.ve026a import objects as ve026a


@pytest.mark.parametrize(
    ("table", "served"),
    [
        (commands.ROBOT_COMMANDS, robot_commands.ROBOT_COMMANDS),
        (commands.CONTROLLER_COMMANDS, controller_commands.COMMANDS),
        (commands.EXTENSION_COMMANDS, extension.EXTENSION_COMMANDS),
        (commands.VE026A_ROBOT_COMMANDS, ve026a._ROBOT_COMMANDS),
    ],
)
def test_the_virtual_controllers_have_the_commands_of_the_tables(table, served):
    names = [command.name.lower() for command in table]
    assert len(set(names)) == len(names)
    assert set(names) == {name.lower() for name in served}


def test_every_example_fits_the_type_of_its_parameter():
    examples = [each for tables in commands.COMMANDS.values() for table in tables.values() for each in table]
    assert len(examples) > 90
    for each in examples:
        assert (each.vt == VarType.EMPTY) == (not each.example) == (not each.hint)
        assert parse_data(each.vt, each.example).type == each.vt
