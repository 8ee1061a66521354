"""The server side of a b-CAP conversation, without I/O and without a clock.

:class:`ServerConversation` receives bytes and yields actions: :class:`Send` (send bytes), :class:`Execute` (execute a
call), :class:`Decode` (decode a large packet), :class:`Continue` (nothing yet), :class:`Close` (close the link) and
:class:`EndSession` (end the client's session). The caller executes the call and passes the result to
:meth:`~ServerConversation.finish`. It calls :meth:`~ServerConversation.tick` at the time that
:meth:`~ServerConversation.next_time` returns. One call is executed at a time. Calls that arrive while another call is
executing return E_BUSY_PROC (docs/protocol.md). On unreliable transports, duplicates are not executed again
(:mod:`orinkit.bcap.duplicate_filter`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple, TypeAlias

from orinkit.bcap import packet
from orinkit.bcap.duplicate_filter import CachedReply, Decision, DuplicateFilter
from orinkit.bcap.profiles import STREAM, BcapProfile
from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.service_options import read_options
from orinkit.core import hresult
from orinkit.core.errors import CallError, ProtocolError
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Variant

_SERVICE_START: Final = 1
_SERVICE_STOP: Final = 2
_MAX_ARGUMENTS: Final = max(len(entry.arguments) for entry in FUNCTIONS.values())
_FAILED: Final = 0x8000_0000
_OVERDUE: Final = 0.5  # s; if a packet on a serial line is incomplete for longer, a packet inside it is accepted
_NEVER: Final = float("inf")
LARGE: Final = 16 * 1024
"""Size in bytes above which packets are decoded, and results encoded, outside the event loop."""

logger = logging.getLogger("orinkit.bcap.server")


@dataclass(frozen=True, slots=True)
class Send:
    """Send bytes."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Close:
    """Close the link after pending data has been sent; ``reason`` is for the log."""

    reason: str


@dataclass(frozen=True, slots=True)
class EndSession:
    """Release the client's objects and cancel its call, as if the client had disconnected; the link stays open."""

    reason: str


@dataclass(frozen=True, slots=True)
class Continue:
    """Do nothing; request the next action after serving other clients. The search for a packet in noise takes longer."""


@dataclass(frozen=True, slots=True)
class Execute:
    """Execute a call, then pass this object and the result to :meth:`ServerConversation.finish`."""

    serial: int
    function_id: int
    arguments: list[Variant]


@dataclass(frozen=True, slots=True, eq=False)
class Decode:
    """Call ``read``, which decodes a large packet, in a worker thread, so that other clients are served meanwhile.

    Then pass this object and the result of ``read`` to :meth:`ServerConversation.decoded`. Until then, further calls of
    the client return E_BUSY_PROC.

    Attributes:
        size: number of bytes of the packet.
    """

    serial: int
    function_id: int
    size: int
    read: Callable[[], list[Variant] | ProtocolError]


class Encoded(NamedTuple):
    """An encoded result, or the error code if it cannot be sent.

    Attributes:
        code: the error code; ``None`` if the result can be sent.
        body: the result, encoded as one argument.
        room: for a large result, used instead of ``body``: a buffer with the encoded argument and room for the rest of
            the packet, so that the argument is not copied.
    """

    code: int | None
    body: bytes = b""
    room: bytearray | None = None


_CONTINUE: Final = Continue()

Action: TypeAlias = Send | Execute | Decode | Continue | Close | EndSession


