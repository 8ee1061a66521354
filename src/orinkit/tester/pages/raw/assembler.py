"""The packet assembler: a form for each function, and for replies, whose packet is appended to the text."""

from __future__ import annotations

from typing import Any, Final

from nicegui import ui

from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM
from orinkit.cao import functions as f
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Function
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.raw.hex_text import hex_text
from orinkit.raw.options import Role
from orinkit.raw.packets import assemble_reply, assemble_request
from orinkit.tester.pages.raw.connection import ConnectionCard
from orinkit.tester.pages.raw.transmit import TransmitCard
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.fields import Field, NumberField, TextField, ValueField, field_for, read_fields
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession
from orinkit.values.types import VarType

_PROFILES: Final = {"tcp": STREAM, "udp": DATAGRAM, "serial": LINE}
_LAST_SERIAL: Final = 0xFFFF


class AssemblerCard:
    """The card.

    Args:
        session: The page.
        connection: The card of the connection; its role determines the kind of packets and the profile.
        transmit: The card whose text the packets are appended to.
    """

    def __init__(self, session: PageSession, connection: ConnectionCard, transmit: TransmitCard) -> None:
        self._transmit = transmit
        self._fields: list[Field] = []
        self._has_value: ui.checkbox | None = None
        with ui.element("section").classes("ok-card").props("data-testid=raw-assembler"):
            with ui.element("div").classes("ok-row"):
                ui.label(tr("Assemble a packet")).classes("ok-card-title")
                ui.space()
                kinds = {"request": tr("Request"), "reply": tr("Reply")}
                self._kind = ui.toggle(kinds, value="request", on_change=self._rebuild)
                self._kind.props("no-caps unelevated dense data-testid=raw-kind")
            self._build_head()
            self._holder = ui.element("div").classes("ok-form-column")
            self._errors = ErrorBox("error-raw-assemble")
            with ui.element("div").classes("ok-row"):
                append = ui.button(tr("Append"), icon="add").props("outline no-caps data-testid=raw-append")
        append.on_click(reported(session, self._append, self._errors.show))
        connection.on_role(self._set_role)
        self._rebuild()

    def _build_head(self) -> None:
        names = {each.id: f"{each.id} {each.name}" for each in sorted(FUNCTIONS.values(), key=lambda each: each.id)}
        with ui.element("div").classes("ok-raw-head"):
            self._function = ui.select(names, label=tr("Function"), value=f.service_start.id, with_input=True)
            self._function.props("outlined dense options-dense data-testid=raw-function")
            self._serial = NumberField(tr("Serial"), "raw-serial", VarType.I4, "1")
            self._serial.input.props(remove="hint")
            profiles = {"tcp": "TCP", "udp": "UDP", "serial": "COM"}
            self._profile = ui.select(profiles, label=tr("Transport"), value="tcp")
            self._profile.props("outlined dense options-dense data-testid=raw-profile")
        self._description = ui.label().classes("ok-dim")
        self._function.on_value_change(self._rebuild)

    def _set_role(self, role: Role) -> None:
        self._profile.value = role.profile.name
        self._kind.value = "reply" if role.serves else "request"

    def _rebuild(self) -> None:
        """Build the fields of the selected function, or those of a reply."""
        is_request = self._kind.value == "request"
        self._function.visible = is_request
        function = FUNCTIONS.get(self._function.value or 0)
        self._description.text = function.text if is_request and function else ""
        self._holder.clear()
        with self._holder:
            if not is_request:
                code = TextField(tr("Return code"), "raw-code", "0x00000000", tr("0x80004001, or a number"))
                chosen = ui.checkbox(tr("With a value"), value=False).props("dense data-testid=raw-with-value")
                self._has_value = chosen
                with ui.element("div").bind_visibility_from(chosen, "value"):
                    value = ValueField("raw-value", tr("Value"), VarType.I4)
                self._fields = [code, value]
            else:
                self._fields = [field_for(each) for each in function.arguments] if function else []

    async def _append(self) -> None:
        data = await (self._assemble_request() if self._kind.value == "request" else self._assemble_reply())
        if data is None:
            return
        self._transmit.append(hex_text(data).upper())
        serial = int.from_bytes(data[5:7], "little")
        self._serial.input.value = f"{serial + 1 if serial < _LAST_SERIAL else 1}"

    async def _assemble_request(self) -> bytes | None:
        function: Function[..., Any] | None = FUNCTIONS.get(self._function.value or 0)
        if function is None:
            raise InvalidValue(tr("no function is selected"))
        values = await read_fields([self._serial, *self._fields])
        if values is None:
            return None
        return assemble_request(function, values[1:], values[0], _PROFILES[self._profile.value])

    async def _assemble_reply(self) -> bytes | None:
        has_value = self._has_value is not None and self._has_value.value
        values = await read_fields([self._serial, *(self._fields if has_value else self._fields[:1])])
        if values is None:
            return None
        return assemble_reply(_code(values[1]), values[2:], values[0], _PROFILES[self._profile.value])


def _code(text: str) -> int:
    try:
        return int(text.strip(), 0)
    except ValueError:
        raise InvalidValue(tr("{text!r:.40} is not a return code. Try: 0x80004001", text=text)) from None
