"""The server side of a b-CAP conversation, without I/O and without a clock.

:class:`ServerConversation` receives bytes and yields actions: :class:`Send` (send bytes), :class:`Execute` (execute a
call), :class:`Decode` (decode a large packet), :class:`Continue` (nothing yet), :class:`Close` (close the link) and
:class:`EndSession` (end the client's session). The caller executes the call and passes the result to
:meth:`~ServerConversation.finish`. It calls :meth:`~ServerConversation.tick` at the time that
:meth:`~ServerConversation.next_time` returns. One call is executed at a time. Calls that arrive while another call is
executing wait in a limited queue; a call that stops motions is executed at once (:mod:`orinkit.bcap.call_queue`,
docs/protocol.md). On unreliable transports, duplicates are not executed again (:mod:`orinkit.bcap.duplicate_filter`).
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeAlias

from orinkit.bcap import packet
from orinkit.bcap.actions import Action, Close, Continue, Decode, Encoded, EndSession, Execute, Send
from orinkit.bcap.call_queue import CallQueue, Request
from orinkit.bcap.duplicate_filter import CachedReply, Decision, DuplicateFilter
from orinkit.bcap.profiles import STREAM, BcapProfile
from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.service_options import read_options
from orinkit.core import hresult
from orinkit.core.errors import CallError, ProtocolError
from orinkit.core.record import replaced
from orinkit.rc8.stopping import MAY_MOVE, MAY_STOP, begins_motion, is_stop
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Variant, VarType

_SERVICE_START: Final = 1
_SERVICE_STOP: Final = 2
_MAX_ARGUMENTS: Final = max(len(entry.arguments) for entry in FUNCTIONS.values())
_FAILED: Final = 0x8000_0000
_EMPTY: Final = codec.encode_variant(Variant(VarType.EMPTY))
_OVERDUE: Final = 0.5  # s; if a packet on a serial line is incomplete for longer, a packet inside it is accepted
_NEVER: Final = float("inf")
LARGE: Final = 16 * 1024
"""Size in bytes above which packets are decoded, and results encoded, outside the event loop."""

_USUAL: Final = 4000  # bytes of the longest packet of the direct path; longer ones are rare, and slow in any case
_OF_SERVICE: Final = frozenset((_SERVICE_START, _SERVICE_STOP))  # they change the conversation

DirectCall: TypeAlias = tuple[int, int, int, list[Variant] | int]
"""Serial, reserved field, function id, and arguments of a call; if the only argument is a handle, the handle."""

logger = logging.getLogger("orinkit.bcap.server")
_CONTINUE: Final = Continue()


class ServerConversation:
    """The server side of the conversation with one client.

    Args:
        limits: limits of a packet.
        invoke_timeout: seconds after which a call returns E_TIMEOUT; a client can set another limit with
            ``InvokeTimeout=<ms>``.
        profile: the b-CAP transport profile.
        dialect: dialect of the controller.

    Attributes:
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
        self._stream = self._framer if isinstance(self._framer, packet.Framer) else None
        self.set_limits(limits)
        self._requests = DuplicateFilter(shared=profile.shared) if profile.lossy else None
        self._calls = CallQueue(queues=dialect.queues_calls)
        self._following: deque[Action] = deque()  # the actions after the one just yielded
        self._pending_since = _NEVER  # time since which the buffer contains an incomplete packet
        self.stopped = False
        self.packets = 0
        self.calls = 0
        self._now = self.last_request_at = self.last_reply_at = 0.0

    def set_limits(self, limits: PacketLimits) -> None:
        """Change the limits of a packet."""
        self._limits = replaced(self._profile.bound(limits), vt_error_size=self._dialect.vt_error_size)
        self._framer.limits = self._limits

    @property
    def busy(self) -> bool:
        """True while a call is in progress."""
        return self._calls.busy

    @property
    def timed_out(self) -> bool:
        """True if E_TIMEOUT has been sent for the call in progress."""
        return self._calls.timed_out

    @property
    def has_queued(self) -> bool:
        """True if a request waits for the end of the call in progress."""
        return bool(self._calls.waiting)

    def is_stop(self, call: Execute) -> bool:
        """Return True if a call is executed beside the call in progress, because it stops motions."""
        return self._calls.is_beside(call)

    def gave_up(self, call: Execute) -> bool:
        """Return True if E_TIMEOUT has been sent for a call."""
        request = self._calls.request_of(call)
        return request is not None and request.timed_out

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

    # --- received bytes -----------------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float) -> Iterator[Action]:
        """Process received bytes; yield the actions, one at a time.

        If the caller passes the result of an :class:`Execute` to :meth:`finish` before it requests the next action, the
        next call does not have to wait.

        Args:
            data: the bytes received.
            now: the time on a monotonic clock, s.
        """
        self._now = now
        return self._actions(partial(self._framer.feed, data), self._framer.next_frame)

    # --- the direct path ----------------------------------------------------------------------------------------

    def take_directly(self, data: bytes, now: float) -> DirectCall | None:
        """Return the call in received bytes, if these are exactly one usual packet, and no call is in progress.

        Otherwise return ``None``, and change nothing: the caller then passes the bytes to :meth:`receive`, which
        processes everything. The caller executes the call at once, and passes the result to :meth:`reply_directly`.

        Args:
            data: the bytes received.
            now: the time on a monotonic clock, s.
        """
        stream = self._stream
        if stream is None or not stream.has_whole(data) or not self._calls.empty:
            return None
        call: DirectCall | None = packet.read_one_handle(data)
        if call is None:
            if len(data) > _USUAL:
                return None
            _, _, serial, reserved, function_id, count = packet.HEADER.unpack_from(data)
            if count > _MAX_ARGUMENTS or function_id in _OF_SERVICE:
                return None
            arguments = self._decode(data, count, len(data) - 1)
            if isinstance(arguments, ProtocolError):
                return None
            call = serial, reserved, function_id, arguments
        elif call[2] in _OF_SERVICE:
            return None
        self._now = self.last_request_at = now
        self.packets += 1
        self.calls += 1
        self.stopped = False
        return call

    def reply_directly(self, call: DirectCall, code: int, result: Variant | None) -> bytes | None:
        """Return the reply to a call of :meth:`take_directly`; ``None`` if the result is not a simple one.

        In this case, the caller continues with :meth:`continue_call` and :meth:`finish`.
        """
        dialect = self._dialect
        serial, reserved, _, _ = call
        reserved = reserved if dialect.echoes_reserved else 0
        if code:
            if result is not None:
                return None
            data: bytes | None = self._pack(serial, reserved, code)
        else:
            try:
                data = packet.pack_reply(serial, code, result, reserved)
            except Exception:  # noqa: BLE001 - the value does not fit its type, which encode() logs
                return None
        if data is None or len(data) > self._limits.packet:
            return None
        self.last_reply_at = self._now
        return data

    def continue_call(self, call: DirectCall) -> Execute:
        """Record that a call of :meth:`take_directly` is in progress, as :meth:`receive` does before it yields a call."""
        serial, reserved, function_id, arguments = call
        request = Request(b"", serial, reserved, function_id, 0, 0)
        self._start_timers(request)
        execute = Execute(serial, function_id, arguments if isinstance(arguments, list) else [])
        self._calls.begin(request, execute)
        return execute

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
            yield from self._with_following(self._request(frame))

    def _with_following(self, action: Action | None) -> Iterator[Action]:
        """Yield an action, and the actions that follow it."""
        while action is not None:
            yield action
            action = self._following.popleft() if self._following else None

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

    # --- requests -----------------------------------------------------------------------------------------------

    def _request(self, frame: bytes) -> Action | None:
        self.packets += 1
        _, _, serial, reserved, function_id, count = packet.HEADER.unpack_from(frame)
        self.last_request_at = self._now
        if len(frame) > self._limits.packet:  # a datagram; in a stream the framer raises an error
            return Send(self._pack(serial, reserved, hresult.E_PACKETSIZEOVER))
        end = len(frame) - self._profile.tail
        request = Request(frame, serial, reserved, function_id, count, end)
        if self._requests is not None:
            return self._request_lossy(self._requests, request)
        if self._calls.idle:
            return self._take(request)
        return self._take_later(request, self._stops(request))

    def _request_lossy(self, requests: DuplicateFilter, request: Request) -> Action | None:
        function_id = request.function_id
        if not function_id or function_id & _FAILED:  # a reply; replying to it could cause an endless loop
            return None
        ends = function_id == _SERVICE_STOP  # accepted during a call: there is no connection to close
        stops = not self._calls.idle and self._stops(request)
        accepts = ends or self._calls.idle or self._calls.accepts(request, stops=stops)
        content = request.frame[9 : request.end]
        serial, reserved = request.serial, request.reserved
        decision = requests.check(serial, reserved, function_id, content, self._now, busy=not accepts)
        if decision is Decision.RESTART or (decision is Decision.NEW and ends and self._calls.busy):
            self._calls.clear()
            taken = self._take(request)
            self._following.appendleft(taken)
            return EndSession("Service_Stop during a call" if ends else "a new client begins")
        if decision is not Decision.NEW:
            return self._not_new(requests, decision, serial, reserved)
        return self._take(request) if self._calls.idle else self._take_later(request, stops)

    def _not_new(self, requests: DuplicateFilter, decision: Decision, serial: int, reserved: int) -> Action | None:
        """Return the action for a request that must not be executed; ``None`` to drop the request."""
        if decision is Decision.STALE:
            return None
        if decision is Decision.REPLIED:
            reply = requests.reply_to(serial, reserved)
            return Send(self._pack(serial, reserved, reply.code, reply.count, reply.body))
        if decision is Decision.BUSY:
            return Send(self._pack(serial, reserved, hresult.E_BUSY_PROC))
        self._calls.attempt(serial, reserved)  # the client now waits for the reply to this attempt
        return Send(self._pack(serial, reserved, hresult.S_EXECUTING))

    def _stops(self, request: Request) -> bool:
        """Return True if a request stops motions, so that it must not wait."""
        if request.function_id not in MAY_STOP or len(request.frame) > LARGE:
            return False
        arguments = self._read(request)
        return not isinstance(arguments, ProtocolError) and is_stop(request.function_id, arguments)

    def _take_later(self, request: Request, stops: bool) -> Action | None:
        """Return the action for a new request that arrives during a call; ``None`` if the request waits."""
        if not self._calls.accepts(request, stops=stops):
            return Send(self._pack(request.serial, request.reserved, hresult.E_BUSY_PROC))
        if stops:
            return self._take_stop(request)
        self._start_timers(request)
        self._calls.enqueue(request)
        return None

    def _take_stop(self, request: Request) -> Action:
        """Return the action that executes a stop at once; waiting requests that begin motions are refused before."""
        refused = [each for each in self._calls.waiting if self._begins_motion(each)]
        actions: list[Action] = []
        for each in refused:
            self._calls.remove(each)
            actions.append(Send(self._reply(each, hresult.E_ABORT)))
        self._start_timers(request)
        actions.append(self._call(request, self._read(request), beside=True))
        self._following.extend(actions[1:])
        return actions[0]

    def _begins_motion(self, request: Request) -> bool:
        if request.function_id not in MAY_MOVE:
            return False
        arguments = self._read(request)
        return isinstance(arguments, ProtocolError) or begins_motion(request.function_id, arguments)

    def _start_timers(self, request: Request) -> None:
        request.expires_at = self._now + self.invoke_timeout
        request.next_wdt = _NEVER if self.wdt is None else self._now + self.wdt

    def _take(self, request: Request) -> Action:
        """Decode a new request, and return the action that executes or refuses it."""
        self.stopped = False
        function_id = request.function_id
        if _MAX_ARGUMENTS < request.count <= len(request.frame) // 10:  # not decoded: no function has so many arguments
            known = function_id in FUNCTIONS
            return Send(self._reply(request, hresult.E_INVALIDARG if known else hresult.E_NOTIMPL))
        self._start_timers(request)
        if len(request.frame) <= LARGE:
            return self._call(request, self._read(request))
        read = partial(self._decode, request.frame, request.count, request.end)
        decode = Decode(request.serial, function_id, len(request.frame), read)
        self._calls.begin(request, decode)
        return decode

    def _read(self, request: Request) -> list[Variant] | ProtocolError:
        return self._decode(request.frame, request.count, request.end)

    def _decode(self, frame: bytes, count: int, end: int) -> list[Variant] | ProtocolError:
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
        request = self._calls.end(decode)
        if request is None:
            return
        if not request.timed_out:
            yield from self._with_following(self._call(request, arguments))
        yield from self.resume(now)

    def resume(self, now: float) -> Iterator[Action]:
        """Yield the actions for the requests that have waited for the end of a call, as :meth:`receive` does."""
        self._now = now
        while (request := self._calls.next()) is not None:
            yield from self._with_following(self._take(request))

    def _call(self, request: Request, arguments: list[Variant] | ProtocolError, *, beside: bool = False) -> Action:
        """Return the action that executes or refuses a decoded request."""
        if isinstance(arguments, ProtocolError):
            error = arguments
            if self._dialect.closes_on_malformed_packet and error.code == hresult.E_INVALIDRCVPACKET:
                ends_session = EndSession(str(error), keeps_replies=True)
                self._following.append(ends_session if self._profile.lossy else Close(str(error)))
            return Send(self._reply(request, error.code))
        if request.function_id == _SERVICE_START:
            try:
                self._set_options(arguments)
            except CallError as error:
                if self._dialect.takes_start_options:
                    return Send(self._reply(request, error.code))
        self.calls += 1
        call = Execute(request.serial, request.function_id, arguments)
        self._calls.begin(request, call, beside=beside)
        return call

    def _set_options(self, arguments: list[Variant]) -> None:
        options = read_options(arguments, strict=self._dialect.strict)
        self.wdt, self.max_silence = options.wdt, options.max_silence
        self.invoke_timeout = self._default_timeout if options.invoke_timeout is None else options.invoke_timeout

    # --- replies ------------------------------------------------------------------------------------------------

    def finish(self, call: Execute, code: int, result: Variant | Encoded | None) -> bytes | bytearray:
        """Return the reply to a call; ``b""`` if the call has timed out, or was already finished or abandoned.

        If :attr:`has_queued` is True afterwards, the caller processes the actions of :meth:`resume`.

        Args:
            call: the call that has been executed.
            code: return code.
            result: the result, ``None`` if there is none; for a large result, the return value of :meth:`encode`.
        """
        request = self._calls.end(call)
        if request is None:
            return b""
        self.last_reply_at = self._now
        if request.timed_out:
            return b""
        if call.function_id == _SERVICE_STOP:
            self.stopped = True
        if result is None:
            data: bytes | bytearray = self._reply(request, code)
        else:
            data = self._reply_with(request, code, self._as_bytes(call, result))
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

    def _reply_with(self, request: Request, code: int, result: Encoded) -> bytes | bytearray:
        if result.room is not None:
            echoed = request.reserved if self._dialect.echoes_reserved else 0
            return packet.pack_around(
                result.room, request.serial, self._dialect.code_replacements.get(code, code), 1, echoed
            )
        return self._reply(request, code, 1, result.body) if result.code is None else self._reply(request, result.code)

    def _reply(self, request: Request, code: int, count: int = 0, body: bytes = b"") -> bytes:
        """Return the reply to a request; on unreliable transports, also store the reply."""
        if self._requests is not None:
            self._requests.store_reply(request.number, CachedReply(code, count, body), self._now)
        return self._pack(request.serial, request.reserved, code, count, body)

    def _pack(self, serial: int, reserved: int, code: int, count: int = 0, body: bytes = b"") -> bytes:
        dialect = self._dialect
        code = dialect.code_replacements.get(code, code)
        if not count and code & _FAILED and dialect.replies_vt_empty:
            count, body = 1, _EMPTY
        return packet.pack(serial, code, count, body, reserved if dialect.echoes_reserved else 0, crc=self._profile.crc)

    def abandon(self) -> None:
        """Discard the calls in progress and the waiting requests, because their client has become unreachable."""
        self._calls.clear()
        if self._requests is not None:
            self._requests.abandon()
        self.max_silence = None

    # --- time ---------------------------------------------------------------------------------------------------

    def next_time(self) -> float | None:
        """Return the time of the next :meth:`tick`, or ``None`` if none is due."""
        return self._calls.next_time()

    def tick(self, now: float) -> bytes:
        """Return a packet that is due now (S_EXECUTING or E_TIMEOUT), ``b""`` if none is due.

        After E_TIMEOUT the call may still be executing: further calls return E_BUSY_PROC until it is complete.
        """
        self._now = now
        request = self._calls.due(now)
        if request is None:
            return b""
        if now >= request.expires_at:
            self._calls.time_out(request)
            return self._reply(request, hresult.E_TIMEOUT)
        request.next_wdt = _NEVER if self.wdt is None else now + self.wdt
        return self._pack(request.serial, request.reserved, hresult.S_EXECUTING)
