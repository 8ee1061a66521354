"""The asynchronous client: :func:`connect` and the objects of a controller.

Every method is one call of the table; there is no logic here that the protocol core does not have. The synchronous
twin is made from this file: ``async`` and ``await`` go away, and ``get_x``/``put_x`` without arguments of their own
become a property ``x`` as well.
"""

from __future__ import annotations

from typing import Any, Concatenate, ParamSpec, TypeVar

from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao import functions as f
from orinkit.cao.dialect import RC8 as RC8_DIALECT
from orinkit.cao.dialect import VE026A
from orinkit.cao.replies import Trace
from orinkit.cao.table import Function
from orinkit.client._async.client import AsyncClient
from orinkit.client._async.objects import AsyncNamedObject, AsyncObjectBase, AsyncObjectContainer
from orinkit.client._async.robot import AsyncRobot
from orinkit.client._async.task import AsyncTask
from orinkit.client._shared.common import (
    RC8,
    ErrorInfo,
    ObjectFunctions,
    check_alive,
    check_content,
    check_deadline,
    check_watchdog,
    dialect_of,
    error_count,
    error_info,
    file_data,
    file_option,
    file_text,
    is_no_file,
    is_ve026a,
    moment,
    no_code,
    no_such_error,
    service_option,
    text_list,
    with_alive,
)
from orinkit.client._shared.robot import sendable
from orinkit.core import hresult
from orinkit.core.errors import CallError, ObjectNotFound, OrinError
from orinkit.transport.runner import Deadline
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Value

P = ParamSpec("P")
R = TypeVar("R")
N = TypeVar("N", bound="AsyncObjectBase")


class AsyncExtension(AsyncObjectContainer):
    """An extension board, for example a hand."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.extension_release, f.extension_get_attribute, f.extension_get_help, f.extension_get_name,
        f.extension_get_tag, f.extension_put_tag, f.extension_get_id, f.extension_put_id,
        f.extension_get_variable, f.extension_get_variable_names, f.extension_execute,
    )  # fmt: skip


class AsyncFile(AsyncObjectContainer):
    """A file or folder of the controller.

    One that is not there yet may be connected to: setting its text or data makes it, and its folders; everything else
    is refused until it is there.
    """

    __slots__ = ("_missing",)

    functions = ObjectFunctions(
        f.file_release, f.file_get_attribute, f.file_get_help, f.file_get_name,
        f.file_get_tag, f.file_put_tag, f.file_get_id, f.file_put_id,
        f.file_get_variable, f.file_get_variable_names, f.file_execute,
    )  # fmt: skip

    def __init__(self, client: AsyncClient, handle: int, label: str, parent: AsyncObjectBase | None = None) -> None:
        super().__init__(client, handle, label, parent)
        self._missing: tuple[AsyncObjectContainer, Function[[int, str, str], int], str] | None = None

    async def file(self, name: str, option: str = "", *, create: bool = False) -> AsyncFile:
        """Connect to a file below this folder; with ``create`` it is made if it is not there."""
        return await _file(self, f.file_get_file, name, option, create=create)

    async def get_exists(self) -> bool:
        """Whether the file is there: False until its text or data are set."""
        if self._missing is not None:
            try:
                await self._appear(create=False)
            except CallError as error:
                if is_no_file(error):
                    return False
                raise
        return True

    async def _call(self, function: Function[Concatenate[int, P], R], *args: P.args, **kwargs: P.kwargs) -> R:
        if self._missing is not None:
            await self._appear(create=function is f.file_put_value)
        return await super()._call(function, *args, **kwargs)

    async def _appear(self, *, create: bool) -> None:
        """Connect to the file after all, which is made if it may be."""
        self._require_open()
        if self._missing is None:
            return
        owner, function, option = self._missing
        try:
            handle = await owner._call(function, self._label, file_option(option, create=create))
        except CallError as error:
            error.subject = self._label
            raise
        self.handle, self._missing = handle, None
        owner._adopt(self)

    async def file_names(self, option: str = "") -> list[str]:
        """Names of the files below this one."""
        return text_list(await self._call(f.file_get_file_names, option))

    async def copy(self, name: str, option: str = "") -> None:
        """Copy the file to another name."""
        await self._call(f.file_copy, name, option)

    async def delete(self, option: str = "") -> None:
        """Delete the file."""
        await self._call(f.file_delete, option)

    async def move(self, name: str, option: str = "") -> None:
        """Move or rename the file."""
        await self._call(f.file_move, name, option)

    async def run(self, option: str = "") -> str:
        """Run the program, one cycle, and return the name of its task."""
        return await self._call(f.file_run, option)

    async def get_date_created(self) -> Any:
        """When the file was created: a local ``datetime`` where the controller's answer can be read as one."""
        return moment(await self._call(f.file_get_date_created))

    async def get_date_last_accessed(self) -> Any:
        """When the file was last read."""
        return moment(await self._call(f.file_get_date_last_accessed))

    async def get_date_last_modified(self) -> Any:
        """When the file was last changed."""
        return moment(await self._call(f.file_get_date_last_modified))

    async def get_names(self) -> list[str]:
        """Names of the files below this folder."""
        return await self.file_names()

    async def get_text(self) -> str:
        """Content as text.

        Raises:
            InvalidValue: it is none; ``data`` has the bytes.
        """
        return file_text(await self.get_value())

    async def put_text(self, text: str) -> None:
        """Set the content to text."""
        await self.put_value(check_content(str, text))

    async def get_data(self) -> bytes:
        """Content as bytes; of a file that the controller answers as text, that text in UTF-8."""
        return file_data(await self.get_value())

    async def put_data(self, data: bytes) -> None:
        """Set the content to bytes."""
        await self.put_value(check_content(bytes, data))

    async def get_path(self) -> str:
        """Path in the controller."""
        return await self._call(f.file_get_path)

    async def get_size(self) -> int:
        """Size in bytes."""
        return await self._call(f.file_get_size)

    async def get_type(self) -> str:
        """Type of the file."""
        return await self._call(f.file_get_type)

    async def get_value(self) -> Any:
        """Content."""
        return await self._call(f.file_get_value)

    async def put_value(self, value: Value) -> None:
        """Set the content."""
        await self._call(f.file_put_value, value)


