"""One open page of a user: :class:`PageSession`."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Final

from nicegui import Client, context, ui
from nicegui.slot import Slot, get_task_id

from orinkit.core.errors import OrinError
from orinkit.core.i18n import Language
from orinkit.tester.access import read_cookies
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.workspace import Workspace

logger = logging.getLogger("orinkit.tester")

LANGUAGE_COOKIE: Final = "orinkit_language"
DARK_COOKIE: Final = "orinkit_dark"
CONNECTION_COOKIE: Final = "orinkit_connection"
_SESSIONS: Final[dict[str, PageSession]] = {}
# language of the user whose event started a task, for the messages of the task
_LANGUAGE: Final[ContextVar[Language | None]] = ContextVar("language", default=None)


@dataclass(eq=False)
class PageSession:
    """One open page.

    Attributes:
        workspace: The state that all pages share.
        client: NiceGUI's object of the page.
        user: Identity of the browser; all of its pages have the same.
        language: Language of the page.
        dark: True for dark mode.
        chosen: Name of the connection that the user has chosen.
    """

    workspace: Workspace
    client: Client
    user: str
    language: Language
    dark: bool
    chosen: str = ""

    _entered: bool = field(default=False, init=False)

    def enter(self) -> None:
        """Note that the browser has opened the page, or has connected again."""
        if not self._entered:
            self._entered = True
            self.workspace.controls.enter(self.user)

    def leave(self) -> None:
        """Note that the page has been closed, or the browser cannot be reached."""
        if self._entered:
            self._entered = False
            self.workspace.controls.leave(self.user)

    @property
    def connection(self) -> Connection | None:
        """The chosen connection; otherwise the first one; ``None`` if there is none."""
        return self.workspace.get(self.chosen) or next(iter(self.workspace), None)

    def choose(self, connection: Connection) -> None:
        """Make a connection the one that the pages of this user show."""
        self.chosen = connection.name
        self.set_cookie(CONNECTION_COOKIE, connection.name)

    @property
    def in_control(self) -> bool:
        """True if this user holds the controls."""
        return self.workspace.controls.held_by(self.user)

    def guarded(self, handler: Callable[..., Any], problem: Callable[[Exception | None], None]) -> Callable[..., Any]:
        """Return an event handler that operates: it requires the controls and shows errors where they belong.

        Args:
            handler: Function, possibly asynchronous, that may raise :class:`OrinError` or :class:`OSError`.
            problem: Function that displays an exception, or with ``None`` removes it.
        """

        async def run(*arguments: Any) -> None:
            _LANGUAGE.set(self.language)
            problem(None)
            try:
                self.workspace.controls.require(self.user)
                result = handler(*arguments)
                if isinstance(result, Awaitable):
                    await result
            except (OrinError, OSError, ValueError) as error:
                logger.debug("%s: %s", handler, error)
                if not self.client.is_deleted:
                    problem(error)

        return run

    def set_cookie(self, name: str, value: str) -> None:
        """Store a preference in the browser."""
        self.client.run_javascript(f"document.cookie = '{name}={value}; Path=/; Max-Age=31536000; SameSite=Strict'")


def open_session(workspace: Workspace) -> PageSession:
    """Return the session of the page that is being built."""
    client = context.client
    request = client.request
    cookies = read_cookies(request.headers.get("cookie", ""))
    language = request.query_params.get("lang") or cookies.get(LANGUAGE_COOKIE) or _preferred(request.headers)
    session = PageSession(
        workspace,
        client,
        request.scope["state"]["user"],
        "ja" if language == "ja" else "en",
        cookies.get(DARK_COOKIE) == "1" if "dark" not in request.query_params else request.query_params["dark"] == "1",
        request.query_params.get("connection") or cookies.get(CONNECTION_COOKIE, ""),
    )
    _SESSIONS[client.id] = session
    client.on_connect(session.enter)
    client.on_disconnect(session.leave)
    client.on_delete(lambda: _SESSIONS.pop(client.id, None))
    return session


def language_of_page() -> Language | None:
    """Return the language of the page that is being built or whose event is being handled, if there is one."""
    stack = Slot.stacks.get(get_task_id())
    if not stack:
        return _LANGUAGE.get()
    session = _SESSIONS.get(stack[-1].parent.client.id)
    return session.language if session else None


def _preferred(headers: Any) -> str:
    return "ja" if headers.get("accept-language", "").lower().startswith("ja") else "en"


def notify(text: str, kind: str = "info") -> None:
    """Show a short message at the bottom of the page: ``info``, ``positive``, ``warning`` or ``negative``."""
    ui.notify(text, type=kind, position="bottom", multi_line=True)  # type: ignore[arg-type]  # one of four words
