"""Internal and external speeds in percent: what a motion really runs at is their product."""

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
    """Speed, acceleration and deceleration in percent of the largest."""

    speed: float = FULL
    accel: float = FULL
    decel: float = FULL


@dataclass(slots=True)
class Speeds:
    """What the arm's speeds are set to.

    Attributes:
        path: internal, of motions along a path (``@SPEED``, ``@ACCEL``, ``@DECEL``).
        joint: internal, of point-to-point motions (``@JSPEED``, ``@JACCEL``, ``@JDECEL``).
        external: ``@EXTSPEED``, ``@EXTACCEL``, ``@EXTDECEL``; they hold for every motion.
    """

    path: SpeedSet = field(default_factory=SpeedSet)
    joint: SpeedSet = field(default_factory=SpeedSet)
    external: SpeedSet = field(default_factory=SpeedSet)

    def reset(self) -> None:
        """Set the internal ones to 100 %, as TakeArm does without ``Keep`` (RC8 3.3.2)."""
        self.path, self.joint = SpeedSet(), SpeedSet()

    def set_internal(self, speed: float, *, joint_only: bool = False) -> None:
        """Set the internal speed: of both kinds of motion, or only of point-to-point ones."""
        speed = percent(speed)
        self.joint.speed = speed
        if not joint_only:
            self.path.speed = speed

    def set_acceleration(self, accel: float, decel: float, *, joint_only: bool = False) -> None:
        """Set internal acceleration and deceleration; -1 keeps one."""
        trios = (self.joint,) if joint_only else (self.joint, self.path)
        wanted = [None if value == KEEP else percent(value) for value in (accel, decel)]
        for trio in trios:
            trio.accel = trio.accel if wanted[0] is None else wanted[0]
            trio.decel = trio.decel if wanted[1] is None else wanted[1]

    def set_external(self, speed: float, accel: float = SQUARE, decel: float = SQUARE) -> None:
        """Set the external speeds: -1 keeps one, -2 sets an acceleration to speed squared by 100, the default."""
        trio = self.external
        new = SpeedSet(trio.speed if speed == KEEP else percent(speed), trio.accel, trio.decel)
        square = max(_LEAST, new.speed * new.speed / FULL)
        if accel != KEEP:
            new.accel = square if accel == SQUARE else percent(accel)
        if decel != KEEP:
            new.decel = square if decel == SQUARE else percent(decel)
        self.external = new


def percent(value: float) -> float:
    """Return a percentage above 0, up to 100.

    Raises:
        CallError: VALUE_OUT_OF_RANGE.
    """
    if not _LEAST <= value <= FULL:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{value:g} %, {least} to 100 is possible", value=value, least=_LEAST),
        )
    return value
