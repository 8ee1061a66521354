"""The objects of clients: the controller, the robot, their variables (VE026A 5.2 to 5.4).

Names of variables and commands are case-insensitive. For an unknown variable the return code is E_INVALIDARG, because
table 3-5 has no specific code for this case (a decision of this project); for an unknown command it is
E_INVALIDCOMMAND.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from orinkit.cao.provider import CaoObject, ControllerObject, RobotObject, VariableObject
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.rc8.slave_lateness import COMMAND as LATENESS
from orinkit.rc8.slave_lateness import build_lateness
from orinkit.values.variant import Value, Variant, VarType
from orinkit.virtual.ve026a import parameters
from orinkit.virtual.ve026a.arm import VE026AArm
from orinkit.virtual.ve026a.arm_owner import Operator

VERSION: Final = "VE026A Ver. 1.0.0 (virtual)"
_TYPE: Final = 0  # a vertical arm, as in later controllers; the document does not specify the number

_CONTROLLER_VARIABLES: Final[dict[str, Callable[[VE026AArm], Value]]] = {  # table 5-1
    "@VERSION": lambda _: VERSION,
}
_ROBOT_VARIABLES: Final[dict[str, Callable[[VE026AArm], Value]]] = {  # table 5-3
    "@CURRENT_ANGLE": VE026AArm.angles,
    "@SERVO_ON": lambda arm: Variant(VarType.I2, int(arm.motor_on)),
    "@TYPE": lambda _: Variant(VarType.I4, _TYPE),
}

HANDLES: Final[dict[tuple[str, str], int]] = {
    ("Controller", ""): 1,
    ("Robot", ""): 1,
    ("Variable", "@CURRENT_ANGLE"): 1,
    ("Variable", "@SERVO_ON"): 2,
    ("Variable", "@TYPE"): 3,
    ("Variable", "@VERSION"): 4,
}
"""Handles by interface and name; only variables have a name. The handles of each interface are counted separately, as
in the samples of the document."""


def name_key(name: str) -> str:
    """Return the name of a variable or command, normalized for comparison."""
    return name.strip().upper()


class VE026AVariable(VariableObject):
    """A read-only variable."""

    def __init__(self, arm: VE026AArm, name: str, read: Callable[[VE026AArm], Value]) -> None:
        super().__init__(name)
        self._arm = arm
        self._read = read

    def get_value(self) -> Value:
        """Return the present value."""
        return self._read(self._arm)


class _OfClient(CaoObject):
    """An object of one client.

    Args:
        arm: The arm.
        operator: The client.
        name: Name specified by the client; not used otherwise.
    """

    def __init__(self, arm: VE026AArm, operator: Operator, name: str) -> None:
        super().__init__(name)
        self._arm = arm
        self._operator = operator


class VE026ARobot(_OfClient, RobotObject):
    """The Robot object of one client."""

    def __init__(self, arm: VE026AArm, operator: Operator, name: str) -> None:
        super().__init__(arm, operator, name)
        operator.robots += 1

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Connect to a variable of table 5-3.

        Raises:
            CallError: E_INVALIDARG if there is no such variable.
        """
        return _variable(self._arm, _ROBOT_VARIABLES, name)

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute Motor, slvChangeMode, slvMove or slvGetLateness.

        Raises:
            CallError: E_INVALIDCOMMAND if there is no such command; an error of the command.
        """
        known = _ROBOT_COMMANDS.get(name_key(command))
        if known is None:
            raise error_for(hresult.E_INVALIDCOMMAND, f"{command:.40}")
        return known(self._arm, self._operator, parameter)

    def release(self) -> None:
        """Release the object. If it is the last Robot object of the client, stop the motion and leave slave mode."""
        self._operator.robots -= 1
        if self._operator.robots <= 0:
            self._arm.forget(self._operator)


class VE026AController(_OfClient, ControllerObject):
    """The Controller object of one client."""

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Connect to a variable of table 5-1.

        Raises:
            CallError: E_INVALIDARG if there is no such variable.
        """
        return _variable(self._arm, _CONTROLLER_VARIABLES, name)

    def get_robot(self, name: str, option: str) -> RobotObject:
        """Connect to the robot; any name is accepted."""
        return VE026ARobot(self._arm, self._operator, name)

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute ClearError.

        The reply has no result, as in the sample packet of the document, although table 5-2 lists a result.

        Raises:
            CallError: E_INVALIDCOMMAND if there is no such command; E_INVALIDARG or E_INVALIDARGTYPE if the parameter
                is not an error code; an error of the arm.
        """
        if name_key(command) != "CLEARERROR":
            raise error_for(hresult.E_INVALIDCOMMAND, f"{command:.40}")
        parameters.error_code(parameter)
        return self._arm.clear_error(self._operator)

    def is_moving(self) -> bool:
        """Return True if the client moves the arm in slave mode."""
        return self._arm.slave.owner is self._operator and not self._arm.standing

    def stop_moving(self) -> None:
        """Stop the arm if the client moves it."""
        if self._arm.slave.owner is self._operator:
            self._arm.stop(hresult.E_ABORT)

    def release(self) -> None:
        """Release the object: the client has disconnected."""
        self._arm.forget(self._operator)


def _variable(arm: VE026AArm, variables: Mapping[str, Callable[[VE026AArm], Value]], name: str) -> VariableObject:
    read = variables.get(name_key(name))
    if read is None:
        raise error_for(hresult.E_INVALIDARG, f"{name:.40} ({', '.join(variables)})")
    return VE026AVariable(arm, name_key(name), read)


def _motor(arm: VE026AArm, operator: Operator, parameter: Variant) -> Any:
    return arm.switch_motor(operator, parameters.motor(parameter))


def _change_mode(arm: VE026AArm, operator: Operator, parameter: Variant) -> Any:
    return arm.change_mode(operator, parameters.mode(parameter))


def _move(arm: VE026AArm, operator: Operator, parameter: Variant) -> Any:
    return arm.put_set_point(operator, lambda: parameters.joints(parameter))


def _lateness(arm: VE026AArm, _: Operator, parameter: Variant) -> Variant:
    return build_lateness(arm.slave.lateness(parameters.skip_first_count(parameter)))


_ROBOT_COMMANDS: Final[dict[str, Callable[[VE026AArm, Operator, Variant], Any]]] = {  # table 5-3
    "MOTOR": _motor,
    "SLVCHANGEMODE": _change_mode,
    "SLVMOVE": _move,
    LATENESS.upper(): _lateness,  # does not exist in a real controller
}
