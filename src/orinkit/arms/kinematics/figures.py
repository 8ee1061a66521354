"""Figures (FIG) of six-axis arms: they distinguish the postures that hold the flange in the same pose.

========= ======= =========== ===========================================================================
bit       0       1           condition for 1
========= ======= =========== ===========================================================================
1         RIGHTY  LEFTY       the wrist centre is on the +X side of the frame of joint 1
2         ABOVE   BELOW       joint 3 is at most (LEFTY) or at least (RIGHTY) its value at full stretch
4         FLIP    NONFLIP     joint 5 is positive (LEFTY) or negative (RIGHTY)
8         SINGLE  DOUBLE      joint 6 is outside -180 < angle <= 180
16        SINGLE  DOUBLE      joint 4 is outside -180 < angle <= 180
32        SINGLE  DOUBLE      joint 1 is outside -180 < angle <= 180
========= ======= =========== ===========================================================================

The wrist centre is the intersection of the axes of joints 4 and 5. At full stretch, shoulder, elbow and wrist centre
are on a line. The COBOTTA also sets bit 256, whose meaning is not published. This module accepts and ignores that bit.
The figures of a SCARA are in ``scara``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Final, TypeAlias

import numpy as np

from orinkit.arms import ArmModel, AxisModel
from orinkit.arms.kinematics.chain import ARM_AXES, RADIAN, Array, Chain

LEFTY: Final = 1
BELOW: Final = 2
NONFLIP: Final = 4
J6_DOUBLE: Final = 8
J4_DOUBLE: Final = 16
J1_DOUBLE: Final = 32
POSTURE: Final = LEFTY | BELOW | NONFLIP
HIGHEST: Final = 63
COBOTTA_BIT: Final = 256

DoubleBits: TypeAlias = tuple[tuple[int, int], ...]

DOUBLE_BITS: Final[DoubleBits] = ((0, J1_DOUBLE), (3, J4_DOUBLE), (5, J6_DOUBLE))
"""Indices of the joints that can be DOUBLE, and their bits."""

LIMIT_TOLERANCE: Final = 1e-6
"""Tolerance of the soft limits in deg or mm; angles that are computed from sine and cosine have rounding errors."""

_ANGLE_NOISE: Final = 1e-9  # deg; a value this close to 0 or 180 counts as that value
_LENGTH_NOISE: Final = 1e-9  # mm


def figure_of(chain: Chain, joints: Sequence[float]) -> int:
    """Return the figure, 0 to 63, of joints in deg."""
    elbow_angle = normalize_angle(joints[2] - stretched_elbow(chain))
    lefty = wrist_distance(chain, joints) >= -_LENGTH_NOISE
    above = elbow_angle > _ANGLE_NOISE if lefty else elbow_angle < -_ANGLE_NOISE
    fifth = normalize_angle(joints[4])
    nonflip = fifth > _ANGLE_NOISE if lefty else fifth < -_ANGLE_NOISE
    figure = LEFTY * lefty | BELOW * (not above) | NONFLIP * nonflip
    for index, bit in DOUBLE_BITS:
        if normalize_angle(joints[index]) != joints[index]:
            figure |= bit
    return figure


def is_wrist_straight(joints: Sequence[float]) -> bool:
    """Return True if joint 5 is 0, so that FLIP and NONFLIP are the same."""
    return abs(normalize_angle(joints[4])) <= _ANGLE_NOISE


def wrist_distance(chain: Chain, joints: Sequence[float]) -> float:
    """Return the x coordinate of the wrist centre in the frame of joint 1, mm, for joints in deg."""
    second = joints[1] * RADIAN
    both = second + joints[2] * RADIAN  # the sum of two angles in deg may overflow
    return (
        chain.shoulder[0]
        + chain.upper[0] * math.cos(second)
        + chain.upper[2] * math.sin(second)
        + chain.fore[0] * math.cos(both)
        + (chain.fore[2] + chain.wrist[2]) * math.sin(both)
    )


def stretched_elbow(chain: Chain) -> float:
    """Return the angle of joint 3, deg, at which shoulder, elbow and wrist centre are on a line."""
    fore = math.atan2(chain.fore[0], chain.fore[2] + chain.wrist[2])
    return (math.atan2(chain.upper[0], chain.upper[2]) - fore) / RADIAN


def normalize_angle(angle: float) -> float:
    """Return an angle, deg, normalized to -180 < angle <= 180; an angle in this range is unchanged."""
    turns = math.ceil((angle - 180.0 - _ANGLE_NOISE) / 360.0)
    return angle - 360.0 * turns if turns else angle


def normalize_around(angles: Array, centre: Array) -> Array:
    """Return angles, deg, normalized to within half a turn of ``centre``."""
    return angles - 360.0 * np.ceil((angles - centre - 180.0 - _ANGLE_NOISE) / 360.0)


def turn_centres(model: ArmModel) -> Array:
    """Return the angles (6,), deg, around which the joints of a solution are normalized.

    The angle is 0 for joints 1, 4 and 6, which become SINGLE, and the middle of the limits for the other joints.
    """
    doubled = {index for index, _ in DOUBLE_BITS}
    return np.array(
        [
            0.0 if index in doubled else (axis.lower + axis.upper) / 2.0
            for index, axis in enumerate(model.axes[:ARM_AXES])
        ]
    )


def with_turns(
    joints: Sequence[float],
    figure: int,
    axes: Sequence[AxisModel],
    near: Sequence[float] | None,
    double_bits: DoubleBits = DOUBLE_BITS,
) -> list[float] | None:
    """Return joints; each joint whose DOUBLE bit is set in a figure is turned by 360 or -360 deg.

    Args:
        joints: Joints, deg, of which those that can be DOUBLE are SINGLE.
        figure: The figure; only its DOUBLE bits are used.
        axes: The axes; a joint that is DOUBLE must be within its limits.
        near: If two angles are possible, the one nearer to this joint position is used; with ``None``, the one nearer
            to 0.
        double_bits: Indices of the joints that can be DOUBLE, and their bits.

    Returns:
        The joints; ``None`` if a joint that must be DOUBLE cannot be within its limits.
    """
    turned = list(joints)
    for index, bit in double_bits:
        if figure & bit:
            choices = _doubles(joints[index], axes[index])
            if not choices:
                return None
            goal = near[index] if near is not None else 0.0
            turned[index] = min(choices, key=lambda angle: abs(angle - goal))
    return turned


def all_turns(
    joints: Sequence[float], axes: Sequence[AxisModel], double_bits: DoubleBits = DOUBLE_BITS
) -> Iterable[list[float]]:
    """Return all combinations in which the joints of ``double_bits`` are unchanged (SINGLE) or turned by 360 deg (DOUBLE).

    A joint is turned by 360 or -360 deg only if it is then within its limits.
    """
    choices: list[tuple[float, ...]] = [(angle,) for angle in joints]
    for index, _ in double_bits:
        choices[index] = (joints[index], *_doubles(joints[index], axes[index]))
    return map(list, product(*choices))


def within(value: float, axis: AxisModel) -> bool:
    """Return True if a joint is within the soft limits of its axis."""
    return axis.lower - LIMIT_TOLERANCE <= value <= axis.upper + LIMIT_TOLERANCE


def _doubles(angle: float, axis: AxisModel) -> list[float]:
    return [turned for turned in (angle + 360.0, angle - 360.0) if within(turned, axis)]
