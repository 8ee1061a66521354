"""Base classes for providers: one class per CAO interface, one method per function of the table.

The name of a method is the Python name of the function (``Variable_GetValue`` is :meth:`VariableObject.get_value`). A
method receives the arguments as Python values (a VARIANT as :class:`~orinkit.values.variant.Variant` with its exact
type) and returns the result. A method may

* return the result directly: the method then runs on the server's thread and must not block;
* be ``async def``: it may ``await``, and is cancelled when its client disconnects;
* return :class:`BlockingCall` with a function to run in a worker thread;
* return :class:`Deferred`, and set its result later, from any thread.

To return an error code, raise it: ``raise error_for(0x80020005)``. Any other exception is logged and returns E_FAIL.
For your own device, :class:`orinkit.Device` is more convenient; it is built on these classes.
"""

from __future__ import annotations

from collections.abc import Awaitable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Final

from orinkit.cao.client_info import ClientInfo as ClientInfo
from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.results import BlockingCall as BlockingCall
from orinkit.cao.results import Deferred as Deferred
from orinkit.cao.results import Result as Result
from orinkit.cao.results import ResultWithCode as ResultWithCode
from orinkit.cao.user_functions import UserFunction
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.values.variant import Value, Variant, VarType

READABLE: Final = 1
"""Attribute bit of a variable that can be read."""
WRITABLE: Final = 2
"""Attribute bit of a variable that can be written."""


def not_implemented() -> CallError:
    """Return the exception for a function that this device does not have."""
    return error_for(hresult.E_NOTIMPL)


def not_found(name: str) -> CallError:
    """Return the exception for a name that this device does not have."""
    return error_for(hresult.E_CAO_OBJECT_NOTFOUND, name)


class CaoObject:
    """Base class of all objects: a name, and a tag and an ID that the client can set.

    One instance belongs to one handle of one client, so the tag and the ID belong to that client.
    """

    def __init__(self, name: str = "", *, attribute: int = 0, help: str = "") -> None:  # noqa: A002 - the name in the documents
        self.name = name
        self.attribute = attribute
        self.help = help
        self.tag = Variant(VarType.EMPTY)
        self.id = Variant(VarType.EMPTY)

    def get_attribute(self) -> Result[int]:
        """Return the attribute bits; 0 by default."""
        return self.attribute

    def get_help(self) -> Result[str]:
        """Return the help text."""
        return self.help

    def get_name(self) -> Result[str]:
        """Return the name of the object."""
        return self.name

    def get_tag(self) -> Result[Value]:
        """Return the tag that the client has set."""
        return self.tag

    def put_tag(self, tag: Variant) -> Result[None]:
        """Set the tag."""
        self.tag = tag
        return None

    def get_id(self) -> Result[Value]:
        """Return the ID that the client has set."""
        return self.id

    def put_id(self, id: Variant) -> Result[None]:  # noqa: A002 - the name in the documents
        """Set the ID."""
        self.id = id
        return None

    def release(self) -> None:
        """Release resources immediately: the client has released the object or has disconnected."""


class VariableObject(CaoObject):
    """A variable."""

    def get_date_time(self) -> Result[Value]:
        """Return the date and time of the value, a local ``datetime``."""
        raise not_implemented()

    def get_value(self) -> Result[Value]:
        """Return the value."""
        raise not_implemented()

    def put_value(self, value: Variant) -> Result[None]:
        """Set the value."""
        raise error_for(hresult.E_CAO_NOT_WRITABLE, self.name)

    def get_microsecond(self) -> Result[int]:
        """Return the microseconds of the date and time of the value."""
        raise not_implemented()


class OwnerObject(CaoObject):
    """Base class of the objects with variables and extended commands: all except variables, commands and messages."""

    def get_variable(self, name: str, option: str) -> Result[VariableObject]:
        """Connect to a variable below this object."""
        raise not_implemented()

    def get_variable_names(self, option: str) -> Result[Sequence[str]]:
        """Return the names of the variables below this object."""
        return []

    def execute(self, command: str, parameter: Variant) -> Result[Value]:
        """Execute an extended command; its name is passed as sent by the client."""
        raise not_implemented()