class ServerConversation:
    """The server side of the conversation with one client.

    Args:
        limits: limits of a packet.
        invoke_timeout: seconds after which a call returns E_TIMEOUT; a client can set another limit with
            ``InvokeTimeout=<ms>``.
        profile: the b-CAP transport profile.
        dialect: dialect of the controller.

    Attributes:
        timed_out: True if E_TIMEOUT has been sent for the call in progress.
        wdt: seconds between S_EXECUTING packets during a call, ``None`` for no such packets; set by ``WDT=<ms>``.
        stopped: True from the reply to Service_Stop until the next request.
        packets: number of complete packets received.
        calls: number of calls that were passed on for execution.
        max_silence: limit on the client's silence while its arm moves, s; ``None`` for no such limit; set by
            ``Alive=<ms>``.
        last_request_at: time of the last complete request.
        last_reply_at: time of the last reply to a call.
    """

    def __init__(
        self,
        limits: PacketLimits = DEFAULT_LIMITS,
        invoke_timeout: float = 180.0,
        profile: BcapProfile = STREAM,
        dialect: Dialect = RC8,
    ) -> None:
        self.wdt: float | None = None
        self.max_silence: float | None = None
        self.invoke_timeout = invoke_timeout
        self._default_timeout = invoke_timeout
        self._profile = profile
        self._dialect = dialect
        self._framer = profile.server_framer(limits)
        self.set_limits(limits)
        self._requests = DuplicateFilter(shared=profile.shared) if profile.lossy else None
        self._current: Execute | Decode | None = None
        self._serial = 0  # of the latest attempt of the current call
        self._reserved = 0
        self._next: Action | None = None  # the action after the one just yielded
        self._pending_since = _NEVER  # time since which the buffer contains an incomplete packet
        self.stopped = False
        self.packets = 0
        self.calls = 0
        self.timed_out = False
        self._next_wdt = 0.0
        self._now = self.last_request_at = self.last_reply_at = 0.0
        self._expires_at = 0.0

    def set_limits(self, limits: PacketLimits) -> None:
        """Change the limits of a packet."""
        self._limits = replace(self._profile.bound(limits), vt_error_size=self._dialect.vt_error_size)
        self._framer.limits = self._limits

    @property
    def busy(self) -> bool:
        """True while a call is in progress."""
        return self._current is not None

    @property
    def discardable_bytes(self) -> int:
        """Number of bytes of an incomplete packet that may never be completed; 0 over TCP.

        See :meth:`discard_incomplete`.
        """
        return self._framer.pending if self._profile.lossy else 0

    @property
    def incomplete_bytes(self) -> int:
        """Number of bytes of an incomplete packet, on any transport."""
        return self._framer.pending

    def packet_too_long_reply(self) -> bytes:
        """Return the reply to a packet that is too long to be received; the caller then closes the connection."""
        return self._pack(0, 0, hresult.E_PACKETSIZEOVER)

    def receive(self, data: bytes, now: float) -> Iterator[Action]:
        """Process received bytes; yield the actions, one at a time.

        If the caller passes the result of an :class:`Execute` to :meth:`finish` before it requests the next action, the
        next call is not refused with E_BUSY_PROC.

        Args:
            data: the bytes received.
            now: the time on a monotonic clock, s.
        """
        self._now = now
        return self._actions(partial(self._framer.feed, data), self._framer.next_frame)

    def discard_incomplete(self, now: float) -> Iterator[Action]:
        """Abandon an incomplete packet on a serial line; yield the actions for the packets that follow its first byte.

        Call this method after :data:`~orinkit.bcap.profiles.SILENCE` seconds without data. Afterwards, another
        incomplete packet may be in the buffer.
        """
        self._now = now
        return self._actions(self._framer.discard_incomplete, self._framer.next_frame)

    def _actions(self, first: Callable[[], bytes | None], following: Callable[[], bytes | None]) -> Iterator[Action]:
        take = first
        took = False
        while True:
            try:
                frame = take()
            except ProtocolError as error:
                yield Send(self._pack(0, 0, error.code))
                if error.fatal:
                    yield Close(str(error))
                    return
                take = following
                continue
            if frame is None and self._framer.is_searching:
                take = following
                yield _CONTINUE
                continue
            if frame is None and self._profile.shared:
                frame = self._inside(took)
            if frame is None:
                return
            take, took = following, True
            action = self._request(frame)
            while action is not None:
                yield action
                action, self._next = self._next, None

    def _inside(self, took: bool) -> bytes | None:
        """Return a packet that follows the header of an overdue incomplete packet; ``None`` if there is none."""
        if not self.discardable_bytes:
            self._pending_since = _NEVER
        elif took or self._pending_since == _NEVER:
            self._pending_since = self._now
        elif self._now - self._pending_since >= _OVERDUE:
            self._pending_since = self._now
            return self._framer.resync()
        return None

    def update_time(self, now: float) -> None:
        """Set the current time; call this method before requesting further actions, and before :meth:`finish`."""
        self._now = now

    def _request(self, frame: bytes) -> Action | None:
        self.packets += 1
        _, _, serial, reserved, function_id, count = packet.HEADER.unpack_from(frame)
        self.last_request_at = self._now
        if len(frame) > self._limits.packet:  # a datagram; in a stream the framer raises an error
            return Send(self._pack(serial, reserved, hresult.E_PACKETSIZEOVER))
        end = len(frame) - self._profile.tail
        if self._requests is not None:
            if not function_id or function_id & _FAILED:  # a reply; replying to it could cause an endless loop
                return None
            stopping = function_id == _SERVICE_STOP  # accepted during a call: there is no connection to close
            busy = self._current is not None and not stopping
            decision = self._requests.check(serial, reserved, function_id, frame[9:end], self._now, busy=busy)
            if decision is Decision.RESTART or (decision is Decision.NEW and self._current is not None):
                self._current = None
                self._next = self._take(frame, serial, reserved, function_id, count, end)
                return EndSession("Service_Stop during a call" if stopping else "a new client begins")
            if decision is not Decision.NEW:
                return self._not_new(self._requests, decision, serial, reserved)
        elif self._current is not None:
            return Send(self._pack(serial, reserved, hresult.E_BUSY_PROC))
        return self._take(frame, serial, reserved, function_id, count, end)

    def _not_new(self, requests: DuplicateFilter, decision: Decision, serial: int, reserved: int) -> Action | None:
        """Return the action for a request that must not be executed; ``None`` to drop the request."""
        if decision is Decision.STALE:
            return None
        if decision is Decision.REPLIED:
            reply = requests.reply_to(serial, reserved)
            return Send(self._pack(serial, reserved, reply.code, reply.count, reply.body))
        if decision is Decision.BUSY:
            return Send(self._pack(serial, reserved, hresult.E_BUSY_PROC))
        self._serial, self._reserved = serial, reserved  # the client now waits for the reply to this attempt
        return Send(self._pack(serial, reserved, hresult.S_EXECUTING))

    def _take(self, frame: bytes, serial: int, reserved: int, function_id: int, count: int, end: int) -> Action:
        """Decode a new request, and return the action that executes or refuses it."""
        self.stopped = False
        self._serial, self._reserved = serial, reserved
        if _MAX_ARGUMENTS < count <= len(frame) // 10:  # not decoded: no function has so many arguments
            return Send(self._reply(hresult.E_INVALIDARG if function_id in FUNCTIONS else hresult.E_NOTIMPL))
        action: Action
        if len(frame) > LARGE:
            read = partial(self._read, frame, count, end)
            self._current = action = Decode(serial, function_id, len(frame), read)
        else:
            action = self._call(serial, function_id, self._read(frame, count, end))
        self.timed_out = False
        self._expires_at = self._now + self.invoke_timeout
        if self.wdt is not None:
            self._next_wdt = self._now + self.wdt
        return action

    def _read(self, frame: bytes, count: int, end: int) -> list[Variant] | ProtocolError:
        """Decode the arguments of a packet; has no side effects, so it may be called from any thread."""
        try:
            return packet.decode_arguments(frame, count, end, self._limits, exact=True)[0]
        except ProtocolError as error:
            return error

    def decoded(self, decode: Decode, arguments: list[Variant] | ProtocolError, now: float) -> Iterator[Action]:
        """Process the arguments of a large packet; yield the actions, as :meth:`receive` does.

        The call is not executed if E_TIMEOUT has already been sent for it.
        """
        self._now = now
        if decode is not self._current:
            return
        self._current = None
        if self.timed_out:
            self.timed_out = False
            return
        action: Action | None = self._call(decode.serial, decode.function_id, arguments)
        while action is not None:
            yield action
            action, self._next = self._next, None

    def _call(self, serial: int, function_id: int, arguments: list[Variant] | ProtocolError) -> Action:
        """Return the action that executes or refuses a decoded request."""
        if isinstance(arguments, ProtocolError):
            error = arguments
            if self._dialect.closes_on_malformed_packet and error.code == hresult.E_INVALIDRCVPACKET:
                self._next = EndSession(str(error)) if self._profile.lossy else Close(str(error))
            return Send(self._reply(error.code))
        if function_id == _SERVICE_START and self._dialect.takes_start_options:
            try:
                self._set_options(arguments)
            except CallError as error:
                return Send(self._reply(error.code))
        self.calls += 1
        self._current = call = Execute(serial, function_id, arguments)
        return call

    def _set_options(self, arguments: list[Variant]) -> None:
        options = read_options(arguments)
        self.wdt, self.max_silence = options.wdt, options.max_silence
        self.invoke_timeout = self._default_timeout if options.invoke_timeout is None else options.invoke_timeout

    def finish(self, call: Execute, code: int, result: Variant | Encoded | None) -> bytes | bytearray:
        """Return the reply to a call; ``b""`` if the call has timed out, or was already finished or abandoned.

        Args:
            call: the call that has been executed.
            code: return code.
            result: the result, ``None`` if there is none; for a large result, the return value of :meth:`encode`.
        """
        if call is not self._current:
            return b""
        self._current = None
        self.last_reply_at = self._now
        if self.timed_out:
            self.timed_out = False
            return b""
        if call.function_id == _SERVICE_STOP:
            self.stopped = True
        data = self._reply(code) if result is None else self._reply_with(code, self._as_bytes(call, result))
        if self.stopped and self._requests is not None:
            self._requests.service_stopped()
        return data

    def encode(self, call: Execute, result: Variant) -> Encoded:
        """Encode a result for :meth:`finish`; has no side effects, so it may be called from any thread."""
        try:
            body = codec.encode_variant(result, self._limits.vt_error_size)
        except Exception:
            logger.exception("cannot encode the result of function %d", call.function_id)
            return Encoded(hresult.E_FAIL)
        if len(body) + packet.OVERHEAD + self._profile.tail - 1 > self._limits.packet:
            return Encoded(hresult.E_TOO_MUCH_DATA)
        if len(body) > LARGE and self._requests is None:
            return Encoded(None, room=packet.with_room(body))
        return Encoded(None, body)

    def _as_bytes(self, call: Execute, result: Variant | Encoded) -> Encoded:
        return result if isinstance(result, Encoded) else self.encode(call, result)

    def _reply_with(self, code: int, result: Encoded) -> bytes | bytearray:
        if result.room is not None:
            return packet.pack_around(
                result.room, self._serial, self._dialect.code_replacements.get(code, code), 1, self._echoed
            )
        return self._reply(code, 1, result.body) if result.code is None else self._reply(result.code)

    def _reply(self, code: int, count: int = 0, body: bytes = b"") -> bytes:
        """Return the reply to the current request; on unreliable transports, also store the reply."""
        if self._requests is not None:
            self._requests.store_reply(CachedReply(code, count, body), self._now)
        return self._pack(self._serial, self._reserved, code, count, body)

    def _pack(self, serial: int, reserved: int, code: int, count: int = 0, body: bytes = b"") -> bytes:
        dialect = self._dialect
        code = dialect.code_replacements.get(code, code)
        return packet.pack(serial, code, count, body, reserved if dialect.echoes_reserved else 0, crc=self._profile.crc)

    def abandon(self) -> None:
        """Discard the call in progress, because its client has become unreachable."""
        self._current = None
        self.max_silence = None

    @property
    def _echoed(self) -> int:
        return self._reserved if self._dialect.echoes_reserved else 0

    def next_time(self) -> float | None:
        """Return the time of the next :meth:`tick`, or ``None`` if none is due."""
        if self._current is None or self.timed_out:
            return None
        return self._expires_at if self.wdt is None else min(self._next_wdt, self._expires_at)

    def tick(self, now: float) -> bytes:
        """Return the packet that is due now (S_EXECUTING or E_TIMEOUT), ``b""`` if none is due.

        After E_TIMEOUT the call may still be executing: further calls return E_BUSY_PROC until it is complete.
        """
        self._now = now
        due = self.next_time()
        if self._current is None or due is None or now < due:
            return b""
        if now >= self._expires_at:
            self.timed_out = True
            return self._reply(hresult.E_TIMEOUT)
        assert self.wdt is not None
        self._next_wdt = now + self.wdt
        return self._pack(self._serial, self._reserved, hresult.S_EXECUTING)
