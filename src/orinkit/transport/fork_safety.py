"""Connections belong to the process that has opened them: a child that it forks does not keep them.

A forked child has a copy of every descriptor, and a connection lasts as long as anybody has it. Without this the other
side would not see a killed program go while a child of it lives, and an arm that the program moved would go on.

Descriptors are replaced by those of the null device, not closed: their numbers stay in use in the child, where objects
that know nothing of this may close them once more, and an event loop's selector, which the child shares with its parent,
is left alone. Nothing is shut down: for the parent the connection goes on.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Final, Protocol
from weakref import WeakSet

from orinkit.core.errors import ConnectionClosed
from orinkit.core.i18n import tr
from orinkit.transport.link_errors import closed


class Inheritable(Protocol):
    """Something that a forked child is not to keep."""

    def left_behind(self) -> Iterable[int]:
        """Be of no more use, in the child; returns the descriptors that it has. Locks may be held by threads that are gone."""


class ProcessBound:
    """What client links have in common: the exception by which they say that they are of no more use."""

    _left = False

    def _unusable(self) -> ConnectionClosed:
        return _in_child() if self._left else closed()


_kept: Final[WeakSet[Inheritable]] = WeakSet()


def keep_from_children(thing: Inheritable) -> None:
    """Have something left behind in every child that this process forks from now on, as long as it exists."""
    _kept.add(thing)


def _leave_behind() -> None:
    """Run in a forked child, before anything else of it."""
    try:
        nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    except OSError:  # no descriptor is to be had
        nothing = -1
    for each in list(_kept):
        try:
            descriptors = list(each.left_behind())
        except Exception:  # noqa: BLE001, S112 - it was just being closed; the others are to be left behind all the same
            continue
        for descriptor in descriptors:
            _replace(descriptor, nothing)
    _kept.clear()
    if nothing >= 0:
        os.close(nothing)


def _replace(descriptor: int, nothing: int) -> None:
    try:
        if nothing >= 0 and descriptor >= 0:
            os.dup2(nothing, descriptor, inheritable=False)
        else:
            os.close(descriptor)
    except OSError:  # it has been closed meanwhile
        pass


def _in_child() -> ConnectionClosed:
    return ConnectionClosed(
        tr(
            "the connection belongs to the process that opened it, and this is a forked child of "
            "that. Try: connect in the child, or start it with multiprocessing's method 'spawn'"
        )
    )


if hasattr(os, "register_at_fork"):  # not in Windows, which knows no fork
    os.register_at_fork(after_in_child=_leave_behind)
