"""The errors the controller has now, and the log of all it ever had."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.hresult import CodeFamily, ReturnCode
from orinkit.core.i18n import Language
from orinkit.virtual.rc8.logs import ErrorLog, ErrorRecord

FATAL: Final = 5
_CURRENT_LENGTH: Final = 100
_NOT_THE_CONTROLLERS: Final = frozenset(
    {
        CodeFamily.GENERAL,
        CodeFamily.CAO,
        CodeFamily.PACKET,
        CodeFamily.BUSY,
        CodeFamily.SOCKET,
        CodeFamily.USER,
        CodeFamily.UNKNOWN,
    }
)


class ErrorList:
    """The list of current errors (the 100 newest) and the error log (the 1,000 newest), newest first.

    Args:
        language: of the texts; None for the current language of the process.
    """

    def __init__(self, language: Language | None) -> None:
        self._language = language
        self.current = ErrorLog(_CURRENT_LENGTH)
        self.log = ErrorLog()

    def add(self, record: ErrorRecord) -> bool:
        """Log a record; one that is an error becomes current too.

        Returns:
            whether it is an error, not a notice.
        """
        self.log.add(record)
        if is_notice(record.code):
            return False
        self.current.add(record)
        return True

    def clear(self) -> None:
        """Forget the current errors; the log keeps them."""
        self.current.clear()

    @property
    def fatal(self) -> bool:
        """Whether one of the current errors is of level 5: only a restart clears it."""
        return any(level_of(self.current.at(index).code) >= FATAL for index in range(len(self.current)))

    @property
    def code(self) -> int:
        """The newest current error, unsigned; 0 when there is none."""
        newest = self.current.newest
        return newest.code if newest else 0

    @property
    def message(self) -> str:
        """The text of the newest current error; of success when there is none."""
        newest = self.current.newest
        return newest.message if newest else self.describe(hresult.S_OK)

    def describe(self, code: int) -> str:
        """Return the text of any code; one that is not known is an undefined error."""
        info = hresult.CODES.get(hresult.unsigned(code)) or hresult.CODES[hresult.UNDEFINED_ERROR]
        return self._text_of(info)

    def text(self, code: int) -> str:
        """Return the text under which a code is raised: for an unknown one what its range tells."""
        return self._text_of(hresult.lookup(code))

    def _text_of(self, info: ReturnCode) -> str:
        if self._language is None:
            return info.text
        return info.ja if self._language == "ja" else info.en


def level_of(code: int) -> int:
    """Return the level of a code, 0 a notice to 5 fatal; 1 of an error that has none, as those of CAO."""
    info = hresult.lookup(code)
    return info.level if info.family not in _NOT_THE_CONTROLLERS else int(info.failed)


def is_notice(code: int) -> bool:
    """Return whether a code leaves robot, tasks and motor alone: a success, or a controller code of level 0."""
    info = hresult.lookup(code)
    return not info.failed or (info.level == 0 and info.family not in _NOT_THE_CONTROLLERS)
