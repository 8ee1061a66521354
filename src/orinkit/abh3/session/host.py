"""A host of one ABH3 driver, without I/O: what it remembers, and each function of section 4 as an operation.

An operation is a generator (:mod:`orinkit.can.frame`), which does nothing, and remembers nothing, until it is run. It takes
the answers of its own driver only; other frames do not make it wait any longer, and frames that came before a request are
no answers to it.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Final, Generic, TypeVar, cast

from orinkit.abh3.table import ids
from orinkit.abh3.table.checks import checked, real, whole
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.ids import FrameId
from orinkit.abh3.table.records import BR0, BUF, DP1R, AnyRecord, Feedback, Record
from orinkit.abh3.table.signals import CURRENT, V1, VELOCITY, Dialect, Quantity
from orinkit.can.frame import CanFrame, CanOperation, OperationStep
from orinkit.core.errors import DriverFault, DriverTimeout, InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import brief

F = TypeVar("F", bound=Feedback)
_LENGTH: Final = 8
_ALL_BITS: Final = 0xFFFFFFFF
_SETTLING: Final = 0.005
"""Seconds that a driver gets to clear its errors before it is asked; doubled at each try (it takes about 1 ms)."""
_LONGEST_SETTLING: Final = 0.2
_BEHIND: Final = 0.02
"""Seconds within which two answers follow each other: a driver takes less than 1 ms for one."""
_LOOKING: Final = 0.05
"""Seconds between two looks at whether the motors stand; no driver stops by itself meanwhile."""
_TRIES: Final = 100
_STANDING: Final = 1.0
"""min^-1: what is slower stands, as far as anybody can tell."""


class Host(Generic[F]):
    """What a host knows of one driver.

    The commands and inputs that were sent last are sent again where a function leaves them out (sections 4.2 to 4.5). After
    an answer that did not come both commands are 0 and start is off: no motion goes on that nobody asks for anew.

    Args:
        dialect: of the driver.
        address: of the driver, 0 to 253.
        host: address of this host, 0 to 253.
        group: of the driver's broadcasts, 0 to 31.
        timeout: seconds to wait for an answer.
        priority: of what is sent, 0 (first) to 7.

    Attributes:
        inputs: the input word as it was sent last.
        commanded: how many commands (DP0) there were; only they keep a driver from stopping by itself.

    Raises:
        InvalidValue: a number is out of its range.
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
        self._restless = False
        self._owed = False  # an answer may still come, to a command that nobody waits for any more
        masks = dialect.inputs.masks
        self._starting = masks["start"]
        self._torque = (masks["ay_torque"], masks["bx_torque"])
        self._pack = dialect.layouts["DP0S"].struct.pack
        self._command_id = ids.single(self.address, self.host, priority=self.priority)
        self._feedback_id = ids.single(self.host, self.address)

    # --- what it is told ----------------------------------------------------------------------------------------------

    def accepts(self, frame: CanFrame) -> bool:
        """Whether a frame is from this driver, to this host or to all."""
        number = frame.id
        if number & _SOURCE != self.address:
            return False
        pf = number >> 16 & 0xFF
        return pf == ids.BROADCAST or (pf in _TO_ONE and number >> 8 & 0xFF == self.host)

    @property
    def commands(self) -> tuple[float, float]:
        """The A/Y and the B/X command as they were sent last, in min^-1, or % of an axis whose inputs say torque."""
        return self._quantity(0).decode(self._codes[0]), self._quantity(1).decode(self._codes[1])

    @property
    def moving(self) -> bool:
        """Whether the driver may be at something else than rest: it was asked for, and no answer to an end of it has come."""
        return self._restless

    def abandon(self) -> None:
        """Forget commands and inputs: somebody else is the driver's host now."""
        self.reset_commands()
        self.inputs = 0
        self._restless = False

    def reset_commands(self) -> None:
        """Take back what moves: commands are 0 and start is off in what is sent next, until they are given anew."""
        self._codes = [0, 0]
        self.inputs &= ~self._starting  # a data set with a velocity of its own would go on without a command

    # --- section 4 ----------------------------------------------------------------------------------------------------

    def init(self) -> CanOperation[F]:
        """Commands and inputs 0; returns the feedback (4.1, abh3_can_cmd_init)."""
        self._codes = [0, 0]
        self.inputs = 0
        return (yield from self.exchange("abh3_can_cmd_init"))

    def command(self, ay: float | None = None, bx: float | None = None) -> CanOperation[F]:
        """Commands in min^-1, or % of an axis whose inputs say torque; one that is left out stays (4.2, 4.3).

        Raises:
            InvalidValue: a command is out of its range; nothing has changed.
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
        return (yield from self.exchange(name))

    def set_inputs(self, data: int, mask: int = _ALL_BITS) -> CanOperation[F]:
        """Inputs whose mask is 1 become those of the data (4.4, abh3_can_inSet).

        The command of an axis that changes between speed and torque is 0 from then on: its number would mean another thing.

        Raises:
            InvalidValue: data or mask is no word of 32 bits, unsigned; nothing has changed.
        """
        data, mask = _word("data", data), _word("mask", mask)
        self._change((self.inputs & ~mask) | (data & mask))
        return (yield from self.exchange("abh3_can_inSet"))

    def set_input(self, bit: int | str, value: int) -> CanOperation[F]:
        """One input by its number or name; a name without an axis means both of them (4.5, abh3_can_inBitSet).

        Raises:
            InvalidValue: there is no such input, or the value is not 0 or 1; nothing has changed.
        """
        mask = self.dialect.inputs.mask(bit)
        if (float(value) if isinstance(value, bool) else real(value)) not in (0, 1):
            raise InvalidValue(tr("an input is 0 or 1, not {value}", value=brief(value)))
        self._change(self.inputs | mask if value else self.inputs & ~mask)
        return (yield from self.exchange("abh3_can_inBitSet"))

    def stop(self) -> CanOperation[F]:
        """Commands 0 and start off; the driver decelerates, its servo stays on."""
        self.reset_commands()
        return (yield from self.exchange("abh3_can_cmd"))

    def stop_and_wait(self, seconds: float) -> CanOperation[F]:
        """Commands 0 and start off, again and again until the motors stand; returns the feedback.

        Args:
            seconds: that it may take, about.

        Raises:
            DriverTimeout: no answer, or they still turn.
        """
        for _ in range(max(1, math.ceil(seconds / _LOOKING))):
            record = yield from self.stop()
            velocities = [value for value in _values(record) if isinstance(value, float)]
            if max(map(abs, velocities)) < _STANDING:
                return record
            yield from _wait(_LOOKING)
        raise DriverTimeout("rest", seconds, self.address)

    def exchange(self, function: str = "abh3_can_cmd") -> CanOperation[F]:
        """Send commands and inputs once more (DP0) and return the feedback.

        Raises:
            DriverTimeout: no answer; commands are 0 and start is off from then on, as after a wait that is broken off.
        """
        owed, self._owed = self._owed, True
        try:
            record = yield from self._ask(function, self._command_frame(), "DP0R", self._feedback_id)
            if owed:
                record = yield from self._next_one(record)
            self._owed = False
            self._restless = self._asks()
        except BaseException:  # an answer that does not come; it is broken off, by Ctrl-C or a lost bus
            self.reset_commands()
            raise
        return cast(F, record)

    def request(self, number: int, *, everyone: bool = False) -> CanOperation[AnyRecord]:
        """Request a broadcast and return it (4.7, abh3_can_reqBRD; to all drivers abh3_can_reqBRDBRD).

        Args:
            number: 0 to 7 of the driver's group; or, from 8 on, group * 8 + number as in the document.
            everyone: the request goes to all drivers; the answer of this one is returned.

        Raises:
            InvalidValue: there is no such number.
            DriverTimeout: no answer.
        """
        ps = ids.broadcast_number(number, self.group)
        destination = ids.EVERYONE if everyone else self.address
        sent = self._request_frame(destination, ids.pgn(ids.BROADCAST, ps))
        wanted = int(FrameId(ids.BROADCAST, ps, self.address))
        function = "abh3_can_reqBRDBRD" if everyone else "abh3_can_reqBRD"
        return cast(AnyRecord, (yield from self._ask(function, sent, self._name_of(ps), wanted)))

    def request_single(self, dp: int = 0) -> CanOperation[Feedback | DP1R]:
        """Request a single packet without commanding anything (abh3_can_reqSNG).

        Args:
            dp: 0 for the feedback, 1 for the pulse counts (withheld by the document: many drivers do not answer).

        Raises:
            InvalidValue: another page.
            DriverTimeout: no answer.
        """
        dp = checked("dp", dp, 1)
        sent = self._request_frame(self.address, ids.pgn(ids.SINGLE, 0, dp=dp))
        wanted = ids.single(self.host, self.address, dp=dp)
        record = yield from self._ask("abh3_can_reqSNG", sent, f"DP{dp}R", wanted)
        return cast("Feedback | DP1R", record)

    def reset_errors(self, tries: int = 5) -> CanOperation[BR0]:
        """Clear errors and warnings, with commands, servo and start off, and return what was left: nothing.

        A driver clears on the edge of the reset input from 0 to 1, shortly after it; so this is repeated, ``tries`` times
        at most.

        Raises:
            InvalidValue: tries are not 0 to 100.
            DriverFault: errors or warnings are left.
            DriverTimeout: no answer.
        """
        masks = self.dialect.inputs.masks
        tries = checked("tries", tries, _TRIES)
        self.reset_commands()
        self.inputs &= ~(masks["servo_on"] | masks["error_reset"])
        pause = _SETTLING
        for _ in range(max(1, tries)):
            yield from self.exchange("abh3_can_inBitSet")
            self.inputs |= masks["error_reset"]
            try:
                yield from self.exchange("abh3_can_inBitSet")
            finally:
                self.inputs &= ~masks["error_reset"]
            yield from self.exchange("abh3_can_inBitSet")
            yield from _wait(pause)
            pause = min(2 * pause, _LONGEST_SETTLING)
            found = cast(BR0, (yield from self.request(0)))
            if not found.errors and not found.warnings:
                return found
        texts = tuple(dict.fromkeys((*found.errors.texts, *found.warnings.texts)))
        raise DriverFault(int(found.errors), int(found.warnings), texts)

    def repeat(self, seconds: float) -> CanOperation[bool]:
        """Send commands and inputs once more, as a keep-alive does; returns whether an answer came.

        Args:
            seconds: to wait for it.
        """
        self._owed = True
        received = yield OperationStep((self._command_frame(),), seconds, fresh=True)
        while received is not None:
            if received.id & _MEANT == self._feedback_id and len(received.data) == _LENGTH:
                self._owed = False
                self._restless = self._asks()
                return True
            received = yield OperationStep()
        return False

    def release(self, seconds: float) -> CanOperation[bool]:
        """Have the driver come to rest before the bus is closed, if anything was asked of it; as :meth:`repeat`."""
        if not self.moving:
            return True
        self.reset_commands()
        return (yield from self.repeat(seconds))

    # --- frames -------------------------------------------------------------------------------------------------------

    def _ask(self, function: str, sent: CanFrame, name: str, wanted: int) -> CanOperation[Record]:
        """Send a frame and return the record of the answer."""
        received = yield OperationStep((sent,), self.timeout, True)
        while received is not None:
            if received.id & _MEANT == wanted and len(received.data) == _LENGTH:
                return self.codec.decode(name, received.data) if name else BUF(received.data)
            received = yield OperationStep()
        raise DriverTimeout(function, self.timeout, self.address)

    def _next_one(self, record: Record) -> CanOperation[Record]:
        """Return the feedback that follows at once, if one does: the first was the answer to a command before."""
        received = yield OperationStep((), _BEHIND)
        while received is not None:
            if received.id & _MEANT == self._feedback_id and len(received.data) == _LENGTH:
                return self.codec.decode("DP0R", received.data)
            received = yield OperationStep()
        return record

    def _command_frame(self) -> CanFrame:
        self.commanded += 1
        self._restless = self._restless or self._asks()
        return CanFrame(self._command_id, self._pack(*self._codes, self.inputs))

    def _request_frame(self, destination: int, pgn: bytes) -> CanFrame:
        return CanFrame(ids.request(destination, self.host, priority=self.priority), pgn)

    def _name_of(self, ps: int) -> str:
        layout = self.dialect.broadcasts.get(ps % ids.BROADCASTS)
        return layout.name if layout else ""

    # --- memory -------------------------------------------------------------------------------------------------------

    def _asks(self) -> bool:
        """Whether what is sent now asks for anything but rest."""
        return self._codes != [0, 0] or bool(self.inputs & self._starting)

    def _quantity(self, axis: int) -> Quantity:
        return CURRENT if self.inputs & self._torque[axis] else VELOCITY

    def _change(self, inputs: int) -> None:
        for axis, mask in enumerate(self._torque):
            if (inputs ^ self.inputs) & mask:
                self._codes[axis] = 0
        self.inputs = inputs


_TO_ONE: Final = frozenset((ids.SINGLE, ids.CONTROL, ids.TRANSFER))
_MEANT: Final = 0x03FFFFFF
"""All of an identifier but the priority."""
_SOURCE: Final = 0x020000FF
"""The source address, and the reserved bit, which is 0."""


def broadcasts_of_all(
    codec: Codec, host: int, ps: int, seconds: float, count: int | None = None, priority: int = 0
) -> CanOperation[dict[int, AnyRecord]]:
    """Request a broadcast of all drivers of a group and return their answers by address (4.7, abh3_can_reqBRDBRD).

    Args:
        codec: of their dialect.
        host: address of this host.
        ps: group * 8 + number.
        seconds: to wait for answers.
        count: of drivers; when so many have answered there is no more waiting.
        priority: of the request.
    """
    count = None if count is None else checked("count", count, ids.LAST_ADDRESS + 1)
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
    """Return 32 bits.

    Raises:
        InvalidValue: it is no whole number of 0 to 0xFFFFFFFF.
    """
    number = whole(value)
    if number is not None and 0 <= number <= _ALL_BITS:
        return number
    raise InvalidValue(
        tr(
            "{name} is a word of 32 bits, 0 to 0xFFFFFFFF, not {value}. Try: {name} & 0xFFFFFFFF",
            name=name,
            value=brief(value),
        )
    )
