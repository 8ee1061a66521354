"""The exceptions of all links."""

from __future__ import annotations

from orinkit.errors import ConnectFailed, ConnectionClosed, ConnectionLost, TransportError
from orinkit.language import pick


def lost(reason: object) -> ConnectionLost:
    """Return the exception for a link that broke."""
    return ConnectionLost(pick(f"the connection broke: {reason}", f"接続が切れました: {reason}"))


def closed() -> ConnectionClosed:
    """Return the exception for a link that was closed here."""
    return ConnectionClosed(
        pick("the connection is closed; connect again", "接続は閉じられています。接続し直してください")
    )


def connect_failed(address: object, error: BaseException) -> ConnectFailed:
    """Return the exception for a link that could not be opened."""
    reason = str(error) or type(error).__name__
    return ConnectFailed(
        pick(
            f"cannot connect to {address}: {reason}. Try: is the controller on, the address right, the port open?",
            f"{address} に接続できません: {reason}。対処: コントローラの電源、アドレス、ポートを確認してください",
        )
    )


def other_loop() -> TransportError:
    """Return the exception for a link that is used in another event loop than the one it was opened in."""
    return TransportError(
        pick(
            "the connection belongs to another event loop; connect again in this one",
            "接続は別のイベントループのものです。このループで接続し直してください",
        )
    )
