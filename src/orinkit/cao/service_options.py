"""What a client asks for with Service_Start (RC8 table 3-1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from orinkit.cao import coerce
from orinkit.cao.options import Options
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant

_LEAST_MS: Final = 80
LEAST_ALIVE_MS: Final = 200
_MOST_MS: Final = 0x7FFF_FFFF


class ServiceOptions(NamedTuple):
    """The options of Service_Start.

    Attributes:
        wdt: seconds between S_EXECUTING packets while a call is at work (``WDT=<ms>``); ``None`` for none.
        invoke_timeout: seconds that a call may take (``InvokeTimeout=<ms>``); ``None`` for the server's own.
        alive: seconds within which the client wants to be heard while its arm moves (``Alive=<ms>``, orinkit's own
            option); ``None`` for no such limit.
    """

    wdt: float | None = None
    invoke_timeout: float | None = None
    alive: float | None = None


def read_options(arguments: Sequence[Variant]) -> ServiceOptions:
    """Read the argument of Service_Start; one that is no text, or one of several, is for the session to refuse.

    Raises:
        CallError: E_INVALIDARG, a value is not one.
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
        _seconds(options, "WDT", _LEAST_MS + 1),
        _seconds(options, "InvokeTimeout", _LEAST_MS),
        _seconds(options, "Alive", LEAST_ALIVE_MS),
    )


def _seconds(options: Options, name: str, least: int) -> float | None:
    try:
        number = options.number(name)
    except ValueError:
        number = -1
    if number is None:
        return None
    if not least <= number <= _MOST_MS:
        given = options.text_of(name)
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "{name}={given:.40} is no number of ms from {least} to {most}",
                name=name,
                given=given,
                least=least,
                most=_MOST_MS,
            ),
        )
    return number / 1000
