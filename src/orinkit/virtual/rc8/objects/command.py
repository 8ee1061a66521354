"""Command objects (Controller_GetCommand): commands that a client can start, monitor and cancel, with a time-out.

The name of an object is the name of a command of Controller_Execute, of the robot or of the hand, optionally with the
robot or the hand as a prefix: ``Robot.Motor``, ``Hand0.Chuck``. The documents do not define the states of a command,
nor the return codes of a cancelled command; the states and codes used here are specific to orinkit.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from enum import IntEnum
from typing import Any, Final

from orinkit.cao.provider import CommandObject, Deferred, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.engine.timers import Timer
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.hand.fingers import Fingers
from orinkit.virtual.rc8.objects import controller_commands, robot_commands
from orinkit.virtual.rc8.objects.extension import EXTENSION_COMMANDS, extension_names, find_gripper
from orinkit.virtual.rc8.objects.hand_commands import ROBOT_COMMANDS as HAND_COMMANDS
from orinkit.virtual.rc8.state import RC8State

WAIT, AT_ONCE = 0, 1
MOST_EXECUTING: Final = 256
"""Maximum number of Command objects of all clients that execute at the same time."""
_OF_HAND: Final = frozenset(command.name.lower() for command in HAND_COMMANDS)
_NOT_OF_ROBOT: Final = frozenset(name.lower() for name in robot_commands.NOT_SIMULATED)


class CommandState(IntEnum):
    """The values of Command_GetState."""

    IDLE = 0
    EXECUTING = 1
    DONE = 2
    FAILED = 3
    CANCELLED = 4


@record
class CommandRoute:
    """The functions that execute and stop a command.

    Attributes:
        run: Executes the command.
        stop: Stops the motion of the command, so that the command's Deferred fails; returns False if nothing moves.
    """

    run: Callable[[ClientContext, Variant], Any]
    stop: Callable[[ClientContext, int], bool]


class RC8Command(CommandObject):
    """The Command object of one client."""

    def __init__(self, caller: ClientContext, name: str, route: CommandRoute) -> None:
        super().__init__(name, attribute=int(caller.access), help=caller.state.say("Command") + f" {name}")
        self._caller = caller
        self._route = route
        self._parameters = Variant(VarType.EMPTY)
        self._timeout = 0
        self._state = CommandState.IDLE
        self._result: Any = None
        self._error: BaseException | None = None
        self._cancel_code = 0  # the code with which the execution is being cancelled; otherwise 0
        self._inner: Deferred[Any] | None = None
        self._finished = Deferred[None]()
        self._timer: Timer | None = None

    def execute(self, mode: int) -> Deferred[None] | None:
        """Execute the command with its parameters.

        In mode 0, the call completes when the command is complete, and fails if the command fails. In mode 1, the call
        completes immediately.

        Raises:
            CallError: E_INVALIDARG if the mode is unknown; E_CAO_CMD_EXECUTE if the command is executing; E_MAX_OBJECT
                if too many commands are executing.
        """
        if mode not in (WAIT, AT_ONCE):
            raise error_for(
                hresult.E_INVALIDARG,
                tr("mode {mode} is not 0 (wait) or 1 (return immediately)", mode=mode),
            )
        if self._state is CommandState.EXECUTING:
            raise error_for(hresult.E_CAO_CMD_EXECUTE, self.name)
        if self._caller.state.executing_commands >= MOST_EXECUTING:
            raise error_for(
                hresult.E_MAX_OBJECT,
                tr("{most} commands are executing. Try: wait until one of them has completed", most=MOST_EXECUTING),
            )
        self._start()
        return self._finished if mode == WAIT else None

    def cancel(self) -> Deferred[None] | None:
        """Cancel the execution; if the command is not executing, do nothing.

        The call completes when the motion of the command is at standstill.
        """
        return self._cancel(hresult.E_CANCEL) if self._state is CommandState.EXECUTING else None

    def get_state(self) -> int:
        """Return the state (:class:`CommandState`)."""
        return self._state

    def get_result(self) -> Any:
        """Return the result of the last execution; VT_EMPTY before the first one.

        Raises:
            CallError: E_CAO_CMD_EXECUTE if the command is executing; E_CANCEL if it was cancelled; E_TIMEOUT if it
                timed out; otherwise the code with which the command failed.
        """
        if self._state is CommandState.EXECUTING:
            raise error_for(hresult.E_CAO_CMD_EXECUTE, self.name)
        if self._error is not None:
            raise self._error
        return self._result

    def get_parameters(self) -> Variant:
        """Return the parameter of the command."""
        return self._parameters

    def put_parameters(self, parameters: Variant) -> None:
        """Set the parameter for the next execution, in the form used by Controller_Execute and Robot_Execute."""
        self._parameters = parameters

    def get_timeout(self) -> int:
        """Return the time-out in ms; 0 for none."""
        return self._timeout

    def put_timeout(self, timeout: int) -> None:
        """Set the time-out for the next execution, in ms of the controller's time; 0 for none.

        Raises:
            CallError: E_INVALIDARG if the time-out is negative.
        """
        if timeout < 0:
            raise error_for(hresult.E_INVALIDARG, tr("the time-out is negative: {timeout} ms", timeout=timeout))
        self._timeout = timeout

    def release(self) -> None:
        """Release the object and cancel the execution."""
        if self._state is CommandState.EXECUTING:
            self._cancel(hresult.E_CANCEL)

    # --- execution ----------------------------------------------------------------------------------------------

    def _start(self) -> None:
        self._state = CommandState.EXECUTING
        self._caller.state.executing_commands += 1
        self._result, self._error, self._cancel_code = None, None, 0
        self._finished = Deferred[None]()
        try:
            answer = self._route.run(self._caller, self._parameters)
        except Exception as error:  # noqa: BLE001 - the command fails with it, not Command_Execute
            self._finish(CommandState.FAILED, error=error)
            return
        if not isinstance(answer, Deferred):
            self._finish(CommandState.DONE, answer)
            return
        if self._timeout and not answer.done():
            self._timer = self._caller.state.timers.after(self._timeout, self._on_timeout)
        self._wait_for(answer)

    def _on_timeout(self) -> None:
        self._cancel(hresult.E_TIMEOUT)

    def _wait_for(self, inner: Deferred[Any]) -> None:
        self._inner = inner
        inner.add_done_callback(lambda: self._on_done(inner))

    def _cancel(self, code: int) -> Deferred[None]:
        """Cancel the execution, which then fails with ``code``; return a Deferred that resolves when it has ended."""
        ended = Deferred[None]()
        self._finished.add_done_callback(ended.set_result)
        if not self._cancel_code:
            self._cancel_code = code
            if self._inner is not None and self._caller.robot.arm.withdraw(self._inner):
                return ended  # the command has not begun: nothing is to be stopped
            if not self._route.stop(self._caller, code):
                inner = self._inner
                self._finish_cancelled()
                if inner is not None:
                    inner.abandon()  # ForceWaitCondition must not stop a later motion
        return ended

    def _on_done(self, inner: Deferred[Any]) -> None:
        if inner is not self._inner:  # it belongs to an earlier, cancelled execution
            return
        if self._cancel_code:
            self._finish_cancelled()
            return
        try:
            result = inner.result()
        except Exception as error:  # noqa: BLE001 - as in _start
            self._finish(CommandState.FAILED, error=error)
        else:
            if isinstance(result, Deferred):  # the motion has been planned
                self._wait_for(result)
            else:
                self._finish(CommandState.DONE, result)

    def _finish_cancelled(self) -> None:
        self._finish(CommandState.CANCELLED, error=error_for(self._cancel_code, self.name))

    def _finish(self, state: CommandState, result: Any = None, error: BaseException | None = None) -> None:
        self._caller.state.executing_commands -= 1
        self._state, self._result, self._error, self._inner = state, result, error, None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if error is None:
            self._finished.set_result()
        else:
            self._finished.set_exception(error)


def find_command(caller: ClientContext, name: str) -> RC8Command:
    """Return a command by its name; case-insensitive.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the command.
    """
    return RC8Command(caller.of_robot(_robot_number(caller.state, name)), name, _route(caller.state, name))


def command_names(state: RC8State) -> list[str]:
    """Return the names of all commands; commands of the robot and the hands have a prefix, ``Robot.`` or ``Hand0.``."""
    return [
        *(command.name for command in controller_commands.COMMANDS.values()),
        *(f"Robot.{command.name}" for command in robot_commands.ROBOT_COMMANDS.values()),
        *(
            f"{robot.name}.{command.name}"
            for robot in itertools.islice(state.robots, 1, None)
            for command in robot_commands.ROBOT_COMMANDS.values()
        ),
        *(f"{hand}.{command.name}" for hand in extension_names(state) for command in EXTENSION_COMMANDS.values()),
    ]


def _route(state: RC8State, name: str) -> CommandRoute:
    owner, _, command = (part.strip().lower() for part in name.rpartition("."))
    if not owner and command in controller_commands.COMMANDS:
        stop = _stop_hands if command in _OF_HAND else _nothing
        return CommandRoute(lambda caller, parameter: controller_commands.execute(caller, command, parameter), stop)
    gripper = find_gripper(state, owner)
    if gripper is not None and command in EXTENSION_COMMANDS:
        found = EXTENSION_COMMANDS[command]
        return CommandRoute(
            lambda caller, parameter: found.execute(caller, gripper, parameter),
            lambda _, code: _stop_hand(gripper, code),
        )
    if owner in ("", "robot", *(robot.name.lower() for robot in state.robots)):
        if command in robot_commands.ROBOT_COMMANDS:
            stop = _stop_hands if command in _OF_HAND else _stop_arm
            return CommandRoute(lambda caller, parameter: robot_commands.execute(caller, command, parameter), stop)
        if command in _NOT_OF_ROBOT:
            raise error_for(hresult.E_NOTIMPL, f"{name:.40}")
    raise not_found(f"{name:.40}")


def _robot_number(state: RC8State, name: str) -> int:
    """Return the number of the robot that the prefix of a name names; 0 without such a prefix."""
    owner = name.rpartition(".")[0].strip().lower()
    return next((robot.number for robot in state.robots if robot.name.lower() == owner), 0)


def _stop_arm(caller: ClientContext, code: int) -> bool:
    arm = caller.robot.arm
    if arm.holder is not caller or not (arm.busy or arm.slave.has_work):
        return False
    arm.stop(code)
    return True


def _stop_hands(caller: ClientContext, code: int) -> bool:
    hands = caller.state.hands
    stopped = [_stop_hand(hand, code) for hand in (hands.cobotta, hands.two_finger)]
    return any(stopped)


def _stop_hand(hand: Fingers, code: int) -> bool:
    if not hand.busy:
        return False
    hand.stop(code)
    return True


def _nothing(_caller: ClientContext, _code: int) -> bool:
    return False
