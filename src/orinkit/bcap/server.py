"""The server's side of a b-CAP conversation, without I/O and without a clock.

:class:`ServerConversation` is fed with the bytes received and says what to do: :class:`Send` bytes, :class:`Execute` a
call, :class:`Decode` a large packet first, :class:`Close` the link, :class:`Reset` what the client has. The shell around it
executes the call, hands the answer to :meth:`~ServerConversation.finish`, and calls :meth:`~ServerConversation.tick` when
:meth:`~ServerConversation.deadline` has come. One call is executed at a time; another one meanwhile is answered with
E_BUSY_PROC (reference behaviour: docs/protocol.md). Where packets may be lost, a request that comes again is not
executed again (:mod:`orinkit.bcap.duplicate_filter`).
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
_MOST_ARGUMENTS: Final = max(len(entry.arguments) for entry in FUNCTIONS.values())
_FAILED: Final = 0x8000_0000
_OVERDUE: Final = 0.5  # s that the rest of a packet may take on a serial line before one behind its head is believed
_NEVER: Final = float("inf")
LARGE: Final = 16 * 1024
"""Bytes of a packet, or of a result, that take long enough to be read or written beside the event loop."""

logger = logging.getLogger("orinkit.bcap.server")


@dataclass(frozen=True, slots=True)
class Send:
    """Send these bytes."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Close:
    """Close the link once everything has been sent; ``reason`` is for the log."""

    reason: str


@dataclass(frozen=True, slots=True)
class Reset:
    """Release every object of the client and end what it has at work, as if it had gone; the line goes on."""

    reason: str


@dataclass(frozen=True, slots=True)
class Execute:
    """Execute a call, then hand its answer to :meth:`ServerConversation.finish` with this object."""

    serial: int
    function_id: int
    arguments: list[Variant]


@dataclass(frozen=True, slots=True, eq=False)
class Decode:
    """Read a large packet where nobody else has to wait for it; the client is busy meanwhile.

    Hand what ``read`` returns to :meth:`ServerConversation.decoded`, with this object.
    """

    serial: int
    function_id: int
    read: Callable[[], list[Variant] | ProtocolError]


class Encoded(NamedTuple):
    """A result as bytes, or the code that says why it cannot be sent.

    Attributes:
        code: ``None`` where nothing is wrong with it.
        body: one encoded argument.
        room: the same with room for the rest of a packet around it, of a large one: it would be copied otherwise.
    """

    code: int | None
    body: bytes = b""
    room: bytearray | None = None


Action: TypeAlias = Send | Execute | Decode | Close | Reset


