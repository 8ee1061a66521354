"""Secrets that clients show: which can be used, and how guessing is slowed down and told of; without a clock."""

from __future__ import annotations

import math
import re
from typing import Final, NamedTuple

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

FREE: Final = 5
"""Wrong secrets of one address that are answered at once."""
LONGEST: Final = 1.0
"""Seconds that the answer to a wrong secret is held back at most."""

_FIRST: Final = 0.125  # s, doubled with each failure
_FORGOTTEN: Final = 600.0  # s without a failure
_QUIET: Final = 10.0  # s between two entries in the log for one address
_ADDRESSES: Final = 1000
_SECRET: Final = re.compile(r"[A-Za-z0-9._~-]{16,256}")


def check_secret(secret: str) -> str:
    """Return a secret that an option string can carry.

    Raises:
        InvalidValue: it cannot, or is too short.
    """
    if not _SECRET.fullmatch(secret):
        raise InvalidValue(
            tr("a secret has 16 to 256 ASCII letters, digits and -._~. Try: openssl rand -hex 16 makes one")
        )
    return secret


class SecretDecision(NamedTuple):
    """What is to be done about a wrong secret.

    Attributes:
        delay: seconds until it is answered.
        reported: failures of this address that are to be logged now, those since the last entry; 0 for no entry.
    """

    delay: float
    reported: int


class _Record:
    __slots__ = ("failures", "last", "logged", "untold")

    def __init__(self) -> None:
        self.failures = self.untold = 0
        self.last = 0.0
        self.logged = -math.inf


class SecretAttempts:
    """Counts wrong secrets by address. A right one is never delayed, so nobody asks about it.

    What is kept is bounded: 1,000 addresses, the one that failed longest ago is forgotten first.
    """

    def __init__(self) -> None:
        self._records: dict[str, _Record] = {}  # the address that failed longest ago first

    def failed(self, address: str, now: float) -> SecretDecision:
        """Count a wrong secret.

        Args:
            address: of who has shown it; whatever tells clients apart.
            now: the time, in seconds of any steady clock.
        """
        record = self._records.pop(address, None)
        if record is None or now - record.last > _FORGOTTEN:
            record = _Record()
        self._records[address] = record
        if len(self._records) > _ADDRESSES:
            del self._records[next(iter(self._records))]
        record.last = now
        record.failures += 1
        record.untold += 1
        return SecretDecision(self._delay(record.failures - FREE), self._to_be_told(record, now))

    @staticmethod
    def _delay(beyond: int) -> float:
        return 0.0 if beyond <= 0 else min(LONGEST, math.ldexp(_FIRST, min(beyond, 10) - 1))

    @staticmethod
    def _to_be_told(record: _Record, now: float) -> int:
        if record.failures < FREE or now - record.logged < _QUIET:
            return 0
        record.logged = now
        count, record.untold = record.untold, 0
        return count
