"""Compiled code: a flat list of instructions, as data, and its linker.

An instruction is a function that takes a frame and returns the index of the next instruction, WAIT or DONE. A frame is
a list. It contains the "world" (the functions of the controller, a
:class:`~orinkit.virtual.rc8.pacscript.host_interface.HostInterface`), the machine that runs the program, the return
addresses of Gosub, and the variables.

As functions, the instructions of a large program would be hundreds of thousands of Python objects, and every full
garbage collection, during which nothing else runs, would visit all of them. Therefore an instruction is stored as a
*recipe*, in a few bytes. The function is created when the instruction is executed. A recipe is a tuple: the name of a
function in :data:`MAKERS`, and its arguments, which may contain recipes. No argument is a tuple that begins with a
string but is not a recipe.
"""

from __future__ import annotations

import itertools
import marshal
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.errors import CompileError

Frame: TypeAlias = list[Any]
"""A frame: world, machine, return addresses of Gosub, variables."""
Op: TypeAlias = Callable[[Frame], int]
"""An instruction: takes a frame and returns the index of the next instruction, WAIT or DONE."""
Evaluate: TypeAlias = Callable[[Frame], Any]
"""Returns the value of an expression, with the values of the variables in a frame."""
Recipe: TypeAlias = tuple[Any, ...]
"""Describes a function that :func:`build` creates: an instruction, or a part of one, such as an expression."""

WAIT: Final = -1
"""Returned by an instruction that begins to wait (:meth:`Machine.wait_for`)."""
DONE: Final = -2
"""Returned by an instruction that ends the program."""

WORLD: Final = 0
"""Index in a frame of the "world", the interface to the controller."""
MACHINE: Final = 1
"""Index in a frame of the machine that runs the program."""
RETURNS: Final = 2
"""Index in a frame of the stack of return addresses of Gosub; the stack is ``None`` before the first Gosub."""
FIRST_SLOT: Final = 3
"""Index of the first variable in a frame."""

MAX_STATEMENTS: Final = 20_000
"""Maximum number of statements of a program."""
MAX_ELEMENTS: Final = 100_000
"""Maximum number of elements of the arrays of all running Subs and Functions together."""
MOST_BUILT: Final = 256 * 1024
"""Maximum size in bytes of the recipes whose functions exist at the same time, in all programs of a controller."""

_SPOT: Final = "spot"
_ROUTINE: Final = "routine"

MAKERS: Final[dict[str, Callable[..., Any]]] = {}
"""The functions that create instructions and their parts, by name.

A function that creates an instruction takes the index of the following instruction before the other arguments."""


def maker(function: Callable[..., Any]) -> Callable[..., Recipe]:
    """Add a function to :data:`MAKERS`; return a function that takes the arguments and returns a recipe.

    The arguments for an instruction do not include the index of the following instruction.
    """
    name = function.__name__
    assert name not in MAKERS
    MAKERS[name] = function
    return lambda *arguments: (name, *arguments)


@dataclass(slots=True, eq=False)
class Spot:
    """A jump target in the code; in a function that is created from a recipe, it is the index of an instruction."""

    number: int = field(default_factory=itertools.count().__next__)

    @property
    def recipe(self) -> Recipe:
        """The spot as an argument of a recipe."""
        return _SPOT, self.number


def routine_recipe(key: str) -> Recipe:
    """Return a Sub or Function as an argument of a recipe; its :class:`RoutineCode` is passed to the maker."""
    return _ROUTINE, key


class RoutineCode(NamedTuple):
    """A linked Sub or Function.

    Attributes:
        entry: Index of its first instruction.
        elements: Total number of elements of its arrays.
        new_frame: Creates a frame; the arguments are the interface to the controller and the machine that runs the
            program.
    """

    entry: int
    elements: int
    new_frame: Callable[[Any, Any], Frame]


class UnlinkedRoutine(Protocol):
    """A Sub or Function before it is linked."""

    def linked(self, spots: Mapping[int, int]) -> RoutineCode:
        """Return the linked Sub or Function; ``spots`` are the indices of the instructions at the spots."""


