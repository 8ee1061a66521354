"""Liveness of clients whose motions run: the motions of a silent client are stopped.

There are two limits on the time for which a client may be silent. The server's limit applies to connectionless clients,
because the server cannot detect that they have disconnected. If such a client exceeds this limit while its arm moves
and no call is in progress, the client is disconnected. The client's own limit (``Alive=<ms>``) applies on every
transport, also during a call. If a client exceeds its own limit, its motions are stopped; if it remains silent, it is
disconnected.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Final, Protocol

from orinkit.cao.session import Session

logger = logging.getLogger("orinkit.server")

GONE: Final = 10.0
"""Seconds of silence after which a client with ``Alive`` is disconnected, unless its ``Alive`` is longer."""


class MonitoredClient(Protocol):
    """A client that is monitored by a :class:`LivenessMonitor`."""

    @property
    def name(self) -> str:
        """The client's name in the log."""

    @property
    def last_request_at(self) -> float:
        """The time of the last request or keep-alive, s."""

    @property
    def last_reply_at(self) -> float:
        """The time of the last reply, s."""

    @property
    def has_call(self) -> bool:
        """True if a call is in progress."""

    @property
    def requested_silence_limit(self) -> float | None:
        """The client's own limit (``Alive``), s; ``None`` if the client has not set it."""

    @property
    def default_silence_limit(self) -> float | None:
        """The server's limit on silence while motions run, s; ``None`` if there is no limit."""

    @property
    def session(self) -> Session | None:
        """The client's objects; ``None`` after it has disconnected."""

    def give_up(self, reason: str) -> None:
        """Disconnect the client, because it has become unreachable."""


class LivenessMonitor:
    """Monitors one client.

    Args:
        loop: the event loop of the client.
        client: the client to monitor.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, client: MonitoredClient) -> None:
        self._loop = loop
        self._client = client
        self._timer: asyncio.TimerHandle | None = None
        self._stopped_at = -1.0  # the value of client.last_request_at when the motions were stopped

    def start(self) -> None:
        """Begin to monitor the client; called with every request.

        Monitoring ends when a client without ``Alive`` is silent and none of its motions runs.
        """
        client_limit = self._client.requested_silence_limit
        if self._timer is None:
            self._check()
        elif client_limit is not None and self._timer.when() > self._loop.time() + client_limit:
            self._timer.cancel()  # this timer was started before the client sent Alive
            self._check()

    def end(self) -> None:
        """Stop monitoring."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _check(self) -> None:
        self._timer = None
        client, now = self._client, self._loop.time()
        session = client.session
        if session is None:
            return
        due = [
            each
            for each in (self._check_client_limit(session, now), self._check_server_limit(session, now))
            if each is not None
        ]
        if due and client.session is session:
            self._timer = self._loop.call_at(min(due), self._check)

    def _check_server_limit(self, session: Session, now: float) -> float | None:
        """Apply the server's limit.

        Returns:
            The time of the next check; ``None`` if no check is necessary before the next request.
        """
        client = self._client
        server_limit = client.default_silence_limit
        if server_limit is None:
            return None
        until = (
            now + server_limit if client.has_call else max(client.last_request_at, client.last_reply_at) + server_limit
        )
        if now < until:
            return until
        if not session.is_moving():
            return None
        client.give_up(f"nothing received for {server_limit:g} s")
        return None

    def _check_client_limit(self, session: Session, now: float) -> float | None:
        """Apply the client's own limit; return the time of the next check, or ``None`` if the client has no limit."""
        client = self._client
        client_limit = client.requested_silence_limit
        if client_limit is None:
            return None
        heard = client.last_request_at
        if now < heard + client_limit:
            return heard + client_limit
        if now >= heard + max(GONE, client_limit):
            client.give_up(
                f"nothing received for {now - heard:.3g} s; it had announced a keep-alive every {client_limit:g} s"
            )
            return None
        if self._stopped_at != heard and session.is_moving():
            self._stopped_at = heard
            logger.warning("%s: silent for %g s: its arm is stopped", client.name, client_limit)
            session.stop_moving()
        return min(now + client_limit, heard + max(GONE, client_limit))


def log_disconnected(session: Session, name: str, reason: object = None) -> None:
    """Log that a client has disconnected; a warning if its arm moves, because closing the session stops the arm.

    Args:
        session: the client's objects, which have not been released yet.
        name: the client's name in the log.
        reason: the reason for the disconnection, for the log.
    """
    because = f": {reason}" if reason else ""
    if session.is_moving():
        logger.warning("%s disconnected while its arm moved%s; the arm is stopped", name, because)
    else:
        logger.info("%s disconnected%s", name, because)
