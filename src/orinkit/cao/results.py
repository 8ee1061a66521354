"""What a provider's method may return beside the result itself: work for a thread, a promise, a success code."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from typing import Any, Final, Generic, NamedTuple, TypeAlias, TypeVar

T = TypeVar("T")


class BlockingCall(NamedTuple):
    """The rest of a call, to be run in a worker thread because it may wait."""

    run: Callable[[], Any]


class ResultWithCode(NamedTuple):
    """A result together with a success code that is not S_OK, such as S_BUF_FULL."""

    code: int
    value: Any = None


class Deferred(Generic[T]):
    """A result that is set later, for example at the end of a motion; the methods are those of a Future.

    The device calls :meth:`set_result` or :meth:`set_exception` once. Every method may be called from any thread: each
    of their steps is atomic in Python.
    """

    __slots__ = ("_callbacks", "_done", "_error", "_value")

    def __init__(self) -> None:
        self._done = False
        self._value: T | None = None
        self._error: BaseException | None = None
        self._callbacks: list[Callable[[], None]] = []

    def set_result(self, value: T | None = None) -> None:
        """Set the result; nothing happens if the result or an exception is set."""
        self._settle(value, None)

    def set_exception(self, error: BaseException) -> None:
        """Set an exception instead of a result; nothing happens if the result or an exception is set."""
        self._settle(None, error)

    def done(self) -> bool:
        """Return True if there is a result or an exception."""
        return self._done

    def result(self) -> T | None:
        """Return the result or raise the exception; call it only if :meth:`done` returns True."""
        if self._error is not None:
            raise self._error
        return self._value

    def add_done_callback(self, callback: Callable[[], None]) -> None:
        """Call a function once when the result is set, immediately if it is; in the thread that sets the result."""
        self._callbacks.append(callback)
        if self._done:
            self._call_back()

    def _settle(self, value: T | None, error: BaseException | None) -> None:
        if self._done:
            return
        self._value, self._error = value, error
        self._done = True  # before the callbacks are taken: one that is added meanwhile is called by add_done_callback
        self._call_back()

    def _call_back(self) -> None:
        while self._callbacks:
            try:
                callback = self._callbacks.pop()
            except IndexError:  # the other thread took the last one
                return
            callback()


Result: TypeAlias = T | ResultWithCode | Awaitable[T] | BlockingCall | Deferred[T]
"""What a method returns: the result, alone or with a success code, something to await, work for a thread, a promise."""


def _still_waits() -> bool:
    return False


_WAITS_NO_MORE: Final[ContextVar[Callable[[], bool]]] = ContextVar("waits_no_more", default=_still_waits)


def client_gave_up() -> bool:
    """Whether the client waits no more for the call being carried out: it was told that it took too long, or has gone.

    For an ``async`` method that has waited for something, before it does what its client would not expect any more.
    """
    return _WAITS_NO_MORE.get()()


def begin_call(waits_no_more: Callable[[], bool]) -> None:
    """Say, in the task that carries out a call, how :func:`client_gave_up` finds out; for servers."""
    _WAITS_NO_MORE.set(waits_no_more)
