"""The blocks of a program (Sub, Function, If, For, Do, While, Select Case) that are open during its compilation.

A block is open if its first line has been compiled, but not its last line.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from orinkit.virtual.rc8.pacscript import tree
from orinkit.virtual.rc8.pacscript.code import Recipe, Spot
from orinkit.virtual.rc8.pacscript.tree import Place


@dataclass(slots=True, eq=False)
class Block:
    """An open block: its keyword, the position of its first line, and the jump target after its end."""

    word: str
    at: Place
    end: Spot = field(default_factory=Spot)

    @property
    def closing(self) -> str:
        """The keyword that closes the block."""
        return {"For": "Next", "Do": "Loop", "While": "Wend", "Select Case": "End Select"}.get(
            self.word, f"End {self.word}"
        )


@dataclass(slots=True, eq=False)
class RoutineBlock(Block):
    """A Sub or Function."""

    has_gosub: bool = False


@dataclass(slots=True, eq=False)
class IfBlock(Block):
    """An If block.

    ``otherwise`` is the jump target if none of the conditions compiled so far is met. It is None after Else.
    """

    otherwise: Spot | None = field(default_factory=Spot)


@dataclass(slots=True, eq=False)
class ForBlock(Block):
    """A For block: the loop variable, recipes to read and set it, and the jump target at the start of the body.

    ``slots`` are the indices in the frame at which the limit and the step of the loop are stored.
    """

    target: tree.Target | None = None
    read: Recipe | None = None
    put: Recipe | None = None
    slots: tuple[int, int] = (0, 0)
    body: Spot = field(default_factory=Spot)


@dataclass(slots=True, eq=False)
class LoopBlock(Block):
    """A Do or While block; ``tested`` is True if the opening line has a condition."""

    top: Spot = field(default_factory=Spot)
    tested: bool = False


@dataclass(slots=True, eq=False)
class SelectBlock(Block):
    """A Select Case block: the index in the frame of the compared value, and the jump target of the next Case.

    The jump target ``following`` is None before the first Case and after Case Else.
    """

    slot: int = 0
    following: Spot | None = None
    begun: bool = False
