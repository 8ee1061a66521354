"""ABH3 motor drivers as a CAO provider, ``CaoProv.Waco.ABH3``: every b-CAP and e-CAP client can turn a motor.

A client says in the option of Controller_Connect which driver it wants::

    Interface=socketcan, Channel=can0, Bitrate=500000, Address=1, Host=2, Group=5

Several clients may read one driver; the first that writes has the command, until it lets go, leaves, or is silent.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar, cast
from urllib.parse import quote

from orinkit import hresult
from orinkit.abh3._common import HostSettings
from orinkit.abh3.aio import AsyncMotorBus, open_bus
from orinkit.abh3.records import Flags, Record
from orinkit.abh3.signals import dialect_of
from orinkit.cao import coerce
from orinkit.cao.options import Options
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, VariableObject, not_found
from orinkit.device import DESCRIBE, describe_error
from orinkit.errors import (
    CallError,
    DriverFault,
    DriverTimeout,
    InvalidAddress,
    InvalidValue,
    MissingExtra,
    OrinError,
    ProtocolError,
    TransportError,
    error_for,
)
from orinkit.gateway.abh3_variables import Item, Motor, as_variant, items_of
from orinkit.language import pick
from orinkit.variant import Value, Variant
from orinkit.variant import variant as to_variant

if TYPE_CHECKING:
    import can

T = TypeVar("T")
READABLE: Final = 1
WRITABLE: Final = 2
_PERIOD: Final = 0.1
_IDLE: Final = 1.0
_LONGEST: Final = 3600
_NUMBERS: Final = ("address", "host", "group", "priority")
_REALS: Final = ("timeout", "load_unit")
_KNOWN: Final = (
    "Interface", "Channel", "Bitrate", "Bus", "Address", "Host", "Group", "Priority", "Dialect", "LoadUnit", "Timeout",
    "KeepAlive", "Idle",
)  # fmt: skip
"""The options of Controller_Connect."""


class Wanted(NamedTuple):
    """Which driver a client wants, and how.

    Attributes:
        bus: URL of the bus.
        dialect: of the driver.
        settings: what is known of it.
        period: s between commands of the keep-alive; 0 for none.
        idle: s without a call of the client after which the motor is stopped; 0 for never.
    """

    bus: str
    dialect: str
    settings: HostSettings
    period: float
    idle: float


class ABH3Provider(Provider):
    """ABH3 drivers for CAO clients.

    Args:
        bus: URL of the only bus that clients get, or a bus of python-can; ``None``: each client says which. Whoever can
            connect to the server can then open every CAN interface of this computer.
        **defaults: what holds where a client says nothing: ``dialect``, and as of :class:`HostSettings`.
    """

    provider_names: Sequence[str] = ("CaoProv.Waco.ABH3",)

    def __init__(self, bus: str | can.BusABC | None = None, **defaults: Any) -> None:
        self._given = bus
        self._defaults = defaults
        self._buses: dict[str, _Shared] = {}
        self._holders: dict[tuple[str, int], ABH3Controller] = {}
        self._parting: set[asyncio.Task[None]] = set()
        self._lock = asyncio.Lock()

    async def connect(
        self,
        name: str,
        machine: str,  # noqa: ARG002 - declared by the base
        option: str,
        client: ClientInfo,
    ) -> ControllerObject:
        """Return a driver for one client; nothing is sent.

        Raises:
            CallError: E_INVALIDARG: the option cannot be used; E_CAO_REMOTE_PROVIDER: the bus cannot be opened.
        """
        with _told():
            wanted = self._wanted(option)
            shared = await self._open(wanted.bus)
            try:
                motor = shared.bus.driver(dialect=wanted.dialect, **wanted.settings)
            except BaseException:
                await self._close(shared)
                raise
        return ABH3Controller(name, self, shared, motor, wanted, client.reason)

    async def close(self) -> None:
        """Stop what moves and close every bus."""
        for holder in list(self._holders.values()):
            holder.release()
        if self._parting:
            await asyncio.wait(self._parting)

    # --- for controllers ----------------------------------------------------------------------------------------------

    def take(self, controller: ABH3Controller) -> None:
        """Give a client the command of its driver.

        Raises:
            CallError: E_ACCESSDENIED: another client has it.
        """
        holder = self._holders.setdefault(controller.key, controller)
        if holder is controller:
            return
        if holder.holding:
            raise error_for(
                hresult.E_ACCESSDENIED,
                pick(
                    f"another client commands ABH3 {controller.key[1]}. Try: when it has let go: command Release",
                    f"ABH3 {controller.key[1]} は別のクライアントが操作中です。対処: そのクライアントが Release を実行するのを待ってください",
                ),
            )
        self._holders[controller.key] = controller

    def drop(self, controller: ABH3Controller) -> None:
        """Take the command back from a client, if it has it."""
        if self._holders.get(controller.key) is controller:
            del self._holders[controller.key]

    def part(self, controller: ABH3Controller) -> None:
        """A client has gone: stop its motor, close the bus when nobody is left."""
        task = asyncio.get_running_loop().create_task(self._part(controller))
        self._parting.add(task)
        task.add_done_callback(self._parting.discard)

    async def _part(self, controller: ABH3Controller) -> None:
        try:
            await controller.motor.close()
        finally:
            self.drop(controller)
            await self._close(controller.shared)

    # --- buses --------------------------------------------------------------------------------------------------------

    def _wanted(self, option: str) -> Wanted:
        options = Options(option)
        _check_names(options)
        return Wanted(
            self._bus_of(options),
            dialect_of(options.text_of("Dialect", str(self._defaults.get("dialect", "v1")))).name,
            self._settings_of(options),
            _seconds(options, "KeepAlive", _PERIOD),
            _seconds(options, "Idle", _IDLE),
        )

    def _bus_of(self, options: Options) -> str:
        place = [name for name in ("Interface", "Channel", "Bitrate", "Bus") if name in options]
        if self._given is not None:
            if place:
                raise _invalid(
                    pick(
                        f"the server decides which bus it is: leave {', '.join(place)} out",
                        f"バスはサーバ側で決まっています。{', '.join(place)} は指定できません",
                    )
                )
            return self._given if isinstance(self._given, str) else ""
        if "Bus" in options:
            return options.text_of("Bus")
        if "Interface" not in options:
            raise _invalid(
                pick(
                    "which CAN bus? Try: Interface=socketcan, Channel=can0 (and Bitrate=500000)",
                    "CAN バスの指定がありません。対処: Interface=socketcan, Channel=can0 (と Bitrate=500000)",
                )
            )
        url = f"can://{options.text_of('Interface')}/{quote(options.text_of('Channel'), safe='/:')}"
        return f"{url}?bitrate={options.text_of('Bitrate')}" if "Bitrate" in options else url

    def _settings_of(self, options: Options) -> HostSettings:
        settings: dict[str, Any] = {name: value for name, value in self._defaults.items() if name != "dialect"}
        for name in _NUMBERS:
            if name in options:
                settings[name] = _number(options, name)
        for name in _REALS:
            if (option := name.replace("_", "")) in options:
                settings[name] = _real(options, option)
        return cast(HostSettings, settings)

    async def _open(self, url: str) -> _Shared:
        async with self._lock:
            shared = self._buses.get(url)
            if shared is None:
                shared = _Shared(url, await open_bus(url if self._given is None else self._given))
                self._buses[url] = shared
            shared.users += 1
            return shared

    async def _close(self, shared: _Shared) -> None:
        async with self._lock:
            shared.users -= 1
            if shared.users <= 0 and self._buses.get(shared.url) is shared:
                del self._buses[shared.url]
                await shared.bus.close()


class _Shared:
    """A bus, and how many clients use it."""

    def __init__(self, url: str, bus: AsyncMotorBus) -> None:
        self.url = url
        self.bus = bus
        self.users = 0


class ABH3Controller(ControllerObject):
    """One client's ABH3."""

    def __init__(
        self,
        name: str,
        provider: ABH3Provider,
        shared: _Shared,
        motor: Motor,
        wanted: Wanted,
        reason: Callable[[int], str],
    ) -> None:
        super().__init__(name, help=pick(*_HELP))
        self._reason = reason
        self._provider = provider
        self._wanted = wanted
        self._items = items_of(dialect_of(wanted.dialect))
        self.shared = shared
        self.motor = motor
        self.key = (shared.url, motor.address)

    @property
    def holding(self) -> bool:
        """Whether this client commands the driver now."""
        if self._wanted.period:
            return self.motor.kept_alive
        return bool(self.motor.inputs) or self.motor.commands != (0.0, 0.0)

    def get_variable(self, name: str, option: str) -> VariableObject:  # noqa: ARG002 - declared by the base
        """Return one of the driver's variables; names in upper and lower case."""
        item = self._items.get(name.strip().upper())
        if item is None:
            known = ", ".join(self._items)
            raise not_found(pick(f"{name!r:.80}; there are: {known}", f"{name!r:.80}。あるもの: {known}"))
        return ABH3Variable(self, item)

    def get_variable_names(self, option: str) -> list[str]:  # noqa: ARG002
        """The names of the driver's variables."""
        return list(self._items)

    async def execute(self, command: str, parameter: Variant) -> Value:
        """Carry out one of :data:`COMMANDS`; names in upper and lower case."""
        run = COMMANDS.get(command.strip().lower())
        if command.strip().lower() == DESCRIBE:
            return describe_error(self._reason, parameter)
        if run is None:
            known = ", ".join(_NAMES)
            raise error_for(
                hresult.E_INVALID_CMD_NAME,
                pick(f"{command!r:.80}; there are: {known}", f"{command!r:.80}。あるもの: {known}"),
            )
        values = coerce.to_values(parameter)
        try:
            call = run(self, *values)
        except TypeError:
            raise _invalid(
                pick(
                    f"{command}: {len(values)} values are too many or too few",
                    f"{command}: 引数の数 {len(values)} が違います",
                )
            ) from None
        with _told():
            return await call

    def release(self) -> None:
        """The client has gone: the motor comes to rest."""
        self._provider.part(self)

    # --- what variables and commands do -------------------------------------------------------------------------------

    async def read(self, get: Callable[[Motor], Awaitable[T]]) -> T:
        """Ask the driver."""
        with _told():
            return await get(self.motor)

    async def write(self, put: Callable[[Motor], Awaitable[T]]) -> T:
        """Command the driver, and keep it so while the client is there."""
        with _told():
            self._provider.take(self)
            if self._wanted.period and not self.motor.kept_alive:
                await self.motor.keep_alive(self._wanted.period, idle=self._wanted.idle or None)
            return await put(self.motor)

    async def let_go(self) -> None:
        """Stop the motor, switch the servo off, and give the command back."""
        self.motor.end_keep_alive()
        await self.motor.init()
        self._provider.drop(self)


