"""Detects that the user of a page is gone, during a motion that needs the user: :class:`Presence`."""

from __future__ import annotations

import asyncio
from time import monotonic
from typing import Final

from nicegui import ui
from nicegui.events import GenericEventArguments

from orinkit.core.i18n import tr
from orinkit.tester.ui.session import PageSession

_INTERVAL: Final = 0.1  # s between two heartbeats
_CHECK: Final = 0.02  # s
_EVENT: Final = "ok-heartbeat"
_SCRIPT: Final = f"""
if (!window.okPresence) {{
  const beat = () => emitEvent('{_EVENT}', {{hidden: document.hidden}});
  document.addEventListener('visibilitychange', beat);
  window.addEventListener('pagehide', () => emitEvent('{_EVENT}', {{hidden: true}}));
  window.okPresence = setInterval(beat, {int(_INTERVAL * 1000)});
}}
"""


class Presence:
    """Heartbeats of a page. They cease if the page is closed, the browser ends, or the network fails.

    A gap that exceeds the limit counts even if heartbeats follow: if the Tester itself was blocked, it receives the heartbeats
    of that time at once, possibly before anything has checked the time. A motion must not continue by itself then.

    Args:
        session: The page.
        limit: Time in s without a heartbeat after which the user counts as gone.
    """

    def __init__(self, session: PageSession, limit: float) -> None:
        self._session = session
        self._limit = limit
        self._latest = monotonic()
        self._hidden = False
        self._missed = False
        ui.on(_EVENT, self._beat, ["hidden"])

    def begin(self) -> None:
        """Start the heartbeats; call this before :meth:`lost`."""
        self._latest, self._hidden, self._missed = monotonic(), False, False
        self._session.client.run_javascript(_SCRIPT)

    def end(self) -> None:
        """Stop the heartbeats."""
        self._session.client.run_javascript("clearInterval(window.okPresence); window.okPresence = null")

    @property
    def reason(self) -> str:
        """Why the user counts as gone; ``""`` if the user is present."""
        if self._session.client.is_deleted:
            return tr("the page was closed")
        if self._hidden:
            return tr("the page is hidden")
        if self._missed or self._is_late:
            return tr("nothing was received from the browser for {seconds:g} s", seconds=self._limit)
        return ""

    async def lost(self) -> str:
        """Wait until the user is gone; return the reason."""
        while not self.reason:  # noqa: ASYNC110 - the reason depends on the time
            await asyncio.sleep(_CHECK)
        return self.reason

    @property
    def _is_late(self) -> bool:
        return monotonic() - self._latest > self._limit

    def _beat(self, event: GenericEventArguments) -> None:
        self._missed |= self._is_late
        self._latest = monotonic()
        self._hidden = bool(event.args["hidden"])
