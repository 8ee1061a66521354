"""Command objects (Controller_GetCommand): a command that is started, watched, cancelled and given a time-out.

A name is that of any command of Controller_Execute or of the robot, or one with its owner in front: ``Robot.Motor``,
``Hand0.Chuck``. States, and what a cancelled command answers, are this project's rulings: the documents name none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from orinkit.cao.provider import CommandObject, Deferred, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.engine.timers import Timer
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects import controller_commands, robot_commands
from orinkit.virtual.rc8.objects.extension import CONTROLLER_COMMANDS as HAND_COMMANDS
from orinkit.virtual.rc8.objects.extension import EXTENSION_COMMANDS, HAND_NAME

WAIT, AT_ONCE = 0, 1
_ROBOTS: Final = ("robot", "arm0")
_OF_HAND: Final = frozenset(command.name.lower() for command in HAND_COMMANDS)
_NOT_OF_ROBOT: Final = frozenset(name.lower() for name in robot_commands.NOT_SIMULATED)
_NOT_SIMULATED: Final = frozenset(command.name for command in HAND_COMMANDS if not command.simulated)


class CommandState(IntEnum):
    """What Command_GetState answers."""

    IDLE = 0
    EXECUTING = 1
    DONE = 2
    FAILED = 3
    CANCELLED = 4


@dataclass(frozen=True, slots=True)
class CommandRoute:
    """Where a command goes.

    Attributes:
        run: executes it.
        stop: brings to rest what it has begun, so that its promise is broken; returns whether there was such a thing.
    """

    run: Callable[[ClientContext, Variant], Any]
    stop: Callable[[ClientContext, int], bool]


class RC8Command(CommandObject):
    """One client's command."""

    def __init__(self, caller: ClientContext, name: str, route: CommandRoute) -> None:
        super().__init__(name, attribute=int(caller.access), help=caller.state.say("Command") + f" {name}")
        self._caller = caller
        self._route = route
        self._parameters = Variant(VarType.EMPTY)
        self._timeout = 0
        self._state = CommandState.IDLE
        self._result: Any = None
        self._error: BaseException | None = None
        self._ending = 0  # the code with which it is being cancelled
        self._inner: Deferred[Any] | None = None
        self._over = Deferred[None]()
        self._timer: Timer | None = None

    def execute(self, mode: int) -> Deferred[None] | None:
        """Execute it with its parameters: 0 answers when it is over, with its error if it failed, 1 at once.

        Raises:
            CallError: E_INVALIDARG, another mode; E_CAO_CMD_EXECUTE, it is being executed.
        """
        if mode not in (WAIT, AT_ONCE):
            raise error_for(
                hresult.E_INVALIDARG,
                tr("mode {mode}; 0 waits, 1 returns at once", mode=mode),
            )
        if self._state is CommandState.EXECUTING:
            raise error_for(hresult.E_CAO_CMD_EXECUTE, self.name)
        self._begin()
        return self._over if mode == WAIT else None

    def cancel(self) -> Deferred[None] | None:
        """Cancel it; answers when what it has begun is at rest. One that is not being executed stays as it is."""
        return self._end(hresult.E_CANCEL) if self._state is CommandState.EXECUTING else None

    def get_state(self) -> int:
        """What it is doing (:class:`CommandState`)."""
        return self._state

    def get_result(self) -> Any:
        """The result of the last execution; VT_EMPTY before the first one.

        Raises:
            CallError: what the command failed with: E_CANCEL where it was cancelled, E_TIMEOUT where its time was up;
                E_CAO_CMD_EXECUTE, it is being executed.
        """
        if self._state is CommandState.EXECUTING:
            raise error_for(hresult.E_CAO_CMD_EXECUTE, self.name)
        if self._error is not None:
            raise self._error
        return self._result

    def get_parameters(self) -> Variant:
        """The parameter that it is executed with."""
        return self._parameters

    def put_parameters(self, parameters: Variant) -> None:
        """Set the parameter, as it is given to Execute; for the next execution."""
        self._parameters = parameters

    def get_timeout(self) -> int:
        """Time-out in ms; 0 for none."""
        return self._timeout

    def put_timeout(self, timeout: int) -> None:
        """Set the time-out in ms of the controller's time, for the next execution; 0 for none.

        Raises:
            CallError: E_INVALIDARG, it is negative.
        """
        if timeout < 0:
            raise error_for(hresult.E_INVALIDARG, tr("time-out {timeout} ms", timeout=timeout))
        self._timeout = timeout

    def release(self) -> None:
        """Let go: it is cancelled."""
        if self._state is CommandState.EXECUTING:
            self._end(hresult.E_CANCEL)

    # --- from beginning to end ----------------------------------------------------------------------------------

    def _begin(self) -> None:
        self._state = CommandState.EXECUTING
        self._result, self._error, self._ending = None, None, 0
        self._over = Deferred[None]()
        try:
            answer = self._route.run(self._caller, self._parameters)
        except Exception as error:  # noqa: BLE001 - it is the command that has failed, not Command_Execute
            self._settle(CommandState.FAILED, error=error)
            return
        if not isinstance(answer, Deferred):
            self._settle(CommandState.DONE, answer)
            return
        if self._timeout and not answer.done():
            self._timer = self._caller.state.timers.after(self._timeout, lambda: self._time_up(answer))
        self._inner = answer
        answer.add_done_callback(lambda: self._answered(answer))

    def _time_up(self, inner: Deferred[Any]) -> None:
        if inner is self._inner:
            self._end(hresult.E_TIMEOUT)

    def _end(self, code: int) -> Deferred[None]:
        """Cancel what is being executed; returns what is kept when it is over."""
        over = Deferred[None]()
        self._over.add_done_callback(over.set_result)
        if not self._ending:
            self._ending = code
            if not self._route.stop(self._caller, code):
                self._cancelled()
        return over

    def _answered(self, inner: Deferred[Any]) -> None:
        if inner is not self._inner:  # it was given up
            return
        if self._ending:
            self._cancelled()
            return
        try:
            result = inner.result()
        except Exception as error:  # noqa: BLE001 - as in _begin
            self._settle(CommandState.FAILED, error=error)
        else:
            self._settle(CommandState.DONE, result)

    def _cancelled(self) -> None:
        self._settle(CommandState.CANCELLED, error=error_for(self._ending, self.name))

    def _settle(self, state: CommandState, result: Any = None, error: BaseException | None = None) -> None:
        self._state, self._result, self._error, self._inner = state, result, error, None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if error is None:
            self._over.set_result()
        else:
            self._over.set_exception(error)


