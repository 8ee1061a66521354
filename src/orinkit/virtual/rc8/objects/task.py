"""Task objects and their variables (RC8 3.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, TypeVar

from orinkit.cao.provider import BlockingCall, TaskObject, VariableObject, not_found
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import N_, tr
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.values.variant import Value, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.tasks import PRIORITY, SUFFIX, Task, ms_from_seconds

E = TypeVar("E", bound=IntEnum)


class RC8Task(TaskObject):
    """The Task object of one client."""

    def __init__(self, caller: ClientContext, task: Task, name: str) -> None:
        text = caller.state.say("Task of the program")
        super().__init__(name, attribute=int(caller.access), help=f"{text} {task.name}{SUFFIX}")
        self._caller = caller
        self._state = caller.state
        self._path = task.name  # not the task itself: if the program is deleted and created again, it has a new task

    @property
    def _task(self) -> Task:
        return self._state.tasks.get_or_create(self._path)

    def start(self, mode: int, option: str) -> BlockingCall | None:  # noqa: ARG002 - there are no options
        """Start the task, or continue it if it is suspended (RC8 3.2.2).

        Modes: 1 one cycle (the whole program once), 2 continuous, 3 one statement. A large program is loaded in a
        thread, so that other calls are not delayed.

        Raises:
            CallError: SYNTAX_ERROR; PROGRAM_RUNNING; E_INVALIDARG if the mode is unknown; other codes if the state of
                the controller does not allow the start.
        """
        wanted = _mode(TaskMode, mode)
        require("Task_Start", self._state.arm, self._caller)
        if self._state.tasks.is_large(self._task):
            return BlockingCall(lambda: self._load_and_start(wanted))
        self._state.start_task(self._task, wanted, self._caller.origin)
        return None

    def _load_and_start(self, mode: TaskMode) -> None:
        try:
            self._state.tasks.load(self._task)
        except CallError:  # the error is cached too; start_task raises it
            pass
        with self._state.cycles:
            require("Task_Start", self._state.arm, self._caller)  # the state may have changed meanwhile
            self._state.start_task(self._task, mode, self._caller.origin)

    def stop(self, mode: int, option: str) -> None:  # noqa: ARG002
        """Stop the task (RC8 3.2.2).

        Modes: 0 and 1 immediately, 2 after the statement, 3 after the cycle, 4 immediately and reset to the beginning.

        Raises:
            CallError: NO_WRITE_RIGHT; E_INVALIDARG if the mode is unknown.
        """
        wanted = _mode(StopMode, mode)
        require("Task_Stop", self._state.arm, self._caller)
        self._task.stop(wanted)

    def delete(self, option: str) -> None:  # noqa: ARG002
        """Delete the task and its program.

        Raises:
            CallError: NO_WRITE_RIGHT; PROGRAM_RUNNING.
        """
        self._caller.require_write()
        self._state.tasks.delete(self._task)

    def get_file_name(self) -> str:
        """Return the path of the program's file."""
        return self._task.name + SUFFIX

    def execute(self, command: str, parameter: Variant) -> Value:  # noqa: ARG002 - commands have no parameters
        """Execute an extended command: ``GetStatus`` returns a :class:`~orinkit.rc8.task_modes.TaskStatus`, 0 to 4."""
        self._caller.require_read()
        if command.strip().lower() != "getstatus":
            raise error_for(hresult.E_INVALID_CMD_NAME, f"{command:.40}")
        return _status(self)

    def get_variable(self, name: str, option: str) -> VariableObject:  # noqa: ARG002
        """Connect to a variable of the task."""
        entry = TASK_VARIABLES.get(name.strip().upper())
        if entry is None:
            raise not_found(name)
        return TaskVariableObject(self._caller, self, entry)

    def get_variable_names(self, option: str) -> Sequence[str]:  # noqa: ARG002
        """Return the names of the task's variables."""
        return list(TASK_VARIABLES)

    @property
    def task(self) -> Task:
        """The task."""
        return self._task

    @property
    def exists(self) -> bool:
        """True if the program still exists."""
        return self._state.tasks.exists(self._task)


def _status(served: RC8Task) -> int:
    return int(served.task.status) if served.exists else TaskStatus.NON_EXISTENT


@dataclass(frozen=True, slots=True)
class TaskVariable:
    """A row of the table of a task's variables.

    The attributes have the same meaning as in :class:`~orinkit.virtual.rc8.objects.system_variables.SystemVariable`.
    """

    name: str
    vt: VarType
    read: Callable[[RC8Task], Any]
    text: str


TASK_VARIABLES: Final[dict[str, TaskVariable]] = {
    entry.name: entry
    for entry in (
        TaskVariable("@STATUS", VarType.I4, _status, N_("Status, as returned by GetStatus")),
        TaskVariable("@PRIORITY", VarType.I4, lambda _: PRIORITY, N_("Priority")),
        TaskVariable("@LINE_NO", VarType.I4, lambda served: served.task.line, N_("Line to be executed next")),
        TaskVariable("@CYCLE_TIME", VarType.I4, lambda served: ms_from_seconds(served.task.cycle_seconds),
                     N_("Duration of the last cycle [ms]")),
        TaskVariable("@ELAPSED_TIME", VarType.I4, lambda served: ms_from_seconds(served.task.elapsed),
                     N_("Time since the start [ms]")),
        TaskVariable("@FILE_NAME", VarType.BSTR, lambda served: served.task.name + SUFFIX, N_("File")),
    )
}  # fmt: skip
"""The table of a task's variables, by name."""


class TaskVariableObject(VariableObject):
    """A variable of a task; read-only."""

    def __init__(self, caller: ClientContext, served: RC8Task, entry: TaskVariable) -> None:
        super().__init__(entry.name, attribute=1, help=caller.state.say(entry.text))
        self._caller = caller
        self._served = served
        self._entry = entry

    def get_value(self) -> Value:
        """Return the current value."""
        self._caller.require_read()
        return Variant(self._entry.vt, self._entry.read(self._served))


def find_task(caller: ClientContext, name: str) -> RC8Task:
    """Return a client's Task object for a program.

    Raises:
        CallError: NO_READ_RIGHT; E_CAO_OBJECT_NOTFOUND.
    """
    caller.require_read()
    return RC8Task(caller, caller.state.tasks.find(name), name)


def run_file(caller: ClientContext, name: str, option: str) -> str | BlockingCall:  # noqa: ARG001 - no options exist
    """Run a program once (File_Run) and return the name of its task.

    Raises:
        CallError: Errors of :meth:`RC8Task.start`.
    """
    served = find_task(caller, name)
    loading = served.start(TaskMode.CYCLE, "")
    if loading is None:
        return served.task.name

    def run() -> str:
        loading.run()
        return served.task.name

    return BlockingCall(run)


def _mode(kind: type[E], mode: int) -> E:
    try:
        return kind(mode)
    except ValueError:
        known = ", ".join(f"{int(each)}" for each in kind)
        raise error_for(hresult.E_INVALIDARG, tr("mode {mode} is not one of {modes}", mode=mode, modes=known)) from None
