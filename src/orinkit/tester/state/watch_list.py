"""The variables that a user has chosen on the page Monitor: :class:`WatchList`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, cast

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.poller import OwnerKind, VariableRef

MAX_WATCHED: Final = 40
"""Number of variables in a list."""
_LONGEST_NAME: Final = 100
_LONGEST_TEXT: Final = 2000
_MOST_LISTS: Final = 50


class WatchList:
    """An ordered list of variables.

    Attributes:
        version: Counts the changes, so that pages can detect them.
        plotted: Labels of the plotted columns.
        window: Time span of the plot, s.
    """

    def __init__(self) -> None:
        self._refs: list[VariableRef] = []
        self.version = 0
        self.plotted: list[str] = []
        self.window = 60

    def __iter__(self) -> Iterator[VariableRef]:
        return iter(list(self._refs))

    def __len__(self) -> int:
        return len(self._refs)

    def add(self, refs: list[VariableRef]) -> None:
        """Add variables at the end; those in the list remain where they are.

        Raises:
            InvalidValue: If the list would be too long; nothing is added.
        """
        new = [ref for ref in dict.fromkeys(refs) if ref not in self._refs]
        if len(self._refs) + len(new) > MAX_WATCHED:
            raise InvalidValue(tr("the list can have at most {most} variables. Try: remove some", most=MAX_WATCHED))
        self._refs += new
        self.version += 1

    def remove(self, ref: VariableRef) -> None:
        """Remove a variable."""
        if ref in self._refs:
            self._refs.remove(ref)
            self.version += 1

    def move(self, ref: VariableRef, by: int) -> None:
        """Move a variable up (negative) or down by a number of places, at most to the end of the list."""
        if ref not in self._refs:
            return
        at = self._refs.index(ref)
        self._refs.insert(max(0, min(at + by, len(self._refs) - 1)), self._refs.pop(at))
        self.version += 1


class WatchLists:
    """The lists of all users of a connection."""

    def __init__(self) -> None:
        self._lists: dict[str, WatchList] = {}

    def of(self, user: str) -> WatchList:
        """Return the list of a user; a new one is empty. The lists of the latest 50 users are kept."""
        found = self._lists.pop(user, None) or WatchList()
        self._lists[user] = found
        while len(self._lists) > _MOST_LISTS:
            self._lists.pop(next(iter(self._lists)))
        return found


def entered_refs(kind: str, owner: str, text: str) -> list[VariableRef]:
    """Return the variables whose names a user has entered, separated by commas or spaces.

    Raises:
        InvalidValue: If a name is missing, too long, or represents several variables (``I*``).
    """
    if len(text) > _LONGEST_TEXT:
        raise InvalidValue(tr("the names are too long: {count} characters", count=len(text)))
    names = text.replace(",", " ").split()
    owner = owner.strip() if kind in ("task", "extension") else ""
    if not names:
        raise InvalidValue(tr("enter the name of a variable. Try: I10"))
    if kind in ("task", "extension") and not owner:
        raise InvalidValue(tr("enter the name of the object to which the variable belongs"))
    for name in (*names, owner):
        if len(name) > _LONGEST_NAME:
            raise InvalidValue(tr("the name {name} is too long", name=repr(name[:20] + "…")))
        if "*" in name:
            raise InvalidValue(
                tr("{name} represents many variables. Try: {example}", name=name, example=name.replace("*", "0"))
            )
    return [VariableRef(cast("OwnerKind", kind), owner, name) for name in names]
