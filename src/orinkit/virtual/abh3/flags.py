"""The flag words of a virtual ABH3, made of the table: control flags of inputs and terminals, and what the driver shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from orinkit.abh3.table.signals import V1, Dialect, Logic, Word
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

FAULTS: Final = V1.errors
"""The faults; both dialects number them alike."""
COMMUNICATION: Final = FAULTS.mask("can_communication")

_SEEN: Final = 3  # the code that drivers have been seen to show when nothing but CAN communication is wrong
_UNKNOWN: Final = 15


class Inputs:
    """What the host asks for and what the terminals say, and what control flags that makes.

    Terminals have at first what CAN alone needs: those combined by AND are on, those by OR off.

    Args:
        dialect: of the driver.

    Attributes:
        can: inputs as the host has sent them last.
        external: terminals, numbered like the inputs.
        terminals: digital inputs, as bits of the I/O flags.
    """

    def __init__(self, dialect: Dialect) -> None:
        self._word = dialect.inputs
        self._io = dialect.io
        masks = {logic: _mask_of(dialect.inputs, logic) for logic in Logic}
        self._and = masks[Logic.AND]
        self._not_and = masks[Logic.NOT_AND]
        self._or = masks[Logic.OR]
        self._selects = {axis: [dialect.inputs.masks[f"{axis}_select_{n}"] for n in range(3)] for axis in ("ay", "bx")}
        self.can = 0
        self.external = self._and | self._not_and
        self.terminals = 0

    @property
    def control(self) -> int:
        """The control flags, without those of a state."""
        both = self.can & self.external
        return both & self._and | ~both & self._not_and | (self.can | self.external) & self._or

    def has(self, name: str) -> bool:
        """Return whether a control flag is set."""
        return self.control & self._word.masks[name] != 0

    def data_set(self, axis: str) -> int:
        """Return the number of the data set that is chosen for an axis, ``"ay"`` or ``"bx"``."""
        control = self.control
        return sum(1 << n for n, mask in enumerate(self._selects[axis]) if control & mask)

    def set_terminal(self, name: str, on: bool) -> None:
        """Switch what a terminal says.

        Raises:
            InvalidValue: there is none of that name.
        """
        digital = {key: mask for key, mask in self._io.masks.items() if key.startswith("di_")}
        known = {**self._word.masks, **digital}
        mask = named(known, name, tr("terminal"))
        if name in digital:
            self.terminals = self.terminals | mask if on else self.terminals & ~mask
        else:
            self.external = self.external | mask if on else self.external & ~mask


def named(known: Mapping[str, int], name: object, kind: str) -> int:
    """Return what has a name.

    Raises:
        InvalidValue: nothing has; the text lists the names.
    """
    if not isinstance(name, str) or name not in known:
        names = ", ".join(known)
        raise InvalidValue(tr("there is no {kind} {name!r:.40}; there are {names}", kind=kind, name=name, names=names))
    return known[name]


def code_of(faults: int) -> int:
    """Return the error code or the alarm code: 0 without faults."""
    if not faults:
        return 0
    return _SEEN if faults == COMMUNICATION else _UNKNOWN


def with_code(word: Word, name: str, faults: int) -> int:
    """Return errors or warnings with their code, where the word has bits for it.

    Args:
        word: of the dialect.
        name: of those bits, without their number.
        faults: what is wrong.
    """
    return faults | bits_of(word, name, code_of(faults))


def bits_of(word: Word, name: str, code: int) -> int:
    """Return a code in the four bits of a name that a word has; 0 where it has none."""
    return sum(word.masks.get(f"{name}_{n}", 0) for n in range(4) if code >> n & 1)


def of_states(word: Word, states: Mapping[str, bool]) -> int:
    """Return those bits of a word whose state is true; names that the word has not are passed over."""
    return sum(word.masks.get(name, 0) for name, on in states.items() if on)


def _mask_of(word: Word, logic: Logic) -> int:
    return sum(1 << bit.number for bit in word.bits if bit.logic is logic)
