"""The page Objects: the objects of a controller, and calls of all functions of CAO."""

from __future__ import annotations

from orinkit.tester.pages.objects.page import build

__all__ = ["build"]
