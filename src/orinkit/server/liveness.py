"""A client whose motions run has to show that it is there; one that does not is stopped.

Two limits. The server's own is for clients without a connection whose end would tell of theirs: nothing heard for that long
while no call of theirs is at work and their arm moves, and they are taken to have gone. The client's own (``Alive=<ms>``)
holds on every wire, also during a call: nothing heard, and what it moves is brought to rest; if it stays silent, it is gone.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Final, Protocol

from orinkit.cao.session import Session

logger = logging.getLogger("orinkit.server")

GONE: Final = 10.0
"""Seconds of silence after which a client is taken to have gone that has promised signs of life."""


class MonitoredClient(Protocol):
    """A client, as far as it is watched."""

    @property
    def heard(self) -> float:
        """When something came from it."""

    @property
    def answered(self) -> float:
        """When it was last answered."""

    @property
    def at_work(self) -> bool:
        """Whether a call of it is at work."""

    @property
    def promise(self) -> float | None:
        """Seconds within which it wants to be heard; ``None`` where it has promised nothing."""

    @property
    def patience(self) -> float | None:
        """Seconds that it may be silent while its motions run and no call is at work; ``None`` without limit."""

    @property
    def session(self) -> Session | None:
        """Its objects, ``None`` where it is no client any more."""

    def give_up(self, reason: str) -> None:
        """It is taken to have gone."""


class LivenessMonitor:
    """Watches one client.

    Args:
        loop: the event loop that it lives in.
        client: who is watched.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, client: MonitoredClient) -> None:
        self._loop = loop
        self._client = client
        self._timer: asyncio.TimerHandle | None = None
        self._stopped_at = -1.0  # what was last heard when its arm was stopped

    def attend(self) -> None:
        """Something has come of the client: watch it from now on, until it is silent and nothing moves."""
        promise = self._client.promise
        if self._timer is None:
            self._look()
        elif promise is not None and self._timer.when() > self._loop.time() + promise:
            self._timer.cancel()  # it was set before the client promised
            self._look()

    def end(self) -> None:
        """Watch it no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        self._timer = None
        client, now = self._client, self._loop.time()
        session = client.session
        if session is None:
            return
        due = [
            each for each in (self._mind_promise(session, now), self._mind_silence(session, now)) if each is not None
        ]
        if due and client.session is session:
            self._timer = self._loop.call_at(min(due), self._look)

    def _mind_silence(self, session: Session, now: float) -> float | None:
        """Return when to look again; ``None`` where nothing can happen before something comes of the client."""
        client = self._client
        patience = client.patience
        if patience is None:
            return None
        until = now + patience if client.at_work else max(client.heard, client.answered) + patience
        if now < until:
            return until
        if not session.is_moving():
            return None
        client.give_up(f"nothing heard for {patience:g} s while its arm moves")
        return None

    def _mind_promise(self, session: Session, now: float) -> float | None:
        client = self._client
        promise = client.promise
        if promise is None:
            return None
        heard = client.heard
        if now < heard + promise:
            return heard + promise
        if now >= heard + max(GONE, promise):
            client.give_up(f"nothing heard for {now - heard:.3g} s; it had promised a sign of life every {promise:g} s")
            return None
        if self._stopped_at != heard and session.is_moving():
            self._stopped_at = heard
            logger.warning("a client is silent for %g s: its arm is stopped", promise)
            session.stop_moving()
        return min(now + promise, heard + max(GONE, promise))
