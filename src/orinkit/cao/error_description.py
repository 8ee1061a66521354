"""The command GetErrorDescription, common to the devices that implement it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant

DESCRIBE: Final = "geterrordescription"
"""Name of the command, in lower case."""
_MAX_DESCRIPTION: Final = 1000  # limit on the characters of a description


def get_error_description(describe_error: Callable[[int], str], parameter: Variant) -> str:
    """Return the result of GetErrorDescription.

    The parameter is a return code. The result is the description of the client's last error with this code. If there
    has been no error with this code, the result is the general text of the code.

    Args:
        describe_error: the client's :attr:`ClientInfo.describe_error`.
        parameter: parameter of the command, a return code.

    Raises:
        CallError: E_INVALIDARG or E_INVALIDARGTYPE if the parameter is not a return code.
    """
    code = _code_in(parameter)
    return describe_error(code)[:_MAX_DESCRIPTION] or hresult.lookup(code).text


def _code_in(parameter: Variant) -> int:
    """Return the return code in a parameter; it may be signed or unsigned.

    Raises:
        CallError: E_INVALIDARG or E_INVALIDARGTYPE if the parameter is not a return code.
    """
    number = coerce.to_real(parameter)
    if not number.is_integer() or not -(2**31) <= number < 2**32:
        raise error_for(
            hresult.E_INVALIDARG,
            tr("{number:.15g} is not a 32-bit code", number=number),
        )
    return int(number)
