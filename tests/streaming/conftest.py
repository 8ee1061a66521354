"""Fixtures of the streaming tests."""

from __future__ import annotations

import pytest

from orinkit.virtual.engine import elastic_time


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the controller wait longer than 250 ms, because a busy machine may delay the streaming process that long.

    For tests in real time. The limit of 250 ms is tested with a clock that the test controls (test_slave_late.py).
    """
    monkeypatch.setattr(elastic_time, "LONGEST_WAIT", 5.0)
