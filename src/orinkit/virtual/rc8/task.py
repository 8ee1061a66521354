"""A program of the controller and its execution."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.virtual.rc8.pacscript.code import BuiltCode
from orinkit.virtual.rc8.pacscript.errors import ProgramFault
from orinkit.virtual.rc8.pacscript.host_interface import Wait
from orinkit.virtual.rc8.pacscript.machine import Machine, MachineState, Snapshot
from orinkit.virtual.rc8.pacscript.values import AnyValue
from orinkit.virtual.rc8.program import TaskHost
from orinkit.virtual.rc8.switches import Switches

if TYPE_CHECKING:
    from orinkit.virtual.rc8.pacscript.compiler import Program
    from orinkit.virtual.rc8.pacscript.scope import PublicVariable

_SUPERVISORY: Final = "tsr"  # beginning of the file names of supervisory tasks

LOWEST_PRIORITY, HIGHEST_PRIORITY = -2, 2
"""Range of the priority of a task (provider guide 5.2.33.2)."""

CONTINUE_STOPPED, PENDING, DELAYING = 5, 6, 7
"""Values of ``@STATUS_DETAILS`` that ``@STATUS`` does not have (provider guide 5.3.3)."""

_STEPS: Final = 100  # statements that a task remembers for steps backward


def is_supervisory(program: str) -> bool:
    """Return True if a program is a supervisory task, by its name without suffix."""
    return program.rpartition("\\")[2].lower().startswith(_SUPERVISORY)


class Task:
    r"""A program and its execution.

    A task is an operator of the arm. It requires neither rights nor the token, because its start has required both.

    Attributes:
        name: Name without suffix, such as ``Pro1`` or ``folder\\Pro1``.
        status: State of execution.
        deleted: True if the program has been deleted while the task was running.
        cycle_seconds: Duration of the last complete run of the program, s.
        priority: Priority, -2 to 2; a task with a higher priority executes more statements in a cycle.
        continue_stopped: True if SuspendAll has suspended the task.
    """

    program: Final = True

    def __init__(
        self, name: str, world: Callable[[Task], TaskHost], seconds: Callable[[], float], built: BuiltCode
    ) -> None:
        self.name = name
        self.status = TaskStatus.READY
        self.deleted = False
        self.cycle_seconds = 0.0
        self.priority = 0
        self.continue_stopped = False
        self.world = world(self)
        self._seconds = seconds
        self._built = built
        self._mode = TaskMode.CYCLE
        self._ending = StopMode.DEFAULT  # STEP or CYCLE: stop after the present step or cycle
        self._machine: Machine | None = None
        self._program: Program | None = None
        self._publics: list[AnyValue] = []
        self._declared: Mapping[str, PublicVariable] = {}
        self._steps: deque[tuple[Snapshot, tuple[float, ...]]] = deque(maxlen=_STEPS)
        self._returning: Wait | None = None  # the motion of a step backward
        self._began = 0.0
        self._started = 0.0

    def __str__(self) -> str:
        return self.name

    def write_refusal(self) -> int:
        """Return 0: the rights were checked when the task was started."""
        return 0

    def token_refusal(self, switches: Switches) -> int:
        """Return 0: the client that started the task had the token."""
        return 0

    @property
    def supervisory(self) -> bool:
        """True for a supervisory task: the name of its file begins with ``TSR``."""
        return is_supervisory(self.name)

    @property
    def running(self) -> bool:
        """True while the task is running."""
        return self.status is TaskStatus.RUNNING

    @property
    def line(self) -> int:
        """The line to be executed next, counted from 1; 0 before the first start."""
        return self._machine.line if self._machine else 0

    @property
    def elapsed(self) -> float:
        """Seconds since the start; 0 if the task is not running."""
        return self._seconds() - self._started if self.status is TaskStatus.RUNNING else 0.0

    @property
    def details(self) -> int:
        """The status with the additional values of ``@STATUS_DETAILS``."""
        if self.continue_stopped and self.status is TaskStatus.SUSPENDED:
            return CONTINUE_STOPPED
        if self.running and self._machine is not None and self._machine.state is MachineState.WAITING:
            return DELAYING if self._machine.delaying else PENDING
        return int(self.status)

    def publics(self, program: Program) -> list[AnyValue]:
        """Return the values of the Public variables of the task's program.

        They keep their values until their declarations are changed or the controller is switched off.
        """
        if program.publics != self._declared:
            self._publics, self._declared = program.new_publics(), program.publics
        return self._publics

    def power_on(self) -> None:
        """Set the Public variables to their initial values, as at power-on."""
        self._publics, self._declared = [], {}

    def start(self, program: Program, mode: TaskMode) -> None:
        """Run a program from its beginning; if the task is suspended and the program is unchanged, continue it.

        Raises:
            CallError: PROGRAM_RUNNING if the task is already running; PROGRAM_NOT_RUNNING for a step backward if the
                task has no previous statement.
        """
        if self.status is TaskStatus.RUNNING:
            raise error_for(hresult.PROGRAM_RUNNING, self.name)
        continues = self.status in (TaskStatus.SUSPENDED, TaskStatus.STEP_STOPPED) and program is self._program
        if mode is TaskMode.STEP_BACK:
            self._step_back(continues)
        elif not continues or self._machine is None:
            self._program = program
            self._machine = Machine(program, self.world, self._built, self.publics(program))
            self._steps.clear()
            self._began = self._seconds()
        self._run(mode)

    def resume(self) -> None:
        """Continue the task if it is suspended, in the mode of its last start; a step becomes a cycle."""
        if self._machine is not None and self.status in (TaskStatus.SUSPENDED, TaskStatus.STEP_STOPPED):
            self._run(TaskMode.CONTINUOUS if self._mode is TaskMode.CONTINUOUS else TaskMode.CYCLE)

    def _run(self, mode: TaskMode) -> None:
        self._mode, self._ending = mode, StopMode.DEFAULT
        self._started = self._seconds()
        self.status = TaskStatus.RUNNING
        self.continue_stopped = False
        self.world.resume_motion()

    def _step_back(self, continues: bool) -> None:
        """Return to the previous statement, and begin to move the arm back to where it was before this statement."""
        if not continues or self._machine is None or not self._steps:
            raise error_for(hresult.PROGRAM_NOT_RUNNING, tr("{name} has no previous statement", name=self.name))
        snapshot, joints = self._steps[-1]
        self._returning = self.world.return_to(joints)
        self._steps.pop()
        self._machine.go_back(snapshot)

    def stop(self, mode: StopMode) -> None:
        """Stop the task; if it is not running, only INITIALIZE has an effect."""
        if mode is StopMode.INITIALIZE:
            self.initialize(halt=True)
        elif self.status is TaskStatus.RUNNING:
            if mode in (StopMode.STEP, StopMode.CYCLE):
                self._ending = mode
            else:
                self.status = TaskStatus.SUSPENDED
                self.world.pause_motion()

    def suspend(self) -> None:
        """Suspend the task because it has executed Hold; the next start continues it."""
        self.status = TaskStatus.SUSPENDED

    def initialize(self, *, halt: bool) -> None:
        """Reset the task to its beginning and release the arm; with ``halt``, stop the motion of the task."""
        self.world.leave(halt=halt)
        self._machine = self._returning = None
        self._steps.clear()
        self.continue_stopped = False
        self.status = TaskStatus.READY

    def step(self, statements: int, expired: Callable[[], bool]) -> ProgramFault | None:
        """Execute the statements of one 8 ms cycle; return the fault that ended the program, or None.

        Args:
            statements: Maximum number of statements.
            expired: Callback that returns True when the time for programs in this cycle is used up.
        """
        machine = self._machine
        if self.status is not TaskStatus.RUNNING or machine is None:
            return None
        if self._mode is TaskMode.STEP_BACK:
            return self._poll_return(machine)
        if self._mode is TaskMode.STEP or self._ending is StopMode.STEP:
            if machine.state is MachineState.RUNNING:
                self._steps.append((machine.snapshot(), self.world.joints))
            machine.step()
        else:
            self._steps.clear()
            machine.run(statements, expired)
        if machine.state is MachineState.FAULT:
            self.initialize(halt=True)
            return machine.fault
        if machine.state is MachineState.DONE:
            self._cycle_done(machine)
        elif machine.state is MachineState.RUNNING and TaskMode.STEP in (self._mode, self._ending_as_start()):
            self.status = TaskStatus.STEP_STOPPED
        return None

    def _poll_return(self, machine: Machine) -> ProgramFault | None:
        try:
            if self._returning is not None and not self._returning():
                return None
        except CallError as error:
            fault = ProgramFault(error.code, machine.program.file, machine.line, error.detail)
            self.initialize(halt=True)
            return fault
        self._returning = None
        self.status = TaskStatus.STEP_STOPPED
        return None

    def _ending_as_start(self) -> TaskMode | None:
        return TaskMode.STEP if self._ending is StopMode.STEP else None

    def _cycle_done(self, machine: Machine) -> None:
        self.cycle_seconds = self._seconds() - self._began
        if self._mode is TaskMode.CONTINUOUS and self._ending is StopMode.DEFAULT:
            self._began = self._seconds()
            machine.restart()
        else:
            self.initialize(halt=True)  # only if the program still holds the arm
