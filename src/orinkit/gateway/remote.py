"""A provider that forwards every call to another controller: :class:`RemoteProvider`.

The methods of the provider's objects are generated from the table of functions, so that each function of the table is
forwarded. The gateway stores only handles; names, tags and IDs are always read from the controller.

The connection from the gateway to the controller carries one call at a time, as a direct connection of a client does.
Concurrent calls of one e-CAP client are executed one after the other: a Halt waits for a Move of the same client. To
stop a motion, send Halt from a second client, for which the gateway has a separate connection.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.options import Options
from orinkit.cao.provider import (
    CaoObject,
    ClientInfo,
    CommandObject,
    ControllerObject,
    ExtensionObject,
    FileObject,
    MessageObject,
    Provider,
    ResultWithCode,
    RobotObject,
    TaskObject,
    VariableObject,
)
from orinkit.cao.results import client_gave_up
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.gateway.connection import UpstreamConnection
from orinkit.gateway.upstream import LOCAL, ConnectRequest, Upstream
from orinkit.values.variant import VarType

AnyUpstream: TypeAlias = str | Upstream
_PUT: Final = "put_"
_KEPT_BY_CONTROLLER: Final = "put_value"
_OF_CLIENT: Final = ("get_tag", "get_id")
_OTHER_FILE: Final = ("move", "delete")  # after these calls, the name belongs to another file or to no file


class _Origin(NamedTuple):
    """The call by which a client connected to an object."""

    parent: RemoteObject
    function: Function[..., Any]
    arguments: tuple[Any, ...]


class RemoteObject(CaoObject):
    """An object that a client uses on the gateway. Its calls are forwarded to an object of the controller.

    Args:
        connection: Connection to the controller.
        origin: Call by which the client connected to the object; ``None`` for the controller itself.
        handle: Handle of the object on the controller.

    Attributes:
        origin: Call by which the client connected to the object; ``None`` for the controller itself.
        handle: Handle of the object on the controller. It becomes invalid when the connection is opened again.
        generation: Value of :attr:`UpstreamConnection.generation` for which the handle is valid.
    """

    interface = ""

    def __init__(self, connection: UpstreamConnection, origin: _Origin | None = None, handle: int = 0) -> None:
        super().__init__()
        self.origin = origin
        self.handle = handle
        self.generation = connection.generation
        self._connection = connection
        self._has_local_state = False  # True if the client has set a state that is lost with the connection

    def release(self) -> None:
        """Release the object on the controller; for the controller itself, close the connection."""
        if self.origin is None:
            self._connection.close()
        else:
            self._connection.release(_RELEASES[self.interface], self.handle, self.generation)

    async def _call(self, function: Function[..., Any], arguments: tuple[Any, ...]) -> Any:
        connection = self._connection
        async with connection.turn:
            await connection.ensure_connected()
            self._check_state(function)
            handle = await self._valid_handle()
            if client_gave_up():  # while waiting for another call or for the connection
                raise error_for(hresult.E_ABORT, _not_sent(connection.url, function))
            reply = await connection.request(function, handle, *arguments)
            value = reply.value
            if function.creates:
                value = _CLASSES[function.creates](connection, _Origin(self, function, arguments), value.value)
                connection.add_reference(_RELEASES[function.creates], value.handle)
            elif function.result is VarType.VARIANT:
                value = None if value.type == VarType.EMPTY else value
            elif value is not None:
                value = value.value
            if _sets_local_state(function, arguments):
                self._has_local_state = True
        return value if reply.code == hresult.S_OK else ResultWithCode(reply.code, value)

    def is_moving(self) -> bool:
        """Return True if the arm may still execute a motion that was forwarded for this client."""
        return bool(self._connection.moving)

    def stop_moving(self) -> None:
        """Close the connection, so that the controller stops the arm.

        The next call opens the connection again, but does not take the arm semaphore again.
        """
        self._connection.disconnect()

    def _check_state(self, function: Function[..., Any]) -> None:
        """Check that a call does not request the tag or ID of the controller object after they have been lost.

        When the connection is lost, the tag and ID that the client has set no longer exist on the controller.

        Raises:
            CallError: E_HANDLE, if the call requests a lost tag or ID.
        """
        connection = self._connection
        if self.origin is None and self._has_local_state and self.generation != connection.generation:
            if function.method in _OF_CLIENT:
                raise self._lost()
        elif self.origin is None:
            self.generation = connection.generation

    def _lost(self) -> CallError:
        url, kind = self._connection.url, self.interface
        return error_for(
            hresult.E_HANDLE,
            tr(
                "gateway to {url}: the connection was lost, so the state of this {kind} no longer exists. Try: "
                "get the object again",
                url=url,
                kind=kind,
            ),
        )

    async def _valid_handle(self) -> int:
        """Return the handle of the object. If the connection was opened again, first connect to the object again.

        Raises:
            CallError: If the controller refuses a call that connects to an object again; E_HANDLE, if an object cannot
                be restored from its name.
        """
        connection = self._connection
        path: list[tuple[RemoteObject, _Origin]] = []
        each = self
        while each.origin is not None and each.generation != connection.generation:
            path.append((each, each.origin))
            each = each.origin.parent
        for lost, origin in reversed(path):
            await lost.connect_again(origin)
        return connection.handle if self.origin is None else self.handle

    async def connect_again(self, origin: _Origin) -> None:
        """Connect to the object again by its name, over a new connection.

        The caller must hold :attr:`UpstreamConnection.turn`. The gateway must already have connected to the parent
        object again.

        Args:
            origin: Call by which the client connected to the object.

        Raises:
            CallError: If the controller refuses to connect to the object; E_HANDLE, if the object cannot be restored
                from its name.
        """
        connection = self._connection
        if self._has_local_state or len(origin.arguments) < 2:
            raise self._lost()
        name, option = origin.arguments
        parent = connection.handle if origin.parent.origin is None else origin.parent.handle
        reply = await connection.request(origin.function, parent, name, _without_create(option))
        self.handle, self.generation = reply.value.value, connection.generation
        connection.add_reference(_RELEASES[self.interface], self.handle)


def _sets_local_state(function: Function[..., Any], arguments: tuple[Any, ...]) -> bool:
    """Return True if a call changes its object so that the object cannot be restored by its name afterwards.

    The gateway restores an object by its name if the connection was lost and is opened again.
    """
    method = function.method
    if method.startswith(_PUT):
        return method != _KEPT_BY_CONTROLLER
    if function.interface == "File":
        return method in _OTHER_FILE
    if method != "execute":
        return False
    command = str(arguments[0]).strip().lower()
    return function.interface == "Command" or (command.startswith("slv") and command.endswith("format"))


def _not_sent(url: str, function: Function[..., Any]) -> str:
    return tr(
        "gateway to {url}: {name} was not sent because its client no longer waits for the reply",
        url=url,
        name=function.name,
    )


def _without_create(option: str) -> str:
    """Return the option string of a file without ``@Create``, so that reconnecting does not create the file again."""
    if "@Create" not in Options(option):
        return option
    return ",".join(part for part in option.split(",") if part.partition("=")[0].strip().lower() != "@create")


def _forwarded(function: Function[..., Any]) -> Callable[..., Awaitable[Any]]:
    async def method(self: RemoteObject, *arguments: Any) -> Any:
        return await self._call(function, arguments)

    method.__name__, method.__doc__ = function.method, function.en
    return method


_BASES: Final[Mapping[str, type[CaoObject]]] = {
    "Controller": ControllerObject,
    "Extension": ExtensionObject,
    "File": FileObject,
    "Robot": RobotObject,
    "Task": TaskObject,
    "Variable": VariableObject,
    "Command": CommandObject,
    "Message": MessageObject,
}
_RELEASES: Final = {entry.interface: entry for entry in FUNCTIONS.values() if entry.releases}
_CLASSES: Final[dict[str, Callable[..., Any]]] = {
    interface: type(
        f"Remote{interface}",
        (RemoteObject, base),
        {
            "interface": interface,
            "__doc__": f"A {interface} of another controller.",
            **{
                entry.method: _forwarded(entry)
                for entry in FUNCTIONS.values()
                if entry.interface == interface and not entry.releases and entry.creates != "Controller"
            },
        },
    )
    for interface, base in _BASES.items()
}


class RemoteProvider(Provider):
    """A provider that forwards calls to one or several controllers.

    Each Controller_Connect of a client opens its own connection to the controller. The controller therefore
    distinguishes the clients of the gateway: each client has its own handles, takes the arm semaphore for itself, and
    can disconnect without effect on the others. Controller_Connect is forwarded with all its arguments.

    If there are several controllers, the machine name in Controller_Connect selects one of them. The machine name is
    the name of the controller in ``upstream`` (case is ignored), or the host in the URL of the controller, or host and
    port (``192.168.0.1:5007``).

    Args:
        upstream: URL of a controller, or an :class:`~orinkit.gateway.upstream.Upstream`. For several controllers, a
            mapping from the name of each controller to its URL or Upstream.
        names: Provider names that clients can use for the controllers. By default, the gateway accepts every name that
            no other provider of the server has.

    Raises:
        ValueError: If there is no controller, the names are ambiguous, or the controllers have different dialects.
        InvalidAddress: If a URL is invalid.
        InvalidValue: If another setting of an upstream is invalid.
    """

    def __init__(self, upstream: AnyUpstream | Mapping[str, AnyUpstream], *, names: Sequence[str] = ("*",)) -> None:
        listed = upstream if isinstance(upstream, Mapping) else {"": upstream}
        self.provider_names = names
        self.unwraps_variants = True  # b-CAP has no VT_VARIANT
        self._upstreams = {
            str(name).strip(): each if isinstance(each, Upstream) else Upstream(each) for name, each in listed.items()
        }
        _check_names(self._upstreams, len(listed))
        self.dialect = _common_dialect(self._upstreams)
        self._connections: set[UpstreamConnection] = set()

    async def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        """Connect to a controller for one client; return the client's controller object.

        Raises:
            CallError: E_INVALIDARG, if the machine name matches no controller; E_CAO_REMOTE_PROVIDER, if the controller
                is unreachable; the controller's error code, if the controller refuses the connection.
        """
        upstream, machine = self._choose(machine)
        # names are unique on the controller, whose other clients the gateway does not know: the controller chooses one
        wanted = ConnectRequest("" if client.is_unnamed else name, client.provider, machine, option)
        connection = UpstreamConnection(upstream, wanted, self._connections.discard)
        self._connections.add(connection)
        try:
            async with connection.turn:
                await connection.ensure_connected()
        except BaseException:
            connection.close()
            raise
        made: ControllerObject = _CLASSES["Controller"](connection)
        return made

    async def close(self) -> None:
        """Wait at most 2 s until the connections for the clients of a stopped server have been closed.

        Other servers, in other event loops, may still use this provider; their connections stay open.
        """
        await asyncio.gather(*(connection.wait_closed() for connection in list(self._connections)))

    def _choose(self, machine: str) -> tuple[Upstream, str]:
        """Return the controller that a machine name selects, and the machine name to send to this controller."""
        wanted = machine.strip().lower()
        for name, upstream in self._upstreams.items():
            if name.lower() == wanted != "":
                return upstream, upstream.machine or LOCAL
        found = [upstream for upstream in self._upstreams.values() if wanted in upstream.machine_names]
        if len(self._upstreams) == 1 and ("" in self._upstreams or wanted in ("", LOCAL)):
            found = list(self._upstreams.values())  # any machine name, or the default one, selects the only controller
        if len(found) == 1:
            return found[0], found[0].machine or machine
        names = ", ".join(self._upstreams)
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "unknown machine {machine}; machines behind this gateway: {names}",
                machine=quoted(machine, 80),
                names=names,
            ),
        )


def _check_names(upstreams: Mapping[str, Upstream], given: int) -> None:
    """Check that the names of the controllers are unambiguous, so that no client reaches an unintended controller.

    Args:
        upstreams: Controllers by name.
        given: Number of names that the user has given. ``upstreams`` contains fewer if names differ only in blanks.

    Raises:
        ValueError: If a name occurs twice (case is ignored); or, with several controllers, if a name is empty, is
            ``localhost``, or is also the machine name of a controller.
    """
    names = [name.lower() for name in upstreams]
    hosts = {place for upstream in upstreams.values() for place in upstream.machine_names}
    wrong = [name for name in names if given > 1 and (not name or name == LOCAL or name in hosts)]
    if wrong or len(set(names)) < given:
        raise ValueError(
            tr(
                "with several controllers, each controller needs a unique name other than localhost and the hosts "
                "in the addresses of the controllers; got {names}",
                names=", ".join(map(repr, names)),
            )
        )


def _common_dialect(upstreams: Mapping[str, Upstream]) -> Any:
    dialects = {upstream.spoken.name: upstream.spoken for upstream in upstreams.values()}
    if len({name.lower() for name in upstreams}) < len(upstreams) or len(dialects) != 1:
        raise ValueError(
            tr(
                "a gateway needs at least one controller, unique names (ignoring case), and the same dialect for all "
                "controllers: {upstreams}; {dialects}",
                upstreams=", ".join(upstreams) or "-",
                dialects=", ".join(dialects) or "-",
            )
        )
    (dialect,) = dialects.values()
    return dialect
