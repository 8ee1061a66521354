"""The pose of Robot_Move and of commands like OutRange, in every form that clients send (RC8 3.3.4, 4.6.1).

===========================================  ====================================================================
argument                                     read as
===========================================  ====================================================================
``"@E P1"``, ``"P1, @E P2"``                 string, one target or several (:mod:`orinkit.values.poses`); six
                                             values without a letter are of type P
``["P1", "@E P2"]``                          such strings in sequence
``[value, type, pass, extra]``               one target; everything after the value may be omitted or VT_EMPTY
``[[..., "P"], "@E P2", [1, 2, 3, ...]]``    several targets, each in any of these forms
VT_R4 array of 6 to 8 numbers                one pose of type P; with 8 numbers, the last one is ignored
other array of numbers                       one pose, whose type depends on the count: 7 is P, 8 is J, 9 or 10 is T,
                                             3 is V (vector); with 4 or 6 numbers, the function decides between J and P
===========================================  ====================================================================

=====  ===============================================================================================================
part   meaning
=====  ===============================================================================================================
value  a number is the index of a variable; the type is the class of this variable, P if omitted. An array of numbers
       of any numeric type, or a VARIANT array of numbers, contains the values of the pose; if the type is omitted, the
       count of the values selects it as above
type   0 or ``"P"``, 1 or ``"T"``, 2 or ``"J"``, 3 or ``"V"``; -1: none, so that an index is that of a variable P, and the
       function decides how to interpret values
pass   -1, -2, 0, n for @P, @E, @0, @n (mm); or a string, ``"@E"``
extra  extended joints, ``[mode, [joint, value], ...]``. Mode 1 or ``"EX"`` is relative, 2 or ``"EXA"`` is absolute, 0
       or ``""`` means no extended joints, also without an array. The numbers of the modes are those of DENSO's ROS driver
=====  ===============================================================================================================

If type or pass is a string, they may be in either order. For example, ``[[x, y, z, rx, ry, rz, fig], "P", "@E"]``,
``[[x, y, z, rx, ry, rz, fig], "@E", "P"]`` and ``[2, "P", "@0"]`` are targets. An array of one to three
numbers is interpreted as value, type and pass if its first number is of an integer type, because clients send
``[1, 0, -1]`` as a VT_I4 array; or if all its other numbers are; or if it is the only number.

The value of a J variable is a VT_R4 array, too. It is therefore read as a position, as by a real controller, unless the
type follows (RC8 provider guide, appendix B).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, NotationError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.values.poses import AT_COMMAND, AT_ENCODER, PASSING, Extra, Kind, PassMark, Target, parse_targets
from orinkit.values.types import ARRAY, EMPTIES, INTEGERS, NUMERIC, VARIANT_ARRAY, VarType, type_name
from orinkit.values.variant import Variant, trusted

MAX_TARGETS: Final = 16
"""Largest number of targets of one argument."""

_BSTR_ARRAY: Final = VarType.BSTR | ARRAY
_R4_ARRAY: Final = VarType.R4 | ARRAY
_MOST_NUMBERS: Final = 10
_MOST_OF_P: Final = 7
_MOST_PARTS: Final = 4
_MOST_OF_ONE_TYPE: Final = 3  # value, type and pass may all be numbers; extra is an array

_POSITIONS: Final = (6, 7, 8)
_UNLETTERED: Final = 6  # values; seven are a position by their count
_NO_EXTRA: Final = (0, "")
_LINE_TYPES: Final = ("L", "l")
_MARK: Final = re.compile(r"@\s*(?:[PEC]|[0-9.]+)", re.IGNORECASE)

_LETTERS: Final[dict[str, Kind]] = {"P": "P", "T": "T", "J": "J", "V": "V"}
_TYPES: Final[dict[int, Kind]] = {0: "P", 1: "T", 2: "J", 3: "V", -1: ""}
_BY_COUNT: Final[dict[int, Kind]] = {3: "V", 4: "", 6: "", 7: "P", 8: "J", 9: "T", 10: "T"}
_MARKS: Final[dict[int, PassMark]] = {-1: PASSING, -2: AT_ENCODER, 0: AT_COMMAND}
_MODES: Final[dict[int | str, bool | None]] = {0: None, 1: False, 2: True, "EX": False, "EXA": True}


def read_targets(given: Variant) -> tuple[Target, ...]:
    """Return the targets of an argument; the module's docstring lists the forms.

    Raises:
        CallError: DISP_E_TYPEMISMATCH for a VARIANT type that cannot be a pose; E_INVALIDARG for a string that is not
            valid, a number that is out of range or not finite, or more than MAX_TARGETS targets.
    """
    if given.type == _BSTR_ARRAY:
        return _several([trusted(VarType.BSTR, text) for text in given.value[: MAX_TARGETS + 1]])
    if given.type == VARIANT_ARRAY and _are_targets(given.value):
        return _several(given.value)
    return _bounded(_one(given))


def line_type_as_position(given: Variant, levels: int = 2) -> Variant:
    """Return the pose of a Move with the pose type L, which some clients send for positions, replaced by P.

    An array of targets has two levels of arrays with types.
    """
    if given.type == VarType.BSTR and given.value in _LINE_TYPES:
        return trusted(VarType.BSTR, "P")
    if given.type != VARIANT_ARRAY or not levels or len(given.value) > MAX_TARGETS:
        return given
    return trusted(VARIANT_ARRAY, [line_type_as_position(each, levels - 1) for each in given.value])


def _are_targets(elements: Sequence[Variant]) -> bool:
    """Return True if the elements are targets, False if they are the parts of one target.

    They are targets if the first element is a string, or if it is an array that is the only element or is followed by
    another target.
    """
    if not elements or elements[0].type == VarType.BSTR:
        return bool(elements)
    if not elements[0].type & ARRAY:
        return False
    if len(elements) == 1 or elements[1].type & ARRAY:
        return True
    return elements[1].type == VarType.BSTR and not _is_part(elements[1].value.strip())


def _is_part(text: str) -> bool:
    """Return True if a string is a pose type or a pass mark, False if it is a target."""
    return len(text) <= 1 or _MARK.fullmatch(text) is not None


def _several(elements: Sequence[Variant]) -> tuple[Target, ...]:
    targets: list[Target] = []
    for place, element in enumerate(elements, start=1):
        try:
            targets += _one(element)
        except CallError as error:
            detail = tr("pose {place}: {detail}", place=place, detail=error.detail)
            raise error_for(error.code, detail) from None
        if len(targets) > MAX_TARGETS:
            break
    return _bounded(tuple(targets))


def _bounded(targets: tuple[Target, ...]) -> tuple[Target, ...]:
    if not targets:
        raise _invalid(tr("the array contains no pose"))
    if len(targets) > MAX_TARGETS:
        raise _invalid(tr("more than {most} poses", most=MAX_TARGETS))
    return targets


def _one(given: Variant) -> tuple[Target, ...]:
    """Return the targets in a string, which may contain several, or in an array, which is one target."""
    try:
        return _from_text(given.value) if given.type == VarType.BSTR else (_from_array(given),)
    except (NotationError, InvalidValue) as error:
        raise error_for(hresult.E_INVALIDARG, str(error)) from None


def _from_text(text: str) -> tuple[Target, ...]:
    """Return the targets of a string; values without a letter are a position (RC8 provider guide, appendix B)."""
    return tuple(
        replace(target, kind="P")
        if not target.kind and isinstance(target.value, tuple) and len(target.value) == _UNLETTERED
        else target
        for target in parse_targets(text, MAX_TARGETS)
    )


def _from_array(given: Variant) -> Target:
    elements = _elements(given)
    if not elements:
        raise _invalid(tr("an empty array is not a pose; expected 3 to {most} numbers", most=_MOST_NUMBERS))
    if all(element.type in NUMERIC for element in elements) and not _begins_with_index(elements):
        return Target(*_kind_and_values(given))
    return _from_parts(elements)


def _begins_with_index(elements: Sequence[Variant]) -> bool:
    """Return True if numbers are index, type and pass, False if they are values."""
    if len(elements) > _MOST_OF_ONE_TYPE:
        return False
    first = elements[0]
    if first.type in INTEGERS:
        return True
    whole = float(first.value).is_integer()
    return whole and all(each.type in INTEGERS for each in elements[1:])


def _kind_and_values(given: Variant) -> tuple[Kind, tuple[float, ...]]:
    """Return the pose type and the values of an array of numbers without a type."""
    values = _numbers(given)
    if given.type == _R4_ARRAY and len(values) in _POSITIONS:
        return "P", values[:_MOST_OF_P]
    return _kind_by_count(values), values


def _elements(given: Variant) -> Sequence[Variant]:
    if given.type == VARIANT_ARRAY:
        elements: Sequence[Variant] = given.value
        return elements
    base = given.type & ~ARRAY
    if given.type & ARRAY and base in NUMERIC:
        return [trusted(base, value) for value in given.value[: _MOST_NUMBERS + 1]]
    raise _mismatch(given, tr("a pose (VT_BSTR, an array of numbers or a VARIANT array)"))


class Parts(NamedTuple):
    """The parts of an array ``[value, type, pass, extra]``; the last three are ``None`` if they are omitted or none."""

    value: Variant
    kind: Kind | None
    mark: PassMark | None
    extra: Extra | None


def read_parts(parts: Sequence[Variant]) -> Parts:
    """Return the parts of a target, or of a length or angle in the same form.

    Raises:
        CallError: As for :func:`read_targets`.
    """
    try:
        return _parts(parts)
    except (NotationError, InvalidValue) as error:
        raise error_for(hresult.E_INVALIDARG, str(error)) from None


def _parts(parts: Sequence[Variant]) -> Parts:
    if not 1 <= len(parts) <= _MOST_PARTS:
        raise _invalid(
            tr(
                "pose of {count} elements; expected at most 4: value, type, pass mark, extended joints",
                count=len(parts),
            ),
        )
    value, kind_part, mark_part, extra_part = [*parts, *[trusted(VarType.EMPTY, None)] * (_MOST_PARTS - len(parts))]
    if kind_part.type == VarType.BSTR and kind_part.value.lstrip().startswith("@"):
        kind_part, mark_part = mark_part, kind_part
    return Parts(value, _kind(kind_part), _mark(mark_part), _extra(extra_part))


def _from_parts(parts: Sequence[Variant]) -> Target:
    value, kind, mark, extra = _parts(parts)
    if value.type in NUMERIC:
        return Target(kind or "P", coerce.to_integer(value), mark, extra)
    if kind is None:
        return Target(*_kind_and_values(value), mark, extra)
    return Target(kind, _numbers(value), mark, extra)


def _numbers(given: Variant) -> tuple[float, ...]:
    elements = _elements(given)
    if len(elements) > _MOST_NUMBERS:
        raise _invalid(tr("more than {most} numbers", most=_MOST_NUMBERS))
    for element in elements:
        if element.type not in NUMERIC:
            raise _mismatch(element, tr("a number in a pose"))
    return tuple(float(element.value) for element in elements)


def _kind_by_count(values: Sequence[float]) -> Kind:
    kind = _BY_COUNT.get(len(values))
    if kind is None:
        raise _invalid(
            tr(
                "the pose type of {count} numbers is unknown; expected 7 (P), 8 (J), 9 or 10 (T) or 3 (V)",
                count=len(values),
            ),
        )
    return kind


def _kind(given: Variant) -> Kind | None:
    """Return the pose type in a part of a target: ``None`` if the part is empty, ``""`` if the function decides."""
    word = _word(given, tr("a pose type"))
    if word == "":
        return None
    kind = _LETTERS.get(word) if isinstance(word, str) else _TYPES.get(coerce.to_integer(given))
    if kind is None:
        raise _invalid(
            tr("{word} is not a pose type. Try: 0 or P, 1 or T, 2 or J, 3 or V, -1 for none", word=quoted(word)),
        )
    return kind


def _mark(given: Variant) -> PassMark | None:
    word = _word(given, tr("a pass mark"))
    if isinstance(word, str):
        return PassMark.parse(word) if word else None
    number = coerce.to_real(given)
    if number > 0:
        return PassMark("n", number)
    mark = _MARKS.get(int(number)) if number.is_integer() else None
    if mark is None:
        raise _invalid(
            tr("{word} is not a pass mark. Try: -1 (@P), -2 (@E), 0 (@0) or n above 0 (@n)", word=quoted(word)),
        )
    return mark


def _extra(given: Variant) -> Extra | None:
    if given.type in EMPTIES or given.value in _NO_EXTRA:
        return None
    mode, *joints = _elements(given) or [trusted(VarType.EMPTY, None)]
    word = _word(mode, tr("the mode of extended joints"))
    key = word if isinstance(word, str) else coerce.to_integer(mode)
    if key not in _MODES or len(joints) > len(_MODES):
        raise _invalid(
            tr(
                "mode {word} with {count} extended joints is not valid. Try: [1 (EX) or 2 (EXA), [7, value], "
                "[8, value]]",
                word=quoted(word),
                count=len(joints),
            ),
        )
    absolute = _MODES[key]
    return None if absolute is None else Extra(absolute, tuple(map(_joint, joints)))


def _joint(given: Variant) -> tuple[int, float]:
    numbers = _numbers(given)
    if len(numbers) != 2 or not numbers[0].is_integer():
        raise _invalid(
            tr("expected an extended joint as [number, value], for example [7, 30.5]"),
        )
    return int(numbers[0]), numbers[1]


def _word(given: Variant, wanted: str) -> str | float:
    """Return a part of a target, either as a string in upper case or as a number; ``""`` if the part is empty."""
    if given.type in EMPTIES:
        return ""
    if given.type == VarType.BSTR:
        return str(given.value).strip().upper()
    if given.type in NUMERIC:
        return coerce.to_number(given)
    raise _mismatch(given, wanted)


def _invalid(text: str) -> CallError:
    return error_for(hresult.E_INVALIDARG, text)


def _mismatch(given: Variant, wanted: str) -> CallError:
    name = type_name(given.type)
    return error_for(hresult.DISP_E_TYPEMISMATCH, tr("got {type}, expected {wanted}", type=name, wanted=wanted))
