"""Compiles the statements of a program to instructions."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from orinkit.core.errors import CallError
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript import tree
from orinkit.virtual.rc8.pacscript.blocks import SelectBlock
from orinkit.virtual.rc8.pacscript.code import MAX_ELEMENTS, Code, Evaluate, Frame, Linked, Op, RoutineCode, maker
from orinkit.virtual.rc8.pacscript.commands import (
    compile_command,
    compile_let_part,
    compile_set_reset,
    compile_take_arm,
)
from orinkit.virtual.rc8.pacscript.errors import CompileError, ProgramLoadError
from orinkit.virtual.rc8.pacscript.expressions import Expressions, whole_at
from orinkit.virtual.rc8.pacscript.flow import FlowCompiler, end_program
from orinkit.virtual.rc8.pacscript.lvalues import Store, store
from orinkit.virtual.rc8.pacscript.motions import compile_motion
from orinkit.virtual.rc8.pacscript.parser import parse_lines
from orinkit.virtual.rc8.pacscript.scope import (
    MAX_DIMENSIONS,
    PublicVariable,
    Routine,
    Scope,
    TypeOf,
    find_type,
    unknown_routine,
)
from orinkit.virtual.rc8.pacscript.tree import Place, Statement
from orinkit.virtual.rc8.pacscript.values import AnyValue

_MAIN: Final = "main"


@dataclass(frozen=True, slots=True)
class Program:
    """A compiled program; any number of machines can run it.

    Attributes:
        file: Name of the file.
        lines: Lines at which a statement begins, counted from 1.
        subs: Names of the Subs and Functions, as written.
        linked: Instructions.
        publics: The Public variables, by name in lower case.
    """

    file: str
    lines: tuple[int, ...]
    subs: tuple[str, ...]
    linked: Linked
    publics: Mapping[str, PublicVariable] = field(default_factory=dict)

    @property
    def main(self) -> RoutineCode:
        """Sub Main."""
        return self.linked.routines[_MAIN]

    def new_publics(self) -> list[AnyValue]:
        """Return the initial values of the Public variables."""
        return [variable.initial() for variable in self.publics.values()]


def compile_program(source: str, file: str) -> Program:
    """Compile a program.

    The syntax tree of a large program consists of hundreds of thousands of objects. Therefore it is encoded line by
    line, and only one line at a time exists as objects.

    Args:
        source: Source in PacScript; at most 256 Ki characters, at most 1,024 bytes in a line.
        file: Name of the file, for errors.

    Raises:
        ProgramLoadError: If the source has an error; the exception contains the position of the error.
    """
    lines = [_Line(pickle.dumps(statements), _declares(statements)) for statements in parse_lines(source, file)]
    compiler = _Compiler()
    try:
        linked = compiler.compile(lines)
        compiler.check_main()
    except CompileError as error:
        raise ProgramLoadError(error.message, file, *error.at) from None
    starts = sorted({line for line, starts in zip(linked.lines, linked.starts_statement, strict=True) if starts})
    subs = tuple(routine.name.text for routine in compiler.scope.routines.values())
    return Program(file, tuple(starts), subs, linked, compiler.scope.publics)


class _Line(NamedTuple):
    """The statements of a line, encoded; ``declares`` is True if one of them declares a routine, constants or Public variables."""

    code: bytes
    declares: bool

    @property
    def statements(self) -> tuple[Statement, ...]:
        statements: tuple[Statement, ...] = pickle.loads(self.code)  # noqa: S301 - encoded by compile_program
        return statements


def _declares(statements: tuple[Statement, ...]) -> bool:
    return any(
        isinstance(each, tree.Routine | tree.Constants)
        or (isinstance(each, tree.Declare) and each.public)
        or (isinstance(each, tree.KeywordStatement) and each.word in ("End Sub", "End Function"))
        for each in statements
    )


class _Compiler:
    def __init__(self) -> None:
        self.scope = Scope()
        self.code = Code()
        self.expressions = Expressions(self.scope, self.code)
        self.flow = FlowCompiler(self.expressions)

    def compile(self, lines: list[_Line]) -> Linked:
        self._collect([line for line in lines if line.declares])
        for line in lines:
            for statement in line.statements:
                self._statement(statement)
        if self.flow.blocks:
            block = self.flow.blocks[-1]
            raise CompileError(tr("{word} has no {closing}", word=block.word, closing=block.closing), block.at)
        return self.code.link(self.scope.routines)

    def check_main(self) -> None:
        """Check that there is a Sub Main without parameters.

        Raises:
            CompileError: If the program has no Sub Main, or if it has parameters.
        """
        main = self.scope.routines.get(_MAIN)
        if main is None or main.word != "Sub":
            raise CompileError(tr("the program has no Sub Main"), Place(1, 1))
        if main.parameters:
            raise CompileError(tr("Sub Main cannot have parameters"), main.name.at)

    # --- declarations, before statements are compiled

    def _collect(self, lines: list[_Line]) -> None:
        """Declare all Subs and Functions, the global constants, and the Public variables."""
        for header in _headers(lines):
            self.scope.add_routine(Routine(header.name, header.word))
        inside = False
        for line in lines:
            for statement in line.statements:
                if isinstance(statement, tree.Routine):
                    inside = True
                elif isinstance(statement, tree.KeywordStatement) and statement.word in ("End Sub", "End Function"):
                    inside = False
                elif isinstance(statement, tree.Constants) and not inside:
                    self._constants(statement)
                elif isinstance(statement, tree.Declare) and statement.public:
                    self._declare_public(statement)
        for header in _headers(lines):
            self._declare_parameters(header)

    def _declare_parameters(self, header: tree.Routine) -> None:
        routine = self.scope.routines[header.name.key]
        if header.word == "Function":
            routine.result = self.scope.add_variable(routine, header.name, find_type(header.result))
        for parameter in header.parameters:
            kind = find_type(parameter.type)
            by_ref = parameter.mode != "ByVal"
            routine.parameters.append(self.scope.add_variable(routine, parameter.name, kind, by_ref=by_ref))
            if parameter.mode == "ByRef":
                routine.explicit_refs.add(parameter.name.key)

    # --- statements

    def _statement(self, node: Statement) -> None:
        declares = isinstance(node, tree.Routine | tree.Constants) or (isinstance(node, tree.Declare) and node.public)
        if self.scope.routine is None and not declares:
            raise CompileError(tr("a statement must be in a Sub or Function"), node.at)
        self.code.statement(node.at.line)
        self._require_case_first(node)
        match node:
            case tree.Routine():
                self.scope.routine = self.flow.open_routine(node)
            case tree.KeywordStatement():
                self._marker(node)
            case tree.Label():
                self.flow.label(node)
            case tree.Declare():
                if not node.public:  # Public variables are declared by _collect
                    self._declare(node)
            case tree.Constants():
                if self.scope.routine is not None:
                    self._constants(node)
            case tree.Assign():
                self._assign(node.target, node.value)
            case tree.Call():
                self._call(node)
            case tree.Jump():
                self.flow.jump(node)
            case tree.IfLine():
                self.flow.if_line(node, self._statement)
            case tree.If() | tree.For() | tree.Next() | tree.Loop() | tree.Select() | tree.Case():
                self._block(node)
            case _:
                self._command(node)

    def _command(self, node: tree.Motion | tree.Command | tree.TakeArm | tree.SetOutput | tree.LetPart) -> None:
        match node:
            case tree.Motion():
                compile_motion(self.expressions, node)
            case tree.Command():
                compile_command(self.expressions, node)
            case tree.TakeArm():
                compile_take_arm(self.expressions, node)
            case tree.SetOutput():
                compile_set_reset(self.expressions, node)
            case tree.LetPart():
                compile_let_part(self.expressions, node)

    def _block(self, node: tree.If | tree.For | tree.Next | tree.Loop | tree.Select | tree.Case) -> None:
        match node:
            case tree.If():
                self.flow.open_if(node) if node.word == "If" else self.flow.else_if(node)
            case tree.For():
                self.flow.open_for(node)
            case tree.Next():
                self.flow.close_for(node)
            case tree.Loop():
                if node.word == "Loop":
                    self.flow.close_loop("Loop", node.at, node.test)
                else:
                    self.flow.open_loop(node)
            case tree.Select():
                self.flow.open_select(node)
            case tree.Case():
                self.flow.case(node)

    def _marker(self, node: tree.KeywordStatement) -> None:
        word, at = node.word, node.at
        match word:
            case "End Sub" | "End Function":
                self.flow.close_routine(word, at)
                self.scope.routine = None
            case "Exit Sub" | "Exit Function":
                self.flow.leave_routine(word, at)
            case "Exit For" | "Exit Do":
                self.flow.leave_loop(word, at)
            case "Else":
                self.flow.else_(at)
            case "End If":
                self.flow.close_if(at)
            case "Case Else":
                self.flow.case_else(at)
            case "End Select":
                self.flow.close_select(at)
            case "Wend":
                self.flow.close_loop("Wend", at, None)
            case "Return":
                self.flow.return_(at)
            case _:
                self.code.emit(end_program())

    def _require_case_first(self, node: Statement) -> None:
        block = self.flow.blocks[-1] if self.flow.blocks else None
        if not isinstance(block, SelectBlock) or block.begun or isinstance(node, tree.Case):
            return
        if isinstance(node, tree.KeywordStatement) and node.word in ("Case Else", "End Select"):
            return
        raise CompileError(
            tr("the Select Case in line {line} must begin with a Case", line=block.at.line),
            node.at,
        )

    def _declare_public(self, node: tree.Declare) -> None:
        for item in node.items:
            kind = find_type(item.type)
            value = kind.default if item.value is None else self._converted(kind, item.value)
            self.scope.add_public(item.name, kind, value, self._sizes(item))

    def _sizes(self, item: tree.Declared) -> tuple[int, ...]:
        sizes = tuple(self._size(size) for size in item.sizes)
        if len(sizes) > MAX_DIMENSIONS:
            raise CompileError(
                tr("{name}: an array may have at most {most} dimensions", name=item.name.text, most=MAX_DIMENSIONS),
                item.name.at,
            )
        if sizes and item.value is not None:
            raise CompileError(tr("an array cannot be initialised in Dim"), item.value.at)
        return sizes

    def _declare(self, node: tree.Declare) -> None:
        for item in node.items:
            sizes = self._sizes(item)
            self.scope.add_variable(self.scope.current_routine, item.name, find_type(item.type), sizes)
            if item.value is not None:
                self._assign(item.name, item.value)

    def _size(self, node: tree.Expression) -> int:
        highest = whole_at(self.expressions.known(node), node.at)
        if 0 <= highest < MAX_ELEMENTS:
            return highest + 1
        raise CompileError(
            tr("the highest index of an array must be 0 to {highest}", highest=MAX_ELEMENTS - 1),
            node.at,
        )

    def _constants(self, node: tree.Constants) -> None:
        for item in node.items:
            self.scope.add_constant(item.name, self._converted(find_type(item.type), item.value))

    def _converted(self, kind: TypeOf, node: tree.Expression) -> AnyValue:
        """Return the value of a constant expression, converted to a type."""
        try:
            return kind.convert(self.expressions.known(node))
        except CallError as error:
            raise CompileError(error.detail, node.at) from None

    def _assign(self, target: tree.Target, value_node: tree.Expression) -> None:
        value = self.expressions.value(value_node)
        self.code.emit(assign(store(self.expressions, target), value))

    def _call(self, node: tree.Call) -> None:
        name = node.target
        if not isinstance(name, tree.Name):
            raise CompileError(tr("expected the name of a Sub"), node.at)
        routine = self.scope.routines.get(name.key)
        if routine is None:
            raise unknown_routine(name)
        self.expressions.call(routine, name.at, node.arguments, result=False)


def _headers(lines: list[_Line]) -> Iterator[tree.Routine]:
    for line in lines:
        yield from (statement for statement in line.statements if isinstance(statement, tree.Routine))


@maker
def assign(following: int, put: Store, value: Evaluate) -> Op:
    """Return the instruction of an assignment."""

    def run(f: Frame) -> int:
        put(f, value(f))
        return following

    return run
