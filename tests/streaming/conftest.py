"""What the tests of streaming share as fixtures."""

from __future__ import annotations

import pytest

from orinkit.virtual.engine import elastic_time


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the controller wait longer than 250 ms: a busy machine holds up the streaming process for as long.

    For tests in real time. What 250 ms mean is tested on a clock that the test moves (test_slave_late.py).
    """
    monkeypatch.setattr(elastic_time, "LONGEST_WAIT", 5.0)