class ExtensionObject(OwnerObject):
    """An extension board, for example a hand."""


class FileObject(OwnerObject):
    """A file or folder of the controller."""

    def get_file(self, name: str, option: str) -> Result[FileObject]:
        """Connect to a file below this one."""
        raise not_implemented()

    def get_file_names(self, option: str) -> Result[Sequence[str]]:
        """Return the names of the files below this one."""
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
        """Run the file; return the name of the task."""
        raise not_implemented()

    def get_date_created(self) -> Result[Value]:
        """Return the date and time of the file's creation."""
        raise not_implemented()

    def get_date_last_accessed(self) -> Result[Value]:
        """Return the date and time of the last read access to the file."""
        raise not_implemented()

    def get_date_last_modified(self) -> Result[Value]:
        """Return the date and time of the last change of the file."""
        raise not_implemented()

    def get_path(self) -> Result[str]:
        """Return the path in the controller."""
        raise not_implemented()

    def get_size(self) -> Result[int]:
        """Return the size in bytes."""
        raise not_implemented()

    def get_type(self) -> Result[str]:
        """Return the type of the file."""
        raise not_implemented()

    def get_value(self) -> Result[Value]:
        """Return the content."""
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
        """Move one joint by a relative value in deg or mm."""
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
        """Rotate by an angle in deg about an axis through a pivot."""
        raise not_implemented()

    def speed(self, axis: int, speed: float) -> Result[None]:
        """Set the internal speed in percent."""
        raise not_implemented()

    def unchuck(self, option: str) -> Result[None]:
        """Open the chuck."""
        raise not_implemented()

    def unhold(self, option: str) -> Result[None]:
        """Resume a paused motion."""
        raise not_implemented()


class TaskObject(OwnerObject):
    """A program task."""

    def start(self, mode: int, option: str) -> Result[None]:
        """Start the task in a mode: 1 is one cycle, 2 continuous, 3 step."""
        raise not_implemented()

    def stop(self, mode: int, option: str) -> Result[None]:
        """Stop the task in a mode: 0 is the default, 1 instant, 2 step, 3 cycle, 4 initialise."""
        raise not_implemented()

    def delete(self, option: str) -> Result[None]:
        """Delete the task."""
        raise not_implemented()

    def get_file_name(self) -> Result[str]:
        """Return the name of the task's file."""
        raise not_implemented()


class CommandObject(CaoObject):
    """A command that can be started, monitored and cancelled."""

    def execute(self, mode: int) -> Result[None]:
        """Execute the command; in mode 0 return at its end, in mode 1 return immediately."""
        raise not_implemented()

    def cancel(self) -> Result[None]:
        """Cancel the running command."""
        raise not_implemented()

    def get_timeout(self) -> Result[int]:
        """Return the time-out in ms."""
        raise not_implemented()

    def put_timeout(self, timeout: int) -> Result[None]:
        """Set the time-out in ms."""
        raise not_implemented()

    def get_state(self) -> Result[int]:
        """Return the state of the command."""
        raise not_implemented()

    def get_parameters(self) -> Result[Value]:
        """Return the parameters."""
        raise not_implemented()

    def put_parameters(self, parameters: Variant) -> Result[None]:
        """Set the parameters."""
        raise not_implemented()

    def get_result(self) -> Result[Value]:
        """Return the result of the last execution."""
        raise not_implemented()


class MessageObject(CaoObject):
    """A message: an event of the controller that the client has fetched."""

    def reply(self, value: Variant) -> Result[None]:
        """Reply to the message."""
        raise not_implemented()

    def clear(self) -> Result[None]:
        """Clear the message."""
        raise not_implemented()

    def get_date_time(self) -> Result[Value]:
        """Return the date and time of the message, a local ``datetime``."""
        raise not_implemented()

    def get_description(self) -> Result[str]:
        """Return the description of the message."""
        raise not_implemented()

    def get_destination(self) -> Result[str]:
        """Return the destination of the message."""
        raise not_implemented()

    def get_number(self) -> Result[int]:
        """Return the number that identifies the kind of the message."""
        raise not_implemented()

    def get_serial_number(self) -> Result[int]:
        """Return the serial number of the message."""
        raise not_implemented()

    def get_source(self) -> Result[str]:
        """Return the source of the message."""
        raise not_implemented()

    def get_value(self) -> Result[Value]:
        """Return the value of the message."""
        raise not_implemented()


