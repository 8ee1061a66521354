"""Handling of replies in clients, common to all protocols: results, and calls without a reply."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias

from orinkit.cao.table import Function
from orinkit.core.errors import CallTimeout, ConnectionLost, ProtocolError
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType

Trace: TypeAlias = Callable[[str, bytes], None]
"""Callback invoked for every packet or HTTP body, with ``">"`` and a request, or with ``"<"`` and a reply."""

_RESULT_TYPES: Final[dict[VarType | None, type]] = {VarType.I4: int, VarType.BSTR: str}


class Reply(NamedTuple):
    """A successful reply.

    Attributes:
        code: the return code: 0, or another success code such as S_BUF_FULL.
        value: the result, ``None`` for a function without one.
    """

    code: int
    value: Any


def no_answer(function: Function[..., Any], received: bytes | None, seconds: float) -> CallTimeout | ConnectionLost:
    """Return the exception for a call without a reply.

    Args:
        function: the function called.
        received: ``None`` after a time-out, ``b""`` if the peer has closed the connection.
        seconds: time-out of the call, s.
    """
    if received is None:
        return CallTimeout(function.name, seconds)
    return ConnectionLost(tr("{name}: the peer closed the connection before a reply was received", name=function.name))


def checked(function: Function[..., Any], value: Any, *, exact: bool) -> Any:
    """Return the result of a function after checking its type.

    Args:
        function: the function called; it has a result.
        value: the received value: plain, or a :class:`~orinkit.values.variant.Variant` if ``exact``.
        exact: whether the value is a :class:`~orinkit.values.variant.Variant`.

    Raises:
        ProtocolError: If the type is not that of the function's result.
    """
    if function.result is VarType.VARIANT:
        return value
    plain = value.value if exact else value
    expected = _RESULT_TYPES[function.result]
    if plain is None and expected is str:  # a controller may send an empty string as VT_EMPTY
        return Variant(VarType.BSTR, "") if exact else ""
    if type(plain) is not expected:
        raise _wrong_result(function, repr(plain))
    return value


def _wrong_result(function: Function[..., Any], got: str) -> ProtocolError:
    wanted = function.result.name if function.result else ""
    return ProtocolError(
        tr("{name} returned {got:.80}, expected VT_{wanted}", name=function.name, got=got, wanted=wanted)
    )
