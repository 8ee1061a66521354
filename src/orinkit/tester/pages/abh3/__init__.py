"""The page ABH3: driving the motors, inputs, flags, feedback, CAN frames, and parameters of a motor driver."""

from __future__ import annotations

from orinkit.tester.pages.abh3.page import build

__all__ = ["build"]
