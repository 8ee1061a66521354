"""A device of your own, by decorators: what it serves is what its methods say.

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

A plain method runs in a worker thread, so it may take its time without holding up other clients; two clients may be in
it at once, so guard what must not be shared. An ``async def`` method runs in the server's event loop. ``quick=True``
says that a plain method returns at once: it then runs in the event loop too, which is faster.

To answer with an error code raise :func:`orinkit.errors.error_for`; any other exception is logged and is E_FAIL. What went
wrong is told in words to the client that asks for it: ``controller.error_description(error.code)``, which is the command
GetErrorDescription. A device may declare that command itself.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from datetime import datetime
from decimal import Decimal
from typing import Any, ClassVar, Final, Generic, TypeVar

from orinkit import hresult
from orinkit.cao import coerce
from orinkit.cao.provider import (
    Blocking,
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
from orinkit.errors import CallError, InvalidValue, error_for
from orinkit.language import pick
from orinkit.variant import ARRAY, Value, Variant, VarType, type_name
from orinkit.variant import variant as to_variant

D = TypeVar("D", bound="Declared")

READABLE: Final = 1
"""Attribute bit of a variable that can be read."""
WRITABLE: Final = 2
"""Attribute bit of a variable that can be written."""
_DESCRIBE: Final = "geterrordescription"
_DESCRIBED: Final = 1000  # characters of an error's description

_BY_ANNOTATION: Final[dict[object, VarType]] = {
    kind: vt
    for python, vt in ((bool, VarType.BOOL), (int, VarType.I4), (float, VarType.R8), (str, VarType.BSTR), (datetime, VarType.DATE))
    for kind in (python, python.__name__)
}  # fmt: skip


def _check_name(name: object) -> None:
    if not isinstance(name, str) or not name:
        raise TypeError(
            pick(
                'a name in the controller is needed: @variable("NAME"), @command("NAME")',
                'コントローラでの名前が必要です: @variable("名前")、@command("名前")',
            )
        )


def _check_type(name: str, vt: object) -> None:
    if vt is not None and (not isinstance(vt, int) or "?" in type_name(vt)):
        raise TypeError(
            pick(
                f"variable {name!r}: type must be a VarType, not {vt!r}",
                f"変数 {name!r}: type は VarType で指定してください ({vt!r})",
            )
        )


class Declared:
    """Something that a decorator declares: its name in the controller, and how its method is run."""

    kind = ""

    def __init__(self, method: Callable[..., Any], name: str, help: str, quick: bool) -> None:  # noqa: A002
        _check_name(name)
        self.method = method
        self.name = name
        self.help = help or inspect.getdoc(method) or ""
        self.quick = quick

    def run(self, method: Callable[..., Any], *args: Any) -> Any:
        """Call a method the way it is to be run: at once, awaited, or in a thread."""
        if self.quick or inspect.iscoroutinefunction(method):
            return method(*args)
        return Blocking(lambda: method(*args))


class DeclaredVariable(Declared):
    """A variable: a getter, perhaps a setter."""

    kind = "Variable"

    def __init__(self, method: Callable[..., Any], name: str, help: str, quick: bool, type: int | None) -> None:  # noqa: A002
        super().__init__(method, name, help, quick)
        _check_type(name, type)
        self.type = type if type is not None else _BY_ANNOTATION.get(method.__annotations__.get("return"))
        self.set: Callable[..., Any] | None = None

    def setter(self, method: Callable[..., Any]) -> DeclaredVariable:
        """Make the variable writable: the method gets the new value as plain Python."""
        self.set = method
        return self

    def accept(self, value: Variant) -> Any:
        """Return a written value as the variable's type.

        Raises:
            CallError: DISP_E_TYPEMISMATCH where it does not fit.
        """
        if self.type is None:
            return value.plain
        try:
            if self.type & ARRAY or self.type == VarType.DATE:
                return Variant(self.type, value.plain).plain
            return _as_type(self.type, value).plain
        except (InvalidValue, CallError) as error:
            raise error_for(hresult.DISP_E_TYPEMISMATCH, f"{self.name}: {error}") from None


class DeclaredCommand(Declared):
    """An Execute command."""

    kind = "Command"

    def arguments(self, parameter: Variant) -> list[Any]:
        """Return the method's arguments: a parameter array is spread over them, a method with one gets it whole.

        Raises:
            CallError: E_INVALIDARG where there are too many or too few.
        """
        parameters = list(inspect.signature(self.method).parameters.values())[1:]
        values = coerce.to_values(parameter)
        if len(parameters) == 1 and parameters[0].kind is not inspect.Parameter.VAR_POSITIONAL and len(values) > 1:
            values = [values]
        try:
            inspect.signature(self.method).bind(None, *values)
        except TypeError:
            wanted = ", ".join(str(p) for p in parameters)
            raise error_for(
                hresult.E_INVALIDARG,
                pick(
                    f"{self.name}({wanted}) was given {len(values)} values",
                    f"{self.name}({wanted}) に {len(values)} 個の値が渡されました",
                ),
            ) from None
        converted = [_converted(*pair) for pair in zip(parameters, values, strict=False)]
        return converted + values[len(converted) :]


def _converted(parameter: inspect.Parameter, value: Any) -> Any:
    """Return an argument of a command as its annotation says: bool, int, float or str; another one as it came.

    Raises:
        CallError: E_INVALIDARG where it cannot be that.
    """
    vt = _BY_ANNOTATION.get(parameter.annotation)
    if vt is None or vt is VarType.DATE or parameter.kind is inspect.Parameter.VAR_POSITIONAL:
        return value
    try:
        return _as_type(vt, to_variant(value)).plain
    except (InvalidValue, CallError) as error:
        raise error_for(hresult.E_INVALIDARG, f"{parameter}: {error}") from None


def _as_type(vt: int, value: Variant) -> Variant:
    if vt == value.type:
        return value
    if vt == VarType.BSTR:
        return Variant(vt, coerce.to_text(value))
    number = coerce.to_number(value)
    return Variant(vt, Decimal(repr(number)) if vt == VarType.CY else number)


class DeclaredChild(Declared):
    """An object below: the method returns it, once for every client that connects to it."""

    def __init__(self, method: Callable[..., Any], name: str, help: str, kind: str) -> None:  # noqa: A002
        super().__init__(method, name, help, quick=True)
        self.kind = kind


class _Decorator(Generic[D]):
    def __init__(self, make: Callable[[Callable[..., Any]], D]) -> None:
        self._make = make

    def __call__(self, method: Callable[..., Any]) -> D:
        return self._make(method)


def variable(
    name: str,
    *,
    type: int | None = None,  # noqa: A002 - the documents' word
    help: str = "",  # noqa: A002
    quick: bool = False,
) -> _Decorator[DeclaredVariable]:
    """Declare a variable; the method is its getter, ``@method.setter`` makes it writable.

    Args:
        name: name in the controller; upper and lower case do not matter.
        type: VARIANT type, ``VarType.R4`` or ``VarType.R4 | VarType.ARRAY``; by default what the annotation of the
            getter's result says (bool, int, float, str), else whatever the getter returns.
        help: help text; by default the docstring.
        quick: the methods return at once.
    """
    return _Decorator(lambda method: DeclaredVariable(method, name, help, quick, type))


def command(name: str, *, help: str = "", quick: bool = False) -> _Decorator[DeclaredCommand]:  # noqa: A002
    """Declare an Execute command; what the method returns is the result.

    The parameter is spread over the method's arguments, so ``Execute("Close", [10.0, 1])`` calls ``close(10.0, 1)``.
    """
    return _Decorator(lambda method: DeclaredCommand(method, name, help, quick))


def _child(kind: str) -> Callable[..., _Decorator[DeclaredChild]]:
    def declare(name: str, *, help: str = "") -> _Decorator[DeclaredChild]:  # noqa: A002
        return _Decorator(lambda method: DeclaredChild(method, name, help, kind))

    declare.__doc__ = (
        f"Declare an object below of the kind {kind}; the method returns a :class:`Part` or an object of cao.provider."
    )
    return declare


extension = _child("Extension")
robot = _child("Robot")
task = _child("Task")
file = _child("File")
command_object = _child("Command object")


def _declared_in(kind: type) -> dict[tuple[str, str], Declared]:
    """Return what one class declares by itself; two members of one kind and name would hide each other."""
    found: dict[tuple[str, str], Declared] = {}
    for member in vars(kind).values():
        if isinstance(member, Declared) and found.setdefault((member.kind, member.name.lower()), member) is not member:
            raise TypeError(
                pick(
                    f"{kind.__name__} declares the {member.kind} {member.name!r} twice; upper and lower case are the same",
                    f"{kind.__name__} で {member.kind} {member.name!r} が二重に宣言されています (大文字と小文字は区別しません)",
                )
            )
    return found


class Part:
    """Something with declared variables, commands and objects below; one instance serves all clients."""

    _declared: ClassVar[dict[tuple[str, str], Declared]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Collect what the class and its bases declare."""
        super().__init_subclass__(**kwargs)
        cls._declared = {}
        for base in reversed(cls.__mro__):
            cls._declared.update(_declared_in(base))

    @classmethod
    def declared(cls, kind: str, name: str) -> Declared | None:
        """Return what is declared under a name: kind is Variable, Command, Extension, Robot, Task or File."""
        return cls._declared.get((kind, name.lower()))

    @classmethod
    def names(cls, kind: str) -> list[str]:
        """Return the names of everything declared of a kind, in order."""
        return [member.name for (of, _), member in cls._declared.items() if of == kind]


