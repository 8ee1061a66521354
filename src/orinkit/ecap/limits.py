"""Limits on the values in the bodies of e-CAP, which are the limits of b-CAP packets."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import LimitExceeded
from orinkit.core.i18n import tr
from orinkit.values import codec
from orinkit.values.codec import PacketLimits
from orinkit.values.notation import parse
from orinkit.values.types import ARRAY, TABLE, VARIANT_ARRAY, VarType
from orinkit.values.variant import Variant


def too_long(length: int, limits: PacketLimits) -> str:
    """Return the message about a body that is too long."""
    return tr("body of {length} bytes exceeds the limit of {most} bytes", length=length, most=limits.packet)


_SLICE: Final = 4096  # characters searched at a time
_MARGIN: Final = 80  # characters; at least the longest match of _HEAD
_FIRST: Final = re.compile(r"[ \t\r\n]*+([0-9]{1,5})")
_HEAD: Final = re.compile(r"(?:\A|\()[ \t\r\n]{0,64}+([0-9]{1,5}|[ \t\r\n])")
# The types of arrays whose elements are slow to parse. The elements of VARIANT arrays are counted by their brackets.
_SLOW: Final = {int(row.code) | ARRAY for row in TABLE if row.elements_per_unit == 1} - {VARIANT_ARRAY}
# The costs are the estimated times to parse a character, in microseconds. _ALLOWANCE is the time allowed for each
# permitted element, also in microseconds; with the default limits, the total is one second. The costs of brackets and
# of commas of slow types are overestimated: PacketLimits.variants limits such arrays after parsing.
_BRACKET_COST: Final = 10
_SLOW_COST: Final = 5
_QUOTES_FOR_ONE: Final = 8
_ALLOWANCE: Final = 20


def check_cost(texts: Iterable[str], limits: PacketLimits) -> None:
    """Estimate the time to parse texts by counting characters, and refuse texts that would take too long.

    Raises:
        LimitExceeded: If the texts contain too many brackets, quotation marks and commas.
    """
    left = _ALLOWANCE * limits.variants
    for text in texts:
        if len(text) > limits.variants:
            left -= _cost(text, left)
    if left < 0:
        raise LimitExceeded(
            tr(
                "the arrays have too many elements for e-CAP, which transfers arrays as text. Try: use smaller "
                "arrays, several calls, or b-CAP"
            ),
            hresult.E_ARGSIZEOVER,
        )


def _cost(text: str, left: int) -> int:
    head = _FIRST.match(text)
    if not head or not (int(head[1]) & ARRAY or int(head[1]) == VarType.VARIANT):
        return 0  # a scalar, or not a VARIANT in the notation
    cost = _BRACKET_COST * _count(text, "(") + _count(text, '"') // _QUOTES_FOR_ONE
    if cost > left:
        return cost
    return cost + (_SLOW_COST if _has_slow(text) else 1) * _count(text, ",")


def _count(text: str, sign: str) -> int:
    return sum(text.count(sign, at, at + _SLICE) for at in range(0, len(text), _SLICE))


def _has_slow(text: str) -> bool:
    """Return True if a text may contain an array whose type is slow to parse.

    More than 64 blanks before a type also count as such an array, because the type after them is not examined.
    """
    for at in range(0, len(text), _SLICE):
        heads = set(_HEAD.findall(text, at, at + _SLICE + _MARGIN))
        if any(head.isspace() or int(head) in _SLOW for head in heads):
            return True
    return False


def parse_limited(text: str, limits: PacketLimits) -> Variant:
    """Return the VARIANT that a text in the notation of e-CAP 3.5 represents.

    Raises:
        NotationError: If the text is not a VARIANT.
        LimitExceeded: If the value exceeds the limits of a b-CAP packet.
    """
    item = parse(text, exact=True)
    if item.type & ARRAY and len(text) > limits.variants:  # a shorter text cannot have more elements than the limit
        sizes = PacketLimits(limits.packet, limits.depth, limits.variants)
        codec.decode(codec.encode_variant(item), limits=sizes)
    return item
