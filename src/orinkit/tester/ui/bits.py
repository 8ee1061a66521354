"""The bits of a word, as switches or as lamps with text: :class:`BitSwitches`, :class:`BitLamps`."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from orinkit.core.i18n import tr


@dataclass(frozen=True, slots=True)
class BitText:
    """A bit for display.

    Attributes:
        number: Number of the bit.
        title: Meaning of the value 1.
        fixed: True for a switch that only displays the bit.
        note: Further explanation.
        tone: Colour of the lamp when it is on, if it differs from that of the other lamps.
    """

    number: int
    title: str
    fixed: bool = False
    note: str = ""
    tone: str = ""


class _Bits(ui.element, component="bits.js"):
    """A list of bits.

    Args:
        label: Text for screen readers.
        marker: Beginning of the values of ``data-testid``, which end with the number of the bit.
        bits: The bits, in order.
    """

    def __init__(self, label: str, marker: str, bits: Sequence[BitText]) -> None:
        super().__init__()
        self._props["bits"] = [
            {
                "number": each.number, "title": each.title, "fixed": each.fixed, "note": each.note, "tone": each.tone,
            }
            for each in bits
        ]  # fmt: skip
        self._props.update(value=None, enabled=False, switches=False, label=label, marker=marker, tone="good")
        self._props["texts"] = {"on": tr("on"), "off": tr("off"), "unknown": tr("unknown")}

    def show(self, value: int | None) -> None:
        """Show a word; ``None`` if it is unknown."""
        self._set("value", value)

    def _set(self, name: str, value: object) -> None:
        if self._props[name] != value:
            self._props[name] = value
            self.update()


class BitLamps(_Bits):
    """Bits as lamps with text; each lamp has a label for screen readers.

    Args:
        label: Text for screen readers.
        marker: Beginning of the values of ``data-testid``.
        bits: The bits, in order.
        tone: Colour of a lamp that is on: ``"good"``, ``"warn"`` or ``"bad"``.
    """

    def __init__(self, label: str, marker: str, bits: Sequence[BitText], *, tone: str = "good") -> None:
        super().__init__(label, marker, bits)
        self._props["tone"] = tone


class BitSwitches(_Bits):
    """Bits as switches; they show the word that was passed to :meth:`show`, not the clicks of the user.

    Args:
        label: Text for screen readers.
        marker: Beginning of the values of ``data-testid``.
        bits: The bits, in order.
        toggle: Event handler for the number of a bit and its new value.
    """

    def __init__(
        self, label: str, marker: str, bits: Sequence[BitText], toggle: Callable[[int, bool], Awaitable[Any]]
    ) -> None:
        super().__init__(label, marker, bits)
        self._props["switches"] = True
        self._numbers = {each.number for each in bits if not each.fixed}
        self._toggle = toggle
        self.on("toggle", self._pressed)

    def enable(self, enabled: bool) -> None:
        """Permit or prevent switching."""
        self._set("enabled", enabled)

    async def _pressed(self, event: GenericEventArguments) -> None:
        number = event.args.get("number") if isinstance(event.args, dict) else None
        if number in self._numbers:
            await self._toggle(number, bool(event.args.get("on")))
