"""The error log and the operation log: of limited length, newest record first, in the layout that clients read.

The records of both logs begin with the same nine numbers: code, year, month, weekday (0 Sunday), day, hour, minute,
second, millisecond, then the milliseconds since power-on (provider guide 5.2.11.10 and 12). The remaining elements are,
by index:

* error log: 10 program name, 11 line, 12 message, 13 original code, 14 client ID;
* operation log: 10 client ID, 11 text.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from datetime import datetime
from enum import IntEnum
from typing import Final, Generic, TypeVar

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.variant import Value

T = TypeVar("T")

LOG_LENGTH: Final = 1000


class ClientId(IntEnum):
    """The source of an entry of a log (provider guide 5.2.11.10)."""

    UNKNOWN = -1
    SYSTEM = 0
    PENDANT = 1
    IO = 2
    PC = 3
    PAC = 4


@record
class ErrorRecord:
    """One error or notice.

    Attributes:
        code: Return code, unsigned, 32 bits.
        message: Text in the controller's language.
        moment: Local date and time of the controller.
        subcode: Additional code; 0 if there is none.
        program: Name of the program; ``""`` outside programs.
        line: Line of the program, counted from 1; 0 outside programs.
        file_id: Number of the program file.
        original: Code that caused this error, unsigned; 0 if there is none.
        tick: Milliseconds since power-on.
        client_id: Who has caused the error.
    """

    code: int
    message: str
    moment: datetime
    subcode: int = 0
    program: str = ""
    line: int = 0
    file_id: int = 0
    original: int = 0
    tick: int = 0
    client_id: int = ClientId.SYSTEM

    def as_current(self, *, dated: bool = False) -> list[Value]:
        """Return the record in the layout of GetCurErrorInfo.

        Element 3 contains the file ID in its high 16 bits and the line in its low 16 bits.

        Args:
            dated: Use the layout of an RC9: an eighth element with the date, and the code as additional code if there is
                no other one.
        """
        place = (self.file_id & 0x7FFF) << 16 | self.line & 0xFFFF
        code = hresult.signed(self.code)
        items: list[Value] = [code, self.message, self.subcode, place, self.program, self.line, self.file_id]
        if dated:
            items[2] = self.subcode or code
            items.append(self.moment)
        return items

    def as_logged(self) -> list[Value]:
        """Return the record in the layout of GetErrorLog."""
        place: list[Value] = [self.tick, self.program, self.line]
        origin: list[Value] = [hresult.signed(self.original), int(self.client_id)]
        return [hresult.signed(self.code), *_stamp(self.moment), *place, self.message, *origin]


@record
class OperationRecord:
    """One operation, such as a connection of a client or a change of mode.

    Attributes:
        code: Type of operation (:class:`~orinkit.virtual.rc8.state.Operation`).
        text: Description in the controller's language.
        moment: Local date and time of the controller.
        tick: Milliseconds since power-on.
        client_id: Who has caused the operation.
    """

    code: int
    text: str
    moment: datetime
    tick: int = 0
    client_id: int = ClientId.SYSTEM

    def as_logged(self) -> list[Value]:
        """Return the record in the layout of GetOprLog."""
        return [int(self.code), *_stamp(self.moment), self.tick, int(self.client_id), self.text]


class RecordLog(Generic[T]):
    """A list of records with a maximum length, newest first; if the list is full, the oldest record is dropped."""

    def __init__(self, length: int = LOG_LENGTH) -> None:
        self._records: deque[T] = deque(maxlen=length)

    def __len__(self) -> int:
        return len(self._records)

    def add(self, record: T) -> None:
        """Add a record as the newest one."""
        self._records.appendleft(record)

    def clear(self) -> None:
        """Remove all records."""
        self._records.clear()

    @property
    def newest(self) -> T | None:
        """The newest record, or ``None`` if there is none."""
        return self._records[0] if self._records else None

    def at(self, index: int) -> T:
        """Return a record by index; 0 is the newest.

        Raises:
            CallError: DISP_E_BADINDEX.
        """
        try:
            if index >= 0:
                return self._records[index]
        except IndexError:
            pass
        count = len(self._records)
        raise error_for(
            hresult.DISP_E_BADINDEX,
            tr("index {index} is out of range; the log has {count} records", index=index, count=count),
        )


ErrorLog = RecordLog[ErrorRecord]
OperationLog = RecordLog[OperationRecord]
Now = Callable[[], datetime]


def _stamp(moment: datetime) -> list[Value]:
    weekday = moment.isoweekday() % 7  # 0 is Sunday; the fields have the order of SYSTEMTIME on Windows
    date: list[Value] = [moment.year, moment.month, weekday, moment.day]
    return [*date, moment.hour, moment.minute, moment.second, moment.microsecond // 1000]