class AsyncCommand(AsyncNamedObject):
    """A command that can be started, watched and cancelled."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.command_release, f.command_get_attribute, f.command_get_help, f.command_get_name,
        f.command_get_tag, f.command_put_tag, f.command_get_id, f.command_put_id,
    )  # fmt: skip

    async def execute(self, mode: int = 0) -> None:
        """Execute: 0 wait for the end, 1 return at once."""
        await self._call(f.command_execute, mode)

    async def cancel(self) -> None:
        """Cancel the running command."""
        await self._call(f.command_cancel)

    async def get_timeout(self) -> int:
        """Time-out in ms."""
        return await self._call(f.command_get_timeout)

    async def put_timeout(self, timeout: int) -> None:
        """Set the time-out in ms."""
        await self._call(f.command_put_timeout, timeout)

    async def get_state(self) -> int:
        """State of the command."""
        return await self._call(f.command_get_state)

    async def get_parameters(self) -> Any:
        """Parameters."""
        return await self._call(f.command_get_parameters)

    async def put_parameters(self, parameters: Value) -> None:
        """Set the parameters; ``P(...)``, ``J(...)``, ``T(...)`` and ``V(...)`` in them go out as their texts."""
        await self._call(f.command_put_parameters, sendable(parameters))

    async def get_result(self) -> Any:
        """Result of the last execution."""
        return await self._call(f.command_get_result)


class AsyncMessage(AsyncObjectBase):
    """An event that the controller reported."""

    __slots__ = ()

    functions = ObjectFunctions(f.message_release)

    async def reply(self, value: Value = None) -> None:
        """Answer the event."""
        await self._call(f.message_reply, value)

    async def clear(self) -> None:
        """Clear the event."""
        await self._call(f.message_clear)

    async def get_date_time(self) -> Any:
        """When it happened, local ``datetime`` of the controller."""
        return await self._call(f.message_get_date_time)

    async def get_description(self) -> str:
        """What happened, in words."""
        return await self._call(f.message_get_description)

    async def get_destination(self) -> str:
        """Whom it is for."""
        return await self._call(f.message_get_destination)

    async def get_number(self) -> int:
        """Number that tells the kind of event."""
        return await self._call(f.message_get_number)

    async def get_serial_number(self) -> int:
        """Serial number of the message."""
        return await self._call(f.message_get_serial_number)

    async def get_source(self) -> str:
        """Where it came from."""
        return await self._call(f.message_get_source)

    async def get_value(self) -> Any:
        """Value that came with it."""
        return await self._call(f.message_get_value)


class AsyncController(AsyncObjectContainer):
    """A controller; :func:`connect` makes one. Closing it releases everything and closes the connection."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.controller_disconnect, f.controller_get_attribute, f.controller_get_help, f.controller_get_name,
        f.controller_get_tag, f.controller_put_tag, f.controller_get_id, f.controller_put_id,
        f.controller_get_variable, f.controller_get_variable_names, f.controller_execute,
    )  # fmt: skip

    async def extension(self, name: str, option: str = "") -> AsyncExtension:
        """Connect to an extension board by name."""
        return await self._child(AsyncExtension, f.controller_get_extension, name, option)

    async def file(self, name: str, option: str = "", *, create: bool = False) -> AsyncFile:
        r"""Connect to a file or folder by name, ``dir\Pro1.pcs``.

        Args:
            name: from the root folder; that of a folder may end in a separator.
            option: of Controller_GetFile.
            create: make it if it is not there. Without, a file that is not there is made when its text or data are set.
        """
        return await _file(self, f.controller_get_file, name, option, create=create)

    async def robot(self, name: str = "Arm", option: str = "") -> AsyncRobot:
        """Connect to a robot; the name is free, option ``ID=1`` picks the second arm."""
        return await self._child(AsyncRobot, f.controller_get_robot, name, option)

    async def task(self, name: str, option: str = "") -> AsyncTask:
        """Connect to a task by name."""
        return await self._child(AsyncTask, f.controller_get_task, name, option)

    async def command(self, name: str, option: str = "") -> AsyncCommand:
        """Connect to a command by name."""
        return await self._child(AsyncCommand, f.controller_get_command, name, option)

    async def message(self) -> AsyncMessage | None:
        """Fetch the oldest waiting event; ``None`` when none waits."""
        try:
            handle = await self._call(f.controller_get_message)
        except ObjectNotFound:
            return None
        message = AsyncMessage(self.client, handle, "message", self)
        self._adopt(message)
        return message

    async def extension_names(self, option: str = "") -> list[str]:
        """Names of the extension boards."""
        return text_list(await self._call(f.controller_get_extension_names, option))

    async def file_names(self, option: str = "") -> list[str]:
        """Names of the files."""
        return text_list(await self._call(f.controller_get_file_names, option))

    async def robot_names(self, option: str = "") -> list[str]:
        """Names of the robots."""
        return text_list(await self._call(f.controller_get_robot_names, option))

    async def task_names(self, option: str = "") -> list[str]:
        """Names of the tasks."""
        return text_list(await self._call(f.controller_get_task_names, option))

    async def command_names(self, option: str = "") -> list[str]:
        """Names of the commands."""
        return text_list(await self._call(f.controller_get_command_names, option))

    async def errors(self) -> list[ErrorInfo]:
        """Errors that the controller reports now, newest first (GetCurErrorCount, GetCurErrorInfo)."""
        errors: list[ErrorInfo] = []
        for index in range(error_count(await self.execute("GetCurErrorCount"))):
            try:
                errors.append(error_info(await self.execute("GetCurErrorInfo", index)))
            except CallError as error:
                if not no_such_error(error):
                    raise
                break  # somebody has cleared errors meanwhile
        return errors

    async def clear_error(self) -> None:
        """Clear the controller's errors (RC8 3.3.6)."""
        await self.execute("ClearError", no_code(self.client.dialect))

    async def error_description(self, code: int) -> str:
        """Return the controller's own text for a code."""
        return str(await self.execute("GetErrorDescription", hresult.signed(code)))

    async def close(self, *, deadline: float | None = None) -> None:
        """Release everything, newest first, disconnect, stop the service, close the connection.

        Args:
            deadline: seconds for asking the controller, even if it says that it is at work; then the connection is closed,
                which says the same. By default three time-outs (of all tries), at least 3 s.
        """
        if not self._open:
            return
        limit = check_deadline(deadline)
        self.client.end_within(self.client.usual_deadline() if limit is None else limit)
        try:
            if await self._let_go():
                await self.client.call(f.service_stop)
        except OrinError:  # closing the connection says the same
            pass
        finally:
            await self.client.close()


