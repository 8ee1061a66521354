"""The controls of the Tester: one user operates, all others watch. :class:`Controls`."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Final

from orinkit.core.errors import OrinError
from orinkit.core.i18n import tr

GRACE: Final = 5.0
"""Time in s after which the controls are free if all pages of the user who holds them are closed."""


class ControlsHeld(OrinError):
    """Another user holds the controls; nothing was sent."""


class Controls:
    """Decides which user may operate; a user is a browser, with all of its pages.

    The first user who opens a page holds the controls. The controls are free if this user gives them up, or has had
    no page open for :data:`GRACE` seconds. Then the next user who operates holds them.

    Args:
        clock: Function that returns the time in s.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._holder = ""
        self._pages: dict[str, int] = {}
        self._left_at = 0.0

    @property
    def holder(self) -> str:
        """The user who holds the controls; ``""`` if they are free."""
        if self._holder and not self._pages.get(self._holder) and self._clock() - self._left_at >= GRACE:
            self._holder = ""
        return self._holder

    def enter(self, user: str) -> None:
        """Note that a user has opened a page; the user takes the controls if they are free."""
        self._pages[user] = self._pages.get(user, 0) + 1
        if not self.holder:
            self._holder = user

    def leave(self, user: str) -> None:
        """Note that a user has closed a page."""
        left = self._pages.get(user, 0) - 1
        if left > 0:
            self._pages[user] = left
        else:
            self._pages.pop(user, None)
            if user == self._holder:
                self._left_at = self._clock()

    def held_by(self, user: str) -> bool:
        """Return True if a user holds the controls."""
        return self.holder == user

    def has_page(self, user: str) -> bool:
        """Return True if a user has a page open."""
        return bool(self._pages.get(user))

    def take(self, user: str) -> None:
        """Take the controls.

        Raises:
            ControlsHeld: If another user holds them.
        """
        if self.holder not in ("", user):
            raise ControlsHeld(
                tr("another user holds the controls. Try: ask that user to give them up, or to close the page")
            )
        self._holder, self._left_at = user, self._clock()

    def give_up(self, user: str) -> None:
        """Give up the controls if the user holds them."""
        if self._holder == user:
            self._holder = ""

    def require(self, user: str) -> None:
        """Check that a user holds the controls; take them if they are free.

        Raises:
            ControlsHeld: If another user holds them.
        """
        self.take(user)
