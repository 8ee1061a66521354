"""The asynchronous client: :func:`connect` and the objects of a controller.

Most methods only call one CAO function. ``tools/make_sync.py`` generates the synchronous version from this file:
it removes ``async`` and ``await``, and adds a property ``x`` for each ``get_x``/``put_x`` without further arguments.
"""

from __future__ import annotations

from typing import Any

from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao import functions as f
from orinkit.cao.dialect import RC8 as RC8_DIALECT
from orinkit.cao.dialect import VE026A
from orinkit.cao.replies import Trace
from orinkit.client._async.client import AsyncClient
from orinkit.client._async.file import AsyncFile, connect_file
from orinkit.client._async.objects import AsyncNamedObject, AsyncObjectBase, AsyncObjectContainer
from orinkit.client._async.robot import AsyncRobot
from orinkit.client._async.task import AsyncTask
from orinkit.client._shared.common import (
    LOCALHOST,
    RC8,
    ErrorInfo,
    ObjectFunctions,
    check_alive,
    check_deadline,
    check_no_watchdog,
    clear_error_parameter,
    dialect_of,
    error_count,
    error_info,
    is_bad_index,
    is_ve026a,
    service_option,
    text_list,
    with_alive,
)
from orinkit.client._shared.connection_string import ConnectArguments, evaluate
from orinkit.client._shared.robot import sendable
from orinkit.core import hresult
from orinkit.core.errors import CallError, ObjectNotFound, OrinError
from orinkit.transport.runner import Deadline
from orinkit.transport.tcp_keepalive import DEAD_AFTER
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Value


class AsyncExtension(AsyncObjectContainer):
    """An extension board of a controller, for example a hand."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.extension_release, f.extension_get_attribute, f.extension_get_help, f.extension_get_name,
        f.extension_get_tag, f.extension_put_tag, f.extension_get_id, f.extension_put_id,
        f.extension_get_variable, f.extension_get_variable_names, f.extension_execute,
    )  # fmt: skip


class AsyncCommand(AsyncNamedObject):
    """A Command object: a command of a controller that can be executed, monitored and cancelled."""

    __slots__ = ()

    functions = ObjectFunctions(
        f.command_release, f.command_get_attribute, f.command_get_help, f.command_get_name,
        f.command_get_tag, f.command_put_tag, f.command_get_id, f.command_put_id,
    )  # fmt: skip

    async def execute(self, mode: int = 0) -> None:
        """Execute the command. Mode 0 waits for its end, mode 1 returns immediately."""
        await self._call(f.command_execute, mode)

    async def cancel(self) -> None:
        """Cancel the execution of the command."""
        await self._call(f.command_cancel)

    async def get_timeout(self) -> int:
        """Return the time-out of an execution of the command in ms."""
        return await self._call(f.command_get_timeout)

    async def put_timeout(self, timeout: int) -> None:
        """Set the time-out of an execution of the command in ms."""
        await self._call(f.command_put_timeout, timeout)

    async def get_state(self) -> int:
        """Return the state of the command."""
        return await self._call(f.command_get_state)

    async def get_parameters(self) -> Any:
        """Return the parameters."""
        return await self._call(f.command_get_parameters)

    async def put_parameters(self, parameters: Value) -> None:
        """Set the parameters; ``P(...)``, ``J(...)``, ``T(...)`` and ``V(...)`` in them are sent as text."""
        await self._call(f.command_put_parameters, sendable(parameters))

    async def get_result(self) -> Any:
        """Return the result of the last execution."""
        return await self._call(f.command_get_result)


class AsyncMessage(AsyncObjectBase):
    """An event that a controller reports (a Message object of CAO)."""

    __slots__ = ()

    functions = ObjectFunctions(f.message_release)

    async def reply(self, value: Value = None) -> None:
        """Reply to the event."""
        await self._call(f.message_reply, value)

    async def clear(self) -> None:
        """Clear the event."""
        await self._call(f.message_clear)

    async def get_date_time(self) -> Any:
        """Return the time of the event, as a ``datetime`` in the controller's local time."""
        return await self._call(f.message_get_date_time)

    async def get_description(self) -> str:
        """Return the description of the event."""
        return await self._call(f.message_get_description)

    async def get_destination(self) -> str:
        """Return the destination of the event."""
        return await self._call(f.message_get_destination)

    async def get_number(self) -> int:
        """Return the number of the event type."""
        return await self._call(f.message_get_number)

    async def get_serial_number(self) -> int:
        """Return the serial number of the event."""
        return await self._call(f.message_get_serial_number)

    async def get_source(self) -> str:
        """Return the source of the event."""
        return await self._call(f.message_get_source)

    async def get_value(self) -> Any:
        """Return the value of the event."""
        return await self._call(f.message_get_value)


