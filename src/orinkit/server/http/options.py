"""Who is let in over HTTP, and how the server shows who it is."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

_HOST: Final = re.compile(r"[\w.-]+", re.ASCII)
_LEAST_IDLE: Final = 0.1  # s
_MOST_IDLE: Final = 86_400.0


@dataclass(frozen=True, slots=True)
class HttpOptions:
    """How a server listens on ``http://`` and ``https://``.

    Attributes:
        token: what a client has to show as ``Authorization: Bearer ...``; nothing where it is empty.
        cert: PEM file of the server's certificate, for ``https://``.
        key: PEM file of its key; in ``cert`` too where it is empty.
        hosts: further names by which clients may call this server (its Host header); addresses, ``localhost`` and the
            name of the machine are always taken.
        idle: seconds of silence after which a client is forgotten and everything that it holds is released.

    Raises:
        InvalidValue: a token that a header cannot carry, a host name that is none, or seconds that are none from 0.1 to
            86,400.
    """

    token: str = ""
    cert: str = ""
    key: str = ""
    hosts: tuple[str, ...] = ()
    idle: float = 60.0

    def __post_init__(self) -> None:
        if any(not "!" <= sign <= "~" for sign in self.token):
            raise InvalidValue(tr("a token has ASCII letters, digits and signs only, and no blanks"))
        given: object = self.hosts
        wrong = [given] if isinstance(given, str) else [name for name in self.hosts if not _HOST.fullmatch(name)]
        if wrong:
            raise InvalidValue(
                tr('hosts are names without a port, as ("robot.example",), not {wrong!r:.80}', wrong=wrong[0])
            )
        if not (math.isfinite(self.idle) and _LEAST_IDLE <= self.idle <= _MOST_IDLE):
            raise InvalidValue(
                tr(
                    "idle must be {least:g} to {most:g} seconds, not {seconds:g}",
                    least=_LEAST_IDLE,
                    most=_MOST_IDLE,
                    seconds=self.idle,
                )
            )


DEFAULT_HTTP: Final = HttpOptions()
"""Everybody who can reach the port is let in, and is forgotten after a minute of silence."""
