"""The credentials of a client."""

from __future__ import annotations

from typing import Final, NamedTuple


class Credentials(NamedTuple):
    """Data by which an HTTP client authenticates itself and verifies the server.

    Attributes:
        token: Token, sent as ``Authorization: Bearer ...``; no token is sent if it is empty.
        cafile: File of the certificates (PEM) that must have signed the server's; if it is empty, those of the system.
    """

    token: str = ""
    cafile: str = ""


NOTHING: Final = Credentials()
"""No token, and the system's certificates."""
