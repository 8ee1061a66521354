"""Exceptions that all links raise."""

from __future__ import annotations

from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost, TransportError
from orinkit.core.i18n import tr


def lost(reason: object) -> ConnectionLost:
    """Return the exception for a lost connection."""
    return ConnectionLost(tr("connection lost: {reason}", reason=reason))


def closed() -> ConnectionClosed:
    """Return the exception for a link that this side has closed."""
    return ConnectionClosed(tr("the connection is closed. Try: connect again"))


def connect_failed(address: object, error: BaseException) -> ConnectFailed:
    """Return the exception for a link that could not be opened."""
    reason = str(error) or type(error).__name__
    return ConnectFailed(
        tr(
            "cannot connect to {address}: {reason}. Try: check the address and the port, and that the controller is on",
            address=address,
            reason=reason,
        )
    )


def other_loop() -> TransportError:
    """Return the exception for a link that is used in another event loop than the one in which it was opened."""
    return TransportError(tr("the connection belongs to another event loop. Try: connect again in this one"))
