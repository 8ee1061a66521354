"""What compilers of calls and of lvalues need of the compiler of expressions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from orinkit.virtual.rc8.pacscript.code import Code, Evaluate, Frame
from orinkit.virtual.rc8.pacscript.scope import Scope, Variable
from orinkit.virtual.rc8.pacscript.tree import Apply, Expression


class ExpressionCompiler(Protocol):
    """Compiles expressions; :class:`~orinkit.virtual.rc8.pacscript.expressions.Expressions` is the one that there is."""

    @property
    def scope(self) -> Scope:
        """The names that the expressions may use."""

    @property
    def code(self) -> Code:
        """Where instructions go."""

    def value(self, node: Expression) -> Evaluate:
        """Return what evaluates an expression."""

    def element(self, variable: Variable, node: Apply) -> Callable[[Frame], int]:
        """Return what evaluates the offset of an element of an array."""
