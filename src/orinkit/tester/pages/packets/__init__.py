"""The page Packets: all packets that were sent and received, their bytes and their meaning."""

from __future__ import annotations

from orinkit.tester.pages.packets.page import build

__all__ = ["build"]
