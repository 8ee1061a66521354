"""The packets of requests, encoded by the types of the function table. No I/O."""

from __future__ import annotations

from collections.abc import Callable
from operator import call as _apply
from typing import Any, Final

from orinkit.bcap import packet
from orinkit.bcap.direct import RequestTemplate
from orinkit.cao.table import Argument, Function
from orinkit.cao.user_functions import MOST_ARGUMENTS, is_user_function
from orinkit.core.errors import InvalidValue
from orinkit.core.speedups import EXTENSION, replaced_in_c
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.variant import VarType, variant

_HEADER: Final = packet.HEADER.pack
_SOH: Final = packet.SOH
_EOT: Final = bytes([packet.EOT])
_OVERHEAD: Final = packet.OVERHEAD
_VT_ERROR_SIZE: Final = DEFAULT_LIMITS.vt_error_size
# Controller_Execute and Robot_Execute are the most frequent calls: their arguments are encoded without a loop.
_EXECUTE_ARGUMENTS: Final = 3


@replaced_in_c
def encode_request(
    function: Function[..., Any],
    arguments: tuple[Any, ...],
    serial: int,
    reserved: int = 0,
    *,
    crc: bool = False,
    vt_error_size: int = _VT_ERROR_SIZE,
) -> bytes:
    """Return the packet of a call.

    Args:
        function: an entry of the table of functions.
        arguments: the result of :meth:`~orinkit.cao.table.Function.bind`.
        serial: serial of this attempt.
        reserved: serial of the first attempt; 0 over TCP, because there is only one attempt.
        crc: True to add a CRC, for a serial line.
        vt_error_size: size of a VT_ERROR, bytes.

    Raises:
        InvalidValue: If an argument does not fit its type; the message names the function and the argument.
    """
    encoders = _ENCODERS.get(function.id) or _make_encoders(function)
    if vt_error_size != _VT_ERROR_SIZE:
        encoders = tuple(_sized(each, vt_error_size) for each in encoders)
    try:
        if len(arguments) == len(encoders) == _EXECUTE_ARGUMENTS:
            first, second, third = encoders
            handle, command, parameter = arguments
            body = first(handle) + second(command) + third(parameter)
        else:
            body = b"".join(map(_apply, encoders, arguments))  # map() stops at the first omitted optional argument
    except (InvalidValue, TypeError) as error:
        raise _argument_error(function, arguments, error) from None
    if crc:
        return packet.pack(serial, function.id, len(arguments), body, reserved, crc=True)
    head = _HEADER(_SOH, len(body) + _OVERHEAD, serial, reserved, function.id, len(arguments))
    return head + body + _EOT


_BY_TYPE: Final[dict[VarType, Callable[[Any], bytes]]] = {
    VarType.I4: codec.encode_integer,
    VarType.R4: codec.encode_single,
    VarType.BSTR: codec.encode_string,
    VarType.VARIANT: codec.encode,
}
_ENCODERS: Final[dict[int, tuple[Callable[[Any], bytes], ...]]] = {}
_ARGUMENT_TYPES: Final[dict[int, bytes]] = {}  # for the counterpart in C: one byte per argument
if EXTENSION is not None:
    EXTENSION.set_requests(_ARGUMENT_TYPES)


def _make_encoders(function: Function[..., Any]) -> tuple[Callable[[Any], bytes], ...]:
    if is_user_function(function.id):  # calls of the same function may have different numbers of arguments
        encoders: tuple[Callable[[Any], bytes], ...] = (codec.encode,) * MOST_ARGUMENTS
        types = bytes((VarType.VARIANT,)) * MOST_ARGUMENTS
    else:
        encoders = tuple(map(_encoder, function.arguments))
        types = bytes(each.vt for each in function.arguments)
    _ENCODERS[function.id] = encoders
    _ARGUMENT_TYPES[function.id] = types
    return encoders


def _encoder(argument: Argument) -> Callable[[Any], bytes]:
    return codec.encode_handle if argument.is_handle else _BY_TYPE[argument.vt]


def _sized(encoder: Callable[[Any], bytes], vt_error_size: int) -> Callable[[Any], bytes]:
    """Return ``encoder``, adapted to the size of a VT_ERROR; only the encoder of VARIANTs depends on this size."""
    if encoder is not codec.encode:
        return encoder
    return lambda value: codec.encode_variant(variant(value), vt_error_size)


def _argument_error(function: Function[..., Any], arguments: tuple[Any, ...], error: Exception) -> InvalidValue:
    """Return an exception that names the invalid argument."""
    for number, (argument, value) in enumerate(zip(function.arguments, arguments, strict=False), 1):
        try:
            _BY_TYPE[argument.vt](value)
        except (InvalidValue, TypeError) as reason:
            return InvalidValue(function.where(number) + str(reason))
    return InvalidValue(f"{function.name}: {error}")


def request_template(function: Function[..., Any], constants: tuple[Any, ...], most: int) -> RequestTemplate | None:
    """Return the template of a call whose arguments are constant, except for a last one of type VARIANT.

    Args:
        function: an entry of the table of functions.
        constants: all arguments, or all but the last one. For other functions, or if an argument is invalid, the
            result is ``None``.
        most: largest size of a packet, bytes.
    """
    varies = len(function.arguments) == len(constants) + 1
    if varies and function.arguments[-1].vt is not VarType.VARIANT:
        return None
    encoders = _ENCODERS.get(function.id) or _make_encoders(function)
    try:
        body = b"".join(map(_apply, encoders, constants))
    except (InvalidValue, TypeError):  # the call itself reports the error
        return None
    return RequestTemplate(function, len(constants) + varies, body, varies=varies, most=most)
