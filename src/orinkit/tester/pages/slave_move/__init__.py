"""The page Slave Move (RC8 5.1.1): the source of the set-points, the check, the sequence, and what was measured."""

from __future__ import annotations

from orinkit.tester.pages.slave_move.page import build

__all__ = ["build"]
