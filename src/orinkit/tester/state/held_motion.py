"""Motions that last only while a user holds a button: :class:`HeldMotion` is the base of jogging and of driving."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from time import monotonic
from typing import TYPE_CHECKING, Final, Generic, TypeVar

from orinkit.core.errors import OrinError
from orinkit.tester.state.connection import Connection

if TYPE_CHECKING:
    from orinkit.tester.state.workspace import ActiveMotion

logger = logging.getLogger("orinkit.tester")

R = TypeVar("R")
IDLE: Final = 60.0
"""Time in s without a motion after which the motions are disabled."""
HEARTBEAT: Final = 0.5
"""Time in s without a heartbeat of the page after which the motion is stopped."""


class MotionState(Enum):
    """State of a held motion."""

    OFF = "off"
    STARTING = "starting"
    READY = "ready"
    MOVING = "moving"
    ENDING = "ending"


class HeldMotion(ABC, Generic[R]):
    """Motions of one connection that pages enable first, and that last while a button is held.

    Args:
        connection: The connection.
        motions: The running motions of the workspace; they contain this object while it is active.

    Attributes:
        state: The state.
        message: Why the last motion, or the whole operation, ended, for the user; otherwise ``""``.
        error: The error that ended the operation; otherwise ``None``.
        version: Counts the changes of the attributes above.
    """

    def __init__(self, connection: Connection, motions: set[ActiveMotion]) -> None:
        self._owner, self._motions = connection, motions
        self.state = MotionState.OFF
        self.message = ""
        self.error: Exception | None = None
        self.version = 0
        self._task: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()
        self._ending = False
        self._request: R | None = None
        self._absent: Callable[[], str] = lambda: ""
        self._used = 0.0

    @property
    def active(self) -> bool:
        """True unless the state is off."""
        return self.state is not MotionState.OFF

    @property
    def usable(self) -> bool:
        """True if a motion can be started."""
        return self.state in (MotionState.READY, MotionState.MOVING)

    @property
    def requested(self) -> bool:
        """True while a motion is requested or executing."""
        return self._request is not None

    async def enable(self) -> None:
        """Prepare motions; return when a motion can be started.

        Raises:
            OrinError: If the preparation fails.
        """
        if self._task is None:
            self.error, self._ending = None, False
            self._set(MotionState.STARTING)
            self._motions.add(self)
            self._task = asyncio.create_task(self._run())
        while self.active and not self.usable:
            await self._wait_for_change()
        if self.error is not None:
            raise self.error

    async def disable(self) -> None:
        """Stop, and end the operation; do nothing if the state is off."""
        await self.stop("")

    async def stop(self, reason: str) -> None:
        """Stop within the limits and end the operation; return at standstill.

        Args:
            reason: Why, for the user.
        """
        self._request = None
        self._ending = True
        if self._task is not None:
            self._tell(reason)
            self._wake()
            while self.active:
                await self._wait_for_change()

    def watch(self, absent: Callable[[], str]) -> None:
        """Require the user as soon as the operation begins.

        Args:
            absent: Function that returns why the user counts as gone; ``""`` if the user is present.
        """
        if not self.active:
            self._absent = absent

    def leave(self, reason: str) -> None:
        """Stop within the limits and end the operation, because the user is gone.

        Args:
            reason: Why the user counts as gone.
        """
        if self.active:
            self._halt(self._leave_text(reason))
            self._ending = True
            self._wake()

    @abstractmethod
    def release(self) -> None:
        """Stop within the limits, because the user has released the button; further motions remain possible."""

    # --- for derived classes -----------------------------------------------------------------------------------------

    @abstractmethod
    async def _operate(self) -> None:
        """Prepare motions, set the state to ready, execute the motions, and end the operation."""

    @abstractmethod
    def _halt(self, message: str) -> None:
        """Withdraw the request, and begin to stop within the limits."""

    @abstractmethod
    def _leave_text(self, reason: str) -> str:
        """Return the message for the user if the operation has ended because the user is gone."""

    @abstractmethod
    def _forget(self) -> None:
        """Forget everything that belongs to the operation, which has ended."""

    def _wake(self) -> None:
        """Let the task consider a new request at once; by default, it does so in its next cycle."""
        return

    def _check_presence(self) -> None:
        """End the operation if the user is gone."""
        reason = self._absent()
        if reason:
            self.leave(reason)

    @property
    def _unused(self) -> bool:
        """True if there was no motion for a long time."""
        return monotonic() - self._used > IDLE

    async def _run(self) -> None:
        try:
            await self._operate()
        except (OrinError, OSError, ValueError, ImportError) as error:
            if not self._ending:
                logger.warning("%s: the motion ended: %s", self._owner.name, error)
                self.error = error
        finally:
            self._request = None
            self._forget()
            self._task = None
            self._motions.discard(self)
            self._set(MotionState.OFF)

    def _tell(self, message: str) -> None:
        if message != self.message:
            self.message = message
            self.version += 1

    def _set(self, state: MotionState) -> None:
        self.state = state
        self.version += 1
        self._changed.set()
        self._changed = asyncio.Event()

    async def _wait_for_change(self) -> None:
        await self._changed.wait()
