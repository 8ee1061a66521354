"""Export of the frames of ABH3 drivers as a DBC file, generated from the table in :mod:`orinkit.abh3.table.signals`."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterable, Iterator, Mapping
from struct import Struct
from typing import TYPE_CHECKING, Any, Final

from orinkit.abh3.table import ids
from orinkit.abh3.table.signals import CURRENT, Dialect, FrameLayout, Quantity, SignalField, Word, dialect_of
from orinkit.abh3.table.transfer_fields import KINDS, PARTS, PGN_AT, REASONS
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal
    from cantools.database.conversion import BaseConversion
    from cantools.database.namedsignalvalue import NamedSignalValue

_HOST: Final = "HOST"
_DRIVER: Final = "ABH3"
_FULL: Final = 8
_REQUEST: Final = 3
_FLOAT: Final = "f"
_SIGNED: Final = "hi"
_OFF_ON: Final = {0: "off", 1: "on"}
_PRIORITY: Final = "Identifiers have priority 0; receivers ignore the priority (mask 0x03FFFFFF)."


def dbc(
    dialect: str | Dialect = "v1",
    *,
    addresses: Iterable[int] = (1,),
    host: int = 2,
    group: int = 5,
    load_unit: float = 1.0,
) -> str:
    """Return a DBC file with every frame of a bus: commands, feedback, broadcasts, requests, multi-packet frames.

    Signals have the names of the fields of the records. A flag is a signal of one bit; its name begins with the name of
    its flag word: ``inputs_ay_servo_on``. The A/Y command is the signal ``ay_command`` in min^-1, or
    ``ay_command_torque`` in % if the input ``ay_torque`` is on. If there are several drivers, the name of a message
    ends with the address of the driver: ``DP0R_3``.

    Args:
        dialect: Dialect of the drivers, ``"v1"`` or ``"v2"``.
        addresses: Addresses of the drivers.
        host: Address of the host.
        group: Group of the drivers' broadcasts.
        load_unit: Resolution of the loads in frames, in %: 1 or 0.1.

    Returns:
        ASCII text with line feeds. It is in English, because DBC files are limited to ASCII.

    Raises:
        InvalidValue: If the dialect, an address, the group or the unit is not valid, or an address occurs twice.
        MissingExtra: If cantools is not installed.
    """
    require(tr("a DBC file"), "can", "cantools")
    from cantools.database.can import Database, Node

    selected = dialect_of(dialect).with_load_unit(load_unit)
    drivers = _addresses(addresses, ids.check_address("host", host))
    ids.check_group(group)
    names = {address: f"_{address}" if len(drivers) > 1 else "" for address in drivers}
    messages = [message for address in drivers for message in _messages(selected, address, names[address], host, group)]
    messages.append(_request("REQUEST_ALL", ids.request(ids.EVERYONE, host), group))
    nodes = [
        Node(_HOST, f"Host, address {host}"),
        *(Node(f"{_DRIVER}{names[address]}", f"ABH3 driver, address {address}, group {group}") for address in drivers),
    ]
    text: str = Database(messages=messages, nodes=nodes, version=f"ABH3 {selected.name}").as_dbc_string(
        sort_signals=None
    )
    return text.replace("\r\n", "\n")


def _addresses(addresses: Iterable[int], host: int) -> list[int]:
    """Check the addresses of the drivers and return them as a list.

    Raises:
        InvalidValue: If an address is not valid, occurs twice, or is the host's, or if there is no address.
    """
    drivers = [ids.check_address("address", address) for address in addresses]
    if not drivers:
        raise InvalidValue(tr("at least one driver address is required"))
    for address in drivers:
        if drivers.count(address) > 1 or address == host:
            raise InvalidValue(
                tr(
                    "address {address} occurs twice: each driver and the host must have different addresses",
                    address=address,
                )
            )
    return drivers


def _messages(dialect: Dialect, address: int, suffix: str, host: int, group: int) -> Iterator[Message]:
    """Yield the frames between a driver and its host."""
    driver = f"{_DRIVER}{suffix}"
    for layout in dialect.layouts.values():
        sender = _HOST if layout.from_host else driver
        yield _message(
            f"{layout.name}{suffix}", _id(layout, address, host, group), _data_signals(layout),
            sender, comment=_comment(layout),
        )  # fmt: skip
        if layout.dp:
            text = f"Request for {layout.name} (section {layout.section}). The document withholds it. {_PRIORITY}"
            yield _message(f"DP1S{suffix}", ids.single(address, host, dp=1), [], _HOST, length=0, comment=text)
    yield _request(f"REQUEST{suffix}", ids.request(address, host), group)
    for letter, sender, to, source in (("S", _HOST, address, host), ("R", driver, host, address)):
        control, data = (int(ids.FrameId(pf, to, source)) for pf in (ids.CONTROL, ids.TRANSFER))
        text = f"frame of a multi-packet message. {_PRIORITY}"
        yield _message(f"TP_CM_{letter}{suffix}", control, _control_signals(), sender, comment=f"Control {text}")
        yield _message(f"TP_DT_{letter}{suffix}", data, _packet_signals(), sender, comment=f"Data {text}")


def _id(layout: FrameLayout, address: int, host: int, group: int) -> int:
    if layout.broadcast is not None:
        return ids.broadcast(group, layout.broadcast, address)
    to, source = (address, host) if layout.from_host else (host, address)
    return ids.single(to, source, dp=layout.dp)


def _comment(layout: FrameLayout) -> str:
    withheld = " The document withholds it." if layout.undocumented else ""
    return f"{_sentence(layout.title)} (section {layout.section}).{withheld} {_PRIORITY}"


# --- data -------------------------------------------------------------------------------------------------------------


def _data_signals(layout: FrameLayout) -> list[Signal]:
    """Return the signals of a frame, according to its layout in the table."""
    signals: list[Signal] = []
    switches = [field.torque_input for field in layout.fields if field.torque_input]
    for field, start in layout.starts:
        if field.word is not None:
            signals += _flag_signals(field, field.word, start, switches)
        elif field.quantity is not None and field.torque_input:
            switch = f"inputs_{field.torque_input}"
            signals.append(_number_signal(field, field.quantity, start, switch, 0))
            signals.append(_number_signal(field, CURRENT, start, switch, 1))
        elif field.quantity is not None:
            signals.append(_number_signal(field, field.quantity, start))
    return signals


def _number_signal(field: SignalField, quantity: Quantity, start: int, switch: str = "", state: int = 0) -> Signal:
    """Return the signal of a number. With ``switch``, only frames with a certain state of a flag contain the signal.

    Args:
        field: Field that contains the number.
        quantity: Quantity of the number.
        start: Number of the first bit.
        switch: Name of the signal of the flag.
        state: State of the flag in frames that contain the signal, 0 or 1.
    """
    is_float = field.code == _FLOAT
    steps = quantity.steps or 1
    when = f" while {switch} is {_OFF_ON[state]}" if switch else ""
    return _signal(
        f"{field.name}_torque" if state else field.name,
        start,
        8 * Struct(field.code).size,
        is_signed=is_float or field.code in _SIGNED,
        conversion=_conversion(scale=1 if steps == 1 else 1 / steps, is_float=is_float),
        minimum=None if is_float else _limit(quantity.low, steps),
        maximum=None if is_float else _limit(quantity.high, steps),
        unit=quantity.unit or None,
        comment=f"{_sentence(field.title)}{when}",
        multiplexer_signal=switch or None,
        multiplexer_ids=[state] if switch else None,
    )


def _limit(code: int, steps: int) -> float:
    return code if steps == 1 else code / steps


def _flag_signals(field: SignalField, word: Word, start: int, switches: Collection[str]) -> Iterator[Signal]:
    for bit in sorted(word.bits, key=lambda bit: bit.number):
        yield _signal(
            f"{field.name}_{bit.name}",
            start + bit.number,
            1,
            conversion=_conversion(choices=_OFF_ON),
            minimum=0,
            maximum=1,
            comment=f"{_sentence(word.title)}, bit {bit.number}: {bit.english}",
            is_multiplexer=bit.name in switches,
        )


# --- requests, multi-packet messages ----------------------------------------------------------------------------------


def _request(name: str, frame_id: int, group: int) -> Message:
    wanted = {
        int.from_bytes(ids.pgn(ids.SINGLE, 0, dp=dp), "little"): ("DP0R", "DP1R")[dp] for dp in (0, 1)
    }  # fmt: skip
    for number in range(ids.BROADCASTS):
        pgn = ids.pgn(ids.BROADCAST, group * ids.BROADCASTS + number)
        wanted[int.from_bytes(pgn, "little")] = f"BR{number}"
    signal = _signal("pgn", 0, 24, conversion=_conversion(choices=wanted), comment="PGN of the requested frame")
    return _message(name, frame_id, [signal], _HOST, length=_REQUEST, comment=f"Request for a frame. {_PRIORITY}")


def _control_signals() -> list[Signal]:
    """Return the signals of a control frame: the control byte, and the fields for each of its values."""
    signals = [_signal("control", 0, 8, conversion=_conversion(choices=KINDS), is_multiplexer=True)]
    for part in PARTS:
        reasons = REASONS if part.name == "reason" else None
        signals.append(
            _signal(
                part.name, 8 * part.start, 8 * part.size,
                conversion=_conversion(choices=reasons), unit=part.unit or None, comment=_sentence(part.title),
                multiplexer_signal="control", multiplexer_ids=list(part.kinds),
            )
        )  # fmt: skip
    return [*signals, _signal("pgn", 8 * PGN_AT, 24, comment="PGN of the message")]


def _packet_signals() -> list[Signal]:
    signals = [_signal("number", 0, 8, comment="Number of the packet, from 1")]
    return signals + [_signal(f"data_{n}", 8 * n, 8) for n in range(1, _FULL)]


# --- cantools ---------------------------------------------------------------------------------------------------------


def _message(
    name: str, frame_id: int, signals: list[Signal], sender: str, *, length: int = _FULL, comment: str
) -> Message:
    from cantools.database.can import Message

    return Message(
        frame_id, name, length, signals, comment=comment, senders=[sender], is_extended_frame=True, strict=True
    )


def _signal(name: str, start: int, length: int, **rest: Any) -> Signal:
    from cantools.database.can import Signal

    return Signal(name, start, length, **rest)


def _conversion(
    *, scale: float = 1, choices: Mapping[int, str] | None = None, is_float: bool = False
) -> BaseConversion:
    from cantools.database.conversion import BaseConversion

    names: OrderedDict[int, str | NamedSignalValue] | None = None if choices is None else OrderedDict(choices)
    return BaseConversion.factory(scale=scale, choices=names, is_float=is_float)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
