"""Sessions: the handles of one client, and the dispatch of function calls to the provider's methods.

:meth:`Session.invoke` finds the object of the handle, converts the arguments to the types of the table, calls the
method and returns a :class:`CallReply`. If the result is not available yet, it returns a :class:`Pending`: the caller
awaits or runs ``pending.work`` and passes the result to :meth:`Session.complete` or the exception to
:meth:`Session.fail`.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from inspect import isawaitable
from typing import Any, Final, cast

from orinkit.cao.arguments import read_arguments
from orinkit.cao.controller_names import starts_anew
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.handles import HandleAllocator
from orinkit.cao.options import Options
from orinkit.cao.outcomes import CallReply, FailedCalls, Outcome, Pending
from orinkit.cao.provider import (
    BlockingCall,
    CaoObject,
    ClientInfo,
    ControllerObject,
    Deferred,
    Provider,
    ResultWithCode,
)
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.quota import CLIENT_LIMIT, STORING_METHODS, ByteQuota, stored_size
from orinkit.cao.table import Function
from orinkit.cao.user_functions import FIRST_BCAP
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.values.types import ARRAY
from orinkit.values.variant import Variant, VarType, trusted, variant

logger = logging.getLogger("orinkit.session")

_NAMES: Final = VarType.BSTR | ARRAY


@dataclass(slots=True)
class _Entry:
    handle: int
    interface: str
    served: CaoObject
    parent: int
    label: str
    guard: AbstractContextManager[object]
    kept: dict[str, int] = field(default_factory=dict)  # number of stored bytes, by method


class Session:
    """The objects of one client, by handle. Handles are valid only in their own session.

    Args:
        host: the providers.
        client: information on the client.
        numbers: allocator of the handles; by default a new one, whose handles begin at 2.
        own_code: function that replaces a return code of the server itself, for an invalid argument, by one that the
            protocol permits; it does not change the return codes of a device.
    """

    def __init__(
        self,
        host: ProviderRegistry,
        client: ClientInfo | None = None,
        numbers: HandleAllocator | None = None,
        own_code: Callable[[int], int] = hresult.unsigned,
    ) -> None:
        self.host = host
        self._own_code = own_code
        # an object of its own: a device that stores ClientInfo would otherwise keep this session in memory
        self._failures = FailedCalls()
        self.client = (client or ClientInfo())._replace(describe_error=self._failures.describe)
        self._entries: dict[int, _Entry] = {}  # oldest first
        self._handles = numbers or HandleAllocator()
        self._kept = ByteQuota(CLIENT_LIMIT, host.kept)
        self._closed = False
        self._numbers = itertools.count(1)
        self._functions = host.functions
        # fixed handles are unique only within an interface, so its number is added above the 32 bits of the handle
        self._spaces = _SPACES if host.fixed_handles else {}

    def __len__(self) -> int:
        """Return the number of the client's objects."""
        return len(self._entries)

    # --- a call -------------------------------------------------------------------------------------------------

    def invoke(self, function_id: int, arguments: Sequence[Variant]) -> Outcome:
        """Execute a call. Errors are returned as replies; no exception is raised, regardless of the request.

        Args:
            function_id: An id of the table; any other returns E_NOTIMPL.
            arguments: the arguments with their exact types, as returned by :func:`orinkit.bcap.packet.decode`.
        """
        function = FUNCTIONS.get(function_id)
        if function is None or (self._functions is not None and function_id not in self._functions):
            return self._invoke_user_function(function_id, arguments)
        try:
            return self._call(function, self._values(function, arguments))
        except BaseException as error:  # noqa: BLE001 - any exception of a device becomes a reply, SystemExit too
            return self._failures.reply(function, error)

    def invoke_on_handle(self, function_id: int, handle: int) -> Outcome:
        """Execute a call whose only argument is a handle; as :meth:`invoke`, which other calls use."""
        function = _ON_HANDLE.get(function_id)
        if function is None or self._functions is not None:
            return self.invoke(function_id, [trusted(_I4, handle)])
        try:
            return self._call(function, [handle])
        except BaseException as error:  # noqa: BLE001 - as in invoke
            return self._failures.reply(function, error)

    def _invoke_user_function(self, function_id: int, arguments: Sequence[Variant]) -> Outcome:
        """Execute a user-defined function; a function that no device has declared returns E_NOTIMPL."""
        provider, user = self.host.user_functions.get(function_id, (None, None))
        over_bcap = self.client.transport != "http"
        if provider is None or user is None or (over_bcap and function_id < FIRST_BCAP):
            return CallReply(hresult.E_NOTIMPL, detail=tr("unknown function {function_id}", function_id=function_id))
        function = user.function
        try:
            if provider.requires_secret and not self._entries:
                raise error_for(hresult.E_ACCESSDENIED, function.name)
            values = self._values(function, arguments)[: len(arguments)]  # the function has its own defaults
            with provider.guard:
                result = user.call(*values)
            return self._outcome(function, 0, "", result, provider)
        except BaseException as error:  # noqa: BLE001 - as in invoke
            return self._failures.reply(function, error)

    def _values(self, function: Function[..., Any], arguments: Sequence[Variant]) -> list[Any]:
        """Return the arguments with their types.

        Raises:
            CallError: If they are invalid, with a return code that the protocol permits to the server itself.
        """
        try:
            return read_arguments(function, arguments)
        except CallError as error:
            raise error_for(self._own_code(error.code), error.detail) from None

    def complete(self, pending: Pending, result: Any, *, client_waits: bool = True) -> CallReply:
        """Return the reply to a pending call whose work has returned ``result``.

        Args:
            pending: the call.
            result: the result of its work.
            client_waits: whether the client receives the reply. If False (after a time-out or a disconnection), an
                object that the call has created is released, because the client would never receive its handle.
        """
        try:
            made = result.value if type(result) is ResultWithCode else result
            if not client_waits and isinstance(made, CaoObject):
                made.release()
                raise error_for(hresult.E_ABORT, pending.label)
            return self._reply(pending.function, pending.handle, pending.label, result, pending.provider)
        except BaseException as error:  # noqa: BLE001 - as in invoke
            return self._failures.reply(pending.function, error)

    def fail(self, pending: Pending, error: BaseException) -> CallReply:
        """Return the reply to a pending call whose work has raised ``error``."""
        return self._failures.reply(pending.function, error)

    def refuse(self, function_id: int, error: CallError) -> CallReply:
        """Return the reply to a call whose result cannot be sent, and store the description of the error."""
        user = self.host.user_functions.get(function_id)
        return self._failures.reply(FUNCTIONS[function_id] if user is None else user[1].function, error)

    def _call(self, function: Function[..., Any], values: list[Any]) -> Outcome:
        """Call the method of the object that the first argument refers to.

        Raises:
            CallError: The error of the call; the method may raise any exception.
        """
        kind = _KINDS.get(function.id)
        if kind is None:
            return self._call_unusual(function, values)
        handle = values[0]
        entry = self._entries.get(handle)
        if entry is None or entry.interface != function.interface or self._spaces:
            entry = self._find(function, handle)
        method = getattr(entry.served, function.method)
        guard = entry.guard
        if guard is _UNGUARDED:
            result = method(*values[1:])
        else:
            with guard:
                result = method(*values[1:])
        if kind is _RETURNS_VARIANT:
            if type(result) is Variant:
                return CallReply(hresult.S_OK, result)
            if type(result) is float:
                return CallReply(hresult.S_OK, trusted(_R8, result))
        elif kind is _RETURNS_NOTHING and result is None:
            return CallReply()
        return self._outcome(function, entry.handle, "", result)

    def _call_unusual(self, function: Function[..., Any], values: list[Any]) -> Outcome:
        """Call a function that creates or releases an object, stores a value, or is executed by the session itself."""
        special = _SPECIAL.get(function.id)
        if special is not None:
            return special(self, function, values)
        entry = self._find(function, values[0])
        handle = entry.handle
        label = ""
        if function.creates:
            label = values[1] if len(values) > 1 else ""
            existing = self._existing(function.creates, handle, label, values[-1])
            if existing is not None:
                return existing
        if function.method in STORING_METHODS:
            self._count_stored(entry, function.method, values[1])
        with entry.guard:
            result = getattr(entry.served, function.method)(*values[1:])
        return self._outcome(function, handle, label, result)

    def _count_stored(self, entry: _Entry, method: str, value: Variant) -> None:
        """Count the bytes of a value that an object will store; no longer count those of the value that it replaces.

        Raises:
            CallError: E_TOO_MUCH_DATA if the value is too large, E_OUTOFMEMORY if the client's limit would be exceeded.
        """
        size = stored_size(value)
        self._kept.change(size - entry.kept.get(method, 0))
        entry.kept[method] = size

    def _outcome(
        self, function: Function[..., Any], parent: int, label: str, result: Any, provider: Provider | None = None
    ) -> Outcome:
        while type(result) is Deferred and result.done():
            result = result.result()
        if type(result) in (BlockingCall, Deferred) or isawaitable(result):
            return Pending(function, parent, label, result, provider)
        return self._reply(function, parent, label, result, provider)

    def _find(self, function: Function[..., Any], handle: int) -> _Entry:
        """Return the object that a function is called on.

        Raises:
            CallError: E_HANDLE if there is no such object.
        """
        entry = self._entries.get(handle + self._spaces[function.interface] if self._spaces else handle)
        if entry is None or entry.interface != function.interface:
            raise error_for(hresult.E_HANDLE, self._handle_error(handle, entry, function))
        return entry

    def _existing(self, interface: str, parent: int, label: str, option: str) -> CallReply | None:
        """Return the reply with the handle of the existing object ``label`` if ``option`` contains @IfNotMember.

        If the option is absent, or no object has this name, check that the limit on objects permits another object, and
        return ``None``.
        """
        if label and Options(option).flag("@IfNotMember"):
            found = self._named(interface, parent, label)
            if found is not None:
                return CallReply(result=Variant(VarType.I4, found.handle & _ON_WIRE))
        self._check_room()
        return None

    def _named(self, interface: str, parent: int, label: str) -> _Entry | None:
        wanted = label.lower()
        for entry in self._entries.values():
            if entry.parent == parent and entry.interface == interface and entry.label.lower() == wanted:
                return entry
        return None

    def _reply(
        self, function: Function[..., Any], parent: int, label: str, result: Any, provider: Provider | None = None
    ) -> CallReply:
        code = hresult.S_OK
        if type(result) is ResultWithCode:
            code, result = hresult.unsigned(result.code), result.value
        if function.creates:
            result = self._add(function.creates, result, parent, label, provider) & _ON_WIRE
        executes = function.method == "execute"
        if function.result is None or (executes and result is None):
            return CallReply(code, Variant(VarType.EMPTY) if executes and self.host.dialect.replies_vt_empty else None)
        if function.method.endswith("_names") and isinstance(result, list | tuple) and not result:
            result = Variant(_NAMES, [])  # not a VARIANT array, for clients with static types
        try:
            return CallReply(
                code, variant(result) if function.result is VarType.VARIANT else Variant(function.result, result)
            )
        except InvalidValue as error:  # an error of the device, not of the client
            kind = type(result).__name__
            raise TypeError(
                tr("{name} cannot return {kind}: {error}", name=function.name, kind=kind, error=error)
            ) from error

    @staticmethod
    def _handle_error(handle: int, entry: _Entry | None, function: Function[..., Any]) -> str:
        if entry is None:
            return tr("handle {handle} does not exist", handle=handle)
        return tr(
            "handle {handle} is a {interface}, {name} requires a {wanted}",
            handle=handle,
            interface=entry.interface,
            name=function.name,
            wanted=function.interface,
        )

    # --- motion -------------------------------------------------------------------------------------------------

    def is_moving(self) -> bool:
        """Return True if a motion of the client is in progress, or if that is unknown because of an exception."""
        return any(self._moves(entry) for entry in self._controllers())

    def stop_moving(self) -> None:
        """Stop the motions of the client; its objects are kept."""
        self._notify_controllers(
            lambda controller: controller.stop_moving(), "while stopping the motions of a silent client"
        )

    def _notify_controllers(self, notify: Callable[[ControllerObject], object], when: str) -> None:
        """Invoke a callback with each controller object of the client; log the exceptions of the device."""
        for entry in self._controllers():
            try:
                with entry.guard:
                    notify(cast("ControllerObject", entry.served))
            except Exception:
                logger.exception("%s: error %s", entry.label, when)

    def _controllers(self) -> list[_Entry]:
        return [entry for entry in self._entries.values() if entry.interface == "Controller"]

    @staticmethod
    def _moves(entry: _Entry) -> bool:
        try:
            with entry.guard:
                return bool(cast("ControllerObject", entry.served).is_moving())
        except Exception:
            logger.exception("%s: error while querying motions", entry.label)
            return True

    # --- objects ------------------------------------------------------------------------------------------------

    def _check_room(self) -> None:
        if len(self._entries) >= self.host.objects:
            raise error_for(
                hresult.E_MAX_OBJECT,
                tr("the limit is {most} objects per client", most=self.host.objects),
            )

    def _add(self, interface: str, served: object, parent: int, label: str, provider: Provider | None) -> int:
        if not isinstance(served, CaoObject):
            kind = type(served).__name__
            raise TypeError(tr("the device returned {kind} instead of a {interface}", kind=kind, interface=interface))
        if self._closed or (parent and parent not in self._entries):  # the client disconnected during the call
            served.release()
            raise error_for(hresult.E_ABORT, label)
        if self._spaces:
            handle = self._spaces[interface] + self.host.providers[0].handle_of(interface, label)
            if handle in self._entries:  # the client already has this object
                served.release()
                return handle
        else:
            handle = self._handles.take(self._entries)
        guard = self._entries[parent].guard if provider is None else provider.guard
        self._entries[handle] = _Entry(handle, interface, served, parent, label, guard)
        if provider is not None and provider.unique_names:
            self.host.names.hold(label, (id(self), handle))
        return handle

    def _remove(self, handle: int) -> None:
        """Release an object and all objects below it, newest first; an object is always newer than the one above it."""
        doomed = {handle}
        doomed.update(entry.handle for entry in self._entries.values() if entry.parent in doomed)
        for each in [each for each in reversed(self._entries) if each in doomed]:
            self._release_one(each)

    def _release_one(self, handle: int) -> None:
        entry = self._entries.pop(handle)
        if entry.interface == "Controller":
            self._free_name(entry)
        self._kept.change(-sum(entry.kept.values()))
        try:
            with entry.guard:
                entry.served.release()
        except BaseException:
            logger.exception("error while releasing %s %s", entry.interface, quoted(entry.label))

    def close(self) -> None:
        """Release all objects, newest first, after the client has disconnected; create no more objects."""
        self._closed = True
        self._notify_controllers(lambda controller: controller.connection_lost(), "after the loss of its client")
        self._release_all()

    def _release_all(self) -> None:
        while self._entries:
            self._release_one(next(reversed(self._entries)))

    # --- functions of the session itself ------------------------------------------------------------

    def _service_start(self, _function: Function[..., Any], _values: list[Any]) -> CallReply:
        if starts_anew(self.client.transport):
            self.free_names()
        return CallReply()

    def _service_stop(self, _function: Function[..., Any], _values: list[Any]) -> CallReply:
        self._release_all()
        return CallReply()

    def _controller_connect(self, function: Function[..., Any], values: list[Any]) -> Outcome:
        name, provider_name, machine, option = values
        is_unnamed = not name
        provider = self.host.find(provider_name)
        if name:
            existing = self._existing("Controller", 0, name, option)
            if existing is not None:
                return existing
            if self._is_taken(name, option, provider):
                raise error_for(hresult.E_CAO_COLLECTION_REGISTERED, name)
        else:
            self._check_room()
            taken = {entry.label.lower() for entry in self._controllers()}
            numbered = (f"Controller{number}" for number in self._numbers)
            name = next(each for each in numbered if each.lower() not in taken and not self.host.names.is_taken(each))
        with provider.guard:
            made = provider.connect(
                name, machine, option, self.client._replace(provider=provider_name, is_unnamed=is_unnamed)
            )
        return self._outcome(function, 0, name, made, provider)

    def _is_taken(self, name: str, option: str, provider: Provider) -> bool:
        """Return True if a controller has the name, so that no other controller may have it."""
        if provider.unique_names:
            return self.host.names.is_taken(name) and not Options(option).flag("@IfNotMember")
        return not self._spaces and self._named("Controller", 0, name) is not None

    def free_names(self) -> None:
        """Permit other clients to use the names of the controllers of this client."""
        for entry in self._controllers():
            self._free_name(entry)

    def _free_name(self, entry: _Entry) -> None:
        self.host.names.free(entry.label, (id(self), entry.handle))

    def _release(self, function: Function[..., Any], values: list[Any]) -> CallReply:
        self._remove(self._find(function, values[0]).handle)
        return CallReply()


