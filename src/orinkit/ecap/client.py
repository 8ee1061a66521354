"""The client's side of an e-CAP conversation, without I/O.

:meth:`EcapConversation.call` is a generator as that of :class:`orinkit.bcap.client.BcapConversation`: what it yields to be sent is
the body of a request, what it is sent is the body of the reply. Line feeds ahead of a reply say that the server is at
work, as S_EXECUTING does in b-CAP. Nothing is ever sent twice.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, Final, TypeAlias

from orinkit.cao.call_limits import CallTimer, Clock, standing
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
"""e-CAP over HTTP. A server forgets a client after a silence that it is told; 60 s is what orinkit's own has by default."""

_FAILED: Final = 0x8000_0000
_FAREWELL: Final = 1.0  # s


class EcapConversation:
    """One client's requests and replies, one at a time.

    Args:
        limits: bounds on a reply, and on a request.
        trace: is told every body: ``">"`` and a request, ``"<"`` and a reply.
        profile: how calls travel.
        dialect: of the controller; may be set once it is known.
        clock: tells the time, for deadlines and floods.

    Attributes:
        stray_replies: always 0: a reply comes over the connection of its request.
        echoes_reserved: always False, as there is no reserved field.
        serial: of no meaning here.
    """

    stray_replies = 0
    echoes_reserved = False

    def __init__(
        self,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        profile: TransportProfile = HTTP,
        dialect: Dialect = RC8,
        clock: Clock = standing,
    ) -> None:
        self._clock = clock
        self.trace = trace
        self.profile = profile
        self.dialect = dialect
        self.serial = 1
        self._limits = limits
        self._stopped = True  # the server has been told that nobody is here, or never that somebody is

    def call(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        *,
        exact: bool = False,
        tries: int = 1,  # noqa: ARG002 - nothing is lost here
        later: float = 0.0,  # noqa: ARG002
        deadline: float | None = None,
    ) -> Operation:
        """Call a function; returns a generator, see the module's docstring.

        Args:
            function: an entry of the table.
            arguments: as :meth:`~orinkit.cao.table.Function.bind` gives them.
            seconds: time-out; every sign of the server that it is at work starts it anew.
            exact: give the result as a :class:`~orinkit.values.variant.Variant`.
            tries: as in b-CAP, where packets may be lost.
            later: the same.
            deadline: seconds that the call may take in all, whatever the server says; ``None`` for no such limit.

        Raises:
            InvalidValue: an argument does not fit; nothing was sent.
            CallTimeout: no answer in time. An answer that comes later is dropped.
            ConnectionLost: the other side closed the connection.
            ProtocolError: what came is not e-CAP, or not what the function returns; or too much came that is no answer.
            CallError: the controller answered with an error code.
        """
        request = write_request(function, arguments)
        if len(request) > self._limits.packet:
            raise _too_long(function, len(request), self._limits)
        self._tell(">", request)
        self._stopped = False
        patience = CallTimer(function.name, deadline, self._clock)
        received = yield request, patience.bound(seconds)
        while received and not received.strip():
            patience.heard(1, executing=True)
            received = yield b"", patience.bound(seconds)
        if not received:
            late = patience.end() if received is None else None
            raise late or no_answer(function, received, seconds)
        self._tell("<", received)
        code, result = read_reply(received, self._limits)
        if code >= _FAILED:
            raise error_for(code, read_detail(received), function.name, arguments)
        self._stopped = function is service_stop
        if function.result is None:
            return code, None
        if result is None:  # what is VT_EMPTY is left out
            result = Variant(VarType.EMPTY)
        return code, checked(function, result if exact else result.plain, exact=exact)

    def close_sequence(self) -> list[tuple[bytes, float]]:
        """Return what is to be sent before a client leaves that has not said Service_Stop, and seconds to wait for it."""
        if self._stopped:
            return []
        self._stopped = True
        request = write_request(service_stop, ())
        self._tell(">", request)
        return [(request, _FAREWELL)]

    def _tell(self, mark: str, body: bytes) -> None:
        if self.trace is not None:
            self.trace(mark, body)


def _too_long(function: Function[..., Any], length: int, limits: PacketLimits) -> InvalidValue:
    return InvalidValue(
        tr(
            "{name}: the arguments make a request of {length} bytes, at most {most} can be sent",
            name=function.name,
            length=length,
            most=limits.packet,
        )
    )