async def _file(
    owner: AsyncObjectContainer, function: Function[[int, str, str], int], name: str, option: str, *, create: bool
) -> AsyncFile:
    """Connect to a file below an object; one that is not there, and is not to be made, gets no handle yet."""
    try:
        return await owner._child(AsyncFile, function, name, file_option(option, create=create))
    except CallError as error:
        if create or not is_no_file(error):
            raise
    file = AsyncFile(owner.client, 0, name, owner)
    file._missing = (owner, function, option)
    return file


async def connect(
    url: str,
    *,
    provider: str = RC8,
    name: str = "",
    machine: str = "localhost",
    option: str = "",
    timeout: float | None = None,
    tries: int = DEFAULT_TRIES,
    service: str | None = None,
    limits: PacketLimits = DEFAULT_LIMITS,
    trace: Trace | None = None,
    dialect: str | None = None,
    token: str = "",
    cafile: str = "",
    dead_after: float = DEAD_AFTER,
    alive: float | None = None,
    deadline: float | None = None,
) -> AsyncController:
    """Connect to a controller: open the connection, Service_Start, Controller_Connect (RC8 3.1).

    Args:
        url: ``tcp://192.168.0.1:5007``, ``udp://192.168.0.1:5007``, ``serial:///dev/ttyUSB0?baudrate=38400``; DENSO's
            ``tcp:192.168.0.1:5007``, ``udp:192.168.0.1:5007``, ``com:1:38400:N:8:1:0`` too. ``http://192.168.0.1:8080/path``
            and ``https://...`` for e-CAP.
        provider: provider name; RC9 and COBOTTA PRO want ``CaoProv.DENSO.VRC9``, RC7 ``CaoProv.DENSO.NetwoRC``.
        name: name of the controller in this connection; empty lets the controller choose.
        machine: machine name; controllers take ``localhost`` or their own address.
        option: connection options, for example ``@IfNotMember``.
        timeout: seconds for connecting and for each call; with UDP and serial lines for each try of a call, so that it
            may take ``timeout * tries`` in all. By default 3.0 with TCP and HTTP, 0.5 with the others.
        tries: how often a request is sent in all with UDP and serial lines, 1 to 7 (RC8 table 5-1: TORetry); the
            controller carries it out once. With TCP and HTTP nothing is sent twice.
        service: option of Service_Start; by default a watchdog (``WDT=400``), so that a long call outlasts the time-out. On
            a serial line none: there the answer to a repeated request tells that the controller is still at work. With
            HTTP none: the request itself asks for it.
        limits: bounds on what is received.
        trace: is told every packet, or body of e-CAP: ``">"`` or ``"<"``, and its bytes.
        dialect: ``"rc8"`` or ``"ve026a"``. By default the second where the provider's name is empty or has ``VE026A`` in
            it; on a serial line, and with UDP where its answers are of that form, where the controller's ``@VERSION`` has;
            otherwise the first.
        token: for HTTP, what lets a client in; it is sent as ``Authorization: Bearer``.
        cafile: for https, a PEM file of certificates that the server's is to be signed by, instead of the system's.
        dead_after: seconds without an answer from the controller's machine after which a TCP connection counts as lost
            (cable pulled, machine off): 2 to 7,200.
        alive: ties motion to this program: if nothing is heard of it for that many seconds while the arm moves, the
            server stops the arm, though the connection stands; 0.3 to 3,600. Signs of life are sent by a thread (in
            asyncio by a task), so a program that is stopped (SIGSTOP) or, in asyncio, whose event loop is blocked, shows
            none. An option of orinkit's servers (``Alive=`` in Service_Start), which other controllers may not know.
        deadline: seconds that connecting may take in all, even if the controller says that it is at work; by default three
            time-outs (of all tries), at least 3 s. Calls have none unless ``client.deadline`` is set.

    Raises:
        InvalidAddress: the URL cannot be used.
        InvalidValue: there is no such dialect, or another value cannot be used.
        ConnectFailed: nobody there.
        CallTimeout: nobody answers.
        CallError: the controller refuses.
        MissingExtra: serial lines need serialx, HTTP needs httpx2.
    """
    known = dialect_of(dialect, provider)
    check_alive(alive, service, known or RC8_DIALECT)
    end = Deadline(check_deadline(deadline))
    client = await AsyncClient.open(
        url, timeout=timeout, tries=tries, limits=limits, trace=trace, token=token, cafile=cafile, dead_after=dead_after,
        deadline=deadline,
    )  # fmt: skip
    try:
        client.end_within(client.usual_deadline() if deadline is None else end.left)
        client.dialect = known or client.dialect
        shown = alive is not None and client.profile.lossy  # by the tries of a call, which S_EXECUTING would put off
        if shown:
            check_watchdog(service)
        asked = service if shown else service_option(service, client.profile, client.dialect, client.timeout)
        await client.call(f.service_start, with_alive(asked, alive))
        handle = await client.call(f.controller_connect, name, provider, machine, option)
        controller = AsyncController(client, handle, name or provider)
        if known is None and (client.profile.shared or client.echoes) and is_ve026a(await _version(controller)):
            client.dialect = VE026A
        if alive is not None:
            await client.promise(alive, handle)
        client.end_within(None)
    except BaseException:
        await client.close()
        raise
    return controller


async def _version(controller: AsyncController) -> Any:
    try:
        async with await controller.variable("@VERSION") as version:
            return await version.get_value()
    except CallError:  # it does not tell
        return ""
