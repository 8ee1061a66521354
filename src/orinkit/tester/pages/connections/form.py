"""The form for a new connection: the parameters of RC8 table 5-1, as fields and as one string; saved connections."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.pages.connections.string_field import StringField
from orinkit.tester.state.connection_spec import VRC, ConnectionSpec
from orinkit.tester.state.connection_text import spec_of_string, string_of
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession
from orinkit.transport.address import parse_address

_EXAMPLES: Final = {
    "tcp": "192.168.0.1:5007",
    "udp": "192.168.0.1:5007",
    "serial": "/dev/ttyUSB0?baudrate=38400",
    "http": "192.168.0.1:8080",
    "can": "socketcan/can0",
}
_PROVIDERS: Final = (VRC, "CaoProv.DENSO.VRC9", "CaoProv.DENSO.NetwoRC", "")
_SOCKETS: Final = ("tcp", "udp")
_SCHEMES: Final = {**{scheme: scheme for scheme in _EXAMPLES}, "https": "http"}


class ConnectionForm:
    """The form. The fields and the connection string follow each other."""

    def __init__(self, session: PageSession) -> None:
        self._session = session
        self._adopting = False  # True while the fields follow the string, or a saved connection

    def build(self) -> Iterator[None]:
        """Build the elements in several parts."""
        session = self._session
        with ui.element("section").classes("ok-card ok-new").props("data-testid=connection-form"):
            ui.label(tr("New connection")).classes("ok-card-title")
            self._build_saved()
            yield
            self._build_fields()
            with ui.expansion(tr("More parameters")).props("dense").classes("ok-more"):
                yield
                self._build_parameters()
            self._string = StringField(session, self._take_string, lambda error: self._errors.show(error))
            self._errors = ErrorBox("error-form")
            self._build_buttons()
        self._saved.on_value_change(self._load)
        self._scheme.on_value_change(self._scheme_changed)
        self._url.on_value_change(self._url_changed)
        for field in self._parameters():
            field.on_value_change(self._changed)

    def _build_saved(self) -> None:
        saved = [each.name for each in self._session.workspace.profiles]
        self._saved = ui.select(saved, label=tr("Saved connections"), clearable=True)
        self._saved.props("outlined dense").props("data-testid=saved")
        self._saved.visible = bool(saved)

    def _build_fields(self) -> None:
        self._scheme = ui.toggle(
            {"tcp": "TCP", "udp": "UDP", "serial": tr("Serial"), "http": "HTTP", "can": "CAN"}, value="tcp"
        )
        self._scheme.props("no-caps unelevated dense spread").props("data-testid=scheme")
        with ui.element("div").classes("ok-form"):
            self._url = ui.input(tr("Address"), placeholder=_EXAMPLES["tcp"]).classes("ok-mono")
            self._url.props("outlined dense debounce=250 maxlength=4000 data-testid=url").without_auto_validation()
            self._name = ui.input(tr("Name")).props("outlined dense maxlength=60 data-testid=name")

    def _build_parameters(self) -> None:
        with ui.element("div").classes("ok-form"):
            self._provider = ui.select(
                list(_PROVIDERS), label=tr("Provider"), value=VRC, with_input=True, new_value_mode="add-unique"
            )
            self._machine = ui.input(tr("Machine"), placeholder="localhost")
            self._option = ui.input(tr("Option"))
            self._timeout = ui.number(tr("Time-out (ms)"), min=0, max=3_600_000, precision=0, placeholder=tr("default"))
            self._tries = ui.number(tr("Attempts (UDP, serial)"), value=5, min=1, max=7, precision=0)
            self._token = ui.input(tr("Access token (HTTP)"), password=True)
            self._robot = ui.number(tr("Robot (ID)"), value=0, min=0, max=1, precision=0)
            self._driver = ui.number(tr("Driver address (CAN)"), value=1, min=1, max=63, precision=0)
            self._dialect = ui.select(["v1", "v2"], label=tr("Dialect (CAN)"), value="v1")
            for field, marker in (
                (self._provider, "provider"), (self._machine, "machine"), (self._option, "option"),
                (self._timeout, "timeout"), (self._tries, "tries"), (self._token, "token"),
                (self._robot, "robot"), (self._driver, "driver"), (self._dialect, "dialect"),
            ):  # fmt: skip
                field.props("outlined dense debounce=250 maxlength=4000").props(f"data-testid=field-{marker}")
        self._messages = ui.checkbox(tr("Fetch messages (Message)"), value=True).props("data-testid=field-messages")
        self._debug = ui.checkbox(tr("Debug: $LAST_SEND_PACKET$, $LAST_RECEIVE_PACKET$"))
        self._debug.props("data-testid=field-debug")

    def _build_buttons(self) -> None:
        guarded = self._session.guarded
        with ui.element("div").classes("ok-row"):
            self._connect = ui.button(tr("Connect"), icon="link", on_click=guarded(self._open, self._errors.show))
            self._connect.props("unelevated no-caps data-testid=connect")
            save = ui.button(tr("Save"), icon="bookmark_add", on_click=guarded(self._save, self._errors.show))
            save.props("flat no-caps data-testid=save")

    def _parameters(self) -> tuple[ValueElement[Any], ...]:
        """Return the fields of the connection string besides transport and address."""
        return (
            self._provider, self._machine, self._option, self._timeout, self._tries, self._messages, self._debug,
        )  # fmt: skip

    # --- the parameters -----------------------------------------------------------------------------------------

    def spec(self) -> ConnectionSpec:
        """Return the entered parameters.

        Raises:
            InvalidAddress, InvalidValue: If a parameter is invalid.
        """
        self._string.check()
        entered = self._entered()
        if not entered.url:
            raise InvalidValue(tr("the address is empty. Try: {example}", example=_EXAMPLES[self._scheme.value]))
        return entered.renamed(entered.name or entered.url.partition("://")[2]).check()

    def _entered(self) -> ConnectionSpec:
        """Return the entered parameters, which may be invalid."""
        url = (self._url.value or "").strip()
        if url and "://" not in url:
            url = f"{self._scheme.value}://{url}"
        return ConnectionSpec(
            (self._name.value or "").strip(),
            url,
            provider=self._provider.value or "",
            machine=(self._machine.value or "").strip(),
            option=(self._option.value or "").strip(),
            messages=self._messages.value,
            timeout=int(self._timeout.value or 0),
            tries=int(self._tries.value or 1),
            debug=self._debug.value,
            token=self._token.value or "",
            robot=int(self._robot.value or 0),
            driver=int(self._driver.value or 0),
            dialect=self._dialect.value or "",
        )

    def _adopt(self, spec: ConnectionSpec) -> None:
        """Display parameters in the fields."""
        with self._following():
            self._scheme.value = _SCHEMES.get(spec.scheme, "tcp")
            self._url.value, self._name.value = spec.url, spec.name
            self._machine.value, self._option.value = spec.machine, spec.option
            self._provider.set_options(list(dict.fromkeys([*_PROVIDERS, spec.provider])), value=spec.provider)
            self._timeout.value, self._tries.value = spec.timeout or None, spec.tries
            self._messages.value, self._debug.value = spec.messages, spec.debug
            self._robot.value = spec.robot
            self._driver.value, self._dialect.value = spec.driver, spec.dialect
        self._show_scheme()

    @contextmanager
    def _following(self) -> Iterator[None]:
        self._adopting = True
        try:
            yield
        finally:
            self._adopting = False

    def _scheme_changed(self) -> None:
        """Replace the scheme of the address; without one that fits, the address is removed."""
        scheme, (given, separator, rest) = self._scheme.value, (self._url.value or "").partition("://")
        if not self._adopting and separator and _SCHEMES.get(given) != scheme:
            with self._following():
                self._url.value = f"{scheme}://{rest}" if scheme in _SOCKETS and given in _SOCKETS else ""
        self._changed()

    def _url_changed(self) -> None:
        """Select the transport of an address that begins with its scheme."""
        given, separator, _ = (self._url.value or "").partition("://")
        if not self._adopting and separator and given in _SCHEMES:
            with self._following():
                self._scheme.value = _SCHEMES[given]
        self._changed()

    def _changed(self) -> None:
        """Update what depends on the fields, unless they follow the string."""
        if not self._adopting:
            self._show_scheme()
            self._string.show(string_of(self._entered()))

    def _show_scheme(self) -> None:
        """Display the errors of the address, and what depends on the transport."""
        scheme = self._scheme.value
        self._url.props(f"placeholder={_EXAMPLES[scheme]}")
        self._url.error = _problem(self._entered().url)
        self._string.input.visible = scheme != "can"

    def _take_string(self, text: str) -> None:
        """Let the fields follow the connection string.

        Raises:
            InvalidAddress, InvalidValue: If the string is not valid; the fields then remain.
        """
        self._adopt(spec_of_string(text, self._entered()))

    # --- buttons ------------------------------------------------------------------------------------------------

    async def _open(self) -> None:
        spec = self.spec()
        self._string.remember(string_of(spec))
        self._connect.props("loading")
        try:
            connection = self._session.workspace.add(spec)
            await connection.open()
            self._session.choose(connection)
        finally:
            self._connect.props(remove="loading")

    def _save(self) -> None:
        self._session.workspace.profiles.save(self.spec())
        self._saved.set_options([each.name for each in self._session.workspace.profiles])
        self._saved.visible = True

    def _load(self) -> None:
        spec = self._session.workspace.profiles.get(self._saved.value or "")
        if spec is not None:
            self._adopt(spec)
            self._string.show(string_of(spec))


def _problem(url: str) -> str | None:
    try:
        if url:
            parse_address(url)
    except (InvalidAddress, InvalidValue) as error:
        return f"{error}"
    return None
