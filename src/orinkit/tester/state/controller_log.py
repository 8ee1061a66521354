"""The errors and events of a controller, for all pages: :class:`ControllerLog`."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from orinkit.client._async.controller import AsyncController, AsyncMessage
from orinkit.client._shared.common import ErrorInfo, unexpected_value
from orinkit.core import hresult
from orinkit.core.errors import CallError, OrinError, ProtocolError
from orinkit.core.hresult import CodeFamily
from orinkit.tester.state.shared_poll import PollSource, SharedPoll

logger = logging.getLogger("orinkit.tester")

MAX_EVENTS: Final = 1000
MAX_LOGGED: Final = 200
"""Number of records of the error log that are read: the newest ones."""
_PERIOD: Final = 0.5  # s
_RETRY: Final = 2.0  # s
_PER_CYCLE: Final = 50  # events fetched in one cycle
_PROGRAM: Final = 10  # index in a record of the error log
_MESSAGE: Final = 12
_ERROR_EVENT: Final = 1
_NO_LEVEL: Final = frozenset({CodeFamily.UNKNOWN, CodeFamily.USER, CodeFamily.GENERAL, CodeFamily.CAO})


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An error or an event.

    Attributes:
        severity: 0 information or notice, 1 to 5 the level of an error.
        time: Local time of the controller; ``None`` if unknown.
        code: Return code, unsigned; of an event without a code its number.
        name: Name of the code; ``""`` if the code is not a return code.
        text: The controller's text.
        place: Program and line, or client, if known.
    """

    severity: int
    time: datetime | None
    code: int
    name: str
    text: str
    place: str = ""

    def matches(self, words: str, least: int) -> bool:
        """Return True if all words occur in the entry, in any case, and its severity is sufficient."""
        whole = f"{self.code:08X} {self.name} {self.text} {self.place}".casefold()
        return self.severity >= least and all(word in whole for word in words.casefold().split())


def severity_of(code: int) -> int:
    """Return the severity of a return code: its level 0 to 5; 1 for an error without a level."""
    info = hresult.lookup(hresult.unsigned(code))
    return max(info.level, int(info.failed and info.family in _NO_LEVEL))


def logged_entry(record: Any) -> LogEntry | None:
    """Return the entry for a record of GetErrorLog; ``None`` if the record has another form."""
    if not isinstance(record, list) or len(record) < 9 or not all(isinstance(each, int) for each in record[:9]):
        return None
    code = hresult.unsigned(record[0])
    year, month, _, day, hour, minute, second, millisecond = record[1:9]
    try:
        time = datetime(year, month, day, hour, minute, second, millisecond * 1000)
    except ValueError:
        time = None
    rest = [*record[9:], *[""] * (_MESSAGE + 4)]
    first = _PROGRAM - 9 if isinstance(rest[0], int) else 0  # some controllers do not send the tick count
    program, line, text = rest[first], rest[first + 1], rest[_MESSAGE - 9]
    client = " ".join(f"{each}" for each in rest[5:7] if isinstance(each, str) and each)
    place = f"{program}:{line}" if program and line else f"{program}" or client
    return LogEntry(
        severity_of(code), time, code, hresult.lookup(code).name, text if isinstance(text, str) else "", place
    )


async def event_entry(message: AsyncMessage) -> LogEntry:
    """Read the properties of a Message object.

    Raises:
        OrinError: If a call fails.
    """
    number, value = await message.get_number(), await message.get_value()
    time, text = await message.get_date_time(), await message.get_description()
    moment = time if isinstance(time, datetime) else None
    if number == _ERROR_EVENT and isinstance(value, int) and hresult.failed(hresult.unsigned(value)):
        code = hresult.unsigned(value)
        return LogEntry(severity_of(code), moment, code, hresult.lookup(code).name, text)
    return LogEntry(0, moment, number, "", text, "" if value is None else f"{value}"[:100])


class ControllerLog(SharedPoll):
    """Fetches the current errors, the error log and the events of a controller while a page displays them.

    Attributes:
        fetches_events: False if the user has switched off the fetching of messages (``Message=False``).
        current: The current errors, newest first.
        logged: The newest records of the error log, newest first.
        events: The events, newest first.
        problems: Why a part could not be read, by its name: ``"current"``, ``"logged"``, ``"events"``.
        version: Counts the changes, so that pages can detect them.
    """

    def __init__(self, source: PollSource, *, fetches_events: bool) -> None:
        super().__init__()
        self._source = source
        self.fetches_events = fetches_events
        self.current: list[ErrorInfo] = []
        self.logged: list[LogEntry] = []
        self.events: deque[LogEntry] = deque(maxlen=MAX_EVENTS)
        self.problems: dict[str, Exception] = {}
        self.version = 0
        self._newest: Any = None

    def refresh(self) -> None:
        """Begin the next cycle at once."""
        self._wake.set()

    def clear_events(self) -> None:
        """Remove the events from the list."""
        self.events.clear()
        self.version += 1

    async def _cycle(self) -> float:
        try:
            controller = await self._source.monitor()
            for name, read in (("current", self._current), ("logged", self._log), ("events", self._events)):
                try:
                    await read(controller)
                    self._note(name, None)
                except (CallError, ProtocolError) as error:
                    self._note(name, error)
        except (OrinError, OSError) as error:
            logger.debug("%s: reading the log: %s", self._source.name, error)
            for name in ("current", "logged", "events"):
                self._note(name, error)
            return _RETRY
        return _PERIOD

    def _note(self, name: str, error: Exception | None) -> None:
        if f"{self.problems.get(name, '')}" == f"{error or ''}":
            return
        self.version += 1
        if error is None:
            self.problems.pop(name, None)
        else:
            self.problems[name] = error

    async def _current(self, controller: AsyncController) -> None:
        found = await controller.errors()
        if found != self.current:
            self.current = found
            self.version += 1

    async def _log(self, controller: AsyncController) -> None:
        """Read the records that are newer than the newest known one; all if that one is gone."""
        logged = await controller.execute("GetErrorLogCount")
        if not isinstance(logged, int):
            raise unexpected_value("GetErrorLogCount", logged)
        count = min(logged, MAX_LOGGED)
        fresh: list[Any] = []
        while len(fresh) < count:
            record = await controller.execute("GetErrorLog", len(fresh))
            if record == self._newest:
                break
            fresh.append(record)
        complete = len(fresh) >= count
        if not fresh and not (complete and self.logged):
            return
        entries = [entry for entry in map(logged_entry, fresh) if entry is not None]
        self.logged = (entries if complete else [*entries, *self.logged])[:MAX_LOGGED]
        self._newest = fresh[0] if fresh else None
        self.version += 1

    async def _events(self, controller: AsyncController) -> None:
        if not self.fetches_events:
            return
        for _ in range(_PER_CYCLE):
            message = await controller.message()
            if message is None:
                return
            async with message:
                self.events.appendleft(await event_entry(message))
            self.version += 1
