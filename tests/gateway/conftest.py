"""What all tests of the gateway share."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _quiet(no_errors_are_logged: None) -> None:
    """An error in the log is a bug of the gateway."""
