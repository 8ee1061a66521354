"""The names of a program: types, variables, constants, Subs and Functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript import functions, values
from orinkit.virtual.rc8.pacscript.code import FIRST_SLOT, MAX_ELEMENTS, Frame, RoutineCode, Spot
from orinkit.virtual.rc8.pacscript.errors import CompileError, not_supported
from orinkit.virtual.rc8.pacscript.keywords import (
    CONSTANTS,
    GLOBAL_KINDS,
    KEYWORDS,
    NUMBERED,
    POINT_KINDS,
    REFUSED,
    STARTERS,
    TYPES,
)
from orinkit.virtual.rc8.pacscript.tree import Name
from orinkit.virtual.rc8.pacscript.values import AnyValue

MAX_DIMENSIONS: Final = 3
"""Maximum number of dimensions of an array."""
MAX_ROUTINES: Final = 1_000
"""Maximum number of Subs and Functions of a program."""


@dataclass(frozen=True, slots=True)
class TypeOf:
    """A type of variables.

    Attributes:
        name: Name in lower case; Long is another name of Integer.
        default: Initial value of a variable.
        convert: Converts a value to this type, or raises CallError.
    """

    name: str
    default: AnyValue
    convert: Callable[[AnyValue], AnyValue]


TYPES_BY_NAME: Final[Mapping[str, TypeOf]] = {
    kind.name: kind
    for kind in (
        TypeOf("integer", 0, values.rounded_to_integer),
        TypeOf("single", 0.0, values.single),
        TypeOf("double", 0.0, values.double),
        TypeOf("string", "", values.string),
        TypeOf("boolean", 0, values.boolean),
        TypeOf("variant", 0, values.any_value),
        TypeOf("vector", (0.0,) * values.V_LENGTH, values.pose("V")),
        TypeOf("position", (*(0.0,) * (values.P_LENGTH - 1), -1.0), values.pose("P")),
        TypeOf("joint", (0.0,) * values.J_LENGTH, values.pose("J")),
        TypeOf("trans", (*(0.0,) * (values.T_LENGTH - 1), -1.0), values.pose("T")),
    )
}
"""The types, by name."""
VARIANT: Final = TYPES_BY_NAME["variant"]
"""The type that accepts any value."""
BY_CLASS: Final[Mapping[str, TypeOf]] = {
    "I": TYPES_BY_NAME["integer"], "F": TYPES_BY_NAME["single"], "D": TYPES_BY_NAME["double"], "S": TYPES_BY_NAME["string"],
    "V": TYPES_BY_NAME["vector"], "P": TYPES_BY_NAME["position"], "J": TYPES_BY_NAME["joint"], "T": TYPES_BY_NAME["trans"],
}  # fmt: skip
"""The types of the global variables, by the name of their class."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A local variable.

    Attributes:
        name: Name as declared.
        type: Type of the variable, or of the elements of an array.
        slot: Index in the frame.
        sizes: Number of elements of an array in each dimension; ``()`` for a scalar.
        by_ref: True for a parameter passed by reference: its slot contains a container, for example an array, and
            the index of the value in this container.
    """

    name: str
    type: TypeOf
    slot: int
    sizes: tuple[int, ...] = ()
    by_ref: bool = False


@dataclass(frozen=True, slots=True)
class PublicVariable:
    """A variable of the whole program (Public), which other programs and clients can access, too.

    Attributes:
        name: Name as declared.
        type: Type of the variable, or of the elements of an array.
        place: Index in the list of the values of all Public variables of the program.
        value: Initial value.
        sizes: Number of elements of an array in each dimension; ``()`` for a scalar.
    """

    name: str
    type: TypeOf
    place: int
    value: AnyValue
    sizes: tuple[int, ...] = ()

    def initial(self) -> AnyValue:
        """Return the initial value; a new list for an array."""
        return [self.value] * math.prod(self.sizes) if self.sizes else self.value


@dataclass(slots=True, eq=False)
class Routine:
    """A Sub or Function."""

    name: Name
    word: str
    parameters: list[Variable] = field(default_factory=list)
    explicit_refs: set[str] = field(default_factory=set)
    result: Variable | None = None
    variables: dict[str, Variable] = field(default_factory=dict)
    constants: dict[str, AnyValue] = field(default_factory=dict)
    entry: Spot = field(default_factory=Spot)
    template: Frame = field(default_factory=lambda: [None] * FIRST_SLOT)
    elements: int = 0
    publics: dict[str, tuple[PublicVariable, Variable]] = field(default_factory=dict)

    def public(self, key: str, variable: PublicVariable) -> Variable:
        """Return a Public variable as a variable of this routine: an array, or a reference to the value."""
        if key not in self.publics:
            own = Variable(variable.name, variable.type, self.new_slot(), variable.sizes, by_ref=not variable.sizes)
            self.publics[key] = variable, own
        return self.publics[key][1]

    def new_slot(self, default: AnyValue = None) -> int:
        """Reserve a slot in the frame and return its index."""
        self.template.append(default)
        return len(self.template) - 1

    def linked(self, spots: Mapping[int, int]) -> RoutineCode:
        """Return the linked Sub or Function; ``spots`` are the indices of the instructions at the spots."""
        return RoutineCode(spots[self.entry.number], self.elements, self._framer())

    def _framer(self) -> Callable[[Any, Any], Frame]:
        template = self.template
        arrays = [(one.slot, one.type.default, math.prod(one.sizes)) for one in self.variables.values() if one.sizes]
        publics = [(own.slot, one.place, bool(one.sizes)) for one, own in self.publics.values()]

        def frame(world: Any, machine: Any) -> Frame:
            new = template.copy()
            new[0] = world
            new[1] = machine
            for slot, default, count in arrays:
                new[slot] = [default] * count
            for slot, place, is_array in publics:
                new[slot] = machine.publics[place] if is_array else (machine.publics, place)
            return new

        return frame


class Scope:
    """The names that are visible at a position in a program."""

    def __init__(self) -> None:
        self.routines: dict[str, Routine] = {}
        self.shared: dict[str, AnyValue] = {}
        self.publics: dict[str, PublicVariable] = {}
        self.routine: Routine | None = None

    @property
    def current_routine(self) -> Routine:
        """The Sub or Function that is being compiled."""
        assert self.routine is not None
        return self.routine

    def add_routine(self, routine: Routine) -> None:
        """Add a Sub or Function.

        Raises:
            CompileError: If the name is already declared or not allowed, or if there are too many.
        """
        self.check_name(routine.name)
        self._reject_duplicate(routine.name, routine.name.key in self.routines)
        if len(self.routines) >= MAX_ROUTINES:
            raise CompileError(
                tr("the program has more than {most} Subs and Functions", most=MAX_ROUTINES), routine.name.at
            )
        self.routines[routine.name.key] = routine

    def add_variable(
        self, routine: Routine, name: Name, kind: TypeOf, sizes: tuple[int, ...] = (), *, by_ref: bool = False
    ) -> Variable:
        """Add a variable to a Sub or Function.

        Raises:
            CompileError: If the name is already declared or not allowed, or if the arrays of the Sub or Function have
                too many elements.
        """
        self.check_name(name)
        key = name.key
        taken = key in routine.variables or key in routine.constants
        own = routine.result is None and key == routine.name.key  # a Function's result is a variable with its name
        shared = key in self.shared or key in self.publics
        self._reject_duplicate(name, taken or (key in self.routines and not own) or shared)
        routine.elements += math.prod(sizes) if sizes else 0
        if routine.elements > MAX_ELEMENTS:
            raise CompileError(
                tr(
                    "{name}: the arrays of a Sub may have at most {most} elements in total",
                    name=name.text,
                    most=MAX_ELEMENTS,
                ),
                name.at,
            )
        variable = Variable(name.text, kind, routine.new_slot(kind.default), sizes, by_ref)
        routine.variables[key] = variable
        return variable

    def add_public(self, name: Name, kind: TypeOf, value: AnyValue, sizes: tuple[int, ...] = ()) -> None:
        """Add a variable of the whole program.

        Raises:
            CompileError: If the name is already declared or not allowed, or if the arrays have too many elements.
        """
        self.check_name(name)
        key = name.key
        self._reject_duplicate(name, key in self.publics or key in self.routines or key in self.shared)
        total = sum(math.prod(one.sizes) for one in self.publics.values() if one.sizes)
        if sizes and total + math.prod(sizes) > MAX_ELEMENTS:
            raise CompileError(
                tr(
                    "{name}: the Public arrays of a program may have at most {most} elements in total",
                    name=name.text,
                    most=MAX_ELEMENTS,
                ),
                name.at,
            )
        self.publics[key] = PublicVariable(name.text, kind, len(self.publics), value, sizes)

    def add_constant(self, name: Name, value: AnyValue) -> None:
        """Add a constant to the Sub or Function that is being compiled, or a global constant outside of them.

        Raises:
            CompileError: If the name is already declared or not allowed.
        """
        self.check_name(name)
        routine = self.routine
        taken = routine is not None and (name.key in routine.variables or name.key in routine.constants)
        shared = name.key in self.shared or name.key in self.publics
        self._reject_duplicate(name, taken or name.key in self.routines or shared)
        (self.shared if routine is None else routine.constants)[name.key] = value

    def variable(self, key: str) -> Variable | None:
        """Return a local or Public variable, or None if no variable has this name."""
        if self.routine is None:
            return None
        own = self.routine.variables.get(key)
        if own is None and key in self.publics and key not in self.routine.constants:
            return self.routine.public(key, self.publics[key])
        return own

    def constant(self, key: str) -> AnyValue:
        """Return a constant, or None if no constant has this name."""
        if self.routine and key in self.routine.constants:
            return self.routine.constants[key]
        return self.shared.get(key, CONSTANTS.get(key))

    def check_name(self, name: Name) -> None:
        """Check that a name may be declared.

        Raises:
            CompileError: If the name is a word of PacScript or the name of a global variable.
        """
        key = name.key
        if NUMBERED.fullmatch(key):
            raise CompileError(
                tr("{name} cannot be declared: it is the name of a global variable", name=name.text),
                name.at,
            )
        if key in _RESERVED:
            raise CompileError(
                tr("{name} cannot be declared: it is a reserved word of PacScript", name=name.text),
                name.at,
            )

    @staticmethod
    def _reject_duplicate(name: Name, taken: bool) -> None:
        if taken:
            raise CompileError(tr("{name} is declared twice", name=name.text), name.at)


_RESERVED: Final = (
    frozenset(KEYWORDS)
    | frozenset(STARTERS)
    | frozenset(CONSTANTS)
    | frozenset(functions.FUNCTIONS)
    | frozenset(REFUSED)
    | frozenset(TYPES)
    | frozenset(kind.lower() for kind in POINT_KINDS)
)


def find_type(name: Name | None) -> TypeOf:
    """Return the type with the name that follows As; Variant if the declaration has no As.

    Raises:
        CompileError: If the type does not exist.
    """
    if name is None:
        return VARIANT
    kind = TYPES_BY_NAME.get("integer" if name.key == "long" else name.key)
    if kind is None:
        raise CompileError(tr("unknown type {name}", name=name.text), name.at)
    return kind


def split_number(key: str) -> tuple[str, int] | None:
    """Return class and index of a name such as ``P12`` or ``IO128``; None for any other word."""
    found = NUMBERED.fullmatch(key)
    return (found[1].upper(), int(found[2])) if found else None


def global_class(name: Name) -> str:
    """Return the class of a global variable or I/O point from its name in ``P[...]`` or ``IO[...]``.

    Raises:
        CompileError: If no class has this name.
    """
    kind = name.text.upper()
    if kind in GLOBAL_KINDS or kind in POINT_KINDS:
        return kind
    if name.key in REFUSED:
        raise not_supported(REFUSED[name.key], name.at)
    raise CompileError(
        tr("{name}[ ] is not a global variable. Try: {name}( ) for an element of an array", name=name.text),
        name.at,
    )


def unknown_routine(name: Name) -> CompileError:
    """Return the error for a statement that is neither a command nor a call of a declared Sub or Function."""
    if name.key in REFUSED:
        return not_supported(REFUSED[name.key], name.at)
    return CompileError(
        tr("unknown command, Sub or Function {name}", name=name.text),
        name.at,
    )


def unknown(name: Name, *, applied: bool) -> CompileError:
    """Return the error for an undeclared name; ``applied`` is True for a name followed by parentheses."""
    if name.key in REFUSED:
        return not_supported(REFUSED[name.key], name.at)
    if applied:
        return CompileError(
            tr("unknown array or Function {name}", name=name.text),
            name.at,
        )
    return CompileError(tr("{name} is not declared", name=name.text), name.at)


def check_count(name: Name, given: int, least: int, most: int) -> None:
    """Check the number of arguments or indices.

    Raises:
        CompileError: If the number is not allowed.
    """
    if least <= given <= most:
        return
    wanted = f"{least}" if least == most else tr("{least} to {most}", least=least, most=most)
    raise CompileError(
        tr(
            "wrong number of arguments for {name}: {given}, expected {wanted}",
            name=name.text,
            wanted=wanted,
            given=given,
        ),
        name.at,
    )
