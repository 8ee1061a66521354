"""Who is let in over HTTP, and how the server shows who it is."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from orinkit.errors import InvalidValue
from orinkit.language import pick

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
            raise InvalidValue(
                pick(
                    "a token has ASCII letters, digits and signs only, and no blanks",
                    "トークンに使えるのは空白を除く ASCII の文字だけです",
                )
            )
        given: object = self.hosts
        wrong = [given] if isinstance(given, str) else [name for name in self.hosts if not _HOST.fullmatch(name)]
        if wrong:
            raise InvalidValue(
                pick(
                    f'hosts are names without a port, as ("robot.example",), not {wrong[0]!r:.80}',
                    f'hosts はポートを含まないホスト名のタプルです (例: ("robot.example",)): {wrong[0]!r:.80}',
                )
            )
        if not (math.isfinite(self.idle) and _LEAST_IDLE <= self.idle <= _MOST_IDLE):
            raise InvalidValue(
                pick(
                    f"idle must be {_LEAST_IDLE:g} to {_MOST_IDLE:g} seconds, not {self.idle:g}",
                    f"idle は {_LEAST_IDLE:g}～{_MOST_IDLE:g} 秒でなければなりません ({self.idle:g})",
                )
            )


DEFAULT_HTTP: Final = HttpOptions()
"""Everybody who can reach the port is let in, and is forgotten after a minute of silence."""
