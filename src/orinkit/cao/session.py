"""One client's session: its handles, and the way from a function call to the provider's method and back.

:meth:`Session.invoke` finds the object behind the handle, reads the arguments as the table types them, calls the
method and gives a :class:`CallReply`. Where the method wants to wait, it gives a :class:`Pending`: the caller awaits or
runs ``pending.work`` and hands what came of it to :meth:`Session.complete` or :meth:`Session.fail`.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Container, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from inspect import isawaitable
from traceback import format_exception_only
from typing import Any, Final, TypeAlias, cast

from orinkit.cao.arguments import read_arguments
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.options import Options
from orinkit.cao.provider import (
    BlockingCall,
    CaoObject,
    ClientInfo,
    ControllerObject,
    Deferred,
    Provider,
    ResultWithCode,
)
from orinkit.cao.quota import KEPT, MOST_OF_A_CLIENT, ByteQuota, size_to_keep
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.core.i18n import cut, printable, quoted, tr
from orinkit.values.variant import Variant, VarType, variant

logger = logging.getLogger("orinkit.session")

_FIRST_HANDLE: Final = 2  # as in the documents' samples (RC8 3.1.2): the service itself is 1
_LAST_HANDLE: Final = 0x7FFF_FFFF
_REASONS: Final = 32  # codes of which a client is told why
_MOST_TOLD: Final = 1000  # characters of a reason


@dataclass(frozen=True, slots=True)
class CallReply:
    """The answer to one call.

    Attributes:
        code: return code.
        result: the result, ``None`` for a function that has none.
        detail: for the log and for people: what went wrong, in words.
    """

    code: int = hresult.S_OK
    result: Variant | None = None
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Pending:
    """A call whose method waits for something; ``work`` is an awaitable, :class:`BlockingCall` or :class:`Deferred`."""

    function: Function[..., Any]
    handle: int
    label: str
    work: Any
    provider: Provider | None = None


Outcome: TypeAlias = CallReply | Pending


class ProviderRegistry:
    """The providers that one server offers, by name.

    Args:
        providers: what is served; the first also answers to an unknown name if it lists ``"*"``.
        objects: how many objects one client may hold at a time; more is E_MAX_OBJECT.
    """

    def __init__(self, providers: Provider | Iterable[Provider], objects: int = 1000) -> None:
        self.providers = [providers] if isinstance(providers, Provider) else _checked(providers)
        self.objects = objects
        self.kept = ByteQuota()
        self._by_name = {name.lower(): p for p in reversed(self.providers) for name in _names(p)}
        first, *others = self.providers
        for other in others:
            _check_together(first, other)
        self.dialect = first.dialect
        self.functions = first.functions
        self.fixed_handles = first.fixed_handles

    def find(self, name: str) -> Provider:
        """Return the provider of that name.

        Raises:
            CallError: E_CAO_PROV_INVALID, there is none.
        """
        found = self._by_name.get(name.strip().lower()) or self._by_name.get("*")
        if found is None:
            offered = ", ".join(dict.fromkeys(name for p in self.providers for name in p.provider_names))
            raise error_for(
                hresult.E_CAO_PROV_INVALID,
                tr("{name}; served here: {offered}", name=quoted(name), offered=offered),
            )
        return found


def _checked(given: object) -> list[Provider]:
    listed = list(given) if isinstance(given, Iterable) and not isinstance(given, type) else [given]
    wrong = [each for each in listed if not isinstance(each, Provider)]
    if wrong:
        raise TypeError(
            tr(
                "a Provider or Device object is needed, not {wrong!r:.100}; a class wants brackets: MyDevice()",
                wrong=wrong[0],
            )
        )
    if not listed:
        raise ValueError(tr("there is nothing to serve"))
    return [each for each in listed if isinstance(each, Provider)]


def _check_together(one: Provider, other: Provider) -> None:
    kinds = [(each.dialect, each.functions, each.fixed_handles) for each in (one, other)]
    if kinds[0] != kinds[1]:
        names = type(one).__name__, type(other).__name__
        raise ValueError(
            tr(
                "{first} and {second} speak b-CAP differently and cannot be served together",
                first=names[0],
                second=names[1],
            )
        )


def _names(provider: Provider) -> list[str]:
    names = provider.provider_names
    if not names:
        logger.warning("%s has no provider_names: nobody can connect to it", type(provider).__name__)
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise TypeError(
            tr(
                '{name}.provider_names must be a tuple of names, as ("CaoProv.Example.Gripper",), not {names!r}',
                name=type(provider).__name__,
                names=names,
            )
        )
    return list(names)


class HandleAllocator:
    """Counts handles up, from 2 to 2,147,483,647 and round again; several sessions may share it."""

    def __init__(self) -> None:
        self._next = _FIRST_HANDLE

    def take(self, used: Container[int]) -> int:
        """Return the next one that is not used."""
        while self._next in used:
            self._next = _following(self._next)
        number = self._next
        self._next = _following(number)
        return number


@dataclass(slots=True)
class _Entry:
    handle: int
    interface: str
    served: CaoObject
    parent: int
    label: str
    guard: AbstractContextManager[object]
    kept: dict[str, int] = field(default_factory=dict)  # bytes of what each method has had it keep


class Session:
    """One client's objects, by handle. Handles of one session mean nothing in another.

    Args:
        host: the providers.
        client: who it is.
        numbers: where handles come from; by default they begin at 2.
    """

    def __init__(
        self, host: ProviderRegistry, client: ClientInfo | None = None, numbers: HandleAllocator | None = None
    ) -> None:
        self.host = host
        self._reasons: dict[int, str] = {}
        # not a method of this session: a device that keeps the one must not keep the other
        self.client = (client or ClientInfo())._replace(reason=partial(_reason, self._reasons))
        self._entries: dict[int, _Entry] = {}  # insertion order is age
        self._handles = numbers or HandleAllocator()
        self._kept = ByteQuota(MOST_OF_A_CLIENT, host.kept)
        self._closed = False
        self._numbers = itertools.count(1)
        self._functions = host.functions
        # where each kind of object counts for itself, its handles are kept apart by what the wire's 32 bits do not have
        self._spaces = _SPACES if host.fixed_handles else {}

    def __len__(self) -> int:
        """Return how many objects the client holds."""
        return len(self._entries)

    # --- a call -------------------------------------------------------------------------------------------------

    def invoke(self, function_id: int, arguments: Sequence[Variant]) -> Outcome:
        """Execute a call; nothing that a client sends makes this raise.

        Args:
            function_id: 1 to 137; any other is answered with E_NOTIMPL.
            arguments: with their exact types, as :func:`orinkit.bcap.packet.decode` gives them.
        """
        function = FUNCTIONS.get(function_id)
        if function is None or (self._functions is not None and function_id not in self._functions):
            return CallReply(hresult.E_NOTIMPL, detail=tr("no function {function_id}", function_id=function_id))
        try:
            values = read_arguments(function, arguments)
            special = _SPECIAL.get(function.id)
            if special is not None:
                return special(self, function, values)
            return self._call_method(function, values)
        except BaseException as error:  # noqa: BLE001 - whatever a device raises is answered, SystemExit too
            return self._failed(function, error)

    def complete(self, pending: Pending, result: Any, *, told: bool = True) -> CallReply:
        """Return the reply for a pending call whose work has given ``result``.

        Args:
            pending: the call.
            result: what its work has given.
            told: False where the client was told meanwhile that it failed: an object that it made is let go, for the
                client would never learn its handle.
        """
        try:
            made = result.value if type(result) is ResultWithCode else result
            if not told and isinstance(made, CaoObject):
                made.release()
                raise error_for(hresult.E_ABORT, pending.label)
            return self._reply(pending.function, pending.handle, pending.label, result, pending.provider)
        except BaseException as error:  # noqa: BLE001 - as in invoke
            return self._failed(pending.function, error)

    def fail(self, pending: Pending, error: BaseException) -> CallReply:
        """Return the reply for a pending call whose work has raised ``error``."""
        return self._failed(pending.function, error)

    def _call_method(self, function: Function[..., Any], values: list[Any]) -> Outcome:
        entry = self._find(function, values[0])
        handle = entry.handle
        label = ""
        if function.creates:
            label = values[1] if len(values) > 1 else ""
            existing = self._existing(function.creates, handle, label, values[-1])
            if existing is not None:
                return existing
        if function.method in KEPT:
            self._keep(entry, function.method, values[1])
        with entry.guard:
            result = getattr(entry.served, function.method)(*values[1:])
        return self._outcome(function, handle, label, result)

    def _keep(self, entry: _Entry, method: str, value: Variant) -> None:
        """Count what an object is to keep, instead of what it has kept until now.

        Raises:
            CallError: E_TOO_MUCH_DATA, E_OUTOFMEMORY.
        """
        size = size_to_keep(value)
        self._kept.change(size - entry.kept.get(method, 0))
        entry.kept[method] = size

    def _outcome(
        self, function: Function[..., Any], parent: int, label: str, result: Any, provider: Provider | None = None
    ) -> Outcome:
        if type(result) is Deferred and result.done():
            result = result.result()
        elif type(result) in (BlockingCall, Deferred) or isawaitable(result):
            return Pending(function, parent, label, result, provider)
        return self._reply(function, parent, label, result, provider)

    def _find(self, function: Function[..., Any], handle: int) -> _Entry:
        """Return the object that a function is called on.

        Raises:
            CallError: E_HANDLE, there is none.
        """
        entry = self._entries.get(handle + self._spaces[function.interface] if self._spaces else handle)
        if entry is None or entry.interface != function.interface:
            raise error_for(hresult.E_HANDLE, self._which(handle, entry, function))
        return entry

    def _says_nothing(self, function: Function[..., Any]) -> bool:
        """Whether a function without a result is answered without an argument, where others have VT_EMPTY."""
        return function.method == "execute" and not self.host.dialect.empty_result

    def _existing(self, interface: str, parent: int, label: str, option: str) -> CallReply | None:
        """The object of that name if the client has it and says @IfNotMember; else there must be room for one more."""
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
        if function.result is None or (result is None and self._says_nothing(function)):
            return CallReply(code)
        try:
            return CallReply(
                code, variant(result) if function.result is VarType.VARIANT else Variant(function.result, result)
            )
        except InvalidValue as error:  # the device's fault, not the client's
            kind = type(result).__name__
            raise TypeError(
                tr("{name} cannot return {kind}: {error}", name=function.name, kind=kind, error=error)
            ) from error

    def _failed(self, function: Function[..., Any], error: BaseException) -> CallReply:
        if isinstance(error, CallError) and hresult.failed(error.code):
            # only the code goes over the wire: what the device has to say beside it is told here
            level = logging.INFO if error.detail else logging.DEBUG
            if logger.isEnabledFor(level):
                told = printable(str(error), _MOST_TOLD)
                logger.log(level, "%s: %s", function.name, told, extra={"kind": function.name})
            return self._failure(error.code, error.detail)
        logger.error("%s: the device raised an exception", function.name, exc_info=error, extra={"kind": function.name})
        return self._failure(hresult.E_FAIL, cut("".join(format_exception_only(error)).strip(), _MOST_TOLD))

    def _failure(self, code: int, detail: str) -> CallReply:
        """Return the reply for a call that failed, and remember of what."""
        self._reasons.pop(code, None)
        self._reasons[code] = detail
        if len(self._reasons) > _REASONS:
            del self._reasons[next(iter(self._reasons))]
        return CallReply(code, detail=detail)

    @staticmethod
    def _which(handle: int, entry: _Entry | None, function: Function[..., Any]) -> str:
        if entry is None:
            return tr("handle {handle} is not in use", handle=handle)
        return tr(
            "handle {handle} is a {interface}, {name} needs a {wanted}",
            handle=handle,
            interface=entry.interface,
            name=function.name,
            wanted=function.interface,
        )

    # --- motion -------------------------------------------------------------------------------------------------

    def is_moving(self) -> bool:
        """Whether something moves because of what the client has told it; yes where the device cannot tell."""
        return any(self._moves(entry) for entry in self._controllers())

    def stop_moving(self) -> None:
        """Bring to rest what the client moves; it keeps its objects."""
        for entry in self._controllers():
            try:
                with entry.guard:
                    cast("ControllerObject", entry.served).stop_moving()
            except Exception:
                logger.exception("%s: stopping what a silent client moves", entry.label)

    def _controllers(self) -> list[_Entry]:
        return [entry for entry in self._entries.values() if entry.interface == "Controller"]

    @staticmethod
    def _moves(entry: _Entry) -> bool:
        try:
            with entry.guard:
                return bool(cast("ControllerObject", entry.served).is_moving())
        except Exception:
            logger.exception("%s: asking whether anything moves", entry.label)
            return True

    # --- objects ------------------------------------------------------------------------------------------------

    def _check_room(self) -> None:
        if len(self._entries) >= self.host.objects:
            raise error_for(
                hresult.E_MAX_OBJECT,
                tr("{most} objects per client", most=self.host.objects),
            )

    def _add(self, interface: str, served: object, parent: int, label: str, provider: Provider | None) -> int:
        if not isinstance(served, CaoObject):
            kind = type(served).__name__
            raise TypeError(tr("the device gave {kind} for a {interface}", kind=kind, interface=interface))
        if self._closed or (parent and parent not in self._entries):  # the client left while the device was at work
            served.release()
            raise error_for(hresult.E_ABORT, label)
        if self._spaces:
            handle = self._spaces[interface] + self.host.providers[0].handle_of(interface, label)
            if handle in self._entries:  # it has it already
                served.release()
                return handle
        else:
            handle = self._handles.take(self._entries)
        guard = self._entries[parent].guard if provider is None else provider.guard
        self._entries[handle] = _Entry(handle, interface, served, parent, label, guard)
        return handle

    def _remove(self, handle: int) -> None:
        """Release an object and all below it, newest first; what is below an object is always newer."""
        doomed = {handle}
        doomed.update(entry.handle for entry in self._entries.values() if entry.parent in doomed)
        for each in [each for each in reversed(self._entries) if each in doomed]:
            self._let_go(each)

    def _let_go(self, handle: int) -> None:
        entry = self._entries.pop(handle)
        self._kept.change(-sum(entry.kept.values()))
        try:
            with entry.guard:
                entry.served.release()
        except BaseException:
            logger.exception("release of %s %s", entry.interface, quoted(entry.label))

    def close(self) -> None:
        """Release everything, newest first, for good: the client has gone."""
        self._closed = True
        self._release_all()

    def _release_all(self) -> None:
        while self._entries:
            self._let_go(next(reversed(self._entries)))

    # --- functions that are about the session itself ------------------------------------------------------------

    def _service_start(self, _function: Function[..., Any], _values: list[Any]) -> CallReply:
        return CallReply()

    def _service_stop(self, _function: Function[..., Any], _values: list[Any]) -> CallReply:
        self._release_all()
        return CallReply()

    def _controller_connect(self, function: Function[..., Any], values: list[Any]) -> Outcome:
        name, provider_name, machine, option = values
        provider = self.host.find(provider_name)
        if name:
            existing = self._existing("Controller", 0, name, option)
            if existing is not None:
                return existing
            if not self._spaces and self._named("Controller", 0, name) is not None:
                raise error_for(hresult.E_CAO_COLLECTION_REGISTERED, name)
        else:
            self._check_room()
            name = next(free for n in self._numbers if self._named("Controller", 0, free := f"Controller{n}") is None)
        with provider.guard:
            made = provider.connect(name, machine, option, self.client._replace(provider=provider_name))
        return self._outcome(function, 0, name, made, provider)

    def _release(self, function: Function[..., Any], values: list[Any]) -> CallReply:
        self._remove(self._find(function, values[0]).handle)
        return CallReply()


def _reason(reasons: dict[int, str], code: int) -> str:
    return reasons.get(hresult.unsigned(code), "")


_ON_WIRE: Final = 0xFFFF_FFFF
_SPACES: Final = {
    name: number << 32 for number, name in enumerate(dict.fromkeys(entry.interface for entry in FUNCTIONS.values()))
}


def _following(handle: int) -> int:
    return handle + 1 if handle < _LAST_HANDLE else _FIRST_HANDLE


_SPECIAL: Final[dict[int, Callable[[Session, Function[..., Any], list[Any]], Outcome]]] = {
    1: Session._service_start,  # noqa: SLF001 - the class's own table
    2: Session._service_stop,  # noqa: SLF001
    3: Session._controller_connect,  # noqa: SLF001
    **{entry.id: Session._release for entry in FUNCTIONS.values() if entry.releases},  # noqa: SLF001
}
