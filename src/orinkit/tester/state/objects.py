"""The objects of a connection, which all pages share: :class:`ObjectRegistry`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, Final

from orinkit.cao import functions as f
from orinkit.cao.table import Function
from orinkit.client._async.client import AsyncClient
from orinkit.core.errors import ConnectionClosed, InvalidValue, ObjectReleased
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant

MAX_OBJECTS: Final = 500
_ROOT: Final = "Service"


def owner_of(function: Function[..., Any]) -> str:
    """Return the interface of the objects on which a function is called; ``"Service"`` for functions without a handle."""
    return function.interface if function.arguments and function.arguments[0].is_handle else _ROOT


def functions_of(interface: str) -> list[Function[..., Any]]:
    """Return the functions of the objects of an interface, in the order of the table."""
    return [each for each in f.FUNCTIONS.values() if owner_of(each) == interface]


def creators_of(interface: str) -> list[Function[..., Any]]:
    """Return the functions that create objects below an object of an interface."""
    return [each for each in functions_of(interface) if each.creates]


def names_function(creator: Function[..., Any]) -> Function[..., Any] | None:
    """Return the function that lists the names for a function that creates objects, if there is one."""
    return f.BY_NAME.get(f"{creator.name}Names")


@dataclass(eq=False)
class RemoteObject:
    """An object of the controller.

    Attributes:
        interface: Interface: ``Controller``, ``Robot``, ...; ``Service`` for the root.
        label: Name of the object.
        handle: Handle; 0 for the root.
        parent: The object that created it; ``None`` for the root.
        creator: The function that created it.
        children: The objects that it has created.
    """

    interface: str
    label: str
    handle: int
    parent: RemoteObject | None = None
    creator: Function[..., Any] | None = None
    children: list[RemoteObject] = field(default_factory=list)

    def walk(self) -> Iterator[RemoteObject]:
        """Yield the object and all objects below it."""
        yield self
        for child in self.children:
            yield from child.walk()

    @property
    def path(self) -> str:
        """The labels of the objects from the controller to this one."""
        above = self.parent.path if self.parent is not None and self.parent.parent is not None else ""
        return f"{above}/{self.label}" if above else self.label


@dataclass(frozen=True, slots=True)
class Outcome:
    """A successful call.

    Attributes:
        function: The function.
        code: Return code.
        value: Result; ``None`` if the function has none.
        seconds: Time taken, s.
        created: The object that the call has created, if any.
    """

    function: Function[..., Any]
    code: int
    value: Variant | None
    seconds: float
    created: RemoteObject | None = None


class ObjectRegistry:
    """The objects that the pages of the Tester have created over one connection, and calls of their functions.

    Attributes:
        root: The service, the parent of the controllers.
        version: Counts the changes, so that pages can detect them.
    """

    def __init__(self) -> None:
        self._client: AsyncClient | None = None
        self.root = RemoteObject(_ROOT, _ROOT, 0)
        self.version = 0

    def begin(self, client: AsyncClient, controller: int, name: str) -> None:
        """Begin with the objects of a new connection: the service and the controller."""
        self._client = client
        self.root = RemoteObject(_ROOT, _ROOT, 0)
        self._add(self.root, f.controller_connect, name, controller)

    def end(self) -> None:
        """Forget all objects, because the connection is closed."""
        self._client = None
        self.root = RemoteObject(_ROOT, _ROOT, 0)
        self.version += 1

    def __iter__(self) -> Iterator[RemoteObject]:
        return self.root.walk()

    def __contains__(self, item: object) -> bool:
        return any(each is item for each in self)

    @property
    def controller(self) -> RemoteObject | None:
        """The first controller; ``None`` if the connection is closed."""
        return self.root.children[0] if self.root.children else None

    async def call(self, target: RemoteObject, function: Function[..., Any], *arguments: Any) -> Outcome:
        """Call a function of an object, and note the objects that the call creates or releases.

        Args:
            target: The object.
            function: A function of its interface.
            *arguments: The arguments without the handle.

        Raises:
            ConnectionClosed: If the connection is closed.
            ObjectReleased: If the object has been released; nothing was sent.
            InvalidValue: If an argument does not fit, or there are too many objects; nothing was sent.
            OrinError: As :meth:`orinkit.aio.AsyncClient.call`.
        """
        client = self._check(target, function)
        handle = (target.handle,) if target is not self.root else ()
        timeout = (
            client.command_timeout(f"{arguments[0]}") if function.name.endswith("_Execute") and arguments else None
        )
        begun = perf_counter()
        reply = await client.request(function, *handle, *arguments, timeout=timeout, exact=function.result is not None)
        seconds = perf_counter() - begun
        created = None
        if client is self._client:
            created = self._note(target, function, arguments, reply.value)
        return Outcome(function, reply.code, reply.value if function.result is not None else None, seconds, created)

    def _check(self, target: RemoteObject, function: Function[..., Any]) -> AsyncClient:
        if self._client is None:
            raise ConnectionClosed(tr("the connection is closed. Try: Connect on the page Connections"))
        if target not in self:
            raise ObjectReleased(tr("{name} has been released. Try: add it again", name=target.label))
        if function.creates and sum(1 for _ in self) >= MAX_OBJECTS:
            raise InvalidValue(tr("at most {most} objects are possible. Try: release some", most=MAX_OBJECTS))
        return self._client

    def _note(
        self, target: RemoteObject, function: Function[..., Any], arguments: tuple[Any, ...], value: Variant | None
    ) -> RemoteObject | None:
        if function.creates and value is not None:
            label = f"{arguments[0]}" if arguments and arguments[0] else function.creates
            return self._add(target, function, label, int(value.value))
        if function.releases:
            self._remove(target)
        if function is f.service_stop:
            self.root.children.clear()
            self.version += 1
        return None

    def _add(self, parent: RemoteObject, creator: Function[..., Any], label: str, handle: int) -> RemoteObject:
        added = RemoteObject(creator.creates, label, handle, parent, creator)
        if self._client is not None:
            self._client.handles.add_reference(f.BY_NAME[creator.released_by], handle)
        parent.children.append(added)
        self.version += 1
        return added

    async def release(self, target: RemoteObject) -> Outcome:
        """Release an object and all objects below it, the newest first.

        A VE026A returns the same handle for all objects of a kind. Such a handle is released with the last of them.

        Raises:
            OrinError: As for :meth:`call`.
        """
        for child in reversed(list(target.children)):
            await self.release(child)
        if target.creator is None:
            raise InvalidValue(tr("{name} cannot be released", name=target.label))
        release = f.BY_NAME[target.creator.released_by]
        client = self._check(target, release)
        if not client.handles.drop_reference(release, target.handle):
            client.handles.add_reference(release, target.handle)
            self._remove(target)
            return Outcome(release, 0, None, 0.0)
        client.handles.add_reference(release, target.handle)
        return await self.call(target, release)

    def _remove(self, target: RemoteObject) -> None:
        if target.parent is None or target not in self:
            return
        target.parent.children.remove(target)
        self.version += 1
        if self._client is not None:
            for each in target.walk():
                assert each.creator is not None
                self._client.handles.drop_reference(f.BY_NAME[each.creator.released_by], each.handle)

    async def names(self, parent: RemoteObject, creator: Function[..., Any]) -> list[str]:
        """Return the names of the objects that a function can create ([Get] in DENSO's Tester).

        Raises:
            OrinError: As for :meth:`call`.
        """
        function = names_function(creator)
        if function is None:
            return []
        value = (await self.call(parent, function, "")).value
        found = value.plain if value is not None else None
        return [f"{each}" for each in found] if isinstance(found, list) else []