_ON_WIRE: Final = 0xFFFF_FFFF
_SPACES: Final = {
    name: number << 32 for number, name in enumerate(dict.fromkeys(entry.interface for entry in FUNCTIONS.values()))
}


_SPECIAL: Final[dict[int, Callable[[Session, Function[..., Any], list[Any]], Outcome]]] = {
    1: Session._service_start,  # noqa: SLF001 - the class's own table
    2: Session._service_stop,  # noqa: SLF001 - the class's own table
    3: Session._controller_connect,  # noqa: SLF001 - the class's own table
    **{entry.id: Session._release for entry in FUNCTIONS.values() if entry.releases},  # noqa: SLF001 - the class's own table
}

_I4: Final = int(VarType.I4)
_R8: Final = int(VarType.R8)
_UNGUARDED: Final = Provider.guard  # does nothing
_RETURNS_VARIANT, _RETURNS_NOTHING, _RETURNS_OTHER = object(), object(), object()


def _kind(function: Function[..., Any]) -> object:
    """Return what a function of an object returns; ``None`` for the functions of ``_call_unusual``."""
    if function.id in _SPECIAL or function.creates or function.method in STORING_METHODS:
        return None
    if function.result is None:
        return _RETURNS_NOTHING if function.method != "execute" else _RETURNS_OTHER
    return _RETURNS_VARIANT if function.result is VarType.VARIANT else _RETURNS_OTHER


_KINDS: Final = {number: kind for number, each in FUNCTIONS.items() if (kind := _kind(each)) is not None}
_ON_HANDLE: Final = {
    number: FUNCTIONS[number]
    for number in _KINDS
    if len(FUNCTIONS[number].arguments) == 1 and FUNCTIONS[number].arguments[0].is_handle
}
"""The usual functions whose only argument is a handle."""
