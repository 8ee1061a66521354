"""Calls that take effect at the standstill of the arm: GiveArm, Motor off, and Motor on after a stop."""

from __future__ import annotations

from collections.abc import Callable

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.record import record
from orinkit.virtual.rc8.robot.arm_owner import Operator


@record
class _Action:
    """The arguments of :meth:`StandstillActions.add`, and the Deferred that it returned."""

    operator: Operator | None
    run: Callable[[], Deferred[None] | None]
    revocable: bool
    done: Deferred[None]


class StandstillActions:
    """The actions that wait for standstill, in the order of the calls."""

    def __init__(self) -> None:
        self._actions: list[_Action] = []

    def __bool__(self) -> bool:
        return bool(self._actions)

    def add(
        self, operator: Operator | None, run: Callable[[], Deferred[None] | None], *, revocable: bool = False
    ) -> Deferred[None]:
        """Add an action; return a Deferred that resolves when the action is complete.

        Args:
            operator: Operator that has made the call; ``None`` for the pendant.
            run: The action; if it returns a Deferred, the action is complete when this Deferred resolves.
            revocable: True if the action is dropped when the client no longer waits for it.
        """
        action = _Action(operator, run, revocable, Deferred[None](revocable=revocable))
        self._actions.append(action)
        return action.done

    def includes(self, run: Callable[[], Deferred[None] | None]) -> bool:
        """Return True if an action waits."""
        return any(action.run == run and not action.done.done() for action in self._actions)

    def withdraw(self, call: Deferred[None]) -> bool:
        """Drop the action of a call, which fails with E_CANCEL; return False if no action of this call waits."""
        found = [each for each in self._actions if each.done is call and not call.done()]
        self._actions = [each for each in self._actions if each not in found]
        for _ in found:
            call.set_exception(error_for(hresult.E_CANCEL))
        return bool(found)

    def run(self) -> None:
        """Execute all actions; the arm is at standstill."""
        actions, self._actions = self._actions, []
        for action in actions:
            if action.done.done():  # the client no longer waits
                continue
            try:
                result = action.run()
            except CallError as error:
                action.done.set_exception(error)
            else:
                _pass_on(result, action.done)

    def drop(self, error: CallError, operator: Operator | None = None) -> None:
        """Drop the revocable actions of an operator, or all actions if no operator is given; their calls fail."""
        dropped = [each for each in self._actions if operator is None or (each.revocable and each.operator is operator)]
        self._actions = [each for each in self._actions if each not in dropped]
        for action in dropped:
            action.done.set_exception(error)


def _pass_on(result: Deferred[None] | None, done: Deferred[None]) -> None:
    if result is None:
        done.set_result()
        return

    def settle() -> None:
        try:
            result.result()
        except CallError as error:
            done.set_exception(error)
        else:
            done.set_result()

    result.add_done_callback(settle)
