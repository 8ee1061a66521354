"""The parameters of table 5-2 as one string and as fields, and the state of the raw connection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields as fields_of
from typing import Any

from nicegui import ui

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import tr
from orinkit.raw.options import OPTIONS, Role
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.state.raw.fields import ROLES, RawFields, checked_options, initial_fields, proposed_place
from orinkit.tester.state.raw.link import RawLink
from orinkit.tester.ui.errors import ErrorBox, error_text
from orinkit.tester.ui.reporting import reported
from orinkit.tester.ui.session import PageSession

_LAMPS = {
    ConnectionState.CLOSED: "closed",
    ConnectionState.CONNECTING: "connecting",
    ConnectionState.OPEN: "open",
    ConnectionState.LOST: "lost",
}
_LONGEST = 400  # characters


class ConnectionCard:
    """The card. The parameter string and the fields stay in step.

    Args:
        session: The page.
        link: The raw connection.

    Attributes:
        role: The role that the fields show.
    """

    def __init__(self, session: PageSession, link: RawLink) -> None:
        self._session, self._link = session, link
        self._spec = session.connection.spec if session.connection is not None else None
        initial = initial_fields(self._spec)
        self.role = initial.role
        self._is_setting = False
        self._roles: list[Callable[[Role], None]] = []
        self._shown: object = None
        with ui.element("section").classes("ok-card ok-raw-connection").props("data-testid=raw-connection"):
            with ui.element("div").classes("ok-row"):
                self._lamp = ui.element("span").classes("ok-lamp").props("aria-hidden=true")
                self._state = ui.label().classes("ok-raw-state").props("role=status data-testid=raw-state")
            with ui.element("div").classes("ok-raw-parameters"):
                self._build_string(initial)
            self._build_fields(initial)
            self._errors = ErrorBox("error-raw-connection")
        self._connect.on_click(session.guarded(self._open, self._errors.show))
        self._disconnect.on_click(reported(session, link.close, self._errors.show))

    def _build_string(self, initial: RawFields) -> None:
        self._text = ui.input(tr("Parameters"), value=f"{initial}").props(
            "outlined dense debounce=200 data-testid=raw-parameters"
        )
        self._text.props(f"maxlength={_LONGEST} autocomplete=off spellcheck=false").classes("ok-mono ok-grow")
        self._text.without_auto_validation().on_value_change(self._read_string)
        self._connect = ui.button(tr("Connect"), icon="link").props("unelevated no-caps data-testid=raw-connect")
        self._disconnect = ui.button(tr("Disconnect"), icon="link_off").props(
            "outline no-caps data-testid=raw-disconnect"
        )

    def _build_fields(self, initial: RawFields) -> None:
        with ui.element("div").classes("ok-form ok-raw-fields"):
            roles = {int(role): tr(text) for role, text in ROLES.items()}
            self._role = ui.select(roles, label=tr("Role (EtherOpt)"), value=int(initial.role))
            self._role.props("outlined dense options-dense data-testid=raw-role")
            self._place = self._input(tr("Address (Conn)"), "place", initial.place)
            self._clients = self._input(tr("Clients (ConnMax)"), "clients", initial.clients)
            self._timeout = self._input(tr("Time-out (ms)"), "timeout", initial.timeout)
            self._packet_opt = self._input("PacketOpt", "packet_opt", initial.packet_opt)
            self._sync = ui.checkbox(tr("Wait for the reply (Sync)"), value=initial.sync)
            self._sync.props("data-testid=raw-sync")
        for row in OPTIONS:
            field = {"Conn": self._place, "Timeout": self._timeout, "PacketOpt": self._packet_opt, "Sync": self._sync}
            if row.name in field:
                field[row.name].tooltip(f"{row.name}={row.form}: {tr(row.meaning)}")
        self._role.on_value_change(self._change_role)
        self._sync.on_value_change(self._read_fields)
        self._clients.visible = initial.role is Role.TCP_SERVER

    def _input(self, label: str, name: str, value: str) -> ui.input:
        made = ui.input(label, value=value, on_change=self._read_fields).classes("ok-mono")
        made.props(f"outlined dense debounce=200 maxlength={_LONGEST} autocomplete=off spellcheck=false")
        made.without_auto_validation()  # the problems of all fields are determined together
        return made.props(f"data-testid=raw-{name.replace('_', '-')}")

    # --- the string and the fields ------------------------------------------------------------------------------------

    @property
    def _inputs(self) -> dict[str, Any]:
        return {each.name: getattr(self, f"_{each.name}") for each in fields_of(RawFields)}

    def fields(self) -> RawFields:
        """Return the contents of the fields."""
        return RawFields(
            Role(self._role.value), self._place.value or "", self._timeout.value or "", self._packet_opt.value or "",
            self._clients.value or "", bool(self._sync.value),
        )  # fmt: skip

    def on_role(self, callback: Callable[[Role], None]) -> None:
        """Register a callback for changes of the role."""
        self._roles.append(callback)

    def announce(self) -> None:
        """Report the role to the callbacks."""
        for callback in self._roles:
            callback(self.role)

    def _change_role(self) -> None:
        if self._is_setting:
            return
        previous, role = self.role, Role(self._role.value)
        is_proposed = self._place.value == proposed_place(previous, self._spec)
        if is_proposed or Role.SERIAL in (previous, role):
            self._is_setting = True
            self._place.value = proposed_place(role, self._spec)
            self._is_setting = False
        self._read_fields()

    def _read_fields(self) -> None:
        """Show the fields in the string."""
        if self._is_setting:
            return
        self._errors.show(None)
        fields = self.fields()
        self._is_setting = True
        self._text.value, self._text.error = f"{fields}", None
        self._is_setting = False
        self._show_problems(fields.problems())
        self._set_role(fields.role)

    def _read_string(self) -> None:
        """Show the string in the fields."""
        if self._is_setting:
            return
        self._errors.show(None)
        try:
            checked_options(self._text.value or "")
            fields = RawFields.parse(self._text.value)
        except (InvalidValue, InvalidAddress) as error:
            self._text.error = f"{error}"
            return
        self._text.error = None
        self._is_setting = True
        for name, element in self._inputs.items():
            value = getattr(fields, name)
            element.value = int(value) if name == "role" else value
        self._is_setting = False
        self._show_problems({})
        self._set_role(fields.role)

    def _show_problems(self, problems: dict[str, str]) -> None:
        for name in ("place", "timeout", "packet_opt", "clients"):
            self._inputs[name].error = problems.get(name)

    def _set_role(self, role: Role) -> None:
        self._clients.visible = role is Role.TCP_SERVER
        if role is not self.role:
            self.role = role
            self.announce()

    # --- the connection -----------------------------------------------------------------------------------------------

    async def _open(self) -> None:
        options = checked_options(self._text.value or "")
        self._connect.props("loading")
        try:
            await self._link.open(options)
        finally:
            self._connect.props(remove="loading")

    def refresh(self) -> None:
        """Show the current state."""
        link = self._link
        shown = (link.state, link.error, link.notice, link.peers, link.url)
        if shown == self._shown:
            return
        self._shown = shown
        self._lamp.classes(replace=f"ok-lamp ok-{_LAMPS[link.state]}")
        self._state.text = state_text(link)
        is_busy = link.state in (ConnectionState.OPEN, ConnectionState.CONNECTING)
        self._connect.set_enabled(not is_busy)
        self._disconnect.set_enabled(is_busy)
        for element in (self._text, *self._inputs.values()):
            element.set_enabled(not is_busy)


def state_text(link: RawLink) -> str:
    """Return the state of the raw connection for users."""
    if link.state is ConnectionState.CONNECTING:
        return tr("connecting")
    if link.state is ConnectionState.LOST:
        return tr("connection lost: {reason}", reason=error_text(link.error) if link.error else "")
    if link.state is ConnectionState.CLOSED:
        return tr("not connected: {reason}", reason=link.notice) if link.notice else tr("not connected")
    if not link.serves:
        return tr("connected to {url}", url=link.url)
    count = len(link.peers)
    listening = tr("listening on {url}", url=link.url)
    if not count:
        return f"{listening} · " + tr("no client")
    clients = tr("1 client") if count == 1 else tr("{count} clients", count=count)
    return f"{listening} · {clients}: {', '.join(link.peers[:5])}{'…' if count > 5 else ''}"
