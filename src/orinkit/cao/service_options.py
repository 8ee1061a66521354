"""The options of Service_Start (RC8 table 3-1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from orinkit.cao import coerce
from orinkit.cao.options import Options
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant

MIN_MS: Final = 80
"""Smallest interval and time-out of Service_Start, ms; the document requires more than this for WDT."""
LEAST_ALIVE_MS: Final = 200
_MAX_MS: Final = 0x7FFF_FFFF


class ServiceOptions(NamedTuple):
    """The options of Service_Start.

    Attributes:
        wdt: seconds between S_EXECUTING packets during a call (``WDT=<ms>``); ``None`` for no such packets.
        invoke_timeout: limit on the duration of a call, s (``InvokeTimeout=<ms>``); ``None`` for the server's default.
        max_silence: limit on the client's silence while its arm moves, s (``Alive=<ms>``, an option of orinkit); ``None`` for
            no limit.
    """

    wdt: float | None = None
    invoke_timeout: float | None = None
    max_silence: float | None = None


def read_options(arguments: Sequence[Variant], *, strict: bool = False) -> ServiceOptions:
    """Return the options of Service_Start.

    If the type or the number of the arguments is wrong, the defaults are returned; the session then refuses the call.
    A value of WDT or InvokeTimeout that is not a number means "not limited", as real controllers read it.

    Args:
        arguments: the arguments of the call.
        strict: True to refuse ``WDT=80`` and values that are not numbers, as the document requires.

    Raises:
        CallError: E_INVALIDARG if the value of an option is invalid.
    """
    if len(arguments) != 1:
        return ServiceOptions()
    try:
        options = Options(coerce.to_text(arguments[0]))
    except CallError as error:
        if error.code == hresult.E_INVALIDARGTYPE:
            return ServiceOptions()
        raise
    return ServiceOptions(
        _seconds(options, "WDT", MIN_MS + strict, strict=strict),
        _seconds(options, "InvokeTimeout", MIN_MS, strict=strict),
        _seconds(options, "Alive", LEAST_ALIVE_MS, strict=True),
    )


def _seconds(options: Options, name: str, least: int, *, strict: bool) -> float | None:
    try:
        number = options.number(name)
    except ValueError:
        number = -1 if strict else None
    if number is None:
        return None
    if not least <= number <= _MAX_MS:
        given = options.text_of(name)
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "{name} must be {least} to {most} ms, not {given:.40}",
                name=name,
                given=given,
                least=least,
                most=_MAX_MS,
            ),
        )
    return number / 1000
