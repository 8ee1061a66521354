"""The parameters of a virtual ABH3 (section 1), and of the motors that it drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from orinkit.abh3.table.ids import BROADCASTS, GROUPS, LAST_ADDRESS
from orinkit.abh3.table.signals import CURRENT, DIALECTS, VELOCITY, VOLTAGE
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr

SETS: Final = 8
"""Data sets of an axis, chosen by its select bits."""
LONGEST_PERIOD: Final = 1000
"""ms between two frames that are sent unasked, at most."""
LONGEST_TIMEOUT: Final = 10_000
"""ms."""

_FASTEST: Final = VELOCITY.high / VELOCITY.steps
_STRONGEST: Final = CURRENT.high / CURRENT.steps
_MOST_VOLTS: Final = VOLTAGE.high / VOLTAGE.steps
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
    "main_voltage": (0.0, _MOST_VOLTS),
    "control_voltage": (0.0, _MOST_VOLTS),
}


def _choice(name: str, value: object, known: tuple[Any, ...]) -> None:
    if isinstance(value, bool) or not isinstance(value, str | float | int) or value not in known:
        raise _unusable(name, value, " / ".join(str(item) for item in known))


def _whole(name: str, value: object, low: float, high: float) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise _unusable(name, value, tr("a whole number of {low} to {high}", low=low, high=high))


def check_number(name: str, value: object, low: float, high: float) -> None:
    """Check a number.

    Raises:
        InvalidValue: it is none, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise _unusable(name, value, tr("{low:g} to {high:g}", low=low, high=high))


def _unusable(name: str, value: object, known: str) -> InvalidValue:
    return InvalidValue(tr("{name} must be {known}, not {value!r:.60}", name=name, known=known, value=value))


@dataclass(frozen=True, slots=True)
class DataSet:
    """Where the command of an axis comes from while its select bits choose this set.

    Attributes:
        source: ``"can"`` or ``"internal"``.
        velocity: internal command in min^-1.
        current: internal command in torque mode, %.

    Raises:
        InvalidValue: a value is out of range.
    """

    source: Literal["can", "internal"] = "can"
    velocity: float = 0.0
    current: float = 0.0

    def __post_init__(self) -> None:
        _choice("source", self.source, ("can", "internal"))
        check_number("velocity", self.velocity, -_FASTEST, _FASTEST)
        check_number("current", self.current, -_STRONGEST, _STRONGEST)


_ALL_FROM_CAN: Final = (DataSet(),) * SETS


@dataclass(frozen=True, slots=True)
class Parameters:
    """What a driver is set to. All have the values of section 1 unless they are given.

    Attributes:
        dialect: ``"v1"``, the document's, or ``"v2"`` of 2023.
        address: of the driver, 0 to 253.
        host: address of its host, 0 to 253; ``None`` for any: each one is answered that asks.
        group: of its broadcasts, 0 to 31.
        single_priority: of single packets, 0 (first) to 7.
        multi_priority: of multi-packet messages.
        broadcast_priority: of broadcasts.
        single_mode: when it sends single packets: -1 or 0 when asked; 1 to 1000 also every so many ms, to a fixed host
            only; ``None`` never.
        broadcast_modes: the same of broadcasts 0 to 7: 0 when asked, 1 to 1000 also every so many ms.
        command_timeout: ms without a command after which start is off; 0 for never.
        error_timeout: ms without a command after which that is an error; 0 for never.
        load_unit: of loads on CAN: 1 or 0.1 %.
        model: ``"motor"``: commands are those of A and B; ``"travel"``: of Y, which moves, and X, which turns: A = Y + X and
            B = Y - X.
        rated_speed: min^-1.
        acceleration_time: s from 0 to the rated speed.
        deceleration_time: s from the rated speed to 0.
        speed_limit: of each commanded axis, min^-1.
        current_limit: % of the rated current.
        pulses_per_revolution: of the counts.
        inertia: s that the rated current takes from 0 to the rated speed.
        friction: % of the rated current that keeps a motor turning.
        ay_sets: the eight data sets of A/Y.
        bx_sets: those of B/X.
        main_voltage: of the main supply, V.
        control_voltage: of the control supply, V.

    Raises:
        InvalidValue: one is out of range; it says which and what there is.
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
            check = _whole if isinstance(low, int) else check_number
            check(name, getattr(self, name), low, high)
        if self.host is not None:
            _whole("host", self.host, 0, LAST_ADDRESS)
        if self.host == self.address:
            raise _unusable("host", self.host, tr("another one than address"))
        if self.single_mode is not None:
            _whole("single_mode", self.single_mode, -1, LONGEST_PERIOD)
            if self.single_mode > 0 and self.host is None:
                raise _unusable("single_mode", self.single_mode, tr("-1 or 0 without a fixed host"))
        self._check_rows()

    def _check_rows(self) -> None:
        for name, kind in (("broadcast_modes", int), ("ay_sets", DataSet), ("bx_sets", DataSet)):
            row = getattr(self, name)
            eight = isinstance(row, Sequence) and len(row) == BROADCASTS
            if not eight or not all(isinstance(item, kind) for item in row):
                raise _unusable(name, row, tr("8 x {type}", type=kind.__name__))
            object.__setattr__(self, name, tuple(row))  # a list could change later
        for mode in self.broadcast_modes:
            _whole("broadcast_modes", mode, 0, LONGEST_PERIOD)
