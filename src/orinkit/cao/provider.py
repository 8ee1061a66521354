"""What a served device implements: one class per CAO interface, one method per function of the table.

A method's name is the function's in Python's spelling (``Variable_GetValue`` is :meth:`VariableObject.get_value`). It
gets the arguments as Python values, one of type VARIANT as :class:`~orinkit.values.variant.Variant` with its exact type, and
returns the result. It may

* return at once: it then runs on the server's own thread and must not wait for anything;
* be ``async def``: it may ``await``, and is cancelled when its client goes away;
* return :class:`Blocking` with a function to run in a worker thread;
* return :class:`Later`, and finish it when the result has come, from whatever thread.

To answer with an error code, raise it: ``raise error_for(0x80020005)``. Any other exception is logged and answered
with E_FAIL. For a device of your own, :class:`orinkit.Device` is the comfortable way; this is what lies beneath.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Final, NamedTuple

from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.results import BlockingCall as BlockingCall
from orinkit.cao.results import Deferred as Deferred
from orinkit.cao.results import Result as Result
from orinkit.cao.results import ResultWithCode as ResultWithCode
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.values.variant import Value, Variant, VarType


def _no_reason(code: int) -> str:  # noqa: ARG001 - as every reason
    return ""


READABLE: Final = 1
"""Attribute bit of a variable that can be read."""
WRITABLE: Final = 2
"""Attribute bit of a variable that can be written."""


class ClientInfo(NamedTuple):
    """Who is calling.

    Attributes:
        address: host address of the client, ``"127.0.0.1"``; the port's path on a serial line.
        transport: ``"tcp"``, ``"udp"``, ``"serial"``, ``"http"`` or ``"memory"``.
        port: the client's port number, 0 where there is none.
        drain_input: calls a function back, from any thread, once everything that has arrived from this client by now has been
            handled; it waits for nothing itself. ``None`` where that is always so. For a device whose time goes on while
            the server may be late to read.
        provider: the provider's name that it has asked for, as it wrote it.
        reason: tells what its last call that ended with a code failed of, in words; ``""`` where that is not known.
    """

    address: str = ""
    transport: str = "memory"
    port: int = 0
    drain_input: Callable[[Callable[[], None]], None] | None = None
    provider: str = ""
    reason: Callable[[int], str] = _no_reason


def not_implemented() -> CallError:
    """Return the exception for a function that this device does not have."""
    return error_for(hresult.E_NOTIMPL)


def not_found(name: str) -> CallError:
    """Return the exception for a name that this device does not have."""
    return error_for(hresult.E_CAO_OBJECT_NOTFOUND, name)


class CaoObject:
    """What every served object has: a name, and a tag and an ID that its client may set.

    One instance serves one handle of one client, so tag and ID are that client's own.
    """

    def __init__(self, name: str = "", *, attribute: int = 0, help: str = "") -> None:  # noqa: A002 - the documents' word
        self.name = name
        self.attribute = attribute
        self.help = help
        self.tag = Variant(VarType.EMPTY)
        self.id = Variant(VarType.EMPTY)

    def get_attribute(self) -> Result[int]:
        """Attribute bits; 0 where there is nothing to say."""
        return self.attribute

    def get_help(self) -> Result[str]:
        """Help text."""
        return self.help

    def get_name(self) -> Result[str]:
        """Name of the object."""
        return self.name

    def get_tag(self) -> Result[Value]:
        """Tag that the client has set."""
        return self.tag

    def put_tag(self, tag: Variant) -> Result[None]:
        """Set the tag."""
        self.tag = tag
        return None

    def get_id(self) -> Result[Value]:
        """ID that the client has set."""
        return self.id

    def put_id(self, id: Variant) -> Result[None]:  # noqa: A002 - the documents' word
        """Set the ID."""
        self.id = id
        return None

    def release(self) -> None:
        """Let go, at once: the client has released the object or has gone away."""


class VariableObject(CaoObject):
    """A variable."""

    def get_date_time(self) -> Result[Value]:
        """When the value was taken, a local ``datetime``."""
        raise not_implemented()

    def get_value(self) -> Result[Value]:
        """The value."""
        raise not_implemented()

    def put_value(self, value: Variant) -> Result[None]:
        """Set the value."""
        raise error_for(hresult.E_CAO_NOT_WRITABLE, self.name)

    def get_microsecond(self) -> Result[int]:
        """Microseconds of the time when the value was taken."""
        raise not_implemented()


class OwnerObject(CaoObject):
    """An object with variables and extended commands: everything but variables, commands and messages."""

    def get_variable(self, name: str, option: str) -> Result[VariableObject]:
        """Connect to a variable below this object."""
        raise not_implemented()

    def get_variable_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the variables below this object."""
        return []

    def execute(self, command: str, parameter: Variant) -> Result[Value]:
        """Execute an extended command; its name comes as the client wrote it."""
        raise not_implemented()


