"""The flat list of instructions that a program becomes, and how it is put together.

An instruction is a function of the frame; it returns the index of the instruction to go on with, or WAIT or DONE. A
frame is a list: the world, the machine, the places that Gosub came from, then the variables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

Frame: TypeAlias = list[Any]
"""World, machine, places of Gosub, variables."""
Op: TypeAlias = Callable[[Frame], int]
"""An instruction."""
Evaluate: TypeAlias = Callable[[Frame], Any]
"""Gives the value of an expression."""
Make: TypeAlias = Callable[[int], Op]
"""Makes an instruction when all places are known, of the index of the one that follows it."""

WAIT: Final = -1
"""The machine has been told what to wait for."""
DONE: Final = -2
"""The program is over."""

WORLD: Final = 0
"""Where the world is in a frame."""
MACHINE: Final = 1
"""Where the machine is."""
RETURNS: Final = 2
"""Where the list of instructions is that Return goes to; ``None`` before the first Gosub."""
FIRST_SLOT: Final = 3
"""Where the variables begin."""


@dataclass(slots=True, eq=False)
class Spot:
    """A place in the code that something jumps to; ``pc`` is known when instructions are made."""

    pc: int = -1


@dataclass(slots=True)
class _Item:
    make: Make | None
    to: Spot | None
    line: int
    starts: bool


@dataclass(frozen=True, slots=True)
class Linked:
    """Finished code: the instructions, the line of each, and whether a statement starts with it."""

    ops: tuple[Op, ...]
    lines: tuple[int, ...]
    starts: tuple[bool, ...]


@dataclass(slots=True)
class Code:
    """Instructions in the making."""

    _items: list[_Item] = field(default_factory=list)
    _spots: list[tuple[Spot, int]] = field(default_factory=list)
    _line: int = 1
    _starts: bool = False

    def statement(self, line: int) -> None:
        """Say that the next instruction starts a statement."""
        self._line = line
        self._starts = True

    def emit(self, make: Make) -> None:
        """Add an instruction."""
        self._items.append(_Item(make, None, self._line, self._starts))
        self._starts = False

    def jump(self, to: Spot) -> None:
        """Go on elsewhere: forward only, and it takes no instruction."""
        self._items.append(_Item(None, to, self._line, False))

    def put(self, spot: Spot) -> None:
        """Make a spot the place of the next instruction."""
        self._spots.append((spot, len(self._items)))

    def link(self) -> Linked:
        """Resolve the spots and make the instructions."""
        items = self._items
        numbers: list[int] = []
        count = 0
        for item in items:
            numbers.append(count)
            count += item.make is not None
        where = {id(spot): index for spot, index in self._spots}

        def resolve(index: int) -> int:
            while index < len(items) and (to := items[index].to) is not None:
                index = where[id(to)]
            return numbers[index] if index < len(items) else count

        for spot, index in self._spots:
            spot.pc = resolve(index)
        real = [(index, item, item.make) for index, item in enumerate(items) if item.make is not None]
        return Linked(
            tuple(make(resolve(index + 1)) for index, _, make in real),
            tuple(item.line for _, item, _ in real),
            tuple(item.starts for _, item, _ in real),
        )
