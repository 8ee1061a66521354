"""The page Programs: the files of a controller, an editor, and the tasks."""

from __future__ import annotations

from orinkit.tester.pages.programs.page import build

__all__ = ["build"]
