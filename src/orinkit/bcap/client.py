"""The client's side of a b-CAP conversation, without I/O.

:meth:`BcapConversation.call` is a generator. It yields ``(data, seconds)``: send these bytes (if any), then wait for bytes
until that many seconds have passed; ``None`` for the seconds means that the wait in force goes on. What comes back from
the ``yield`` are the bytes received, ``b""`` when the other side has closed, ``None`` when the time is up. It returns
the return code and the result. The two drivers in :mod:`orinkit.transport` do the waiting.

Where packets may be lost (:mod:`orinkit.bcap.profiles`) a request that is not answered is repeated; the controller knows it
again by the reserved field and carries it out once.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator
from dataclasses import replace
from operator import call as _apply
from typing import Any, Final, TypeAlias

from orinkit.bcap import packet
from orinkit.bcap.profiles import SILENCE, STREAM, BcapProfile
from orinkit.cao.call_limits import CallTimer, Clock, standing
from orinkit.cao.dialect import RC8, Dialect
from orinkit.cao.functions import controller_get_name, service_stop
from orinkit.cao.replies import Trace, checked, no_answer
from orinkit.cao.table import Argument, Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, InvalidValue, error_for
from orinkit.core.i18n import tr
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.variant import Variant, VarType, variant

Exchange: TypeAlias = tuple[bytes, float | None]
Operation: TypeAlias = Generator[Exchange, bytes | None, tuple[int, Any]]

_SERIAL_AND_CODE: Final = struct.Struct("<HHIH").unpack_from  # serial, reserved, code, argument count: at offset 5
_HEADER: Final = packet.HEADER.pack
_FAILED: Final = 0x8000_0000
_EXECUTING: Final = hresult.S_EXECUTING
_FAREWELLS: Final = 3


class BcapConversation:
    """One client's requests and replies over one link, one at a time.

    Args:
        limits: bounds on a packet; those of the profile count too.
        trace: see below.
        profile: how packets travel.
        dialect: of the controller; may be set once it is known.
        clock: tells the time, for deadlines and floods.

    Attributes:
        stray_replies: replies that answered no waiting call: late, repeated, or foreign.
        trace: if set, is told every packet.
        profile: how packets travel.
        echoes_reserved: whether the last answer had its request's reserved field, as those of a VE026A have (UDP, serial lines).
    """

    def __init__(
        self,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        profile: BcapProfile = STREAM,
        dialect: Dialect = RC8,
        clock: Clock = standing,
    ) -> None:
        self.stray_replies = 0
        self._clock = clock
        self.trace = trace
        self.profile = profile
        self._limits = profile.bound(limits)
        self._framer = profile.framer(self._limits)
        self._tail = profile.tail
        self._serial = 1
        self.echoes_reserved = False
        self._stopped = True  # the controller has been told that nobody is here, or never that somebody is
        self.dialect = dialect

    @property
    def dialect(self) -> Dialect:
        """Dialect of the controller."""
        return self._dialect

    @dialect.setter
    def dialect(self, dialect: Dialect) -> None:
        self._dialect = dialect
        if dialect.error_size != self._limits.error_size:
            self._limits = replace(self._limits, error_size=dialect.error_size)

    @property
    def serial(self) -> int:
        """Serial number of the next request; may be set where another process has made requests on the same link."""
        return self._serial

    @serial.setter
    def serial(self, number: int) -> None:
        self._serial = number

    @property
    def skipped(self) -> int:
        """Bytes received outside any packet."""
        return self._framer.skipped

    def call(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        *,
        exact: bool = False,
        tries: int = 1,
        later: float = 0.0,
        deadline: float | None = None,
    ) -> Operation:
        """Call a function; returns a generator, see the module's docstring.

        Args:
            function: an entry of the table.
            arguments: as :meth:`~orinkit.cao.table.Function.bind` gives them.
            seconds: time-out of one try; every S_EXECUTING from the controller starts it anew.
            exact: give the result as a :class:`~orinkit.values.variant.Variant`.
            tries: how often the request is sent in all, where packets may be lost (RC8 table 5-1: TORetry); every
                S_EXECUTING allows as many again.
            later: least time-out of the tries after the first one: a line that noise has put out of step has to fall
                silent before the other side finds its place again.
            deadline: seconds that the call may take in all, whatever the controller says; ``None`` for no such limit.

        Raises:
            InvalidValue: an argument does not fit; nothing was sent.
            CallTimeout: no answer in time. An answer that comes later is dropped, it never answers another call.
            ConnectionLost: the other side closed.
            ProtocolError: what came is not b-CAP, or not what the function returns; or too much came that is no answer.
            CallError: the controller answered with an error code.
        """
        if self.profile.lossy:
            return self._call_lossy(function, arguments, seconds, exact, tries, later, deadline)
        return self._call_stream(function, arguments, seconds, exact, deadline)

    def _call_stream(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        deadline: float | None,
    ) -> Operation:
        serial = self._take_serial()
        request = self._request(function, arguments, serial, 0)
        # a call that is answered at once needs no clock
        patience = None if deadline is None else CallTimer(function.name, deadline, self._clock)
        received = yield request, seconds if patience is None else patience.bound(seconds)
        framer = self._framer
        while True:
            if not received:
                late = patience.end() if received is None and patience is not None else None
                raise late or no_answer(function, received, seconds)
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
                patience = patience or CallTimer(function.name, None, self._clock)
                patience.heard(idle, executing=wait is not None)
                wait = patience.bound(wait)
            received = yield b"", wait

    def _call_lossy(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        tries: int,
        later: float,
        deadline: float | None,
    ) -> Operation:
        first = serial = self._take_serial()
        requests = {serial: self._request(function, arguments, serial, first)}
        framer, left, seen = self._framer, tries, 0
        self._stopped = False
        busy: CallError | None = None
        patience = CallTimer(function.name, deadline, self._clock)
        received = yield requests[serial], patience.bound(seconds)
        while True:
            if received is None and framer.pending > seen and framer.partial_serial in requests:
                seen = framer.pending  # a long answer over a slow line is still coming
                received = yield b"", patience.bound(SILENCE)
                continue
            if received == b"":
                raise no_answer(function, received, seconds)
            seen, executing = 0, False
            idle = 0
            # noise before an answer may have kept it from being seen until the time was up
            frame = framer.feed(received) if received else framer.timeout()
            while frame is not None:
                if self.trace is not None:
                    self.trace("<", frame)
                answered, reserved, code, count = _SERIAL_AND_CODE(frame, 5)
                if requests.get(answered, frame) == frame:  # foreign, or a line that gives back what is sent
                    self.stray_replies += 1
                    idle += 1
                elif code == _EXECUTING:
                    executing, left = True, tries
                    idle += 1
                elif len(requests) > 1 and code == self._dialect.busy != 0:
                    busy = error_for(code, "", function.name, arguments)
                elif code >= _FAILED:
                    raise error_for(code, "", function.name, arguments)
                else:
                    self.echoes_reserved = bool(reserved)
                    self._stopped = function is service_stop
                    return code, self._result(function, frame, count, exact)
                frame = framer.next_frame()
            if not idle and received and not self.profile.shared:
                idle = 1  # an empty datagram; a serial line brings every byte on its own
            patience.heard(idle, executing=executing)
            if received or executing:
                received = yield b"", patience.bound(seconds if executing else None)
                continue
            late = patience.end(len(requests))
            if late is not None:
                raise busy or late
            left -= 1
            if left <= 0:
                raise busy or CallTimeout(function.name, seconds * tries, tries)
            serial = self._take_serial()
            requests[serial] = self._request(function, arguments, serial, first)
            received = yield requests[serial], patience.bound(max(seconds, later))

    def close_sequence(self) -> list[tuple[bytes, float]]:
        """Return packets to be sent where a connection is closed that does not tell of its end: Service_Stop.

        Beside each how many seconds to wait for an answer: none, so it is said more than once.
        """
        if self._stopped or not self.profile.lossy:
            return []
        self._stopped = True
        first = self._take_serial()
        serials = [first, *(self._take_serial() for _ in range(_FAREWELLS - 1))]
        return [(self._request(service_stop, (), serial, first), 0.0) for serial in serials]

    def _take_serial(self) -> int:
        serial = self._serial
        self._serial = serial % 0xFFFF + 1
        return serial

    def _request(self, function: Function[..., Any], arguments: tuple[Any, ...], serial: int, first: int) -> bytes:
        """Return the packet of a try, which the trace is told."""
        request = encode_request(
            function, arguments, serial, first, crc=self.profile.crc, error_size=self._limits.error_size
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
        else:  # a VE026A answers nothing where an RC8 answers VT_EMPTY
            value = Variant(VarType.EMPTY) if exact else None
        return checked(function, value, exact=exact)


def sign_of_life(handle: int) -> bytes:
    """Return a packet that may be sent over a stream while a call is under way, to be heard: Controller_GetName.

    Its serial is 0, which no call has, so its answer (E_BUSY_PROC) is dropped.
    """
    return encode_request(controller_get_name, (handle,), 0)


def _too_long(function: Function[..., Any], length: int, limits: PacketLimits, profile: BcapProfile) -> InvalidValue:
    by_tcp = tr(" ({name}; with TCP there is room)", name=profile.name)
    return InvalidValue(
        tr(
            "{name}: the arguments make a packet of {length} bytes, at most {most} can be sent",
            name=function.name,
            length=length,
            most=limits.packet,
        )
        + (by_tcp if limits.packet == profile.packet != STREAM.packet else "")
    )


def encode_request(
    function: Function[..., Any],
    arguments: tuple[Any, ...],
    serial: int,
    reserved: int = 0,
    *,
    crc: bool = False,
    error_size: int = DEFAULT_LIMITS.error_size,
) -> bytes:
    """Return the packet of a call.

    Args:
        function: an entry of the table.
        arguments: as :meth:`~orinkit.cao.table.Function.bind` gives them.
        serial: of this try.
        reserved: of the first try, where packets may be lost.
        crc: for a serial line.
        error_size: bytes of a VT_ERROR.

    Raises:
        InvalidValue: an argument does not fit its type; the message names function and argument.
    """
    encoders = _ENCODERS.get(function.id) or _learn(function)
    if error_size != DEFAULT_LIMITS.error_size:
        encoders = tuple(_sized(each, error_size) for each in encoders)
    try:
        body = b"".join(map(_apply, encoders, arguments))  # stops at the last one given: optional ones may be missing
    except (InvalidValue, TypeError) as error:
        raise _explain(function, arguments, error) from None
    if crc:
        return packet.pack(serial, function.id, len(arguments), body, reserved, crc=True)
    head = _HEADER(packet.SOH, len(body) + packet.OVERHEAD, serial, reserved, function.id, len(arguments))
    return head + body + b"\x04"


_BY_TYPE: Final[dict[VarType, Callable[[Any], bytes]]] = {
    VarType.I4: codec.encode_integer,
    VarType.R4: codec.encode_single,
    VarType.BSTR: codec.encode_string,
    VarType.VARIANT: codec.encode,
}
_ENCODERS: Final[dict[int, tuple[Callable[[Any], bytes], ...]]] = {}


def _learn(function: Function[..., Any]) -> tuple[Callable[[Any], bytes], ...]:
    encoders = _ENCODERS[function.id] = tuple(map(_encoder, function.arguments))
    return encoders


def _encoder(argument: Argument) -> Callable[[Any], bytes]:
    return codec.encode_handle if argument.is_handle else _BY_TYPE[argument.vt]


def _sized(encoder: Callable[[Any], bytes], error_size: int) -> Callable[[Any], bytes]:
    """Return an encoder for which a VT_ERROR has another size; only in a VARIANT can there be one."""
    if encoder is not codec.encode:
        return encoder
    return lambda value: codec.encode_variant(variant(value), error_size)


def _explain(function: Function[..., Any], arguments: tuple[Any, ...], error: Exception) -> InvalidValue:
    """Say which argument was wrong; only when one was."""
    for number, (argument, value) in enumerate(zip(function.arguments, arguments, strict=False), 1):
        try:
            _BY_TYPE[argument.vt](value)
        except (InvalidValue, TypeError) as reason:
            return InvalidValue(function.where(number) + str(reason))
    return InvalidValue(f"{function.name}: {error}")
