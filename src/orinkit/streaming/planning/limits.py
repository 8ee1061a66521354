"""Limits of a stream: how far and how fast set-points may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

from orinkit.arms import ArmModel
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.public_name import public
from orinkit.core.validation import brief, check_amount, check_finite, check_positive
from orinkit.values.pose_numbers import MAX_JOINTS

SECONDS_TO_ACCELERATION: Final = 0.05
"""Time in s in which an axis can increase its acceleration from zero to the limit.

This time is an assumption of this project, because DENSO publishes no jerk limits.
"""

_LARGEST: Final = 1e9  # the largest value for which jerk-limited planning works


@public("orinkit")
@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a stream of joint positions, one value per axis: deg, or mm for linear axes.

    Attributes:
        lower: Lowest positions.
        upper: Highest positions.
        velocity: Largest velocities, per second.
        acceleration: Largest accelerations, per second squared.
        jerk: Largest jerks, per second cubed. The controller does not check them. They apply to the motions that the
            client plans, so that these are smooth.

    Raises:
        InvalidValue: If the attributes do not all have the same number of values, from 1 to 8; if a value is not
            finite, or its magnitude exceeds 10^9; if a velocity, an acceleration or a jerk is not positive; or if a
            lower position is not below the upper one.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in _names(self):
            object.__setattr__(self, name, _row(name, getattr(self, name)))
        count = len(self.lower)
        for name in _names(self):
            row: tuple[float, ...] = getattr(self, name)
            if len(row) != count:
                raise InvalidValue(
                    tr(
                        "limits: {name} has {count} values, lower has {wanted}; one value per axis is required",
                        name=name,
                        count=len(row),
                        wanted=count,
                    )
                )
            if name not in ("lower", "upper"):
                for axis, value in enumerate(row, start=1):
                    check_positive(f"J{axis} {name}", value, _owner())
        for axis, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True), start=1):
            if lower >= upper:
                raise InvalidValue(
                    tr(
                        "limits: J{axis}: lower ({lower:g}) is not below upper ({upper:g})",
                        axis=axis,
                        lower=lower,
                        upper=upper,
                    )
                )

    @classmethod
    def of_model(cls, model: ArmModel) -> Limits:
        """Return the limits of an arm.

        DENSO publishes neither jerks nor accelerations. This project assumes the accelerations of
        :class:`orinkit.arms.Axis`, and a jerk of acceleration / 0.05 s.

        Args:
            model: The arm, including extended joints.
        """
        axes = model.axes
        return cls(
            lower=tuple(axis.lower for axis in axes),
            upper=tuple(axis.upper for axis in axes),
            velocity=tuple(axis.velocity for axis in axes),
            acceleration=tuple(axis.acceleration for axis in axes),
            jerk=tuple(axis.acceleration / SECONDS_TO_ACCELERATION for axis in axes),
        )

    def scaled(self, velocity: float = 1.0, acceleration: float = 1.0, jerk: float = 1.0) -> Limits:
        """Return limits scaled by factors, the same for all axes; positions are not scaled.

        Args:
            velocity: Factor, above 0 and up to 1.
            acceleration: Factor, above 0 and up to 1.
            jerk: Factor, above 0 and up to 1.

        Raises:
            InvalidValue: If a factor is out of range.
        """
        parts = _parts(velocity=velocity, acceleration=acceleration, jerk=jerk)
        return Limits(
            self.lower,
            self.upper,
            tuple(value * parts["velocity"] for value in self.velocity),
            tuple(value * parts["acceleration"] for value in self.acceleration),
            tuple(value * parts["jerk"] for value in self.jerk),
        )


@public("orinkit")
@dataclass(frozen=True, slots=True)
class PathLimits:
    """Limits of a stream of poses, P or T: for the position of the tool tip, and for the orientation of the tool.

    Only the controller can check that a pose is reachable and that the joints are fast enough.

    Attributes:
        speed: Velocity of the tip in any direction, mm/s.
        acceleration: Acceleration of the tip, mm/s^2.
        jerk: Jerk of motions that the client plans, mm/s^3.
        rotation: Angular velocity about any axis, deg/s.
        rotation_acceleration: Angular acceleration, deg/s^2.
        rotation_jerk: Angular jerk, deg/s^3.

    Raises:
        InvalidValue: If a value is not finite, not positive, or exceeds 10^9.
    """

    speed: float
    acceleration: float
    jerk: float
    rotation: float
    rotation_acceleration: float
    rotation_jerk: float

    def __post_init__(self) -> None:
        for name in _names(self):
            value = _number(name, getattr(self, name))
            check_positive(name, value, _owner())
            object.__setattr__(self, name, value)

    @classmethod
    def of_model(cls, model: ArmModel) -> PathLimits:
        """Return the limits of an arm for a stream of poses.

        DENSO publishes none of these limits. The values of the model, and the jerks (acceleration / 0.05 s), are
        assumptions of this project.
        """
        return cls(
            speed=model.path_speed,
            acceleration=model.path_acceleration,
            jerk=model.path_acceleration / SECONDS_TO_ACCELERATION,
            rotation=model.path_rotation,
            rotation_acceleration=model.path_rotation_acceleration,
            rotation_jerk=model.path_rotation_acceleration / SECONDS_TO_ACCELERATION,
        )

    def scaled(self, velocity: float = 1.0, acceleration: float = 1.0, jerk: float = 1.0) -> PathLimits:
        """Return limits scaled by factors, the same for the tip and for the orientation; see :meth:`Limits.scaled`.

        Raises:
            InvalidValue: If a factor is out of range.
        """
        parts = _parts(velocity=velocity, acceleration=acceleration, jerk=jerk)
        return PathLimits(
            self.speed * parts["velocity"],
            self.acceleration * parts["acceleration"],
            self.jerk * parts["jerk"],
            self.rotation * parts["velocity"],
            self.rotation_acceleration * parts["acceleration"],
            self.rotation_jerk * parts["jerk"],
        )


def _names(limits: Limits | PathLimits) -> list[str]:
    return [each.name for each in fields(limits)]


def _row(name: str, values: Any) -> tuple[float, ...]:
    if not isinstance(values, Sequence) or isinstance(values, str | bytes) or not 1 <= len(values) <= MAX_JOINTS:
        raise InvalidValue(
            tr(
                "limits: {name} is {values}; expected 1 to {most} numbers, one per axis",
                name=name,
                values=brief(values),
                most=MAX_JOINTS,
            )
        )
    return tuple(_number(f"J{axis} {name}", value) for axis, value in enumerate(values, start=1))


def _number(name: str, value: Any) -> float:
    number = check_finite(name, value, _owner())
    if abs(number) > _LARGEST:
        raise InvalidValue(
            tr(
                "{owner}: {name} is {number:g}; the largest allowed value is {largest:g}",
                owner=_owner(),
                name=name,
                number=number,
                largest=_LARGEST,
            )
        )
    return number


def _parts(**parts: float) -> dict[str, float]:
    return {
        name: check_amount(tr("the factor for {name}", name=name), value, 1.0, _owner())
        for name, value in parts.items()
    }


def _owner() -> str:
    return tr("limits")
