"""Forward and inverse kinematics of an arm: figures, limits, singular points.

:class:`Kinematics` is the public interface. The module ``chain`` contains the forward kinematics, ``inverse`` the
inverse kinematics in closed form for arms with a spherical wrist, ``search`` (with ``roots``) the numeric inverse
kinematics for other arms, and ``figures`` the figures.
"""

from orinkit.arms.kinematics.solver import (
    AUTOMATIC,
    CONDITION_SINGULAR,
    LEAST_CHANGE,
    SHOULDER_SINGULAR,
    WITHIN_LIMITS,
    WRIST_SINGULAR,
    Kinematics,
)

__all__ = [
    "AUTOMATIC",
    "CONDITION_SINGULAR",
    "LEAST_CHANGE",
    "SHOULDER_SINGULAR",
    "WITHIN_LIMITS",
    "WRIST_SINGULAR",
    "Kinematics",
]
