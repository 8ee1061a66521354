"""The page Arm: the arm in 3D, its state, jogging, stored poses, and the pendant of a virtual RC8."""

from __future__ import annotations

from orinkit.tester.pages.arm.page import build

__all__ = ["build"]
