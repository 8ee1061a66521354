"""The client side of a b-CAP conversation, without I/O.

:meth:`BcapConversation.call` is a generator. It yields ``(data, seconds)``. If ``data`` is not empty, the caller sends
it to the controller. The caller then waits for bytes from the controller, for at most ``seconds`` s. If ``seconds`` is
``None``, the caller continues the previous wait. The caller passes the received bytes to the generator, or ``b""`` if
the peer has closed the connection, or ``None`` after a time-out. Finally, the generator returns the return code and the
result. The runners in :mod:`orinkit.transport.runner` execute such generators and do the I/O.

On unreliable transports (:mod:`orinkit.bcap.profiles`), a request without a reply is repeated. The controller
recognizes the duplicate by the reserved field and executes the request once.
"""

from __future__ import annotations

import struct
from collections.abc import Generator
from typing import Any, Final, TypeAlias

from orinkit.bcap import packet
from orinkit.bcap.direct import NUMBERS, SCALAR, RequestTemplate
from orinkit.bcap.profiles import SILENCE, STREAM, BcapProfile
from orinkit.bcap.requests import encode_request, request_template
from orinkit.cao.call_limits import CallTimer, Clock, no_clock
from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.functions import controller_get_name, service_stop
from orinkit.cao.replies import Trace, checked, no_answer
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, ConnectionLost, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.core.record import replaced
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Variant, VarType

Exchange: TypeAlias = tuple[bytes, float | None]
Operation: TypeAlias = Generator[Exchange, bytes | None, tuple[int, Any]]
RawOperation: TypeAlias = Generator[Exchange, bytes | None, bytes | None]

_SERIAL_AND_CODE: Final = struct.Struct("<HHIH").unpack_from  # at offset 5: serial, reserved, code, argument count
_HEADER: Final = packet.HEADER.pack
_READ_HEADER: Final = packet.HEADER.unpack_from
_FAILED: Final = 0x8000_0000
_EXECUTING: Final = hresult.S_EXECUTING
_STOP_REPEATS: Final = 3


