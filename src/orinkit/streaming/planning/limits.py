"""Within which bounds an arm is streamed: what may change from one set-point to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

from orinkit.arms import ArmModel
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values.pose_numbers import MAX_JOINTS, brief, finite

SECONDS_TO_ACCELERATION: Final = 0.05
"""Seconds from rest to the largest acceleration. DENSO publishes no jerk; this is this project's assumption."""

_LARGEST: Final = 1e9  # what jerk-limited planning can compute with


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on a stream of joints, one value for each axis: deg, and mm where an axis is linear.

    Attributes:
        lower: lowest position.
        upper: highest position.
        velocity: largest velocity, per second.
        acceleration: largest acceleration, per second squared.
        jerk: largest change of acceleration, per second cubed. The controller does not ask for it; it is for motions
            that this side plans, so that they are smooth.

    Raises:
        InvalidValue: the numbers of values differ, there are none or more than eight, a value is not finite or beyond
            10^9, one that has to be above 0 is not, or a lower position is not below the upper one.
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
                        "limits: {name} has {count} values, lower has {wanted}; one for each axis is wanted",
                        name=name,
                        count=len(row),
                        wanted=count,
                    )
                )
            if name not in ("lower", "upper"):
                for axis, value in enumerate(row, start=1):
                    _positive(f"J{axis} {name}", value)
        for axis, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True), start=1):
            if lower >= upper:
                raise InvalidValue(
                    tr(
                        "limits: J{axis}: lower, {lower:g}, is not below upper, {upper:g}",
                        axis=axis,
                        lower=lower,
                        upper=upper,
                    )
                )

    @classmethod
    def of_model(cls, model: ArmModel) -> Limits:
        """Return the bounds of an arm.

        DENSO publishes no jerk, and hardly an acceleration: acceleration / 0.05 s, and what :class:`orinkit.arms.Axis`
        says of accelerations, are this project's assumptions.

        Args:
            model: the arm, with its extra axes if it has any.
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
        """Return a part of these bounds, the same for all axes; positions stay as they are.

        Args:
            velocity: above 0, up to 1.
            acceleration: above 0, up to 1.
            jerk: above 0, up to 1.

        Raises:
            InvalidValue: a part is not.
        """
        parts = _parts(velocity=velocity, acceleration=acceleration, jerk=jerk)
        return Limits(
            self.lower,
            self.upper,
            tuple(value * parts["velocity"] for value in self.velocity),
            tuple(value * parts["acceleration"] for value in self.acceleration),
            tuple(value * parts["jerk"] for value in self.jerk),
        )


@dataclass(frozen=True, slots=True)
class PathLimits:
    """Bounds on a stream of poses, P or T: of the point at the tip of the tool, and of the tool's orientation.

    Whether a pose can be reached, and whether the joints are fast enough, only the controller knows.

    Attributes:
        speed: mm/s, in any direction.
        acceleration: mm/s^2.
        jerk: mm/s^3, of motions that this side plans.
        rotation: deg/s, about any axis.
        rotation_acceleration: deg/s^2.
        rotation_jerk: deg/s^3.

    Raises:
        InvalidValue: a value is not finite, not above 0, or beyond 10^9.
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
            _positive(name, value)
            object.__setattr__(self, name, value)

    @classmethod
    def of_model(cls, model: ArmModel) -> PathLimits:
        """Return the bounds of an arm on a path.

        None of them is published; those of the model, and the jerks (acceleration / 0.05 s), are this project's
        assumptions.
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
        """Return a part of these bounds, the same for the tip and for the orientation.

        Args:
            velocity: of speed and rotation; above 0, up to 1.
            acceleration: above 0, up to 1.
            jerk: above 0, up to 1.

        Raises:
            InvalidValue: a part is not.
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
                "limits: {name} is {values}, 1 to {most} numbers are wanted, one for each axis",
                name=name,
                values=brief(values),
                most=MAX_JOINTS,
            )
        )
    return tuple(_number(f"J{axis} {name}", value) for axis, value in enumerate(values, start=1))


def _number(name: str, value: Any) -> float:
    number = finite(_owner(), name, value)
    if abs(number) > _LARGEST:
        raise InvalidValue(
            tr(
                "{owner}: {name} is {number:g}, at most {largest:g} is wanted",
                owner=_owner(),
                name=name,
                number=number,
                largest=_LARGEST,
            )
        )
    return number


def _positive(name: str, value: float) -> None:
    if value <= 0.0:
        raise InvalidValue(
            tr("{owner}: {name} is {value:g}, it has to be above 0", owner=_owner(), name=name, value=value)
        )


def _parts(**parts: float) -> dict[str, float]:
    checked = {name: finite(_owner(), name, value) for name, value in parts.items()}
    for name, value in checked.items():
        if not 0.0 < value <= 1.0:
            raise InvalidValue(
                tr(
                    "{owner}: the part of {name} is {value:g}, it has to be above 0 and up to 1",
                    owner=_owner(),
                    name=name,
                    value=value,
                )
            )
    return checked


def _owner() -> str:
    return tr("limits")
