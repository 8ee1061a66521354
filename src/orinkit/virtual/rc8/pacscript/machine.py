"""Runs a program in slices."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.pacscript.code import DONE, WAIT, Frame
from orinkit.virtual.rc8.pacscript.compiler import Program, compile_program
from orinkit.virtual.rc8.pacscript.errors import ProgramFault, out_of_range
from orinkit.virtual.rc8.pacscript.host_interface import HostInterface, Wait
from orinkit.virtual.rc8.pacscript.scope import MAX_ELEMENTS

__all__ = ["MAX_CALLS", "Machine", "MachineState", "Program", "compile_program"]

MAX_CALLS: Final = 64
"""How deep Subs and Functions may call each other."""

_SEED: Final = 12_345
_MULTIPLIER: Final = 1_103_515_245
_INCREMENT: Final = 12_345
_MODULUS: Final = 2**31


class MachineState(Enum):
    """What a machine is about."""

    RUNNING = "running"  #: at a statement
    WAITING = "waiting"  #: for a motion, a time, a condition
    DONE = "done"  #: at the end of Main, or at End
    FAULT = "fault"  #: stopped by what :attr:`Machine.fault` says


class Machine:
    """A program as it runs.

    Args:
        program: what to run; it begins at Sub Main.
        world: the controller.

    Attributes:
        program: what it runs.
        frame: the variables of the Sub that runs; for the instructions.
    """

    def __init__(self, program: Program, world: HostInterface) -> None:
        self.program = program
        self._world = world
        self._ops = program.linked.ops
        self.restart()

    @property
    def state(self) -> MachineState:
        """What it is about."""
        return self._state

    @property
    def fault(self) -> ProgramFault | None:
        """What stopped it; ``None`` unless the state is FAULT."""
        return self._fault

    @property
    def line(self) -> int:
        """The line to be executed next, or that waits, or failed; when it is done the last one; counted from 1."""
        return self.program.linked.lines[self._pc]

    def restart(self) -> None:
        """Begin Main anew."""
        self._stack: list[tuple[Frame, int, int, int]] = []
        self._elements = self.program.elements
        self.frame: Frame = self.program.new_frame(self._world, self)
        self._pc = self.program.entry
        self._wait: Wait | None = None
        self._after_wait = self._pc
        self._fault: ProgramFault | None = None
        self._seed = _SEED
        self._state = MachineState.RUNNING

    def interrupt(self) -> None:
        """Forget the wait in progress; the statement that waited is executed anew when the program goes on."""
        self._wait = None
        if self._state is MachineState.WAITING:
            self._state = MachineState.RUNNING

    def run(self, budget: int, tired: Callable[[], bool] = lambda: False) -> int:
        """Execute statements until the budget is used up or the program waits or ends.

        Args:
            budget: how many. A call of a Function in an expression counts as one of its own.
            tired: is asked after each of them whether it has been long enough.

        Returns:
            how many were executed; the one that began to wait is among them.
        """
        if self._state is MachineState.WAITING:
            self._poll()
        return self._execute(budget, tired) if self._state is MachineState.RUNNING else 0

    def step(self) -> None:
        """Execute one statement; of one that waits, look whether it is over."""
        if self._state is MachineState.WAITING:
            self._poll()
        elif self._state is MachineState.RUNNING:
            self._execute(1)
        starts = self.program.linked.starts
        while self._state is MachineState.RUNNING and not starts[self._pc]:
            self._execute(1)

    # --- for the instructions

    def wait_for(self, wait: Wait, following: int) -> int:
        """Wait, then go on at an instruction."""
        self._wait = wait
        self._after_wait = following
        return WAIT

    def enter(self, frame: Frame, following: int, slot: int, elements: int) -> None:
        """Begin a Sub or Function.

        Args:
            frame: its variables.
            following: the instruction after the call.
            slot: where the caller wants its value, -1 for nowhere.
            elements: how many elements its arrays have.

        Raises:
            CallError: VALUE_OUT_OF_RANGE, MAX_CALLS are running; E_OUTOFMEMORY, their arrays are too large together.
        """
        if len(self._stack) >= MAX_CALLS:
            raise out_of_range(tr("calls nested deeper than {most}", most=MAX_CALLS))
        if self._elements + elements > MAX_ELEMENTS:
            raise error_for(
                hresult.E_OUTOFMEMORY,
                tr("the arrays of the running Subs have more than {most} elements", most=MAX_ELEMENTS),
            )
        self._elements += elements
        self._stack.append((self.frame, following, slot, elements))
        self.frame = frame

    def leave(self, value: Any) -> int:
        """End a Sub or Function; returns where the caller goes on."""
        if not self._stack:
            return DONE
        frame, following, slot, elements = self._stack.pop()
        self._elements -= elements
        if slot >= 0:
            frame[slot] = value
        self.frame = frame
        return following

    def random(self) -> float:
        """Return a number from 0 up to 1, the same ones after every restart."""
        self._seed = (_MULTIPLIER * self._seed + _INCREMENT) % _MODULUS
        return self._seed / _MODULUS

    # --- running

    def _execute(self, budget: int, tired: Callable[[], bool] = lambda: False) -> int:
        ops = self._ops
        pc = self._pc
        done = 0
        try:
            while done < budget:
                done += 1
                following = ops[pc](self.frame)
                if following < 0:
                    self._pc = pc
                    if not self._goes_on(following):
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

    def _goes_on(self, told: int) -> bool:
        """Return whether the program goes on at once after an instruction that told to wait or to end."""
        if told == WAIT:
            return self._is_over()
        self._state = MachineState.DONE
        return False

    def _poll(self) -> None:
        try:
            self._is_over()
        except (CallError, InvalidValue) as error:
            self._fail(error)

    def _is_over(self) -> bool:
        """DrainInput whether what is waited for is over."""
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
