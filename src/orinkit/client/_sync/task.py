"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``task.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from orinkit.cao import functions as f
from orinkit.client._shared.common import (
    ObjectFunctions,
    error_count,
    error_info,
    is_program,
    logged_message,
    program_error,
    task_mode,
    task_status,
)
from orinkit.client._shared.motion import POLL
from orinkit.client._sync.objects import ObjectContainer
from orinkit.core import hresult
from orinkit.core.errors import CallError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.rc8.task_modes import StopMode, StopName, TaskMode, TaskName, TaskStatus
from orinkit.transport.runner import Deadline, sleep


class Task(ObjectContainer):
    """A task: a program of a controller that can run (RC8 3.2)."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.task_release, f.task_get_attribute, f.task_get_help, f.task_get_name,
        f.task_get_tag, f.task_put_tag, f.task_get_id, f.task_put_id,
        f.task_get_variable, f.task_get_variable_names, f.task_execute,
    )  # fmt: skip

    def start(self, mode: TaskMode | TaskName | int = TaskMode.CYCLE, option: str = "") -> None:
        """Start the program, or resume it if it is suspended.

        Args:
            mode: ``"cycle"`` (1) to run it once, ``"continuous"`` (2) to repeat it, ``"step"`` (3) to execute one
                statement.
            option: Option string of Task_Start.

        Raises:
            CallError: If the controller refuses. For SYNTAX_ERROR, the attribute ``detail`` of the exception is the
                text from the controller's error log.
        """
        try:
            self._call(f.task_start, task_mode(TaskMode, mode), option)
        except CallError as error:
            if error.code == hresult.SYNTAX_ERROR and not error.detail:
                error.detail = self._logged(error.code)
            raise

    def stop(self, mode: StopMode | StopName | int = StopMode.DEFAULT, option: str = "") -> None:
        """Stop the program.

        Args:
            mode: ``"default"`` (0), ``"instant"`` (1) immediately, ``"step"`` (2) after the current statement,
                ``"cycle"`` (3) after the current cycle, ``"initialize"`` (4).
            option: Option string of Task_Stop.
        """
        self._call(f.task_stop, task_mode(StopMode, mode), option)

    def wait(self, timeout: float | None = None, *, check: bool = False) -> TaskStatus:
        """Wait until the program no longer runs; return its status.

        After an error, the status of the program is READY. The error is then in ``errors()`` of the controller; with
        ``check``, it is raised.

        Args:
            timeout: Maximum time to wait in s; the default is no limit.
            check: True to raise the error that the controller reports for this program, if any.

        Raises:
            TimeoutError: If the program still runs after the time-out.
            CallError: With ``check``, the error that ended the program.
        """
        deadline = Deadline(timeout)
        while (status := self.get_status()) is TaskStatus.RUNNING:
            if timeout is not None and deadline.passed:
                raise TimeoutError(tr("the task still runs after {seconds:g} s", seconds=timeout))
            sleep(min(POLL, deadline.left))
        if check:
            self._check()
        return status

    def get_status(self) -> TaskStatus:
        """Return the status of the program (GetStatus)."""
        return task_status(self.execute("GetStatus"))

    def get_running(self) -> bool:
        """Return True if the program runs."""
        return self.get_status() is TaskStatus.RUNNING

    def get_line(self) -> int:
        """Return the line of the program that is executed next (@LINE_NO)."""
        with self.variable("@LINE_NO") as variable:
            value = variable.get_value()
        return int(value[0] if isinstance(value, list) else value)  # line and file, or the line alone

    def delete(self, option: str = "") -> None:
        """Delete the task."""
        self._call(f.task_delete, option)

    def get_file_name(self) -> str:
        """Return the name of the program file of the task."""
        return self._call(f.task_get_file_name)

    def _check(self) -> None:
        """Raise the newest error that the controller reports for this program, if any."""
        if not isinstance(self._parent, ObjectContainer):
            return
        for index in range(error_count(self._parent.execute("GetCurErrorCount"))):
            info = error_info(self._parent.execute("GetCurErrorInfo", index))
            if is_program(info.program, self._label):
                raise program_error(info, self._label)

    def _logged(self, code: int) -> str:
        """Return the message of the newest record in the error log, if the record has this code; otherwise ``""``."""
        if not isinstance(self._parent, ObjectContainer):
            return ""
        try:
            return logged_message(self._parent.execute("GetErrorLog", 0), code)
        except (CallError, ProtocolError):  # the message is only a hint
            return ""

    @property
    def status(self) -> TaskStatus:
        """Return the status of the program (GetStatus)."""
        return self.get_status()

    @property
    def running(self) -> bool:
        """Return True if the program runs."""
        return self.get_running()

    @property
    def line(self) -> int:
        """Return the line of the program that is executed next (@LINE_NO)."""
        return self.get_line()

    @property
    def file_name(self) -> str:
        """Return the name of the program file of the task."""
        return self.get_file_name()
