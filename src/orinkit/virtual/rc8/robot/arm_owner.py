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
        """Return 0 if the operator may write, otherwise the error code with which a write is refused."""

    def token_refusal(self, switches: Switches) -> int:
        """Return 0 if the operator has the executable token (RC8 2.1), otherwise the error code of a refused call."""

    def __str__(self) -> str: ...
