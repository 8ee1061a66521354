"""Options for HTTP: access control, and the server's certificate."""

from __future__ import annotations

import re
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.core.validation import check_range
from orinkit.ecap.fields import UTF_8, find_charset

_HOST: Final = re.compile(r"[\w.-]+", re.ASCII)
_ORIGIN: Final = re.compile(r"https?://([\w.-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?", re.ASCII | re.IGNORECASE)
LEAST_IDLE: Final = 0.1
"""Smallest idle time in s after which a session ends."""
MOST_IDLE: Final = 86_400.0
"""Largest idle time in s after which a session ends."""


@record
class HttpOptions:
    """Options for ``http://`` and ``https://``.

    Attributes:
        token: the token that clients must send as ``Authorization: Bearer ...``; if empty, no token is required.
        cert: PEM file with the server's certificate, for ``https://``.
        key: PEM file with the private key of the certificate; if empty, ``cert`` also contains the key.
        hosts: further host names of this server that clients may send in the Host header. Addresses, ``localhost`` and
            the name of the machine are always accepted.
        idle: idle time in s after which a client's session ends and its objects are released.
        origins: origins of web pages that may call this server in addition to its own pages, such as
            ``("https://panel.example:8443",)``. By default, pages of other origins are refused.
        charset: encoding of the bodies of requests that do not name one, and of their replies: ``"utf-8"`` or
            ``"shift_jis"``.

    Raises:
        InvalidValue: If the token contains characters that are not allowed in a header, if a host name, an origin or the
            encoding is invalid, or if ``idle`` is not from 0.1 to 86,400.
    """

    token: str = ""
    cert: str = ""
    key: str = ""
    hosts: tuple[str, ...] = ()
    idle: float = 60.0
    origins: tuple[str, ...] = ()
    charset: str = UTF_8

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
        self._check_origins()
        found = find_charset(self.charset)
        if found is None:
            raise InvalidValue(tr('charset must be "utf-8" or "shift_jis", not {charset!r:.40}', charset=self.charset))
        object.__setattr__(self, "charset", found)

    def _check_origins(self) -> None:
        given: object = self.origins
        wrong = [given] if isinstance(given, str) else [name for name in self.origins if not _ORIGIN.fullmatch(name)]
        if wrong:
            raise InvalidValue(
                tr(
                    'origins must be a scheme and a host, without a path, such as ("https://panel.example:8443",), '
                    "not {wrong!r:.80}",
                    wrong=wrong[0],
                )
            )


DEFAULT_HTTP: Final = HttpOptions()
"""The default options: no token is required, and a session ends after an idle time of one minute."""
