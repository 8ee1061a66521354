"""Copying to the clipboard of the user: :func:`copy_text`."""

from __future__ import annotations

import json
from typing import Final

from nicegui import ui

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.tester.ui.session import notify

_COPY: Final = """
(async text => {
  try { await navigator.clipboard.writeText(text); return true; } catch (error) { }
  const area = document.createElement('textarea');
  area.value = text; document.body.append(area); area.select();
  const done = document.execCommand('copy');
  area.remove();
  return done;
})"""
_PATIENCE: Final = 5.0  # s for the browser to copy


async def copy_text(text: str) -> None:
    """Copy a text, and tell the user; call this in an event handler.

    Raises:
        OrinError: If the browser does not permit it.
    """
    if not await ui.run_javascript(f"return await {_COPY}({json.dumps(text)})", timeout=_PATIENCE):
        raise OrinError(tr("the browser does not permit copying. Try: open the page as http://localhost"))
    notify(tr("copied"), "positive")
