"""Compiled code: a flat list of instructions, and its linker.

An instruction is a function that takes a frame and returns the index of the next instruction, WAIT or DONE. A frame is
a list. It contains the "world" (the functions of the controller, a
:class:`~orinkit.virtual.rc8.pacscript.host_interface.HostInterface`), the machine that runs the program, the return
addresses of Gosub, and the variables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

Frame: TypeAlias = list[Any]
"""A frame: world, machine, return addresses of Gosub, variables."""
Op: TypeAlias = Callable[[Frame], int]
"""An instruction: takes a frame and returns the index of the next instruction, WAIT or DONE."""
Evaluate: TypeAlias = Callable[[Frame], Any]
"""Returns the value of an expression, with the values of the variables in a frame."""
Make: TypeAlias = Callable[[int], Op]
"""Creates an instruction at link time, when the indices of all instructions are known.

The argument is the index of the instruction that follows in the code."""

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


@dataclass(slots=True, eq=False)
class Spot:
    """A jump target in the code.

    ``pc`` is the index of the instruction there. The linker sets it before the instructions are created.
    """

    pc: int = -1


@dataclass(slots=True)
class _Item:
    make: Make | None
    to: Spot | None
    line: int
    starts_statement: bool


@dataclass(frozen=True, slots=True)
class Linked:
    """Linked code: the instructions, their lines, and flags that mark the first instruction of each statement."""

    ops: tuple[Op, ...]
    lines: tuple[int, ...]
    starts_statement: tuple[bool, ...]


@dataclass(slots=True)
class Code:
    """Collects instructions and links them."""

    _items: list[_Item] = field(default_factory=list)
    _spots: list[tuple[Spot, int]] = field(default_factory=list)
    _line: int = 1
    _starts_statement: bool = False

    def statement(self, line: int) -> None:
        """Mark the next instruction as the start of a statement."""
        self._line = line
        self._starts_statement = True

    def emit(self, make: Make) -> None:
        """Add an instruction."""
        self._items.append(_Item(make, None, self._line, self._starts_statement))
        self._starts_statement = False

    def jump(self, to: Spot) -> None:
        """Add a jump to a spot.

        The jump needs no instruction, because the linker connects the previous instruction to the spot.
        """
        self._items.append(_Item(None, to, self._line, False))

    def put(self, spot: Spot) -> None:
        """Set a spot to the position of the next instruction."""
        self._spots.append((spot, len(self._items)))

    def link(self) -> Linked:
        """Resolve the spots and create the instructions."""
        items = self._items
        numbers: list[int] = []
        count = 0
        for item in items:
            numbers.append(count)
            count += item.make is not None
        positions = {id(spot): index for spot, index in self._spots}

        def resolve(index: int) -> int:
            while index < len(items) and (to := items[index].to) is not None:
                index = positions[id(to)]
            return numbers[index] if index < len(items) else count

        for spot, index in self._spots:
            spot.pc = resolve(index)
        real = [(index, item, item.make) for index, item in enumerate(items) if item.make is not None]
        return Linked(
            tuple(make(resolve(index + 1)) for index, _, make in real),
            tuple(item.line for _, item, _ in real),
            tuple(item.starts_statement for _, item, _ in real),
        )
