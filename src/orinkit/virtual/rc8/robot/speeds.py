"""Internal and external speeds in percent; a motion runs at their product."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

FULL: Final = 100.0
KEEP: Final = -1.0
SQUARE: Final = -2.0
_LEAST: Final = 0.01


@dataclass(slots=True)
class SpeedSet:
    """Speed, acceleration and deceleration in percent of the largest values."""

    speed: float = FULL
    accel: float = FULL
    decel: float = FULL


@dataclass(slots=True)
class Speeds:
    """The speed settings of the arm.

    Attributes:
        path: Internal speeds for motions along a path (``@SPEED``, ``@ACCEL``, ``@DECEL``).
        joint: Internal speeds for point-to-point motions (``@JSPEED``, ``@JACCEL``, ``@JDECEL``).
        external: External speeds, which apply to every motion (``@EXTSPEED``, ``@EXTACCEL``, ``@EXTDECEL``).
        avoid_singular: True to slow paths down near singular points instead of refusing them (SingularAvoid).
        mode: Number of the mode of optimal speed (SpeedMode), 0 to 3. The planner always uses the limits of the model,
            so that the mode has no effect.
    """

    path: SpeedSet = field(default_factory=SpeedSet)
    joint: SpeedSet = field(default_factory=SpeedSet)
    external: SpeedSet = field(default_factory=SpeedSet)
    avoid_singular: bool = False
    mode: int = 0

    def reset(self) -> None:
        """Set the internal speeds to 100 % and the modes to off, as TakeArm without ``Keep`` does (RC8 3.3.2)."""
        self.path, self.joint = SpeedSet(), SpeedSet()
        self.avoid_singular, self.mode = False, 0

    def set_internal(self, speed: float, *, joint_only: bool = False) -> None:
        """Set the internal speed for all motions, or only for point-to-point motions."""
        speed = percent(speed)
        self.joint.speed = speed
        if not joint_only:
            self.path.speed = speed

    def set_acceleration(self, accel: float, decel: float, *, joint_only: bool = False) -> None:
        """Set internal acceleration and deceleration for all motions, or only for point-to-point motions.

        -1 keeps a value.
        """
        trios = (self.joint,) if joint_only else (self.joint, self.path)
        new = [None if value == KEEP else percent(value) for value in (accel, decel)]
        for trio in trios:
            trio.accel = trio.accel if new[0] is None else new[0]
            trio.decel = trio.decel if new[1] is None else new[1]

    def set_external(self, speed: float, accel: float = SQUARE, decel: float = SQUARE) -> None:
        """Set the external speed, acceleration and deceleration.

        -1 keeps a value; -2 sets acceleration or deceleration to the default, speed squared / 100.
        """
        trio = self.external
        new = SpeedSet(trio.speed if speed == KEEP else percent(speed), trio.accel, trio.decel)
        square = max(_LEAST, new.speed * new.speed / FULL)
        if accel != KEEP:
            new.accel = square if accel == SQUARE else percent(accel)
        if decel != KEEP:
            new.decel = square if decel == SQUARE else percent(decel)
        self.external = new


def percent(value: float) -> float:
    """Return a percentage after checking that it is 0.01 to 100.

    Raises:
        CallError: VALUE_OUT_OF_RANGE.
    """
    if not _LEAST <= value <= FULL:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("Out of range: {value:g} %; expected {least} to 100 %", value=value, least=_LEAST),
        )
    return value
