"""Task objects and their variables (RC8 3.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, Final, TypeVar

from orinkit.cao.provider import Deferred, TaskObject, VariableObject, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import N_, tr
from orinkit.core.record import record
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.values.variant import ARRAY, Value, Variant, VarType
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.files.names import SEPARATOR
from orinkit.virtual.rc8.objects.file import require_program
from orinkit.virtual.rc8.permission import AccessRight
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.task import HIGHEST_PRIORITY, LOWEST_PRIORITY, Task, is_supervisory
from orinkit.virtual.rc8.tasks import SUFFIX, ms_from_seconds
from orinkit.virtual.rc8.variables import conversion

E = TypeVar("E", bound=IntEnum)
T = TypeVar("T")


class RC8Task(TaskObject):
    """The Task object of one client."""

    def __init__(self, caller: ClientContext, task: Task, name: str) -> None:
        text = caller.state.say("Task of the program")
        super().__init__(name, attribute=int(caller.access), help=f"{text} {task.name}{SUFFIX}")
        self._caller = caller
        self._state = caller.state
        self._path = task.name  # not the task itself: if the program is deleted and created again, it has a new task

    @property
    def task(self) -> Task:
        """The task."""
        with self._state.cycles:
            return self._state.tasks.get_or_create(self._path)

    def start(self, mode: int, option: str) -> Deferred[None] | None:
        """Start the task, or continue it if it is suspended (RC8 3.2.2).

        Modes: 1 one cycle (the whole program once), 2 continuous, 3 one statement, 4 one statement backward. A step
        backward returns to the statement of the previous step, and moves the arm back to where it was before this
        statement; the statement is not executed, and variables keep their values. The program is loaded in a thread.
        If it is stopped meanwhile, alone or with all others, the call fails with E_CANCEL. If the client disconnects
        meanwhile, the program is not started.

        Raises:
            CallError: SYNTAX_ERROR; PROGRAM_RUNNING; E_INVALIDARG if the mode is unknown; E_BUSY_PROC if other programs
                are being loaded; other codes if the state of the controller does not allow the start.
        """
        wanted = _mode(TaskMode, mode)
        return _when_loaded(self._caller, self._path, lambda done: self.load_and_start(wanted, done))

    def load_and_start(self, mode: TaskMode, done: Deferred[Any]) -> None:
        """Load the program and start the task; call this method in the thread that loads programs.

        Args:
            mode: The mode.
            done: The result of the call; if it is set, the start has been cancelled.

        Raises:
            CallError: As for :meth:`start`.
        """
        state, task = self._state, self.task
        program = state.load_program(task, self._caller.origin)
        with state.cycles:
            if done.done():
                raise error_for(hresult.E_CANCEL, task.name)
            require(_start_condition(task.name), state.arm, self._caller)  # the state may have changed meanwhile
            state.tasks.start(task, program, mode)

    def stop(self, mode: int, option: str) -> None:
        """Stop the task (RC8 3.2.2).

        Modes: 0 and 1 immediately, 2 after the statement, 3 after the cycle, 4 immediately and reset to the beginning.

        Raises:
            CallError: NO_WRITE_RIGHT; E_INVALIDARG if the mode is unknown.
        """
        wanted = _mode(StopMode, mode)
        require("Task_Stop", self._state.arm, self._caller)
        self._state.tasks.stop(self.task, wanted)

    def delete(self, option: str) -> Deferred[None] | None:
        """Delete the task and its program.

        Raises:
            CallError: NO_WRITE_RIGHT; PROGRAM_RUNNING.
        """
        self._caller.require_write()
        return self._state.disk.run(lambda: self._state.tasks.delete(self.task))

    def get_file_name(self) -> str:
        """Return the path of the program's file."""
        return self.task.name + SUFFIX

    def execute(self, command: str, parameter: Variant) -> Value | Deferred[Value]:
        """Execute an extended command of :data:`TASK_COMMANDS`.

        ``GetStatus`` returns a :class:`~orinkit.rc8.task_modes.TaskStatus`, 0 to 4; ``GetThreadPriority`` and
        ``SetThreadPriority`` read and set the priority, -2 to 2.

        Raises:
            CallError: NO_READ_RIGHT; NO_WRITE_RIGHT; E_INVALID_CMD_NAME; VALUE_OUT_OF_RANGE.
        """
        self._caller.require_read()
        run = TASK_COMMANDS.get(command.strip().lower())
        if run is None:
            raise error_for(hresult.E_INVALID_CMD_NAME, f"{command:.40}")
        return run(self, parameter)

    def set_priority(self, priority: int) -> None:
        """Set the priority of the task.

        Raises:
            CallError: NO_WRITE_RIGHT; VALUE_OUT_OF_RANGE.
        """
        self._caller.require_write()
        if not LOWEST_PRIORITY <= priority <= HIGHEST_PRIORITY:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("priority {priority} is not in -2 to 2", priority=priority),
            )
        self.task.priority = priority

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Connect to a variable of the task."""
        entry = TASK_VARIABLES.get(name.strip().upper())
        if entry is None:
            raise not_found(name)
        return TaskVariableObject(self._caller, self, entry)

    def get_variable_names(self, option: str) -> Sequence[str]:
        """Return the names of the task's variables."""
        return list(TASK_VARIABLES)

    @property
    def file_number(self) -> int:
        """The number of the program's file: the ID of its File object."""
        return self._state.files.number(self._path + SUFFIX)

    @property
    def exists(self) -> bool:
        """True if the program still exists; accesses the disk."""
        return self._state.tasks.exists(self.task)

    def when_found(self, read: Callable[[], T]) -> T | Deferred[T]:
        """Return the result of a function that uses :attr:`exists`.

        Usually, the program exists and has the same name on the disk as the task, so that it is found immediately.
        Otherwise, the function is called in the thread that accesses the disk.
        """
        return read() if self._state.tasks.is_found(self.task) else self._state.disk.run(read)


