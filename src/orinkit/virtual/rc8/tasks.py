"""The programs of the controller: one task per ``.pcs`` file.

A running task executes some statements in each 8 ms cycle.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from orinkit.cao.provider import Deferred, not_found
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.rc8.files import FileStore
from orinkit.virtual.rc8.pacscript.code import BuiltCode
from orinkit.virtual.rc8.pacscript.errors import ProgramLoadError
from orinkit.virtual.rc8.program import TaskHost
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.moves import Moves
from orinkit.virtual.rc8.starts import WaitingStarts
from orinkit.virtual.rc8.task import Task
from orinkit.virtual.rc8.variables.table import VariableTable

if TYPE_CHECKING:
    from orinkit.virtual.rc8.pacscript.compiler import Program

STATEMENTS: Final = 200
"""Maximum number of statements of one task in a cycle; this is 25,000 per second."""

ALL_STATEMENTS: Final = 800
"""Maximum number of statements of all tasks in a cycle; more would leave too little time for the arm and clients."""

MOST_RUNNING: Final = 32
SUFFIX: Final = ".pcs"
_MILLISECONDS: Final = 1000
_PART_OF_CYCLE: Final = 0.25  # fraction of a cycle that all programs together may use; some statements take long
_KEPT: Final = 32
_KEPT_BYTES: Final = 1024 * 1024  # of source; the compiled form is up to ten times as large


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
        self._world = lambda task: TaskHost(
            task, task.suspend, arm, moves, variables, seconds, show, takes_arm=not task.supervisory
        )
        self._stopping: list[tuple[tuple[Task, ...], Deferred[None]]] = []
        self._seconds = seconds

    @property
    def _kept_bytes(self) -> int:
        return sum(len(source) for source, _ in self._programs.values())

    @property
    def running(self) -> int:
        """Number of running tasks, without supervisory ones."""
        return sum([task.running and not task.supervisory for task in self._begun]) if self._begun else 0

    @property
    def supervisors_running(self) -> int:
        """Number of running supervisory tasks."""
        return sum(task.running and task.supervisory for task in self._begun)

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
        self.cycle_complete = self.cycle_complete and task.supervisory
        self._cycles.wake()

    def _require_room(self) -> None:
        if self.running + self.supervisors_running >= MOST_RUNNING:
            raise error_for(hresult.TASKS_TOO_MANY, str(MOST_RUNNING))

    def stop(self, task: Task, mode: StopMode) -> None:
        """Stop a task, and cancel the waiting starts of its program."""
        self.starts.cancel(program=task.name)
        task.stop(mode)

    def stop_all(self, *, supervisory: bool = False) -> None:
        """Reset every program, so that its next start is from the beginning. The caller stops the arm.

        Waiting starts are cancelled. Supervisory tasks continue, unless ``supervisory`` is True.
        """
        self.starts.cancel()
        for task in self._begun:
            if supervisory or not task.supervisory:
                task.initialize(halt=False)

    def power_on(self) -> None:
        """Reset every program, also supervisory tasks, as at power-on. The caller stops the arm."""
        self.stop_all(supervisory=True)
        for task in self._tasks.values():
            task.power_on()

    def close(self) -> None:
        """Fail the calls that wait for programs to stop, because the controller is switched off."""
        waiting, self._stopping = self._stopping, []
        for _, stopped in waiting:
            stopped.set_exception(error_for(hresult.E_ABORT))

    def stop_group(self, mode: StopMode, *, supervisory: bool = False) -> Deferred[None]:
        """Stop all tasks except supervisory ones, or only supervisory ones, and cancel the waiting starts.

        Returns:
            A Deferred that resolves when none of these tasks runs.
        """
        self.starts.cancel()
        group = tuple(task for task in self._begun if task.supervisory is supervisory)
        for task in group:
            was_running = task.running
            task.stop(mode)
            task.continue_stopped = was_running and mode is StopMode.INSTANT
        stopped = Deferred[None]()
        self._stopping.append((group, stopped))
        self._end_stops()
        self._cycles.wake()
        return stopped

    def continue_all(self) -> None:
        """Continue all suspended tasks except supervisory ones."""
        for task in self._begun:
            if not task.supervisory:
                task.resume()
        self._cycles.wake()

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
        if self._stopping:
            self._end_stops()
        if not self._begun:
            return False
        running = [task for task in self._begun if task.running]
        if running:
            self._first = (self._first + 1) % len(running)  # round-robin, because the time may not suffice for all
            turns = running[self._first :] + running[: self._first]
            turns.sort(key=lambda task: -task.priority)
            shares = sum(2.0**task.priority for task in running)
            expired = self._cycles.time_budget(_PART_OF_CYCLE)
            for task in turns:
                if task.running:  # the fault of another task may have stopped it
                    share = int(ALL_STATEMENTS * 2.0**task.priority / shares)
                    self._run(task, max(1, min(STATEMENTS, share)), expired)
                if expired():
                    break
        self._begun = [task for task in self._begun if task.status is not TaskStatus.READY]
        self._end_stops()
        return any(task.running for task in self._begun)

    def _end_stops(self) -> None:
        waiting, self._stopping = self._stopping, []
        for group, stopped in waiting:
            if any(task.running for task in group):
                self._stopping.append((group, stopped))
            else:
                stopped.set_result()

    def _run(self, task: Task, statements: int, expired: Callable[[], bool]) -> None:
        fault = task.step(statements, expired)
        if fault is not None:
            self._report(fault.code, fault.detail, task.name, fault.line)
        elif not task.running and not task.supervisory:
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
    from orinkit.virtual.rc8.pacscript.compiler import (
        compile_program,  # with lark, a quarter of all imports; many controllers run no program
    )

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
