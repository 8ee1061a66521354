"""Secrets of clients: their validation, the delay of replies to wrong secrets, and the logging of wrong secrets.

The caller supplies the current time.
"""

from __future__ import annotations

import math
import re
from typing import Final, NamedTuple

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

FREE: Final = 5
"""Number of wrong secrets that one address may send before the replies are delayed."""
LONGEST: Final = 1.0
"""Maximum delay of the reply to a wrong secret, s."""

_FIRST: Final = 0.125  # s; the first delay, doubled with each further failure
_FORGOTTEN: Final = 600.0  # s without a failure after which an address is forgotten
_QUIET: Final = 10.0  # s; the minimum time between two log entries for one address
_ADDRESSES: Final = 1000
_SECRET: Final = re.compile(r"[A-Za-z0-9._~-]{16,256}")


def check_secret(secret: str) -> str:
    """Return a secret after checking that it can be sent in an option string.

    Raises:
        InvalidValue: If the secret does not consist of 16 to 256 ASCII letters, digits and ``-._~``.
    """
    if not _SECRET.fullmatch(secret):
        raise InvalidValue(tr("a secret must have 16 to 256 ASCII letters, digits and -._~. Try: openssl rand -hex 16"))
    return secret


class FailureResponse(NamedTuple):
    """The way to handle a wrong secret.

    Attributes:
        delay: delay of the reply, s.
        failures_to_log: number of wrong secrets from the address since the last log entry; 0 for no log entry now.
    """

    delay: float
    failures_to_log: int


class _Record:
    __slots__ = ("failures", "last", "logged", "unreported")

    def __init__(self) -> None:
        self.failures = self.unreported = 0
        self.last = 0.0
        self.logged = -math.inf


class SecretAttempts:
    """Counts wrong secrets by address. The reply to a correct secret is never delayed.

    At most 1,000 addresses are stored. The address whose last failure is the oldest is forgotten first.
    """

    def __init__(self) -> None:
        self._records: dict[str, _Record] = {}  # in the order of the last failures, oldest first

    def failed(self, address: str, now: float) -> FailureResponse:
        """Count a wrong secret, and return the way to handle it.

        Args:
            address: address of the client, or another identification.
            now: the time on a monotonic clock, s.
        """
        record = self._records.pop(address, None)
        if record is None or now - record.last > _FORGOTTEN:
            record = _Record()
        self._records[address] = record
        if len(self._records) > _ADDRESSES:
            del self._records[next(iter(self._records))]
        record.last = now
        record.failures += 1
        record.unreported += 1
        return FailureResponse(self._delay(record.failures - FREE), self._to_report(record, now))

    @staticmethod
    def _delay(beyond: int) -> float:
        return 0.0 if beyond <= 0 else min(LONGEST, math.ldexp(_FIRST, min(beyond, 10) - 1))

    @staticmethod
    def _to_report(record: _Record, now: float) -> int:
        if record.failures < FREE or now - record.logged < _QUIET:
            return 0
        record.logged = now
        count, record.unreported = record.unreported, 0
        return count
