"""The 32 inputs of the driver as switches."""

from __future__ import annotations

from nicegui import ui

from orinkit.abh3.table.bits import Bit
from orinkit.core.i18n import N_, tr
from orinkit.tester.state.abh3.cell import DriverCell
from orinkit.tester.ui.bits import BitSwitches, BitText
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_WIDTH = 32
_GROUPS = {"ay": "A/Y", "bx": "B/X", "": N_("Both axes"), "reserved": N_("Not defined")}


class InputsCard:
    """The card with the switches. They show what was sent last; start is displayed only.

    Args:
        session: The page.
        cell: The driver.
    """

    def __init__(self, session: PageSession, cell: DriverCell) -> None:
        self._session, self._cell = session, cell
        self._switches: list[BitSwitches] = []
        self._errors: ErrorBox
        word = cell.connection.dialect.inputs
        with ui.element("section").classes("ok-card ok-third").props("data-testid=inputs"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Inputs")).classes("ok-card-title")
                ui.space()
                self._word = ui.label().classes("ok-value ok-value-small").props("data-testid=inputs-word")
            ui.label(tr("Switches work while driving is enabled. Start is on only while a button is held.")).classes(
                "ok-dim"
            )
            self._errors = ErrorBox("error-inputs")
            for key, title in _GROUPS.items():
                bits = [each for each in range(_WIDTH) if _group(word.by_number.get(each)) == key]
                if bits:
                    self._build_group(key, tr(title), [self._text(each) for each in bits])
        self.refresh()

    def _build_group(self, key: str, title: str, bits: list[BitText]) -> None:
        label = tr("Inputs: {group}", group=title)
        if key == "reserved":
            with ui.expansion(title).props("dense").classes("ok-bit-group"):
                self._switches.append(BitSwitches(label, "input", bits, self._toggle))
            return
        with ui.element("div").classes("ok-bit-group"):
            ui.label(title).classes("ok-dim")
            self._switches.append(BitSwitches(label, "input", bits, self._toggle))

    def _text(self, number: int) -> BitText:
        bit = self._cell.connection.dialect.inputs.by_number.get(number)
        if self._cell.drive.is_start(number):
            return BitText(
                number, bit.text if bit else "", fixed=True, note=tr("on while a button for driving is held")
            )
        return BitText(number, bit.text if bit else tr("bit {number}", number=number))

    async def _toggle(self, number: int, on: bool) -> None:
        async def send() -> None:
            await self._cell.drive.set_input(number, int(on))

        await self._session.guarded(send, self._errors.show)()
        self.refresh()

    def refresh(self) -> None:
        """Show the inputs that were sent last."""
        drive = self._cell.drive
        value = drive.inputs
        text = f"0x{value:08X}"
        if self._word.text != text:
            self._word.text = text
        enabled = drive.usable and not drive.driving and self._session.in_control
        for each in self._switches:
            each.show(value)
            each.enable(enabled)


def _group(bit: Bit | None) -> str:
    """Return the key of the group of a bit."""
    if bit is None:
        return "reserved"
    axis = bit.name.partition("_")[0]
    return {"ay": "ay", "a": "ay", "bx": "bx", "b": "bx"}.get(axis, "")
