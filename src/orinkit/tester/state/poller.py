"""The values of variables for all pages, each variable read once per cycle: :class:`VariablePoller`."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field
from decimal import Decimal
from time import monotonic, time
from typing import Any, Final, Literal, TypeAlias
from weakref import WeakValueDictionary

from orinkit.cao import functions as f
from orinkit.client._async.controller import AsyncController
from orinkit.client._async.objects import AsyncObjectContainer, AsyncVariable
from orinkit.core.errors import CallError, InvalidHandle, InvalidValue, ObjectReleased, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.history import History
from orinkit.tester.state.shared_poll import PollSource, SharedPoll
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.tester")

OwnerKind: TypeAlias = Literal["controller", "robot", "task", "extension"]

MAX_VARIABLES: Final = 100
"""Number of different variables that are read in a cycle."""
_PERIOD: Final = 0.1  # s; shortest time between the starts of two cycles
_LONGEST: Final = 2.0  # s; longest pause
_NUMBERS: Final = (bool, int, float, Decimal)
_RETRY: Final = 1.0  # s after which a variable that could not be read, or a lost connection, is tried again


@dataclass(frozen=True, slots=True)
class VariableRef:
    """The name of a variable.

    Attributes:
        kind: Type of the object to which it belongs.
        owner: Name of the task or extension; ``""`` for the controller and the robot.
        name: Name of the variable.
    """

    kind: OwnerKind
    owner: str
    name: str

    @property
    def label(self) -> str:
        """The name for users: ``I10``, ``Robot.@SPEED``, ``Pro1.@LINE_NO``."""
        owner = "Robot" if self.kind == "robot" else self.owner
        return f"{owner}.{self.name}" if owner else self.name


@dataclass(eq=False)
class Reading:
    """The latest value of a variable.

    Attributes:
        ref: The variable.
        value: The value with its type; ``None`` if it has not been read yet.
        error: Why it could not be read in the latest cycle; otherwise ``None``.
        history: The past values.
    """

    ref: VariableRef
    value: Variant | None = None
    error: Exception | None = None
    history: History = field(default_factory=History)
    watches: list[Watch] = field(default_factory=list)
    variable: AsyncVariable | None = None
    retry_at: float = 0.0


class Watch:
    """The interest of one page in a variable.

    Attributes:
        reading: The latest value.
        low: The lowest value since :meth:`reset`; ``None`` if there is none, or the value is no number.
        high: The highest value.
    """

    def __init__(self, poller: VariablePoller, reading: Reading) -> None:
        self.reading = reading
        self.low: float | None = None
        self.high: float | None = None
        self._poller: VariablePoller | None = poller

    def reset(self) -> None:
        """Forget the lowest and the highest value."""
        self.low = self.high = None

    def note(self, value: float) -> None:
        """Take a new value into account."""
        self.low = value if self.low is None else min(self.low, value)
        self.high = value if self.high is None else max(self.high, value)

    def close(self) -> None:
        """End the interest; closing again has no effect."""
        poller, self._poller = self._poller, None
        if poller is not None:
            poller.drop(self)


class VariablePoller(SharedPoll):
    """Reads the variables that pages watch, through the connection for polling.

    A cycle reads each variable once, no matter how many pages watch it. The pause between two cycles is at least as
    long as the previous cycle, so that polling takes no more than half of the time of a slow connection. An error of a
    variable does not stop the others.

    Attributes:
        cycles: Number of complete cycles.
        period: Time in s between the starts of the last two cycles.
    """

    def __init__(self, source: PollSource) -> None:
        super().__init__()
        self._source = source
        self._readings: dict[VariableRef, Reading] = {}
        self._owners: WeakValueDictionary[tuple[str, str], AsyncObjectContainer] = WeakValueDictionary()
        self._controller: AsyncController | None = None
        self._started = 0.0
        self.cycles = 0
        self.period = _PERIOD

    def watch(self, ref: VariableRef) -> Watch:
        """Begin to read a variable; the caller must close the result.

        Raises:
            InvalidValue: If too many different variables are watched.
        """
        reading = self._readings.get(ref)
        is_new = reading is None or not reading.watches
        if is_new and sum(bool(each.watches) for each in self._readings.values()) >= MAX_VARIABLES:
            raise InvalidValue(
                tr("at most {most} variables can be watched per connection. Try: remove some", most=MAX_VARIABLES)
            )
        if reading is None:
            self._discard_oldest()
            reading = self._readings[ref] = Reading(ref)
        watch = Watch(self, reading)
        reading.watches.append(watch)
        reading.retry_at = 0.0
        self.begin()
        return watch

    def drop(self, watch: Watch) -> None:
        """End a watch; its history is kept for a later one while there is room."""
        watch.reading.watches.remove(watch)
        self.end()

    def _discard_oldest(self) -> None:
        for ref in [ref for ref, each in self._readings.items() if not each.watches and each.variable is None]:
            if len(self._readings) < MAX_VARIABLES:
                return
            del self._readings[ref]

    async def _cycle(self) -> float:
        started = monotonic()
        self.period, self._started = started - self._started, started
        try:
            controller = await self._source.monitor()
            if controller is not self._controller:
                self._forget()
                self._controller = controller
            await self._read_all(controller)
        except (OrinError, OSError) as error:
            logger.debug("%s: polling: %s", self._source.name, error)
            self._forget()
            for reading in self._readings.values():
                reading.error = error
            return _RETRY
        self.cycles += 1
        duration = monotonic() - started
        return min(max(_PERIOD - duration, duration), _LONGEST)

    async def _read_all(self, controller: AsyncController) -> None:
        """Read all variables; errors of the connection are raised, those of variables are noted."""
        now, clock = time(), monotonic()
        for reading in list(self._readings.values()):
            if not reading.watches:
                await self._release(reading)
            elif clock >= reading.retry_at:
                await self._read(controller, reading, now)

    async def _read(self, controller: AsyncController, reading: Reading, now: float) -> None:
        try:
            if reading.variable is None:
                owner = await self._owner(controller, reading.ref)
                reading.variable = await owner.variable(reading.ref.name)
            handle = reading.variable.handle
            reply = await controller.client.request(f.variable_get_value, handle, exact=True)
        except (CallError, ObjectReleased, InvalidValue) as error:
            if isinstance(error, InvalidHandle | ObjectReleased):
                reading.variable = None
            reading.error, reading.retry_at = error, monotonic() + _RETRY
            return
        reading.value, reading.error = reply.value, None
        numbers = numbers_of(reply.value)
        if numbers:
            reading.history.add(now, numbers)
        if len(numbers) == 1 and math.isfinite(numbers[0]):
            for watch in reading.watches:
                watch.note(numbers[0])

    async def _owner(self, controller: AsyncController, ref: VariableRef) -> AsyncObjectContainer:
        if ref.kind == "controller":
            return controller
        if ref.kind == "robot":
            return await self._source.monitored_robot()
        found = self._owners.get((ref.kind, ref.owner))
        if found is None:
            connect = controller.task if ref.kind == "task" else controller.extension
            found = self._owners[ref.kind, ref.owner] = await connect(ref.owner)
        return found

    async def _release(self, reading: Reading) -> None:
        variable, reading.variable = reading.variable, None
        if variable is not None:
            await variable.close()

    def _forget(self) -> None:
        """Discard the objects of a connection that is closed or lost."""
        self._controller = None
        self._owners.clear()
        for reading in self._readings.values():
            reading.variable = None

    async def _finish(self) -> None:
        for reading in list(self._readings.values()):
            if not reading.watches:
                await self._release(reading)


def numbers_of(value: Variant) -> list[float]:
    """Return the numbers in a value: one for a number, several for an array of numbers, none for anything else."""
    content: Any = value.value
    if isinstance(content, _NUMBERS):
        return [float(content)]
    if isinstance(content, list) and content and all(isinstance(each, _NUMBERS) for each in content):
        return [float(each) for each in content]
    return []
