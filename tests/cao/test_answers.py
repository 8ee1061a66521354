"""Replies on the client side, and missing replies."""

from __future__ import annotations

from typing import Any

import pytest

from orinkit import functions as f
from orinkit.cao.replies import checked, no_answer
from orinkit.core.errors import CallTimeout, ConnectionLost, ProtocolError
from orinkit.values.variant import Variant, VarType

pytestmark = pytest.mark.core


def test_no_answer() -> None:
    late = no_answer(f.robot_move, None, 3.0)
    assert isinstance(late, CallTimeout)
    assert (late.function, late.seconds) == ("Robot_Move", 3.0)
    assert isinstance(no_answer(f.robot_move, b"", 3.0), ConnectionLost)


@pytest.mark.parametrize("exact", [False, True])
def test_results_of_the_right_type(exact: bool) -> None:
    for function, variant in (
        (f.controller_get_robot, Variant(VarType.I4, 5)),
        (f.controller_get_attribute, Variant(VarType.I2, 5)),
        (f.controller_get_name, Variant(VarType.BSTR, "RC8")),
        (f.variable_get_value, Variant(VarType.R4, 0.5)),
        (f.variable_get_value, Variant(VarType.EMPTY)),
    ):
        value: Any = variant if exact else variant.plain
        assert checked(function, value, exact=exact) is value


def test_an_empty_text_may_be_vt_empty() -> None:
    assert checked(f.controller_get_name, None, exact=False) == ""
    assert checked(f.controller_get_name, Variant(VarType.EMPTY), exact=True) == Variant(VarType.BSTR, "")


@pytest.mark.parametrize(
    ("function", "value"),
    [
        (f.controller_get_robot, Variant(VarType.BSTR, "5")),
        (f.controller_get_robot, Variant(VarType.BOOL, True)),
        (f.controller_get_robot, Variant(VarType.EMPTY)),
        (f.controller_get_name, Variant(VarType.I4, 5)),
    ],
)
@pytest.mark.parametrize("exact", [False, True])
def test_results_of_another_type(function: Any, value: Variant, exact: bool) -> None:
    with pytest.raises(ProtocolError, match=function.name):
        checked(function, value if exact else value.plain, exact=exact)
