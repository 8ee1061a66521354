"""Who tells the robot to do something: a client, or a running program."""

from __future__ import annotations

from typing import Protocol

from orinkit.virtual.rc8.switches import Switches


class Operator(Protocol):
    """A client, or a running program; whoever holds the arm is one.

    Attributes:
        program: whether it is a program.
    """

    @property
    def program(self) -> bool:
        """Whether it is a program."""

    def right(self) -> int:
        """Return the code with which a write is refused, 0 if it may write."""

    def token(self, switches: Switches) -> int:
        """Return the code with which a start is refused, 0 if it has the executable token (RC8 2.1)."""

    def __str__(self) -> str: ...
