"""Fork safety: a connection belongs to the process that opened it, and is closed in forked children.

A forked child has a copy of every descriptor, and a connection stays open until every copy is closed. Without this
module, the connections of a killed program would stay open while a child is alive, and the arm would continue to move.

In the child, a descriptor is not closed, but replaced by the null device, so that its number remains in use. If the
number were reused, an object of the child that still closes it would close a wrong file. The selector of an event loop
is not changed, because the child shares it with its parent. No connection is shut down, because it remains open for the
parent.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Final, Protocol
from weakref import WeakSet

from orinkit.core.errors import ConnectionClosed
from orinkit.core.i18n import tr
from orinkit.transport.link_errors import closed


class ForkAware(Protocol):
    """An object with descriptors that a forked child must not keep."""

    def after_fork_in_child(self) -> Iterable[int]:
        """Invalidate the object in the child and return its descriptors.

        The method must not acquire locks: they may be held by threads that do not exist in the child.
        """


class ProcessBound:
    """Base class of client links: provides the exception for a link that is closed or belongs to another process."""

    _left = False

    def _unusable(self) -> ConnectionClosed:
        return _in_child() if self._left else closed()


_kept: Final[WeakSet[ForkAware]] = WeakSet()


def keep_from_children(thing: ForkAware) -> None:
    """Register an object to be invalidated in every child that this process forks while the object exists."""
    _kept.add(thing)


def _invalidate_in_child() -> None:
    """Invalidate all registered objects; called first in a forked child."""
    try:
        nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    except OSError:  # no descriptor is available
        nothing = -1
    for each in list(_kept):
        try:
            descriptors = list(each.after_fork_in_child())
        except Exception:  # noqa: BLE001, S112 - the parent was closing the object; continue with the others
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
    except OSError:  # the descriptor is already closed
        pass


def _in_child() -> ConnectionClosed:
    return ConnectionClosed(
        tr(
            "the connection belongs to the process that opened it; this is a forked child of "
            "that process. Try: connect in the child, or use multiprocessing's start method 'spawn'"
        )
    )


if hasattr(os, "register_at_fork"):  # Windows has no fork
    os.register_at_fork(after_in_child=_invalidate_in_child)