def _status(served: RC8Task) -> int:
    return int(served.task.status) if served.exists else TaskStatus.NON_EXISTENT


def _details(served: RC8Task) -> int:
    return served.task.details if served.exists else TaskStatus.NON_EXISTENT


def _set_priority(served: RC8Task, parameter: Variant) -> None:
    (priority,) = parameters.whole_numbers(parameter, 0)
    served.set_priority(priority)


TASK_COMMANDS: Final[dict[str, Callable[[RC8Task, Variant], Value | Deferred[Value]]]] = {
    "getstatus": lambda served, _: served.when_found(lambda: _status(served)),
    "getthreadpriority": lambda served, _: served.task.priority,
    "setthreadpriority": _set_priority,
}
"""The commands of Task_Execute, by name in lower case."""


@record
class TaskVariable:
    """A row of the table of a task's variables.

    The attributes have the same meaning as in :class:`~orinkit.virtual.rc8.objects.system_variables.SystemVariable`.
    """

    name: str
    vt: int
    read: Callable[[RC8Task], Any] | None
    text: str
    write: Callable[[RC8Task, int], Deferred[None] | None] | None = None


def _line(served: RC8Task) -> list[int]:
    return [served.task.line, served.file_number]


def _start(served: RC8Task, mode: int) -> Deferred[None] | None:
    return served.start(mode, "")


def _stop(served: RC8Task, mode: int) -> None:
    served.stop(mode, "")


TASK_VARIABLES: Final[dict[str, TaskVariable]] = {
    entry.name: entry
    for entry in (
        TaskVariable("@STATUS", VarType.I4, _status, N_("Status, as returned by GetStatus")),
        TaskVariable("@STATUS_DETAILS", VarType.I4, _details,
                     N_("Status; 5 stopped by SuspendAll, 6 waiting, 7 waiting in a Delay")),
        TaskVariable("@PRIORITY", VarType.I4, None, N_("Not supported; use GetThreadPriority and SetThreadPriority")),
        TaskVariable("@START", VarType.I4, None, N_("Starts the task in the written mode"), _start),
        TaskVariable("@STOP", VarType.I4, None, N_("Stops the task in the written mode"), _stop),
        TaskVariable("@LINE_NO", VarType.I4 | ARRAY, _line, N_("Line to be executed next, and the ID of the file")),
        TaskVariable("@CYCLE_TIME", VarType.I4, lambda served: ms_from_seconds(served.task.cycle_seconds),
                     N_("Duration of the last cycle [ms]")),
        TaskVariable("@ELAPSED_TIME", VarType.I4, lambda served: ms_from_seconds(served.task.elapsed),
                     N_("Time since the start [ms]")),
        TaskVariable("@FILE_NAME", VarType.BSTR, lambda served: served.task.name + SUFFIX, N_("File")),
    )
}  # fmt: skip
"""The table of a task's variables, by name."""


