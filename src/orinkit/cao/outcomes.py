"""The outcomes of calls: replies, calls without a result so far, and failed calls with the descriptions of their errors."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from traceback import format_exception_only
from typing import Any, Final, TypeAlias

from orinkit.cao.provider import Provider
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.core.i18n import cut, printable
from orinkit.core.record import record
from orinkit.values.variant import Variant

logger = logging.getLogger("orinkit.session")

_MAX_DESCRIPTIONS: Final = 32  # limit on the return codes with a stored description
_MAX_DESCRIPTION: Final = 1000  # limit on the characters of a description


@dataclass(slots=True)
class CallReply:
    """The reply to one call.

    Attributes:
        code: return code.
        result: the result, ``None`` for a function without one.
        detail: description of the error, for the log and for users.
    """

    code: int = hresult.S_OK
    result: Variant | None = None
    detail: str = ""


@record
class Pending:
    """A call without a result so far; ``work`` is an awaitable, a :class:`BlockingCall` or a :class:`Deferred`."""

    function: Function[..., Any]
    handle: int
    label: str
    work: Any
    provider: Provider | None = None


Outcome: TypeAlias = CallReply | Pending


class FailedCalls:
    """Creates the replies to the failed calls of one client, and stores the descriptions of their errors."""

    def __init__(self) -> None:
        self._reasons: dict[int, str] = {}

    def describe(self, code: int) -> str:
        """Return the description of the last error with a return code; ``""`` if it is unknown."""
        return self._reasons.get(hresult.unsigned(code), "")

    def reply(self, function: Function[..., Any], error: BaseException) -> CallReply:
        """Return the reply to a call that has raised an exception, and log the exception."""
        if isinstance(error, CallError) and hresult.failed(error.code):
            # b-CAP transmits only the code; the detail is logged here
            level = logging.INFO if error.detail else logging.DEBUG
            if logger.isEnabledFor(level):
                message = printable(str(error), _MAX_DESCRIPTION)
                logger.log(level, "%s: %s", function.name, message, extra={"kind": function.name})
            return self._failure(error.code, error.detail)
        logger.error("%s: the device raised an exception", function.name, exc_info=error, extra={"kind": function.name})
        code = hresult.E_OUTOFMEMORY if isinstance(error, MemoryError) else hresult.E_FAIL
        return self._failure(code, cut("".join(format_exception_only(error)).strip(), _MAX_DESCRIPTION))

    def _failure(self, code: int, detail: str) -> CallReply:
        """Return the reply to a failed call, and store the description of the error."""
        self._reasons.pop(code, None)
        self._reasons[code] = detail
        if len(self._reasons) > _MAX_DESCRIPTIONS:
            del self._reasons[next(iter(self._reasons))]
        return CallReply(code, detail=detail)
