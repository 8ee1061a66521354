"""Parameters of a virtual ABH3 (section 1 of the manufacturer's document) and of its motors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from orinkit.abh3.table.ids import BROADCASTS, GROUPS, LAST_ADDRESS
from orinkit.abh3.table.signals import CURRENT, DIALECTS, VELOCITY, VOLTAGE
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_range, check_whole

_set: Final = object.__setattr__  # the records below are frozen

SETS: Final = 8
"""Number of data sets of an axis; the select bits of the axis choose one of them."""
LONGEST_PERIOD: Final = 1000
"""Longest period of a periodic frame, ms."""
LONGEST_TIMEOUT: Final = 10_000
"""Longest time-out, ms."""

_FASTEST: Final = VELOCITY.high / VELOCITY.steps
_STRONGEST: Final = CURRENT.high / CURRENT.steps
_MAX_VOLTS: Final = VOLTAGE.high / VOLTAGE.steps
_PRIORITY: Final = 7
_RANGES: Final[dict[str, tuple[float, float]]] = {
    "address": (0, LAST_ADDRESS),
    "group": (0, GROUPS - 1),
    "single_priority": (0, _PRIORITY),
    "multi_priority": (0, _PRIORITY),
    "broadcast_priority": (0, _PRIORITY),
    "command_timeout": (0, LONGEST_TIMEOUT),
    "error_timeout": (0, LONGEST_TIMEOUT),
    "pulses_per_revolution": (1, 65_536),
    "rated_speed": (1.0, _FASTEST),
    "acceleration_time": (0.001, 100.0),
    "deceleration_time": (0.001, 100.0),
    "speed_limit": (0.0, _FASTEST),
    "current_limit": (0.0, _STRONGEST),
    "inertia": (0.001, 100.0),
    "friction": (0.1, 100.0),
    "main_voltage": (0.0, _MAX_VOLTS),
    "control_voltage": (0.0, _MAX_VOLTS),
}


def _choice(name: str, value: object, known: tuple[Any, ...]) -> None:
    if isinstance(value, bool) or not isinstance(value, str | float | int) or value not in known:
        raise _unusable(name, value, " / ".join(str(item) for item in known))


def _unusable(name: str, value: object, known: str) -> InvalidValue:
    return InvalidValue(tr("{name} must be {known}, not {value}", name=name, known=known, value=brief(value)))


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set: the source of the command of an axis while the select bits of the axis choose this set.

    Attributes:
        source: ``"can"`` if the command comes from the host; ``"internal"`` if the command is ``velocity``, or in
            torque mode ``current``.
        velocity: Internal velocity command, min^-1.
        current: Internal current command in torque mode, %.

    Raises:
        InvalidValue: If a value is out of range.
    """

    source: Literal["can", "internal"] = "can"
    velocity: float = 0.0
    current: float = 0.0

    def __post_init__(self) -> None:
        _choice("source", self.source, ("can", "internal"))
        _set(self, "velocity", check_range("velocity", self.velocity, -_FASTEST, _FASTEST))
        _set(self, "current", check_range("current", self.current, -_STRONGEST, _STRONGEST))


