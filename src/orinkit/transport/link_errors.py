"""Exceptions that all links raise."""

from __future__ import annotations

import errno
import os
import re
from socket import EAI_NONAME, gaierror
from typing import Final

from orinkit.core.errors import ConnectFailed, ConnectionClosed, ConnectionLost, OrinError, TransportError
from orinkit.core.i18n import N_, tr

_REASONS: Final = {
    errno.ECONNREFUSED: N_("no program listens at this address"),
    errno.ECONNRESET: N_("the peer has reset the connection"),
    errno.EPIPE: N_("the peer has closed the connection"),
    errno.ETIMEDOUT: N_("the peer does not respond"),
    errno.EHOSTUNREACH: N_("the peer cannot be reached"),
    errno.ENETUNREACH: N_("the network of the peer cannot be reached"),
}
_NUMBERS: Final = re.compile(r"\[Errno (\d+)\]")


def reason_of(error: BaseException) -> object:
    """Return why a link failed: a text for users, without the number of the error, or an exception of orinkit."""
    if isinstance(error, OrinError):
        return error
    if isinstance(error, gaierror):
        return tr("the host name is unknown") if error.errno == EAI_NONAME else error.strerror or f"{error}"
    number = _number_of(error)
    if number in _REASONS:
        return tr(_REASONS[number])
    return (os.strerror(number) if number else f"{error}") or type(error).__name__


def _number_of(error: BaseException) -> int:
    """Return the number of an error; 0 if it has none, or several."""
    if isinstance(error, OSError) and error.errno:
        return error.errno
    if isinstance(error, TimeoutError):
        return errno.ETIMEDOUT
    # If a host has several addresses, asyncio raises one exception with the texts of all errors.
    numbers = set(_NUMBERS.findall(f"{error}"))
    return int(numbers.pop()) if len(numbers) == 1 else 0


def lost(reason: object) -> ConnectionLost:
    """Return the exception for a lost connection."""
    what = reason_of(reason) if isinstance(reason, OSError) else reason
    return ConnectionLost(tr("connection lost: {reason}", reason=what))


def closed() -> ConnectionClosed:
    """Return the exception for a link that this side has closed."""
    return ConnectionClosed(tr("the connection is closed. Try: connect again"))


def connect_failed(address: object, error: BaseException) -> ConnectFailed:
    """Return the exception for a link that could not be opened."""
    return ConnectFailed(
        tr(
            "cannot connect to {address}: {reason}. Try: check the address and the port, and that the controller is on",
            address=address,
            reason=reason_of(error),
        )
    )


def other_loop() -> TransportError:
    """Return the exception for a link that is used in another event loop than the one in which it was opened."""
    return TransportError(tr("the connection belongs to another event loop. Try: connect again in this one"))
