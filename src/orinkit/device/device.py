"""Base classes of user-written devices. Clients use the decorated methods as variables, commands and objects.

::

    class Gripper(Device):
        provider_names = ("CaoProv.Example.Gripper",)
        width = 30.0

        @variable("WIDTH", help="Opening in mm")
        def opening(self) -> float:
            return self.width

        @opening.setter
        def opening(self, mm: float) -> None:
            self.width = mm

        @command("Close")
        def close_fingers(self, force: float = 10.0) -> None:
            ...

    with serve(Gripper(), "tcp://127.0.0.1:5007") as server:
        server.wait()

A plain method runs in a worker thread, so it may block without delaying other clients. Calls of several clients may run
concurrently, so protect shared data with a lock. An ``async def`` method runs in the server's event loop. A plain
method that is declared with ``quick=True`` also runs in the event loop, which is faster. Such a method must return
immediately.

To return an error code to the client, raise the exception that :func:`orinkit.core.errors.error_for` creates. Any other
exception is logged, and the client receives E_FAIL. Clients can read the text of the error with
``controller.error_description(error.code)``, that is, with the command GetErrorDescription. A device may declare a
command of this name, which is then used instead.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial
from types import FunctionType
from typing import Any, Final
from weakref import WeakKeyDictionary

from orinkit.cao.dialect import Dialect
from orinkit.cao.error_description import DESCRIBE, get_error_description
from orinkit.cao.provider import (
    READABLE,
    WRITABLE,
    CaoObject,
    ClientInfo,
    CommandObject,
    ControllerObject,
    ExtensionObject,
    FileObject,
    OwnerObject,
    Provider,
    RobotObject,
    TaskObject,
    VariableObject,
    not_found,
)
from orinkit.cao.user_functions import UserFunction
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import quoted, tr
from orinkit.device.declarations import Declared as Declared
from orinkit.device.declarations import DeclaredChild as DeclaredChild
from orinkit.device.declarations import DeclaredCommand as DeclaredCommand
from orinkit.device.declarations import DeclaredFunction as DeclaredFunction
from orinkit.device.declarations import DeclaredVariable as DeclaredVariable
from orinkit.device.declarations import declared_in
from orinkit.values.variant import Value, Variant

_DECLARED: Final[WeakKeyDictionary[type, dict[tuple[str, str], Declared]]] = WeakKeyDictionary()
"""Declarations of each class and its base classes.

They are not stored in an attribute of the class, because the author of the class may already use the same name.
"""


class Part:
    """Base class of objects with declared variables, commands and child objects; one instance serves all clients."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Collect the declarations of the class and its bases.

        Raises:
            TypeError: If a name is declared twice, or the name of a declared method is reserved for Python, like
                ``__len__``.
        """
        super().__init_subclass__(**kwargs)
        found: dict[tuple[str, str], Declared] = {}
        for base in reversed(cls.__mro__):
            found.update(declared_in(base))
        _DECLARED[cls] = found
        for name, member in vars(cls).items():
            if isinstance(member, Declared) and name.startswith("__") and name.endswith("__"):
                raise _reserved(cls, name)


class Device(Part, Provider):
    """Base class of user-written devices. The decorators of :mod:`orinkit.device` declare what clients can use.

    Clients connect to a device with Controller_Connect. The server uses the members of
    :class:`~orinkit.cao.provider.Provider`, so these names are reserved: ``close``, ``connect``, ``dialect``,
    ``fixed_handles``, ``functions``, ``guard``, ``handle_of``, ``provider_names``, ``requires_secret``,
    ``unique_names``, ``unwraps_variants``, ``user_functions``. A device may override a reserved name with the same meaning, for example
    define ``close()`` to clean up after the server has stopped. Any other use of these names raises TypeError.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Check the names that are reserved for the server.

        Raises:
            TypeError: If a reserved name is used for another purpose.
        """
        super().__init_subclass__(**kwargs)
        for name in _NEEDED:
            _check_member(cls, name, inspect.getattr_static(cls, name))

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute.

        Raises:
            TypeError: If the name is reserved for the server, and the value does not have the type or signature that
                the server requires.
        """
        if name in _NEEDED and not _fits(name, value):
            raise _misused(type(self), name)
        super().__setattr__(name, value)

    def user_functions(self) -> Sequence[UserFunction]:
        """Return the declared user-defined functions."""
        return [
            UserFunction(member.entry, partial(member.call, self))
            for member in _DECLARED.get(type(self), {}).values()
            if isinstance(member, DeclaredFunction)
        ]

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        """Return a controller object for one client; the controller objects of all clients use this device."""
        return _PartController(self, name, client.describe_error)


# --- reserved names ---------------------------------------------------------------------------------------------------

