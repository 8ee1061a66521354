"""Return types of a provider's methods besides the result itself: a blocking call, a deferred result, a success code."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from typing import Any, Final, Generic, NamedTuple, TypeAlias, TypeVar

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

T = TypeVar("T")


class BlockingCall(NamedTuple):
    """The rest of a call, to be run in a worker thread because it may block."""

    run: Callable[[], Any]


class ResultWithCode(NamedTuple):
    """A result with a success code other than S_OK, such as S_BUF_FULL."""

    code: int
    value: Any = None


class Deferred(Generic[T]):
    """A result that is set later, for example at the end of a motion; the methods are those of a Future.

    The device calls :meth:`set_result` or :meth:`set_exception` once. All methods are thread-safe: each of their steps
    is atomic in Python.

    Args:
        brief: True if another thread computes the result and waits for nothing else. On TCP, the next request of the
            client is then executed after the computation, as if the method had returned the result itself; after one
            second of computing, further requests return E_BUSY_PROC.
        revocable: True if nothing may happen for a client that does not wait any more: :meth:`abandon` then sets
            E_ABORT. The device checks :meth:`done` before it acts.

    Attributes:
        brief: As above. The result may be another Deferred, without ``brief``: the call then continues to wait for it.
    """

    __slots__ = ("_callbacks", "_done", "_error", "_revocable", "_value", "brief")

    def __init__(self, *, brief: bool = False, revocable: bool = False) -> None:
        self.brief = brief
        self._revocable = revocable
        self._done = False
        self._value: T | None = None
        self._error: BaseException | None = None
        self._callbacks: list[Callable[[], None]] = []

    def set_result(self, value: T | None = None) -> None:
        """Set the result; do nothing if a result or an exception has been set."""
        self._settle(value, None)

    def set_exception(self, error: BaseException) -> None:
        """Set an exception instead of a result; do nothing if a result or an exception has been set."""
        self._settle(None, error)

    def abandon(self) -> None:
        """Set E_ABORT if the result is ``revocable``; called before E_TIMEOUT is sent, and after a disconnection."""
        if self._revocable:
            self.set_exception(error_for(hresult.E_ABORT, tr("the client no longer waits for the call")))

    def done(self) -> bool:
        """Return True if there is a result or an exception."""
        return self._done

    def result(self) -> T | None:
        """Return the result or raise the exception; call it only if :meth:`done` returns True."""
        if self._error is not None:
            raise self._error
        return self._value

    def add_done_callback(self, callback: Callable[[], None]) -> None:
        """Register a callback, which is invoked once, when the result is set, in the thread that sets it.

        If the result has already been set, the callback is invoked immediately.
        """
        self._callbacks.append(callback)
        if self._done:
            self._call_back()

    def _settle(self, value: T | None, error: BaseException | None) -> None:
        if self._done:
            return
        self._value, self._error = value, error
        self._done = True  # before the callbacks, so that add_done_callback invokes a callback that is added meanwhile
        self._call_back()

    def _call_back(self) -> None:
        while self._callbacks:
            try:
                callback = self._callbacks.pop()
            except IndexError:  # another thread has invoked the last callback
                return
            callback()


Result: TypeAlias = T | ResultWithCode | Awaitable[T] | BlockingCall | Deferred[T]
"""Return type of a method: result (alone or with a success code), awaitable, blocking call or deferred result."""


def _waits() -> bool:
    return False


_GAVE_UP: Final[ContextVar[Callable[[], bool]]] = ContextVar("gave_up", default=_waits)


def client_gave_up() -> bool:
    """Return True if the client no longer waits for the current call, after E_TIMEOUT or a disconnection.

    After an ``await``, an ``async`` method should check this before it does anything that the client no longer expects.
    """
    return _GAVE_UP.get()()


def begin_call(gave_up: Callable[[], bool]) -> None:
    """Set the function that :func:`client_gave_up` calls in the current task; only servers call ``begin_call``."""
    _GAVE_UP.set(gave_up)