class ControllerObject(OwnerObject):
    """A controller: the root of a client's objects."""

    def is_moving(self) -> bool:
        """Return True if an arm executes a motion of this client, or may start one.

        The server calls this method while it receives no requests from the client.
        """
        return False

    def stop_moving(self) -> None:
        """Stop the motions of this client; keep its objects and semaphores until it disconnects.

        The server calls this method if there have been no signs of life from the client for too long.
        """

    def connection_lost(self) -> None:
        """Handle the loss of the client; the server releases its objects afterwards.

        The server calls this method if the client ends without Controller_Disconnect and without Service_Stop, for
        example because its program was killed. Motions that :meth:`release` stops need not be stopped here.
        """

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
        """Return the names of the extension boards."""
        return []

    def get_file_names(self, option: str) -> Result[Sequence[str]]:
        """Return the names of the files."""
        return []

    def get_robot_names(self, option: str) -> Result[Sequence[str]]:
        """Return the names of the robots."""
        return []

    def get_task_names(self, option: str) -> Result[Sequence[str]]:
        """Return the names of the tasks."""
        return []

    def get_command_names(self, option: str) -> Result[Sequence[str]]:
        """Return the names of the commands."""
        return []

    def get_message(self) -> Result[MessageObject]:
        """Fetch the oldest waiting message; raise E_CAO_OBJECT_NOTFOUND if there is no message."""
        raise not_found("Message")


class Provider:
    """A controller or device that clients connect to with Controller_Connect and one of its provider names.

    Attributes:
        provider_names: for example ``("CaoProv.DENSO.VRC",)``; case-insensitive.
        guard: context manager that the server enters for every method call on its thread, and for every release. If
            other threads modify the device, the guard may be a lock. By default, it does nothing.
        dialect: dialect of b-CAP.
        functions: ids of the implemented functions, ``None`` for all; a call of any other function returns E_NOTIMPL,
            even if its arguments are invalid.
        fixed_handles: whether :meth:`handle_of` determines the handles, separately for each interface; otherwise
            handles are allocated from 2 upwards.
        unwraps_variants: True if the device receives the value in a VT_VARIANT instead of the VT_VARIANT itself, which
            only clients of e-CAP send.
        unique_names: True if the names of controllers are unique over all clients of a server (provider guide 5.2.1);
            otherwise only over the controllers of one client.
        requires_secret: True if :meth:`connect` refuses clients that do not send a secret. A server of such a provider
            accepts only few connections and small packets of clients that have no object yet. Over b-CAP, the calls of
            all other clients take precedence over the calls of the clients of other servers in the same event loop.
    """

    provider_names: Sequence[str] = ()
    guard: AbstractContextManager[object] = nullcontext()
    dialect: Dialect = RC8
    functions: frozenset[int] | None = None
    fixed_handles: bool = False
    unwraps_variants: bool = False
    unique_names: bool = False
    requires_secret: bool = False

    def user_functions(self) -> Sequence[UserFunction]:
        """Return the user-defined functions of the device; by default, there are none."""
        return ()

    def handle_of(self, interface: str, name: str) -> int:
        """Return the handle of an object, by default 1; called only if ``fixed_handles`` is True.

        Args:
            interface: ``"Robot"``, ``"Variable"``.
            name: name of the object, as sent by the client.
        """
        return 1

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Result[ControllerObject]:
        """Return the controller object for one client, in any of the forms of :data:`Result`.

        Args:
            name: the name that the client gives to the controller; if that name is empty, a generated name.
            machine: the machine name of the call; according to the documents the controller's address or ``localhost``.
            option: the option string of the call.
            client: information on the client.

        Raises:
            CallError: If the client is refused.
        """
        raise not_implemented()

    def close(self) -> Awaitable[None] | None:
        """Save persistent data after the server has stopped; may be ``async``."""
        return None