class ServerConversation:
    """One client's requests and their answers.

    Args:
        limits: bounds on a packet.
        invoke_timeout: seconds that a call may take before it is answered with E_TIMEOUT; a client may set its own with
            ``InvokeTimeout=<ms>``.
        profile: how packets travel.
        dialect: that is spoken.

    Attributes:
        timed_out: True once the call being executed has been answered with E_TIMEOUT.
        wdt: seconds between S_EXECUTING packets while a call is at work, ``None`` for none; set by ``WDT=<ms>``.
        stopped: True from an answered Service_Stop to the next request.
        packets: how many whole packets have come.
        calls: how many of them were calls to be executed.
        alive: seconds within which the client wants to be heard, ``None`` for no limit; set by ``Alive=<ms>``.
        heard: when the last whole request came.
        answered: when a call was last answered.
    """

    def __init__(
        self,
        limits: PacketLimits = DEFAULT_LIMITS,
        invoke_timeout: float = 180.0,
        profile: BcapProfile = STREAM,
        dialect: Dialect = RC8,
    ) -> None:
        self.wdt: float | None = None
        self.alive: float | None = None
        self.invoke_timeout = invoke_timeout
        self._default_timeout = invoke_timeout
        self._profile = profile
        self._dialect = dialect
        self._limits = replace(profile.bound(limits), error_size=dialect.error_size)
        self._framer = profile.server_framer(self._limits)
        self._requests = DuplicateFilter(shared=profile.shared) if profile.lossy else None
        self._current: Execute | Decode | None = None
        self._serial = 0  # of the latest try of the current call
        self._reserved = 0
        self._next: Action | None = None  # what is to follow what has just been said
        self._pending_since = _NEVER  # when what is pending was found to be no packet yet
        self.stopped = False
        self.packets = 0
        self.calls = 0
        self.timed_out = False
        self._next_wdt = 0.0
        self._now = self.heard = self.answered = 0.0
        self._give_up = 0.0

    @property
    def busy(self) -> bool:
        """True while a call is being executed."""
        return self._current is not None

    @property
    def pending(self) -> int:
        """How many bytes have come that are no whole packet yet; where they may stay so, :meth:`timeout` is for it."""
        return self._framer.pending if self._profile.lossy else 0

    @property
    def incomplete(self) -> int:
        """How many bytes have come of a packet that is not whole yet, whatever it travels by."""
        return self._framer.pending

    def refuse_packet(self) -> bytes:
        """Return the answer to a packet that is too long to be taken: to whom it is sent the connection is closed."""
        return self._pack(0, 0, hresult.E_PACKETSIZEOVER)

    def receive(self, data: bytes, now: float) -> Iterator[Action]:
        """Take bytes of the stream; yields what to do, one thing after the other.

        An :class:`Execute` that is finished before the next action is asked for is not busy any more.

        Args:
            data: what has been received.
            now: the time, in seconds of any steady clock.
        """
        self._now = now
        return self._actions(lambda: self._framer.feed(data), self._framer.next_frame)

    def timeout(self, now: float) -> Iterator[Action]:
        """Nothing has come for :data:`~orinkit.bcap.profiles.SILENCE` seconds; yields what to do, as :meth:`receive`.

        What a serial line has brought of a packet is given up then: its rest will not come. Something may still be
        pending afterwards.
        """
        self._now = now
        return self._actions(self._framer.timeout, self._framer.next_frame)

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
            if frame is None and self._profile.shared:
                frame = self._inside(took)
            if frame is None:
                return
            take, took = following, True
            yield from self._one_after_the_other(self._request(frame))

    def _one_after_the_other(self, action: Action | None) -> Iterator[Action]:
        if action is not None:
            yield action
        while self._next is not None:
            action, self._next = self._next, None
            yield action

    def _inside(self, took: bool) -> bytes | None:
        """Return a packet that waits behind the head of one that has not come to its end for long (a serial line)."""
        if not self.pending:
            self._pending_since = _NEVER
        elif took or self._pending_since == _NEVER:
            self._pending_since = self._now
        elif self._now - self._pending_since >= _OVERDUE:
            self._pending_since = self._now
            return self._framer.resync()
        return None

    def go_on(self, now: float) -> None:
        """Tell the time where some has passed: before going on with what :meth:`receive` yields, before an answer."""
        self._now = now

    def _request(self, frame: bytes) -> Action | None:
        self.packets += 1
        _, _, serial, reserved, function_id, count = packet.HEADER.unpack_from(frame)
        self.heard = self._now
        if len(frame) > self._limits.packet:  # a datagram; a stream would have lost its place
            return Send(self._pack(serial, reserved, hresult.E_PACKETSIZEOVER))
        end = len(frame) - self._profile.tail
        if self._requests is not None:
            if not function_id or function_id & _FAILED:  # an answer: to answer it could go on for ever
                return None
            goodbye = function_id == _SERVICE_STOP  # there is no connection whose end would say so
            busy = self._current is not None and not goodbye
            verdict = self._requests.check(serial, reserved, function_id, frame[9:end], self._now, busy=busy)
            if verdict is Decision.ANEW or (verdict is Decision.NEW and self._current is not None):
                self._current = None
                self._next = self._take(frame, serial, reserved, function_id, count, end)
                return Reset("it stops while a call is at work" if goodbye else "a client begins")
            if verdict is not Decision.NEW:
                return self._not_new(self._requests, verdict, serial, reserved)
        elif self._current is not None:
            return Send(self._pack(serial, reserved, hresult.E_BUSY_PROC))
        return self._take(frame, serial, reserved, function_id, count, end)

    def _not_new(self, requests: DuplicateFilter, verdict: Decision, serial: int, reserved: int) -> Action | None:
        """Answer a request that is not to be carried out."""
        if verdict is Decision.STALE:
            return None
        if verdict is Decision.ANSWERED:
            answer = requests.answer_to(serial, reserved)
            return Send(self._pack(serial, reserved, answer.code, answer.count, answer.body))
        if verdict is Decision.BUSY:
            return Send(self._pack(serial, reserved, hresult.E_BUSY_PROC))
        self._serial, self._reserved = serial, reserved  # its client waits for this one now
        return Send(self._pack(serial, reserved, hresult.S_EXECUTING))

    def _take(self, frame: bytes, serial: int, reserved: int, function_id: int, count: int, end: int) -> Action:
        """Read a new request, to be executed or refused."""
        self.stopped = False
        self._serial, self._reserved = serial, reserved
        if _MOST_ARGUMENTS < count <= len(frame) // 10:  # not worth reading: no function has so many
            return Send(self._answer(hresult.E_INVALIDARG if function_id in FUNCTIONS else hresult.E_NOTIMPL))
        read = partial(self._read, frame, count, end)
        action: Action
        if len(frame) > LARGE:
            self._current = action = Decode(serial, function_id, read)
        else:
            action = self._call(serial, function_id, read())
        self.timed_out = False
        self._give_up = self._now + self.invoke_timeout
        if self.wdt is not None:
            self._next_wdt = self._now + self.wdt
        return action

    def _read(self, frame: bytes, count: int, end: int) -> list[Variant] | ProtocolError:
        """Read the arguments of a packet; changes nothing, so it may be called from any thread."""
        try:
            return packet.decode_arguments(frame, count, end, self._limits, exact=True)[0]
        except ProtocolError as error:
            return error

    def decoded(self, decode: Decode, arguments: list[Variant] | ProtocolError, now: float) -> Iterator[Action]:
        """Take what a large packet has in it; yields what to do, as :meth:`receive`.

        Nothing is executed whose client has been told that it took too long.
        """
        self._now = now
        if decode is not self._current:
            return
        self._current = None
        if self.timed_out:
            self.timed_out = False
            return
        yield from self._one_after_the_other(self._call(decode.serial, decode.function_id, arguments))

    def _call(self, serial: int, function_id: int, arguments: list[Variant] | ProtocolError) -> Action:
        """Return the call of a request whose arguments have been read, or its refusal."""
        if isinstance(arguments, ProtocolError):
            error = arguments
            if self._dialect.drops_client and error.code == hresult.E_INVALIDRCVPACKET:
                self._next = Reset(str(error)) if self._profile.lossy else Close(str(error))
            return Send(self._answer(error.code))
        if function_id == _SERVICE_START and self._dialect.takes_options:
            try:
                self._set_options(arguments)
            except CallError as error:
                return Send(self._answer(error.code))
        self.calls += 1
        self._current = call = Execute(serial, function_id, arguments)
        return call

    def _set_options(self, arguments: list[Variant]) -> None:
        options = read_options(arguments)
        self.wdt, self.alive = options.wdt, options.alive
        self.invoke_timeout = self._default_timeout if options.invoke_timeout is None else options.invoke_timeout

    def finish(self, call: Execute, code: int, result: Variant | Encoded | None) -> bytes | bytearray:
        """Return the packet that answers a call; nothing where it has been answered already, by E_TIMEOUT or here.

        Args:
            call: what has been executed.
            code: return code.
            result: the result, ``None`` where there is none; a large one by way of :meth:`encode`.
        """
        if call is not self._current:
            return b""
        self._current = None
        self.answered = self._now
        if self.timed_out:
            self.timed_out = False
            return b""
        if call.function_id == _SERVICE_STOP:
            self.stopped = True
        data = self._answer(code) if result is None else self._answer_with(code, self._as_bytes(call, result))
        if self.stopped and self._requests is not None:
            self._requests.stop()
        return data

    def encode(self, call: Execute, result: Variant) -> Encoded:
        """Return a result for :meth:`finish`; changes nothing, so it may be called from any thread."""
        try:
            body = codec.encode_variant(result, self._limits.error_size)
        except Exception:
            logger.exception("the result of function %d cannot be sent", call.function_id)
            return Encoded(hresult.E_FAIL)
        if len(body) + packet.OVERHEAD + self._profile.tail - 1 > self._limits.packet:
            return Encoded(hresult.E_TOO_MUCH_DATA)
        if len(body) > LARGE and self._requests is None:
            return Encoded(None, room=packet.with_room(body))
        return Encoded(None, body)

    def _as_bytes(self, call: Execute, result: Variant | Encoded) -> Encoded:
        return result if isinstance(result, Encoded) else self.encode(call, result)

    def _answer_with(self, code: int, result: Encoded) -> bytes | bytearray:
        if result.room is not None:
            return packet.pack_around(result.room, self._serial, self._dialect.codes.get(code, code), 1, self._echoed)
        return self._answer(code, 1, result.body) if result.code is None else self._answer(result.code)

    def _answer(self, code: int, count: int = 0, body: bytes = b"") -> bytes:
        """Return the answer to the current request, which is kept where it may be lost."""
        if self._requests is not None:
            self._requests.answered(CachedReply(code, count, body), self._now)
        return self._pack(self._serial, self._reserved, code, count, body)

    def _pack(self, serial: int, reserved: int, code: int, count: int = 0, body: bytes = b"") -> bytes:
        dialect = self._dialect
        code = dialect.codes.get(code, code)
        return packet.pack(serial, code, count, body, reserved if dialect.echoes_reserved else 0, crc=self._profile.crc)

    def abandon(self) -> None:
        """Have nobody wait for the call that is at work: its client is taken to have gone."""
        self._current = None
        self.alive = None

    @property
    def _echoed(self) -> int:
        return self._reserved if self._dialect.echoes_reserved else 0

    def deadline(self) -> float | None:
        """Return when :meth:`tick` is due next, ``None`` while it is not."""
        if self._current is None or self.timed_out:
            return None
        return self._give_up if self.wdt is None else min(self._next_wdt, self._give_up)

    def tick(self, now: float) -> bytes:
        """Return what is due now: S_EXECUTING, E_TIMEOUT, or nothing yet.

        After E_TIMEOUT the client is answered, but the device is still at work: calls are E_BUSY_PROC until it is done.
        """
        self._now = now
        due = self.deadline()
        if self._current is None or due is None or now < due:
            return b""
        if now >= self._give_up:
            self.timed_out = True
            return self._answer(hresult.E_TIMEOUT)
        assert self.wdt is not None
        self._next_wdt = now + self.wdt
        return self._pack(self._serial, self._reserved, hresult.S_EXECUTING)
