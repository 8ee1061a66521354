"""One open page of a user: :class:`PageSession`."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar
from urllib.parse import quote

from nicegui import Client, context, ui
from nicegui.slot import Slot, get_task_id

from orinkit.core.errors import OrinError
from orinkit.core.i18n import Language
from orinkit.tester.access import read_cookies
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.workspace import Workspace

T = TypeVar("T")

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

    _present: bool = field(default=False, init=False)
    _arrivals: list[Callable[[], Any]] = field(default_factory=list, init=False)
    _departures: list[Callable[[], Any]] = field(default_factory=list, init=False)

    def connected(self) -> None:
        """Note that the browser has opened a connection to the page: the first one, or a further one."""
        if not self._present:
            self._present = True
            self.workspace.controls.enter(self.user)
            for each in self._arrivals:
                self.client.safe_invoke(each)

    def disconnected(self) -> None:
        """Note that a connection of the browser has ended.

        A browser that connects again may open the new connection before the Tester notices the end of the previous one.
        Then the user remains present.
        """
        if self._present and not self.client.has_socket_connection:
            self._present = False
            self.workspace.controls.leave(self.user)
            for each in self._departures:
                self.client.safe_invoke(each)

    def while_connected(self, enter: Callable[[], Any], leave: Callable[[], Any]) -> None:
        """Register callbacks, possibly asynchronous, for the first connection of the browser and for the end of the last one.

        Both are invoked again if the browser connects again later.
        """
        self._arrivals.append(enter)
        self._departures.append(leave)

    @property
    def is_present(self) -> bool:
        """True while at least one connection of the browser to the page is open."""
        return self._present

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

    async def in_thread(self, function: Callable[..., T], *arguments: Any) -> T:
        """Return the result of a function that runs in a thread, with its messages in the language of the page."""
        _LANGUAGE.set(self.language)
        return await asyncio.to_thread(function, *arguments)

    def set_cookie(self, name: str, value: str) -> None:
        """Store a preference in the browser."""
        text = f"{name}={quote(value)}; Path=/; Max-Age=31536000; SameSite=Strict"
        self.client.run_javascript(f"document.cookie = {json.dumps(text)}")


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
    client.on_connect(session.connected)
    client.on_disconnect(session.disconnected)
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
