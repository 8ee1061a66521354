"""One client's ABH3: its variables, the commands of Execute, and whether it commands the driver."""

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
from orinkit.abh3.provider.variables import Motor, VariableEntry, as_variant, items_of
from orinkit.abh3.table.records import Feedback, Flags, Record
from orinkit.abh3.table.signals import dialect_of
from orinkit.cao import coerce
from orinkit.cao.error_description import DESCRIBE, describe_error
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


class DriverOwner(Protocol):
    """The provider, as far as a client's object needs it."""

    def acquire(self, controller: ABH3Controller) -> None:
        """Give a client the command of its driver."""

    def owns(self, controller: ABH3Controller) -> bool:
        """Whether a client has it."""

    def owner(self, controller: ABH3Controller) -> ABH3Controller | None:
        """Return who has it now."""

    def release(self, controller: ABH3Controller) -> None:
        """Take it back."""

    def disconnect(self, controller: ABH3Controller) -> None:
        """A client has gone."""


class ABH3Controller(ControllerObject):
    """One client's ABH3.

    Args:
        name: that the client gave it.
        owner: the provider.
        shared: the bus.
        motor: the driver, on that bus.
        wanted: what the client has said.
        reason: what went wrong with the client's last calls.
    """

    def __init__(
        self,
        name: str,
        owner: DriverOwner,
        shared: SharedBus,
        motor: Motor,
        wanted: DriverSelection,
        reason: Callable[[int], str],
    ) -> None:
        super().__init__(name, help=tr("An ABH3 motor driver."))
        self.shared = shared
        self.motor = motor
        self.key: tuple[Key, int] = (shared.key, motor.address)
        self._owner = owner
        self._wanted = wanted
        self._reason = reason
        self._items = items_of(dialect_of(wanted.dialect))
        self._turn = asyncio.Lock()
        self._called = monotonic()
        self._kept = False
        self._writing = self._stopped = False
        self._gone = False

    @property
    def holding(self) -> bool:
        """Whether this client commands the driver now: it has asked for something, and is not silent."""
        if self._writing:
            return True
        if self._wanted.period:
            return self.motor.kept_alive
        return not self._silent() and (bool(self.motor.inputs) or self.motor.commands != (0.0, 0.0))

    def _silent(self) -> bool:
        """Whether this client has not called for longer than it may."""
        return bool(self._wanted.idle) and monotonic() - self._called > self._wanted.idle

    def get_variable(self, name: str, option: str) -> VariableObject:  # noqa: ARG002 - declared by the base
        """Return one of the driver's variables; names in upper and lower case."""
        item = self._items.get(name.strip().upper())
        if item is None:
            names = ", ".join(self._items)
            raise not_found(tr("{name}; there are: {names}", name=quoted(name, 80), names=names))
        return ABH3Variable(self, item)

    def get_variable_names(self, option: str) -> list[str]:  # noqa: ARG002
        """The names of the driver's variables."""
        return list(self._items)

    async def execute(self, command: str, parameter: Variant) -> Value:
        """Carry out one of :data:`COMMANDS`; names in upper and lower case."""
        wanted = command.strip().lower()
        if wanted == DESCRIBE:
            return describe_error(self._reason, parameter)
        name = next((known for known in COMMANDS if known.lower() == wanted), None)
        if name is None:
            names = ", ".join(COMMANDS)
            raise error_for(
                hresult.E_INVALID_CMD_NAME,
                tr("{name}; there are: {names}", name=quoted(command, 80), names=names),
            )
        values = coerce.to_values(parameter)
        readers, least, run = COMMANDS[name]
        if not least <= len(values) <= len(readers):
            raise invalid(
                tr(
                    "{name} takes {least} to {most} values, not {count}",
                    name=name,
                    least=least,
                    most=len(readers),
                    count=len(values),
                )
            )
        return await run(self, *[read(value) for read, value in zip(readers, values, strict=False)])

    def release(self) -> None:
        """The client has gone: the motor comes to rest."""
        if not self._gone:
            self._gone = True
            self._owner.disconnect(self)

    # --- what variables and commands do -------------------------------------------------------------------------------

    async def read(self, get: Callable[[Motor], Awaitable[T]]) -> T:
        """Ask the driver."""
        with map_errors():
            async with self._turn:
                self._begin()
                return await get(self.motor)

    async def write(self, put: Callable[[Motor], Awaitable[T]], *, calming: bool = False) -> T:
        """Command the driver, and keep it so while the client is there.

        Args:
            put: does it.
            calming: it moves nothing: it is done even after the motor was stopped.
        """
        with map_errors():
            async with self._turn:
                if not self._wanted.period and self._silent() and self.motor.host.moving:
                    self.motor.host.reset_commands()
                    self._stopped = True
                self._begin()
                self._owner.acquire(self)
                self._tell_of_stop(calming=calming)
                self._writing = True  # nobody else gets the command meanwhile
                try:
                    result = await put(self.motor)
                    if self._wanted.period and not self.motor.kept_alive:
                        await self.motor.keep_alive(self._wanted.period, idle=self._wanted.idle or None)
                        self._kept = True
                finally:
                    self._writing = False
                return result

    async def stop(self) -> Feedback:
        """Stop the motor, whoever commands it; another client that does is told at its next write."""
        holder = self._owner.owner(self)
        if holder is None or holder is self:
            return await self.write(lambda motor: motor.stop(), calming=True)
        with map_errors():
            self._begin()
            return await holder.stopped()

    async def stopped(self) -> Feedback:
        """Stop for another client. The keep-alive ends, so that the command can be taken."""
        feedback: Feedback = await self.motor.stop()
        self.motor.end_keep_alive()
        self._stopped = True
        return feedback

    async def release_command(self) -> None:
        """Stop the motor, switch the servo off, and give the command back, if this client has it."""
        with map_errors():
            async with self._turn:
                self._begin()
                if not self._owner.owns(self):
                    return
                self._kept = self._stopped = False
                self.motor.end_keep_alive()
                await self.motor.init()
                self._owner.release(self)

    def _begin(self) -> None:
        """Note that the client is there; a call that it was told took too long is not begun.

        Raises:
            CallError: E_TIMEOUT: it was told so while this call waited for its turn.
        """
        if client_gave_up():
            raise error_for(hresult.E_TIMEOUT)
        self._called = monotonic()
        self.motor.feed()

    def _tell_of_stop(self, *, calming: bool) -> None:
        """Tell a client once that its motor was stopped meanwhile.

        Raises:
            CallError: E_ABORT.
        """
        if not self._stopped and (not self._kept or self.motor.kept_alive):
            return
        self._kept = self._stopped = False
        self.motor.end_keep_alive()  # the driver's object has nothing to tell any more
        if calming:
            return
        raise error_for(
            hresult.E_ABORT,
            tr(
                "the motor was stopped: this client was silent for {idle:g} s (option Idle), the driver "
                "did not answer, or another client said Stop. Say START and COMMAND again, and "
                "ResetErrors before them if ERRORS is not 0",
                idle=self._wanted.idle,
            ),
        )


