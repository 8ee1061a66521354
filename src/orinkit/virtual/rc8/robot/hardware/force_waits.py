"""Calls that wait for a state of force control (RC8 provider guide, ForceWaitCondition)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.rc8.robot.arm_owner import Operator

CONTINUE, HALT, END = 0, 1, 2
"""What happens when the condition is met: nothing, the robot stops, robot and force control stop."""

MOST_WAITS: Final = 100
_IGNORED: Final = -1.0
_MILLISECONDS: Final = 1000
_WITHOUT: Final = (_IGNORED,) * 6


@record
class ForceCondition:
    """A condition; all of its parts must hold. -1 means that a part is not looked at.

    Attributes:
        position: Least way of the tool since the start of force control, absolute values, mm and deg.
        force: Least force and moment, absolute values, N and N m.
        time: Least time since the start of force control, ms.
        mode: 0 nothing ends, 1 the robot stops, 2 robot and force control stop.
        timeout: Longest time to wait, ms.
    """

    position: Sequence[float] = _WITHOUT
    force: Sequence[float] = _WITHOUT
    time: float = _IGNORED
    mode: int = CONTINUE
    timeout: float = _IGNORED

    def met(self, position: Sequence[float], force: Sequence[float], seconds: float) -> bool:
        """Return True if the condition holds."""
        if self.time >= 0 and seconds * _MILLISECONDS < self.time:
            return False
        return _reached(self.position, position) and _reached(self.force, force)


def _reached(least: Sequence[float], values: Sequence[float]) -> bool:
    return all(low < 0 or abs(value) >= low for low, value in zip(least, values, strict=True))


@dataclass(slots=True, eq=False)
class _Wait:
    operator: Operator
    condition: ForceCondition
    began: float
    stopping: bool = False
    done: Deferred[None] = field(default_factory=lambda: Deferred[None](revocable=True))


class ForceWaits:
    """The waiting calls.

    Args:
        halt: Callback that stops the robot; ``True`` also ends force control.
        at_rest: Callback that returns True at standstill.
    """

    def __init__(self, halt: Callable[[bool], None], at_rest: Callable[[], bool]) -> None:
        self._waits: list[_Wait] = []
        self._halt = halt
        self._at_rest = at_rest

    def __len__(self) -> int:
        return len(self._waits)

    def add(self, operator: Operator, condition: ForceCondition, now: float) -> Deferred[None]:
        """Return a Deferred that resolves when the condition is met, in modes 1 and 2 at standstill.

        It fails with E_TIMEOUT after the time-out, and with the code of a stop.

        Raises:
            CallError: E_MAX_OBJECT if too many calls wait.
        """
        if len(self._waits) >= MOST_WAITS:
            raise error_for(hresult.E_MAX_OBJECT, tr("{most} calls wait already", most=MOST_WAITS))
        wait = _Wait(operator, condition, now)
        self._waits.append(wait)
        return wait.done

    def step(self, position: Sequence[float], force: Sequence[float], seconds: float, now: float) -> None:
        """Check the conditions in one cycle.

        Args:
            position: Way of the tool since the start of force control, mm and deg.
            force: Force and moment, N and N m.
            seconds: Time since the start of force control, s.
            now: Time since the controller was switched on, s.
        """
        for wait in list(self._waits):
            condition = wait.condition
            if wait not in self._waits:  # cancelled by the stop for an earlier one
                continue
            if wait.done.done():  # its client is lost
                self._waits.remove(wait)
            elif wait.stopping:
                self._finish(wait)
            elif condition.met(position, force, seconds):
                wait.stopping = True
                if condition.mode != CONTINUE:
                    self._halt(condition.mode == END)
                self._finish(wait)
            elif 0 <= condition.timeout <= (now - wait.began) * _MILLISECONDS:
                self._fail(wait, hresult.E_TIMEOUT)

    def cancel(self, code: int, operator: Operator | None = None) -> None:
        """Let the waiting calls fail: all of them, or those of one operator; calls that stop the robot complete."""
        for wait in list(self._waits):
            if not wait.stopping and operator in (None, wait.operator):
                self._fail(wait, code)

    def _finish(self, wait: _Wait) -> None:
        if wait.condition.mode == CONTINUE or self._at_rest():
            self._waits.remove(wait)
            wait.done.set_result()

    def _fail(self, wait: _Wait, code: int) -> None:
        self._waits.remove(wait)
        wait.done.set_exception(error_for(code))
