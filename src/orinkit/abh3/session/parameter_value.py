"""Values of parameters and monitors with units, converted from the 32-bit words of TelABH3."""

from __future__ import annotations

from typing import NamedTuple

from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS, TelItem
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_whole, whole


class ParameterValue(NamedTuple):
    """The value of a parameter or a monitor, as read from a driver.

    Attributes:
        address: Address of the parameter or the monitor.
        word: The 32-bit word that represents the value in TelABH3.
        item: Description of the parameter or the monitor; ``None`` for an unknown address.
    """

    address: int
    word: int
    item: TelItem | None

    @property
    def value(self) -> float:
        """The value in :attr:`unit`; for an unknown address, the word itself."""
        return self.word if self.item is None else self.item.decode(self.word)

    @property
    def unit(self) -> str:
        """Unit of the value, ``""`` if it has none."""
        return "" if self.item is None else self.item.unit

    def __str__(self) -> str:
        name = "" if self.item is None else f" {self.item.text}"
        value = self.value
        digits = str(value) if isinstance(value, int) else f"{value:g}"  # "g" would omit digits of a large whole number
        return f"0x{self.address:04X}{name}: {digits} {self.unit}".rstrip()


def parameter(address: int, word: int) -> ParameterValue:
    """Return the value of a parameter from its word."""
    return ParameterValue(address, word, PARAMETERS.get(address))


def monitor(address: int, word: int) -> ParameterValue:
    """Return the value of a monitor from its word."""
    return ParameterValue(address, word, MONITORS.get(address))


def word_of(address: int, value: float, *, raw: bool) -> int:
    """Return the word to write to a parameter.

    Args:
        address: Address of the parameter.
        value: The value in the parameter's unit; with ``raw``, the 32-bit word that represents it.
        raw: True if ``value`` is the word.

    Raises:
        InvalidValue: If the value cannot be written, or if the address is unknown and ``raw`` is False.
    """
    address = check_whole("address", address, 0xFFFF)
    item = PARAMETERS.get(address)
    if item is not None and not raw:
        return item.encode(value)
    if not raw:
        raise InvalidValue(
            tr(
                "the format of parameter 0x{address:04X} is unknown. Try: raw=True with the 32-bit word",
                address=address,
            )
        )
    word = whole(value)
    if word is None:
        raise InvalidValue(
            tr("with raw=True, the value must be a whole number (a 32-bit word), not {value}", value=brief(value))
        )
    return word
