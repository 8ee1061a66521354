"""Transport profiles: the properties of a transport that matter to clients, independent of the protocol."""

from __future__ import annotations

from orinkit.core.record import record
from orinkit.values.codec import DEFAULT_LIMITS


@record
class TransportProfile:
    """Properties of a transport.

    Attributes:
        name: ``"tcp"``, ``"udp"``, ``"serial"`` or ``"http"``.
        lossy: whether packets may be lost.
        shared: whether successive clients use the same line. The end of one client is then detected only when the next
            one begins.
        session_timeout: seconds of silence after which a controller ends a session; 0 if it detects the end of the connection.
        uses_watchdog: whether a client requests S_EXECUTING (``WDT=``) to monitor a long-running call; otherwise the
            connection itself shows that the call is executing.
        packet: limit on the size of a packet, bytes.
        timeout: seconds that a client waits for a reply to each attempt.
    """

    name: str
    lossy: bool = False
    shared: bool = False
    session_timeout: float = 0.0
    uses_watchdog: bool = True
    packet: int = DEFAULT_LIMITS.packet
    timeout: float = 3.0
