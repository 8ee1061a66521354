"""The page Raw packets: Raw Packet Mode (RC8 5.2)."""

from __future__ import annotations

from orinkit.tester.pages.raw.page import build

__all__ = ["build"]
