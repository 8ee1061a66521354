"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``driver.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from time import monotonic
from types import TracebackType
from typing import Any, Final, Generic, Literal, Self, TypeVar, overload

from orinkit.abh3.api._sync.shared import SharedBus
from orinkit.abh3.api.keepalive_runner import PeriodicCall
from orinkit.abh3.session import parameter_value, telabh3
from orinkit.abh3.session.host import Host
from orinkit.abh3.session.keepalive import KeepAliveEnd, KeepAliveTimer, watched
from orinkit.abh3.session.parameter_value import ParameterValue
from orinkit.abh3.table.checks import check_seconds
from orinkit.abh3.table.decoder import DecodedFrame
from orinkit.abh3.table.records import BR0, BR2, BR3, BR4, BR5, BR6, DP1R, AnyRecord, Feedback, Flags, States
from orinkit.can.frame import CanOperation
from orinkit.can.shared_bus import CanReceiver
from orinkit.core.errors import DriverTimeout, OrinError
from orinkit.transport.link_errors import closed

F = TypeVar("F", bound=Feedback)
S = TypeVar("S", bound=States)
R = TypeVar("R")
_GOODBYE: Final = 0.1
"""Seconds to wait for a driver's answer before the bus is closed."""


class Driver(Generic[F, S]):
    """One ABH3 driver on a bus; :func:`connect` and :meth:`MotorBus.driver` make it.

    Velocities are in min^-1, currents and loads in %, supplies and analog inputs in V. A call sends one frame and waits for
    the driver's answer to it; several threads may use one driver. Commands and inputs that a call leaves out are those that
    were sent last.

    When an answer does not come in time, or the bus breaks, commands are 0 and start is off from then on: what moves is for
    the program to say anew. The bus is opened again by the next call if it was opened here.

    Args:
        bus: that it is on.
        host: what is known of it.
        owner: closing the driver closes the bus too.

    Attributes:
        bus: that it is on.
        host: what is known of it.
    """

    def __init__(self, bus: SharedBus, host: Host[F], *, owner: bool = False) -> None:
        self.bus = bus
        self.host = host
        self._owner = owner
        self._port: CanReceiver = bus.enter(self)
        self._lock = threading.RLock()
        self._heart: KeepAliveTimer | None = None
        self._keeper: PeriodicCall | None = None
        self._ended: DriverTimeout | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.address} on {self.bus.url}>"

    # --- what is known ------------------------------------------------------------------------------------------------

    @property
    def address(self) -> int:
        """Address of the driver."""
        return self.host.address

    @property
    def inputs(self) -> Flags:
        """The inputs as they were sent last."""
        return Flags(self.host.inputs, self.host.dialect.inputs)

    @property
    def commands(self) -> tuple[float, float]:
        """The A/Y and the B/X command as they were sent last, in min^-1, or % of an axis whose inputs say torque."""
        return self.host.commands

    # --- commands and inputs (4.1 to 4.5) -----------------------------------------------------------------------------

    def init(self) -> F:
        """Send commands and inputs that are all 0, and return the feedback (4.1, abh3_can_cmd_init).

        Raises:
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.init(), calming=True)

    def command(self, ay: float | None = None, bx: float | None = None) -> F:
        """Send commands and return the feedback (4.2, 4.3, abh3_can_cmdAY, cmdBX, cmd).

        Args:
            ay: A/Y command in min^-1, -6553.6 to 6553.4, rounded to 0.2; or in %, -327.68 to 327.67, where the input
                ``ay_torque`` is 1. Left out it is as before.
            bx: the same for B/X.

        Raises:
            InvalidValue: a command is out of its range; nothing was sent.
            DriverTimeout: no answer; whether the driver took the command is not known. Both are 0 and start is off from now on.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.command(ay, bx))

    def set_inputs(self, data: int, mask: int = 0xFFFFFFFF) -> F:
        """Send the inputs whose mask is 1, and return the feedback (4.4, abh3_can_inSet).

        Raises:
            InvalidValue: data or mask is no word of 32 bits; nothing was sent.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.set_inputs(data, mask))

    def set_input(self, bit: int | str, value: int) -> F:
        """Send one input, by number or name, and return the feedback (4.5, abh3_can_inBitSet).

        Args:
            bit: 0 to 31, or a name: ``ay_servo_on``, ``bx_start``, ``error_reset`` ...; without an axis it is that of both:
                ``servo_on``, ``start``. The names are in :attr:`Dialect.inputs`.
            value: 0, 1, ``False`` or ``True``.

        Raises:
            InvalidValue: there is no such input or value; nothing was sent.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.set_input(bit, value))

    def stop(self) -> F:
        """Send commands 0 and start off, and return the feedback: the driver decelerates, its servo stays on.

        Raises:
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.stop(), calming=True)

    def stop_and_wait(self, seconds: float = 5.0) -> F:
        """Send commands 0 and start off until both motors stand, and return the feedback; the servo stays on.

        Args:
            seconds: that it may take.

        Raises:
            InvalidValue: there are no such seconds.
            DriverTimeout: no answer, or the motors still turn.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.stop_and_wait(check_seconds("seconds", seconds)), calming=True)

    def reset_errors(self, tries: int = 5) -> BR0:
        """Clear errors and warnings; commands are 0, servo and start off after it.

        A driver that has not heard of a host for a second has an error, and keeps it until it is reset: a program begins
        with this.

        Args:
            tries: how often it may be tried, 0 to 100; once at least.

        Raises:
            InvalidValue: there are no such tries; nothing was sent.
            DriverFault: errors or warnings are left.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.reset_errors(tries), calming=True)

    # --- requests (4.6, 4.7) ------------------------------------------------------------------------------------------

    @overload
    def request_broadcast(self, number: Literal[0], *, everyone: bool = False) -> BR0: ...

    @overload
    def request_broadcast(self, number: Literal[1], *, everyone: bool = False) -> S: ...

    @overload
    def request_broadcast(self, number: Literal[2], *, everyone: bool = False) -> BR2: ...

    @overload
    def request_broadcast(self, number: Literal[3], *, everyone: bool = False) -> BR3: ...

    @overload
    def request_broadcast(self, number: Literal[4], *, everyone: bool = False) -> BR4: ...

    @overload
    def request_broadcast(self, number: Literal[5], *, everyone: bool = False) -> BR5: ...

    @overload
    def request_broadcast(self, number: Literal[6], *, everyone: bool = False) -> BR6: ...

    @overload
    def request_broadcast(self, number: int, *, everyone: bool = False) -> AnyRecord: ...

    def request_broadcast(self, number: int, *, everyone: bool = False) -> Any:
        """Request a broadcast and return it (4.7, abh3_can_reqBRD; with ``everyone`` abh3_can_reqBRDBRD).

        Args:
            number: 0 to 6 of the driver's group; or, from 8 on, group * 8 + number as in the document.
            everyone: the request goes to all drivers; the answer of this one is returned.

        Raises:
            InvalidValue: there is no such number.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.request(number, everyone=everyone))

    @overload
    def request_single(self, dp: Literal[0] = 0) -> F: ...

    @overload
    def request_single(self, dp: int) -> F | DP1R: ...

    def request_single(self, dp: int = 0) -> Any:
        """Request a single packet without commanding anything (abh3_can_reqSNG).

        It does not keep a driver from stopping by itself: commands only do.

        Args:
            dp: 0 the feedback, 1 the pulse counts (2.2, withheld by the document: :meth:`pulses` has them too).

        Raises:
            InvalidValue: there is no such page.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return self._run(self.host.request_single(dp))

    def errors(self) -> BR0:
        """Request errors and warnings (2.3), as :meth:`request_broadcast`."""
        return self.request_broadcast(0)

    def states(self) -> S:
        """Request control and I/O flags (2.4), as :meth:`request_broadcast`."""
        return self.request_broadcast(1)

    def velocities(self) -> BR2:
        """Request velocities in min^-1 (2.5), as :meth:`request_broadcast`."""
        return self.request_broadcast(2)

    def currents(self) -> BR3:
        """Request currents and loads in % (2.6), as :meth:`request_broadcast`."""
        return self.request_broadcast(3)

    def pulses(self) -> BR4:
        """Request the pulse counts (2.7), as :meth:`request_broadcast`."""
        return self.request_broadcast(4)

    def analog(self) -> BR5:
        """Request analog inputs and supplies in V (2.8), as :meth:`request_broadcast`."""
        return self.request_broadcast(5)

    def monitors(self) -> BR6:
        """Request what the driver monitors (2.9), as :meth:`request_broadcast`."""
        return self.request_broadcast(6)

    # --- parameters (TelABH3 over multi-packet messages) --------------------------------------------------------------

    def exchange_message(self, message: bytes) -> bytes:
        """Send a multi-packet message and return the driver's.

        Args:
            message: at most 1785 bytes; TelABH3 text as :mod:`orinkit.abh3.session.telabh3` makes it.

        Raises:
            InvalidValue: it is empty, too long, or no bytes; nothing was sent.
            ProtocolError: the driver has broken it off.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        self._check_open()
        self.feed()
        return self.bus.exchange(message, self.host)

    def read_parameter(self, address: int) -> ParameterValue:
        """Read a parameter of the driver.

        Args:
            address: 0 to 0xFFFF; those that are known are in :data:`orinkit.abh3.session.telabh3.PARAMETERS`.

        Raises:
            InvalidValue: there is no such address.
            DriverRefused: the driver refuses it.
            ProtocolError: the driver has broken it off, or answers something else.
            DriverTimeout: no answer.
            TransportError: the bus is broken, or closed.
        """
        return parameter_value.parameter(address, (self._ask(telabh3.read_parameter(address))).word)

    def write_parameter(self, address: int, value: float, *, raw: bool = False) -> None:
        """Write a parameter of the driver.

        Args:
            address: as of :meth:`read_parameter`.
            value: in the parameter's unit.
            raw: the value is the word of 32 bits itself.

        Raises:
            InvalidValue: value or address cannot be; nothing was sent.
            DriverRefused, ProtocolError, DriverTimeout, TransportError: as of :meth:`read_parameter`.
        """
        word = parameter_value.word_of(address, value, raw=raw)
        (self._ask(telabh3.write_parameter(address, word))).confirmed()

    def read_monitor(self, address: int) -> ParameterValue:
        """Read a value that the driver monitors; as :meth:`read_parameter`.

        Args:
            address: 0 to 0xFFFF; those that are known are in :data:`orinkit.abh3.session.telabh3.MONITORS`.
        """
        return parameter_value.monitor(address, (self._ask(telabh3.read_monitor(address))).word)

    def read_identification(self, number: int = telabh3.VERSION) -> str:
        """Return an identification of the driver, by default its version; as :meth:`read_parameter`."""
        return (self._ask(telabh3.read_identification(number))).confirmed()

    def _ask(self, request: bytes) -> telabh3.TelReply:
        """Send a TelABH3 text and return the driver's answer, which knows what it is about."""
        answer = self.exchange_message(request)
        return telabh3.parse_reply(answer, f"ABH3 {self.address}, {telabh3.parse_request(request)}")

    # --- keep-alive ---------------------------------------------------------------------------------------------------

    def keep_alive(self, period: float = 0.1, *, patience: float = 0.5, idle: float | None = None) -> None:
        """Send commands and inputs again in the background, so that the driver does not stop by itself.

        It ends when the driver does not answer for ``patience`` seconds, when the program does not call for ``idle``
        seconds, and with the program. Commands are 0 then; the next call after a driver's silence raises DriverTimeout.

        Args:
            period: s between commands, 0.001 or more; well below the driver's time-out of 500 ms.
            patience: s.
            idle: s; ``None``: a program that hangs may hold the motor at its speed.

        Raises:
            InvalidValue: a number is not positive, or more than an hour; the period is below 1 ms, or not below the patience.
        """
        heart = KeepAliveTimer(period, patience, idle, monotonic())
        self._check_open()
        self.end_keep_alive()
        self._heart = heart
        self._keeper = PeriodicCall(self._beat, self._left, f"orinkit-abh3-{self.address}")

    def end_keep_alive(self) -> None:
        """End it; the driver stops by itself if no commands come. One that has ended by itself is told of no more."""
        self._ended = None
        keeper = self._take_keeper()
        if keeper is not None:
            keeper.join()

    def _take_keeper(self) -> PeriodicCall | None:
        keeper, self._keeper, self._heart = self._keeper, None, None
        if keeper is not None:
            keeper.stop()
        return keeper

    def _left(self) -> None:
        """The keep-alive has ended with whoever began it, or by an exception."""
        if self._heart is not None:
            self._heart = None
            self.host.reset_commands()

    @property
    def kept_alive(self) -> bool:
        """Whether a keep-alive is at work."""
        return self._heart is not None

    def _beat(self) -> float | None:
        """Send the command again if that is due; returns the seconds until the next time."""
        with self._lock:
            heart = self._heart
            if heart is None:
                return None
            now = monotonic()
            end = heart.too_late(now)  # first: a driver that has stopped by itself does not start again by itself
            if end is None and heart.due <= now:
                self._send_again(heart)
            end = end or heart.end(monotonic())
            if end is not None:
                self._end(end, heart)
                return None
            return max(0.0, heart.due - monotonic())

    def _send_again(self, heart: KeepAliveTimer) -> None:
        began = monotonic()
        try:
            answered = self.bus.run(self.host.repeat(heart.period), self._port, revive=False)
        except OrinError:
            answered = False
        heart.sent(began, answered=answered)

    def _end(self, end: KeepAliveEnd, heart: KeepAliveTimer) -> None:
        self._heart = None
        if end is KeepAliveEnd.SILENT:
            self._ended = DriverTimeout("keep_alive", heart.patience, self.address)
        self._part()

    # --- the bus ------------------------------------------------------------------------------------------------------

    def listen(self, seconds: float | None = None) -> Iterator[DecodedFrame]:
        """Yield every frame on the bus, decoded, those of others too; as :meth:`MotorBus.listen`."""
        return self.bus.listen(seconds, dialect=self.host.dialect, hosts=(self.host.host,))

    def close(self) -> None:
        """Have the driver come to rest, end the keep-alive, and close the bus if it was opened for this driver (4.8).

        A driver that was asked for nothing is left alone. May be called again.
        """
        keeper = self._take_keeper()
        try:
            self.release()
        finally:
            self._port.close()
            try:
                if self._owner:
                    self.bus.close()
            finally:
                if keeper is not None:
                    keeper.join()

    def release(self) -> None:
        """End the keep-alive, and have the driver come to rest if it was asked to move; for its bus."""
        self._take_keeper()
        with self._lock:
            self._part()

    def _part(self) -> None:
        if self._port.closed:
            return
        try:
            self.bus.run(self.host.release(_GOODBYE), self._port, revive=False)
        except OrinError:
            self.host.reset_commands()

    def abandon(self) -> None:
        """Forget commands and inputs, and end the keep-alive; nothing is sent. For one whose driver has another host now."""
        self._take_keeper()
        self.host.abandon()

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        return self._port.closed

    def _check_open(self) -> None:
        if self._port.closed:
            raise closed()

    def feed(self) -> None:
        """Tell the keep-alive that the program is there, as every call does."""
        heart = self._heart
        if heart is not None:
            heart.called(monotonic())

    def _run(self, operation: CanOperation[R], *, calming: bool = False) -> R:
        """Carry out an operation.

        Args:
            operation: what to do.
            calming: it moves nothing, so that it is carried out even if a keep-alive has ended that nobody was told of.
        """
        with self._lock:
            ended, self._ended = self._ended, None
            if ended is not None and not calming:
                operation.close()
                raise ended
            self.feed()
            heart = self._heart
            return self.bus.run(
                operation if heart is None else watched(operation, heart, self.host, monotonic), self._port
            )
