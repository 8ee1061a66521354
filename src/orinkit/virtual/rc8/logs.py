"""The error log and the operation log: bounded, newest first, as arrays in the form clients read.

Both records begin with the same nine numbers: code, year, month, weekday (0 Sunday), day, hour, minute, second,
millisecond. What follows is not settled by any document for every place; this controller fills

* error log: 9 program name, 10 line, 11 file ID, 12 message, 13 original code, 14 caller, 15 address of the caller;
* operation log: 9 caller, 10 address of the caller, 11 text.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Final, Generic, TypeVar

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Value

T = TypeVar("T")

LOG_LENGTH: Final = 1000


@dataclass(frozen=True, slots=True)
class ErrorRecord:
    """One error, or one notice.

    Attributes:
        code: unsigned, 32 bits.
        message: in the controller's language.
        moment: controller's local date and time.
        subcode: more about the error; 0 where there is nothing.
        program: name of the program, ``""`` outside programs.
        line: line of the program, counted from 1; 0 outside programs.
        file_id: number of the program file.
        original: the code that led to this one, unsigned; 0 where there is none.
        caller: name of the client's controller object, ``""`` where no client is the cause.
        address: address of that client.
    """

    code: int
    message: str
    moment: datetime
    subcode: int = 0
    program: str = ""
    line: int = 0
    file_id: int = 0
    original: int = 0
    caller: str = ""
    address: str = ""

    def as_current(self) -> list[Value]:
        """Return the answer of GetCurErrorInfo; place 3 has the file ID in its high and the line in its low 16 bits."""
        place = (self.file_id & 0x7FFF) << 16 | self.line & 0xFFFF
        code = hresult.signed(self.code)
        return [code, self.message, self.subcode, place, self.program, self.line, self.file_id]

    def as_logged(self) -> list[Value]:
        """Return the answer of GetErrorLog."""
        place: list[Value] = [self.program, self.line, self.file_id]
        origin: list[Value] = [hresult.signed(self.original), self.caller, self.address]
        return [hresult.signed(self.code), *_stamp(self.moment), *place, self.message, *origin]


@dataclass(frozen=True, slots=True)
class OperationRecord:
    """One operation: a client connected, a mode changed.

    Attributes:
        code: kind of operation (:class:`~orinkit.virtual.rc8.state.Operation`).
        text: what was done, in the controller's language.
        moment: controller's local date and time.
        caller: name of the client's controller object, ``""`` for the pendant.
        address: address of that client.
    """

    code: int
    text: str
    moment: datetime
    caller: str = ""
    address: str = ""

    def as_logged(self) -> list[Value]:
        """Return the answer of GetOprLog."""
        return [self.code, *_stamp(self.moment), self.caller, self.address, self.text]


class RecordLog(Generic[T]):
    """A bounded list, newest first: a record too many pushes the oldest out."""

    def __init__(self, length: int = LOG_LENGTH) -> None:
        self._records: deque[T] = deque(maxlen=length)

    def __len__(self) -> int:
        return len(self._records)

    def add(self, record: T) -> None:
        """Put a record in front."""
        self._records.appendleft(record)

    def clear(self) -> None:
        """Forget every record."""
        self._records.clear()

    @property
    def newest(self) -> T | None:
        """The newest record, ``None`` when there is none."""
        return self._records[0] if self._records else None

    def at(self, index: int) -> T:
        """Return a record, 0 the newest.

        Raises:
            CallError: DISP_E_BADINDEX.
        """
        try:
            if index >= 0:
                return self._records[index]
        except IndexError:
            pass
        count = len(self._records)
        raise error_for(hresult.DISP_E_BADINDEX, tr("{index}; there are {count}", index=index, count=count))


ErrorLog = RecordLog[ErrorRecord]
OperationLog = RecordLog[OperationRecord]
Now = Callable[[], datetime]


def _stamp(moment: datetime) -> list[Value]:
    weekday = moment.isoweekday() % 7  # 0 Sunday: year, month, weekday, day ... is the order of Windows' SYSTEMTIME
    date: list[Value] = [moment.year, moment.month, weekday, moment.day]
    return [*date, moment.hour, moment.minute, moment.second, moment.microsecond // 1000]
