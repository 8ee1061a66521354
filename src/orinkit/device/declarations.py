"""What the decorators of :mod:`orinkit.device` make of a method: a declaration, with its name and how it is run."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from decimal import Decimal
from typing import Any, Final, Generic, TypeVar, overload

from orinkit.cao import coerce
from orinkit.cao.provider import BlockingCall
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.values.types import ARRAY, BY_PYTHON, EMPTIES, VarType, type_name
from orinkit.values.variant import Variant
from orinkit.values.variant import variant as to_variant

D = TypeVar("D", bound="Declared")
T = TypeVar("T")

# A value annotated as Decimal is left as it is: few clients can send VT_CY.
_BY_ANNOTATION: Final[dict[object, int]] = {
    annotation: vt
    for python, vt in BY_PYTHON.items()
    for annotation in (python, python.__name__)
    if vt not in EMPTIES and python is not Decimal
}


def _check_name(decorator: str, name: object) -> None:
    if not isinstance(name, str) or not name:
        raise TypeError(tr('a name in the controller is needed: @{decorator}("NAME")', decorator=decorator))


def _check_type(name: str, vt: object) -> None:
    if vt is not None and (not isinstance(vt, int) or "?" in type_name(vt)):
        raise TypeError(tr("variable {name!r}: type must be a VarType, not {type!r}", name=name, type=vt))


class Declared:
    """Something that a decorator declares: its name in the controller, and how its method is run."""

    kind = ""

    def __init__(self, method: Callable[..., Any], name: str, help: str, quick: bool) -> None:  # noqa: A002
        self.method = method
        self.name = name
        self.help = help or inspect.getdoc(method) or ""
        self.quick = quick

    def run(self, method: Callable[..., Any], *args: Any) -> Any:
        """Call a method the way it is to be run: at once, awaited, or in a thread."""
        if self.quick or inspect.iscoroutinefunction(method):
            return method(*args)
        return BlockingCall(lambda: method(*args))


class DeclaredVariable(Declared, Generic[T]):
    """A variable: a getter and, if it is writable, a setter. In the device's own code it behaves like a property."""

    kind = "Variable"

    def __init__(self, method: Callable[..., Any], name: str, help: str, quick: bool, type: int | None) -> None:  # noqa: A002
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
        """Make the variable writable: the method gets the new value as plain Python.

        Type checkers want another name for the method than that of the getter: ``def set_width(self, width: float)``.
        """
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
                tr("{name}({wanted}) was given {count} values", name=self.name, wanted=wanted, count=len(values)),
            ) from None
        converted = [_converted(*pair) for pair in zip(parameters, values, strict=False)]
        return converted + values[len(converted) :]


def _converted(parameter: inspect.Parameter, value: Any) -> Any:
    """Return an argument of a command as its annotation says: bool, int, float or str; another one as it came.

    Raises:
        CallError: E_INVALIDARG where it cannot be that.
    """
    vt = _BY_ANNOTATION.get(parameter.annotation)
    if vt is None or vt == VarType.DATE or parameter.kind is inspect.Parameter.VAR_POSITIONAL:
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


class _VariableDecorator:
    def __init__(self, name: str, type: int | None, help: str, quick: bool) -> None:  # noqa: A002
        self._options = (name, help, quick, type)

    def __call__(self, method: Callable[[Any], T]) -> DeclaredVariable[T]:
        return DeclaredVariable(method, *self._options)


def variable(
    name: str,
    *,
    type: int | None = None,  # noqa: A002 - the documents' word
    help: str = "",  # noqa: A002
    quick: bool = False,
) -> _VariableDecorator:
    """Declare a variable; the method is its getter, ``@method.setter`` makes it writable.

    In the device's own code, ``self.width`` calls the getter, and ``self.width = 5.0`` the setter.

    Args:
        name: name in the controller; upper and lower case do not matter.
        type: VARIANT type, ``VarType.R4`` or ``VarType.R4 | VarType.ARRAY``; by default what the annotation of the
            getter's result says (bool, int, float, str), else whatever the getter returns.
        help: help text; by default the docstring.
        quick: the methods return at once.
    """
    _check_name("variable", name)
    return _VariableDecorator(name, type, help, quick)


def command(name: str, *, help: str = "", quick: bool = False) -> _Decorator[DeclaredCommand]:  # noqa: A002
    """Declare an Execute command; what the method returns is the result.

    The parameter is spread over the method's arguments, so ``Execute("Close", [10.0, 1])`` calls ``close(10.0, 1)``.
    """
    _check_name("command", name)
    return _Decorator(lambda method: DeclaredCommand(method, name, help, quick))


def _child(kind: str, decorator: str) -> Callable[..., _Decorator[DeclaredChild]]:
    def declare(name: str, *, help: str = "") -> _Decorator[DeclaredChild]:  # noqa: A002
        _check_name(decorator, name)
        return _Decorator(lambda method: DeclaredChild(method, name, help, kind))

    declare.__doc__ = (
        f"Declare an object below of the kind {kind}; the method returns a :class:`Part` or an object of cao.provider."
    )
    return declare


extension = _child("Extension", "extension")
robot = _child("Robot", "robot")
task = _child("Task", "task")
file = _child("File", "file")
command_object = _child("Command object", "command_object")


def declared_in(kind: type) -> dict[tuple[str, str], Declared]:
    """Return what one class declares by itself; two members of one kind and name would hide each other."""
    found: dict[tuple[str, str], Declared] = {}
    for member in vars(kind).values():
        if isinstance(member, Declared) and found.setdefault((member.kind, member.name.lower()), member) is not member:
            raise TypeError(
                tr(
                    "{device} declares the {kind} {name!r} twice; upper and lower case are the same",
                    device=kind.__name__,
                    kind=member.kind,
                    name=member.name,
                )
            )
    return found
