"""client_gave_up: detection of calls without a waiting client."""

from __future__ import annotations

from contextvars import copy_context

import pytest

from orinkit.cao.results import begin_call, client_gave_up

pytestmark = pytest.mark.core


def test_outside_a_call() -> None:
    assert not copy_context().run(client_gave_up)


def test_each_call_has_its_own_state() -> None:
    waits = [True]

    def call(patience: list[bool]) -> list[bool]:
        begin_call(lambda: not patience[0])
        states = [client_gave_up()]
        patience[0] = False
        return [*states, client_gave_up()]

    assert copy_context().run(call, waits) == [False, True]
    assert not copy_context().run(client_gave_up)
