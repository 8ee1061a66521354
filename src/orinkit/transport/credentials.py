"""The credentials of a client, and the encoding of its requests."""

from __future__ import annotations

from typing import Final, NamedTuple


class Credentials(NamedTuple):
    """Data by which an HTTP client authenticates itself and verifies the server.

    Attributes:
        token: Token, sent as ``Authorization: Bearer ...``; if it is empty, no token is sent.
        cafile: PEM file of CA certificates for verifying the server's certificate; if it is empty, the CA certificates
            of the system are used.
        charset: Encoding of the bodies of requests, for the header Content-Type; empty for UTF-8.
    """

    token: str = ""
    cafile: str = ""
    charset: str = ""


NOTHING: Final = Credentials()
"""No token, and the CA certificates of the system."""
