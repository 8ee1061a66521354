"""What a provider's method may return beside the result itself: work for a thread, a promise, a success code."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from typing import Any, Final, Generic, NamedTuple, TypeAlias, TypeVar

T = TypeVar("T")


class Blocking(NamedTuple):
    """The rest of a call, to be run in a worker thread because it may wait."""

    run: Callable[[], Any]


class Coded(NamedTuple):
    """A result together with a success code that is not S_OK, such as S_BUF_FULL."""

    code: int
    value: Any = None


class Later(Generic[T]):
    """A result that comes by itself, for example when a motion is over.

    The device keeps it and calls :meth:`finish` or :meth:`fail` once; whoever waits for it has said so with
    :meth:`when_done`. Each may be called from any thread: each of their steps is one that Python does not interrupt.
    """

    __slots__ = ("_callbacks", "_error", "_value", "done")

    def __init__(self) -> None:
        self.done = False
        self._value: T | None = None
        self._error: BaseException | None = None
        self._callbacks: list[Callable[[], None]] = []

    def finish(self, value: T | None = None) -> None:
        """The result is there; nothing happens if there was one already."""
        self._settle(value, None)

    def fail(self, error: BaseException) -> None:
        """There will be no result but this exception; nothing happens if there was a result already."""
        self._settle(None, error)

    def result(self) -> T | None:
        """Return the result, or raise what the call failed with; to be called when it is done."""
        if self._error is not None:
            raise self._error
        return self._value

    def when_done(self, callback: Callable[[], None]) -> None:
        """Have a function called once when the result is there, at once if it is; in the thread that finishes."""
        self._callbacks.append(callback)
        if self.done:
            self._call_back()

    def _settle(self, value: T | None, error: BaseException | None) -> None:
        if self.done:
            return
        self._value, self._error = value, error
        self.done = True  # before the callbacks are taken: one that is added meanwhile is called by when_done
        self._call_back()

    def _call_back(self) -> None:
        while self._callbacks:
            try:
                callback = self._callbacks.pop()
            except IndexError:  # the other thread took the last one
                return
            callback()


Result: TypeAlias = T | Coded | Awaitable[T] | Blocking | Later[T]
"""What a method returns: the result, alone or with a success code, something to await, work for a thread, a promise."""


def _still_waits() -> bool:
    return False


_WAITS_NO_MORE: Final[ContextVar[Callable[[], bool]]] = ContextVar("waits_no_more", default=_still_waits)


def given_up() -> bool:
    """Whether the client waits no more for the call being carried out: it was told that it took too long, or has gone.

    For an ``async`` method that has waited for something, before it does what its client would not expect any more.
    """
    return _WAITS_NO_MORE.get()()


def begin_call(waits_no_more: Callable[[], bool]) -> None:
    """Say, in the task that carries out a call, how :func:`given_up` finds out; for servers."""
    _WAITS_NO_MORE.set(waits_no_more)