class ExtensionObject(OwnerObject):
    """An extension board, a hand."""


class FileObject(OwnerObject):
    """A file or folder of the controller."""

    def get_file(self, name: str, option: str) -> Result[FileObject]:
        """Connect to a file below this one."""
        raise not_implemented()

    def get_file_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the files below this one."""
        return []

    def copy(self, name: str, option: str) -> Result[None]:
        """Copy the file."""
        raise not_implemented()

    def delete(self, option: str) -> Result[None]:
        """Delete the file."""
        raise not_implemented()

    def move(self, name: str, option: str) -> Result[None]:
        """Move or rename the file."""
        raise not_implemented()

    def run(self, option: str) -> Result[str]:
        """Run the file; returns the name of the task."""
        raise not_implemented()

    def get_date_created(self) -> Result[Value]:
        """When the file was created."""
        raise not_implemented()

    def get_date_last_accessed(self) -> Result[Value]:
        """When the file was last read."""
        raise not_implemented()

    def get_date_last_modified(self) -> Result[Value]:
        """When the file was last changed."""
        raise not_implemented()

    def get_path(self) -> Result[str]:
        """Path in the controller."""
        raise not_implemented()

    def get_size(self) -> Result[int]:
        """Size in bytes."""
        raise not_implemented()

    def get_type(self) -> Result[str]:
        """Type of the file."""
        raise not_implemented()

    def get_value(self) -> Result[Value]:
        """Content."""
        raise not_implemented()

    def put_value(self, value: Variant) -> Result[None]:
        """Set the content."""
        raise not_implemented()


class RobotObject(OwnerObject):
    """A robot."""

    def accelerate(self, axis: int, accel: float, decel: float) -> Result[None]:
        """Set internal acceleration and deceleration in percent."""
        raise not_implemented()

    def change(self, name: str) -> Result[None]:
        """Change the tool or work frame in use."""
        raise not_implemented()

    def chuck(self, option: str) -> Result[None]:
        """Close the chuck."""
        raise not_implemented()

    def drive(self, axis: int, value: float, option: str) -> Result[None]:
        """Move one joint by degrees or mm."""
        raise not_implemented()

    def go_home(self) -> Result[None]:
        """Move to the home pose."""
        raise not_implemented()

    def halt(self, option: str) -> Result[None]:
        """Stop the motion and abandon it."""
        raise not_implemented()

    def hold(self, option: str) -> Result[None]:
        """Pause the motion."""
        raise not_implemented()

    def move(self, interpolation: int, pose: Variant, option: str) -> Result[None]:
        """Move to a pose."""
        raise not_implemented()

    def rotate(self, plane: Variant, angle: float, pivot: Variant, option: str) -> Result[None]:
        """Rotate about an axis through a pivot by degrees."""
        raise not_implemented()

    def speed(self, axis: int, speed: float) -> Result[None]:
        """Set the internal speed in percent."""
        raise not_implemented()

    def unchuck(self, option: str) -> Result[None]:
        """Open the chuck."""
        raise not_implemented()

    def unhold(self, option: str) -> Result[None]:
        """Go on with a paused motion."""
        raise not_implemented()


class TaskObject(OwnerObject):
    """A program task."""

    def start(self, mode: int, option: str) -> Result[None]:
        """Start: 1 one cycle, 2 continuous, 3 step."""
        raise not_implemented()

    def stop(self, mode: int, option: str) -> Result[None]:
        """Stop: 0 default, 1 instant, 2 step, 3 cycle, 4 initialise."""
        raise not_implemented()

    def delete(self, option: str) -> Result[None]:
        """Delete the task."""
        raise not_implemented()

    def get_file_name(self) -> Result[str]:
        """File that the task came from."""
        raise not_implemented()


class CommandObject(CaoObject):
    """A command that can be started, watched and cancelled."""

    def execute(self, mode: int) -> Result[None]:
        """Execute: 0 wait for the end, 1 return at once."""
        raise not_implemented()

    def cancel(self) -> Result[None]:
        """Cancel the running command."""
        raise not_implemented()

    def get_timeout(self) -> Result[int]:
        """Time-out in ms."""
        raise not_implemented()

    def put_timeout(self, timeout: int) -> Result[None]:
        """Set the time-out in ms."""
        raise not_implemented()

    def get_state(self) -> Result[int]:
        """State of the command."""
        raise not_implemented()

    def get_parameters(self) -> Result[Value]:
        """Parameters."""
        raise not_implemented()

    def put_parameters(self, parameters: Variant) -> Result[None]:
        """Set the parameters."""
        raise not_implemented()

    def get_result(self) -> Result[Value]:
        """Result of the last execution."""
        raise not_implemented()


class MessageObject(CaoObject):
    """An event that the client has fetched."""

    def reply(self, value: Variant) -> Result[None]:
        """Answer the event."""
        raise not_implemented()

    def clear(self) -> Result[None]:
        """Clear the event."""
        raise not_implemented()

    def get_date_time(self) -> Result[Value]:
        """When it happened, a local ``datetime``."""
        raise not_implemented()

    def get_description(self) -> Result[str]:
        """What happened, in words."""
        raise not_implemented()

    def get_destination(self) -> Result[str]:
        """Whom it is for."""
        raise not_implemented()

    def get_number(self) -> Result[int]:
        """Number that tells the kind of event."""
        raise not_implemented()

    def get_serial_number(self) -> Result[int]:
        """Serial number of the message."""
        raise not_implemented()

    def get_source(self) -> Result[str]:
        """Where it came from."""
        raise not_implemented()

    def get_value(self) -> Result[Value]:
        """Value that came with it."""
        raise not_implemented()


class ControllerObject(OwnerObject):
    """A controller: where a client's objects begin."""

    def is_moving(self) -> bool:
        """Whether an arm moves, or may begin to, because of what this client has told it; asked while the client is silent."""
        return False

    def stop_moving(self) -> None:
        """The client has fallen silent: bring to rest what it moves. What it holds it keeps until it has gone."""

    def get_extension(self, name: str, option: str) -> Result[ExtensionObject]:
        """Connect to an extension board."""
        raise not_implemented()

    def get_file(self, name: str, option: str) -> Result[FileObject]:
        """Connect to a file."""
        raise not_implemented()

    def get_robot(self, name: str, option: str) -> Result[RobotObject]:
        """Connect to a robot."""
        raise not_implemented()

    def get_task(self, name: str, option: str) -> Result[TaskObject]:
        """Connect to a task."""
        raise not_implemented()

    def get_command(self, name: str, option: str) -> Result[CommandObject]:
        """Connect to a command."""
        raise not_implemented()

    def get_extension_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the extension boards."""
        return []

    def get_file_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the files."""
        return []

    def get_robot_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the robots."""
        return []

    def get_task_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the tasks."""
        return []

    def get_command_names(self, option: str) -> Result[Sequence[str]]:
        """Names of the commands."""
        return []

    def get_message(self) -> Result[MessageObject]:
        """Fetch the oldest waiting event; E_CAO_OBJECT_NOTFOUND when none waits."""
        raise not_found("Message")


