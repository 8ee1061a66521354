"""Fixtures of all gateway tests."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _quiet(no_errors_are_logged: None) -> None:
    """Fail on errors in the log, which are bugs of the gateway."""
