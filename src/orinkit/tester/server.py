"""Running the Tester: :func:`serve`."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from orinkit.core import i18n
from orinkit.core.errors import ConnectFailed, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.access import AccessMiddleware, AccessRules
from orinkit.tester.assets import AssetCache
from orinkit.tester.pages import register
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.workspace import Workspace
from orinkit.tester.ui.session import language_of_page
from orinkit.transport.address import is_loopback

DEFAULT_HTTP: Final = "127.0.0.1:8450"
_RECONNECT: Final = 10.0  # s in which a browser may connect again without losing its page
_LARGEST_MESSAGE: Final = 32 * 1024 * 1024
_SHUTDOWN: Final = 2  # s
_ARM_PAGE: Final = "/arm"
_GRAPHICAL: Final = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


@dataclass(frozen=True, slots=True)
class TesterOptions:
    """Options of the Tester.

    Attributes:
        host: Address to listen on.
        port: Port; 0 selects a free one.
        names: Further host names under which users reach the Tester.
        connections: Connections to open at the start.
        simulators: Keys of virtual controllers to start.
        browser: True to open a browser.
        profiles: File of the saved connections; by default in the user's configuration directory.
    """

    host: str
    port: int
    names: tuple[str, ...] = ()
    connections: Sequence[ConnectionSpec] = ()
    simulators: Sequence[str] = ()
    browser: bool = True
    profiles: Path | None = None


@dataclass(frozen=True, slots=True)
class Reports:
    """Callbacks of :func:`serve`.

    Attributes:
        ready: Called with the address once the Tester accepts requests.
        hint: Called with a text for the user: where the Tester was opened, or how to open it.
    """

    ready: Callable[[str], None]
    hint: Callable[[str], None] = lambda _: None


def serve(options: TesterOptions, reports: Reports) -> None:
    """Run the Tester until SIGINT, SIGTERM or SIGHUP. Then stop all motions and close all connections.

    Args:
        options: The options.
        reports: Callbacks.

    Raises:
        ConnectFailed: If the address is not available.
    """
    asyncio.run(_serve(options, reports))


async def _serve(options: TesterOptions, reports: Reports) -> None:
    workspace = Workspace(options.profiles)
    rules = AccessRules.for_host(options.host, options.names)
    app = FastAPI(openapi_url=None)
    register(workspace)
    i18n.set_source(language_of_page)
    ui.run_with(
        app, title="orinkit", favicon=_favicon(), tailwind=False, reconnect_timeout=_RECONNECT, show_welcome_message=False,
        gzip_middleware_factory=None,
    )  # fmt: skip
    config = uvicorn.Config(
        AccessMiddleware(AssetCache(app), rules), options.host.strip("[]"), options.port, log_level="warning", lifespan="on",
        ws_max_size=_LARGEST_MESSAGE, timeout_graceful_shutdown=_SHUTDOWN, access_log=False, server_header=False,
        ws_per_message_deflate=not is_loopback(options.host),
    )  # fmt: skip
    server = _Server(config)
    try:
        await _run(server, workspace, options, rules, reports)
    finally:
        i18n.set_source(None)
        await workspace.close()


def _favicon() -> str:
    return (files("orinkit.tester") / "static" / "favicon.svg").read_text("utf-8")


class _Server(uvicorn.Server):
    """A uvicorn server that leaves signals to :func:`_run`, and reports a used port as an exception."""

    def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]  # the base class has a generator
        """Do not change the handlers of signals."""
        return nullcontext()


async def _run(
    server: _Server, workspace: Workspace, options: TesterOptions, rules: AccessRules, reports: Reports
) -> None:
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, _end, server)
    sockets = [_bind(server.config)]
    gc.collect()
    gc.freeze()  # the modules: examining them again and again would block the event loop for up to 0.1 s
    serving = asyncio.create_task(server.serve(sockets))
    while not server.started and not serving.done():  # noqa: ASYNC110 - uvicorn has no event for this
        await asyncio.sleep(0.01)
    if not serving.done():
        await _open_connections(workspace, options)
        url = f"http://{options.host}:{sockets[0].getsockname()[1]}"
        query = f"?token={rules.token}" if rules.token else ""
        reports.ready(f"{url}/{query}" if query else url)
        if options.browser:
            # an arm can be seen and jogged on its page; without a controller, the user has to connect first
            is_connected = any(isinstance(each, ControllerConnection) and each.is_open for each in workspace)
            reports.hint(await _open_page(f"{url}{_ARM_PAGE if is_connected else '/'}{query}"))
    await serving


async def _open_page(page: str) -> str:
    """Open a page in a browser; return a text for the user."""
    if await asyncio.to_thread(_open_browser, page):
        return tr("the browser shows {page}. To end the Tester, press Ctrl+C.", page=page)
    return tr(
        "no browser could be opened. Try: open {page} in a browser on this computer. From another computer, first connect "
        "with ssh -L {port}:localhost:{port}. To end the Tester, press Ctrl+C.",
        page=page,
        port=urlsplit(page).port,
    )


def _open_browser(page: str) -> bool:
    """Open a page in a browser; return False if that is not possible."""
    if sys.platform == "linux" and not any(os.environ.get(name) for name in _GRAPHICAL):
        return False  # a browser for text would occupy the terminal
    try:
        return webbrowser.open(page)
    except (webbrowser.Error, OSError):
        return False


def _end(server: _Server) -> None:
    server.force_exit = server.should_exit  # the second signal does not wait for open pages
    server.should_exit = True


def _bind(config: uvicorn.Config) -> socket.socket:
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((config.host, config.port))
    except OSError as error:
        listening.close()
        where = f"{config.host}:{config.port}"
        raise ConnectFailed(
            tr("cannot listen on {where}: {error}. Try: --http 127.0.0.1:0 for a free port", where=where, error=error)
        ) from None
    listening.set_inheritable(False)
    return listening


async def _open_connections(workspace: Workspace, options: TesterOptions) -> None:
    """Open the connections of the command line; errors are displayed on the page Connections."""
    for spec in options.connections:
        connection = workspace.add(spec)
        try:
            await connection.open()
        except OrinError:
            continue
    for key in options.simulators:
        await workspace.start_simulator(key)
