"""Elements of the function table: functions, arguments, and the annotations for their types."""

import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Final, Generic, NamedTuple, ParamSpec, TypeVar

from orinkit.core.i18n import choose, tr
from orinkit.core.record import record
from orinkit.values.variant import Value, VarType

P = ParamSpec("P")
R = TypeVar("R")

Handle = Annotated[int, VarType.I4, "handle"]
"""Handle of an object on one connection; VT_I4, positive."""
I4 = Annotated[int, VarType.I4]
R4 = Annotated[float, VarType.R4]
Bstr = Annotated[str, VarType.BSTR]
AnyValue = Annotated[Any, VarType.VARIANT]

INTERFACES: Final = ("Service", "Controller", "Extension", "File", "Robot", "Task", "Variable", "Command", "Message")


LONGEST_NAME: Final = 1024
"""Limit on the characters of a name, or of any other text argument."""
LONGEST_OPTION: Final = 4096
"""Limit on the characters of an option string."""


class Argument(NamedTuple):
    """One argument of a function.

    Attributes:
        name: Python name.
        vt: VARIANT type in the packet; ``VarType.VARIANT`` if any type may be sent.
        is_handle: True for a handle.
        optional: True if the client may omit it.
        default: value of an omitted argument. If it is ``None``, the client sends VT_EMPTY for an argument of type
            VARIANT, and does not send an argument of any other type.
    """

    name: str
    vt: VarType
    is_handle: bool = False
    optional: bool = False
    default: object = None

    @property
    def longest(self) -> int:
        """Limit on the characters of a text: 1,024 for a name, 4,096 for an option string."""
        return LONGEST_OPTION if self.name == "option" else LONGEST_NAME

    @property
    def omitted_by_default(self) -> bool:
        """True for an argument that is omitted from the packet if it is not given."""
        return self.optional and self.default is None and self.vt is not VarType.VARIANT


@record(eq=False)
class Function(Generic[P, R]):
    """An entry of the table; ``P`` are the types of the arguments, ``R`` is the type of the result.

    Attributes:
        id: function id, counted from 1.
        name: name in the documents, ``Robot_Move``.
        cao: CAO interface name (RC8 appendix A), ``""`` if the appendix has none for the function.
        section: section of the documents.
        arguments: the arguments, in order.
        result: VARIANT type of the result, ``VarType.VARIANT`` for any, ``None`` for no result.
        creates: interface of the object whose handle is returned, otherwise ``""``.
        released_by: name of the function that releases the returned handle, otherwise ``""``.
        releases: True if the function releases the object that it is called on.
        en, ja: description in one line.
        interface: ``Robot`` for ``Robot_Move``.
        method: name of the provider's method that implements the function: ``move`` for ``Robot_Move``.
        required: number of required arguments.
    """

    id: int
    name: str
    cao: str
    section: str
    arguments: tuple[Argument, ...]
    result: VarType | None
    creates: str
    released_by: str
    releases: bool
    en: str
    ja: str
    interface: str
    method: str
    required: int

    @property
    def text(self) -> str:
        """The description in the current language."""
        return choose(self.en, self.ja)

    def bind(self, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return the arguments to send, in order, with defaults filled in.

        Raises:
            TypeError: If there are too many or too few arguments, or an unknown one.
        """
        if not named and len(arguments) == len(self.arguments):
            left_out = bool(arguments) and arguments[-1] is None and self.arguments[-1].omitted_by_default
            return arguments[:-1] if left_out else arguments
        if len(arguments) > len(self.arguments):
            raise TypeError(
                tr(
                    "{name} takes {count} arguments, got {given}",
                    name=self.name,
                    count=len(self.arguments),
                    given=len(arguments),
                )
            )
        bound = list(arguments)
        left = dict(named)
        for argument in self.arguments[len(arguments) :]:
            if argument.name not in left and not argument.optional:
                raise TypeError(tr("{name} requires the argument {argument!r}", name=self.name, argument=argument.name))
            value = left.pop(argument.name, argument.default)
            if value is None and argument.omitted_by_default:
                break
            bound.append(value)
        if left:
            raise TypeError(
                tr(
                    "{name} got an unknown or repeated argument {argument!r}",
                    name=self.name,
                    argument=next(iter(left)),
                )
            )
        return tuple(bound)

    def where(self, number: int) -> str:
        """Return the beginning of an error message about an argument: function, number and name, then ``": "``.

        Args:
            number: number of the argument; the first one is 1.
        """
        name = self.arguments[number - 1].name
        return tr("{name}, argument {number} ({argument}): ", name=self.name, number=number, argument=name)


def snake_case(name: str) -> str:
    """Return the Python name for a name of the documents: ``GetDateCreated`` -> ``get_date_created``, ``GetID`` -> ``get_id``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


ENTRIES: Final[dict[int, Function[..., Any]]] = {}
"""The entries that have been added so far, by id. Use :data:`orinkit.cao.functions.FUNCTIONS` to read the table."""


def function(
    id: int,  # noqa: A002 - the name in the documents
    name: str,
    cao: str,
    section: str,
    *,
    en: str,
    ja: str,
    creates: str = "",
    released_by: str = "",
    releases: bool = False,
) -> Callable[[Callable[P, R]], Function[P, R]]:
    """Return a decorator that adds a signature to the table."""

    def enter(signature: Callable[P, R]) -> Function[P, R]:
        arguments, result = _read_signature(signature)
        interface, _, method = name.partition("_")
        required = sum(not argument.optional for argument in arguments)
        entry: Function[P, R] = Function(
            id, name, cao, section, arguments, result, creates, released_by, releases, en, ja,
            interface, snake_case(method), required,
        )  # fmt: skip
        ENTRIES[id] = entry
        return entry

    return enter


def _read_signature(signature: Callable[..., Any]) -> tuple[tuple[Argument, ...], VarType | None]:
    hints = dict(signature.__annotations__)
    result = hints.pop("return")
    defaults: tuple[Any, ...] = getattr(signature, "__defaults__", None) or ()
    first = len(hints) - len(defaults)
    arguments = tuple(
        Argument(
            name, _type_of(hint), hint is Handle, index >= first, defaults[index - first] if index >= first else None
        )
        for index, (name, hint) in enumerate(hints.items())
    )
    return arguments, None if result is None else _type_of(result)


def _type_of(hint: Any) -> VarType:
    if hint is Value:
        return VarType.VARIANT
    for part in (hint, *getattr(hint, "__args__", ())):  # the parts of "Bstr | None" are in __args__
        for mark in getattr(part, "__metadata__", ()):
            if isinstance(mark, VarType):
                return mark
    raise TypeError(f"{hint!r} is not an argument type of the table")
