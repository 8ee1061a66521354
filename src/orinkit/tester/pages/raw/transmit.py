"""The packets to send: the text with its live check, Send, Loop and Stop."""

from __future__ import annotations

from typing import Final

from nicegui import background_tasks, ui

from orinkit.bcap.dissect import Kind
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.raw.exchange import ALL, LoopProgress
from orinkit.raw.options import Role
from orinkit.tester.pages.raw.checks import CheckList
from orinkit.tester.state.raw.link import MOST_ROUNDS, RawLink
from orinkit.tester.state.raw.text import LONGEST_TEXT, CheckedText, check_text
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.presence import Presence
from orinkit.tester.ui.session import PageSession

_LIMIT: Final = 2.0  # s without a sign of life of the browser after which a loop stops
_QUICK: Final = 4000  # characters that are checked without a thread


class TransmitCard:
    """The card.

    Args:
        session: The page.
        link: The raw connection.
    """

    def __init__(self, session: PageSession, link: RawLink) -> None:
        self._session, self._link = session, link
        self._presence = Presence(session, _LIMIT)
        self._role = Role.TCP_CLIENT
        self._checks = 0
        self._shown: object = None
        with ui.element("section").classes("ok-card").props("data-testid=raw-transmit"):
            self._title = ui.label().classes("ok-card-title")
            self._build_text()
            self._as_is = ui.checkbox(tr("Send as it is, even if a packet is malformed")).props(
                "dense data-testid=raw-as-is"
            )
            self._build_buttons()
            # below the buttons: a list that changes its height between press and release would move them
            self._list = CheckList(self._text)
            self._errors = ErrorBox("error-raw-send")
            self._build_progress()

    def _build_text(self) -> None:
        self._text = ui.textarea(
            tr("Packets in hex, separated by blank lines"),
            placeholder="01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04",
            on_change=self._change_text,
        )
        self._text.props(f"outlined debounce=200 maxlength={LONGEST_TEXT + 1} spellcheck=false autocomplete=off")
        self._text.props("data-testid=raw-text").classes("ok-raw-text")

    def _build_buttons(self) -> None:
        guarded = self._session.guarded
        self._peer = ui.select({ALL: tr("All clients")}, label=tr("Send to"), value=ALL)
        self._peer.props("outlined dense options-dense data-testid=raw-peer")
        with ui.element("div").classes("ok-row ok-raw-buttons"):
            self._send = ui.button(tr("Send packets"), icon="send", on_click=guarded(self._send_once, self._show_error))
            self._send.props("unelevated no-caps data-testid=raw-send")
            ui.space()
            self._count = ui.number(tr("Count"), value=1000, min=1, max=MOST_ROUNDS, precision=0)
            self._count.props("outlined dense data-testid=raw-count").classes("ok-raw-count")
            self._loop = ui.button(tr("Loop"), icon="repeat", on_click=guarded(self._send_often, self._show_error))
            self._loop.props("outline no-caps data-testid=raw-loop")
            self._stop = ui.button(tr("Stop"), icon="stop", on_click=self._stop_sending, color="negative")
            self._stop.props("unelevated no-caps data-testid=raw-stop")

    def _build_progress(self) -> None:
        self._progress = ui.element("div").classes("ok-raw-progress")
        with self._progress:
            self._bar = ui.linear_progress(0.0, show_value=False, size="8px")
            label = tr("Progress")
            self._bar.props(f'rounded instant-feedback aria-label="{label}"')
            self._figures = ui.label().classes("ok-raw-figures").props("role=status data-testid=raw-progress")
        self._progress.visible = False

    # --- the text -----------------------------------------------------------------------------------------------------

    @property
    def _kind(self) -> Kind:
        return "reply" if self._role.serves else "request"

    def set_role(self, role: Role) -> None:
        """Check the packets for the transport and the direction of a role."""
        self._role = role
        self._title.text = tr("TX (server → client)") if role.serves else tr("TX (client → server)")
        self._peer.visible = role is Role.TCP_SERVER
        self.check()

    def append(self, text: str) -> None:
        """Append a packet to the text.

        Raises:
            InvalidValue: If the text becomes too long.
        """
        before = (self._text.value or "").rstrip()
        after = f"{before}\n\n{text}\n" if before else f"{text}\n"
        if len(after) > LONGEST_TEXT:
            raise InvalidValue(tr("the text is full. Try: remove packets"))
        self._text.value = after

    def _change_text(self) -> None:
        self._errors.show(None)
        self.check()

    def check(self) -> None:
        """Check the text, a long one in a thread, and show the result."""
        self._checks += 1
        text = self._text.value or ""
        if len(text) > _QUICK:
            background_tasks.create(self._check_later(text, self._checks))
        else:
            self._list.show(check_text(text, self._role.profile, self._kind), is_empty=not text.strip())

    async def _check_later(self, text: str, number: int) -> None:
        found = await self._checked(text)
        if number == self._checks and not self._session.client.is_deleted:
            self._list.show(found, is_empty=False)

    async def _checked(self, text: str) -> CheckedText:
        if len(text) > _QUICK:
            return await self._session.in_thread(check_text, text, self._role.profile, self._kind)
        return check_text(text, self._role.profile, self._kind)

    # --- sending ------------------------------------------------------------------------------------------------------

    async def _send_once(self) -> None:
        await self._transmit(1)

    async def _send_often(self) -> None:
        count = self._count.value
        if count is None or not 1 <= count <= MOST_ROUNDS:
            raise InvalidValue(tr("the count must be 1 to {most}", most=f"{MOST_ROUNDS:,}"))
        self._presence.begin()
        try:
            await self._transmit(int(count))
        finally:
            if not self._session.client.is_deleted:
                self._presence.end()

    async def _transmit(self, count: int) -> None:
        found = await self._checked(self._text.value or "")
        packets = found.sendable(as_is=bool(self._as_is.value))
        peer = (self._peer.value or ALL) if self._role is Role.TCP_SERVER else ""
        unattended = self._unattended if count > 1 else str
        done = await self._link.send(packets, count, peer, unattended)
        if self._link.options and self._link.options.sync and not self._link.serves and done.replies < done.sent:
            self._errors.show_text(_missing(done, self._link.options.timeout))

    def _unattended(self) -> str:
        return self._presence.reason

    def _stop_sending(self) -> None:
        """Stop; everybody who sees the page may do that."""
        self._link.stop_sending(tr("the button Stop was pressed"))

    def _show_error(self, error: Exception | None) -> None:
        self._errors.show(error)

    # --- display ------------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Show the current state."""
        link = self._link
        shown = (link.state, link.is_sending, link.progress, link.sent, link.peers, link.interruption)
        if shown == self._shown:
            return
        self._shown = shown
        self._send.set_enabled(link.is_open and not link.is_sending)
        self._loop.set_enabled(link.is_open and not link.is_sending)
        self._stop.set_enabled(link.is_sending)
        peers = {ALL: tr("All clients"), **{peer: peer for peer in link.peers}}
        if list(peers) != list(self._peer.options):
            self._peer.set_options(peers, value=self._peer.value if self._peer.value in peers else ALL)
        progress = link.progress
        self._progress.visible = progress is not None
        if progress is not None:
            self._bar.value = progress.rounds / progress.count
            self._figures.text = progress_text(progress, link.interruption)


def progress_text(progress: LoopProgress, interruption: str) -> str:
    """Return the state of a loop for users."""
    text = tr(
        "{rounds} of {count} · {sent} sent · {replies} replies",
        rounds=f"{progress.rounds:,}",
        count=f"{progress.count:,}",
        sent=f"{progress.sent:,}",
        replies=f"{progress.replies:,}",
    )
    if progress.seconds > 0:
        text += " · " + tr("{rate} packets/s", rate=f"{progress.rate:,.0f}")
    if interruption:
        text += " · " + tr("stopped: {reason}", reason=interruption)
    return text


def _missing(done: LoopProgress, seconds: float) -> str:
    if done.stopped:
        return ""
    return tr(
        "{missing} of {sent} packets have no reply within {seconds:g} s. Try: a longer Timeout; a controller ignores "
        "some malformed packets",
        missing=done.sent - done.replies,
        sent=done.sent,
        seconds=seconds,
    )
