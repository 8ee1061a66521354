"""The Controller object of a client: access to its other objects, commands and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from orinkit.cao.options import Options
from orinkit.cao.provider import (
    CommandObject,
    ControllerObject,
    Deferred,
    ExtensionObject,
    FileObject,
    MessageObject,
    RobotObject,
    TaskObject,
    VariableObject,
    not_found,
)
from orinkit.core import hresult
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.events import EventQueue
from orinkit.virtual.rc8.objects import controller_commands
from orinkit.virtual.rc8.objects.command import command_names, find_command
from orinkit.virtual.rc8.objects.extension import extension_names, find_extension
from orinkit.virtual.rc8.objects.file import find_file
from orinkit.virtual.rc8.objects.messages import EventMessage
from orinkit.virtual.rc8.objects.robot import RC8Robot
from orinkit.virtual.rc8.objects.task import find_task, run_file
from orinkit.virtual.rc8.objects.variables import find_variable, variable_names
from orinkit.virtual.rc8.state import Operation

_NUMBERS: Final = {"0": 0, "True": 0, "1": 1}
"""Values of the option ``ID``; without a value it means the first robot."""


def _disables_events(options: Options) -> bool:
    """Return True if the client receives no events (``Message``: RC8 table 5-1)."""
    return options.flag("@EventDisable") or ("Message" in options and not options.flag("Message"))


class RC8Controller(ControllerObject):
    """The Controller object of one client.

    The attribute of the object is the sum of the client's access rights: 1 read, 2 write.

    Args:
        caller: The client.
        option: Option of Controller_Connect; ``@EventDisable=true`` and ``Message=false`` disable events, other options
            are ignored.

    Attributes:
        events: Pending events of this client; None if events are disabled.
    """

    def __init__(self, caller: ClientContext, option: str) -> None:
        state = caller.state
        text = state.say("Virtual RC8 robot controller")
        super().__init__(caller.origin.caller, attribute=int(caller.access), help=text)
        self.events: EventQueue | None = None if _disables_events(Options(option)) else state.events.subscribe()
        self._caller = caller
        self._connected = True
        state.log(Operation.CONNECT, state.say("Client connected"), caller.origin)

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Connect to a variable.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; VARIABLE_INDEX_INVALID.
        """
        return find_variable(self._caller, name)

    def get_variable_names(self, option: str) -> Sequence[str]:
        """Return the names of the system variables, and the pattern of each class of user variables (``I*``)."""
        return variable_names()

    def get_robot(self, name: str, option: str) -> RobotObject:
        """Connect to a robot; any name is accepted, and the option ``ID`` chooses the robot, the first one by default.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND if the robot does not exist.
        """
        number = _NUMBERS.get(Options(option).text_of("ID", "0").strip(), len(self._caller.state.robots))
        if number >= len(self._caller.state.robots):
            raise not_found(f"{name} {option}")
        caller = self._caller.of_robot(number)
        return RC8Robot(caller, name or caller.robot.name)

    def get_robot_names(self, option: str) -> Sequence[str]:
        """Return the names of the robots."""
        return [robot.name for robot in self._caller.state.robots]

    def get_task(self, name: str, option: str) -> TaskObject | Deferred[TaskObject]:
        r"""Connect to the task of a program: ``Pro1``, ``folder\Pro1``.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND if the program does not exist.
        """
        return find_task(self._caller, name)

    def get_task_names(self, option: str) -> Sequence[str] | Deferred[Sequence[str]]:
        """Return the names of the tasks, one for each program in the file store."""
        self._caller.require_read()
        state = self._caller.state
        return state.disk.run(state.tasks.names)

    def get_file(self, name: str, option: str) -> FileObject | Deferred[FileObject]:
        """Connect to a file or folder; with ``@Create=1`` it is created if it does not exist.

        Raises:
            CallError: FILE_NOT_FOUND; E_INVALIDARG if the name is invalid.
        """
        return find_file(self._caller, self._caller.state.files, name, option, run_file)

    def get_file_names(self, option: str) -> Sequence[str] | Deferred[Sequence[str]]:
        """Return the names of the files and folders in the root folder."""
        self._caller.require_read()
        state = self._caller.state
        return state.disk.run(lambda: state.files.names(""))

    def get_extension(self, name: str, option: str) -> ExtensionObject:
        """Connect to an extension: an electric gripper, ``Hand0`` to ``Hand7``.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the extension.
        """
        return find_extension(self._caller, name)

    def get_extension_names(self, option: str) -> Sequence[str]:
        """Return the names of the extensions, the electric grippers that are fitted."""
        return extension_names(self._caller.state)

    def get_command(self, name: str, option: str) -> CommandObject:
        """Connect to a command of Controller_Execute, of the robot (``Robot.Motor``) or of the hand (``Hand0.Chuck``).

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the command.
        """
        return find_command(self._caller, name)

    def get_command_names(self, option: str) -> Sequence[str]:
        """Return the names of the commands."""
        return command_names(self._caller.state)

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute an extended command (:mod:`orinkit.virtual.rc8.objects.controller_commands`)."""
        return controller_commands.execute(self._caller, command, parameter)

    def get_message(self) -> MessageObject:
        """Remove the oldest pending event and return it.

        Raises:
            CallError: NO_READ_RIGHT; E_CAO_OBJECT_NOTFOUND if no event is pending.
        """
        self._caller.require_read()
        event = self.events.take() if self.events else None
        if event is None:
            raise not_found("Message")
        return EventMessage(event, self._caller.state.identity.type, self.name)

    def is_moving(self) -> bool:
        """Return True if the client holds an arm and has running, queued or paused motions."""
        return any(each.robot.arm.holder is each and each.robot.arm.busy for each in self._caller.client.contexts)

    def stop_moving(self) -> None:
        """Stop every arm that the client holds, and discard its motions; cancel its waiting starts of programs."""
        self._caller.client.sync = None
        self._caller.state.tasks.starts.cancel(client=self._caller)
        for each in self._caller.client.contexts:
            if each.robot.arm.holder is each:
                each.robot.arm.stop(hresult.STOPPED_DURING_PC_MOTION)

    def release(self) -> None:
        """Release the object: unsubscribe from events, cancel waiting starts of programs, and release the arms."""
        if not self._connected:
            return
        self._connected = False
        state = self._caller.state
        state.connections.pop(self._caller, None)
        state.tasks.starts.cancel(client=self._caller)
        self._caller.client.sync = None
        for each in self._caller.client.contexts:  # the client may have taken an arm with a Command object
            each.robot.arm.forget(each)
        if self.events is not None:
            self.events.close()
        state.log(Operation.DISCONNECT, state.say("Client disconnected"), self._caller.origin)
