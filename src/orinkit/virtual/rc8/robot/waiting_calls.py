"""The calls that wait for a motion, for the planning of motions, or for the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.motion.queue import Ticket, TicketState
from orinkit.virtual.engine.servo import Servo
from orinkit.virtual.rc8.robot.accuracy import Accuracy
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.target import FrameContext

_PASSED: Final = (TicketState.PASSED, TicketState.DONE)
_SERVED: Final = 100  # operators waiting for the arm that are answered in a cycle


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


class MotionCalls:
    """The calls that wait for motions of one arm.

    Args:
        accuracy: Tolerances of the encoders.
        servo: The encoders.
        space: Frames and kinematics.
        seconds: Callback that returns the time since the controller was switched on, s.
    """

    def __init__(
        self, accuracy: Accuracy, servo: Servo, space: FrameContext, seconds: Callable[[], float]
    ) -> None:  # fmt: skip
        self._accuracy = accuracy
        self._servo = servo
        self._space = space
        self._seconds = seconds
        self._calls: list[WaitingCall] = []

    def __bool__(self) -> bool:
        return bool(self._calls)

    def add(self, call: WaitingCall, stop_code: int | None) -> Deferred[None]:
        """Let a call wait, unless its motion has ended; for ``stop_code`` see :meth:`answer`."""
        if not self._finish(call, stop_code):
            self._calls.append(call)
        return call.done

    def answer(self, stop_code: int | None) -> None:
        """Complete the calls whose motions have ended.

        Args:
            stop_code: During a stop the code with which the calls of stopped motions fail, 0 if they succeed.
        """
        calls, self._calls = self._calls, []
        self._calls += [call for call in calls if not self._finish(call, stop_code)]

    def fail(self, error: CallError) -> None:
        """Let all calls fail."""
        calls, self._calls = self._calls, []
        for call in calls:
            call.done.set_exception(error)

    def _finish(self, call: WaitingCall, stop_code: int | None) -> bool:
        """Settle a call if its motion has ended or is late; return True if it is settled."""
        if call.ticket.state is TicketState.STOPPED:
            if stop_code == hresult.S_OK:
                call.done.set_result()
            else:
                call.done.set_exception(error_for(stop_code or hresult.STOPPED_DURING_PC_MOTION))
        elif self._complete(call):
            call.done.set_result()
        elif self._late(call):
            call.done.set_exception(
                error_for(hresult.E_TIMEOUT, tr("the encoders have not arrived in time (MotionTimeout)"))
            )
        return call.done.done()

    def _complete(self, call: WaitingCall) -> bool:
        state, mark = call.ticket.state, call.ticket.motion.mark.mode
        if call.progress is not None:
            return call.ticket.progress >= call.progress
        if mark in ("P", "n"):
            return state in _PASSED
        return state is TicketState.DONE and self._accuracy.arrived(mark, self._servo, self._space)

    def _late(self, call: WaitingCall) -> bool:
        """Return True if the encoders have not arrived within the time of MotionTimeout."""
        timeout = self._accuracy.timeout
        if call.ticket.state is not TicketState.DONE or timeout is None:
            return False
        now = self._seconds()
        call.ended = now if call.ended is None else call.ended
        return (now - call.ended) * 1000 >= timeout


@dataclass(slots=True, eq=False)
class _Taker:
    """The arguments of :meth:`WaitingTakers.add`, and the Deferred that it returned."""

    operator: Operator
    keep: bool
    check: Callable[[], None]
    done: Deferred[None] = field(default_factory=lambda: Deferred[None](revocable=True))


class WaitingTakers:
    """The calls that wait for standstill to take the arm, in their order."""

    def __init__(self) -> None:
        self._takers: list[_Taker] = []

    def __bool__(self) -> bool:
        return bool(self._takers)

    def add(self, operator: Operator, *, keep: bool, check: Callable[[], None]) -> Deferred[None]:
        """Add a call; return its Deferred. For the arguments see :meth:`serve`."""
        taker = _Taker(operator, keep, check)
        self._takers.append(taker)
        return taker.done

    def serve(self, take: Callable[[Operator, bool], None]) -> None:
        """Give the arm to the operators that wait; at most 100 in a cycle.

        Args:
            take: Callback that gives the arm to an operator; the second argument is ``keep``. It is not invoked if the
                ``check`` of the call raises an exception, with which the call then fails, or if the client no longer
                waits.
        """
        served, self._takers = self._takers[:_SERVED], self._takers[_SERVED:]
        for taker in served:
            if taker.done.done():  # the client no longer waits
                continue
            try:
                taker.check()
            except Exception as error:  # noqa: BLE001 - passed to the operator
                taker.done.set_exception(error)
            else:
                take(taker.operator, taker.keep)
                taker.done.set_result()

    def drop(self, error: CallError, operator: Operator | None = None) -> None:
        """Drop the calls of an operator, or all calls if no operator is given; they fail."""
        dropped = [each for each in self._takers if operator in (None, each.operator)]
        self._takers = [each for each in self._takers if each not in dropped]
        for taker in dropped:
            taker.done.set_exception(error)

    def withdraw(self, call: Deferred[None]) -> bool:
        """Drop a call, which fails with E_CANCEL; return False if it does not wait."""
        found = [each for each in self._takers if each.done is call and not call.done()]
        for taker in found:
            self._takers.remove(taker)
            call.set_exception(error_for(hresult.E_CANCEL))
        return bool(found)


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
