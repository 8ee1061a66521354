"""A provider that forwards every call to another controller: :class:`RemoteProvider`.

The methods of its objects are made of THE TABLE, so a function that is entered there is forwarded. Nothing is kept here
but handles: names, tags, IDs are asked for where they are.

A connection carries one call at a time, as a controller itself has it: a client that calls several things at once (e-CAP)
has them carried out one after the other. A Halt that is to stop a Move of the same client waits behind it; it has to come
from a second client, which has a connection of its own, as with every controller.
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
from orinkit.gateway.upstream import LOCAL, ConnectRequest, Upstream, UpstreamConnection
from orinkit.values.variant import VarType

AnyUpstream: TypeAlias = str | Upstream
_PUT: Final = "put_"
_KEPT_BY_CONTROLLER: Final = "put_value"
_OF_CLIENT: Final = ("get_tag", "get_id")
_OTHER_FILE: Final = ("move", "delete")  # afterwards its name is that of another one, or of none


class _Origin(NamedTuple):
    """How an object was connected to."""

    parent: RemoteObject
    function: Function[..., Any]
    arguments: tuple[Any, ...]


class RemoteObject(CaoObject):
    """An object of another controller.

    Args:
        connection: to that controller.
        origin: how it was connected to; ``None`` for the controller itself.
        handle: there.

    Attributes:
        origin: as it was given.
        handle: there, in this generation of the connection.
        generation: of the connection when the handle was given.
    """

    interface = ""

    def __init__(self, connection: UpstreamConnection, origin: _Origin | None = None, handle: int = 0) -> None:
        super().__init__()
        self.origin = origin
        self.handle = handle
        self.generation = connection.generation
        self._connection = connection
        self._marked = False  # the client has put something into it that is gone with the connection

    def release(self) -> None:
        """Let go: release the object there; with the controller the connection ends."""
        if self.origin is None:
            self._connection.close()
        else:
            self._connection.release(_RELEASES[self.interface], self.handle, self.generation)

    async def _call(self, function: Function[..., Any], arguments: tuple[Any, ...]) -> Any:
        connection = self._connection
        async with connection.turn:
            await connection.ready()
            self._check_kept(function)
            handle = await self._reach()
            if client_gave_up():  # it has waited behind another call, or for the connection
                raise error_for(hresult.E_ABORT, _too_late(connection.url, function))
            reply = await connection.ask(function, handle, *arguments)
            value = reply.value
            if function.creates:
                value = _CLASSES[function.creates](connection, _Origin(self, function, arguments), value.value)
                connection.hold(_RELEASES[function.creates], value.handle)
            elif function.result is VarType.VARIANT:
                value = None if value.type == VarType.EMPTY else value
            elif value is not None:
                value = value.value
            if _leaves_mark(function, arguments):
                self._marked = True
        return value if reply.code == hresult.S_OK else ResultWithCode(reply.code, value)

    def is_moving(self) -> bool:
        """Whether a motion that was passed on may still run."""
        return self._connection.may_move

    def stop_moving(self) -> None:
        """Give up the connection: the controller stops the arm. The next call connects again, without the arm."""
        self._connection.give_up()

    def _check_kept(self, function: Function[..., Any]) -> None:
        """Refuse to tell tag and ID of a controller where they went with a lost connection."""
        connection = self._connection
        if self.origin is None and self._marked and self.generation != connection.generation:
            if function.method in _OF_CLIENT:
                raise self._lost()
        elif self.origin is None:
            self.generation = connection.generation

    def _lost(self) -> CallError:
        url, kind = self._connection.url, self.interface
        return error_for(
            hresult.E_HANDLE,
            tr(
                "gateway to {url}: the connection was lost meanwhile, and with it what the client had "
                "put into this {kind}, done with it, or fetched. Get it anew",
                url=url,
                kind=kind,
            ),
        )

    async def _reach(self) -> int:
        """Return the handle; after a lost connection the objects on the way here are connected to again.

        Raises:
            CallError: one cannot be; E_HANDLE, for it would not be the same.
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
        """Connect to the same object in a new connection, by its name; for who has the turn, and has reached its parent.

        Args:
            origin: how it was connected to.

        Raises:
            CallError: the controller refuses; E_HANDLE, a name does not tell all about the object.
        """
        connection = self._connection
        if self._marked or len(origin.arguments) < 2:
            raise self._lost()
        name, option = origin.arguments
        parent = connection.handle if origin.parent.origin is None else origin.parent.handle
        reply = await connection.ask(origin.function, parent, name, _without_create(option))
        self.handle, self.generation = reply.value.value, connection.generation
        connection.hold(_RELEASES[self.interface], self.handle)


