"""An ABH3 that a client uses as a CAO controller: variables, Execute commands, and the right to command the driver."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import fields
from datetime import datetime
from time import monotonic
from typing import Any, Final, Protocol, TypeAlias, TypeVar

from orinkit.abh3.provider.buses import Key, SharedBus
from orinkit.abh3.provider.errors import map_errors
from orinkit.abh3.provider.options import DriverSelection, invalid
from orinkit.abh3.provider.variables import Motor, VariableEntry, as_variant, entries_of
from orinkit.abh3.table.records import Feedback, Flags, Record
from orinkit.abh3.table.signals import dialect_of
from orinkit.cao import coerce
from orinkit.cao.error_description import DESCRIBE, get_error_description
from orinkit.cao.provider import READABLE, WRITABLE, ControllerObject, VariableObject, not_found
from orinkit.cao.results import client_gave_up
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import quoted, tr
from orinkit.values.variant import Value, Variant, VarType
from orinkit.values.variant import variant as to_variant

T = TypeVar("T")
_ALL_BITS: Final = 0xFFFFFFFF
_SIGNED: Final = -0x80000000


class CommandArbiter(Protocol):
    """The part of the provider that grants clients the right to command a driver; called by controller objects."""

    def acquire(self, controller: ABH3Controller) -> None:
        """Give the client of a controller object the right to command its driver."""

    def owns(self, controller: ABH3Controller) -> bool:
        """Return True if the client of a controller object has the right to command its driver."""

    def owner(self, controller: ABH3Controller) -> ABH3Controller | None:
        """Return the controller object that commands the driver of ``controller``; ``None`` if there is none."""

    def release(self, controller: ABH3Controller) -> None:
        """Withdraw the right to command from a client."""

    def disconnect(self, controller: ABH3Controller) -> None:
        """Remove a client that has disconnected."""


class ABH3Controller(ControllerObject):
    """The controller object through which one client uses an ABH3.

    Args:
        name: Name chosen by the client.
        owner: The provider.
        shared: The bus.
        motor: The driver on that bus.
        wanted: The driver and the settings selected by the client.
        describe_error: Function that returns the text of the client's last error with a given return code.
    """

    def __init__(
        self,
        name: str,
        owner: CommandArbiter,
        shared: SharedBus,
        motor: Motor,
        wanted: DriverSelection,
        describe_error: Callable[[int], str],
    ) -> None:
        super().__init__(name, help=tr("An ABH3 motor driver."))
        self.shared = shared
        self.motor = motor
        self.key: tuple[Key, int] = (shared.key, motor.address)
        self._owner = owner
        self._wanted = wanted
        self._describe_error = describe_error
        self._entries = entries_of(dialect_of(wanted.dialect))
        self._call_lock = asyncio.Lock()
        self._called = monotonic()
        self._keeps_alive = False
        self._writing = self._stopped = False
        self._released = False

    @property
    def holding(self) -> bool:
        """True while this client commands the driver.

        This is the case if the client has sent commands and its idle time (option ``Idle``) has not expired.
        """
        if self._writing:
            return True
        if self._wanted.period:
            return self.motor.kept_alive
        return not self._silent() and (bool(self.motor.inputs) or self.motor.commands != (0.0, 0.0))

    def _silent(self) -> bool:
        """Return True if the client has made no call for its idle time; False if the option ``Idle`` is 0."""
        return bool(self._wanted.idle) and monotonic() - self._called > self._wanted.idle

    def get_variable(self, name: str, option: str) -> VariableObject:
        """Return a variable of the driver; names are case-insensitive."""
        entry = self._entries.get(name.strip().upper())
        if entry is None:
            names = ", ".join(self._entries)
            raise not_found(tr("{name}; available: {names}", name=quoted(name, 80), names=names))
        return ABH3Variable(self, entry)

    def get_variable_names(self, option: str) -> list[str]:
        """Return the names of the driver's variables."""
        return list(self._entries)

    async def execute(self, command: str, parameter: Variant) -> Value:
        """Execute one of :data:`COMMANDS`; names are case-insensitive."""
        wanted = command.strip().lower()
        if wanted == DESCRIBE:
            return get_error_description(self._describe_error, parameter)
        name = next((known for known in COMMANDS if known.lower() == wanted), None)
        if name is None:
            names = ", ".join(COMMANDS)
            raise error_for(
                hresult.E_INVALID_CMD_NAME,
                tr("{name}; available: {names}", name=quoted(command, 80), names=names),
            )
        values = coerce.to_values(parameter)
        readers, minimum, run = COMMANDS[name]
        if not minimum <= len(values) <= len(readers):
            raise invalid(
                tr(
                    "{name} takes {least} to {most} values, got {count}",
                    name=name,
                    least=minimum,
                    most=len(readers),
                    count=len(values),
                )
            )
        return await run(self, *[read(value) for read, value in zip(readers, values, strict=False)])

    def release(self) -> None:
        """Release the controller after its client has disconnected; stop the motor if this client commands it."""
        if not self._released:
            self._released = True
            self._owner.disconnect(self)

    # --- what variables and commands do -------------------------------------------------------------------------------

    async def read(self, get: Callable[[Motor], Awaitable[T]]) -> T:
        """Request a value from the driver."""
        with map_errors():
            async with self._call_lock:
                self._begin()
                return await get(self.motor)

    async def write(self, put: Callable[[Motor], Awaitable[T]], *, causes_motion: bool = True) -> T:
        """Command the driver, and begin a keep-alive that repeats the command, unless the option KeepAlive is 0.

        Args:
            put: Function that sends the command.
            causes_motion: True if the command may start a motion. Such a command raises E_ABORT, and is not executed,
                if the motor was stopped after the client's previous command.
        """
        with map_errors():
            async with self._call_lock:
                if not self._wanted.period and self._silent() and self.motor.host.moving:
                    self.motor.host.reset_commands()
                    self._stopped = True
                self._begin()
                self._owner.acquire(self)
                self._report_stop(causes_motion=causes_motion)
                self._writing = True  # until "put" has returned, no other client can get the right to command
                try:
                    result = await put(self.motor)
                    if self._wanted.period and not self.motor.kept_alive:
                        await self.motor.keep_alive(self._wanted.period, idle=self._wanted.idle or None)
                        self._keeps_alive = True
                finally:
                    self._writing = False
                return result

    async def stop(self) -> Feedback:
        """Stop the motor, even if another client commands it; the next write of that client raises E_ABORT."""
        holder = self._owner.owner(self)
        if holder is None or holder is self:
            return await self.write(lambda motor: motor.stop(), causes_motion=False)
        with map_errors():
            self._begin()
            return await holder.preempt()

    async def preempt(self) -> Feedback:
        """Stop the motor because another client has called Stop, and end this client's keep-alive.

        Any other client can then get the right to command the driver.
        """
        feedback: Feedback = await self.motor.stop()
        self.motor.end_keep_alive()
        self._stopped = True
        return feedback

    async def release_command(self) -> None:
        """If this client has the right to command, stop the motor, switch the servo off and release the right."""
        with map_errors():
            async with self._call_lock:
                self._begin()
                if not self._owner.owns(self):
                    return
                self._keeps_alive = self._stopped = False
                self.motor.end_keep_alive()
                await self.motor.init()
                self._owner.release(self)

    def _begin(self) -> None:
        """Restart the idle time of the client at the beginning of a call.

        Raises:
            CallError: E_TIMEOUT: If the call timed out while it waited for an earlier call of the client.
        """
        if client_gave_up():
            raise error_for(hresult.E_TIMEOUT)
        self._called = monotonic()
        self.motor.restart_idle_time()

    def _report_stop(self, *, causes_motion: bool) -> None:
        """Report to the client, once only, that the motor was stopped after its previous command.

        Raises:
            CallError: E_ABORT: If the motor was stopped and ``causes_motion`` is True.
        """
        if not self._stopped and (not self._keeps_alive or self.motor.kept_alive):
            return
        self._keeps_alive = self._stopped = False
        self.motor.end_keep_alive()  # also discards its pending DriverTimeout, which must not be reported twice
        if not causes_motion:
            return
        raise error_for(
            hresult.E_ABORT,
            tr(
                "the motor was stopped: this client made no call for {idle:g} s (option Idle), the driver did not "
                "reply, or another client called Stop. Try: set START and COMMAND again; if ERRORS is not 0, "
                "first call ResetErrors and set SERVO_ON",
                idle=self._wanted.idle,
            ),
        )


