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

ROBOT_NAME: Final = "Arm0"


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

    def get_variable(self, name: str, option: str) -> VariableObject:  # noqa: ARG002 - options have no effect
        """Connect to a variable.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; VARIABLE_INDEX_INVALID.
        """
        return find_variable(self._caller, name)

    def get_variable_names(self, option: str) -> Sequence[str]:  # noqa: ARG002
        """Return the names of the system variables, and the pattern of each class of user variables (``I*``)."""
        return variable_names()

    def get_robot(self, name: str, option: str) -> RobotObject:
        """Connect to the robot; any name is accepted, because there is only one arm (``ID=0``).

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND if the option names another arm.
        """
        if Options(option).text_of("ID", "0").strip() not in ("0", "True"):
            raise not_found(f"{name} {option}")
        return RC8Robot(self._caller, name or ROBOT_NAME)

    def get_robot_names(self, option: str) -> Sequence[str]:  # noqa: ARG002
        """Return the names of the robots; there is one."""
        return [ROBOT_NAME]

    def get_task(self, name: str, option: str) -> TaskObject | Deferred[TaskObject]:  # noqa: ARG002
        r"""Connect to the task of a program: ``Pro1``, ``folder\Pro1``.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND if the program does not exist.
        """
        return find_task(self._caller, name)

    def get_task_names(self, option: str) -> Sequence[str] | Deferred[Sequence[str]]:  # noqa: ARG002
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

    def get_file_names(self, option: str) -> Sequence[str] | Deferred[Sequence[str]]:  # noqa: ARG002
        """Return the names of the files and folders in the root folder."""
        self._caller.require_read()
        state = self._caller.state
        return state.disk.run(lambda: state.files.names(""))

    def get_extension(self, name: str, option: str) -> ExtensionObject:  # noqa: ARG002
        """Connect to an extension: an electric gripper, ``Hand0`` to ``Hand7``.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the extension.
        """
        return find_extension(self._caller, name)

    def get_extension_names(self, option: str) -> Sequence[str]:  # noqa: ARG002
        """Return the names of the extensions, the electric grippers that are fitted."""
        return extension_names(self._caller.state)

    def get_command(self, name: str, option: str) -> CommandObject:  # noqa: ARG002
        """Connect to a command of Controller_Execute, of the robot (``Robot.Motor``) or of the hand (``Hand0.Chuck``).

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; E_NOTIMPL if only real controllers have the command.
        """
        return find_command(self._caller, name)

    def get_command_names(self, option: str) -> Sequence[str]:  # noqa: ARG002
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
        """Return True if the client holds the arm and has running, queued or paused motions."""
        arm = self._caller.state.arm
        return arm.holder is self._caller and arm.busy

    def stop_moving(self) -> None:
        """Stop the arm and discard its motions, if the client holds the arm; cancel its waiting starts of programs."""
        self._caller.state.tasks.starts.cancel(client=self._caller)
        arm = self._caller.state.arm
        if arm.holder is self._caller:
            arm.stop(hresult.STOPPED_DURING_PC_MOTION)

    def release(self) -> None:
        """Release the object: unsubscribe from events, cancel waiting starts of programs, and release the arm."""
        if not self._connected:
            return
        self._connected = False
        state = self._caller.state
        state.connections.pop(self._caller, None)
        state.tasks.starts.cancel(client=self._caller)
        state.arm.forget(self._caller)  # the client may have taken the arm with a Command object
        if self.events is not None:
            self.events.close()
        state.log(Operation.DISCONNECT, state.say("Client disconnected"), self._caller.origin)
