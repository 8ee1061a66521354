"""The command GetErrorDescription, which devices answer by themselves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant

DESCRIBE: Final = "geterrordescription"
"""The command that asks for it, in lower case."""
_DESCRIBED: Final = 1000  # characters of an error's description


def describe_error(reason: Callable[[int], str], parameter: Variant) -> str:
    """Return what the command GetErrorDescription answers: what went wrong in words, else the text of the code.

    Args:
        reason: of the client, as :attr:`ClientInfo.reason`.
        parameter: of the command, a return code.

    Raises:
        CallError: E_INVALIDARG, E_INVALIDARGTYPE; it is none.
    """
    code = _code_in(parameter)
    return reason(code)[:_DESCRIBED] or hresult.lookup(code).text


def _code_in(parameter: Variant) -> int:
    """Return a return code, signed or unsigned.

    Raises:
        CallError: E_INVALIDARG, E_INVALIDARGTYPE; it is none.
    """
    number = coerce.to_real(parameter)
    if not number.is_integer() or not -(2**31) <= number < 2**32:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("{number:.15g} is no 32-bit code", number=number),
        )
    return int(number)
