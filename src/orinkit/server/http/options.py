"""Options for HTTP: access control, and the server's certificate."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import check_range

_HOST: Final = re.compile(r"[\w.-]+", re.ASCII)
LEAST_IDLE: Final = 0.1
"""Smallest idle time in s after which a session ends."""
MOST_IDLE: Final = 86_400.0
"""Largest idle time in s after which a session ends."""


@dataclass(frozen=True, slots=True)
class HttpOptions:
    """Options for ``http://`` and ``https://``.

    Attributes:
        token: the token that clients must send as ``Authorization: Bearer ...``; if empty, no token is required.
        cert: PEM file with the server's certificate, for ``https://``.
        key: PEM file with the private key of the certificate; if empty, ``cert`` also contains the key.
        hosts: further host names of this server that clients may send in the Host header. Addresses, ``localhost`` and
            the name of the machine are always accepted.
        idle: idle time in s after which a client's session ends and its objects are released.

    Raises:
        InvalidValue: If the token contains characters that are not allowed in a header, if a host name is invalid, or
            if ``idle`` is not from 0.1 to 86,400.
    """

    token: str = ""
    cert: str = ""
    key: str = ""
    hosts: tuple[str, ...] = ()
    idle: float = 60.0

    def __post_init__(self) -> None:
        if any(not "!" <= sign <= "~" for sign in self.token):
            raise InvalidValue(
                tr(
                    "a token may contain only ASCII letters, digits and punctuation, no spaces, and no line feed at the "
                    "end. Try: Path(...).read_text().strip()"
                )
            )
        given: object = self.hosts
        wrong = [given] if isinstance(given, str) else [name for name in self.hosts if not _HOST.fullmatch(name)]
        if wrong:
            raise InvalidValue(
                tr(
                    'hosts must be host names without a port, such as ("robot.example",), not {wrong!r:.80}',
                    wrong=wrong[0],
                )
            )
        check_range("idle", self.idle, LEAST_IDLE, MOST_IDLE, seconds=True)


DEFAULT_HTTP: Final = HttpOptions()
"""The default options: no token is required, and a session ends after an idle time of one minute."""
