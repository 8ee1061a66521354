"""Reads vectors, lengths, angles and axis values with pass marks (RC8 provider guide, appendix B, formats C1 to C3).

======  =============================  ===========================================================================
format  string                         array
======  =============================  ===========================================================================
C1      ``"@P V1"``, ``"V(1, 2, 3)"``  ``[20, "V", "@P"]``, ``[[x, y, z], 3, -2]``
C2      ``"@P 10 EX((7, 5))"``         ``[10.0, "", "@P"]``, ``[10, -1, -1]``; or a plain number
C3      ``"@0 (1, 10), (2, 10)"``      ``[[1, 10.0], "", "@P"]``, ``[[1, 10.0], -1, -1]``; a pair ``[1, 10.0]``; or an
                                       array of such elements
======  =============================  ===========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from orinkit.core import hresult
from orinkit.core.errors import CallError, NotationError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.rc8.pose_arguments import read_parts, read_targets
from orinkit.values.pose_text import Scanner, read_extra
from orinkit.values.poses import Extra, PassMark, Target
from orinkit.values.types import ARRAY, EMPTIES, NUMERIC, VARIANT_ARRAY, VarType
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.variables import conversion

_MARK: Final = re.compile(r"@\s*(?:[PEC]|[0-9.]+)", re.IGNORECASE)
_EXTRA: Final = re.compile(r"\bEXA?\s*\(.*", re.IGNORECASE | re.DOTALL)
_PAIRS: Final = re.compile(r"\(([^(),]*),([^(),]*)\)")
_BETWEEN: Final = re.compile(r"[\s,]*")
_PAIR: Final = 2
_NUMBERS: Final = NUMERIC | {int(VarType.BSTR)}


class Amount(NamedTuple):
    """A length or an angle with its pass mark and extended joints; the last two may be ``None``."""

    value: float
    mark: PassMark | None
    extra: Extra | None


class AxisValues(NamedTuple):
    """Axes with their distances or positions, the pass mark and extended joints; the last two may be ``None``."""

    pairs: list[tuple[int, float]]
    mark: PassMark | None
    extra: Extra | None


def amount(given: Variant) -> Amount:
    """Return a length or an angle (format C2).

    Raises:
        CallError: E_INVALIDARG if mark or extended joints are not valid; DISP_E_TYPEMISMATCH if there is no number.
    """
    if given.type & ARRAY:
        parts = read_parts(parameters.elements(given))
        return Amount(conversion.double(parts.value), parts.mark, parts.extra)
    if not isinstance(given.value, str):
        return Amount(conversion.double(given), None, None)
    mark, text, extra = _split(given.value)
    return Amount(conversion.double(Variant(VarType.BSTR, text)), mark, extra)


def vector(given: Variant) -> Target:
    """Return a vector (format C1), or the index of a variable V.

    Raises:
        CallError: E_INVALIDARG, also for several vectors; DISP_E_TYPEMISMATCH if it is not a vector.
    """
    targets = read_targets(given)
    if len(targets) != 1:
        raise error_for(hresult.E_INVALIDARG, tr("expected 1 vector, got {count}", count=len(targets)))
    if targets[0].kind != "V":
        raise error_for(
            hresult.DISP_E_TYPEMISMATCH, tr("{target} is not a vector. Try: V1 or V(x, y, z)", target=targets[0])
        )
    return targets[0]


def axis_values(given: Sequence[Variant]) -> tuple[AxisValues, list[Variant]]:
    """Return the axes at the start of a parameter (format C3), and the elements after them.

    Raises:
        CallError: E_INVALIDARG if there are no axes, or if they are not valid.
    """
    if not given or not given[0].type & ARRAY:
        if given and isinstance(given[0].value, str):
            return _axes_in_text(given[0].value), list(given[1:])
        raise _no_pairs()
    if _is_element(given):  # the parameter itself is [pair, type, mark]
        count = 3 if len(given) > 2 and _is_plain(given[2]) else 2
        return _axes_in_elements([Variant(VARIANT_ARRAY, list(given[:count]))]), list(given[count:])
    count = next((place for place, each in enumerate(given) if not each.type & ARRAY), len(given))
    return _axes_in_elements(given[:count]), list(given[count:])


def _axes_in_text(given: str) -> AxisValues:
    mark, text, extra = _split(given)
    pairs = [(found[1], found[2]) for found in _PAIRS.finditer(text)]
    if not pairs or not _BETWEEN.fullmatch(_PAIRS.sub("", text)):
        raise _no_axes(text)
    return AxisValues(
        [(conversion.whole(_text(axis)), conversion.double(_text(value))) for axis, value in pairs], mark, extra
    )


def _axes_in_elements(given: Sequence[Variant], *, nested: bool = True) -> AxisValues:
    """Return the axes of elements ``pair`` or ``[pair, type, mark, extra]``; the last mark counts for the motion.

    With ``nested``, an element may also be an array of such elements.
    """
    pairs: list[tuple[int, float]] = []
    mark: PassMark | None = None
    extra: Extra | None = None
    for each in given:
        parts = parameters.elements(each)
        if _is_pair(each):
            pairs.append(_pair(each))
        elif _is_element(parts):
            read = read_parts(parts)
            pairs.append(_pair(read.value))
            mark, extra = read.mark or mark, read.extra or extra
        elif len(parts) == 1 and _is_pair(parts[0]):
            pairs.append(_pair(parts[0]))
        elif nested and parts and all(part.type & ARRAY for part in parts):
            inner = _axes_in_elements(parts, nested=False)
            pairs += inner.pairs
            mark, extra = inner.mark or mark, inner.extra or extra
        else:
            raise _no_axes(str(each.plain))
    if not pairs:
        raise _no_pairs()
    return AxisValues(pairs, mark, extra)


def _is_pair(given: Variant) -> bool:
    """Return True if an array has two elements, which are numbers or texts."""
    if not given.type & ARRAY or len(given.value) != _PAIR:
        return False
    return all(each.type in _NUMBERS for each in parameters.elements(given))


def _is_element(parts: Sequence[Variant]) -> bool:
    """Return True for a pair that is followed by a type, which is a number, empty, or a string without a meaning."""
    if len(parts) < 2 or not _is_pair(parts[0]) or parts[1].type & ARRAY:
        return False
    return _is_plain(parts[1])


def _is_plain(part: Variant) -> bool:
    """Return True for a type or a pass mark of an axis: a number, empty, or the text of a pass mark."""
    if not isinstance(part.value, str):
        return part.type in NUMERIC or part.type in EMPTIES
    return not part.value.strip() or _MARK.fullmatch(part.value.strip()) is not None


def _pair(given: Variant) -> tuple[int, float]:
    if not _is_pair(given):
        raise _no_axes(str(given.plain))
    axis, value = parameters.elements(given)
    return conversion.whole(axis), conversion.double(value)


def _split(given: str) -> tuple[PassMark | None, str, Extra | None]:
    """Return the pass mark at the start of a string, the text between, and the extended joints at its end."""
    text = parameters.check_length(given).strip()
    mark, extra = _MARK.match(text), _EXTRA.search(text)
    body = text[mark.end() if mark else 0 : extra.start() if extra else None].strip()
    return parameters.pass_mark(mark[0]) if mark else None, body, _read_extra(extra[0]) if extra else None


def _read_extra(text: str) -> Extra | None:
    scanner = Scanner(text)
    try:
        found = read_extra(scanner)
        scanner.finish()
    except NotationError as error:
        raise error_for(hresult.E_INVALIDARG, f"{quoted(text)}: {error}") from None
    return None if found is None else Extra(*found)


def _text(text: str) -> Variant:
    return Variant(VarType.BSTR, text)


def _no_axes(text: str) -> CallError:
    return error_for(
        hresult.E_INVALIDARG,
        tr('{text} is not a list of axes and values. Try: for example "@0 (1,10),(2,20)"', text=quoted(text)),
    )


def _no_pairs() -> CallError:
    return error_for(
        hresult.E_INVALIDARG,
        tr("expected at least 1 pair of an axis and a value, got none. Try: for example [[1, 10], [2, 20]]"),
    )