@dataclass(frozen=True, slots=True)
class Linked:
    """Linked code: for each instruction its recipe, the index of the following one, its line, and a flag.

    Attributes:
        recipes: The recipes, encoded.
        following: The indices of the following instructions.
        lines: The lines.
        starts_statement: True for the first instruction of a statement.
        spots: The indices of the instructions at the spots, by the number of the spot.
        routines: The Subs and Functions, by name in lower case.
    """

    recipes: tuple[bytes, ...]
    following: tuple[int, ...]
    lines: tuple[int, ...]
    starts_statement: tuple[bool, ...]
    spots: Mapping[int, int]
    routines: Mapping[str, RoutineCode]

    def op(self, pc: int) -> Op:
        """Create the function of the instruction with the index ``pc``."""
        name, *arguments = marshal.loads(self.recipes[pc])  # noqa: S302 - encoded by Code.emit
        made: Op = MAKERS[name](self.following[pc], *[build(each, self) for each in arguments])
        return made


def build(argument: Any, linked: Linked | None = None) -> Any:
    """Return an argument of a maker: a recipe is replaced by the object that it describes, also in tuples.

    Args:
        argument: The argument.
        linked: The code, for spots and routines.
    """
    if type(argument) is not tuple or not argument:
        return argument
    first = argument[0]
    if type(first) is not str:
        return tuple([build(each, linked) for each in argument])
    if linked is not None and first == _SPOT:
        return linked.spots[argument[1]]
    if linked is not None and first == _ROUTINE:
        return linked.routines[argument[1]]
    return MAKERS[first](*[build(each, linked) for each in argument[1:]])


class BuiltCode:
    """The instructions of all programs of a controller that exist as functions; the oldest ones are discarded."""

    def __init__(self) -> None:
        self._built: deque[tuple[list[Op | None], int, int]] = deque()
        self._size = 0

    def op(self, ops: list[Op | None], linked: Linked, pc: int) -> Op:
        """Create the function of an instruction and put it into ``ops``, the functions of a program."""
        made = ops[pc] = linked.op(pc)
        size = len(linked.recipes[pc])
        self._built.append((ops, pc, size))
        self._size += size
        while self._size > MOST_BUILT:
            old, index, size = self._built.popleft()
            old[index] = None
            self._size -= size
        return made


class Code:
    """Collects instructions and links them."""

    def __init__(self) -> None:
        self._recipes: list[bytes] = []  # empty for a jump
        self._targets: dict[int, int] = {}  # spots by the indices of the jumps
        self._lines: list[int] = []
        self._starts: list[bool] = []
        self._spots: dict[int, int] = {}  # positions of the spots by number
        self._line = 1
        self._starts_statement = False
        self._statements = 0

    def statement(self, line: int) -> None:
        """Mark the next instruction as the start of a statement.

        Raises:
            CompileError: If the program has too many statements.
        """
        self._line = line
        self._starts_statement = True
        self._statements += 1
        if self._statements > MAX_STATEMENTS:
            raise CompileError(tr("the program has more than {most} statements", most=MAX_STATEMENTS), (line, 1))

    def emit(self, recipe: Recipe) -> None:
        """Add an instruction."""
        self._add(marshal.dumps(recipe), self._starts_statement)
        self._starts_statement = False

    def jump(self, to: Spot) -> None:
        """Add a jump to a spot.

        The jump needs no instruction, because the linker connects the previous instruction to the spot.
        """
        self._targets[len(self._recipes)] = to.number
        self._add(b"", False)

    def put(self, spot: Spot) -> None:
        """Set a spot to the position of the next instruction."""
        self._spots[spot.number] = len(self._recipes)

    def link(self, routines: Mapping[str, UnlinkedRoutine]) -> Linked:
        """Resolve the spots.

        Args:
            routines: The Subs and Functions, by name in lower case.
        """
        numbers: list[int] = []
        count = 0
        for recipe in self._recipes:
            numbers.append(count)
            count += bool(recipe)

        def resolve(index: int) -> int:
            while (to := self._targets.get(index)) is not None:
                index = self._spots[to]
            return numbers[index] if index < len(numbers) else count

        spots = {number: resolve(index) for number, index in self._spots.items()}
        real = [index for index, recipe in enumerate(self._recipes) if recipe]
        return Linked(
            tuple(self._recipes[index] for index in real),
            tuple(resolve(index + 1) for index in real),
            tuple(self._lines[index] for index in real),
            tuple(self._starts[index] for index in real),
            spots,
            {key: routine.linked(spots) for key, routine in routines.items()},
        )

    def _add(self, recipe: bytes, starts_statement: bool) -> None:
        self._recipes.append(recipe)
        self._lines.append(self._line)
        self._starts.append(starts_statement)
