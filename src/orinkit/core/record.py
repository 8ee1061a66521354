"""``@record``: immutable classes with fields, for the rows of tables, options and values.

A record has what ``@dataclass(frozen=True, slots=True)`` gives a class: a constructor, ``==``, ``hash()``, ``repr()``, no
further attributes. The standard decorator generates and compiles six functions for each class, and imports
:mod:`inspect`; together these take a fifth of the start of a virtual RC8. ``record`` compiles only the constructor.

A field without a default must precede those with one, as in a function. A default must be immutable.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar, dataclass_transform, overload

R = TypeVar("R")

EMPTY: Final[Mapping[Any, Any]] = MappingProxyType({})
"""The default of a field that is a mapping."""
_REQUIRED: Final = object()
_UNCOPIED: Final = frozenset({"__dict__", "__weakref__", "__annotations_cache__"})


class _Field(NamedTuple):
    """A field: its default or ``_REQUIRED``, and whether the constructor accepts it only by its name."""

    default: Any
    named: bool


@overload
def record(kind: type[R], /) -> type[R]: ...


@overload
def record(*, eq: bool = True, kw_only: bool = False) -> Callable[[type[R]], type[R]]: ...


@dataclass_transform(frozen_default=True)
def record(kind: type[R] | None = None, /, *, eq: bool = True, kw_only: bool = False) -> Any:
    """Make a class a record. Its fields are its annotated names, after those of a record that it derives from.

    If the class has a method ``__post_init__``, the constructor calls it last; it may replace a value with
    ``object.__setattr__``. A constructor that the class defines itself must set each field in this way.

    Args:
        kind: The class.
        eq: False if two records are equal only if they are the same object.
        kw_only: True if the constructor accepts the fields of this class only by name.
    """

    def decorate(given: type[R]) -> type[R]:
        return _built(given, eq, kw_only)

    return decorate if kind is None else decorate(kind)


def field_names(kind: type) -> tuple[str, ...]:
    """Return the names of the fields of a record class, in order."""
    names: tuple[str, ...] = tuple(getattr(kind, "__record_fields__"))  # noqa: B009 - no type has this attribute
    return names


def replaced(given: R, **changes: Any) -> R:
    """Return a copy of a record with other values of some fields. The constructor checks the copy, too.

    Args:
        given: The record.
        changes: The new values, by the name of the field.
    """
    values = {name: getattr(given, name) for name in field_names(type(given))}
    return type(given)(**values | changes)


def _built(kind: type[R], eq: bool, kw_only: bool) -> type[R]:
    own = {
        name: _Field(kind.__dict__.get(name, _REQUIRED), kw_only)
        for name, text in kind.__annotations__.items()
        if not str(text).startswith("ClassVar")
    }
    fields: dict[str, _Field] = {**getattr(kind, "__record_fields__", {}), **own}
    body: dict[str, Any] = {name: value for name, value in kind.__dict__.items() if name not in own}
    for name in _UNCOPIED & body.keys():
        del body[name]
    methods = {"__repr__": _repr, "__setattr__": _refuse, "__delattr__": _refuse}
    methods |= {"__getstate__": _state, "__setstate__": _restore}  # for pickle and copy
    if eq:
        methods |= {"__eq__": _equal, "__hash__": _hash}
    body = {**methods, **body, "__slots__": tuple(own), "__record_fields__": fields}
    if eq and "__eq__" in kind.__dict__ and kind.__dict__.get("__hash__") is None:
        body["__hash__"] = _hash  # Python sets __hash__ to None in a class that defines only __eq__
    body["__match_args__"] = tuple(name for name, field in fields.items() if not field.named)
    body["__record_values__"] = staticmethod(_getter(tuple(fields)))
    make: Any = type(kind)
    made: Any = make(kind.__name__, kind.__bases__, body)
    if "__init__" not in body:
        made.__init__ = _constructor(made, fields)
    made.__replace__ = replaced  # copy.replace() of Python 3.13
    made.__dataclass_fields__ = _DataclassFields()
    return made  # type: ignore[no-any-return]  # dataclass_transform describes the class to type checkers


class _DataclassFields:
    """The attribute by which ``dataclasses.fields()``, ``replace()`` and ``asdict()`` accept a record."""

    def __get__(self, _record: object, kind: type) -> dict[str, Any]:
        from dataclasses import MISSING, field, make_dataclass  # only if a program uses these functions

        fields: dict[str, _Field] = getattr(kind, "__record_fields__")  # noqa: B009 - no type has this attribute
        columns = []
        for name, each in fields.items():
            plain = each.default is not _REQUIRED and each.default is not EMPTY  # the latter counts as mutable there
            columns.append((name, Any, field(default=each.default if plain else MISSING, kw_only=True)))
        like: Any = make_dataclass(kind.__name__, columns)
        found: dict[str, Any] = like.__dataclass_fields__
        return found


def _getter(names: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    if len(names) > 1:
        return attrgetter(*names)
    return lambda given: tuple(getattr(given, name) for name in names)


def _constructor(kind: Any, fields: dict[str, _Field]) -> Callable[..., None]:
    """Return ``__init__``, which sets each field through its slot, because ``__setattr__`` refuses to."""
    place = kind.__qualname__
    scope: dict[str, Any] = {"__name__": kind.__module__}
    parameters, lines = ["self"], []
    for name, field in sorted(fields.items(), key=lambda item: item[1].named):
        if field.named and "*" not in parameters:
            parameters.append("*")
        if field.default is _REQUIRED:
            parameters.append(name)
        elif isinstance(field.default, list | dict | set):
            raise TypeError(f"{place}.{name}: the default of a field of a record must be immutable")
        else:
            parameters.append(f"{name}=_default_{name}")
            scope[f"_default_{name}"] = field.default
        scope[f"_set_{name}"] = getattr(kind, name).__set__
        lines.append(f" _set_{name}(self, {name})")
    if hasattr(kind, "__post_init__"):
        lines.append(" self.__post_init__()")
    exec(f"def __init__({', '.join(parameters)}):\n" + ("\n".join(lines) or " pass"), scope)  # noqa: S102 - names of fields
    made: Callable[..., None] = scope["__init__"]
    made.__qualname__ = f"{place}.__init__"
    annotations = {
        name: text for each in reversed(kind.__mro__) for name, text in getattr(each, "__annotations__", {}).items()
    }
    made.__annotations__ = {name: annotations[name] for name in fields} | {"return": "None"}
    return made


def _repr(self: Any) -> str:
    shown = ", ".join(f"{name}={getattr(self, name)!r}" for name in field_names(type(self)))
    return f"{type(self).__qualname__}({shown})"


def _equal(self: Any, other: Any) -> Any:
    if other.__class__ is not self.__class__:
        return NotImplemented
    return self.__record_values__(self) == self.__record_values__(other)


def _hash(self: Any) -> int:
    return hash(self.__record_values__(self))


def _refuse(self: Any, name: str, _value: Any = None) -> None:
    raise AttributeError(f"{type(self).__name__} is immutable: {name!r} cannot be changed")


def _state(self: Any) -> tuple[Any, ...]:
    values: tuple[Any, ...] = self.__record_values__(self)
    return values


def _restore(self: Any, state: tuple[Any, ...]) -> None:
    for name, value in zip(field_names(type(self)), state, strict=True):
        object.__setattr__(self, name, value)
