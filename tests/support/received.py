"""Records the packets that the b-CAP servers of this process receive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.bcap.server import ServerConversation
from orinkit.cao.table import Function
from support.waiting import until


class ReceivedPackets:
    """The packets that were received, in order; ``raw`` are their bytes."""

    def __init__(self) -> None:
        self.raw: list[tuple[bytes, bool]] = []

    def of(self, function: Function[..., Any]) -> list[Packet]:
        """Return the packets that call a function, with exact types."""
        found = (packet.decode(data, exact=True, crc=crc) for data, crc in list(self.raw))
        return [each for each in found if each.code == function.id]

    def wait_for(self, function: Function[..., Any], count: int = 1) -> Packet:
        """Wait until a function has been called a number of times; return the last packet."""
        until(lambda: len(self.of(function)) >= count)
        return self.of(function)[-1]


@contextmanager
def received_packets() -> Iterator[ReceivedPackets]:
    """Record the packets that the framers of all conversations return, and those of the direct path."""
    recorded = ReceivedPackets()
    actions, take_directly = ServerConversation._actions, ServerConversation.take_directly

    def taken(self: ServerConversation, data: bytes, now: float) -> Any:
        call = take_directly(self, data, now)
        if call is not None:
            recorded.raw.append((bytes(data), self._profile.crc))
        return call

    def observed(self: ServerConversation, *sources: Callable[[], bytes | None]) -> Any:
        def noting(source: Callable[[], bytes | None]) -> Callable[[], bytes | None]:
            def read() -> bytes | None:
                frame = source()
                if frame:
                    recorded.raw.append((bytes(frame), self._profile.crc))
                return frame

            return read

        return actions(self, *map(noting, sources))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ServerConversation, "_actions", observed)
        patch.setattr(ServerConversation, "take_directly", taken)
        yield recorded