def _leaves_mark(function: Function[..., Any], arguments: tuple[Any, ...]) -> bool:
    """Whether an object is not the one any more that its name tells, or knows something that only this connection has."""
    method = function.method
    if method.startswith(_PUT):
        return method != _KEPT_BY_CONTROLLER
    if function.interface == "File":
        return method in _OTHER_FILE
    if method != "execute":
        return False
    command = str(arguments[0]).strip().lower()
    return function.interface == "Command" or (command.startswith("slv") and command.endswith("format"))


def _too_late(url: str, function: Function[..., Any]) -> str:
    return tr("gateway to {url}: {name} was not sent, as its client waits for it no more", url=url, name=function.name)


def _without_create(option: str) -> str:
    """Return the option of a file without the wish that it be made: the client has not said so a second time."""
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
    """Another controller, or several, as a provider.

    Each Controller_Connect of a client opens a connection of its own, so that handles, the arm, and the end of the
    client are the same there as here. Controller_Connect itself goes there with all its arguments.

    With several controllers the machine name of Controller_Connect says which one is meant: by the name that it has
    here, in upper or lower case, or by host, or host and port, of its address.

    Args:
        upstream: URL of a controller, or :class:`~orinkit.gateway.upstream.Upstream`; several in a mapping, by name.
        names: provider names that are forwarded; all that no other provider of the server has, unless told otherwise.

    Raises:
        ValueError: none, or controllers of different dialects.
        InvalidAddress: a URL cannot be used.
        InvalidValue: something else of an upstream cannot be used.
    """

    def __init__(self, upstream: AnyUpstream | Mapping[str, AnyUpstream], *, names: Sequence[str] = ("*",)) -> None:
        listed = upstream if isinstance(upstream, Mapping) else {"": upstream}
        self.provider_names = names
        self._upstreams = {
            str(name).strip(): each if isinstance(each, Upstream) else Upstream(each) for name, each in listed.items()
        }
        _check_names(self._upstreams, len(listed))
        self.dialect = _common_dialect(self._upstreams)
        self._connections: set[UpstreamConnection] = set()

    async def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        """Connect for one client, and return its controller object.

        Raises:
            CallError: E_INVALIDARG, the machine is none of those that are there; what the controller refuses with;
                E_CAO_REMOTE_PROVIDER, it cannot be reached.
        """
        upstream, machine = self._choose(machine)
        wanted = ConnectRequest(name, client.provider, machine, option)
        connection = UpstreamConnection(upstream, wanted, self._connections.discard)
        self._connections.add(connection)
        try:
            async with connection.turn:
                await connection.ready()
        except BaseException:
            connection.close()
            raise
        made: ControllerObject = _CLASSES["Controller"](connection)
        return made

    async def close(self) -> None:
        """A server has stopped, and its clients have been let go: wait until their connections have ended.

        Other servers may serve this provider too, in other event loops.
        """
        await asyncio.gather(*(connection.ended() for connection in list(self._connections)))

    def _choose(self, machine: str) -> tuple[Upstream, str]:
        """Return the controller that is meant, and the machine name that it is to be told."""
        wanted = machine.strip().lower()
        for name, upstream in self._upstreams.items():
            if name.lower() == wanted != "":
                return upstream, upstream.machine or LOCAL
        meant = [upstream for upstream in self._upstreams.values() if wanted in upstream.places]
        if len(self._upstreams) == 1 and ("" in self._upstreams or wanted in ("", LOCAL)):
            meant = list(self._upstreams.values())  # there is no other that could be meant
        if len(meant) == 1:
            return meant[0], meant[0].machine or machine
        names = ", ".join(self._upstreams)
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "the machine {machine} is none of those behind this gateway: {names}",
                machine=quoted(machine, 80),
                names=names,
            ),
        )


def _check_names(upstreams: Mapping[str, Upstream], given: int) -> None:
    """Refuse names by which a client could reach another controller than it means."""
    names = [name.lower() for name in upstreams]
    hosts = {place for upstream in upstreams.values() for place in upstream.places}
    wrong = [name for name in names if given > 1 and (not name or name == LOCAL or name in hosts)]
    if wrong or len(set(names)) < given:
        raise ValueError(
            tr(
                "each of several controllers needs a name of its own, which is neither localhost nor the "
                "host of one: {names}",
                names=", ".join(map(repr, names)),
            )
        )


def _common_dialect(upstreams: Mapping[str, Upstream]) -> Any:
    dialects = {upstream.spoken.name: upstream.spoken for upstream in upstreams.values()}
    if len({name.lower() for name in upstreams}) < len(upstreams) or len(dialects) != 1:
        raise ValueError(
            tr(
                "a gateway needs at least one controller, names that differ in more than upper and lower "
                "case, and one dialect for all: {upstreams}; {dialects}",
                upstreams=", ".join(upstreams) or "-",
                dialects=", ".join(dialects) or "-",
            )
        )
    (dialect,) = dialects.values()
    return dialect
