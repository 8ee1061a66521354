"""The asynchronous task: a program of the controller, started, stopped and waited for.

The synchronous twin is made from this file, as that of :mod:`orinkit.client._async.controller` is.
"""

from __future__ import annotations

from orinkit.cao import functions as f
from orinkit.client._async.objects import AsyncObjectContainer
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
from orinkit.core import hresult
from orinkit.core.errors import CallError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.rc8.task_modes import StopMode, StopName, TaskMode, TaskName, TaskStatus
from orinkit.transport.runner import Deadline, apause


class AsyncTask(AsyncObjectContainer):
    """A program task (RC8 3.2)."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.task_release, f.task_get_attribute, f.task_get_help, f.task_get_name,
        f.task_get_tag, f.task_put_tag, f.task_get_id, f.task_put_id,
        f.task_get_variable, f.task_get_variable_names, f.task_execute,
    )  # fmt: skip

    async def start(self, mode: TaskMode | TaskName | int = TaskMode.CYCLE, option: str = "") -> None:
        """Start the program, or go on with one that is suspended.

        Args:
            mode: ``"cycle"`` (1) once, ``"continuous"`` (2) again and again, ``"step"`` (3) one statement.
            option: of Task_Start.

        Raises:
            CallError: the controller refuses. SYNTAX_ERROR has what the controller's error log says of it.
        """
        try:
            await self._call(f.task_start, task_mode(TaskMode, mode), option)
        except CallError as error:
            if error.code == hresult.SYNTAX_ERROR and not error.detail:
                error.detail = await self._logged(error.code)
            raise

    async def stop(self, mode: StopMode | StopName | int = StopMode.DEFAULT, option: str = "") -> None:
        """Stop: ``"default"`` (0), ``"instant"`` (1), after the statement ``"step"`` (2) or ``"cycle"`` (3), ``"initialize"`` (4)."""
        await self._call(f.task_stop, task_mode(StopMode, mode), option)

    async def wait(self, timeout: float | None = None, *, check: bool = False) -> TaskStatus:
        """Wait until it does not run any more, and return its status.

        A program that an error has ended is ready again: what the error was is in the controller's ``errors()``, or is
        raised with ``check``.

        Args:
            timeout: seconds; by default as long as it takes.
            check: whether an error that the controller reports of this program is raised.

        Raises:
            TimeoutError: it still runs.
            CallError: with ``check``, the error that has ended the program.
        """
        deadline = Deadline(timeout)
        while (status := await self.get_status()) is TaskStatus.RUNNING:
            if timeout is not None and deadline.passed:
                raise TimeoutError(tr("the task still runs after {seconds:g} s", seconds=timeout))
            await apause(min(POLL, deadline.left))
        if check:
            await self._check()
        return status

    async def get_status(self) -> TaskStatus:
        """What it is doing (GetStatus)."""
        return task_status(await self.execute("GetStatus"))

    async def get_running(self) -> bool:
        """Whether it runs."""
        return await self.get_status() is TaskStatus.RUNNING

    async def get_line(self) -> int:
        """Line of the program that is executed next (@LINE_NO)."""
        async with await self.variable("@LINE_NO") as variable:
            return int(await variable.get_value())

    async def delete(self, option: str = "") -> None:
        """Delete the task."""
        await self._call(f.task_delete, option)

    async def get_file_name(self) -> str:
        """File that the task came from."""
        return await self._call(f.task_get_file_name)

    async def _check(self) -> None:
        """Raise the newest error of this program that the controller reports."""
        if not isinstance(self._parent, AsyncObjectContainer):
            return
        for index in range(error_count(await self._parent.execute("GetCurErrorCount"))):
            info = error_info(await self._parent.execute("GetCurErrorInfo", index))
            if is_program(info.program, self._label):
                raise program_error(info, self._label)

    async def _logged(self, code: int) -> str:
        """Return what the newest record of the error log says, if it is of this code."""
        if not isinstance(self._parent, AsyncObjectContainer):
            return ""
        try:
            return logged_message(await self._parent.execute("GetErrorLog", 0), code)
        except (CallError, ProtocolError):  # it is only a hint
            return ""
