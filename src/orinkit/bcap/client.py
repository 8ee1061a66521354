"""The client's side of a b-CAP conversation over a stream, without I/O.

:meth:`Conversation.call` is a generator. It yields ``(data, seconds)``: send these bytes (if any), then wait for bytes
until that many seconds have passed; ``None`` for the seconds means that the wait in force goes on. What comes back from
the ``yield`` are the bytes received, ``b""`` when the other side has closed, ``None`` when the time is up. It returns
the :class:`Reply`. The two drivers in :mod:`orinkit.transport` do the waiting.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator
from typing import Any, Final, NamedTuple, TypeAlias

from orinkit import hresult, variant_bytes
from orinkit.bcap import packet
from orinkit.cao.table import Argument, Function
from orinkit.errors import CallTimeout, ConnectionLost, InvalidValue, ProtocolError, error_for
from orinkit.language import pick
from orinkit.variant import Variant, VarType, misfit
from orinkit.variant_bytes import DEFAULT_LIMITS, Limits

Exchange: TypeAlias = tuple[bytes, float | None]
Operation: TypeAlias = Generator[Exchange, bytes | None, "Reply"]
Trace: TypeAlias = Callable[[str, bytes], None]
"""Is told every packet: ``">"`` and a request, or ``"<"`` and what came back."""


class Reply(NamedTuple):
    """A successful answer.

    Attributes:
        code: the return code; 0, or another success code such as S_BUF_FULL.
        value: the result, ``None`` for a function without one.
    """

    code: int
    value: Any


_SERIAL_AND_CODE: Final = struct.Struct("<HHIH")  # serial, reserved, code, argument count: at offset 5
_I4: Final = struct.Struct("<IHIi").pack
_R4: Final = struct.Struct("<IHIf").pack
_FAILED: Final = 0x8000_0000


class Conversation:
    """One client's requests and replies over one link, one at a time.

    Attributes:
        dropped: replies that answered no waiting call: late, repeated, or foreign.
        trace: if set, is told every packet.
    """

    def __init__(self, limits: Limits = DEFAULT_LIMITS, trace: Trace | None = None) -> None:
        self.dropped = 0
        self.trace = trace
        self._limits = limits
        self._framer = packet.Framer(limits)
        self._serial = 1

    @property
    def skipped(self) -> int:
        """Bytes received outside any packet."""
        return self._framer.skipped

    def call(
        self, function: Function[..., Any], arguments: tuple[Any, ...], seconds: float, *, exact: bool = False
    ) -> Operation:
        """Call a function; a generator, see the module's docstring.

        Args:
            function: an entry of the table.
            arguments: as :meth:`~orinkit.cao.table.Function.bind` gives them.
            seconds: time-out; every S_EXECUTING from the controller starts it anew.
            exact: give the result as a :class:`~orinkit.variant.Variant`.

        Raises:
            InvalidValue: an argument does not fit; nothing was sent.
            CallTimeout: no answer in time. An answer that comes later is dropped, it never answers another call.
            ConnectionLost: the other side closed.
            ProtocolError: what came is not b-CAP, or not what the function returns.
            CallError: the controller answered with an error code.
        """
        serial = self._serial
        self._serial = serial % 0xFFFF + 1
        request = encode_request(function, arguments, serial)
        if self.trace:
            self.trace(">", request)
        received = yield request, seconds
        framer = self._framer
        while True:
            if not received:
                if received is None:
                    raise CallTimeout(function.name, seconds)
                raise ConnectionLost(
                    pick(
                        f"{function.name}: the other side closed the connection before it answered",
                        f"{function.name}: 応答の前に相手が接続を閉じました",
                    )
                )
            wait: float | None = None
            frame = framer.take(received)
            while frame is not None:
                if self.trace:
                    self.trace("<", frame)
                answered, _, code, count = _SERIAL_AND_CODE.unpack_from(frame, 5)
                if answered != serial:
                    self.dropped += 1
                elif code == hresult.S_EXECUTING:
                    wait = seconds
                elif code >= _FAILED:
                    raise error_for(code, "", function.name, arguments)
                else:
                    return Reply(code, self._result(function, frame, count, exact=exact))
                frame = framer.next_frame()
            received = yield b"", wait

    def _result(self, function: Function[..., Any], frame: bytes, count: int, *, exact: bool) -> Any:
        if not count or function.result is None:
            if function.creates:
                raise _wrong_result(function, "nothing")
            return Variant(VarType.EMPTY) if exact and function.result else None
        value, _ = variant_bytes.decode(frame, packet.HEADER.size, len(frame) - 1, self._limits, exact=exact)
        expected = _RESULT_TYPES.get(function.result)
        if expected is not None and type(value.value if exact else value) is not expected:
            if function.result is VarType.BSTR and (value.value if exact else value) is None:
                return Variant(VarType.BSTR, "") if exact else ""
            raise _wrong_result(function, repr(value))
        return value


_RESULT_TYPES: Final[dict[VarType, type]] = {VarType.I4: int, VarType.BSTR: str}


def _wrong_result(function: Function[..., Any], got: str) -> ProtocolError:
    wanted = function.result.name if function.result else ""
    return ProtocolError(
        pick(
            f"{function.name} was answered with {got:.80}, VT_{wanted} was expected",
            f"{function.name} の応答が VT_{wanted} ではなく {got:.80} です",
        )
    )


def encode_request(function: Function[..., Any], arguments: tuple[Any, ...], serial: int, reserved: int = 0) -> bytes:
    """Return the packet of a call.

    Raises:
        InvalidValue: an argument does not fit its type; the message names function and argument.
    """
    encoders = _ENCODERS.get(function.id) or _learn(function)
    try:
        body = b"".join([encode(value) for encode, value in zip(encoders, arguments)])  # noqa: B905 - optional ones may be missing
    except (InvalidValue, struct.error) as error:
        raise _explain(function, arguments, error) from None
    head = packet.HEADER.pack(packet.SOH, len(body) + packet.OVERHEAD, serial, reserved, function.id, len(arguments))
    return b"%b%b\x04" % (head, body)


def _encode_i4(value: int) -> bytes:
    return _I4(10, VarType.I4, 1, value)


def _encode_r4(value: float) -> bytes:
    try:
        return _R4(10, VarType.R4, 1, value)
    except OverflowError:
        raise misfit(VarType.R4, value) from None


def _encode_bstr(value: str) -> bytes:
    if not isinstance(value, str):
        raise misfit(VarType.BSTR, value)
    return variant_bytes.encode(value)


_BY_TYPE: Final[dict[VarType, Callable[[Any], bytes]]] = {
    VarType.I4: _encode_i4,
    VarType.R4: _encode_r4,
    VarType.BSTR: _encode_bstr,
    VarType.VARIANT: variant_bytes.encode,
}
_ENCODERS: Final[dict[int, tuple[Callable[[Any], bytes], ...]]] = {}


def _learn(function: Function[..., Any]) -> tuple[Callable[[Any], bytes], ...]:
    encoders = _ENCODERS[function.id] = tuple(_BY_TYPE[argument.vt] for argument in function.arguments)
    return encoders


def _explain(function: Function[..., Any], arguments: tuple[Any, ...], error: Exception) -> InvalidValue:
    """Say which argument was wrong; only when one was."""
    for number, (argument, value) in enumerate(zip(function.arguments, arguments, strict=False), 1):
        try:
            _BY_TYPE[argument.vt](value)
        except InvalidValue as reason:
            return InvalidValue(_where(function, number, argument) + str(reason))
        except struct.error:
            return InvalidValue(_where(function, number, argument) + str(misfit(argument.vt, value)))
    return InvalidValue(f"{function.name}: {error}")


def _where(function: Function[..., Any], number: int, argument: Argument) -> str:
    return pick(
        f"{function.name}, argument {number} ({argument.name}): ",
        f"{function.name} の第 {number} 引数 ({argument.name}): ",
    )
