"""Event handlers that only read, and what pages show if there is no suitable connection."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.ui.errors import ErrorBox
from orinkit.tester.ui.session import PageSession

logger = logging.getLogger("orinkit.tester")


def reported(
    session: PageSession, handler: Callable[..., Any], problem: Callable[[Exception | None], None]
) -> Callable[..., Any]:
    """Return an event handler that shows errors where they belong; unlike ``guarded``, everybody may use it.

    Args:
        session: The page.
        handler: Function, possibly asynchronous, that operates nothing.
        problem: Function that displays an exception, or with ``None`` removes it.
    """

    async def run(*arguments: Any) -> None:
        problem(None)
        try:
            result = handler(*arguments)
            if isinstance(result, Awaitable):
                await result
        except (OrinError, OSError, ValueError) as error:
            logger.debug("%s: %s", handler, error)
            if not session.client.is_deleted:
                problem(error)

    return run


def chosen_controller(session: PageSession) -> ControllerConnection | None:
    """Return the chosen connection if it is one to a controller; otherwise explain what is missing."""
    connection = session.connection
    if isinstance(connection, ControllerConnection):
        return connection
    show_no_controller(session)
    return None


def show_no_controller(session: PageSession) -> None:
    """Show why the page has no open connection to a robot controller, and the way to one."""
    connection = session.connection
    if connection is None:
        text = tr("No connection yet. Connect to a controller, or start a virtual one.")
    elif isinstance(connection, ControllerConnection):
        text = tr("{name} is not connected.", name=connection.name)
    else:
        text = tr("{name} is a motor driver. This page requires a robot controller.", name=connection.name)
    with (
        ui.element("section").classes("ok-card"),
        ui.element("div").classes("ok-empty").props("data-testid=no-controller"),
    ):
        ui.icon("cable")
        ui.label(text)
        if isinstance(connection, ControllerConnection) and connection.error is not None:
            ErrorBox("connection-error").show(connection.error)
        ui.link(tr("Open the page Connections"), "/")


def while_connected(session: PageSession, enter: Callable[[], Any], leave: Callable[[], Any]) -> None:
    """Register callbacks for the presence of the browser: :meth:`PageSession.while_connected`."""
    session.while_connected(enter, leave)
