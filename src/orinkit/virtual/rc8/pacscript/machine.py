"""The interpreter: runs a program, a limited number of statements at a time."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.code import DONE, MAX_ELEMENTS, WAIT, BuiltCode, Frame, Op
from orinkit.virtual.rc8.pacscript.errors import ProgramFault, out_of_range
from orinkit.virtual.rc8.pacscript.host_interface import DelayWait, HostInterface, Wait

if TYPE_CHECKING:  # the compiler is imported for the first program
    from orinkit.virtual.rc8.pacscript.compiler import Program

MAX_CALLS: Final = 64
"""Maximum nesting depth of calls of Subs and Functions."""

Snapshot: TypeAlias = tuple[int, Frame, tuple[tuple[Frame, int, int, int], ...], int]
"""A position in a program: instruction, frame, active calls, elements of their arrays."""

_SEED: Final = 12_345
_MULTIPLIER: Final = 1_103_515_245
_INCREMENT: Final = 12_345
_MODULUS: Final = 2**31


class MachineState(Enum):
    """The state of a machine."""

    RUNNING = "running"  #: ready to execute the next statement
    WAITING = "waiting"  #: waits for a motion, a time or a condition
    DONE = "done"  #: at the end of Main, or at End
    FAULT = "fault"  #: stopped by the error in :attr:`Machine.fault`


class Machine:
    """A running program.

    Args:
        program: The program; it begins at Sub Main.
        world: The interface to the controller.
        built: The instructions of the controller's programs that exist as functions.
        publics: Values of the Public variables (:meth:`Program.new_publics`); their initial values if not given.

    Attributes:
        program: The program.
        publics: Values of the Public variables.
        frame: The frame of the running Sub or Function, with its variables; used by the instructions.
    """

    def __init__(
        self,
        program: Program,
        world: HostInterface,
        built: BuiltCode | None = None,
        publics: list[Any] | None = None,
    ) -> None:
        self.program = program
        self.publics = program.new_publics() if publics is None else publics
        self._world = world
        self._ops: list[Op | None] = [None] * len(program.linked.recipes)
        self._built = built or BuiltCode()
        self.restart()

    @property
    def state(self) -> MachineState:
        """The current state."""
        return self._state

    @property
    def fault(self) -> ProgramFault | None:
        """The error that stopped the program; None unless the state is FAULT."""
        return self._fault

    @property
    def delaying(self) -> bool:
        """True while the program waits in a Delay."""
        return self._state is MachineState.WAITING and isinstance(self._wait, DelayWait)

    @property
    def line(self) -> int:
        """The line of the next, waiting or failed statement; after the end, the last executed line. Counted from 1."""
        return self.program.linked.lines[self._pc]

    def restart(self) -> None:
        """Restart the program at Main."""
        self._stack: list[tuple[Frame, int, int, int]] = []
        self._pc, self._elements, new_frame = self.program.main
        self.frame: Frame = new_frame(self._world, self)
        self._wait: Wait | None = None
        self._after_wait = self._pc
        self._fault: ProgramFault | None = None
        self._seed = _SEED
        self._state = MachineState.RUNNING

    def cancel_wait(self) -> None:
        """Discard the wait in progress; when the program continues, the statement that waited is executed again."""
        self._wait = None
        if self._state is MachineState.WAITING:
            self._state = MachineState.RUNNING

    def run(self, budget: int, tired: Callable[[], bool] = lambda: False) -> int:
        """Execute statements until the budget is used up or the program waits or ends.

        Args:
            budget: Maximum number of statements. A call of a Function in an expression counts as a statement.
            tired: Callback invoked after each statement; if it returns True, the method returns early.

        Returns:
            The number of executed statements, including a statement that has begun to wait.
        """
        if self._state is MachineState.WAITING:
            self._poll()
        return self._execute(budget, tired) if self._state is MachineState.RUNNING else 0

    def step(self) -> None:
        """Execute one statement, or poll the wait in progress."""
        if self._state is MachineState.WAITING:
            self._poll()
        elif self._state is MachineState.RUNNING:
            self._execute(1)
        starts = self.program.linked.starts_statement
        while self._state is MachineState.RUNNING and not starts[self._pc]:
            self._execute(1)

    def snapshot(self) -> Snapshot:
        """Return the present position in the program, for :meth:`go_back`."""
        return self._pc, self.frame, tuple(self._stack), self._elements

    def go_back(self, snapshot: Snapshot) -> None:
        """Return to an earlier position; the variables keep their values."""
        self._pc, self.frame, stack, self._elements = snapshot
        self._stack = list(stack)
        self._wait = self._fault = None
        self._state = MachineState.RUNNING

    # --- for the instructions

    def wait_for(self, wait: Wait, following: int) -> int:
        """Begin to wait; after the wait, the program continues at the instruction with the index ``following``."""
        self._wait = wait
        self._after_wait = following
        return WAIT

    def enter(self, frame: Frame, following: int, slot: int, elements: int) -> None:
        """Begin a Sub or Function.

        Args:
            frame: Frame with the variables of the Sub or Function.
            following: Index of the instruction after the call.
            slot: The slot for the result in the caller's frame, or -1 to discard the result.
            elements: Total number of elements of the arrays of the Sub or Function.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if MAX_CALLS calls are active; E_OUTOFMEMORY if the arrays of all active calls
                exceed MAX_ELEMENTS.
        """
        if len(self._stack) >= MAX_CALLS:
            raise out_of_range(tr("calls are nested more than {most} deep", most=MAX_CALLS))
        if self._elements + elements > MAX_ELEMENTS:
            raise error_for(
                hresult.E_OUTOFMEMORY,
                tr("the arrays of the running Subs have more than {most} elements in total", most=MAX_ELEMENTS),
            )
        self._elements += elements
        self._stack.append((self.frame, following, slot, elements))
        self.frame = frame

    def leave(self, value: Any) -> int:
        """End a Sub or Function and return the index of the instruction at which its caller continues.

        At the end of the program, return DONE.

        Args:
            value: The result of a Function.
        """
        if not self._stack:
            return DONE
        frame, following, slot, elements = self._stack.pop()
        self._elements -= elements
        if slot >= 0:
            frame[slot] = value
        self.frame = frame
        return following

    def random(self) -> float:
        """Return a pseudo-random number in [0, 1); the sequence is the same after every restart."""
        self._seed = (_MULTIPLIER * self._seed + _INCREMENT) % _MODULUS
        return self._seed / _MODULUS

    # --- running

    def _execute(self, budget: int, tired: Callable[[], bool] = lambda: False) -> int:
        ops, linked = self._ops, self.program.linked
        pc = self._pc
        done = 0
        try:
            while done < budget:
                done += 1
                op = ops[pc] or self._built.op(ops, linked, pc)
                following = op(self.frame)
                if following < 0:
                    self._pc = pc
                    if not self._continues(following):
                        return done
                    following = self._pc
                pc = following
                if tired():
                    break
            self._pc = pc
        except (CallError, InvalidValue) as error:
            self._pc = pc
            self._fail(error)
        return done

    def _continues(self, result: int) -> bool:
        """Return True if the program continues immediately after an instruction that returned WAIT or DONE."""
        if result == WAIT:
            return self._poll_wait()
        self._state = MachineState.DONE
        return False

    def _poll(self) -> None:
        try:
            self._poll_wait()
        except (CallError, InvalidValue) as error:
            self._fail(error)

    def _poll_wait(self) -> bool:
        """Poll the wait; return True if it is complete."""
        self._state = MachineState.WAITING
        if self._wait is not None and not self._wait():
            return False
        self._wait = None
        self._pc = self._after_wait
        self._state = MachineState.RUNNING
        return True

    def _fail(self, error: CallError | InvalidValue) -> None:
        self._wait = None
        self._state = MachineState.FAULT
        if isinstance(error, CallError):
            code, detail = error.code, error.detail
        else:
            code, detail = hresult.VALUE_OUT_OF_RANGE, str(error)
        self._fault = ProgramFault(code, self.program.file, self.line, detail)
        self._fault.__cause__ = error
