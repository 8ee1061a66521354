"""The rows of a list of packets: :func:`row_of`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.core.i18n import N_, tr
from orinkit.tester.state.packet_facts import facts_of
from orinkit.tester.state.packet_log import LoggedPacket
from orinkit.tester.state.packet_text import time_text

TIME_MODES: Final = {
    "time": N_("Time of day"),
    "relative": N_("Since the start"),
    "delta": N_("Since the packet before"),
}


def row_of(
    packet: LoggedPacket,
    previous: LoggedPacket | None,
    mode: str,
    start_ns: int,
    summary: Callable[[LoggedPacket], str],
) -> list[Any]:
    """Return a packet as a row: number, time, connection, direction, size, summary, CSS class, marks.

    Args:
        packet: The packet.
        previous: The packet in the row above, if there is one.
        mode: A key of :data:`TIME_MODES`.
        start_ns: Time to which relative times refer, in ns since 1970.
        summary: Function that returns the summary of a packet.
    """
    facts = facts_of(packet)
    marks = [
        tr(text)
        for text, present in (
            (N_("malformed"), facts.malformed), (N_("error"), facts.failed), (N_("retry"), facts.retry),
            (N_("executing"), facts.executing),
        )
        if present
    ]  # fmt: skip
    kind = "bad" if facts.is_error else "warn" if marks else ""
    time = row_time(packet.time_ns, previous.time_ns if previous else None, mode, start_ns)
    return [
        packet.number, time, packet.connection, packet.direction, f"{len(packet.data):,}", summary(packet), kind, marks,
    ]  # fmt: skip


def row_time(time_ns: int, previous_ns: int | None, mode: str, start_ns: int) -> str:
    """Return the time of a packet: of day, or in s since the start or since the previous packet.

    Args:
        time_ns: Time of the packet, in ns since 1970.
        previous_ns: Time of the previous packet; ``None`` if there is none.
        mode: A key of :data:`TIME_MODES`.
        start_ns: Time to which relative times refer, in ns since 1970.
    """
    if mode == "relative":
        return f"{(time_ns - start_ns) / 1e9:.3f}"
    if mode == "delta":
        return f"+{(time_ns - previous_ns) / 1e9:.4f}" if previous_ns is not None else "+0.0000"
    return time_text(time_ns)
