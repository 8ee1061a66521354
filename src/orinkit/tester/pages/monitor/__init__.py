"""The page Monitor: watched variables with their history, errors, and events of a controller."""

from __future__ import annotations

from orinkit.tester.pages.monitor.page import build

__all__ = ["build"]