class ABH3Variable(VariableObject):
    """One client's handle of a variable."""

    def __init__(self, controller: ABH3Controller, item: Item) -> None:
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
        number: Any = _numbers(item, value) if item.count else coerce.to_real(value)
        await self._controller.write(lambda motor: put(motor, number))
        self._taken = datetime.now()

    def get_date_time(self) -> datetime:
        """When it was last read or written by this client."""
        return self._taken.replace(microsecond=0)

    def get_microsecond(self) -> int:
        """The microseconds of that time."""
        return self._taken.microsecond


def _numbers(item: Item, value: Variant) -> list[float]:
    values = coerce.to_values(value)
    if len(values) != item.count:
        raise _invalid(
            pick(
                f"{item.name} has {item.count} values, not {len(values)}",
                f"{item.name} は {item.count} 個の値です ({len(values)} 個)",
            )
        )
    return [coerce.to_real(to_variant(each)) for each in values]


# --- commands ---------------------------------------------------------------------------------------------------------

_HELP: Final = ("An ABH3 motor driver.", "ABH3 モータドライバ。")


async def _init(controller: ABH3Controller) -> Value:
    return _plain(await controller.write(lambda motor: motor.init()))


async def _stop(controller: ABH3Controller) -> Value:
    return _plain(await controller.write(lambda motor: motor.stop()))


