"""The server's object for a b-CAP client on a transport without connections: UDP, and serial lines."""

from __future__ import annotations

from orinkit.bcap.actions import Encoded, Execute
from orinkit.cao.session import Session
from orinkit.server.peer import Peer
from orinkit.values.variant import Variant


class ConnectionlessClient(Peer):
    """A client without a connection: its session begins with its first call and ends with Service_Stop."""

    def _new_session(self) -> Session | None:
        return self._admit()

    def _deliver(self, call: Execute, code: int, result: Variant | Encoded | None) -> None:
        data = self._conversation.finish(call, code, result)
        if self._conversation.stopped:
            self._end_session()
        if data:
            self._send(data)
