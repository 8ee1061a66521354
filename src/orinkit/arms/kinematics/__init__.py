"""Where an arm's flange is for its joints, and which joints put it somewhere: figures, limits, singular points.

:class:`Kinematics` is what others use; ``chain`` is forward kinematics, ``inverse`` the closed form for a wrist whose axes meet
in a point, ``search`` (with ``roots``) the numeric way for any other, ``figures`` the figures.
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