async def _reset(controller: ABH3Controller) -> None:
    await controller.write(lambda motor: motor.reset_errors())


async def _command(controller: ABH3Controller, ay: float, bx: float) -> Value:
    return _plain(await controller.write(lambda motor: motor.command(ay, bx)))


async def _set_inputs(controller: ABH3Controller, data: int, mask: int = 0xFFFFFFFF) -> Value:
    return _plain(await controller.write(lambda motor: motor.set_inputs(data, mask)))


async def _set_input(controller: ABH3Controller, bit: int | str, value: int) -> Value:
    name = bit.lower() if isinstance(bit, str) else bit
    return _plain(await controller.write(lambda motor: motor.set_input(name, int(bool(value)))))


async def _request(controller: ABH3Controller, number: int) -> Value:
    return _plain(await controller.read(lambda motor: motor.request_broadcast(number)))


async def _request_single(controller: ABH3Controller, dp: int = 0) -> Value:
    return _plain(await controller.read(lambda motor: motor.request_single(dp)))


async def _read_parameter(controller: ABH3Controller, address: int) -> Value:
    return (await controller.read(lambda motor: motor.read_parameter(address))).value


async def _write_parameter(controller: ABH3Controller, address: int, value: float) -> None:
    await controller.write(lambda motor: motor.write_parameter(address, value))


