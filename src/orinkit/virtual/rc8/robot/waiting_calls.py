"""The calls that wait for a motion, for the planning of motions, or for the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from orinkit.cao.provider import Deferred
from orinkit.core.errors import CallError
from orinkit.virtual.engine.motion.queue import Ticket


@dataclass(slots=True)
class WaitingCall:
    """A call that waits for a motion.

    Attributes:
        ticket: The motion.
        done: The Deferred of the call.
        progress: Share of the motion after which the call completes, 0 to 1; ``None`` to complete at the pass mark.
        ended: Time at which the command position has reached the end of the motion, s; ``None`` before.
    """

    ticket: Ticket
    done: Deferred[None]
    progress: float | None = None
    ended: float | None = None


@dataclass(slots=True)
class WaitingTaker:
    """The arguments of :meth:`orinkit.virtual.rc8.robot.arm.RC8Arm.take_later`, and the Deferred that it returned."""

    keep: bool
    check: Callable[[], None]
    done: Deferred[None]


@dataclass(slots=True, eq=False)
class PendingMotions:
    """Motions of one call that are being planned.

    Attributes:
        count: Number of motions.
        done: The Deferred of the call.
    """

    count: int
    done: Deferred[Any]


def all_of(calls: Sequence[Deferred[None]]) -> Deferred[None]:
    """Return a Deferred that resolves when all calls have completed; if some failed, it fails as the first of them."""
    done, left = Deferred[None](), len(calls)

    def one_completed() -> None:
        nonlocal left
        left -= 1
        if left:
            return
        try:
            for call in calls:
                call.result()
        except CallError as error:
            done.set_exception(error)
        else:
            done.set_result()

    for call in calls:
        call.add_done_callback(one_completed)
    return done
