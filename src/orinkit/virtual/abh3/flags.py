"""Flag words of a virtual ABH3: state flags, and control flags, which are computed from inputs and terminals.

:mod:`orinkit.abh3.table.signals` defines the bits of all flag words.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from orinkit.abh3.table.signals import V1, Dialect, TerminalGate, Word
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

FAULTS: Final = V1.errors
"""The flag word of the faults; each fault has the same bit in both dialects."""
COMMUNICATION: Final = FAULTS.mask("can_communication")

_COMMUNICATION_CODE: Final = 3  # observed on real drivers if CAN communication is the only fault
_OTHER_CODE: Final = 15


class Inputs:
    """Inputs from the host and the terminals, and the resulting control flags.

    Initially the terminals are set so that CAN alone controls the driver: a terminal is on if it is combined with its
    input by AND, and off if by OR.

    Args:
        dialect: Dialect of the driver.

    Attributes:
        can: Inputs as last sent by the host.
        external: The terminals that are combined with inputs, as bits; a terminal has the number of its input.
        terminals: The digital inputs without a function, as bits of the I/O flags.
    """

    def __init__(self, dialect: Dialect) -> None:
        self._word = dialect.inputs
        self._io = dialect.io
        masks = {gate: _mask_of(dialect.inputs, gate) for gate in TerminalGate}
        self._and = masks[TerminalGate.AND]
        self._not_and = masks[TerminalGate.NOT_AND]
        self._or = masks[TerminalGate.OR]
        self._selects = {axis: [dialect.inputs.masks[f"{axis}_select_{n}"] for n in range(3)] for axis in ("ay", "bx")}
        self.can = 0
        self.external = self._and | self._not_and
        self.terminals = 0

    @property
    def control(self) -> int:
        """The control flags, without the state flags that v2 adds."""
        both = self.can & self.external
        return both & self._and | ~both & self._not_and | (self.can | self.external) & self._or

    def has(self, name: str) -> bool:
        """Return True if a control flag is set."""
        return self.control & self._word.masks[name] != 0

    def data_set(self, axis: str) -> int:
        """Return the number of the selected data set of an axis, ``"ay"`` or ``"bx"``."""
        control = self.control
        return sum(1 << n for n, mask in enumerate(self._selects[axis]) if control & mask)

    def set_terminal(self, name: str, on: bool) -> None:
        """Switch a terminal on or off.

        Raises:
            InvalidValue: If there is no such terminal.
        """
        digital = {key: mask for key, mask in self._io.masks.items() if key.startswith("di_")}
        known = {**self._word.masks, **digital}
        mask = named(known, name, tr("terminal"))
        if name in digital:
            self.terminals = self.terminals | mask if on else self.terminals & ~mask
        else:
            self.external = self.external | mask if on else self.external & ~mask


def named(known: Mapping[str, int], name: object, kind: str) -> int:
    """Return the value that a mapping contains for a name.

    Raises:
        InvalidValue: If the name is unknown; the message lists the valid names.
    """
    if not isinstance(name, str) or name not in known:
        names = ", ".join(known)
        raise InvalidValue(
            tr("there is no {kind} {name!r:.40}; valid names: {names}", kind=kind, name=name, names=names)
        )
    return known[name]


def code_of(faults: int) -> int:
    """Return the error code of errors or the alarm code of warnings; 0 if ``faults`` has no bit set."""
    if not faults:
        return 0
    return _COMMUNICATION_CODE if faults == COMMUNICATION else _OTHER_CODE


def with_code(word: Word, name: str, faults: int) -> int:
    """Return the bits of errors or warnings, together with the bits of their code if the word has bits for a code.

    Args:
        word: Flag word of the dialect.
        name: Name of the bits of the code, without their number: ``error_code`` for ``error_code_0`` to
            ``error_code_3``.
        faults: Errors or warnings.
    """
    return faults | bits_of(word, name, code_of(faults))


def bits_of(word: Word, name: str, code: int) -> int:
    """Return a code as bits of a flag word; 0 if the word has no bits for the code.

    With the name ``error_code``, these are the bits ``error_code_0`` to ``error_code_3``.
    """
    return sum(word.masks.get(f"{name}_{n}", 0) for n in range(4) if code >> n & 1)


def of_states(word: Word, states: Mapping[str, bool]) -> int:
    """Return a flag word in which the bits of the True states are set; a state for which it has no bit is ignored."""
    return sum(word.masks.get(name, 0) for name, on in states.items() if on)


def _mask_of(word: Word, gate: TerminalGate) -> int:
    return sum(1 << bit.number for bit in word.bits if bit.gate is gate)
