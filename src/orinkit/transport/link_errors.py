"""The exceptions of all links."""

from __future__ import annotations

from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost, TransportError
from orinkit.core.i18n import tr


def lost(reason: object) -> ConnectionLost:
    """Return the exception for a link that broke."""
    return ConnectionLost(tr("the connection broke: {reason}", reason=reason))


def closed() -> ConnectionClosed:
    """Return the exception for a link that was closed here."""
    return ConnectionClosed(tr("the connection is closed; connect again"))


def connect_failed(address: object, error: BaseException) -> ConnectFailed:
    """Return the exception for a link that could not be opened."""
    reason = str(error) or type(error).__name__
    return ConnectFailed(
        tr(
            "cannot connect to {address}: {reason}. Try: is the controller on, the address right, the port open?",
            address=address,
            reason=reason,
        )
    )


def other_loop() -> TransportError:
    """Return the exception for a link that is used in another event loop than the one it was opened in."""
    return TransportError(tr("the connection belongs to another event loop; connect again in this one"))