class Device(Part, Provider):
    """A device that clients reach with Controller_Connect; declare what it has with the decorators of this module."""

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        """Every client gets its own view of the one device."""
        return _PartController(self, name, client.reason)


class _PartVariable(VariableObject):
    """One client's handle of a declared variable."""

    def __init__(self, part: Part, declared: DeclaredVariable) -> None:
        super().__init__(declared.name, attribute=READABLE | (WRITABLE if declared.set else 0), help=declared.help)
        self._part = part
        self._variable = declared
        self._taken: datetime | None = None

    def get_value(self) -> Any:
        """Call the getter."""
        declared = self._variable
        method = declared.method
        if inspect.iscoroutinefunction(method):
            return self._await(method)
        return declared.run(lambda: self._typed(method(self._part)))

    async def _await(self, method: Callable[..., Any]) -> Value:
        return self._typed(await method(self._part))

    def _typed(self, value: Value) -> Value:
        self._taken = datetime.now()
        if self._variable.type is None or isinstance(value, Variant):
            return value
        return Variant(self._variable.type, value)

    def put_value(self, value: Variant) -> Any:
        """Call the setter."""
        declared = self._variable
        if declared.set is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, declared.name)
        self._taken = datetime.now()
        return declared.run(declared.set, self._part, declared.accept(value))

    def get_date_time(self) -> datetime:
        """When the value was last read or written by this client."""
        return (self._taken or datetime.now()).replace(microsecond=0)

    def get_microsecond(self) -> int:
        """The microseconds of that time."""
        return (self._taken or datetime.now()).microsecond