_NEEDED: Final = {
    "close": "close(self)",
    "connect": "connect(self, name, machine, option, client)",
    "dialect": "orinkit.cao.dialect.Dialect",
    "fixed_handles": "bool",
    "functions": "frozenset[int] | None",
    "guard": "contextlib.AbstractContextManager",
    "handle_of": "handle_of(self, interface, name)",
    "provider_names": "Sequence[str]",
    "requires_secret": "bool",
    "unique_names": "bool",
    "unwraps_variants": "bool",
    "user_functions": "user_functions(self)",
}
"""Names that the server uses, and the required type or signature of each."""
_ARGUMENTS: Final = {"close": 0, "connect": 4, "handle_of": 2, "user_functions": 0}
_OTHERWISE: Final = {"close": "close_fingers", "connect": "open_port"}


def _check_member(cls: type, name: str, member: object) -> None:
    """Check a member with a reserved name; the value of a property is not checked.

    Raises:
        TypeError: If the member does not have the type or signature that the server requires.
    """
    if isinstance(member, Declared):
        raise _reserved(cls, name)
    if isinstance(member, FunctionType | staticmethod | classmethod):
        member = member.__get__(object(), cls)
    elif hasattr(member, "__get__"):
        return
    if not _fits(name, member):
        raise _misused(cls, name)


def _fits(name: str, value: object) -> bool:
    """Return True if a value or a bound method has the type or signature that a reserved name requires."""
    if name in _ARGUMENTS:
        return callable(value) and _takes(value, _ARGUMENTS[name])
    if name == "dialect":
        return isinstance(value, Dialect)
    if name in ("fixed_handles", "requires_secret", "unique_names", "unwraps_variants"):
        return isinstance(value, bool)
    if name == "functions":
        return value is None or isinstance(value, frozenset)
    if name == "guard":
        return hasattr(value, "__enter__") and hasattr(value, "__exit__")
    return not callable(value) and not isinstance(value, Declared)


def _takes(method: Callable[..., Any], count: int) -> bool:
    try:
        signature = inspect.signature(method)
    except (TypeError, ValueError):  # a compiled function has no signature
        return True
    try:
        signature.bind(*range(count))
    except TypeError:
        return False
    return True


def _reserved(cls: type, name: str) -> TypeError:
    other = _OTHERWISE.get(name, f"my_{name.strip('_')}")
    by = "Python" if name.startswith("__") else tr("the server")
    return TypeError(
        tr(
            "{device}.{method} cannot be declared: {method} is reserved for {by}. Try: another method name, such as "
            '{other}; the name in the controller may be the same: @command("{name}")',
            device=cls.__name__,
            method=name,
            by=by,
            other=other,
            name=name.strip("_").title(),
        )
    )


def _misused(cls: type, name: str) -> TypeError:
    other = _OTHERWISE.get(name, f"my_{name}")
    return TypeError(
        tr(
            "{device}.{method} must be {needed}: it is reserved for the server. Try: another name, such as {other}",
            device=cls.__name__,
            method=name,
            needed=_NEEDED[name],
            other=other,
        )
    )


# --- objects of a client ----------------------------------------------------------------------------------------------


def _declared(part: Part, kind: str, name: str) -> Declared | None:
    """Return the declaration with this kind and name in a part; ``None`` if there is none.

    The kinds are Variable, Command, Extension, Robot, Task, File and Command object.
    """
    return _DECLARED.get(type(part), {}).get((kind, name.lower()))


def _names(part: Part, kind: str) -> list[str]:
    """Return the names of all declarations of this kind in a part, in the order of declaration."""
    return [member.name for (of, _), member in _DECLARED.get(type(part), {}).items() if of == kind]


class _PartVariable(VariableObject):
    """The object through which one client uses a declared variable."""

    def __init__(self, part: Part, declared: DeclaredVariable[Any]) -> None:
        super().__init__(declared.name, attribute=READABLE | (WRITABLE if declared.set else 0), help=declared.help)
        self._part = part
        self._variable = declared
        self._accessed: datetime | None = None

    def get_value(self) -> Any:
        """Call the getter and return its result, or return a call of the getter for the server to execute."""
        declared = self._variable
        method = declared.method
        if inspect.iscoroutinefunction(method):
            return self._await(method)
        return declared.run(lambda: self._typed(method(self._part)))

    async def _await(self, method: Callable[..., Any]) -> Value:
        return self._typed(await method(self._part))

    def _typed(self, value: Value) -> Value:
        self._accessed = datetime.now()
        if self._variable.type is None or isinstance(value, Variant):
            return value
        return Variant(self._variable.type, value)

    def put_value(self, value: Variant) -> Any:
        """Call the setter, or return a call of the setter for the server to execute.

        Raises:
            CallError: E_CAO_NOT_WRITABLE, if the variable has no setter; DISP_E_TYPEMISMATCH, if the value does not fit
                the type of the variable.
        """
        declared = self._variable
        if declared.set is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, declared.name)
        self._accessed = datetime.now()
        return declared.run(declared.set, self._part, declared.accept(value))

    def get_date_time(self) -> datetime:
        """Return the time at which this client last read or wrote the variable, without microseconds.

        Before the first access, the result is the current time.
        """
        return (self._accessed or datetime.now()).replace(microsecond=0)

    def get_microsecond(self) -> int:
        """Return the microseconds of the time at which this client last read or wrote the variable.

        Before the first access, they are those of the current time.
        """
        return (self._accessed or datetime.now()).microsecond


