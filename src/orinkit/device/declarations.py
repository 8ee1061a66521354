"""The decorators of :mod:`orinkit.device`, and the declarations that they create from methods."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from decimal import Decimal
from typing import Any, Final, Generic, TypeVar, overload

from orinkit.cao import coerce
from orinkit.cao.provider import BlockingCall
from orinkit.cao.table import Argument
from orinkit.cao.user_functions import check_number, user_entry
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.values.types import ARRAY, BY_PYTHON, EMPTIES, VarType, type_name
from orinkit.values.variant import Variant, plain
from orinkit.values.variant import variant as to_variant

D = TypeVar("D", bound="Declared")
T = TypeVar("T")

# Values annotated as Decimal are not converted, because few clients can send VT_CY.
_BY_ANNOTATION: Final[dict[object, int]] = {
    annotation: vt
    for python, vt in BY_PYTHON.items()
    for annotation in (python, python.__name__)
    if vt not in EMPTIES and python is not Decimal
}


def _check_name(decorator: str, name: object) -> None:
    if not isinstance(name, str) or not name:
        raise TypeError(tr('a name is required. Try: @{decorator}("NAME")', decorator=decorator))


def _check_type(name: str, vt: object) -> None:
    if vt is not None and (not isinstance(vt, int) or "?" in type_name(vt)):
        raise TypeError(tr("variable {name!r}: type must be a VarType, not {type!r}", name=name, type=vt))


class Declared:
    """A declared member of a device: the name by which clients refer to it, and the method that implements it."""

    kind = ""

    def __init__(self, method: Callable[..., Any], name: str, help: str, quick: bool) -> None:  # noqa: A002 - a parameter of the public interface
        self.method = method
        self.name = name
        self.help = help or inspect.getdoc(method) or ""
        self.quick = quick

    def run(self, method: Callable[..., Any], *args: Any) -> Any:
        """Call a method and return its result, or return a call that the server executes in a worker thread.

        The method is called immediately if it was declared with ``quick=True`` or is a coroutine function.
        """
        if self.quick or inspect.iscoroutinefunction(method):
            return method(*args)
        return BlockingCall(lambda: method(*args))


class DeclaredVariable(Declared, Generic[T]):
    """A declared variable: a getter and, if clients may write the variable, a setter.

    In the device's own code, the variable behaves like a property.
    """

    kind = "Variable"

    def __init__(self, method: Callable[..., Any], name: str, help: str, quick: bool, type: int | None) -> None:  # noqa: A002 - a parameter of the public interface
        super().__init__(method, name, help, quick)
        _check_type(name, type)
        self.type = type if type is not None else _BY_ANNOTATION.get(method.__annotations__.get("return"))
        self.set: Callable[..., Any] | None = None

    @overload
    def __get__(self, part: None, owner: type) -> DeclaredVariable[T]: ...
    @overload
    def __get__(self, part: object, owner: type) -> T: ...
    def __get__(self, part: object, owner: type) -> DeclaredVariable[T] | T:
        if part is None:
            return self
        value: T = self.method(part)
        return value

    def __set__(self, part: object, value: T) -> None:
        if self.set is None:
            raise AttributeError(tr("variable {name!r} has no setter", name=self.name))
        self.set(part, value)

    def setter(self, method: Callable[[Any, T], Any]) -> DeclaredVariable[T]:
        """Declare the setter, which makes the variable writable. The method receives the new value as a Python object.

        Type checkers require that getter and setter have different names: ``def set_width(self, width: float)``.
        """
        self.set = method
        return self

    def accept(self, value: Variant) -> Any:
        """Return the value of a client's write call, converted to the type of the variable.

        If the variable has no type, the value is converted to the Python type that corresponds to its VARIANT type.

        Raises:
            CallError: DISP_E_TYPEMISMATCH, if the value does not fit the type.
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
    """A declared command, which clients call with Execute."""

    kind = "Command"

    def arguments(self, parameter: Variant) -> list[Any]:
        """Return the arguments with which to call the method for the parameter of a client's Execute.

        Each element of an array becomes an argument. If the method takes only one argument, an array of several
        elements becomes one argument, a list. VT_EMPTY stands for no arguments, and any other value becomes the only
        argument.

        Raises:
            CallError: E_INVALIDARG, if there are too many or too few values, or a value does not fit the annotation of
                its argument.
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
                tr("{name}({wanted}) received {count} values", name=self.name, wanted=wanted, count=len(values)),
            ) from None
        converted = [_converted(*pair) for pair in zip(parameters, values, strict=False)]
        return converted + values[len(converted) :]


def _converted(parameter: inspect.Parameter, value: Any) -> Any:
    """Convert an argument of a command to its annotated type (bool, int, float or str).

    An argument with another annotation, or without an annotation, is returned unchanged.

    Raises:
        CallError: E_INVALIDARG, if the value does not fit.
    """
    vt = _BY_ANNOTATION.get(parameter.annotation)
    if vt is None or vt == VarType.DATE or parameter.kind is inspect.Parameter.VAR_POSITIONAL:
        return value
    try:
        return _as_type(vt, to_variant(value)).plain
    except InvalidValue as error:
        raise error_for(hresult.E_INVALIDARG, f"{parameter}: {error}") from None
    except CallError as error:  # only its detail: the message would contain a second return code and remedy
        raise error_for(hresult.E_INVALIDARG, f"{parameter}: {error.detail or error.info.text}") from None


def _as_type(vt: int, value: Variant) -> Variant:
    if vt == value.type:
        return value
    if vt == VarType.BSTR:
        return Variant(vt, coerce.to_text(value))
    number = coerce.to_number(value)
    return Variant(vt, Decimal(repr(number)) if vt == VarType.CY else number)


_ARGUMENT_TYPES: Final = {
    annotation: vt
    for python, vt in ((int, VarType.I4), (float, VarType.R8), (str, VarType.BSTR), (bool, VarType.BOOL))
    for annotation in (python, python.__name__)
}


class DeclaredFunction(Declared):
    """A declared user-defined function, which clients call by its number.

    Attributes:
        entry: the entry of the function, with its arguments.
    """

    kind = "User function"

    def __init__(self, method: Callable[..., Any], number: int, name: str, help: str, quick: bool) -> None:  # noqa: A002 - a parameter of the public interface
        super().__init__(method, str(check_number(number)), help, quick)
        parameters = list(inspect.signature(method).parameters.values())[1:]
        if any(each.kind not in _BY_POSITION for each in parameters):
            raise TypeError(
                tr(
                    "user-defined function {number}: its parameters must be positional, without * and **",
                    number=number,
                )
            )
        result = inspect.signature(method).return_annotation
        self.entry = user_entry(
            number,
            name or method.__name__,
            tuple(map(_argument, parameters)),
            None if result in (None, "None") else VarType.VARIANT,
            self.help,
            self.help,
        )

    def call(self, part: object, *values: Any) -> Any:
        """Call the method with the arguments of a client, converted to their types."""
        return self.run(self.method, part, *(plain(value) for value in values))


_BY_POSITION: Final = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def _argument(parameter: inspect.Parameter) -> Argument:
    """Return the argument that a parameter with its annotation represents; without one, any type is accepted."""
    vt = _ARGUMENT_TYPES.get(parameter.annotation, VarType.VARIANT)
    optional = parameter.default is not inspect.Parameter.empty
    return Argument(parameter.name, vt, optional=optional, default=parameter.default if optional else None)


class DeclaredChild(Declared):
    """A declared child object. Each time a client connects to it, the decorated method is called and returns it."""

    def __init__(self, method: Callable[..., Any], name: str, help: str, kind: str) -> None:  # noqa: A002 - a parameter of the public interface
        super().__init__(method, name, help, quick=True)
        self.kind = kind


class _Decorator(Generic[D]):
    def __init__(self, make: Callable[[Callable[..., Any]], D]) -> None:
        self._make = make

    def __call__(self, method: Callable[..., Any]) -> D:
        return self._make(method)


class _VariableDecorator:
    def __init__(self, name: str, type: int | None, help: str, quick: bool) -> None:  # noqa: A002 - a parameter of the public interface
        self._options = (name, help, quick, type)

    def __call__(self, method: Callable[[Any], T]) -> DeclaredVariable[T]:
        return DeclaredVariable(method, *self._options)


def variable(
    name: str,
    *,
    type: int | None = None,  # noqa: A002 - the name in the documents
    help: str = "",  # noqa: A002 - a parameter of the public interface
    quick: bool = False,
) -> _VariableDecorator:
    """Declare a variable. The decorated method is its getter.

    If the getter is named ``width``, the decorator ``@width.setter`` declares the setter, which makes the variable
    writable. In the device's own code, ``self.width`` calls the getter, and ``self.width = 5.0`` calls the setter.

    Args:
        name: Name by which clients refer to the variable; case is ignored.
        type: VARIANT type, for example ``VarType.R4`` or ``VarType.R4 | VarType.ARRAY``. By default, the annotation of
            the getter's result (bool, int, float, str) determines the type. If there is no annotation, each value is
            sent with the VARIANT type that corresponds to its Python type.
        help: Help text for clients; the default is the docstring of the getter.
        quick: True if getter and setter return immediately; the server then calls them in its event loop.
    """
    _check_name("variable", name)
    return _VariableDecorator(name, type, help, quick)


def command(name: str, *, help: str = "", quick: bool = False) -> _Decorator[DeclaredCommand]:  # noqa: A002 - a parameter of the public interface
    """Declare a command, which clients call with Execute. The client receives the return value of the method.

    The elements of the parameter become the method's arguments: ``Execute("Close", [10.0, 1])`` calls
    ``close(10.0, 1)``.

    Args:
        name: Name by which clients call the command; case is ignored.
        help: Help text for clients; the default is the docstring of the method.
        quick: True if the method returns immediately; the server then calls it in its event loop.
    """
    _check_name("command", name)
    return _Decorator(lambda method: DeclaredCommand(method, name, help, quick))


def user_function(
    number: int,
    name: str = "",
    *,
    help: str = "",  # noqa: A002 - a parameter of the public interface
    quick: bool = False,
) -> _Decorator[DeclaredFunction]:
    """Declare a user-defined function (e-CAP 3.3), which clients call by its number, without a handle.

    The annotations of the parameters (bool, int, float, str) determine their types; a parameter without an annotation
    accepts any type. The function has at most five parameters. The client receives the return value of the method.

    Args:
        number: Number of the function: from 256, or 255 for clients of e-CAP only.
        name: Name for messages; the default is the name of the method.
        help: Help text; the default is the docstring of the method.
        quick: True if the method returns immediately; the server then calls it in its event loop.

    Raises:
        InvalidValue: If the number is not valid, or the method has more than five parameters.
        TypeError: If the method has keyword-only or variable parameters.
    """
    return _Decorator(lambda method: DeclaredFunction(method, number, name, help, quick))


def _child(kind: str, decorator: str) -> Callable[..., _Decorator[DeclaredChild]]:
    def declare(name: str, *, help: str = "") -> _Decorator[DeclaredChild]:  # noqa: A002 - a parameter of the public interface
        _check_name(decorator, name)
        return _Decorator(lambda method: DeclaredChild(method, name, help, kind))

    declare.__doc__ = (
        f"Declare a child object of type {kind}; the method returns a :class:`Part` or an object of cao.provider."
    )
    return declare


extension = _child("Extension", "extension")
robot = _child("Robot", "robot")
task = _child("Task", "task")
file = _child("File", "file")
command_object = _child("Command object", "command_object")


def declared_in(kind: type) -> dict[tuple[str, str], Declared]:
    """Return the declarations of a class by kind and lower-case name, without those of its base classes.

    Raises:
        TypeError: If two members have the same kind and name, because one would hide the other.
    """
    found: dict[tuple[str, str], Declared] = {}
    for member in vars(kind).values():
        if isinstance(member, Declared) and found.setdefault((member.kind, member.name.lower()), member) is not member:
            raise TypeError(
                tr(
                    "{device} declares {kind} {name!r} twice (case is ignored)",
                    device=kind.__name__,
                    kind=member.kind,
                    name=member.name,
                )
            )
    return found
