"""How calls travel, as far as it matters to the objects of a client, whatever the protocol is."""

from __future__ import annotations

from dataclasses import dataclass

from orinkit.values.codec import DEFAULT_LIMITS


@dataclass(frozen=True, slots=True)
class TransportProfile:
    """One way for calls to travel.

    Attributes:
        name: ``"tcp"``, ``"udp"``, ``"serial"`` or ``"http"``.
        lossy: packets may be lost.
        shared: one client follows the other on the same line, and the end of one can only be told by the other's beginning.
        memory: seconds of silence after which a controller forgets a client; 0 where a connection tells of its end.
        watched: a client asks for S_EXECUTING (``WDT=``) to know that the controller is at work; elsewhere the answer to a
            repeated request, or the connection itself, tells.
        packet: longest packet in bytes. UDP: 488 bytes and what is around them (RC8 table 5-1).
        timeout: seconds that a client waits for the answer, to each try where there are several.
    """

    name: str
    lossy: bool = False
    shared: bool = False
    memory: float = 0.0
    watched: bool = True
    packet: int = DEFAULT_LIMITS.packet
    timeout: float = 3.0