class BcapConversation:
    """The client side of the conversation on one link: creates requests and interprets replies, one call at a time.

    Args:
        limits: limits of a packet; the packet size is also limited by the profile.
        trace: callback invoked with every packet; ``None`` for no callback.
        profile: the b-CAP transport profile.
        dialect: dialect of the controller; may be set later, when it is known.
        clock: function that returns the time, s; used for deadlines and to detect too many unexpected packets.

    Attributes:
        stray_replies: number of replies that did not belong to the current call: late, repeated, or for another client.
        trace: callback invoked with every packet; ``None`` for no callback. Set before the first call.
        profile: the b-CAP transport profile.
        serial: serial number of the next request; may be set after another process has sent requests on the same link.
        direct: True if the next call may be a direct one (:meth:`begin`): on a stream without trace, while no received
            bytes are left in the framer.
        echoes_reserved: True if the last reply repeated the reserved field of its request; a VE026A does this over UDP
            and serial lines.
    """

    __slots__ = ("__dict__", "__weakref__", "_limits", "direct", "serial")  # the extension reads slots faster

    def __init__(
        self,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        profile: BcapProfile = STREAM,
        dialect: Dialect = RC8,
        clock: Clock = no_clock,
    ) -> None:
        self.stray_replies = 0
        self._clock = clock
        self.trace = trace
        self.profile = profile
        self._limits = profile.bound(limits)
        self._framer = profile.framer(self._limits)
        self._most = self._limits.packet
        self._tail = profile.tail
        self.serial = 1
        self.echoes_reserved = False
        self._stopped = True  # no Service_Stop is necessary: it has been sent, or no request has been sent
        self.dialect = dialect
        self.direct = self._is_direct()

    @property
    def dialect(self) -> Dialect:
        """Dialect of the controller."""
        return self._dialect

    @dialect.setter
    def dialect(self, dialect: Dialect) -> None:
        self._dialect = dialect
        if dialect.vt_error_size != self._limits.vt_error_size:
            self._limits = replaced(self._limits, vt_error_size=dialect.vt_error_size)

    @property
    def skipped_bytes(self) -> int:
        """Number of bytes received outside any packet."""
        return self._framer.skipped_bytes

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
        """Return a generator that calls a function; the docstring of the module describes how to use the generator.

        Args:
            function: an entry of the table of functions.
            arguments: the result of :meth:`~orinkit.cao.table.Function.bind`.
            seconds: time-out of one attempt, s; every S_EXECUTING from the controller restarts it.
            exact: True to return the result as a :class:`~orinkit.values.variant.Variant`.
            tries: total number of attempts on unreliable transports (RC8 table 5-1: TORetry); every S_EXECUTING
                restarts the count.
            retry_timeout: minimum time-out of every attempt except the first, s. It may exceed ``seconds``: after noise
                on a serial line, a server detects the next packet only after a period of silence.
            deadline: limit on the duration of the call, s, regardless of S_EXECUTING; ``None`` for no limit.

        Raises:
            InvalidValue: If an argument does not fit its type; nothing has been sent.
            CallTimeout: If no reply was received in time. A later reply is dropped and never assigned to another call.
            ConnectionLost: If the peer has closed the connection.
            ProtocolError: If the received data is not b-CAP, if the result does not have the type that the function
                returns, or if too many packets other than the reply were received.
            CallError: If the controller has returned an error code.
        """
        if self.profile.lossy:
            return self._call_lossy(function, arguments, seconds, exact, tries, retry_timeout, deadline)
        return self._call_stream(function, arguments, seconds, exact, deadline)

    def _call_stream(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        deadline: float | None,
    ) -> Operation:
        serial, request = self.begin(function, arguments)
        # without a deadline, the clock is not read unless a packet other than the reply arrives
        timer = None if deadline is None else CallTimer(function.name, deadline, self._clock)
        received = yield request, seconds if timer is None else timer.bound(seconds)
        return (yield from self.resume(serial, function, arguments, seconds, received, exact=exact, timer=timer))

    def resume(
        self,
        serial: int,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        received: bytes | None,
        *,
        exact: bool = False,
        timer: CallTimer | None = None,
    ) -> Operation:
        """Return a generator that continues a call on a stream after its request was sent, and data was received.

        Args:
            serial: serial of the request.
            function: an entry of the table of functions.
            arguments: the arguments of the call.
            seconds: time-out, s.
            received: the received bytes, ``b""`` if the peer has closed the connection, ``None`` after a time-out.
            exact: True to return the result as a :class:`~orinkit.values.variant.Variant`.
            timer: deadline of the call; ``None`` if it has none.

        Raises:
            CallTimeout: As :meth:`call`, which also raises ConnectionLost, ProtocolError and CallError.
        """
        framer = self._framer
        self.direct = False
        try:
            while True:
                if not received:
                    expired = timer.timeout_error() if received is None and timer is not None else None
                    raise expired or no_answer(function, received, seconds)
                wait: float | None = None
                idle = 0
                frame = framer.feed(received)
                while frame is not None:
                    if self.trace is not None:
                        self.trace("<", frame)
                    answered, _, code, count = _SERIAL_AND_CODE(frame, 5)
                    if answered != serial:
                        self.stray_replies += 1
                        idle += 1
                    elif code == _EXECUTING:
                        wait = seconds
                        idle += 1
                    elif code >= _FAILED:
                        raise error_for(code, "", function.name, arguments)
                    else:
                        return code, self._result(function, frame, count, exact)
                    frame = framer.next_frame()
                if idle:
                    timer = timer or CallTimer(function.name, None, self._clock)
                    timer.count_other(idle, executing=wait is not None)
                    wait = timer.bound(wait)
                received = yield b"", wait
        finally:
            self.direct = self._is_direct()

    def _is_direct(self) -> bool:
        return not self.profile.lossy and self.trace is None and self._framer.is_empty

    # --- direct calls -------------------------------------------------------------------------------------------

    def begin(self, function: Function[..., Any], arguments: tuple[Any, ...]) -> tuple[int, bytes]:
        """Return the serial and the request of a direct call.

        The caller sends the request, receives once, and passes the received bytes to :meth:`finish`.

        Raises:
            InvalidValue: If an argument does not fit its type; no serial has been used.
        """
        serial = self.serial
        request = self._request(function, arguments, serial, 0)
        self.serial = serial % 0xFFFF + 1
        return serial, request

    def begin_prepared(self, template: RequestTemplate, value: Any) -> tuple[int, bytes] | None:
        """Return the serial and the request of a prepared call; ``None`` if the template has no layout for the value.

        In the latter case, the caller uses :meth:`begin`; no serial has been used.
        """
        serial = self.serial
        request = template.request(serial, value)
        if request is None:
            return None
        self.serial = serial % 0xFFFF + 1
        return serial, request

    def finish(
        self, function: Function[..., Any], serial: int, data: bytes | None, exact: bool = False
    ) -> tuple[int, Any] | None:
        """Return the return code and the result of a direct call.

        Return ``None`` if ``data`` is anything but one complete packet, which is the reply with a success code to the
        request with this serial. The caller then passes the data to :meth:`resume`.

        Args:
            function: an entry of the table of functions.
            serial: serial of the request.
            data: the received bytes, ``b""`` if the peer has closed the connection, ``None`` after a time-out.
            exact: True to return the result as a :class:`~orinkit.values.variant.Variant`.

        Raises:
            ProtocolError: If the result is invalid, or has another type than the function returns.
        """
        size = len(data) if data is not None else 0
        if data is None or not packet.OVERHEAD <= size <= self._most:
            return None
        if function.result is VarType.VARIANT and not exact:
            reply = NUMBERS.get(size)
            if reply is not None:
                unpack, start, middle = reply
                first, answered, second, *numbers, last = unpack(data)
                if first == start and answered == serial and second == middle and last == packet.EOT:
                    return 0, numbers
            scalar = SCALAR.get(size)
            if scalar is not None:
                (unpack, start, middle), convert = scalar
                first, answered, second, value, last = unpack(data)
                if first == start and answered == serial and second == middle and last == packet.EOT:
                    return 0, value if convert is None else convert(value)
        soh, length, answered, _, code, count = _READ_HEADER(data)
        if (
            soh != packet.SOH
            or length != size
            or data[-1] != packet.EOT
            or answered != serial
            or code == _EXECUTING
            or code >= _FAILED
        ):
            return None
        return code, self._result(function, data, count, exact)

    def template(self, function: Function[..., Any], constants: tuple[Any, ...]) -> RequestTemplate | None:
        """Return the template of prepared calls (:func:`orinkit.bcap.requests.request_template`)."""
        return None if self.profile.lossy else request_template(function, constants, self._most)

    def _call_lossy(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        tries: int,
        retry_timeout: float,
        deadline: float | None,
    ) -> Operation:
        first = serial = self._take_serial()
        requests = {serial: self._request(function, arguments, serial, first)}
        framer, left, seen = self._framer, tries, 0
        self._stopped = False
        busy: CallError | None = None
        timer = CallTimer(function.name, deadline, self._clock)
        received = yield requests[serial], timer.bound(seconds)
        while True:
            if received is None and framer.pending > seen and framer.partial_serial in requests:
                seen = framer.pending  # a long reply over a slow line is still arriving
                received = yield b"", timer.bound(SILENCE)
                continue
            if received == b"":
                raise no_answer(function, received, seconds)
            seen, executing = 0, False
            idle = 0
            # after a time-out, a reply may be found that noise before it has hidden
            frame = framer.feed(received) if received else framer.discard_incomplete()
            while frame is not None:
                if self.trace is not None:
                    self.trace("<", frame)
                answered, reserved, code, count = _SERIAL_AND_CODE(frame, 5)
                if requests.get(answered, frame) == frame:  # for another client, or an echo of the line
                    self.stray_replies += 1
                    idle += 1
                elif code == _EXECUTING:
                    executing, left = True, tries
                    idle += 1
                elif len(requests) > 1 and code == self._dialect.busy_code != 0:
                    busy = error_for(code, "", function.name, arguments)
                elif code >= _FAILED:
                    raise error_for(code, "", function.name, arguments)
                else:
                    self.echoes_reserved = bool(reserved)
                    self._stopped = function is service_stop
                    return code, self._result(function, frame, count, exact)
                frame = framer.next_frame()
            if not idle and received and not self.profile.shared:
                idle = 1  # a datagram without a packet; on a serial line, a part of a packet is normal
            timer.count_other(idle, executing=executing)
            if received or executing:
                received = yield b"", timer.bound(seconds if executing else None)
                continue
            expired = timer.timeout_error(len(requests))
            if expired is not None:
                raise busy or expired
            left -= 1
            if left <= 0:
                raise busy or CallTimeout(function.name, seconds * tries, tries)
            serial = self._take_serial()
            requests[serial] = self._request(function, arguments, serial, first)
            received = yield requests[serial], timer.bound(max(seconds, retry_timeout))

    def raw(self, data: bytes, seconds: float) -> RawOperation:
        """Return a generator that sends bytes unchanged, and returns the packet with the same serial, or ``None``.

        The bytes are sent only once. If they are too short for a serial, the first packet is returned. The serial of
        the next request follows the serial in the bytes, so that a late reply does not match this request.

        Args:
            data: the bytes, which need not be a valid packet.
            seconds: time-out, s; every S_EXECUTING from the controller restarts it.

        Raises:
            ConnectionLost: If the peer has closed the connection.
            ProtocolError: If the received data is not b-CAP, or if too many packets other than the reply were received.
        """
        serial = _serial_of(data)
        if serial:
            self.serial = serial % 0xFFFF + 1
        self._stopped = False
        timer = CallTimer("raw", None, self._clock)
        if self.trace is not None:
            self.trace(">", data)
        self.direct = False
        try:
            received = yield data, seconds
            while received is not None:
                if not received:
                    raise ConnectionLost(
                        tr("{name}: the peer closed the connection before a reply was received", name="raw")
                    )
                frame = self._framer.feed(received)
                wait: float | None = None
                idle = 0
                while frame is not None:
                    if self.trace is not None:
                        self.trace("<", frame)
                    answered, _, code, _ = _SERIAL_AND_CODE(frame, 5)
                    if code == _EXECUTING:
                        wait = seconds
                    elif answered in (serial, 0) or not serial:
                        return frame
                    idle += 1
                    frame = self._framer.next_frame()
                timer.count_other(idle, executing=wait is not None)
                received = yield b"", wait
            return None
        finally:
            self.direct = self._is_direct()

    def close_sequence(self) -> list[tuple[bytes, float]]:
        """Return the Service_Stop packets to send before a UDP link or a serial line is closed.

        The list is empty over TCP, and if no Service_Stop is necessary. Each packet comes with the time to wait for a
        reply, s: always 0, because the client does not wait. Without a reply, the client cannot detect the loss of a
        packet, so the list contains several attempts.
        """
        if self._stopped or not self.profile.lossy:
            return []
        self._stopped = True
        first = self._take_serial()
        serials = [first, *(self._take_serial() for _ in range(_STOP_REPEATS - 1))]
        return [(self._request(service_stop, (), serial, first), 0.0) for serial in serials]

    def _take_serial(self) -> int:
        serial = self.serial
        self.serial = serial % 0xFFFF + 1
        return serial

    def _request(self, function: Function[..., Any], arguments: tuple[Any, ...], serial: int, first: int) -> bytes:
        """Return the packet of one attempt, and pass the packet to the trace callback."""
        request = encode_request(
            function, arguments, serial, first, crc=self.profile.crc, vt_error_size=self._limits.vt_error_size
        )
        if len(request) > self._limits.packet:
            raise _too_long(function, len(request), self._limits, self.profile)
        if self.trace is not None:
            self.trace(">", request)
        return request

    def _result(self, function: Function[..., Any], frame: bytes, count: int, exact: bool) -> Any:
        if function.result is None:
            return None
        if count:
            value, _ = codec.decode(frame, 15, len(frame) - self._tail, self._limits, exact=exact)
        else:  # for some functions, a VE026A returns no value, and an RC8 returns VT_EMPTY
            value = Variant(VarType.EMPTY) if exact else None
        return checked(function, value, exact=exact)


def _serial_of(data: bytes) -> int:
    """Return the serial of a packet that may be malformed; 0 if it is too short."""
    return int.from_bytes(data[5:7], "little") if len(data) >= packet.OVERHEAD else 0


def sign_of_life(handle: int) -> bytes:
    """Return a keep-alive packet that may be sent over TCP during a call; it calls Controller_GetName.

    The server replies E_BUSY_PROC. The client drops this reply, because its serial is 0, which no call uses.
    """
    return encode_request(controller_get_name, (handle,), 0)


def _too_long(function: Function[..., Any], length: int, limits: PacketLimits, profile: BcapProfile) -> InvalidValue:
    by_tcp = tr(" over {name}. Try: use TCP", name=profile.name)
    return InvalidValue(
        tr(
            "{name}: the packet of {length} bytes exceeds the limit of {most} bytes",
            name=function.name,
            length=length,
            most=limits.packet,
        )
        + (by_tcp if limits.packet == profile.packet != STREAM.packet else "")
    )