class ABH3Variable(VariableObject):
    """One client's handle of a variable."""

    def __init__(self, controller: ABH3Controller, item: VariableEntry) -> None:
        super().__init__(item.name, attribute=READABLE | (WRITABLE if item.put else 0), help=item.help)
        self._controller = controller
        self._item = item
        self._taken = datetime.now()

    async def get_value(self) -> Value:
        """Ask the driver for it."""
        value = await self._controller.read(self._item.get)
        self._taken = datetime.now()
        return as_variant(self._item, value)

    async def put_value(self, value: Variant) -> None:
        """Send it to the driver."""
        item, put = self._item, self._item.put
        if put is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, item.name)
        number: Any = _read(item, value)
        await self._controller.write(lambda motor: put(motor, number))
        self._taken = datetime.now()

    def get_date_time(self) -> datetime:
        """When it was last read or written by this client."""
        return self._taken.replace(microsecond=0)

    def get_microsecond(self) -> int:
        """The microseconds of that time."""
        return self._taken.microsecond


# --- values of clients ------------------------------------------------------------------------------------------------


def _read(item: VariableEntry, value: Variant) -> Any:
    """Return a value that a client writes, as the variable wants it.

    Raises:
        CallError: E_INVALIDARG, E_INVALIDARGTYPE: it is none.
    """
    if item.count:
        values = coerce.to_values(value)
        if len(values) != item.count:
            raise invalid(
                tr("{name} has {wanted} values, not {count}", name=item.name, wanted=item.count, count=len(values))
            )
        return [_real(each) for each in values]
    if item.type == VarType.BOOL:
        return _bit(value)
    return _word(value) if item.type == VarType.UI4 else _real(value)


def _real(value: Any) -> float:
    return coerce.to_real(to_variant(value))


def _whole(value: Any) -> int:
    number = _real(value)
    if not number.is_integer():
        raise invalid(tr("{number:g} is no whole number", number=number))
    return int(number)


def _bit(value: Any) -> int:
    number = _real(value)
    if number not in (0, 1, -1):
        raise invalid(tr("0 or 1 is needed, or -1 as VT_BOOL, not {number:g}", number=number))
    return int(number != 0)


def _word(value: Any) -> int:
    """Return 32 bits, from VT_I4 too, which has them signed."""
    if to_variant(value).type == VarType.BOOL:
        raise invalid(tr("a word of 32 bits is needed, not VT_BOOL"))
    number = _whole(value)
    if not _SIGNED <= number <= _ALL_BITS:
        raise invalid(tr("{number} has more than 32 bits", number=number))
    return number & _ALL_BITS


def _name(value: Any) -> int | str:
    """Return a number or a name of an input; a number as text is a number."""
    if isinstance(value, str) and not value.strip().isdecimal():
        return value.strip().lower()
    return _whole(value)


# --- commands ---------------------------------------------------------------------------------------------------------

Reader: TypeAlias = Callable[[Any], Any]
Run: TypeAlias = Callable[..., Awaitable[Value]]


async def _init(controller: ABH3Controller) -> Value:
    return _plain(await controller.write(lambda motor: motor.init(), calming=True))


async def _stop(controller: ABH3Controller) -> Value:
    return _plain(await controller.stop())


async def _reset(controller: ABH3Controller) -> None:
    await controller.write(lambda motor: motor.reset_errors(), calming=True)


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
"""The commands of Execute: how each value is read, how many there are at least, what is done."""


def _plain(record: Record) -> list[float]:
    """Return the values of a record in its order, flags as numbers."""
    values = (getattr(record, each.name) for each in fields(record) if each.name != "codes")
    return [float(int(value)) if isinstance(value, Flags) else float(value) for value in values]
