"""Saving packets as text or pcapng, in pieces that do not block the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Final

from orinkit import __version__
from orinkit.bcap.pcapng import CaptureConnection, PcapngWriter
from orinkit.core.errors import InvalidValue
from orinkit.tester.state.connection import Connection
from orinkit.tester.state.entry_view import SLICE
from orinkit.tester.state.packet_facts import LONGEST_DECODED
from orinkit.tester.state.packet_log import LoggedPacket, PacketLog
from orinkit.tester.state.packet_text import transcript
from orinkit.transport.address import parse_address
from orinkit.transport.captured import LOCAL_PORT, connection_of

_PIECE: Final = 256 * 1024  # bytes of a piece
_PORT: Final = 5007
_LINES: Final = 64  # lines between two looks at the clock


async def _packets(log: PacketLog, numbers: Sequence[int]) -> AsyncIterator[LoggedPacket]:
    for number in numbers:
        packet = log.get(number)
        if packet is not None:
            yield packet


async def export_text(
    log: PacketLog, numbers: Sequence[int], summary: Callable[[LoggedPacket], str]
) -> AsyncIterator[bytes]:
    """Yield packets as text in UTF-8; packets that the log discards meanwhile are left out.

    Args:
        log: The log.
        numbers: The numbers of the packets.
        summary: Function that returns the summary of a packet.
    """
    stop, size, lines = perf_counter() + SLICE, 0, []
    for line in _text_lines(log, numbers, summary):
        lines.append(line)
        size += len(line)
        if len(lines) % _LINES == 0 and (size > _PIECE or perf_counter() > stop):
            yield ("\n".join(lines) + "\n").encode("utf-8", "replace")
            await asyncio.sleep(0)
            stop, size, lines = perf_counter() + SLICE, 0, []
    if lines:
        yield ("\n".join(lines) + "\n").encode("utf-8", "replace")


def _text_lines(log: PacketLog, numbers: Iterable[int], summary: Callable[[LoggedPacket], str]) -> Iterator[str]:
    for number in numbers:
        packet = log.get(number)
        if packet is not None:
            yield from transcript(packet, summary(packet))


async def export_pcapng(
    log: PacketLog, numbers: Sequence[int], places: Mapping[str, CaptureConnection]
) -> AsyncIterator[bytes]:
    """Yield packets as a pcapng file; packets that the log discards meanwhile are left out.

    Args:
        log: The log.
        numbers: The numbers of the packets.
        places: The connection under which the packets of each connection are written (:func:`capture_places`).
    """
    pieces: list[bytes] = []
    writer = PcapngWriter(pieces.append, f"orinkit {__version__}")
    stop, size = perf_counter() + SLICE, 0
    async for packet in _packets(log, numbers):
        place = places.get(packet.connection) or _placeholder(packet.scheme)
        if len(packet.data) > LONGEST_DECODED:
            await asyncio.to_thread(_write, writer, packet, place)
        else:
            _write(writer, packet, place)
        size += len(packet.data)
        if size > _PIECE or perf_counter() > stop:
            for piece in pieces:
                yield piece
            pieces.clear()
            await asyncio.sleep(0)
            stop, size = perf_counter() + SLICE, 0
    yield b"".join(pieces)


def _write(writer: PcapngWriter, packet: LoggedPacket, place: CaptureConnection) -> None:
    try:
        writer.packet(packet.time_ns, packet.direction, packet.data, connection=place)
    except InvalidValue:  # larger than a datagram; no controller sends this
        writer.packet(packet.time_ns, packet.direction, packet.data, connection=replace(place, transport="tcp"))


async def capture_places(connections: Iterable[Connection]) -> dict[str, CaptureConnection]:
    """Return the connections under which packets are written; names of hosts are resolved in threads."""
    places: dict[str, CaptureConnection] = {}
    for index, each in enumerate(connections):
        found = await asyncio.to_thread(connection_of, parse_address(each.spec.url))
        places[each.name] = replace(found, local=(found.local[0], LOCAL_PORT + index))
    return places


def _placeholder(scheme: str) -> CaptureConnection:
    """Return the connection for packets of a connection that the user has removed."""
    return CaptureConnection("udp" if scheme == "udp" else "tcp", ("192.0.2.1", LOCAL_PORT - 1), ("192.0.2.2", _PORT))
