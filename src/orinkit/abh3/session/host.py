"""The host of one ABH3 driver, without I/O: its state, and the functions of section 4 as operations.

An operation is a generator (:mod:`orinkit.can.frame`). It changes no state until it is run. It accepts replies of its
own driver only. Other frames do not prolong the wait for a reply. A frame that arrived before a request was sent is not
accepted as the reply to this request. Numbers in parentheses, such as 4.1, are sections of the document that
:mod:`orinkit.abh3` names.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Final, Generic, TypeVar, cast

from orinkit.abh3.table import ids
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.ids import FrameId
from orinkit.abh3.table.records import BR0, BUF, DP1R, AnyRecord, Feedback, Record
from orinkit.abh3.table.signals import CURRENT, V1, VELOCITY, Dialect, Quantity
from orinkit.can.frame import CanFrame, CanOperation, OperationStep
from orinkit.core.errors import DriverFault, DriverTimeout, InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_whole, real, whole

F = TypeVar("F", bound=Feedback)
_LENGTH: Final = 8
_ALL_BITS: Final = 0xFFFFFFFF
_SETTLING: Final = 0.005
"""Seconds to wait for a driver to clear its errors; doubled after each attempt. A driver needs about 1 ms."""
_LONGEST_SETTLING: Final = 0.2
_SECOND_REPLY_WAIT: Final = 0.02
"""Seconds to wait for a second reply, if the first may belong to an earlier command. A driver replies within 1 ms."""
_POLL_INTERVAL: Final = 0.05
"""Interval for polling standstill, in s; shorter than any command time-out of a driver."""
_MAX_TRIES: Final = 100
_STANDSTILL: Final = 1.0
"""Velocity in min^-1 below which a motor counts as standing still."""


class Host(Generic[F]):
    """The state of one driver, as its host has recorded it.

    If a call omits a command or an input, the last value is sent again (sections 4.2 to 4.5 of the ABH3 document). If
    the reply to a command is missing, both recorded commands become 0 and start becomes off, so that the next frame
    stops the motion.

    Args:
        dialect: Dialect of the driver.
        address: Address of the driver, 0 to 253.
        host: Address of this host, 0 to 253.
        group: Group of the driver's broadcasts, 0 to 31.
        timeout: Seconds to wait for a reply.
        priority: Priority of the frames that are sent, 0 (highest) to 7.

    Attributes:
        inputs: The input word that was sent last.
        commanded: Number of frames with commands (DP0) that were sent. Only these frames restart the driver's command
            time-out.

    Raises:
        InvalidValue: If an argument is out of range, or if driver and host have the same address.
    """

    def __init__(
        self,
        dialect: Dialect = V1,
        *,
        address: int = 1,
        host: int = 2,
        group: int = 5,
        timeout: float = 1.0,
        priority: int = 0,
    ) -> None:
        self.codec = Codec(dialect)
        self.dialect = dialect
        self.address = ids.check_address("address", address)
        self.host = ids.check_address("host", host)
        if address == host:
            raise InvalidValue(tr("driver and host have the same address {host}", host=host))
        self.group = ids.check_group(group)
        self.timeout = timeout
        self.priority = ids.check_priority(priority)
        self._codes = [0, 0]
        self.inputs = 0
        self.commanded = 0
        self._may_move = False
        self._reply_pending = False  # a reply to an earlier command may still arrive
        masks = dialect.inputs.masks
        self._starting = masks["start"]
        self._torque = (masks["ay_torque"], masks["bx_torque"])
        self._pack = dialect.layouts["DP0S"].struct.pack
        self._command_id = ids.single(self.address, self.host, priority=self.priority)
        self._feedback_id = ids.single(self.host, self.address)

    # --- state --------------------------------------------------------------------------------------------------------

    def accepts(self, frame: CanFrame) -> bool:
        """Return True if a frame is from this driver and for this host or all hosts."""
        number = frame.id
        if number & _SOURCE_MASK != self.address:
            return False
        pf = number >> 16 & 0xFF
        return pf == ids.BROADCAST or (pf in _ADDRESSED_FORMATS and number >> 8 & 0xFF == self.host)

    @property
    def commands(self) -> tuple[float, float]:
        """The A/Y and B/X commands that were sent last, each in min^-1, or in % if its axis is in torque mode."""
        return self._quantity(0).decode(self._codes[0]), self._quantity(1).decode(self._codes[1])

    @property
    def moving(self) -> bool:
        """True if the driver may be moving: motion was commanded, and no reply to a later stop has arrived."""
        return self._may_move

    def relinquish(self) -> None:
        """Set commands and inputs to 0 without sending them, because another host or client now commands the driver."""
        self.reset_commands()
        self.inputs = 0
        self._may_move = False

    def reset_commands(self) -> None:
        """Set the commands to 0 and start to off, without sending them. The next frame contains these values."""
        self._codes = [0, 0]
        self.inputs &= ~self._starting  # with start on, a data set of the driver may move the motor without a command

    # --- section 4 ----------------------------------------------------------------------------------------------------

    def init(self) -> CanOperation[F]:
        """Set commands and inputs to 0 and return the feedback (4.1, abh3_can_cmd_init)."""
        self._codes = [0, 0]
        self.inputs = 0
        return (yield from self.send_commands("abh3_can_cmd_init"))

    def command(self, ay: float | None = None, bx: float | None = None) -> CanOperation[F]:
        """Send commands and return the feedback; an omitted command is unchanged (4.2, 4.3).

        Each command is in min^-1, or in % if its axis is in torque mode.

        Raises:
            InvalidValue: If a command is out of range; nothing has changed.
        """
        codes = self._codes.copy()
        for axis, (name, value) in enumerate((("ay", ay), ("bx", bx))):
            if value is not None:
                try:
                    codes[axis] = self._quantity(axis).encode(value)
                except InvalidValue as error:
                    raise InvalidValue(f"{name}: {error}") from None
        self._codes = codes
        alone = "abh3_can_cmdAY" if bx is None else "abh3_can_cmdBX"
        name = "abh3_can_cmd" if (ay is None) == (bx is None) else alone
        return (yield from self.send_commands(name))

    def set_inputs(self, data: int, mask: int = _ALL_BITS) -> CanOperation[F]:
        """Set the inputs whose mask bit is 1 to the bits of ``data`` (4.4, abh3_can_inSet).

        If an axis changes between velocity and torque mode, its command becomes 0, because the unit of the command
        changes.

        Raises:
            InvalidValue: If data or mask is not an unsigned 32-bit word; nothing has changed.
        """
        data, mask = _word("data", data), _word("mask", mask)
        self._set_input_word((self.inputs & ~mask) | (data & mask))
        return (yield from self.send_commands("abh3_can_inSet"))

    def set_input(self, bit: int | str, value: int) -> CanOperation[F]:
        """Set one input by its number or name; a name without an axis sets both axes (4.5, abh3_can_inBitSet).

        Raises:
            InvalidValue: If the input does not exist, or the value is not 0 or 1; nothing has changed.
        """
        mask = self.dialect.inputs.mask(bit)
        if (float(value) if isinstance(value, bool) else real(value)) not in (0, 1):
            raise InvalidValue(tr("an input must be 0 or 1, not {value}", value=brief(value)))
        self._set_input_word(self.inputs | mask if value else self.inputs & ~mask)
        return (yield from self.send_commands("abh3_can_inBitSet"))

    def stop(self) -> CanOperation[F]:
        """Set the commands to 0 and switch start off. The driver decelerates; its servo stays on."""
        self.reset_commands()
        return (yield from self.send_commands("abh3_can_cmd"))

    def stop_and_wait(self, seconds: float) -> CanOperation[F]:
        """Repeat :meth:`stop` until the motors stand still, and return the feedback.

        Args:
            seconds: Approximate maximum time until standstill, in s.

        Raises:
            DriverTimeout: If the driver does not reply, or if the motors still turn after ``seconds``.
        """
        for _ in range(max(1, math.ceil(seconds / _POLL_INTERVAL))):
            record = yield from self.stop()
            velocities = [value for value in _values(record) if isinstance(value, float)]
            if max(map(abs, velocities)) < _STANDSTILL:
                return record
            yield from _wait(_POLL_INTERVAL)
        raise DriverTimeout("stop_and_wait", seconds, self.address)

    def send_commands(self, function: str = "abh3_can_cmd") -> CanOperation[F]:
        """Send the current commands and inputs (DP0) and return the feedback.

        Raises:
            DriverTimeout: If the driver does not reply. After this and any other exception, the commands are 0 and
                start is off.
        """
        reply_pending, self._reply_pending = self._reply_pending, True
        try:
            record = yield from self._query(function, self._command_frame(), "DP0R", self._feedback_id)
            if reply_pending:
                record = yield from self._later_feedback(record)
            self._reply_pending = False
            self._may_move = self._commands_motion()
        except BaseException:  # a missing reply, Ctrl-C, or a lost bus
            self.reset_commands()
            raise
        return cast(F, record)

    def request(self, number: int, *, everyone: bool = False) -> CanOperation[AnyRecord]:
        """Request a broadcast and return it (4.7, abh3_can_reqBRD; with ``everyone`` abh3_can_reqBRDBRD).

        Args:
            number: Number of the broadcast in the driver's group, 0 to 7; or, as in the document, this number plus 8
                times the group, which must be the driver's.
            everyone: True to send the request to all drivers. Only the reply of this driver is returned.

        Raises:
            InvalidValue: If the number is not valid.
            DriverTimeout: If the driver does not reply.
        """
        ps = ids.broadcast_number(number, self.group)
        destination = ids.EVERYONE if everyone else self.address
        sent = self._request_frame(destination, ids.pgn(ids.BROADCAST, ps))
        wanted = int(FrameId(ids.BROADCAST, ps, self.address))
        function = "abh3_can_reqBRDBRD" if everyone else "abh3_can_reqBRD"
        return cast(AnyRecord, (yield from self._query(function, sent, self._name_of(ps), wanted)))

    def request_single(self, dp: int = 0) -> CanOperation[Feedback | DP1R]:
        """Request a single packet and return it, without sending commands (abh3_can_reqSNG).

        Args:
            dp: 0 for the feedback, 1 for the pulse counts. The document withholds the frame of the pulse counts, and
                many drivers do not reply with it.

        Raises:
            InvalidValue: If ``dp`` is not 0 or 1.
            DriverTimeout: If the driver does not reply.
        """
        dp = check_whole("dp", dp, 1)
        sent = self._request_frame(self.address, ids.pgn(ids.SINGLE, 0, dp=dp))
        wanted = ids.single(self.host, self.address, dp=dp)
        record = yield from self._query("abh3_can_reqSNG", sent, f"DP{dp}R", wanted)
        return cast("Feedback | DP1R", record)

    def reset_errors(self, tries: int = 5) -> CanOperation[BR0]:
        """Set commands to 0, switch servo and start off, clear errors and warnings, and return the error flags.

        A driver clears its errors shortly after the input ``error_reset`` has changed from 0 to 1. If errors or
        warnings remain, the change is repeated, for at most ``tries`` attempts.

        Raises:
            InvalidValue: If ``tries`` is not in 0 to 100.
            DriverFault: If errors or warnings remain.
            DriverTimeout: If the driver does not reply.
        """
        masks = self.dialect.inputs.masks
        tries = check_whole("tries", tries, _MAX_TRIES)
        self.reset_commands()
        self.inputs &= ~(masks["servo_on"] | masks["error_reset"])
        pause = _SETTLING
        for _ in range(max(1, tries)):
            yield from self.send_commands("abh3_can_inBitSet")
            self.inputs |= masks["error_reset"]
            try:
                yield from self.send_commands("abh3_can_inBitSet")
            finally:
                self.inputs &= ~masks["error_reset"]
            yield from self.send_commands("abh3_can_inBitSet")
            yield from _wait(pause)
            pause = min(2 * pause, _LONGEST_SETTLING)
            found = cast(BR0, (yield from self.request(0)))
            if not found.errors and not found.warnings:
                return found
        texts = tuple(dict.fromkeys((*found.errors.texts, *found.warnings.texts)))
        raise DriverFault(int(found.errors), int(found.warnings), texts)

    def repeat(self, seconds: float) -> CanOperation[bool]:
        """Send the current commands and inputs for a keep-alive; return True if the driver replied.

        Args:
            seconds: Seconds to wait for the reply.
        """
        self._reply_pending = True
        received = yield OperationStep((self._command_frame(),), seconds, fresh=True)
        while received is not None:
            if received.id & _ID_MASK == self._feedback_id and len(received.data) == _LENGTH:
                self._reply_pending = False
                self._may_move = self._commands_motion()
                return True
            received = yield OperationStep()
        return False

    def release(self, seconds: float) -> CanOperation[bool]:
        """If the driver may be moving, stop it before the bus is closed.

        Return True if the driver replied or no frame was sent.
        """
        if not self.moving:
            return True
        self.reset_commands()
        return (yield from self.repeat(seconds))

    # --- frames -------------------------------------------------------------------------------------------------------

    def _query(self, function: str, sent: CanFrame, name: str, wanted: int) -> CanOperation[Record]:
        """Send a frame and return the record of the reply."""
        received = yield OperationStep((sent,), self.timeout, True)
        while received is not None:
            if received.id & _ID_MASK == wanted and len(received.data) == _LENGTH:
                return self.codec.decode(name, received.data) if name else BUF(received.data)
            received = yield OperationStep()
        raise DriverTimeout(function, self.timeout, self.address)

    def _later_feedback(self, record: Record) -> CanOperation[Record]:
        """Return the next feedback if it arrives within 20 ms; otherwise return ``record``.

        The feedback ``record`` may be the reply to an earlier command. In this case, the reply to the last command
        follows.
        """
        received = yield OperationStep((), _SECOND_REPLY_WAIT)
        while received is not None:
            if received.id & _ID_MASK == self._feedback_id and len(received.data) == _LENGTH:
                return self.codec.decode("DP0R", received.data)
            received = yield OperationStep()
        return record

    def _command_frame(self) -> CanFrame:
        self.commanded += 1
        self._may_move = self._may_move or self._commands_motion()
        return CanFrame(self._command_id, self._pack(*self._codes, self.inputs))

    def _request_frame(self, destination: int, pgn: bytes) -> CanFrame:
        return CanFrame(ids.request(destination, self.host, priority=self.priority), pgn)

    def _name_of(self, ps: int) -> str:
        layout = self.dialect.broadcasts.get(ps % ids.BROADCASTS)
        return layout.name if layout else ""

    # --- commands and inputs ------------------------------------------------------------------------------------------

    def _commands_motion(self) -> bool:
        """Return True if the current commands and inputs can cause motion."""
        return self._codes != [0, 0] or bool(self.inputs & self._starting)

    def _quantity(self, axis: int) -> Quantity:
        return CURRENT if self.inputs & self._torque[axis] else VELOCITY

    def _set_input_word(self, inputs: int) -> None:
        for axis, mask in enumerate(self._torque):
            if (inputs ^ self.inputs) & mask:
                self._codes[axis] = 0
        self.inputs = inputs


_ADDRESSED_FORMATS: Final = frozenset((ids.SINGLE, ids.CONTROL, ids.TRANSFER))
_ID_MASK: Final = 0x03FFFFFF
"""Mask of an identifier without its priority."""
_SOURCE_MASK: Final = 0x020000FF
"""Mask of the source address and the reserved bit, which is 0."""


def broadcasts_of_all(
    codec: Codec, host: int, ps: int, seconds: float, count: int | None = None, priority: int = 0
) -> CanOperation[dict[int, AnyRecord]]:
    """Request a broadcast from all drivers of a group and return their replies by address.

    This is the function abh3_can_reqBRDBRD of section 4.7 of the ABH3 document.

    Args:
        codec: Codec of the drivers' dialect.
        host: Address of this host.
        ps: PS of the broadcast, group * 8 + number.
        seconds: Seconds to wait for replies.
        count: Number of drivers. The wait ends early when this many drivers have replied; ``None`` to wait for
            ``seconds`` in any case.
        priority: Priority of the request.
    """
    count = None if count is None else check_whole("count", count, ids.LAST_ADDRESS + 1)
    layout = codec.dialect.broadcasts.get(ps % ids.BROADCASTS)
    sent = CanFrame(ids.request(ids.EVERYONE, host, priority=priority), ids.pgn(ids.BROADCAST, ps))
    found: dict[int, AnyRecord] = {}
    received = yield OperationStep((sent,), seconds, fresh=True)
    while received is not None:
        parts = FrameId.parse(received.id)
        if parts._replace(priority=0, sa=0) == FrameId(ids.BROADCAST, ps, 0) and len(received.data) == _LENGTH:
            record = codec.decode(layout.name, received.data) if layout else BUF(received.data)
            found[parts.sa] = cast(AnyRecord, record)
            if count is not None and len(found) >= count:
                break
        received = yield OperationStep()
    return found


def _values(record: Feedback) -> list[object]:
    return [getattr(record, each.name) for each in fields(record)]


def _wait(seconds: float) -> CanOperation[None]:
    received = yield OperationStep((), seconds)
    while received is not None:
        received = yield OperationStep()


def _word(name: str, value: object) -> int:
    """Return a value as an unsigned 32-bit word.

    Raises:
        InvalidValue: If the value is not a whole number from 0 to 0xFFFFFFFF.
    """
    number = whole(value)
    if number is not None and 0 <= number <= _ALL_BITS:
        return number
    raise InvalidValue(
        tr(
            "{name} must be a 32-bit word, 0 to 0xFFFFFFFF, not {value}. Try: {name} & 0xFFFFFFFF",
            name=name,
            value=brief(value),
        )
    )
