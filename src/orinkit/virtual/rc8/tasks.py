"""The programs of the controller: one task per ``.pcs`` file.

A running task executes some statements in each 8 ms cycle.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from orinkit.cao.provider import not_found
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.rc8.files import FileStore
from orinkit.virtual.rc8.pacscript.code import BuiltCode
from orinkit.virtual.rc8.pacscript.errors import ProgramFault, ProgramLoadError
from orinkit.virtual.rc8.pacscript.machine import Machine, MachineState, Program, compile_program
from orinkit.virtual.rc8.program import TaskHost
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.moves import Moves
from orinkit.virtual.rc8.starts import WaitingStarts
from orinkit.virtual.rc8.switches import Switches
from orinkit.virtual.rc8.variables.table import VariableTable

STATEMENTS: Final = 200
"""Maximum number of statements of one task in a cycle; this is 25,000 per second."""

ALL_STATEMENTS: Final = 800
"""Maximum number of statements of all tasks in a cycle; more would leave too little time for the arm and clients."""

MOST_RUNNING: Final = 32
PRIORITY: Final = 128
SUFFIX: Final = ".pcs"
_MILLISECONDS: Final = 1000
_PART_OF_CYCLE: Final = 0.25  # fraction of a cycle that all programs together may use; some statements take long
_KEPT: Final = 32
_KEPT_BYTES: Final = 1024 * 1024  # of source; the compiled form is up to ten times as large


class Task:
    r"""A program and its execution.

    A task is an operator of the arm. It requires neither rights nor the token, because its start has required both.

    Attributes:
        name: Name without suffix, such as ``Pro1`` or ``folder\\Pro1``.
        status: State of execution.
        deleted: True if the program has been deleted while the task was running.
        cycle_seconds: Duration of the last complete run of the program, s.
    """

    program: Final = True

    def __init__(
        self, name: str, world: Callable[[Task], TaskHost], seconds: Callable[[], float], built: BuiltCode
    ) -> None:
        self.name = name
        self.status = TaskStatus.READY
        self.deleted = False
        self.cycle_seconds = 0.0
        self.world = world(self)
        self._seconds = seconds
        self._built = built
        self._mode = TaskMode.CYCLE
        self._ending = StopMode.DEFAULT  # STEP or CYCLE: stop after the present step or cycle
        self._machine: Machine | None = None
        self._program: Program | None = None
        self._began = 0.0
        self._started = 0.0

    def __str__(self) -> str:
        return self.name

    def write_refusal(self) -> int:
        """Return 0: the rights were checked when the task was started."""
        return 0

    def token_refusal(self, switches: Switches) -> int:  # noqa: ARG002 - declared by Operator
        """Return 0: the client that started the task had the token."""
        return 0

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

    def start(self, program: Program, mode: TaskMode) -> None:
        """Run a program from its beginning; if the task is suspended and the program is unchanged, continue it.

        Raises:
            CallError: PROGRAM_RUNNING if the task is already running.
        """
        if self.status is TaskStatus.RUNNING:
            raise error_for(hresult.PROGRAM_RUNNING, self.name)
        continues = self.status in (TaskStatus.SUSPENDED, TaskStatus.STEP_STOPPED) and program is self._program
        if not continues or self._machine is None:
            self._program = program
            self._machine = Machine(program, self.world, self._built)
            self._began = self._seconds()
        self._mode, self._ending = mode, StopMode.DEFAULT
        self._started = self._seconds()
        self.status = TaskStatus.RUNNING
        self.world.resume_motion()

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
        self._machine = None
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
        if self._mode is TaskMode.STEP or self._ending is StopMode.STEP:
            machine.step()
        else:
            machine.run(statements, expired)
        if machine.state is MachineState.FAULT:
            self.initialize(halt=True)
            return machine.fault
        if machine.state is MachineState.DONE:
            self._cycle_done(machine)
        elif machine.state is MachineState.RUNNING and TaskMode.STEP in (self._mode, self._ending_as_start()):
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


class Tasks:
    """All tasks: one per program in the file store.

    Args:
        cycles: The control loop.
        arm, moves: The arm, and the planner of its motions.
        variables: Global variables.
        files: The file store with the programs.
        seconds: Callback that returns the time since the controller was switched on, s.
        report: Callback invoked for the fault of a program; its arguments are code, detail, program and line.
        show: Callback invoked for each printed text; its arguments are the program, ``"msg"`` (PrintMsg) or ``"dbg"``
            (PrintDbg), and the text.

    Attributes:
        starts: The starts that wait for the loading of their programs.
        cycle_complete: True if a program has run to its end and no program has been started since.
    """

    def __init__(
        self, cycles: ControlLoop, arm: RC8Arm, moves: Moves, variables: VariableTable, files: FileStore,
        seconds: Callable[[], float], report: Callable[[int, str, str, int], None],
        show: Callable[[str, str, str], None],
    ) -> None:  # fmt: skip
        self.starts = WaitingStarts()
        self.cycle_complete = False
        self._cycles = cycles
        self._files = files
        self._report = report
        self._tasks: dict[str, Task] = {}
        self._begun: list[Task] = []  # tasks that are running, suspended or have ended in this cycle
        files.changed.append(self._file_changed)
        self._programs: OrderedDict[str, tuple[bytes, Program | CallError]] = OrderedDict()
        self._built = BuiltCode()
        self._first = 0
        self._world = lambda task: TaskHost(task, task.suspend, arm, moves, variables, seconds, show)
        self._seconds = seconds

    @property
    def _kept_bytes(self) -> int:
        return sum(len(source) for source, _ in self._programs.values())

    @property
    def running(self) -> int:
        """Number of running tasks."""
        return sum(task.running for task in self._begun)

    def names(self) -> list[str]:
        """Return the names of all programs, without suffix."""
        return self._files.programs()

    def find(self, name: str) -> Task:
        """Return the task of a program, ignoring case, with or without suffix; accesses the disk.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND if the program does not exist.
        """
        stem = name.strip()
        if stem.lower().endswith(SUFFIX):
            stem = stem[: -len(SUFFIX)]
        try:
            exists = bool(stem) and self._files.exists(stem + SUFFIX)
        except CallError:  # not a valid file name
            exists = False
        if not exists:
            raise not_found(name)
        path = self._files.full_name(stem + SUFFIX).lstrip("\\")[: -len(SUFFIX)]
        with self._cycles:
            return self.get_or_create(path)

    def get_or_create(self, path: str) -> Task:
        """Return the task of a path, even if the program does not exist."""
        key = path.lower()
        task = self._tasks.get(key)
        if task is None:
            task = Task(path, self._world, self._seconds, self._built)
            if self.is_found(task):
                self._tasks[key] = task
        return task

    def exists(self, task: Task) -> bool:
        """Return True if the program of a task still exists; accesses the disk."""
        return self._files.exists(task.name + SUFFIX)

    def is_found(self, task: Task) -> bool:
        """Return True if a program exists whose name on the disk is spelled exactly like the name of the task."""
        return self._files.has(task.name + SUFFIX)

    def start(self, task: Task, program: Program, mode: TaskMode) -> None:
        """Run the program of a task.

        Raises:
            CallError: PROGRAM_RUNNING; TASKS_TOO_MANY.
        """
        self._cycles.require_open()
        self._require_room()
        task.start(program, mode)
        self._tasks[task.name.lower()] = task
        if task not in self._begun:
            self._begun.append(task)
        self.cycle_complete = False
        self._cycles.wake()

    def _require_room(self) -> None:
        if self.running >= MOST_RUNNING:
            raise error_for(hresult.TASKS_TOO_MANY, str(MOST_RUNNING))

    def stop(self, task: Task, mode: StopMode) -> None:
        """Stop a task, and cancel the waiting starts of its program."""
        self.starts.cancel(program=task.name)
        task.stop(mode)

    def stop_all(self) -> None:
        """Reset every program, so that its next start is from the beginning. The caller stops the arm.

        Waiting starts are cancelled.
        """
        self.starts.cancel()
        for task in self._begun:
            task.initialize(halt=False)

    def _file_changed(self, name: str, exists: bool) -> None:
        """Discard the compiled form of a changed program; if its file was deleted, discard its task.

        The task is not discarded while it is running.
        """
        key = name.lower().removesuffix(SUFFIX)
        with self._cycles:
            self._programs.pop(key, None)
            task = self._tasks.get(key)
            if task is not None:
                task.deleted = not exists
                if task.deleted and not task.running:
                    self._discard(task)

    def _discard(self, task: Task) -> None:
        if task.status is not TaskStatus.READY:
            task.initialize(halt=True)
        self._tasks.pop(task.name.lower(), None)

    def delete(self, task: Task) -> None:
        """Delete a task and its program; accesses the disk.

        Raises:
            CallError: PROGRAM_RUNNING if the task is running or suspended; otherwise the error of the file store.
        """
        with self._cycles:
            if task.status is not TaskStatus.READY:
                raise error_for(hresult.PROGRAM_RUNNING, task.name)
        self._files.delete(task.name + SUFFIX)

    def step(self) -> bool:
        """Execute one cycle; return True if a program is running."""
        if not self._begun:
            return False
        running = [task for task in self._begun if task.running]
        if running:
            self._first = (self._first + 1) % len(running)  # round-robin, because the time may not suffice for all
            expired = self._cycles.time_budget(_PART_OF_CYCLE)
            for task in running[self._first :] + running[: self._first]:
                if task.running:  # the fault of another task may have stopped it
                    self._run(task, min(STATEMENTS, ALL_STATEMENTS // len(running)), expired)
                if expired():
                    break
        self._begun = [task for task in self._begun if task.status is not TaskStatus.READY]
        return self.running > 0

    def _run(self, task: Task, statements: int, expired: Callable[[], bool]) -> None:
        fault = task.step(statements, expired)
        if fault is not None:
            self._report(fault.code, fault.detail, task.name, fault.line)
        elif not task.running:
            self.cycle_complete = task.status is TaskStatus.READY
        if not task.running and task.deleted:
            self._discard(task)

    def load(self, task: Task) -> Program:
        """Return the compiled program of a task; an unchanged program is compiled only once.

        Compiling takes long. Therefore call this method outside the lock.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND; TASKS_TOO_MANY; SYNTAX_ERROR with file, line and column in its detail;
                otherwise the error of the file store.
        """
        self._cycles.require_open()
        if not self.exists(task):
            raise not_found(task.name)
        with self._cycles:
            self._require_room()
        key, source = task.name.lower(), self._files.read(task.name + SUFFIX)
        with self._cycles:
            cached = self._programs.get(key)
        if cached is None or cached[0] != source:
            cached = source, _compiled(source, task.name + SUFFIX)
            self._keep(key, *cached)
        if isinstance(cached[1], CallError):
            raise error_for(cached[1].code, cached[1].detail)
        return cached[1]

    def _keep(self, key: str, source: bytes, program: Program | CallError) -> None:
        with self._cycles:
            self._programs.pop(key, None)
            if len(source) > _KEPT_BYTES:  # far too long to be compiled, so the same error is found immediately
                return
            self._programs[key] = source, program
            while len(self._programs) > _KEPT or self._kept_bytes > _KEPT_BYTES:
                self._programs.popitem(last=False)  # a running task has its own reference


def _compiled(source: bytes, file: str) -> Program | CallError:
    try:
        return compile_program(_text(source), file)
    except ProgramLoadError as error:
        return error_for(error.code, str(error))


def ms_from_seconds(seconds: float) -> int:
    """Convert a time from s to ms, limited to the largest VT_I4."""
    return min(int(seconds * _MILLISECONDS), 0x7FFF_FFFF)


def _text(source: bytes) -> str:
    try:
        return source.decode("utf-8-sig")
    except UnicodeDecodeError:
        return source.decode("cp932", errors="replace")
