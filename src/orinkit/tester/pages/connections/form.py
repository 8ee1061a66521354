"""The form for a new connection: the parameters of RC8 table 5-1, and saved connections."""

from __future__ import annotations

from nicegui import ui

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.connection_spec import VRC, ConnectionSpec
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

_EXAMPLES = {
    "tcp": "tcp://192.168.0.1:5007",
    "udp": "udp://192.168.0.1:5007",
    "serial": "serial:///dev/ttyUSB0?baudrate=38400",
    "http": "http://192.168.0.1:8080",
    "can": "can://socketcan/can0",
}
_PROVIDERS = (VRC, "CaoProv.DENSO.VRC9", "CaoProv.DENSO.NetwoRC", "")


class ConnectionForm:
    """The form."""

    def __init__(self, session: PageSession) -> None:
        self._session = session
        with ui.element("section").classes("ok-card").props("data-testid=connection-form"):
            ui.label(tr("New connection")).classes("ok-card-title")
            self._build_saved()
            self._build_fields()
            self._errors = ErrorBox("error-form")
            with ui.element("div").classes("ok-row"):
                self._connect = (
                    ui.button(tr("Connect"), icon="link").props("unelevated no-caps").props("data-testid=connect")
                )
                save = ui.button(tr("Save"), icon="bookmark_add").props("flat no-caps").props("data-testid=save")
        self._connect.on_click(session.guarded(self._open, self._errors.show))
        save.on_click(session.guarded(self._save, self._errors.show))

    def _build_saved(self) -> None:
        saved = [each.name for each in self._session.workspace.profiles]
        self._saved = ui.select(saved, label=tr("Saved connections"), on_change=self._load, clearable=True)
        self._saved.props("outlined dense").props("data-testid=saved")
        self._saved.visible = bool(saved)

    def _build_fields(self) -> None:
        self.scheme = ui.toggle(
            {"tcp": "TCP", "udp": "UDP", "serial": "Serial", "http": "HTTP", "can": "CAN"}, value="tcp"
        )
        self.scheme.props("no-caps unelevated dense spread").props("data-testid=scheme")
        self.url = ui.input(tr("Address"), placeholder=_EXAMPLES["tcp"], validation=_check_url)
        self.url.props("outlined dense").classes("ok-mono").props("data-testid=url").without_auto_validation()
        self.name = ui.input(tr("Name")).props("outlined dense").props("data-testid=name")
        with ui.expansion(tr("More parameters")).props("dense"):
            self._build_parameters()
        self.scheme.on_value_change(lambda: self.url.props(f"placeholder={_EXAMPLES[self.scheme.value]}"))

    def _build_parameters(self) -> None:
        with ui.element("div").classes("ok-form"):
            self.provider = ui.select(
                list(_PROVIDERS), label=tr("Provider"), value=VRC, with_input=True, new_value_mode="add-unique"
            )
            self.machine = ui.input(tr("Machine"), placeholder="localhost")
            self.option = ui.input(tr("Option"))
            self.timeout = ui.number(tr("Time-out (ms)"), min=0, max=3_600_000, precision=0, placeholder=tr("default"))
            self.tries = ui.number(tr("Attempts (UDP, serial)"), value=5, min=1, max=7, precision=0)
            self.token = ui.input(tr("Access token (HTTP)"), password=True)
            self.driver = ui.number(tr("Driver address (CAN)"), value=1, min=1, max=63, precision=0)
            self.dialect = ui.select(["v1", "v2"], label=tr("Dialect (CAN)"), value="v1")
            for field in (
                self.provider,
                self.machine,
                self.option,
                self.timeout,
                self.tries,
                self.token,
                self.driver,
                self.dialect,
            ):
                field.props("outlined dense")
        self.messages = ui.checkbox(tr("Fetch messages (Message)"), value=True)
        self.debug = ui.checkbox(tr("Debug: $LAST_SEND_PACKET$, $LAST_RECEIVE_PACKET$"))

    def spec(self) -> ConnectionSpec:
        """Return the entered parameters.

        Raises:
            InvalidAddress, InvalidValue: If a parameter is invalid.
        """
        url = (self.url.value or "").strip()
        if url and "://" not in url:
            url = f"{self.scheme.value}://{url}"
        if not url:
            raise InvalidValue(tr("the address is empty. Try: {example}", example=_EXAMPLES[self.scheme.value]))
        return ConnectionSpec(
            (self.name.value or "").strip() or url.partition("://")[2],
            url,
            provider=self.provider.value or "",
            machine=(self.machine.value or "").strip(),
            option=(self.option.value or "").strip(),
            messages=self.messages.value,
            timeout=int(self.timeout.value or 0),
            tries=int(self.tries.value or 1),
            debug=self.debug.value,
            token=self.token.value or "",
            driver=int(self.driver.value or 0),
            dialect=self.dialect.value or "",
        ).check()

    async def _open(self) -> None:
        self._connect.props("loading")
        try:
            connection = self._session.workspace.add(self.spec())
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
        if spec is None:
            return
        self.scheme.value = spec.scheme if spec.scheme in _EXAMPLES else "http"
        self.url.value, self.name.value, self.option.value, self.machine.value = (
            spec.url,
            spec.name,
            spec.option,
            spec.machine,
        )
        self.provider.set_options(list(dict.fromkeys([*_PROVIDERS, spec.provider])), value=spec.provider)
        self.timeout.value, self.tries.value = spec.timeout or None, spec.tries
        self.messages.value, self.debug.value = spec.messages, spec.debug
        self.driver.value, self.dialect.value = spec.driver, spec.dialect


def _check_url(text: str) -> str | None:
    from orinkit.transport.address import parse_address

    try:
        if text:
            parse_address(text)
    except (InvalidAddress, InvalidValue) as error:
        return f"{error}"
    return None
