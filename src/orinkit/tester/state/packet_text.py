"""Packets as text, to copy and to save: hex, Python, C, and a readable transcript."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from math import isfinite
from typing import Any, Final

from orinkit.bcap import packet as bcap
from orinkit.bcap.requests import encode_request
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Argument, Function, snake_case
from orinkit.core.errors import CallError, InvalidValue, OrinError
from orinkit.core.i18n import tr
from orinkit.tester.state.packet_detail import PER_ROW
from orinkit.tester.state.packet_facts import is_binary
from orinkit.tester.state.packet_log import LoggedPacket
from orinkit.values import codec
from orinkit.values.types import ARRAY, VarType
from orinkit.values.variant import Variant

LONGEST_COPY: Final = 64 * 1024
"""Largest packet that can be copied, bytes."""


def _check(packet: LoggedPacket) -> None:
    if len(packet.data) > LONGEST_COPY:
        size, most = f"{len(packet.data):,}", f"{LONGEST_COPY:,}"
        raise InvalidValue(
            tr("the packet has {size} bytes; at most {most} can be copied. Try: save as pcapng", size=size, most=most)
        )


def as_hex(packet: LoggedPacket) -> str:
    """Return a packet in hex, 16 bytes per line.

    Raises:
        InvalidValue: If the packet is larger than :data:`LONGEST_COPY`.
    """
    _check(packet)
    return "\n".join(hex_rows(packet.data))


def hex_rows(data: bytes) -> Iterator[str]:
    """Yield bytes in hex, 16 at a time."""
    for at in range(0, len(data), PER_ROW):
        yield data[at : at + PER_ROW].hex(" ")


def as_bytes_literal(packet: LoggedPacket) -> str:
    """Return a packet as a Python expression of bytes.

    Raises:
        InvalidValue: If the packet is larger than :data:`LONGEST_COPY`.
    """
    _check(packet)
    if not is_binary(packet):
        return repr(packet.data)
    rows = list(hex_rows(packet.data))
    if len(rows) == 1:
        return f'bytes.fromhex("{rows[0]}")'
    return "bytes.fromhex(\n" + "\n".join(f'    "{row}"' for row in rows) + "\n)"


def as_c_array(packet: LoggedPacket) -> str:
    """Return a packet as an array in C.

    Raises:
        InvalidValue: If the packet is larger than :data:`LONGEST_COPY`.
    """
    _check(packet)
    rows = (", ".join(f"0x{byte:02x}" for byte in bytes.fromhex(row)) for row in hex_rows(packet.data))
    return f"static const unsigned char packet[{len(packet.data)}] = {{\n    " + ",\n    ".join(rows) + "\n};"


def as_call(packet: LoggedPacket) -> str:
    """Return the call that produces a request: ``client.call(functions.variable_put_value, 3, 42)``.

    The client encodes the arguments of this call to the same bytes; only the serial may differ.

    Args:
        packet: A request. For a reply, pass its request.

    Raises:
        InvalidValue: If the packet is not a request, is larger than :data:`LONGEST_COPY`, or no call produces it.
    """
    _check(packet)
    function, arguments = _request(packet)
    chosen = tuple(map(_argument, function.arguments, arguments))
    if len(arguments) > len(function.arguments) or not _encodes_alike(function, chosen, arguments):
        raise InvalidValue(tr("no call of {name} produces these bytes. Try: copy the bytes", name=function.name))
    words = [f"functions.{snake_case(function.name)}", *map(_expression, chosen)]
    return f"client.call({', '.join(words)})"


def _request(packet: LoggedPacket) -> tuple[Function[..., Any], list[Variant]]:
    try:
        if not is_binary(packet):
            from orinkit.ecap.message import read_request

            request = read_request(packet.data)
            return request.function, list(request.arguments)
        crc = packet.scheme == "serial"
        decoded = bcap.decode(packet.data, exact=True, crc=crc)
    except (OrinError, CallError) as error:
        raise InvalidValue(f"{error}") from None
    if decoded.code not in FUNCTIONS:
        raise InvalidValue(tr("{code} is not the id of a function. Try: copy the bytes", code=decoded.code))
    return FUNCTIONS[decoded.code], decoded.arguments


def _argument(argument: Argument, value: Variant) -> Any:
    """Return an argument as plain Python, or with its exact type if a client would infer another one."""
    try:
        alike = argument.vt != VarType.VARIANT or codec.encode(value.plain) == codec.encode(value)
    except OrinError:
        alike = False
    return value.plain if alike else value


def _encodes_alike(function: Function[..., Any], values: tuple[Any, ...], arguments: list[Variant]) -> bool:
    try:
        made = encode_request(function, function.bind(values, {}), 1)
        body = bcap.encode(bcap.Packet(1, function.id, list(arguments)))
    except (OrinError, TypeError):
        return False
    return made == body


def _expression(value: Any) -> str:
    if isinstance(value, Variant):
        kind = VarType(value.type & ~ARRAY)
        word = f"VarType.ARRAY | VarType.{kind.name}" if value.type & ARRAY else f"VarType.{kind.name}"
        return f"Variant({word})" if value.value is None else f"Variant({word}, {_expression(value.value)})"
    if isinstance(value, list):
        return f"[{', '.join(map(_expression, value))}]"
    if isinstance(value, float) and not isfinite(value):
        return f'float("{value}")'
    if isinstance(value, datetime):
        return repr(value).removeprefix("datetime.")
    return repr(value)


def time_text(time_ns: int) -> str:
    """Return the local time of day with ms."""
    return f"{datetime.fromtimestamp(time_ns // 1_000_000_000):%H:%M:%S}.{time_ns // 1_000_000 % 1000:03}"


def transcript(packet: LoggedPacket, meaning: str) -> Iterator[str]:
    """Yield the lines of a packet in a saved text: number, time, connection, direction, size, meaning, bytes in hex."""
    day = f"{datetime.fromtimestamp(packet.time_ns // 1_000_000_000):%Y-%m-%d}"
    yield (
        f"#{packet.number} {day} {time_text(packet.time_ns)} {packet.connection} {packet.direction} "
        f"{len(packet.data)} {meaning}"
    )  # fmt: skip
    if is_binary(packet):
        yield from (f"    {row}" for row in hex_rows(packet.data))
    else:
        text = packet.data.decode("utf-8", "backslashreplace")
        yield from (f"    {text[at : at + 100]}" for at in range(0, len(text), 100))
    yield ""