class AsyncController(AsyncObjectContainer):
    """A connected controller, returned by :func:`connect`.

    Closing the controller releases its objects and closes the connection.
    """

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
        r"""Connect to a file or folder by name, for example ``dir\Pro1.pcs``.

        Args:
            name: Path relative to the root folder; the path of a folder may end in a separator.
            option: Option string of Controller_GetFile.
            create: Create the file now if it does not exist. By default, it is created when its text or data is set.
        """
        return await connect_file(self, f.controller_get_file, name, option, create=create)

    async def robot(self, name: str = "Arm", option: str = "") -> AsyncRobot:
        """Connect to a robot; the name is arbitrary. Option ``ID=1`` selects the second arm."""
        return await self._child(AsyncRobot, f.controller_get_robot, name, option)

    async def task(self, name: str, option: str = "") -> AsyncTask:
        """Connect to a task by name."""
        return await self._child(AsyncTask, f.controller_get_task, name, option)

    async def command(self, name: str, option: str = "") -> AsyncCommand:
        """Connect to a command by name."""
        return await self._child(AsyncCommand, f.controller_get_command, name, option)

    async def message(self) -> AsyncMessage | None:
        """Return the oldest pending event; ``None`` if no event is pending.

        Raises:
            MessagesDisabled: If the controller was connected with ``messages=False``.
        """
        try:
            handle = await self._call(f.controller_get_message)
        except ObjectNotFound:
            return None
        message = AsyncMessage(self.client, handle, "message", self)
        self._adopt(message)
        return message

    async def extension_names(self, option: str = "") -> list[str]:
        """Return the names of the extension boards."""
        return text_list(await self._call(f.controller_get_extension_names, option))

    async def file_names(self, option: str = "") -> list[str]:
        """Return the names of the files."""
        return text_list(await self._call(f.controller_get_file_names, option))

    async def robot_names(self, option: str = "") -> list[str]:
        """Return the names of the robots."""
        return text_list(await self._call(f.controller_get_robot_names, option))

    async def task_names(self, option: str = "") -> list[str]:
        """Return the names of the tasks."""
        return text_list(await self._call(f.controller_get_task_names, option))

    async def command_names(self, option: str = "") -> list[str]:
        """Return the names of the commands."""
        return text_list(await self._call(f.controller_get_command_names, option))

    async def errors(self) -> list[ErrorInfo]:
        """Return the errors present on the controller, newest first (GetCurErrorCount, GetCurErrorInfo)."""
        errors: list[ErrorInfo] = []
        for index in range(error_count(await self.execute("GetCurErrorCount"))):
            try:
                errors.append(error_info(await self.execute("GetCurErrorInfo", index)))
            except CallError as error:
                if not is_bad_index(error):
                    raise
                break  # errors were cleared in the meantime
        return errors

    async def clear_error(self) -> None:
        """Clear the errors of the controller (RC8 3.3.6)."""
        await self.execute("ClearError", clear_error_parameter(self.client.dialect))

    async def error_description(self, code: int) -> str:
        """Return the controller's own text for a return code (GetErrorDescription)."""
        return str(await self.execute("GetErrorDescription", hresult.signed(code)))

    async def call_user(self, number: int, *arguments: Value, timeout: float | None = None) -> Any:
        """Call a user-defined function of a device (e-CAP 3.3) and return its result (:meth:`AsyncClient.call_user`)."""
        return await self.client.call_user(number, *arguments, timeout=timeout)

    async def close(self, *, deadline: float | None = None) -> None:
        """Release all objects, newest first, disconnect, stop the service and close the connection.

        Args:
            deadline: Maximum time in s for these calls, regardless of S_EXECUTING. After that time, the connection is
                closed without further calls, which has the same effect. The default is three times the time-out, on UDP
                and serial lines also multiplied by ``tries``, but at least 3 s.
        """
        if not self._open:
            return
        limit = check_deadline(deadline)
        self.client.set_overall_deadline(self.client.connection_deadline() if limit is None else limit)
        try:
            if await self._release():
                await self.client.call(f.service_stop)
        except OrinError:  # closing the connection has the same effect
            pass
        finally:
            await self.client.close()