_ALL_FROM_CAN: Final = (DataSet(),) * SETS


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of a driver; the defaults are those of section 1 of the manufacturer's document.

    Attributes:
        dialect: ``"v1"`` (drivers as in the document) or ``"v2"`` (drivers of 2023 and later).
        address: Address of the driver, 0 to 253.
        host: Address of its host, 0 to 253; ``None`` to answer every host.
        group: Group of its broadcasts, 0 to 31.
        single_priority: Priority of single packets, 0 (highest) to 7.
        multi_priority: Priority of multi-packet messages, 0 (highest) to 7.
        broadcast_priority: Priority of broadcasts, 0 (highest) to 7.
        single_mode: Answering mode of single packets. With -1 or 0, the driver sends a report in reply to a command or
            request. With 1 to 1000, it also sends reports periodically; the number is the period in ms (requires
            ``host``). With ``None``, it never sends one.
        broadcast_modes: Answering modes of the broadcasts 0 to 7. With 0, the driver sends the broadcast on request.
            With 1 to 1000, it also sends the broadcast periodically; the number is the period in ms.
        command_timeout: Time without a command after which the axes stop and a warning is raised, ms; 0 for never.
        error_timeout: Time without a command after which an error is raised, ms; 0 for never.
        load_unit: Unit of loads on CAN: 1 or 0.1 %.
        model: ``"motor"``: the commands are for the motors A and B; ``"travel"``: the commands are for Y (travel) and X
            (turn), with A = Y + X and B = Y - X.
        rated_speed: Rated speed, min^-1.
        acceleration_time: Time from 0 to the rated speed, s.
        deceleration_time: Time from the rated speed to 0, s.
        speed_limit: Speed limit of each commanded axis, min^-1.
        current_limit: Current limit, % of the rated current.
        pulses_per_revolution: Resolution of the pulse counts.
        inertia: Time in which the rated current accelerates a motor from 0 to the rated speed, s.
        friction: Current that keeps a motor turning, % of the rated current.
        ay_sets: The eight data sets of A/Y.
        bx_sets: The eight data sets of B/X.
        main_voltage: Voltage of the main supply, V.
        control_voltage: Voltage of the control supply, V.

    Raises:
        InvalidValue: If a value is out of range; the message names the parameter and its range.
    """

    dialect: Literal["v1", "v2"] = "v1"
    address: int = 1
    host: int | None = 2
    group: int = 5
    single_priority: int = 0
    multi_priority: int = 0
    broadcast_priority: int = 0
    single_mode: int | None = -1
    broadcast_modes: Sequence[int] = (0,) * BROADCASTS
    command_timeout: int = 500
    error_timeout: int = 1000
    load_unit: float = 1.0
    model: Literal["motor", "travel"] = "motor"
    rated_speed: float = 3000.0
    acceleration_time: float = 0.5
    deceleration_time: float = 0.5
    speed_limit: float = 3000.0
    current_limit: float = 200.0
    pulses_per_revolution: int = 256
    inertia: float = 0.25
    friction: float = 5.0
    ay_sets: Sequence[DataSet] = _ALL_FROM_CAN
    bx_sets: Sequence[DataSet] = _ALL_FROM_CAN
    main_voltage: float = 24.0
    control_voltage: float = 24.0

    def __post_init__(self) -> None:
        _choice("dialect", self.dialect, tuple(DIALECTS))
        _choice("model", self.model, ("motor", "travel"))
        _choice("load_unit", self.load_unit, (1.0, 0.1))
        for name, (low, high) in _RANGES.items():
            given = getattr(self, name)
            whole = isinstance(low, int)
            _set(
                self,
                name,
                check_whole(name, given, int(high), int(low)) if whole else check_range(name, given, low, high),
            )
        if self.host is not None:
            _set(self, "host", check_whole("host", self.host, LAST_ADDRESS))
        if self.host == self.address:
            raise _unusable("host", self.host, tr("different from address"))
        if self.single_mode is not None:
            _set(self, "single_mode", check_whole("single_mode", self.single_mode, LONGEST_PERIOD, -1))
            if self.single_mode > 0 and self.host is None:
                raise _unusable("single_mode", self.single_mode, tr("-1 or 0 if host is None"))
        self._check_rows()

    def _check_rows(self) -> None:
        for name, kind in (("broadcast_modes", int), ("ay_sets", DataSet), ("bx_sets", DataSet)):
            row = getattr(self, name)
            eight = isinstance(row, Sequence) and len(row) == BROADCASTS
            if not eight or not all(isinstance(item, kind) for item in row):
                raise _unusable(name, row, tr("a sequence of 8 {type}", type=kind.__name__))
            _set(self, name, tuple(row))  # a list could change later
        for mode in self.broadcast_modes:
            check_whole("broadcast_modes", mode, LONGEST_PERIOD)
