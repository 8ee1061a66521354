"""The interface of the expression compiler, as used by the compilers of calls and of assignable expressions."""

from __future__ import annotations

from typing import Protocol

from orinkit.virtual.rc8.pacscript.code import Code, Recipe
from orinkit.virtual.rc8.pacscript.scope import Scope, Variable
from orinkit.virtual.rc8.pacscript.tree import Apply, Expression


class ExpressionCompiler(Protocol):
    """Compiles expressions; implemented by :class:`~orinkit.virtual.rc8.pacscript.expressions.Expressions`."""

    @property
    def scope(self) -> Scope:
        """The names that the expressions may use."""

    @property
    def code(self) -> Code:
        """The code to which instructions are added."""

    def value(self, node: Expression) -> Recipe:
        """Return the recipe of a function that evaluates an expression."""

    def element_offset(self, variable: Variable, node: Apply) -> Recipe:
        """Return the recipe of a function that calculates the position of an array element in the list of the array."""
