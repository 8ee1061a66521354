"""The current errors of the controller and its error log."""

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
        language: Language of the texts; None for the current language of the process.
    """

    def __init__(self, language: Language | None) -> None:
        self._language = language
        self.current = ErrorLog(_CURRENT_LENGTH)
        self.log = ErrorLog()

    def add(self, record: ErrorRecord) -> bool:
        """Log a record; an error also becomes a current error.

        Returns:
            True if the record is an error, False if it is a notice.
        """
        self.log.add(record)
        if is_notice(record.code):
            return False
        self.current.add(record)
        return True

    def clear(self) -> None:
        """Clear the current errors; they remain in the log."""
        self.current.clear()

    @property
    def fatal(self) -> bool:
        """True if a current error has level 5, which only a restart clears."""
        return any(level_of(self.current.at(index).code) >= FATAL for index in range(len(self.current)))

    @property
    def code(self) -> int:
        """The return code of the newest current error, unsigned; 0 if there is none."""
        newest = self.current.newest
        return newest.code if newest else 0

    @property
    def message(self) -> str:
        """The text of the newest current error; the text of success if there is none."""
        newest = self.current.newest
        return newest.message if newest else self.text_of(hresult.S_OK)

    def text_of(self, code: int) -> str:
        """Return the text of a code; an unknown code has the text of an undefined error."""
        info = hresult.CODES.get(hresult.unsigned(code)) or hresult.CODES[hresult.UNDEFINED_ERROR]
        return self._in_language(info)

    def default_message(self, code: int) -> str:
        """Return the text of an error that is raised without a text of its own.

        If the code is unknown, return the text of the range of codes to which it belongs.
        """
        return self._in_language(hresult.lookup(code))

    def _in_language(self, info: ReturnCode) -> str:
        if self._language is None:
            return info.text
        return info.ja if self._language == "ja" else info.en


def level_of(code: int) -> int:
    """Return the level of a code, 0 (notice) to 5 (fatal).

    A code for which the documents define no level, such as a code of CAO, has level 1 if it is an error, otherwise 0.
    """
    info = hresult.lookup(code)
    return info.level if info.family not in _NOT_THE_CONTROLLERS else int(info.failed)


def is_notice(code: int) -> bool:
    """Return True if a code is a success, or an error of level 0, which has no effect on robot, tasks and motor."""
    info = hresult.lookup(code)
    return not info.failed or (info.level == 0 and info.family not in _NOT_THE_CONTROLLERS)
