"""TelABH3 access to a virtual ABH3: parameters, monitors, identifications.

A request for an unknown address of a parameter or monitor is refused. Some parameters are fixed: they can only be
written with their present value. A written parameter takes effect after the reply has been sent, because it may be the
driver's own address on the bus, from which the reply must come. If ``single_mode`` is ``None``, its value is read as
-1.

The parameters for servo, start and data select switch the terminals that are combined with the inputs from CAN. The
monitor of the digital inputs has one bit for each input, in the order of their numbers. The monitor "input control"
contains the control flags, and the monitor "output control" contains the I/O flags. The document does not specify these
layouts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from orinkit.abh3.session import telabh3
from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS
from orinkit.abh3.table.ids import BROADCASTS, SINGLE
from orinkit.abh3.table.records import Flags
from orinkit.core.errors import InvalidValue, ProtocolError
from orinkit.virtual.abh3.drive import AXES
from orinkit.virtual.abh3.driver import OUTPUTS, DriverModel
from orinkit.virtual.abh3.parameters import SETS, Parameters

IDENTIFICATIONS: Final = {0: "ABH3", telabh3.VERSION: "orinkit virtual ABH3"}
"""Texts of the supported identifications, by address."""

_ANY_HOST: Final = -1
_FUNCTION: Final = 0x4100
_HOST: Final = 0x4103
_SINGLE_MODE: Final = 0x4105
_MODES: Final = 0x4108
_RECEPTIONS: Final = range(0x4110, 0x4114)
_FIELDS: Final = {
    0x4102: "address",
    _HOST: "host",
    _SINGLE_MODE: "single_mode",
    0x4107: "group",
    0x4114: "single_priority",
    0x4115: "multi_priority",
    0x4116: "broadcast_priority",
    0x4117: "command_timeout",
    0x4118: "error_timeout",
}
_ENABLED: Final = 2  # the CAN function
_FIXED: Final = {_FUNCTION: _ENABLED, **dict.fromkeys(_RECEPTIONS, 0), 0x4119: 0, 0x411A: 0, 0x6180: SINGLE}
_TIMES: Final = {0x5020: "acceleration_time", 0x5040: "deceleration_time"}  # addresses for the first data set of A/Y
_S_CURVES: Final = (0x5030, 0x5050)
_BX_TIMES: Final = 0x60  # offset of the addresses for B/X
_SOURCES: Final = {"internal": 0, "can": 2}
_OUTPUT: Final = 0x5180
_CLOSED: Final = 0xFFFFFFFF
_SWITCHES: Final = {0: "servo_on", 1: "start", 7: "select_0", 8: "select_1", 9: "select_2"}


def _sets() -> dict[int, tuple[str, int, str]]:
    """Return for each address the field of Parameters, the number of the data set, and the name of its value."""
    firsts = {
        "velocity": (0x5000, 0x5008),
        "current": (0x5010, 0x5018),
        "source": (0x50E0, 0x50F0),
    }
    return {
        first + number: (f"{axis}_sets", number, value)
        for value, both in firsts.items()
        for axis, first in zip(AXES, both, strict=True)
        for number in range(SETS)
    }


def _terminals() -> dict[int, str]:
    return {
        first + offset: f"{axis}_{name}"
        for axis, first in zip(AXES, (0x5100, 0x5120), strict=True)
        for offset, name in _SWITCHES.items()
    }


def _times() -> dict[int, str]:
    """Return for each address of a time the field of Parameters; ``""`` for the S-curve times, which are always 0."""
    rows = {**_TIMES, **dict.fromkeys(_S_CURVES, "")}
    return {
        first + bx + number: name for first, name in rows.items() for bx in (0, _BX_TIMES) for number in range(SETS)
    }


_INPUTS: Final = 0x0002
_DIGITAL_INPUTS: Final = 20
_OUTPUTS: Final = 0x0004
_TORQUES: Final = (0x1031, 0x1041)
_STATES: Final = {
    0x0000: "errors",
    0x0001: "warnings",
    0x0003: "control",
    0x0005: "io",
    0x1004: "main_voltage",
    0x1005: "control_voltage",
    0x1012: "ay_velocity",
    0x1022: "bx_velocity",
    0x103B: "a_load",
    0x104B: "b_load",
    0x1054: "a_pulses",
    0x1064: "b_pulses",
}
_SETS_AT: Final = _sets()
_TERMINALS_AT: Final = _terminals()
_TIMES_AT: Final = _times()


class ParameterMemory:
    """Parameters and monitors of a driver, by address.

    Args:
        driver: The driver.
        switch: Function that switches a terminal on or off.

    Attributes:
        written: All parameters as last changed by a host, while the changes have not taken effect; otherwise ``None``.
    """

    def __init__(self, driver: DriverModel, switch: Callable[[str, bool], None]) -> None:
        self.written: Parameters | None = None
        self._driver = driver
        self._switch = switch

    def answer(self, message: bytes, host: int) -> bytes:
        """Return the reply to a message.

        The reply is a refusal if the message is not a valid request, the address is unknown or a value is not valid.
        """
        try:
            request = telabh3.parse_request(message)
            return telabh3.reply(self._execute(request))
        except (InvalidValue, ProtocolError, LookupError):
            return telabh3.refusal()

    def _execute(self, request: telabh3.TelRequest) -> int | str:
        """Execute a request and return the content of the reply.

        Raises:
            InvalidValue: If a value cannot be written.
            LookupError: If there is no such address.
        """
        if request.command == telabh3.IDENTIFICATION:
            return IDENTIFICATIONS[request.address]
        if request.command == telabh3.MONITOR:
            return self._monitor(request.address)
        if request.value is None:
            return self._parameter(request.address)
        self._write(request.address, request.value)
        return ""

    @property
    def _latest(self) -> Parameters:
        return self.written or self._driver.parameters

    # --- monitors -----------------------------------------------------------------------------------------------

    def _monitor(self, address: int) -> int:
        state = self._driver.state()
        if address == _OUTPUTS:
            value: float = self._driver.outputs << 24
        elif address == _INPUTS:
            value = sum(1 << n for n in range(_DIGITAL_INPUTS) if state.io[f"di_{n}"])
        elif address in _TORQUES:
            value = self._driver.drive.currents()[_TORQUES.index(address)]
        else:
            shown = getattr(state, _STATES[address])
            value = int(shown) if isinstance(shown, Flags) else shown
        return MONITORS[address].encode(value)

    # --- parameters ---------------------------------------------------------------------------------------------

    def _parameter(self, address: int) -> int:
        if _OUTPUT <= address < _OUTPUT + OUTPUTS:
            return _CLOSED if self._driver.outputs >> (address - _OUTPUT) & 1 else 0
        return PARAMETERS[address].encode(self._value(address))

    def _value(self, address: int) -> float:
        parameters = self._latest
        if address in _FIXED:
            return _FIXED[address]
        if address in _FIELDS:
            value: int | None = getattr(parameters, _FIELDS[address])
            return _ANY_HOST if value is None else value
        if _MODES <= address < _MODES + BROADCASTS:
            return parameters.broadcast_modes[address - _MODES]
        if address in _TERMINALS_AT:
            mask = self._driver.dialect.inputs.masks[_TERMINALS_AT[address]]
            return telabh3.ON if self._driver.inputs.external & mask else telabh3.OFF
        if address in _TIMES_AT:
            return float(getattr(parameters, _TIMES_AT[address])) if _TIMES_AT[address] else 0.0
        row, number, name = _SETS_AT[address]
        chosen = getattr(getattr(parameters, row)[number], name)
        return _SOURCES[chosen] if name == "source" else float(chosen)

    def _write(self, address: int, word: int) -> None:
        if _OUTPUT <= address < _OUTPUT + OUTPUTS:
            self._write_output(address - _OUTPUT, word)
            return
        value = PARAMETERS[address].decode(word)
        if address in _TERMINALS_AT:
            self._switch(_TERMINALS_AT[address], _lookup({telabh3.OFF: False, telabh3.ON: True}, value))
        elif address in _FIXED or address in _TIMES_AT:
            _lookup({self._parameter(address): None}, word)
        else:
            self.written = self._with_value(address, value)

    def _write_output(self, number: int, word: int) -> None:
        mask = _lookup({0: 0, _CLOSED: 1 << number}, word)
        self._driver.outputs = self._driver.outputs & ~(1 << number) | mask

    def _with_value(self, address: int, value: Any) -> Parameters:
        """Return the latest parameters, with the value at ``address`` replaced.

        Raises:
            InvalidValue: If the value is not valid.
        """
        parameters = self._latest
        if address in _FIELDS:
            value = None if address == _HOST and value == _ANY_HOST else value
            return replace(parameters, **{_FIELDS[address]: value})
        if _MODES <= address < _MODES + BROADCASTS:
            return replace(parameters, broadcast_modes=_with(parameters.broadcast_modes, address - _MODES, value))
        row, number, name = _SETS_AT[address]
        if name == "source":
            value = _lookup({code: source for source, code in _SOURCES.items()}, value)
        sets = getattr(parameters, row)
        changed = replace(sets[number], **{name: value})
        changes: dict[str, Any] = {row: _with(sets, number, changed)}
        return replace(parameters, **changes)


def _with(row: Any, number: int, value: Any) -> tuple[Any, ...]:
    return (*row[:number], value, *row[number + 1 :])


def _lookup(known: dict[int, Any], value: float) -> Any:
    """Return the entry of a table for a value that a host has written.

    Raises:
        LookupError: If the table does not contain the value.
    """
    return known[int(value)]
