"""The selected object for its forms: :class:`ObjectContext`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from orinkit.cao.table import Function
from orinkit.tester.pages.objects.results import ResultBox
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.motion_call import call_function
from orinkit.tester.state.objects import Outcome, RemoteObject
from orinkit.tester.ui.fields import Field, read_fields
from orinkit.tester.ui.session import PageSession


@dataclass(frozen=True, eq=False)
class ObjectContext:
    """The selected object, and how its functions are called.

    Attributes:
        session: The page.
        connection: The connection.
        target: The selected object.
        refresh: Updates the tree of objects.
        select: Selects another object.
    """

    session: PageSession
    connection: ControllerConnection
    target: RemoteObject
    refresh: Callable[[], None]
    select: Callable[[RemoteObject], None]

    async def call(self, function: Function[..., Any], *arguments: Any) -> Outcome:
        """Call a function of the selected object.

        Raises:
            OrinError: As for :func:`~orinkit.tester.state.motion_call.call_function`.
        """
        session = self.session
        return await call_function(session.workspace, self.connection, session.user, self.target, function, *arguments)

    def button(
        self,
        text: str,
        icon: str,
        marker: str,
        function: Function[..., Any],
        fields: Sequence[Field],
        result: ResultBox,
        done: Callable[[Outcome], None] | None = None,
    ) -> ui.button:
        """Add a button that calls a function with the values of fields, and shows the result.

        If a field is invalid, nothing is sent. The button is disabled during the call.
        """
        button = ui.button(text, icon=icon).props("unelevated no-caps").props(f"data-testid={marker}")

        async def press() -> None:
            values = await read_fields(fields)
            if values is None:
                return
            result.begin()
            button.props("loading")
            try:
                outcome = await self.call(function, *values)
            finally:
                button.props(remove="loading")
            if self.session.client.is_deleted:
                return
            result.show(outcome)
            if done is not None:
                done(outcome)
            self.refresh()

        button.on_click(self.session.guarded(press, result.fail))
        return button
