"""The page Connections: virtual controllers, connections, and the form for new ones (RC8 table 5-1)."""

from __future__ import annotations

from orinkit.tester.pages.connections.page import build

__all__ = ["build"]
