"""Forward and inverse kinematics of an arm: figures, limits, singular points.

:class:`Kinematics` is the public interface. ``six_axis`` and ``scara`` solve the two kinds of arms; ``arm_solver`` is their
interface. For six-axis arms, ``chain`` contains the forward kinematics, ``inverse`` the inverse kinematics in closed form
for arms with a spherical wrist, ``search`` (with ``roots``) the numeric inverse kinematics for other arms, and ``figures``
the figures.
"""

from orinkit.arms.kinematics.six_axis import CONDITION_SINGULAR, SHOULDER_SINGULAR, WRIST_SINGULAR
from orinkit.arms.kinematics.solver import AUTOMATIC, LEAST_CHANGE, WITHIN_LIMITS, Kinematics

__all__ = [
    "AUTOMATIC",
    "CONDITION_SINGULAR",
    "LEAST_CHANGE",
    "SHOULDER_SINGULAR",
    "WITHIN_LIMITS",
    "WRIST_SINGULAR",
    "Kinematics",
]
