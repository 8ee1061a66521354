"""Blocks and jumps: If, For, Do, While, Select Case, Goto, Gosub. Errors name the opening line of an unclosed block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias, TypeVar

from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript import tree, values
from orinkit.virtual.rc8.pacscript.blocks import Block, ForBlock, IfBlock, LoopBlock, RoutineBlock, SelectBlock
from orinkit.virtual.rc8.pacscript.code import DONE, MACHINE, RETURNS, Evaluate, Frame, Op, Recipe, Spot, maker
from orinkit.virtual.rc8.pacscript.errors import CompileError, out_of_range
from orinkit.virtual.rc8.pacscript.expressions import RELATIONS, fixed
from orinkit.virtual.rc8.pacscript.lvalues import Store, store
from orinkit.virtual.rc8.pacscript.scope import Routine
from orinkit.virtual.rc8.pacscript.tree import Place
from orinkit.virtual.rc8.pacscript.values import AnyValue, number

if TYPE_CHECKING:
    from collections.abc import Callable

    from orinkit.virtual.rc8.pacscript.expressions import Expressions

MAX_GOSUB: Final = 64
"""Maximum nesting depth of Gosub in one Sub."""


@dataclass(slots=True)
class _Label:
    spot: Spot
    path: tuple[Block, ...] | None = None


_Jumps: TypeAlias = list[tuple[tree.Name, tuple[Block, ...]]]
_B = TypeVar("_B", bound=Block)


class FlowCompiler:
    """Compiles blocks and jumps.

    Attributes:
        blocks: The open blocks, outermost first.
    """

    def __init__(self, expressions: Expressions) -> None:
        self._expressions = expressions
        self._code = expressions.code
        self._scope = expressions.scope
        self._labels: dict[str, _Label] = {}
        self._jumps: _Jumps = []
        self._returns: list[Place] = []
        self.blocks: list[Block] = []

    # --- Sub and Function

    def open_routine(self, node: tree.Routine) -> Routine:
        """Compile the beginning of a Sub or Function."""
        self.refuse_open(node.at, node.word)
        routine = self._scope.routines[node.name.key]
        self.blocks.append(RoutineBlock(node.word, node.at))
        self._labels, self._jumps, self._returns = {}, [], []
        self._code.put(routine.entry)
        return routine

    def close_routine(self, word: str, at: Place) -> None:
        """Compile the end of a Sub or Function."""
        block = self._close(RoutineBlock, word.removeprefix("End "), word, at)
        if self._returns and not block.has_gosub:
            raise _misplaced("Return", self._returns[0], "Gosub")
        self._return_from(self._scope.current_routine)
        self._join_labels()

    def leave_routine(self, word: str, at: Place) -> None:
        """Compile Exit Sub or Exit Function."""
        routine = self._scope.current_routine
        if routine.word != word.removeprefix("Exit "):
            raise _misplaced(word, at, routine.word)
        self._return_from(routine)

    def refuse_open(self, at: Place, word: str) -> None:
        """Check that no block is open.

        Raises:
            CompileError: If a block is open.
        """
        if self.blocks:
            raise _not_closed(self.blocks[-1], at, word)

    # --- If

    def open_if(self, node: tree.If) -> None:
        """Compile If."""
        block = IfBlock("If", node.at)
        self._branch(node.condition, block.otherwise)
        self.blocks.append(block)

    def else_if(self, node: tree.If) -> None:
        """Compile ElseIf."""
        block = self._next_branch(node.word, node.at)
        block.otherwise = Spot()
        self._branch(node.condition, block.otherwise)

    def else_(self, at: Place) -> None:
        """Compile Else."""
        self._next_branch("Else", at).otherwise = None

    def close_if(self, at: Place) -> None:
        """Compile End If."""
        block = self._close(IfBlock, "If", "End If", at)
        if block.otherwise is not None:
            self._code.put(block.otherwise)
        self._code.put(block.end)

    def if_line(self, node: tree.IfLine, compile_one: Callable[[tree.Statement], None]) -> None:
        """Compile If on one line."""
        otherwise, end = Spot(), Spot()
        self._branch(node.condition, otherwise)
        for statement in node.then:
            compile_one(statement)
        self._code.jump(end)
        self._code.put(otherwise)
        for statement in node.otherwise:
            compile_one(statement)
        self._code.put(end)

    # --- For

    def open_for(self, node: tree.For) -> None:
        """Compile For."""
        expressions = self._expressions
        routine = self._scope.current_routine
        put, read = store(expressions, node.target), expressions.value(node.target)
        first, last = expressions.value(node.first), expressions.value(node.last)
        step = expressions.value(node.step) if node.step else fixed(1)
        slots = routine.new_slot(), routine.new_slot()
        block = ForBlock("For", node.at, target=node.target, read=read, put=put, slots=slots)
        self._code.emit(begin_for(put, read, first, last, step, *slots, block.end.recipe))
        self._code.put(block.body)
        self.blocks.append(block)

    def close_for(self, node: tree.Next) -> None:
        """Compile Next."""
        block = self._close(ForBlock, "For", "Next", node.at)
        if node.target is not None and block.target is not None and _written(node.target) != _written(block.target):
            raise CompileError(
                tr(
                    "Next {name} does not match For {opened} in line {line}",
                    name=_written(node.target),
                    opened=_written(block.target),
                    line=block.at.line,
                ),
                node.at,
            )
        self._code.emit(next_of_for(block.put, block.read, *block.slots, block.body.recipe))
        self._code.put(block.end)

    # --- Do, While

    def open_loop(self, node: tree.Loop) -> None:
        """Compile Do or While."""
        block = LoopBlock(node.word, node.at, tested=node.test is not None)
        self._code.put(block.top)
        if node.test is not None:
            self._branch(node.test.condition, block.end, unless=node.test.until)
        self.blocks.append(block)

    def close_loop(self, word: str, at: Place, test: tree.Test | None) -> None:
        """Compile Loop or Wend."""
        block = self._close(LoopBlock, "Do" if word == "Loop" else "While", word, at)
        if test is not None and block.tested:
            raise CompileError(
                tr("the Do in line {line} already has a condition", line=block.at.line),
                at,
            )
        if test is not None:
            self._branch(test.condition, block.top, unless=not test.until)
        else:
            self._code.emit(go_to(block.top.recipe))
        self._code.put(block.end)

    def leave_loop(self, word: str, at: Place) -> None:
        """Compile Exit For or Exit Do."""
        wanted = word.removeprefix("Exit ")
        for block in reversed(self.blocks):
            if block.word == wanted:
                self._code.emit(go_to(block.end.recipe))
                return
        raise _misplaced(word, at, wanted)

    # --- Select Case

    def open_select(self, node: tree.Select) -> None:
        """Compile Select Case."""
        value = self._expressions.value(node.value)
        slot = self._scope.current_routine.new_slot()
        self._code.emit(select(value, slot))
        self.blocks.append(SelectBlock("Select Case", node.at, slot=slot))

    def case(self, node: tree.Case) -> None:
        """Compile Case."""
        block = self._next_case("Case", node.at)
        block.following = Spot()
        tests = tuple(self._matcher(item) for item in node.items)
        self._code.emit(case(tests, block.slot, block.following.recipe))

    def case_else(self, at: Place) -> None:
        """Compile Case Else."""
        self._next_case("Case Else", at).following = None

    def close_select(self, at: Place) -> None:
        """Compile End Select."""
        block = self._close(SelectBlock, "Select Case", "End Select", at)
        if block.following is not None:
            self._code.put(block.following)
        self._code.put(block.end)

    # --- labels

    def label(self, node: tree.Label) -> None:
        """Compile a label."""
        known = self._labels.setdefault(node.name.key, _Label(Spot()))
        if known.path is not None:
            text = node.name.text
            raise CompileError(tr("label {label} is declared twice", label=text), node.at)
        known.path = tuple(self.blocks)
        self._code.put(known.spot)

    def jump(self, node: tree.Jump) -> None:
        """Compile Goto or Gosub."""
        spot = self._labels.setdefault(node.label.key, _Label(Spot())).spot
        self._jumps.append((node.label, tuple(self.blocks)))
        if node.word == "Goto":
            self._code.emit(go_to(spot.recipe))
            return
        outermost = self.blocks[0]
        assert isinstance(outermost, RoutineBlock)
        outermost.has_gosub = True
        self._code.emit(gosub(spot.recipe))

    def return_(self, at: Place) -> None:
        """Compile Return, the end of a Gosub."""
        self._returns.append(at)
        self._code.emit(return_from_gosub())

    # --- helpers

    def _branch(self, condition: tree.Expression, otherwise: Spot | None, *, unless: bool = False) -> None:
        """Emit a test: continue if the condition is met, otherwise jump to a spot; ``unless`` inverts the condition."""
        assert otherwise is not None
        self._code.emit(branch(self._expressions.condition(condition), unless, otherwise.recipe))

    def _next_branch(self, word: str, at: Place) -> IfBlock:
        block = self._innermost(IfBlock, "If", word, at)
        if block.otherwise is None:
            raise CompileError(
                tr("{word} after the Else of the If in line {line}", word=word, line=block.at.line),
                at,
            )
        self._code.jump(block.end)
        self._code.put(block.otherwise)
        return block

    def _next_case(self, word: str, at: Place) -> SelectBlock:
        block = self._innermost(SelectBlock, "Select Case", word, at)
        if block.begun and block.following is None:
            raise CompileError(
                tr("{word} after the Case Else of the Select Case in line {line}", word=word, line=block.at.line),
                at,
            )
        if block.following is not None:
            self._code.jump(block.end)
            self._code.put(block.following)
        block.begun = True
        return block

    def _matcher(self, item: tree.CaseItem) -> Recipe:
        low = self._expressions.value(item.value)
        if item.high is not None:
            return is_between(low, self._expressions.value(item.high))
        return is_related(item.relation, low)

    def _return_from(self, routine: Routine) -> None:
        self._code.emit(return_from(routine.result.slot if routine.result else None))

    def _innermost(self, kind: type[_B], opening: str, word: str, at: Place) -> _B:
        """Return the innermost open block after checking that a keyword belongs to it.

        Raises:
            CompileError: If no block is open, or if the innermost one is of another type.
        """
        top = self.blocks[-1] if self.blocks else None
        if isinstance(top, kind) and top.word == opening:
            return top
        if top is not None and any(isinstance(block, kind) and block.word == opening for block in self.blocks):
            raise _not_closed(top, at, word)
        if kind is RoutineBlock and top is not None:
            raise _not_closed(top, at, word)
        raise _misplaced(word, at, opening)

    def _close(self, kind: type[_B], opening: str, word: str, at: Place) -> _B:
        block = self._innermost(kind, opening, word, at)
        self.blocks.pop()
        return block

    def _join_labels(self) -> None:
        for name, path in self._jumps:
            there = self._labels[name.key].path
            if there is None:
                raise CompileError(
                    tr("unknown label {label} in this Sub", label=name.text),
                    name.at,
                )
            if there != path[: len(there)]:
                block = next(one for one in reversed(there) if one not in path)
                raise CompileError(
                    tr(
                        "cannot jump to label {label} inside the {word} in line {line}",
                        label=name.text,
                        word=block.word,
                        line=block.at.line,
                    ),
                    name.at,
                )


# --- instructions -----------------------------------------------------------------------------------------------------


@maker
def return_from(_following: int, slot: int | None) -> Op:
    """Return an instruction that ends a Sub or Function, whose result is in the slot."""

    def run(f: Frame) -> int:
        return int(f[MACHINE].leave(None if slot is None else f[slot]))

    return run


@maker
def end_program(_following: int) -> Op:
    """Return an instruction that ends the program."""
    return lambda _: DONE


@maker
def branch(following: int, met: Callable[[Frame], bool], unless: bool, there: int) -> Op:
    """Return an instruction that continues if a condition is met (``unless`` inverts it), and otherwise jumps."""
    if unless:
        return lambda f: there if met(f) else following
    return lambda f: following if met(f) else there


@maker
def begin_for(
    following: int, put: Store, read: Evaluate, first: Evaluate, last: Evaluate, step: Evaluate, limit_slot: int,
    step_slot: int, end: int,
) -> Op:  # fmt: skip
    """Return the instruction of For."""

    def run(f: Frame) -> int:
        start = number(first(f))
        limit = f[limit_slot] = number(last(f))
        by = f[step_slot] = number(step(f))
        put(f, start)
        value = read(f)
        return following if (value <= limit if by >= 0 else value >= limit) else end

    return run


@maker
def next_of_for(following: int, put: Store, read: Evaluate, limit_slot: int, step_slot: int, body: int) -> Op:
    """Return the instruction of Next."""

    def run(f: Frame) -> int:
        by = f[step_slot]
        put(f, values.add(read(f), by))
        value = read(f)
        return body if (value <= f[limit_slot] if by >= 0 else value >= f[limit_slot]) else following

    return run


@maker
def go_to(_following: int, there: int) -> Op:
    """Return an instruction that jumps."""
    return lambda _: there


@maker
def gosub(following: int, there: int) -> Op:
    """Return the instruction of Gosub."""

    def run(f: Frame) -> int:
        returns = f[RETURNS] = f[RETURNS] or []
        if len(returns) >= MAX_GOSUB:
            raise out_of_range(tr("Gosub is nested more than {most} deep", most=MAX_GOSUB))
        returns.append(following)
        return there

    return run


@maker
def return_from_gosub(_following: int) -> Op:
    """Return the instruction of Return."""

    def run(f: Frame) -> int:
        if f[RETURNS]:
            return int(f[RETURNS].pop())
        raise out_of_range(tr("Return without Gosub"))

    return run


@maker
def select(following: int, value: Evaluate, slot: int) -> Op:
    """Return the instruction of Select Case."""

    def run(f: Frame) -> int:
        f[slot] = value(f)
        return following

    return run


@maker
def case(body: int, tests: tuple[Callable[[Frame, AnyValue], bool], ...], slot: int, otherwise: int) -> Op:
    """Return the instruction of Case."""

    def run(f: Frame) -> int:
        value = f[slot]
        for test in tests:
            if test(f, value):
                return body
        return otherwise

    return run


@maker
def is_between(low: Evaluate, high: Evaluate) -> Callable[[Frame, AnyValue], bool]:
    """Return a function that returns True if a value is in a range."""
    return lambda f, value: not values.less(value, low(f)) and not values.less(high(f), value)


@maker
def is_related(relation: str, low: Evaluate) -> Callable[[Frame, AnyValue], bool]:
    """Return a function that compares a value."""
    compare = RELATIONS[relation]
    return lambda f, value: compare(value, low(f))


def _misplaced(word: str, at: Place, opening: str) -> CompileError:
    return CompileError(tr("{word} without {opening}", word=word, opening=opening), at)


def _not_closed(block: Block, at: Place, word: str) -> CompileError:
    return CompileError(
        tr(
            "unexpected {word}: the {opening} in line {line} has no {closing}",
            word=word,
            opening=block.word,
            line=block.at.line,
            closing=block.closing,
        ),
        at,
    )


def _written(target: tree.Target) -> str:
    if isinstance(target, tree.Name):
        return target.text.lower()
    if isinstance(target, tree.GlobalRef) and isinstance(target.index, tree.Literal):
        return f"{target.name.key}{target.index.value}"
    return target.name.key