class TaskVariableObject(VariableObject):
    """A variable of a task, for one client."""

    def __init__(self, caller: ClientContext, served: RC8Task, entry: TaskVariable) -> None:
        own = (AccessRight.READ if entry.read else 0) | (AccessRight.WRITE if entry.write else 0)
        super().__init__(entry.name, attribute=int(own & caller.access), help=caller.state.say(entry.text))
        self._caller = caller
        self._served = served
        self._entry = entry

    def get_value(self) -> Value | Deferred[Value]:
        """Return the current value.

        With ``strict``, ``@LINE_NO`` is the line alone.

        Raises:
            CallError: NO_READ_RIGHT; E_NOTIMPL if the variable can only be written or is not supported.
        """
        self._caller.require_read()
        read = self._entry.read
        if read is None:
            raise error_for(hresult.E_NOTIMPL, self.name)
        return self._served.when_found(lambda: self._typed(read(self._served)))

    def put_value(self, value: Variant) -> Deferred[None] | None:
        """Set the value: start or stop the task.

        Raises:
            CallError: NO_WRITE_RIGHT; E_CAO_NOT_WRITABLE; errors of :meth:`RC8Task.start` and :meth:`RC8Task.stop`.
        """
        self._caller.require_write()
        if self._entry.write is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, self.name)
        return self._entry.write(self._served, conversion.whole(value))

    def _typed(self, value: Any) -> Variant:
        if isinstance(value, list) and self._caller.state.switches.strict:
            return Variant(self._entry.vt & ~ARRAY, value[0])
        return Variant(self._entry.vt, value)


def find_task(caller: ClientContext, name: str) -> TaskObject | Deferred[TaskObject]:
    """Return a client's Task object for a program.

    Raises:
        CallError: NO_READ_RIGHT; E_CAO_OBJECT_NOTFOUND.
    """
    caller.require_read()
    return caller.state.disk.run(lambda: _find(caller, name))


def _find(caller: ClientContext, name: str) -> RC8Task:
    return RC8Task(caller, caller.state.tasks.find(name), name)


def run_file(caller: ClientContext, path: str, option: str) -> str | Deferred[str]:  # noqa: ARG001 - no options exist
    """Run a program once (File_Run) and return the name of its task.

    Args:
        caller: The client.
        path: Path of the file.
        option: Option of File_Run.

    Raises:
        CallError: Errors of :func:`~orinkit.virtual.rc8.objects.file.require_program` and of :meth:`RC8Task.start`.
    """

    def run(done: Deferred[Any]) -> str:
        require_program(caller, caller.state.files, path)
        served = _find(caller, path)
        served.load_and_start(TaskMode.CYCLE, done)
        return served.task.name

    return _when_loaded(caller, path.lstrip(SEPARATOR)[: -len(SUFFIX)], run)


def _when_loaded(caller: ClientContext, program: str, job: Callable[[Deferred[Any]], T]) -> T | Deferred[T]:
    """Load and start a program in the thread that loads programs, unless the start is cancelled meanwhile.

    Args:
        caller: The client.
        program: Name of the program, without suffix.
        job: Function that loads and starts the program; its argument is the result of the call.

    Raises:
        CallError: E_BUSY_PROC if too many starts wait; other codes if the state of the controller does not allow the
            start.
    """
    state = caller.state
    lane, done = state.compiling, Deferred[T](brief=True, revocable=True)
    with state.cycles:
        require(_start_condition(program), state.arm, caller)
        if not lane.immediate:
            lane.submit(lambda: job(done), done, caller)
            state.tasks.starts.add(caller, program, done)
            return done
    return job(done)


def _start_condition(program: str) -> str:
    """Return the name of the conditions under which a program may be started."""
    return "RunAllTsr" if is_supervisory(program) else "Task_Start"


def _mode(kind: type[E], mode: int) -> E:
    try:
        return kind(mode)
    except ValueError:
        known = ", ".join(f"{int(each)}" for each in kind)
        raise error_for(hresult.E_INVALIDARG, tr("mode {mode} is not one of {modes}", mode=mode, modes=known)) from None
