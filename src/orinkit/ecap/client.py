"""The client side of an e-CAP conversation, without I/O.

:meth:`EcapConversation.call` is a generator like :meth:`orinkit.bcap.client.BcapConversation.call`: it yields the body
of a request. The caller posts this body, and passes the body of the reply to the generator. Line feeds before a reply
mean that the call is still executing, as S_EXECUTING does in b-CAP. Requests are never repeated.
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
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.ecap.fields import UTF_8
from orinkit.ecap.message import read_detail, read_reply, reply_error, write_request
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Variant, VarType

Operation: TypeAlias = Generator[tuple[bytes, float | None], bytes | None, tuple[int, Any]]

HTTP: Final = TransportProfile("http", session_timeout=60.0, uses_watchdog=False)
"""Transport profile of e-CAP.

A server ends a session after a configurable idle time; the default of orinkit is 60 s.
"""

_FAILED: Final = 0x8000_0000
_STOP_TIMEOUT: Final = 1.0  # s


class EcapConversation:
    """The client side of a conversation: creates requests and interprets replies, one call at a time.

    Args:
        limits: limits on the size of a request and of a reply, and on the values in a reply.
        trace: callback invoked with ``">"`` and the body of each request, and with ``"<"`` and the body of each reply.
        profile: the transport profile.
        dialect: dialect of the controller; may be set later, when it is known.
        clock: callback that returns the time in s; required for deadlines and for the detection of too many line feeds.
        charset: encoding of the text: ``"utf-8"`` or ``"shift_jis"``.

    Attributes:
        stray_replies: always 0, because a reply arrives on the connection of its request.
        echoes_reserved: always False, because e-CAP has no reserved field.
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
        charset: str = UTF_8,
    ) -> None:
        self._clock = clock
        self._charset = charset
        self.trace = trace
        self.profile = profile
        self.dialect = dialect
        self.serial = 1
        self._limits = limits
        self._stopped = True  # closing requires no Service_Stop: it has been sent, or no request has been sent

    # Also in bcap.client: clients call the two kinds of conversation with the same arguments.
    def call(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        *,
        exact: bool = False,
        tries: int = 1,
        retry_timeout: float = 0.0,
        deadline: float | None = None,
    ) -> Operation:
        """Return a generator that calls a function; the module's docstring describes it.

        Args:
            function: an entry of the table of functions.
            arguments: the result of :meth:`~orinkit.cao.table.Function.bind`.
            seconds: time-out, s; every line feed from the server restarts it.
            exact: True to return the result as a :class:`~orinkit.values.variant.Variant`.
            tries: ignored; only b-CAP over UDP and serial lines uses it.
            retry_timeout: ignored; only b-CAP over UDP and serial lines uses it.
            deadline: limit on the duration of the call, s, regardless of line feeds; ``None`` for no limit.

        Raises:
            InvalidValue: If an argument does not fit its type, or the request exceeds the limits; nothing has been
                sent.
            CallTimeout: If no reply was received in time. A later reply is dropped.
            ConnectionLost: If the peer has closed the connection.
            ProtocolError: If the received data is not e-CAP, if the type of the result is wrong, or if there are too
                many line feeds.
            CallError: If the controller has returned an error code.
        """
        request = write_request(function, arguments, self._charset)
        if len(request) > self._limits.packet:
            raise _too_long(function, len(request), self._limits)
        self._trace(">", request)
        self._stopped = False
        timer = CallTimer(function.name, deadline, self._clock)
        received = yield request, timer.bound(seconds)
        while received and not received.strip():
            timer.count_other(1, executing=True)
            received = yield b"", timer.bound(seconds)
        if not received:
            expired = timer.timeout_error() if received is None else None
            raise expired or no_answer(function, received, seconds)
        self._trace("<", received)
        code, result = read_reply(received, self._limits, self._charset)
        if code >= _FAILED:
            raise reply_error(code, read_detail(received), function.name, arguments)
        self._stopped = function is service_stop
        if function.result is None:
            return code, None
        if result is None:  # VT_EMPTY is omitted from the body
            result = Variant(VarType.EMPTY)
        return code, checked(function, result if exact else result.plain, exact=exact)

    def close_sequence(self) -> list[tuple[bytes, float]]:
        """Return the requests to send before the client disconnects, each with its time-out in s.

        The list is empty if no Service_Stop is necessary.
        """
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
