"""Base classes of the asynchronous objects of a controller, and variables.

The synchronous version is generated from this file; :mod:`orinkit.client._async.controller` describes how.
"""

from __future__ import annotations

from typing import Any, ClassVar, Concatenate, ParamSpec, TypeVar
from weakref import WeakValueDictionary

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.client._async.client import AsyncClient, call_prepared_by_client
from orinkit.client._shared.common import ObjectFunctions, text_list
from orinkit.client._shared.prepared import MOST_COMMANDS, PreparedCommand, PreparedFunction
from orinkit.core.closing import AsyncClosing
from orinkit.core.errors import CallError, CallTimeout, ObjectReleased, OrinError
from orinkit.core.i18n import tr
from orinkit.values.variant import Value

P = ParamSpec("P")
R = TypeVar("R")
N = TypeVar("N", bound="AsyncObjectBase")


class AsyncObjectBase(AsyncClosing):
    """Base class of all objects of a controller.

    An object is released on the controller at the end of ``async with``, by :meth:`close`, or when the controller is
    closed. If a Python object is garbage collected without being closed, its object on the controller is released
    before the next object is created.
    """

    __slots__ = (
        "__weakref__",
        "_children",
        "_label",
        "_open",
        "_parent",
        "client",
        "handle",
    )  # a misspelt attribute is an error

    functions: ClassVar[ObjectFunctions]

    def __init__(self, client: AsyncClient, handle: int, label: str, parent: AsyncObjectBase | None = None) -> None:
        self.client = client
        self.handle = handle
        self._label = label
        self._parent = parent  # keeps the parent alive
        self._children: WeakValueDictionary[int, AsyncObjectBase] = WeakValueDictionary()
        self._open = True

    def __repr__(self) -> str:
        state = "" if self._open else " closed"
        return f"<{type(self).__name__} {self._label!r} handle {self.handle}{state}>"

    def __reduce__(self) -> str:
        raise TypeError(tr("{object!r} cannot be copied or pickled: its handle belongs to one connection", object=self))

    def __del__(self) -> None:
        if getattr(self, "_open", False) and self._parent is not None and self.handle:
            self.client.handles.add_orphan(self.functions.release, self.handle)

    async def _call(self, function: Function[Concatenate[int, P], R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function of this object; add the object's name to the exception if the controller returns an error.

        Raises:
            CallError: If the controller returned an error code.
        """
        self._require_open()
        try:
            return await self.client.call(function, self.handle, *args, **kwargs)
        except CallError as error:
            error.subject = self._label
            raise

    def _require_open(self) -> None:
        if not self._open:  # the handle may belong to another object by now
            raise ObjectReleased(tr("{object!r} was used after it was closed. Try: connect to it again", object=self))

    async def _child(self, kind: type[N], function: Function[..., int], name: str, option: str) -> N:
        self._require_open()
        while (dropped := self.client.handles.pop_orphan()) is not None:
            try:
                if self.client.handles.drop_reference(*dropped):
                    await self.client.call(*dropped)
            except CallError:  # the controller has already released the object
                pass
        handle = await self.client.call(function, self.handle, name, option)
        child = kind(self.client, handle, name, self)
        self._adopt(child)
        return child

    def _adopt(self, child: AsyncObjectBase) -> None:
        """Register a child object, which is released with this one."""
        self._children[id(child)] = child
        self.client.handles.add_reference(child.functions.release, child.handle)

    async def close(self) -> None:
        """Release the object and its child objects, newest first. Closing an object again has no effect.

        It is not an error if the controller has already released the object, or if the connection is lost. If the
        controller does not reply in time, no further calls are made.
        """
        await self._release()

    async def _release(self) -> bool:
        """Release the object. Return False if the controller did not reply.

        The caller then releases no further objects, so that closing takes only one time-out in total.
        """
        if not self._open:
            return True
        self._open = False
        for reference in reversed(self._children.valuerefs()):  # a copy, because another thread may add a child
            child = reference()
            if child is not None and not await child._release():
                return False
        if not self.handle:
            return True  # a file that does not exist
        if not self.client.handles.drop_reference(self.functions.release, self.handle):
            return True  # another object has the same handle
        try:
            await self.client.call(self.functions.release, self.handle)
        except CallTimeout:
            return False
        except OrinError:  # already released with its parent or with the connection
            pass
        return True


class AsyncNamedObject(AsyncObjectBase):
    """Base class of objects with attribute, help, name, tag and ID: all except messages."""

    __slots__ = ()

    async def get_attribute(self) -> int:
        """Return the attribute bits."""
        assert self.functions.attribute is not None
        return await self._call(self.functions.attribute)

    async def get_help(self) -> str:
        """Return the help text."""
        assert self.functions.help is not None
        return await self._call(self.functions.help)

    async def get_name(self) -> str:
        """Return the name of the object on the controller."""
        assert self.functions.name is not None
        return await self._call(self.functions.name)

    async def get_tag(self) -> Any:
        """Return the tag, a user-defined value that the controller stores with the object."""
        assert self.functions.get_tag is not None
        return await self._call(self.functions.get_tag)

    async def put_tag(self, tag: Value) -> None:
        """Set the tag."""
        assert self.functions.put_tag is not None
        await self._call(self.functions.put_tag, tag)

    async def get_id(self) -> Any:
        """Return the ID. For the object ``I*``, which represents all variables I0, I1 ..., it is the selected index."""
        assert self.functions.get_id is not None
        return await self._call(self.functions.get_id)

    async def put_id(self, id: Value) -> None:  # noqa: A002 - the name in the documents
        """Set the ID."""
        assert self.functions.put_id is not None
        await self._call(self.functions.put_id, id)


class AsyncVariable(AsyncNamedObject):
    """A variable of a controller, robot, task, file or extension (RC8 3.1)."""

    __slots__ = ("_getting", "_putting")

    functions = ObjectFunctions(
        f.variable_release, f.variable_get_attribute, f.variable_get_help, f.variable_get_name,
        f.variable_get_tag, f.variable_put_tag, f.variable_get_id, f.variable_put_id,
    )  # fmt: skip

    def __init__(self, client: AsyncClient, handle: int, label: str, parent: AsyncObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._getting: PreparedFunction | None = None
        self._putting: PreparedFunction | None = None

    async def get_value(self) -> Any:
        """Return the value, converted to Python types (:mod:`orinkit.values.variant`)."""
        prepared = self._getting
        if prepared is None or not self._open:
            self._getting = prepared = self._prepare(f.variable_get_value)
        return await call_prepared_by_client(self.client, prepared, None)

    async def put_value(self, value: Value) -> None:
        """Set the value."""
        prepared = self._putting
        if prepared is None or not self._open:
            self._putting = prepared = self._prepare(f.variable_put_value)
        await call_prepared_by_client(self.client, prepared, value)

    def _prepare(self, function: Function[..., Any]) -> PreparedFunction:
        self._require_open()
        return self.client.prepare(function, self.handle, subject=self._label)

    async def get_date_time(self) -> Any:
        """Return the time at which the value was sampled, as a ``datetime`` in the controller's local time."""
        return await self._call(f.variable_get_date_time)

    async def get_microsecond(self) -> int:
        """Return the microseconds of the time at which the value was sampled."""
        return await self._call(f.variable_get_microsecond)


class AsyncPreparedCall:
    """An extended command of an object, prepared for many calls; created by ``prepare`` of the object.

    ``await call(parameter)`` executes the command, as ``execute(command, parameter)`` of the object does, and returns
    its result. The parameter is any value of CAO, ``None`` by default.

    Attributes:
        command: Name of the command.
    """

    __slots__ = ("_owner", "_prepared", "command")

    def __init__(self, owner: AsyncObjectContainer, prepared: PreparedCommand) -> None:
        self.command = prepared.command
        self._owner = owner
        self._prepared = prepared

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.command!r} of {self._owner!r}>"

    async def __call__(self, parameter: Value = None) -> Any:
        """Execute the command with a parameter, and return its result.

        Raises:
            InvalidValue: If the parameter cannot be converted; nothing was sent.
            CallError: If the controller returned an error code.
            CallTimeout: If there was no reply in time.
            ConnectionLost: If the connection broke.
            ObjectReleased: If the object is closed.
        """
        owner, prepared = self._owner, self._prepared
        client, changes = owner.client, prepared.changes
        # the same shortcut as in execute() of the object
        if owner._open and prepared.short_in is client.dialect and (changes is None or changes.forgotten):
            return await call_prepared_by_client(client, prepared, parameter)
        return await owner._execute(prepared, parameter)


class AsyncObjectContainer(AsyncNamedObject):
    """Base class of objects that have variables and extended commands."""

    __slots__ = ("_commands",)

    def __init__(self, client: AsyncClient, handle: int, label: str, parent: AsyncObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._commands: dict[str, PreparedCommand] = {}  # they do not refer to this object: it is deleted immediately

    async def variable(self, name: str, option: str = "") -> AsyncVariable:
        """Connect to a variable by name."""
        assert self.functions.variable is not None
        return await self._child(AsyncVariable, self.functions.variable, name, option)

    async def variable_names(self, option: str = "") -> list[str]:
        """Return the names of the variables."""
        assert self.functions.variable_names is not None
        return text_list(await self._call(self.functions.variable_names, option))

    async def execute(self, command: str, parameter: Value = None) -> Any:
        """Execute an extended command, for example ``execute("ClearError")``, and return its result.

        Args:
            command: Name of the command.
            parameter: Value of CAO. A robot also takes ``P(...)``, ``J(...)``, ``T(...)`` and ``V(...)``, also in lists,
                and sends them as text.
        """
        try:
            known = self._commands[command]
        except (KeyError, TypeError):
            known = self._prepare(command)
        client, changes = self.client, known.changes
        # the frequent case, without further calls of Python functions; _execute() is the general one
        if self._open and known.short_in is client.dialect and (changes is None or changes.forgotten):
            return await call_prepared_by_client(client, known, parameter)
        return await self._execute(known, parameter)

    def prepare(self, command: str) -> AsyncPreparedCall:
        """Return an extended command that is prepared for many calls. Nothing is sent.

        ::

            slv_move = robot.prepare("slvMove")
            feedback = await slv_move(pose)

        Args:
            command: Name of the command.
        """
        return AsyncPreparedCall(self, self._prepare(command))

    def _prepare(self, command: str) -> PreparedCommand:
        """Prepare a command, and keep it for :meth:`execute`; at most ``MOST_COMMANDS`` are kept."""
        assert self.functions.execute is not None
        if len(self._commands) >= MOST_COMMANDS:
            self._commands.clear()
        prepared = self.client.prepare(self.functions.execute, self.handle, command, subject=self._label)
        made = self._command(prepared, command)
        if type(command) is str:
            self._commands[command] = made
        return made

    def _command(self, prepared: PreparedFunction, command: str) -> PreparedCommand:
        return PreparedCommand(prepared)

    async def _execute(self, command: PreparedCommand, parameter: Value) -> Any:
        """Execute a prepared command."""
        self._require_open()
        client = self.client
        seconds = client.command_timeout(command.command)
        command.short_in = client.dialect if seconds is None else None
        if command.changes is not None:
            command.changes.forget()
        return await client.call_prepared(command, parameter, seconds)