async def connect(
    url: str,
    *,
    provider: str = RC8,
    name: str = "",
    machine: str = LOCALHOST,
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
    messages: bool = True,
    debug: bool = False,
    charset: str = "utf-8",
) -> AsyncController:
    """Connect to a controller: open the connection, then call Service_Start and Controller_Connect (RC8 3.1).

    Args:
        url: For b-CAP, ``tcp://192.168.0.1:5007``, ``udp://192.168.0.1:5007`` or
            ``serial:///dev/ttyUSB0?baudrate=38400``. The notation of DENSO is accepted, too: ``tcp:192.168.0.1:5007``,
            ``udp:192.168.0.1:5007``, ``com:1:38400:N:8:1:0``. For e-CAP, ``http://192.168.0.1:8080/path`` or
            ``https://...``. A connection string of the b-CAP Tester (RC8 table 5-1) is accepted, too:
            ``Server=192.168.0.1, UDP=0, Timeout=800`` (:class:`~orinkit.ConnectionString`). Its options replace the
            arguments; its default time-out is 0.5 s.
        provider: Provider name; RC9 and COBOTTA PRO require ``CaoProv.DENSO.VRC9``, RC7 ``CaoProv.DENSO.NetwoRC``.
        name: Name of the controller; if empty, the controller chooses the name. A controller may require that the name
            is unique over all clients, unless the option contains ``@IfNotMember``.
        machine: Machine name; controllers accept ``localhost`` or their own address.
        option: Option string of Controller_Connect, for example ``@IfNotMember``.
        timeout: Time-out in s for connecting and for each call; on UDP and serial lines for each attempt, so that a
            call may take ``timeout * tries``. The default is 3.0 s on TCP and HTTP, 0.5 s otherwise.
        tries: Maximum number of times that a request is sent on UDP and serial lines, 1 to 7 (RC8 table 5-1: TORetry).
            The controller executes a repeated request only once. On TCP and HTTP, requests are sent once.
        service: Option string of Service_Start. The default requests a watchdog (``WDT=400``, at most half the
            time-out), so that a call may take longer than the time-out. On HTTP, the default is empty, because each
            request asks the server to report that the call is still executing.
        limits: Limits on the size of received packets and on the values in them.
        trace: Callback invoked for every packet, or every e-CAP body, with ``">"`` (sent) or ``"<"`` (received), and
            the bytes.
        dialect: ``"rc8"`` or ``"ve026a"``. By default, the dialect is ``"ve026a"`` if the provider name is empty or
            contains ``VE026A``, or if the controller's variable ``@VERSION`` contains ``VE026A``; otherwise it is
            ``"rc8"``. The variable is read only on serial lines, and on UDP if the replies have the form that a VE026A
            uses.
        token: Access token for HTTP, sent as ``Authorization: Bearer``.
        cafile: PEM file of CA certificates for verifying an https server, instead of those of the system.
        dead_after: Time in s without any reply from the controller's network stack after which a TCP connection is
            considered lost (cable pulled, power off): 2 to 7,200.
        alive: Interval in s, 0.3 to 3,600, within which the server must receive a sign of life while the arm moves.
            Otherwise, the server stops the arm, even if the connection is open. A thread (in asyncio a task) sends the
            signs of life, so they cease if the program is stopped (SIGSTOP) or, in asyncio, if its event loop is
            blocked. This is an option of orinkit's servers (``Alive=`` in Service_Start); other controllers may not
            support it.
        deadline: Maximum duration of connecting in s, regardless of S_EXECUTING. The default is three times the
            time-out, on UDP and serial lines also multiplied by ``tries``, but at least 3 s. After connecting, calls
            have no deadline by default; ``controller.client.deadline`` sets one.
        messages: False to disable messages (RC8 table 5-1: Message): the client refuses Controller_GetMessage and the
            functions of messages. ``Message=False`` in ``option`` makes the controller queue no events.
        debug: True for debug mode (RC8 table 5-1: Debug): the client keeps the last packet of each direction, or the
            last e-CAP body, as the variables ``$LAST_SEND_PACKET$`` and ``$LAST_RECEIVE_PACKET$`` of the controller.
        charset: Encoding of text over e-CAP: ``"utf-8"``, or ``"shift_jis"`` for servers that require it.

    Raises:
        InvalidAddress: If the URL or the connection string is invalid.
        InvalidValue: If another argument is invalid, for example an unknown dialect, or contradicts the connection
            string.
        ConnectFailed: If nothing listens at the address.
        CallTimeout: If there is no reply in time.
        CallError: If the controller refuses the connection.
        MissingExtra: If a package is not installed: serialx for serial lines, httpx2 for HTTP.
    """
    given = ConnectArguments(url, provider, machine, option, timeout, tries, messages, debug)
    url, provider, machine, option, timeout, tries, messages, debug = evaluate(given)
    known = dialect_of(dialect, provider)
    check_alive(alive, service, known or RC8_DIALECT)
    end = Deadline(check_deadline(deadline))
    client = await AsyncClient.open(
        url, timeout=timeout, tries=tries, limits=limits, trace=trace, token=token, cafile=cafile, dead_after=dead_after,
        deadline=deadline, messages=messages, debug=debug, charset=charset,
    )  # fmt: skip
    try:
        client.set_overall_deadline(client.connection_deadline() if deadline is None else end.left)
        client.use_dialect(known or client.dialect)
        tries_are_signs = alive is not None and client.profile.lossy  # S_EXECUTING would postpone the next attempt
        if tries_are_signs:
            check_no_watchdog(service)
        wanted = service if tries_are_signs else service_option(service, client.profile, client.dialect, client.timeout)
        await client.call(f.service_start, with_alive(wanted, alive))
        handle = await client.call(f.controller_connect, name, provider, machine, option)
        controller = AsyncController(client, handle, name or provider)
        if (
            known is None
            and (client.profile.shared or client.echoes_reserved)
            and is_ve026a(await _version(controller))
        ):
            client.use_dialect(VE026A)
        if alive is not None:
            await client.start_keep_alive(alive, handle)
        client.set_overall_deadline(None)
    except BaseException:
        await client.close()
        raise
    return controller


async def _version(controller: AsyncController) -> Any:
    try:
        async with await controller.variable("@VERSION") as version:
            return await version.get_value()
    except CallError:  # the controller does not have the variable
        return ""
