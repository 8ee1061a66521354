"""ABH3 drivers in asyncio: the functions of section 4 of the document.

Numbers in parentheses, such as 4.1, are sections of the document that :mod:`orinkit.abh3` names.

The synchronous version is generated from this file by ``tools/make_sync.py``.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from time import monotonic
from typing import Any, Final, Generic, Literal, TypeVar, overload

from orinkit.abh3.api._async.parameters import AsyncParameterAccess
from orinkit.abh3.api._async.shared import AsyncSharedBus
from orinkit.abh3.api.keepalive_runner import AsyncPeriodicCall
from orinkit.abh3.session.host import Host
from orinkit.abh3.session.keepalive import KeepAliveEnd, KeepAliveTimer, report_commands
from orinkit.abh3.table.decoder import DecodedFrame
from orinkit.abh3.table.records import BR0, BR2, BR3, BR4, BR5, BR6, DP1R, AnyRecord, Feedback, Flags, States
from orinkit.can.aio_shared_bus import AsyncCanReceiver
from orinkit.can.frame import CanOperation
from orinkit.core.errors import DriverTimeout, OrinError
from orinkit.core.validation import check_seconds
from orinkit.transport.link_errors import closed

F = TypeVar("F", bound=Feedback)
S = TypeVar("S", bound=States)
R = TypeVar("R")
_GOODBYE: Final = 0.1
"""Seconds to wait for the reply to the stop that is sent when a driver is closed or its keep-alive ends."""


class AsyncDriver(AsyncParameterAccess[F], Generic[F, S]):
    """One ABH3 driver on a bus; created by :func:`connect` or :meth:`AsyncMotorBus.driver`.

    Velocities are in min^-1, currents and loads in %, supply voltages and analog inputs in V. A call sends one frame
    and waits for the driver's reply; several tasks may use one driver. Commands and inputs that a call omits keep the
    values that were sent last.

    If the reply to a command is missing or the bus is lost, the next frame with commands sets both commands to 0 and
    switches the input ``start`` off. The program must then send its commands again. If orinkit opened the bus, the next
    call reopens it.

    Numbers in parentheses after a description, such as 4.1, are sections of the ABH3 document.

    Args:
        bus: The bus that the driver is on.
        host: The state of the driver as its host has recorded it: the settings, and the commands and inputs sent last.
        owner: True if closing the driver also closes the bus.

    Attributes:
        bus: The bus that the driver is on.
        host: The state of the driver as its host has recorded it: the settings, and the commands and inputs sent last.
    """

    def __init__(self, bus: AsyncSharedBus, host: Host[F], *, owner: bool = False) -> None:
        self.bus = bus
        self.host = host
        self._owner = owner
        self._port: AsyncCanReceiver = bus.enter(self)
        self._lock = asyncio.Lock()
        self._keep_alive_timer: KeepAliveTimer | None = None
        self._keep_alive_call: AsyncPeriodicCall | None = None
        self._ended: DriverTimeout | None = None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.address} on {self.bus.url}>"

    # --- state --------------------------------------------------------------------------------------------------------

    @property
    def address(self) -> int:
        """Address of the driver."""
        return self.host.address

    @property
    def inputs(self) -> Flags:
        """The inputs that were sent last."""
        return Flags(self.host.inputs, self.host.dialect.inputs)

    @property
    def commands(self) -> tuple[float, float]:
        """The A/Y and B/X commands that were sent last, each in min^-1, or in % if its axis is in torque mode."""
        return self.host.commands

    # --- commands and inputs (4.1 to 4.5) -----------------------------------------------------------------------------

    async def init(self) -> F:
        """Set all commands and inputs to 0 and return the feedback (4.1, abh3_can_cmd_init).

        Raises:
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.init(), causes_motion=False)

    async def command(self, ay: float | None = None, bx: float | None = None) -> F:
        """Send commands and return the feedback (4.2, 4.3, abh3_can_cmdAY, cmdBX, cmd).

        Args:
            ay: A/Y command in min^-1, -6553.6 to 6553.4, rounded to a multiple of 0.2. If the input ``ay_torque`` is 1,
                the command is in %, -327.68 to 327.67. If omitted, the command is unchanged.
            bx: B/X command. Units and ranges are those of ``ay``; the input for torque is ``bx_torque``.

        Raises:
            InvalidValue: If a command is out of range; nothing was sent.
            DriverTimeout: If the driver does not reply. It may still have executed the command. In the next frame, both
                commands are 0 and start is off.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.command(ay, bx))

    async def set_inputs(self, data: int, mask: int = 0xFFFFFFFF) -> F:
        """Set the inputs whose bit in ``mask`` is 1 to the bits of ``data``; return the feedback (4.4, abh3_can_inSet).

        Raises:
            InvalidValue: If data or mask is not a 32-bit word; nothing was sent.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.set_inputs(data, mask))

    async def set_input(self, bit: int | str, value: int) -> F:
        """Set one input, by number or name, and return the feedback (4.5, abh3_can_inBitSet).

        Args:
            bit: 0 to 31, or a name in :attr:`Dialect.inputs`, such as ``ay_servo_on``, ``bx_start`` or ``error_reset``.
                A name without an axis, such as ``servo_on`` or ``start``, sets the inputs of both axes.
            value: 0, 1, ``False`` or ``True``.

        Raises:
            InvalidValue: If there is no such input, or the value is not 0 or 1; nothing was sent.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.set_input(bit, value))

    async def stop(self) -> F:
        """Set the commands to 0, switch start off, and return the feedback. The driver decelerates; its servo stays on.

        Raises:
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.stop(), causes_motion=False)

    async def stop_and_wait(self, seconds: float = 5.0) -> F:
        """Repeat :meth:`stop` until both motors stand still, and return the feedback; the servo stays on.

        Args:
            seconds: Maximum time until standstill, in s.

        Raises:
            InvalidValue: If ``seconds`` is not positive or exceeds one hour.
            DriverTimeout: If the driver does not reply, or if the motors still turn after ``seconds``.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.stop_and_wait(check_seconds("seconds", seconds)), causes_motion=False)

    async def reset_errors(self, tries: int = 5) -> BR0:
        """Clear errors and warnings; afterwards the commands are 0, and servo and start are off.

        A driver that has received no command for one second reports an error until the error is reset. Therefore a
        program calls this method first, before it switches the servo on.

        Args:
            tries: Maximum number of attempts, 0 to 100; with 0, one attempt is made.

        Raises:
            InvalidValue: If tries is out of range; nothing was sent.
            DriverFault: If errors or warnings remain.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.reset_errors(tries), causes_motion=False)

    # --- requests (4.6, 4.7) ------------------------------------------------------------------------------------------

    @overload
    async def request_broadcast(self, number: Literal[0], *, everyone: bool = False) -> BR0: ...

    @overload
    async def request_broadcast(self, number: Literal[1], *, everyone: bool = False) -> S: ...

    @overload
    async def request_broadcast(self, number: Literal[2], *, everyone: bool = False) -> BR2: ...

    @overload
    async def request_broadcast(self, number: Literal[3], *, everyone: bool = False) -> BR3: ...

    @overload
    async def request_broadcast(self, number: Literal[4], *, everyone: bool = False) -> BR4: ...

    @overload
    async def request_broadcast(self, number: Literal[5], *, everyone: bool = False) -> BR5: ...

    @overload
    async def request_broadcast(self, number: Literal[6], *, everyone: bool = False) -> BR6: ...

    @overload
    async def request_broadcast(self, number: int, *, everyone: bool = False) -> AnyRecord: ...

    async def request_broadcast(self, number: int, *, everyone: bool = False) -> Any:
        """Request a broadcast and return it (4.7, abh3_can_reqBRD; with ``everyone`` abh3_can_reqBRDBRD).

        Args:
            number: Number of the broadcast in the driver's group, 0 to 6; or, as in the document, this number plus 8
                times the group, which must be the driver's.
            everyone: True to send the request to all drivers. Only the reply of this driver is returned.

        Raises:
            InvalidValue: If the number is not valid.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.request(number, everyone=everyone))

    @overload
    async def request_single(self, dp: Literal[0] = 0) -> F: ...

    @overload
    async def request_single(self, dp: int) -> F | DP1R: ...

    async def request_single(self, dp: int = 0) -> Any:
        """Request a single packet and return it, without sending commands (abh3_can_reqSNG).

        A request does not restart the driver's command time-out; only commands do.

        Args:
            dp: 0 for the feedback, 1 for the pulse counts (2.2). The document withholds the frame of the pulse counts,
                and many drivers do not send it; :meth:`pulses` requests the same counts by a broadcast.

        Raises:
            InvalidValue: If ``dp`` is not 0 or 1.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return await self._run(self.host.request_single(dp))

    async def errors(self) -> BR0:
        """Request errors and warnings (2.3) by :meth:`request_broadcast`."""
        return await self.request_broadcast(0)

    async def states(self) -> S:
        """Request control and I/O flags (2.4) by :meth:`request_broadcast`."""
        return await self.request_broadcast(1)

    async def velocities(self) -> BR2:
        """Request velocities in min^-1 (2.5) by :meth:`request_broadcast`."""
        return await self.request_broadcast(2)

    async def currents(self) -> BR3:
        """Request currents and loads in % (2.6) by :meth:`request_broadcast`."""
        return await self.request_broadcast(3)

    async def pulses(self) -> BR4:
        """Request the pulse counts (2.7) by :meth:`request_broadcast`."""
        return await self.request_broadcast(4)

    async def analog(self) -> BR5:
        """Request analog inputs and supply voltages in V (2.8) by :meth:`request_broadcast`."""
        return await self.request_broadcast(5)

    async def monitors(self) -> BR6:
        """Request the two monitored values of the driver (2.9) by :meth:`request_broadcast`."""
        return await self.request_broadcast(6)

    # --- keep-alive ---------------------------------------------------------------------------------------------------

    async def keep_alive(self, period: float = 0.1, *, patience: float = 0.5, idle: float | None = None) -> None:
        """Repeat the last commands and inputs in the background, so that the driver's command time-out does not expire.

        The keep-alive ends if the driver does not reply for ``patience`` seconds, if the program makes no call for
        ``idle`` seconds, or if the program ends. The commands are then 0. If the driver did not reply, the next command
        or request raises DriverTimeout; only :meth:`init`, :meth:`stop`, :meth:`stop_and_wait` and :meth:`reset_errors`
        are executed instead.

        Args:
            period: Seconds between commands, 0.001 or more. It should be well below the driver's time-out of 500 ms.
            patience: Seconds without a reply after which the keep-alive ends.
            idle: Seconds without a call after which the keep-alive ends; ``None`` for no such limit. Without the limit,
                a program that hangs may keep the motor turning.

        Raises:
            InvalidValue: If an argument is not positive or exceeds one hour, or if ``period`` is below 1 ms or is not
                below ``patience``.
        """
        timer = KeepAliveTimer(period, patience, idle, monotonic())
        self._check_open()
        self.end_keep_alive()
        self._keep_alive_timer = timer
        self._keep_alive_call = AsyncPeriodicCall(
            self._send_if_due, self._keep_alive_lost, f"orinkit-abh3-{self.address}"
        )

    def end_keep_alive(self) -> None:
        """End the keep-alive. If it ended earlier with a DriverTimeout that no call has raised yet, discard this error.

        If the driver then receives no commands, it stops by itself.
        """
        self._ended = None
        periodic_call = self._stop_keep_alive()
        if periodic_call is not None:
            periodic_call.join()

    def _stop_keep_alive(self) -> AsyncPeriodicCall | None:
        periodic_call, self._keep_alive_call, self._keep_alive_timer = self._keep_alive_call, None, None
        if periodic_call is not None:
            periodic_call.stop()
        return periodic_call

    def _keep_alive_lost(self) -> None:
        """Set the commands to 0; called after the thread or task of the keep-alive has ended unexpectedly."""
        if self._keep_alive_timer is not None:
            self._keep_alive_timer = None
            self.host.reset_commands()

    @property
    def kept_alive(self) -> bool:
        """True while a keep-alive is active."""
        return self._keep_alive_timer is not None

    async def _send_if_due(self) -> float | None:
        """Repeat the command if it is due.

        Return the seconds after which this method must be called again, ``None`` if the keep-alive ended.
        """
        async with self._lock:
            timer = self._keep_alive_timer
            if timer is None:
                return None
            now = monotonic()
            # first, because a driver that has stopped by itself must not start again
            end = timer.end_reason_if_delayed(now)
            if end is None and timer.next_time <= now:
                await self._repeat_command(timer)
            end = end or timer.end_reason(monotonic())
            if end is not None:
                await self._end_timer(end, timer)
                return None
            return max(0.0, timer.next_time - monotonic())

    async def _repeat_command(self, timer: KeepAliveTimer) -> None:
        sent_at = monotonic()
        try:
            replied = await self.bus.run(self.host.repeat(timer.period), self._port, revive=False)
        except OrinError:
            replied = False
        timer.sent(sent_at, replied=replied)

    async def _end_timer(self, end: KeepAliveEnd, timer: KeepAliveTimer) -> None:
        self._keep_alive_timer = None
        if end is KeepAliveEnd.SILENT:
            self._ended = DriverTimeout("keep_alive", timer.patience, self.address)
        await self._stop_motion()

    # --- the bus ------------------------------------------------------------------------------------------------------

    def listen(self, seconds: float | None = None) -> AsyncIterator[DecodedFrame]:
        """Decode and yield every frame on the bus, also frames of other nodes; see :meth:`AsyncMotorBus.listen`."""
        return self.bus.listen(seconds, dialect=self.host.dialect, hosts=(self.host.host,))

    async def close(self) -> None:
        """Stop the driver, end the keep-alive, and close the bus if it was opened for this driver (4.8).

        If no motion was commanded after the last stop, no frame is sent. May be called again.
        """
        periodic_call = self._stop_keep_alive()
        try:
            await self.release()
        finally:
            self._port.close()
            try:
                if self._owner:
                    await self.bus.close()
            finally:
                if periodic_call is not None:
                    periodic_call.join()

    async def release(self) -> None:
        """End the keep-alive, and stop the driver if it may be moving. The bus calls this method when it is closed."""
        self._stop_keep_alive()
        async with self._lock:
            await self._stop_motion()

    async def _stop_motion(self) -> None:
        if self._port.closed:
            return
        try:
            await self.bus.run(self.host.release(_GOODBYE), self._port, revive=False)
        except OrinError:
            self.host.reset_commands()

    def relinquish(self) -> None:
        """End the keep-alive, and set commands and inputs to 0 without sending them.

        This method is called when another host, or another client of the same server, begins to command the driver. A
        stop by this object would then interrupt that host or client.
        """
        self._stop_keep_alive()
        self.host.relinquish()

    @property
    def closed(self) -> bool:
        """True if the driver was closed."""
        return self._port.closed

    def _check_open(self) -> None:
        if self._port.closed:
            raise closed()

    def _begin_call(self) -> None:
        self._check_open()
        self.restart_idle_time()

    def restart_idle_time(self) -> None:
        """Restart the idle time of :meth:`keep_alive`, as every call of the program does."""
        timer = self._keep_alive_timer
        if timer is not None:
            timer.called(monotonic())

    async def _run(self, operation: CanOperation[R], *, causes_motion: bool = True) -> R:
        """Run an operation of the host and return its result; operations of one driver run one after the other.

        Args:
            operation: The operation.
            causes_motion: True to raise the DriverTimeout with which the keep-alive has ended, if no call has raised it
                yet. False for operations that cannot start a motion: they run, and this error is discarded.
        """
        async with self._lock:
            ended, self._ended = self._ended, None
            if ended is not None and causes_motion:
                operation.close()
                raise ended
            self.restart_idle_time()
            timer = self._keep_alive_timer
            return await self.bus.run(
                operation if timer is None else report_commands(operation, timer, self.host, monotonic), self._port
            )
