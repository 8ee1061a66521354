"""The interface of an operator of the robot: a client, or a running program."""

from __future__ import annotations

from typing import Protocol

from orinkit.virtual.rc8.switches import Switches


class Operator(Protocol):
    """A client or a running program, which can hold the arm.

    Attributes:
        program: True for a program.
    """

    @property
    def program(self) -> bool:
        """True for a program."""

    def write_refusal(self) -> int:
        """Return the error code of a refused write, or 0 if the operator may write."""

    def token_refusal(self, switches: Switches) -> int:
        """Return the error code of a refused start, or 0 if the operator has the executable token (RC8 2.1)."""

    def __str__(self) -> str: ...
