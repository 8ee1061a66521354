"""Date and time of the controller, which clients can set (``@CURRENT_TIME``)."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.clock import Clock

_FIRST_YEAR: Final = 1980
_LAST_YEAR: Final = 2099  # well below datetime.max, so that later time stamps do not overflow


class Calendar:
    """The clock's date and time plus an offset set by clients; a restart resets the offset."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._offset = timedelta()

    def now(self) -> datetime:
        """Return the controller's local date and time."""
        return self._clock.wall() + self._offset

    def set(self, moment: datetime) -> None:
        """Set the controller's local date and time.

        Raises:
            CallError: E_INVALIDARG if the year is outside 1980 to 2099.
        """
        if not _FIRST_YEAR <= moment.year <= _LAST_YEAR:
            raise error_for(
                hresult.E_INVALIDARG,
                tr(
                    "the year must be {first_year} to {last_year}, not {year}",
                    first_year=_FIRST_YEAR,
                    last_year=_LAST_YEAR,
                    year=moment.year,
                ),
            )
        self._offset = moment - self._clock.wall()