class _PartObject(OwnerObject):
    """The object through which one client uses the variables, commands and child objects of a part."""

    def __init__(self, part: Part, name: str, help: str = "") -> None:  # noqa: A002 - the name in the documents
        super().__init__(name, help=help or inspect.getdoc(type(part)) or "")
        self.part = part

    def get_variable(self, name: str, option: str) -> VariableObject:
        declared = _declared(self.part, "Variable", name)
        if not isinstance(declared, DeclaredVariable):
            raise not_found(_among(name, _names(self.part, "Variable")))
        return _PartVariable(self.part, declared)

    def get_variable_names(self, option: str) -> list[str]:
        return _names(self.part, "Variable")

    def execute(self, command: str, parameter: Variant) -> Any:
        declared = _declared(self.part, "Command", command)
        if not isinstance(declared, DeclaredCommand):
            raise error_for(hresult.E_INVALID_CMD_NAME, _among(command, _names(self.part, "Command")))
        return declared.run(declared.method, self.part, *declared.arguments(parameter))

    def child(self, kind: str, name: str) -> Any:
        """Return the object through which the client uses a declared child object."""
        declared = _declared(self.part, kind, name)
        if not isinstance(declared, DeclaredChild):
            raise not_found(_among(name, _names(self.part, kind)))
        below = declared.method(self.part)
        if isinstance(below, CaoObject):
            return below
        if kind not in _KINDS or not isinstance(below, Part):
            wanted = "Part, orinkit.cao.provider.CaoObject" if kind in _KINDS else "orinkit.cao.provider.CommandObject"
            name = declared.method.__qualname__
            raise TypeError(
                tr("{name} must return {wanted}, not {returned}", name=name, wanted=wanted, returned=quoted(below, 100))
            )
        return _KINDS[kind](below, declared.name, declared.help)


def _among(name: str, names: Sequence[str]) -> str:
    return tr("{name}; available: {names}", name=quoted(name), names=", ".join(names) or tr("none"))


class _PartExtension(_PartObject, ExtensionObject):
    pass


class _PartRobot(_PartObject, RobotObject):
    pass


class _PartTask(_PartObject, TaskObject):
    pass


class _PartFile(_PartObject, FileObject):
    def get_file(self, name: str, option: str) -> FileObject:
        below: FileObject = self.child("File", name)
        return below

    def get_file_names(self, option: str) -> list[str]:
        return _names(self.part, "File")


class _PartController(_PartObject, ControllerObject):
    def __init__(self, part: Part, name: str, describe_error: Callable[[int], str]) -> None:
        super().__init__(part, name)
        self._describe_error = describe_error

    def execute(self, command: str, parameter: Variant) -> Any:
        if command.lower() == DESCRIBE and _declared(self.part, "Command", command) is None:
            return get_error_description(self._describe_error, parameter)
        return super().execute(command, parameter)

    def get_extension(self, name: str, option: str) -> ExtensionObject:
        below: ExtensionObject = self.child("Extension", name)
        return below

    def get_file(self, name: str, option: str) -> FileObject:
        below: FileObject = self.child("File", name)
        return below

    def get_robot(self, name: str, option: str) -> RobotObject:
        below: RobotObject = self.child("Robot", name)
        return below

    def get_command(self, name: str, option: str) -> CommandObject:
        below: CommandObject = self.child("Command object", name)
        return below

    def get_task(self, name: str, option: str) -> TaskObject:
        below: TaskObject = self.child("Task", name)
        return below

    def get_extension_names(self, option: str) -> list[str]:
        return _names(self.part, "Extension")

    def get_file_names(self, option: str) -> list[str]:
        return _names(self.part, "File")

    def get_robot_names(self, option: str) -> list[str]:
        return _names(self.part, "Robot")

    def get_command_names(self, option: str) -> list[str]:
        return _names(self.part, "Command object")

    def get_task_names(self, option: str) -> list[str]:
        return _names(self.part, "Task")


_KINDS: Final[dict[str, type[_PartObject]]] = {
    "Extension": _PartExtension,
    "Robot": _PartRobot,
    "Task": _PartTask,
    "File": _PartFile,
}