class _PartObject(OwnerObject):
    """One client's handle of a part: variables, commands, objects below."""

    def __init__(self, part: Part, name: str, help: str = "") -> None:  # noqa: A002 - the documents' word
        super().__init__(name, help=help or inspect.getdoc(type(part)) or "")
        self.part = part

    def get_variable(self, name: str, option: str) -> VariableObject:
        declared = self.part.declared("Variable", name)
        if not isinstance(declared, DeclaredVariable):
            raise not_found(_among(name, self.part.names("Variable")))
        return _PartVariable(self.part, declared)

    def get_variable_names(self, option: str) -> list[str]:
        return self.part.names("Variable")

    def execute(self, command: str, parameter: Variant) -> Any:
        declared = self.part.declared("Command", command)
        if not isinstance(declared, DeclaredCommand):
            raise error_for(hresult.E_INVALID_CMD_NAME, _among(command, self.part.names("Command")))
        return declared.run(declared.method, self.part, *declared.arguments(parameter))

    def child(self, kind: str, name: str) -> Any:
        """Return the declared object below of that name, for one more client."""
        declared = self.part.declared(kind, name)
        if not isinstance(declared, DeclaredChild):
            raise not_found(_among(name, self.part.names(kind)))
        below = declared.method(self.part)
        if isinstance(below, CaoObject):
            return below
        if kind not in _KINDS or not isinstance(below, Part):
            wanted = "Part, orinkit.cao.provider.CaoObject" if kind in _KINDS else "orinkit.cao.provider.CommandObject"
            name = declared.method.__qualname__
            raise TypeError(
                pick(
                    f"{name} must return {wanted}, not {below!r:.100}",
                    f"{name} は {wanted} を返す必要があります: {below!r:.100}",
                )
            )
        return _KINDS[kind](below, declared.name, declared.help)


def _among(name: str, names: Sequence[str]) -> str:
    return pick(
        f"{name!r}; there are: {', '.join(names) or 'none'}", f"{name!r}。あるもの: {', '.join(names) or 'なし'}"
    )


def _code_in(parameter: Variant) -> int:
    """Return a return code, signed or unsigned.

    Raises:
        CallError: E_INVALIDARG, E_INVALIDARGTYPE; it is none.
    """
    number = coerce.to_real(parameter)
    if not number.is_integer() or not -(2**31) <= number < 2**32:
        raise error_for(
            hresult.E_INVALIDARG,
            pick(f"{number:.15g} is no 32-bit code", f"{number:.15g} は 32 ビットのコードではありません"),
        )
    return int(number)


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
        return self.part.names("File")


class _PartController(_PartObject, ControllerObject):
    def __init__(self, part: Part, name: str, reason: Callable[[int], str]) -> None:
        super().__init__(part, name)
        self._reason = reason

    def execute(self, command: str, parameter: Variant) -> Any:
        if command.lower() == _DESCRIBE and self.part.declared("Command", command) is None:
            code = _code_in(parameter)
            return self._reason(code)[:_DESCRIBED] or hresult.lookup(code).text
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
        return self.part.names("Extension")

    def get_file_names(self, option: str) -> list[str]:
        return self.part.names("File")

    def get_robot_names(self, option: str) -> list[str]:
        return self.part.names("Robot")

    def get_command_names(self, option: str) -> list[str]:
        return self.part.names("Command object")

    def get_task_names(self, option: str) -> list[str]:
        return self.part.names("Task")


_KINDS: Final[dict[str, type[_PartObject]]] = {
    "Extension": _PartExtension,
    "Robot": _PartRobot,
    "Task": _PartTask,
    "File": _PartFile,
}
