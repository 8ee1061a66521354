"""Checks of motions against the soft limits."""

from __future__ import annotations

from orinkit.arms import ArmModel, AxisModel
from orinkit.arms.kinematics.figures import LIMIT_TOLERANCE
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.motion.joint_path import Joints, Path


def check_end(model: ArmModel, end: Joints, first_axis: int = 0) -> None:
    """Check the joints at the end of a motion, from index ``first_axis`` on.

    Raises:
        CallError: TARGET_OVER_SOFT_LIMIT_AXISn if axis n is outside its soft limits.
    """
    for number, (value, axis) in enumerate(zip(end, model.axes, strict=True)):
        if number >= first_axis and not axis.lower - LIMIT_TOLERANCE <= value <= axis.upper + LIMIT_TOLERANCE:
            raise error_for(hresult.TARGET_OVER_SOFT_LIMIT_AXIS1 + number, _range_text(value, axis))


def check_way(model: ArmModel, path: Path) -> None:
    """Check the joints along a path; an axis that starts outside its limits may move back.

    Raises:
        CallError: SOFT_LIMIT_OVER_AXISn if axis n leaves its soft limits.
    """
    joints = path.sampled(path.probes)[0]
    for number, axis in enumerate(model.axes):
        low = min(axis.lower, path.start[number]) - LIMIT_TOLERANCE
        high = max(axis.upper, path.start[number]) + LIMIT_TOLERANCE
        values = joints[:, number]
        if values.min() < low or values.max() > high:
            farthest = values.min() if values.min() < low else values.max()
            raise error_for(hresult.SOFT_LIMIT_OVER_AXIS1 + number, _range_text(float(farthest), axis))


def _range_text(value: float, axis: AxisModel) -> str:
    unit = "mm" if axis.linear else "deg"
    return tr(
        "{value:.6g} {unit} is outside the soft limits, {lower:g} to {upper:g} {unit}",
        value=value,
        lower=axis.lower,
        upper=axis.upper,
        unit=unit,
    )