async def _read_monitor(controller: ABH3Controller, address: int) -> Value:
    return (await controller.read(lambda motor: motor.read_monitor(address))).value


async def _release(controller: ABH3Controller) -> None:
    await controller.let_go()


_NAMES: Final[Mapping[str, Callable[..., Awaitable[Value]]]] = {
    "Init": _init,
    "Stop": _stop,
    "ResetErrors": _reset,
    "Command": _command,
    "SetInputs": _set_inputs,
    "SetInput": _set_input,
    "RequestBroadcast": _request,
    "RequestSingle": _request_single,
    "ReadParameter": _read_parameter,
    "WriteParameter": _write_parameter,
    "ReadMonitor": _read_monitor,
    "Release": _release,
}
COMMANDS: Final = {name.lower(): run for name, run in _NAMES.items()}
"""The commands of Execute by their names in lower case."""


def _plain(record: Record) -> list[float]:
    """Return the values of a record in its order, flags as numbers."""
    values = (getattr(record, name) for name in record.__dataclass_fields__ if name != "codes")
    return [float(int(value)) if isinstance(value, Flags) else float(value) for value in values]


# --- errors -----------------------------------------------------------------------------------------------------------


class _told:  # noqa: N801 - reads as a statement
    """What goes wrong with a driver becomes a code, and its text the reason."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, CallError) or not isinstance(error, OrinError):
            return
        for kinds, code in _CODES:
            if isinstance(error, kinds):
                raise error_for(code, str(error)) from error
        raise error_for(hresult.E_FAIL, str(error)) from error


_CODES: Final[tuple[tuple[type[OrinError] | tuple[type[OrinError], ...], int], ...]] = (
    ((InvalidValue, InvalidAddress), hresult.E_INVALIDARG),
    (DriverTimeout, hresult.E_TIMEOUT),
    ((TransportError, MissingExtra), hresult.E_CAO_REMOTE_PROVIDER),
    ((DriverFault, ProtocolError), hresult.E_FAIL),
)


def _invalid(text: str) -> CallError:
    return error_for(hresult.E_INVALIDARG, text)


def _check_names(options: Options) -> None:
    """Refuse an option that there is not: a mistyped Address would turn another motor.

    Raises:
        CallError: E_INVALIDARG: there is one.
    """
    known = {name.lower() for name in _KNOWN}
    for name in options.names:
        if name not in known:
            raise _invalid(
                pick(
                    f"there is no option {name:.40}; there are: {', '.join(_KNOWN)}",
                    f"オプション {name:.40} はありません。あるもの: {', '.join(_KNOWN)}",
                )
            )


def _number(options: Options, name: str) -> int:
    try:
        number = options.number(name)
    except ValueError as error:
        raise _invalid(pick(f"{name}={error} is no whole number", f"{name}={error} は整数ではありません")) from None
    assert number is not None
    return number


def _real(options: Options, name: str) -> float:
    text = options.text_of(name)
    try:
        return float(text)
    except ValueError:
        raise _invalid(pick(f"{name}={text:.40} is no number", f"{name}={text:.40} は数値ではありません")) from None


def _seconds(options: Options, name: str, default: float) -> float:
    seconds = _real(options, name) if name in options else default
    if not 0 <= seconds <= _LONGEST:
        raise _invalid(
            pick(f"{name} is 0 to {_LONGEST} s, not {seconds:g}", f"{name} は 0 から {_LONGEST} 秒です ({seconds:g})")
        )
    return seconds
