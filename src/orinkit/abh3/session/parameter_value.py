"""Parameters and monitors with their units, around the words of TelABH3."""

from __future__ import annotations

from typing import NamedTuple

from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS, TelItem
from orinkit.abh3.table.checks import checked, whole
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import brief


class ParameterValue(NamedTuple):
    """What was read from a driver.

    Attributes:
        address: of the parameter or monitor.
        word: the 32 bits.
        item: what is known of it; ``None`` of an address that is in no table.
    """

    address: int
    word: int
    item: TelItem | None

    @property
    def value(self) -> float:
        """The value in its unit; of an unknown address the word itself."""
        return self.word if self.item is None else self.item.decode(self.word)

    @property
    def unit(self) -> str:
        """Unit of the value, ``""`` for none."""
        return "" if self.item is None else self.item.unit

    def __str__(self) -> str:
        name = "" if self.item is None else f" {self.item.text}"
        value = self.value
        digits = str(value) if isinstance(value, int) else f"{value:g}"  # a whole number keeps all of them
        return f"0x{self.address:04X}{name}: {digits} {self.unit}".rstrip()


def parameter(address: int, word: int) -> ParameterValue:
    """Return a parameter that was read."""
    return ParameterValue(address, word, PARAMETERS.get(address))


def monitor(address: int, word: int) -> ParameterValue:
    """Return a monitor that was read."""
    return ParameterValue(address, word, MONITORS.get(address))


def word_of(address: int, value: float, *, raw: bool) -> int:
    """Return the word that a parameter is to be written as.

    Args:
        address: of the parameter.
        value: in its unit.
        raw: the value is the word itself.

    Raises:
        InvalidValue: it cannot be written, or the address is unknown, so that there are words only.
    """
    address = checked("address", address, 0xFFFF)
    item = PARAMETERS.get(address)
    if item is not None and not raw:
        return item.encode(value)
    if not raw:
        raise InvalidValue(
            tr(
                "what parameter 0x{address:04X} holds is not known. Try: raw=True, and the 32 bits as they are",
                address=address,
            )
        )
    word = whole(value)
    if word is None:
        raise InvalidValue(tr("a word is a whole number, not {value}", value=brief(value)))
    return word