def find_command(caller: ClientContext, name: str) -> RC8Command:
    """Return the command of a name, in upper or lower case.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL, real controllers have it.
    """
    return RC8Command(caller, name, _route(name))


def command_names() -> list[str]:
    """Return the names of all commands: those of the controller alone, the others with their owner."""
    return [
        *(command.name for command in controller_commands.COMMANDS.values() if command.name not in _NOT_SIMULATED),
        *(f"Robot.{command.name}" for command in robot_commands.ROBOT_COMMANDS.values()),
        *(f"{HAND_NAME}.{command.name}" for command in EXTENSION_COMMANDS.values()),
    ]


def _route(name: str) -> CommandRoute:
    owner, _, command = (part.strip().lower() for part in name.rpartition("."))
    if not owner and command in controller_commands.COMMANDS:
        stop = _stop_hand if command in _OF_HAND else _nothing
        return CommandRoute(lambda caller, parameter: controller_commands.execute(caller, command, parameter), stop)
    if owner == HAND_NAME.lower() and command in EXTENSION_COMMANDS:
        return CommandRoute(EXTENSION_COMMANDS[command].execute, _stop_hand)
    if owner in ("", *_ROBOTS):
        if command in robot_commands.ROBOT_COMMANDS:
            return CommandRoute(lambda caller, parameter: robot_commands.execute(caller, command, parameter), _stop_arm)
        if command in _NOT_OF_ROBOT:
            raise error_for(hresult.E_NOTIMPL, f"{name:.40}")
    raise not_found(f"{name:.40}")


def _stop_arm(caller: ClientContext, code: int) -> bool:
    arm = caller.state.arm
    if arm.holder is not caller or not (arm.busy or arm.slave.pending):
        return False
    arm.stop(code)
    return True


def _stop_hand(caller: ClientContext, code: int) -> bool:
    hand = caller.state.hand
    if not hand.busy:
        return False
    hand.stop(code)
    return True


def _nothing(_caller: ClientContext, _code: int) -> bool:
    return False
