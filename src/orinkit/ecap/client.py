"""The client side of an e-CAP conversation, without I/O.

:meth:`EcapConversation.call` is a generator like that of :class:`orinkit.bcap.client.BcapConversation`: it yields the body
of a request, and the caller sends back the body of the reply. Line feeds before a reply mean that the call is still
executing, as S_EXECUTING does in b-CAP. Requests are never repeated.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, Final, TypeAlias

from orinkit.cao.call_limits import CallTimer, Clock, no_clock
from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.functions import service_stop
from orinkit.cao.replies import Trace, checked, no_answer
from orinkit.cao.table import Function
from orinkit.cao.transport_profile import TransportProfile
from orinkit.core.errors import InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.ecap.message import read_detail, read_reply, write_request
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Variant, VarType

Operation: TypeAlias = Generator[tuple[bytes, float | None], bytes | None, tuple[int, Any]]

HTTP: Final = TransportProfile("http", memory=60.0, watched=False)
"""e-CAP over HTTP. A server ends a session after a configurable period of silence; the default of orinkit is 60 s."""

_FAILED: Final = 0x8000_0000
_STOP_TIMEOUT: Final = 1.0  # s


class EcapConversation:
    """Requests and replies of one client, one at a time.

    Args:
        limits: bounds on a request and on a reply.
        trace: callback invoked with every body: ``">"`` and a request, ``"<"`` and a reply.
        profile: the transport profile.
        dialect: dialect of the controller; may be set later, when it is known.
        clock: returns the time, s; for deadlines and the detection of floods.

    Attributes:
        stray_replies: always 0: a reply is received over the connection of its request.
        echoes_reserved: always False: there is no reserved field.
        serial: unused.
    """

    stray_replies = 0
    echoes_reserved = False

    def __init__(
        self,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        profile: TransportProfile = HTTP,
        dialect: Dialect = RC8,
        clock: Clock = no_clock,
    ) -> None:
        self._clock = clock
        self.trace = trace
        self.profile = profile
        self.dialect = dialect
        self.serial = 1
        self._limits = limits
        self._stopped = True  # no Service_Stop is necessary: one has been sent, or no request at all

    def call(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        *,
        exact: bool = False,
        tries: int = 1,  # noqa: ARG002 - the transport is reliable
        retry_timeout: float = 0.0,  # noqa: ARG002
        deadline: float | None = None,
    ) -> Operation:
        # Also in bcap.client: clients call the two kinds of conversation with the same arguments.
        """Call a function; return a generator, see the module's docstring.

        Args:
            function: an entry of the table.
            arguments: the result of :meth:`~orinkit.cao.table.Function.bind`.
            seconds: time-out, s; every line feed from the server restarts it.
            exact: return the result as a :class:`~orinkit.values.variant.Variant`.
            tries: ignored; for unreliable transports of b-CAP.
            retry_timeout: ignored; for unreliable transports of b-CAP.
            deadline: limit on the duration of the call, s, regardless of line feeds; ``None`` for no limit.

        Raises:
            InvalidValue: If an argument does not fit its type; nothing has been sent.
            CallTimeout: If no reply was received in time. A later reply is dropped.
            ConnectionLost: If the peer has closed the connection.
            ProtocolError: If the received data is not e-CAP or not what the function returns, or if there are too many line
                feeds.
            CallError: If the controller has returned an error code.
        """
        request = write_request(function, arguments)
        if len(request) > self._limits.packet:
            raise _too_long(function, len(request), self._limits)
        self._trace(">", request)
        self._stopped = False
        patience = CallTimer(function.name, deadline, self._clock)
        received = yield request, patience.bound(seconds)
        while received and not received.strip():
            patience.count_other(1, executing=True)
            received = yield b"", patience.bound(seconds)
        if not received:
            expired = patience.end() if received is None else None
            raise expired or no_answer(function, received, seconds)
        self._trace("<", received)
        code, result = read_reply(received, self._limits)
        if code >= _FAILED:
            raise error_for(code, read_detail(received), function.name, arguments)
        self._stopped = function is service_stop
        if function.result is None:
            return code, None
        if result is None:  # VT_EMPTY is omitted from the body
            result = Variant(VarType.EMPTY)
        return code, checked(function, result if exact else result.plain, exact=exact)

    def close_sequence(self) -> list[tuple[bytes, float]]:
        """Return the requests to send before a client without a Service_Stop disconnects, with the time to wait for each, s."""
        if self._stopped:
            return []
        self._stopped = True
        request = write_request(service_stop, ())
        self._trace(">", request)
        return [(request, _STOP_TIMEOUT)]

    def _trace(self, mark: str, body: bytes) -> None:
        if self.trace is not None:
            self.trace(mark, body)


def _too_long(function: Function[..., Any], length: int, limits: PacketLimits) -> InvalidValue:
    return InvalidValue(
        tr(
            "{name}: the request of {length} bytes exceeds the limit of {most} bytes",
            name=function.name,
            length=length,
            most=limits.packet,
        )
    )
