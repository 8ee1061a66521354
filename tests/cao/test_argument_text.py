"""Arguments of functions as text."""

from __future__ import annotations

import pytest

from orinkit.cao.argument_text import read_argument, type_text
from orinkit.cao.functions import controller_execute, robot_move, variable_get_value
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.values.variant import Variant, VarType

pytestmark = pytest.mark.core

HANDLE, INTERPOLATION, POSE, OPTION = robot_move.arguments


@pytest.mark.parametrize(
    ("argument", "text", "value"),
    [
        (HANDLE, "3", 3),
        (INTERPOLATION, "2,7", 7),
        (POSE, "P1", Variant(VarType.BSTR, "P1")),
        (POSE, "0x81501003", Variant(VarType.I4, -2125459453)),
        (OPTION, "NEXT", "NEXT"),
        (OPTION, "8,NEXT", "NEXT"),
        (OPTION, "8197,x", "8197,x"),
        (controller_execute.arguments[1], "100", "100"),
    ],
)
def test_a_value_has_the_type_of_its_argument(argument, text, value):
    assert read_argument(argument, text) == value


@pytest.mark.parametrize("text", ["P1", "1.5", "true"])
def test_a_handle_must_be_a_whole_number(text):
    with pytest.raises(InvalidValue, match=r"not a valid number for the argument handle \(VT_I4\)"):
        read_argument(variable_get_value.arguments[0], text)


def test_invalid_notation_is_refused():
    with pytest.raises(NotationError):
        read_argument(POSE, "8197,x")


def test_any_type_is_called_variant():
    assert (type_text(VarType.VARIANT), type_text(VarType.I4)) == ("VARIANT", "VT_I4")