class Provider:
    """A device that clients reach with Controller_Connect under one of its provider names.

    Attributes:
        provider_names: for example ``("CaoProv.DENSO.VRC",)``; upper and lower case do not matter.
        guard: is entered around every method that a client's call runs on the server's own thread, and around every
            release; a lock, for a device that changes in other threads too. Nothing by default.
        dialect: of b-CAP that it speaks.
        functions: ids of those that it has; any other is E_NOTIMPL, whatever its arguments are. ``None`` for all.
        fixed_handles: it gives every object a handle of its own by :meth:`handle_of`, each kind for itself; otherwise
            handles are counted from 2 on.
    """

    provider_names: Sequence[str] = ()
    guard: AbstractContextManager[object] = nullcontext()
    dialect: Dialect = RC8
    functions: frozenset[int] | None = None
    fixed_handles: bool = False

    def handle_of(self, interface: str, name: str) -> int:
        """Return the handle of an object, where these are fixed; 1 by default.

        Args:
            interface: ``"Robot"``, ``"Variable"``.
            name: of the object, as the client wrote it.
        """
        return 1

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Result[ControllerObject]:
        """Return the controller object for one client, at once or as any other method may.

        Args:
            name: the name that the client gives to the controller, or one made up where it gave none.
            machine: the machine name of the call; the documents say the controller's address or ``localhost``.
            option: the option string of the call.
            client: who calls.

        Raises:
            CallError: the client is refused.
        """
        raise not_implemented()

    def close(self) -> Awaitable[None] | None:
        """The server has stopped; write down what has to be kept. May be ``async``, and then take a moment."""
        return None
