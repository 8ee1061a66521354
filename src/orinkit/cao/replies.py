"""What a client makes of an answer, or of none, whatever the protocol is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias

from orinkit.cao.table import Function
from orinkit.core.errors import CallTimeout, ConnectionLost, ProtocolError
from orinkit.core.i18n import tr
from orinkit.values.variant import Variant, VarType

Trace: TypeAlias = Callable[[str, bytes], None]
"""Is told every packet, or body: ``">"`` and a request, ``"<"`` and what came back."""

_RESULT_TYPES: Final[dict[VarType | None, type]] = {VarType.I4: int, VarType.BSTR: str}


class Reply(NamedTuple):
    """A successful answer.

    Attributes:
        code: the return code; 0, or another success code such as S_BUF_FULL.
        value: the result, ``None`` for a function without one.
    """

    code: int
    value: Any


def no_answer(function: Function[..., Any], received: bytes | None, seconds: float) -> CallTimeout | ConnectionLost:
    """Return the exception for a call that was not answered.

    Args:
        function: that was called.
        received: ``None`` where the time is up, ``b""`` where the other side has closed.
        seconds: time-out of the call.
    """
    if received is None:
        return CallTimeout(function.name, seconds)
    return ConnectionLost(tr("{name}: the other side closed the connection before it answered", name=function.name))


def checked(function: Function[..., Any], value: Any, *, exact: bool) -> Any:
    """Return the result of a function that has one.

    Args:
        function: that was called.
        value: what came: plain, or a :class:`~orinkit.values.variant.Variant` where it is to be exact.
        exact: give it as it came.

    Raises:
        ProtocolError: it is not what the function returns.
    """
    if function.result is VarType.VARIANT:
        return value
    plain = value.value if exact else value
    expected = _RESULT_TYPES[function.result]
    if plain is None and expected is str:  # an empty string may come as VT_EMPTY
        return Variant(VarType.BSTR, "") if exact else ""
    if type(plain) is not expected:
        raise _wrong_result(function, repr(plain))
    return value


def _wrong_result(function: Function[..., Any], got: str) -> ProtocolError:
    wanted = function.result.name if function.result else ""
    return ProtocolError(
        tr("{name} was answered with {got:.80}, VT_{wanted} was expected", name=function.name, got=got, wanted=wanted)
    )
