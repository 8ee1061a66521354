"""What a client needs beside an address to be let in."""

from __future__ import annotations

from typing import Final, NamedTuple


class Credentials(NamedTuple):
    """What a client shows to a server over HTTP, and how it knows the server.

    Attributes:
        token: is sent as ``Authorization: Bearer ...``; none where it is empty.
        cafile: certificates, PEM, that the server's is to be signed by; those of the system where it is empty.
    """

    token: str = ""
    cafile: str = ""


NOTHING: Final = Credentials()
"""For a server that lets everybody in, known by the system's certificates."""
