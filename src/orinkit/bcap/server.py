"""The server's side of a b-CAP conversation over a stream, without I/O and without a clock.

:class:`ServerConversation` is fed with the bytes received and says what to do: :class:`Send` bytes, :class:`Execute` a
call, :class:`Close` the link. The shell around it executes the call, hands the answer to :meth:`~ServerConversation.finish`,
and calls :meth:`~ServerConversation.tick` when :meth:`~ServerConversation.deadline` has come. One call is executed at a
time; another one meanwhile is answered with E_BUSY_PROC (reference behaviour: docs/protocol.md).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

from orinkit import hresult, variant_bytes
from orinkit.bcap import packet
from orinkit.cao import coerce
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.options import Options
from orinkit.errors import CallError, ProtocolError
from orinkit.variant import Variant
from orinkit.variant_bytes import DEFAULT_LIMITS, Limits

_SERVICE_START: Final = 1
_LEAST_MS: Final = 80
_MOST_ARGUMENTS: Final = max(len(entry.arguments) for entry in FUNCTIONS.values())
_MOST_MS: Final = 0x7FFF_FFFF

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
class Execute:
    """Execute a call, then hand its answer to :meth:`ServerConversation.finish` with this object."""

    serial: int
    function_id: int
    arguments: list[Variant]


Action: TypeAlias = Send | Execute | Close


class ServerConversation:
    """One client's requests and their answers.

    Args:
        limits: bounds on a packet.
        invoke_timeout: seconds that a call may take before it is answered with E_TIMEOUT; a client may set its own with
            ``InvokeTimeout=<ms>``.

    Attributes:
        timed_out: True once the call being executed has been answered with E_TIMEOUT.
        wdt: seconds between S_EXECUTING packets while a call is at work, ``None`` for none; set by ``WDT=<ms>``.
    """

    def __init__(self, limits: Limits = DEFAULT_LIMITS, invoke_timeout: float = 180.0) -> None:
        self.wdt: float | None = None
        self.invoke_timeout = invoke_timeout
        self._default_timeout = invoke_timeout
        self._limits = limits
        self._framer = packet.Framer(limits)
        self._current: Execute | None = None
        self.timed_out = False
        self._next_wdt = 0.0
        self._now = 0.0
        self._give_up = 0.0

    @property
    def busy(self) -> bool:
        """True while a call is being executed."""
        return self._current is not None

    def receive(self, data: bytes, now: float) -> Iterator[Action]:
        """Take bytes of the stream; yields what to do, one thing after the other.

        An :class:`Execute` that is finished before the next action is asked for is not busy any more.

        Args:
            data: what has been received.
            now: the time, in seconds of any steady clock.
        """
        self._now = now
        try:
            frame = self._framer.take(data)
            while frame is not None:
                yield self._request(frame)
                frame = self._framer.next_frame()
        except ProtocolError as error:
            yield Send(packet.pack(0, error.code, 0, b""))
            yield Close(str(error))

    def go_on(self, now: float) -> None:
        """Tell the time before taking up what :meth:`receive` yields again, where that was put off."""
        self._now = now

    def _request(self, frame: bytes) -> Action:
        _, _, serial, _, function_id, count = packet.HEADER.unpack_from(frame)
        if self._current is not None:
            return _answer(serial, hresult.E_BUSY_PROC)
        if _MOST_ARGUMENTS < count <= len(frame) // 10:  # not worth reading: no function has so many
            return _answer(serial, hresult.E_INVALIDARG if function_id in FUNCTIONS else hresult.E_NOTIMPL)
        try:
            arguments, _ = packet.decode_arguments(frame, count, len(frame) - 1, self._limits, exact=True)
        except ProtocolError as error:
            return _answer(serial, error.code)
        if function_id == _SERVICE_START and not self._set_options(arguments):
            return _answer(serial, hresult.E_INVALIDARG)
        self._current = call = Execute(serial, function_id, arguments)
        self.timed_out = False
        self._give_up = self._now + self.invoke_timeout
        if self.wdt is not None:
            self._next_wdt = self._now + self.wdt
        return call

    def _set_options(self, arguments: list[Variant]) -> bool:
        """Read Service_Start's options (RC8 table 3-1); False where a value is not one."""
        if len(arguments) != 1:
            return True  # no options, or what the session will refuse
        try:
            options = Options(coerce.to_text(arguments[0]))
            wdt = options.number("WDT")
            timeout = options.number("InvokeTimeout")
        except ValueError:
            return False
        except CallError as error:
            return error.code == hresult.E_INVALIDARGTYPE  # the session will say so
        if wdt is not None and not _LEAST_MS < wdt <= _MOST_MS:
            return False
        if timeout is not None and not _LEAST_MS <= timeout <= _MOST_MS:
            return False
        self.wdt = None if wdt is None else wdt / 1000
        self.invoke_timeout = self._default_timeout if timeout is None else timeout / 1000
        return True

    def finish(self, call: Execute, code: int, result: Variant | None) -> bytes:
        """Return the packet that answers a call; nothing where it has been answered already, by E_TIMEOUT or here."""
        if call is not self._current:
            return b""
        self._current = None
        if self.timed_out:
            self.timed_out = False
            return b""
        if result is None:
            return packet.pack(call.serial, code, 0, b"")
        try:
            body = variant_bytes.encode_variant(result)
        except Exception:
            logger.exception("the result of function %d cannot be sent", call.function_id)
            return packet.pack(call.serial, hresult.E_FAIL, 0, b"")
        if len(body) + packet.OVERHEAD > self._limits.packet:
            return packet.pack(call.serial, hresult.E_TOO_MUCH_DATA, 0, b"")
        return packet.pack(call.serial, code, 1, body)

    def deadline(self) -> float | None:
        """Return when :meth:`tick` is due next, ``None`` while it is not."""
        if self._current is None or self.timed_out:
            return None
        return self._give_up if self.wdt is None else min(self._next_wdt, self._give_up)

    def tick(self, now: float) -> bytes:
        """Return what is due now: S_EXECUTING, E_TIMEOUT, or nothing yet.

        After E_TIMEOUT the client is answered, but the device is still at work: calls are E_BUSY_PROC until it is done.
        """
        due = self.deadline()
        if self._current is None or due is None or now < due:
            return b""
        if now >= self._give_up:
            self.timed_out = True
            return packet.pack(self._current.serial, hresult.E_TIMEOUT, 0, b"")
        assert self.wdt is not None
        self._next_wdt = now + self.wdt
        return packet.pack(self._current.serial, hresult.S_EXECUTING, 0, b"")


def _answer(serial: int, code: int) -> Send:
    return Send(packet.pack(serial, code, 0, b""))
