"""The parameters and monitors of a driver, as far as they have been read: :class:`ParameterStore`."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from orinkit.abh3.session.parameter_value import ParameterValue
from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS, TelItem
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.driver_connection import DriverConnection

LONGEST_ENTRY: Final = 40
"""Maximum number of characters of a value."""
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WHOLE: Final = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|\d+)", re.ASCII)
_BUS: Final = range(0x4100, 0x4120)
_BUS_TOO: Final = 0x6180

GROUPS: Final = {
    "can": N_("CAN communication"),
    "ay": N_("A/Y data sets"),
    "bx": N_("B/X data sets"),
    "io": N_("Inputs and outputs"),
    "monitors": N_("Monitors (read only)"),
}
"""The groups of parameters, by key."""


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A parameter or a monitor.

    Attributes:
        item: The parameter or monitor.
        group: A key of :data:`GROUPS`.
        writable: False for a monitor.
    """

    item: TelItem
    group: str
    writable: bool = True

    @property
    def concerns_bus(self) -> bool:
        """True if a change may interrupt the communication with the driver."""
        return self.writable and (self.item.address in _BUS or self.item.address == _BUS_TOO)


def _group_of(item: TelItem) -> str:
    if item.address in _BUS or item.address == _BUS_TOO:
        return "can"
    axis = dict(item.title_args).get("axis")
    if item.address < 0x5100:
        return "ay" if axis == "A/Y" else "bx"
    return "io"


ROWS: Final = {
    **{address: ParameterRow(item, _group_of(item)) for address, item in PARAMETERS.items()},
    **{address: ParameterRow(item, "monitors", writable=False) for address, item in MONITORS.items()},
}
"""All known parameters and monitors, by address."""


class ParameterStore:
    """The values that have been read from a driver, for all pages.

    Args:
        connection: The connection.

    Attributes:
        version: Counts the values that were read.
        pending: Number of values that are still to be read.
    """

    def __init__(self, connection: DriverConnection) -> None:
        self._connection = connection
        self._values: dict[int, ParameterValue | Exception] = {}
        self._lock = asyncio.Lock()
        self._cancelled = False
        self.version = 0
        self.pending = 0

    def value(self, address: int) -> ParameterValue | None:
        """Return the value of a parameter or monitor; ``None`` if it has not been read."""
        found = self._values.get(address)
        return found if isinstance(found, ParameterValue) else None

    def problem(self, address: int) -> Exception | None:
        """Return why the driver has refused the latest reading of a parameter or monitor; ``None`` if it has not."""
        found = self._values.get(address)
        return found if isinstance(found, Exception) else None

    async def read(self, addresses: Iterable[int]) -> None:
        """Read parameters or monitors, one after the other, until :meth:`cancel`.

        Raises:
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        async with self._lock:
            wanted, self._cancelled = list(addresses), False
            self.pending = len(wanted)
            try:
                for address in wanted:
                    if self._cancelled:
                        return
                    await self._read(address)
                    self.pending -= 1
            finally:
                self.pending = 0
                self.version += 1

    def cancel(self) -> None:
        """End a reading in progress after the current value."""
        self._cancelled = True

    async def write(self, address: int, text: str) -> None:
        """Write a parameter, and read it back.

        Raises:
            InvalidValue: If there is no such parameter, or the text is not a valid value; nothing was sent.
            ParameterRefused: If the driver refuses the value.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        item = PARAMETERS.get(address)
        if item is None:
            raise InvalidValue(tr("there is no writable parameter {address:04X}", address=address))
        value = parse_value(item, text)
        async with self._lock:
            await self._connection.driver.write_parameter(address, value)
            await self._read(address)

    async def _read(self, address: int) -> None:
        driver = self._connection.driver
        is_monitor = address in MONITORS
        try:
            self._values[address] = await (driver.read_monitor if is_monitor else driver.read_parameter)(address)
        except OSError:  # also DriverTimeout: the bus or the driver does not work at all
            raise
        except OrinError as error:
            self._values[address] = error
        self.version += 1


def parse_value(item: TelItem, text: str) -> float:
    """Return the value that a user has entered for a parameter.

    Raises:
        InvalidValue: If the text is too long, not a number, or not a value of this parameter.
    """
    if len(text) > LONGEST_ENTRY:
        raise InvalidValue(tr("at most {most} characters can be entered", most=LONGEST_ENTRY))
    entry = text.strip().replace("−", "-")
    if item.kind == "pack":
        if _NUMBER.fullmatch(entry) is None:
            raise InvalidValue(tr("{text!r} is not a number. Try: 1.5", text=entry))
        value = float(entry)
    else:
        if _WHOLE.fullmatch(entry) is None:
            raise InvalidValue(tr("{text!r} is not a whole number. Try: 10, or 0x000A", text=entry))
        value = int(entry, 0) if "x" in entry.lower() else int(entry)
    _check_switch(item, value)
    item.encode(value)
    return value


def _check_switch(item: TelItem, value: float) -> None:
    """Check the value of a switch: the unit of a switch consists of its two valid values."""
    choices = choices_of(item)
    if choices and int(value) not in [int(each, 0) for each in choices]:
        raise InvalidValue(tr("{name} must be {choices}", name=item.text, choices=tr(" or ").join(choices)))


def choices_of(item: TelItem) -> list[str]:
    """Return the two valid values of a switch; an empty list for other parameters."""
    return item.unit.split("/") if item.unit.startswith("0x") else []


def unit_of(item: TelItem) -> str:
    """Return the unit of a value; ``""`` if it has none."""
    return "" if choices_of(item) else item.unit


def value_text(value: ParameterValue) -> str:
    """Return a value for display, in a form that can be entered again."""
    item = value.item
    number = value.value
    if item is not None and (item.kind == "bits" or choices_of(item)):
        return f"0x{value.word:08X}" if item.kind == "bits" else f"0x{value.word & 0xFFFF:04X}"
    return f"{number}" if isinstance(number, int) else f"{number:g}"


def hint_of(item: TelItem) -> str:
    """Return the values that a parameter accepts, for users."""
    choices = choices_of(item)
    if choices:
        return tr(" or ").join(choices)
    if item.kind == "pack":
        return tr("a number with up to six digits")
    return tr("32 bits, such as 0x0000000F") if item.kind == "bits" else tr("a whole number, such as 10 or 0x000A")
