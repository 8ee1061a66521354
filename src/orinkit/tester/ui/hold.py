"""Buttons that move something while they are held: :class:`HoldControl`."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Any

from nicegui import context, ui
from nicegui.events import GenericEventArguments

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.held_motion import HEARTBEAT, HeldMotion, MotionState
from orinkit.tester.ui.presence import Presence
from orinkit.tester.ui.session import PageSession


def hold_button(key: str, text: str, label: str, marker: str) -> ui.element:
    """Build a button for :class:`HoldControl`; its attribute ``aria-disabled`` is ``false`` while it can be used.

    Args:
        key: Key that is passed to the callback ``start``.
        text: The text.
        label: Text for screen readers.
        marker: Value of ``data-testid``.
    """
    button = ui.element("button").classes("ok-hold-button")
    button.props(f'type=button data-hold="{key}" data-testid="{marker}" aria-disabled=true')
    button.props["aria-label"] = label
    with button:
        ui.label(text)
    return button


def parsed_key(pattern: re.Pattern[str], key: str) -> re.Match[str]:
    """Return the parts of the key of a hold button, as received from the browser.

    Raises:
        InvalidValue: If the page has no such button.
    """
    found = pattern.fullmatch(key)
    if found is None:
        raise InvalidValue(tr("the button {key:.20} does not exist", key=key))
    return found


class HoldControl:
    """Starts a motion when a hold button of a page is pressed, and stops it in every case in which the user is gone.

    The motion stops if the button is released, the page is hidden or closed, nothing was received from the browser for 0.5 s,
    or the user has lost the controls.

    Args:
        session: The page.
        motion: The motion.
        start: Callback invoked with the key of the pressed button, and with the function that returns why the user
            counts as gone (``""`` if the user is present); it starts the motion.
        problem: Function that displays an exception, or with ``None`` removes it.
        always: True if the user must be present as long as the motion is enabled; False if only while a button is held.
    """

    def __init__(
        self,
        session: PageSession,
        motion: HeldMotion[Any],
        start: Callable[[str, Callable[[], str]], None],
        problem: Callable[[Exception | None], None],
        *,
        always: bool = False,
    ) -> None:
        self._session, self._motion, self._start, self._problem = session, motion, start, problem
        self._always = always
        self._presence = Presence(session, HEARTBEAT)
        self._mine = False  # True if this page has begun the motion
        self._enabled = False  # True if this page has enabled motions
        self._place = context.slot.parent
        ui.on("ok-hold", self._event, ["key"])
        session.client.run_javascript(_script())
        session.while_connected(lambda: None, lambda: self.leave(tr("the page was closed")))

    @property
    def usable(self) -> bool:
        """True if this user can start a motion."""
        return self._motion.usable and self._session.in_control

    async def toggle(self) -> None:
        """Enable motions, or stop and disable them; everybody may stop."""
        if self._motion.active:
            await self._motion.disable()
        else:
            self._enabled = True
            await self._session.guarded(self._enable, self._problem)()

    def refresh(self) -> None:
        """End the heartbeats if the motion has ended; call this often."""
        motion = self._motion
        if motion.state is MotionState.OFF and (self._mine or self._enabled):
            self._mine = self._enabled = False
            self._presence.end()
        elif self._mine and not self._always and motion.state is MotionState.READY and not motion.requested:
            self._mine = False
            self._presence.end()

    def leave(self, reason: str) -> None:
        """End the operation if this page has enabled it or has begun the motion.

        Args:
            reason: Why the user counts as gone.
        """
        if self._mine or self._enabled:
            self._mine = self._enabled = False
            self._motion.leave(reason)
            if self._session.client.has_socket_connection:
                self._presence.end()

    def close(self) -> None:
        """End the operation, because the page no longer shows the buttons."""
        self.leave(tr("the page was closed"))

    def absent(self) -> str:
        """Return why the user counts as gone; ``""`` if the user is present."""
        if not self._session.in_control:
            return tr("another user holds the controls")
        return self._presence.reason

    async def _enable(self) -> None:
        if self._always:
            self._presence.begin()
            self._motion.watch(self.absent)
        await self._motion.enable()

    async def _event(self, event: GenericEventArguments) -> None:
        if self._place.is_deleted:  # the page was built again for another connection
            return
        key = event.args.get("key") if isinstance(event.args, dict) else None
        if not key:
            self._release()
        elif key == "gone":
            self.leave(tr("the page is hidden"))
        else:
            await self._session.guarded(self._press, self._problem)(str(key))

    def _press(self, key: str) -> None:
        self._start(key, self.absent)
        self._presence.begin()
        self._mine = True

    def _release(self) -> None:
        if self._mine:
            self._motion.release()


@cache
def _script() -> str:
    return (files("orinkit.tester") / "static" / "hold.js").read_text("utf-8")
