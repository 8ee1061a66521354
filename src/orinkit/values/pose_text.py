"""Parser of poses.

It returns plain values; :mod:`orinkit.values.poses` creates objects from them, and describes the grammar.
"""

from __future__ import annotations

import math
import re
from typing import Final, NamedTuple

from orinkit.core.errors import NotationError
from orinkit.core.i18n import N_, tr
from orinkit.values.pose_numbers import COUNTS, EXTRA_JOINTS, FIELDS, MAX_WHOLE, counted, is_whole

MAX_LENGTH: Final = 4096
"""Largest number of characters of a text to parse."""

_SHOWN: Final = 20  # characters of a text that an error message quotes
_SPACE: Final = re.compile(r"[ \t\r\n]*")
_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE: Final = re.compile(r"[0-9]+")
_LONGEST_WHOLE: Final = 10
_KIND: Final = re.compile(r"[PTJVptjv]")
_MODE: Final = re.compile(r"[CEPcep]")
_EXTRA: Final = re.compile(r"[Ee][Xx][Aa]?")


class PassMarkText(NamedTuple):
    """Parsed pass mark such as ``@E``: the mode (``0``, ``E``, ``C``, ``P`` or ``n``), and the radius in mm for ``n``."""

    mode: str
    radius: float


class ExtraJointsText(NamedTuple):
    """Parsed extended joints such as ``EXA((7, 10))``."""

    absolute: bool
    joints: tuple[tuple[int, float], ...]


class TargetParts(NamedTuple):
    """Parsed target such as ``@E P1 EX((7, 10))``."""

    kind: str
    value: tuple[float, ...] | int
    mark: PassMarkText | None
    extra: ExtraJointsText | None


class Scanner:
    """Splits a text into tokens in one pass; ``at`` is the position. Blanks before a token are ignored.

    Raises:
        NotationError: If the text is longer than MAX_LENGTH.
    """

    __slots__ = ("at", "text")

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0
        if len(text) > MAX_LENGTH:
            raise _error(
                MAX_LENGTH,
                tr("the text is longer than {most} characters", most=MAX_LENGTH),
            )

    def here(self) -> int:
        """Skip blanks; return the position of the next token."""
        match = _SPACE.match(self.text, self.at)
        assert match  # the pattern also matches an empty text
        self.at = match.end()
        return self.at

    def skip(self, sign: str) -> bool:
        """Skip a sign if it follows; return True if it was skipped."""
        found = self.text.startswith(sign, self.here())
        self.at += len(sign) if found else 0
        return found

    def need(self, sign: str) -> None:
        """Skip a sign; raise an error if it does not follow."""
        if not self.skip(sign):
            raise self.expected(tr('"{sign}"', sign=sign))

    def take(self, pattern: re.Pattern[str]) -> str:
        """Skip and return the text that a pattern matches at this position; return ``""`` if it does not match."""
        match = pattern.match(self.text, self.here())
        if not match:
            return ""
        self.at = match.end()
        return match[0]

    def number(self, wanted: str, **values: object) -> float:
        """Read a finite number.

        Args:
            wanted: Message that describes the number.
            values: Values of the placeholders in the message.
        """
        start = self.here()
        text = self.take(_NUMBER)
        number = float(text) if text else math.nan
        if not math.isfinite(number):
            raise self.expected(tr(wanted, **values), start)
        return number

    def whole(self, low: int, high: int, wanted: str, **values: object) -> int:
        """Read a whole number without a sign, ``low`` to ``high``; the other arguments are as for :meth:`number`."""
        start = self.here()
        text = self.take(_WHOLE)
        number = int(text) if 0 < len(text) <= _LONGEST_WHOLE else -1
        if not low <= number <= high:
            raise self.expected(tr(wanted, **values), start)
        return number

    def finish(self) -> None:
        """Raise an error if any text except blanks follows."""
        if self.here() < len(self.text):
            raise self.expected(tr("the end of the text"))

    def expected(self, wanted: str, at: int | None = None) -> NotationError:
        """Return the error for unexpected text at this position, or at ``at``."""
        at = self.here() if at is None else at
        found = self.text[at : at + _SHOWN]
        if not found:
            return _error(at, tr("expected {wanted}, the text ends here", wanted=wanted))
        return _error(at, tr("expected {wanted}, found {found!r}", wanted=wanted, found=found))