class ABH3Variable(VariableObject):
    """The object through which one client uses a variable of a driver."""

    def __init__(self, controller: ABH3Controller, entry: VariableEntry) -> None:
        super().__init__(entry.name, attribute=READABLE | (WRITABLE if entry.put else 0), help=entry.help)
        self._controller = controller
        self._entry = entry
        self._accessed = datetime.now()

    async def get_value(self) -> Value:
        """Read the variable from the driver."""
        value = await self._controller.read(self._entry.get)
        self._accessed = datetime.now()
        return as_variant(self._entry, value)

    async def put_value(self, value: Variant) -> None:
        """Write the variable to the driver."""
        entry, put = self._entry, self._entry.put
        if put is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, entry.name)
        number: Any = _read(entry, value)
        await self._controller.write(lambda motor: put(motor, number))
        self._accessed = datetime.now()

    def get_date_time(self) -> datetime:
        """Return the time at which this client last read or wrote the variable, without microseconds.

        Before the first access, it is the time at which the client got the variable.
        """
        return self._accessed.replace(microsecond=0)

    def get_microsecond(self) -> int:
        """Return the microseconds of the time that :meth:`get_date_time` returns."""
        return self._accessed.microsecond


# --- values of clients ------------------------------------------------------------------------------------------------


def _read(entry: VariableEntry, value: Variant) -> Any:
    """Convert a value from a client to the type of the variable.

    Raises:
        CallError: E_INVALIDARG, E_INVALIDARGTYPE: If the value is not valid.
    """
    if entry.count:
        values = coerce.to_values(value)
        if len(values) != entry.count:
            raise invalid(
                tr("{name} has {wanted} values, got {count}", name=entry.name, wanted=entry.count, count=len(values))
            )
        return [_real(each) for each in values]
    if entry.type == VarType.BOOL:
        return _bit(value)
    return _word(value) if entry.type == VarType.UI4 else _real(value)


