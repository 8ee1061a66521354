"""Mapping of the exceptions of ABH3 drivers to CAO return codes."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import (
    CallError,
    DriverTimeout,
    InvalidAddress,
    InvalidValue,
    MissingExtra,
    OrinError,
    TransportError,
    error_for,
)

_CODES: Final[tuple[tuple[tuple[type[OrinError], ...], int], ...]] = (
    ((InvalidValue, InvalidAddress), hresult.E_INVALIDARG),
    ((DriverTimeout,), hresult.E_TIMEOUT),
    ((TransportError, MissingExtra), hresult.E_CAO_REMOTE_PROVIDER),
)


class map_errors:  # noqa: N801 - used like a statement
    """Context manager that converts the exceptions of drivers to CallError with the same text.

    The return code is E_FAIL if no other return code fits.
    """

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, CallError) or not isinstance(error, OrinError):
            return
        codes = (code for kinds, code in _CODES if isinstance(error, kinds))
        raise error_for(next(codes, hresult.E_FAIL), str(error)) from error