def _error(at: int, problem: str) -> NotationError:
    return NotationError(tr("column {column}: {problem}", column=at + 1, problem=problem))


def read_target(scanner: Scanner) -> TargetParts:
    """Read one target."""
    mark = read_mark(scanner)
    kind = scanner.take(_KIND).upper()
    value: tuple[float, ...] | int
    if scanner.skip("("):
        value = _read_values(scanner, kind)
    elif not kind:
        raise scanner.expected(
            tr("a pose like P1, P(x, y, z, rx, ry, rz, fig) or J(j1, ..., j6)"),
        )
    elif scanner.skip("["):
        value = scanner.whole(0, MAX_WHOLE, N_("the number of a variable {kind}"), kind=kind)
        scanner.need("]")
    else:
        value = scanner.whole(0, MAX_WHOLE, N_('the number of a variable {kind}, or "(" followed by values'), kind=kind)
    return TargetParts(kind, value, mark, read_extra(scanner))


def read_mark(scanner: Scanner) -> PassMarkText | None:
    """Read a pass mark; return ``None`` if no pass mark follows."""
    if not scanner.skip("@"):
        return None
    mode = scanner.take(_MODE).upper()
    if mode:
        return PassMarkText(mode, 0.0)
    start = scanner.here()
    wanted = N_("P, E, C, 0 or a radius in mm")
    radius = scanner.number(wanted)
    if radius < 0:
        raise scanner.expected(tr(wanted), start)
    return PassMarkText("n" if radius else "0", radius)


def _read_values(scanner: Scanner, kind: str) -> tuple[float, ...]:
    least, most = COUNTS[kind]
    values = [_read_value(scanner, kind, 0)]
    while len(values) < most and scanner.skip(","):
        values.append(_read_value(scanner, kind, len(values)))
    if scanner.skip(")"):
        if len(values) >= least:
            return tuple(values)
        scanner.at -= 1
    counts = counted(kind)
    if len(values) < least:
        raise scanner.expected(
            tr('"," and another value ({kind}(...) has {counts} values)', counts=counts, kind=kind),
        )
    if len(values) < most:
        raise scanner.expected(tr('"," or ")"'))
    raise scanner.expected(tr('")" after the {counts} values of {kind}(...)', counts=counts, kind=kind))


def _read_value(scanner: Scanner, kind: str, place: int) -> float:
    name = FIELDS[kind][place]
    start = scanner.here()
    value = scanner.number(N_("a number ({name})"), name=name)
    if name == "fig" and not is_whole(value):
        raise scanner.expected(tr("a whole number (fig)"), start)
    return value


def read_extra(scanner: Scanner) -> ExtraJointsText | None:
    """Read extended joints; return ``None`` if none follow."""
    name = scanner.take(_EXTRA)
    if not name:
        return None
    scanner.need("(")
    joints: dict[int, float] = {}
    if scanner.skip("("):
        _read_joint(scanner, joints)
        while scanner.skip(","):
            scanner.need("(")
            _read_joint(scanner, joints)
        scanner.need(")")
    else:
        _read_joint(scanner, joints)
    return ExtraJointsText(len(name) > len("EX"), tuple(joints.items()))


def _read_joint(scanner: Scanner, joints: dict[int, float]) -> None:
    start = scanner.here()
    joint = scanner.whole(*EXTRA_JOINTS, N_("the number of an extended joint, 7 or 8"))
    if joint in joints:
        raise scanner.expected(tr("the number of the other extended joint"), start)
    scanner.need(",")
    joints[joint] = scanner.number(N_("a number (J{joint})"), joint=joint)
    scanner.need(")")