def _real(value: Any) -> float:
    return coerce.to_real(to_variant(value))


def _whole(value: Any) -> int:
    number = _real(value)
    if not number.is_integer():
        raise invalid(tr("{number:g} is not a whole number", number=number))
    return int(number)


def _bit(value: Any) -> int:
    number = _real(value)
    if number not in (0, 1, -1):
        raise invalid(tr("the value must be 0 or 1, or -1 for VT_BOOL true, not {number:g}", number=number))
    return int(number != 0)


def _word(value: Any) -> int:
    """Convert a value to an unsigned 32-bit word; a negative value (VT_I4) becomes the word with the same bits."""
    if to_variant(value).type == VarType.BOOL:
        raise invalid(tr("the value must be a 32-bit word, not VT_BOOL"))
    number = _whole(value)
    if not _SIGNED <= number <= _ALL_BITS:
        raise invalid(tr("{number} does not fit in 32 bits", number=number))
    return number & _ALL_BITS


def _name(value: Any) -> int | str:
    """Convert a value from a client to the number or the name of an input; a text of decimal digits is a number."""
    if isinstance(value, str) and not value.strip().isdecimal():
        return value.strip().lower()
    return _whole(value)


# --- commands ---------------------------------------------------------------------------------------------------------

Reader: TypeAlias = Callable[[Any], Any]
Run: TypeAlias = Callable[..., Awaitable[Value]]


async def _init(controller: ABH3Controller) -> Value:
    return _plain(await controller.write(lambda motor: motor.init(), causes_motion=False))


async def _stop(controller: ABH3Controller) -> Value:
    return _plain(await controller.stop())


async def _reset(controller: ABH3Controller) -> None:
    await controller.write(lambda motor: motor.reset_errors(), causes_motion=False)


async def _command(controller: ABH3Controller, ay: float, bx: float) -> Value:
    return _plain(await controller.write(lambda motor: motor.command(ay, bx)))


async def _set_inputs(controller: ABH3Controller, data: int, mask: int = _ALL_BITS) -> Value:
    return _plain(await controller.write(lambda motor: motor.set_inputs(data, mask)))


async def _set_input(controller: ABH3Controller, bit: int | str, value: int) -> Value:
    return _plain(await controller.write(lambda motor: motor.set_input(bit, value)))


async def _request(controller: ABH3Controller, number: int) -> Value:
    return _plain(await controller.read(lambda motor: motor.request_broadcast(number)))


async def _request_single(controller: ABH3Controller, dp: int = 0) -> Value:
    return _plain(await controller.read(lambda motor: motor.request_single(dp)))


async def _read_parameter(controller: ABH3Controller, address: int) -> Value:
    return (await controller.read(lambda motor: motor.read_parameter(address))).value


async def _write_parameter(controller: ABH3Controller, address: int, value: float) -> None:
    number = int(value) if value.is_integer() else value
    await controller.write(lambda motor: motor.write_parameter(address, number))


async def _read_monitor(controller: ABH3Controller, address: int) -> Value:
    return (await controller.read(lambda motor: motor.read_monitor(address))).value


async def _release(controller: ABH3Controller) -> None:
    await controller.release_command()


COMMANDS: Final[Mapping[str, tuple[tuple[Reader, ...], int, Run]]] = {
    "Init": ((), 0, _init),
    "Stop": ((), 0, _stop),
    "ResetErrors": ((), 0, _reset),
    "Command": ((_real, _real), 2, _command),
    "SetInputs": ((_word, _word), 1, _set_inputs),
    "SetInput": ((_name, _bit), 2, _set_input),
    "RequestBroadcast": ((_whole,), 1, _request),
    "RequestSingle": ((_whole,), 0, _request_single),
    "ReadParameter": ((_whole,), 1, _read_parameter),
    "WriteParameter": ((_whole, _real), 2, _write_parameter),
    "ReadMonitor": ((_whole,), 1, _read_monitor),
    "Release": ((), 0, _release),
}
"""For each command of Execute, by name: converters of its values, minimum number of values, and implementation."""


def _plain(record: Record) -> list[float]:
    """Return the values of a record in the order of its fields, with flag words as numbers."""
    values = (getattr(record, each.name) for each in fields(record) if each.name != "codes")
    return [float(int(value)) if isinstance(value, Flags) else float(value) for value in values]
