"""Robot commands that calculate or report without moving: poses, conversions, range checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from orinkit.arms import frames
from orinkit.cao import coerce
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.core.validation import rounded_to_single
from orinkit.values.poses import Kind, Target
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8.robot import parameters, state_report
from orinkit.virtual.rc8.robot.accuracy import check_axis
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.state_report import ArmPosition, Numbers
from orinkit.virtual.rc8.robot.target import NO_FRAME, figure_of
from orinkit.virtual.rc8.robot.tools import Matrix
from orinkit.virtual.rc8.variables import conversion

_R8_ARRAY: Final = int(VarType.R8) | ARRAY
_UNREACHABLE: Final = -1
_SINGULAR: Final = -2
_IN_USE: Final = -1
_FULL: Final = 100.0
_DEGREES_PER_SECOND: Final = 6.0  # for a turn per minute
_COUNTS: Final[Mapping[str, Sequence[int]]] = {"P": (6, 7), "J": (4, 6, 7, 8), "T": (9, 10)}

Answer = Callable[[RC8Arm, Variant], Variant]

POSES: Final[Mapping[str, Callable[[ArmPosition], Numbers]]] = {
    "Pos": ArmPosition.position,
    "Jnt": ArmPosition.angles,
    "Trn": ArmPosition.trans,
}
"""The suffixes of commands such as CurPos, HighCurJnt and DestTrn, each with the function that reads the pose."""


def pose_command(source: Callable[[RC8Arm], ArmPosition], read: Callable[[ArmPosition], Numbers]) -> Answer:
    """Return a command that returns a pose: ``source`` supplies the joint position, ``read`` converts it to a pose."""
    return lambda arm, _: Variant(_R8_ARRAY, read(source(arm)))


def stamped_pose_command(source: Callable[[RC8Arm], ArmPosition], read: Callable[[ArmPosition], Numbers]) -> Answer:
    """Return a command that returns the time since power-on, ms, and a pose."""
    return lambda arm, _: Variant(_R8_ARRAY, state_report.stamped(arm.seconds(), read(source(arm))))


def figure_command(source: Callable[[RC8Arm], ArmPosition]) -> Answer:
    """Return a command that returns a figure."""
    return lambda arm, _: Variant(VarType.I4, source(arm).figure())


def conversion_command(given: Kind, wanted: Kind) -> Answer:
    """Return a command that converts a pose of one type to another: J2P, P2J ..."""

    def run(arm: RC8Arm, parameter: Variant) -> Variant:
        target = _named(parameter, given)
        if target.kind != given:
            raise error_for(
                hresult.DISP_E_TYPEMISMATCH,
                tr("{target} is not of type {given}", target=target, given=given),
            )
        if given == "J" and not isinstance(target.value, int) and len(target.value) < arm.model.robot_axes:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("{target} has {count} values, expected at least {least}", target=target, count=len(target.value),
                   least=arm.model.robot_axes),
            )  # fmt: skip
        if "J" not in (given, wanted):
            return Variant(_R8_ARRAY, _retyped(arm, target, wanted))
        source = ArmPosition(arm, arm.space.joints(target, arm.servo.command))
        return Variant(_R8_ARRAY, {"J": source.angles, "P": source.position, "T": source.trans}[wanted]())

    return run


def _named(parameter: Variant, kind: Kind) -> Target:
    """Return the pose of a parameter; untyped values have the pose type ``kind`` if their count matches this type."""
    target = parameters.pose(parameter)
    given = parameters.elements(coerce.unwrap_single(parameter))
    numbers = all(isinstance(each.value, int | float) for each in given)
    no_letter = isinstance(parameter.value, str) and parameter.value.lstrip().startswith("(")
    if isinstance(target.value, int) or (target.kind and not (numbers or no_letter)):
        return target
    values = tuple(float(each.value) for each in given) if numbers else target.value
    if len(values) not in _COUNTS[kind]:
        return target
    if kind != "J":
        figure_of(kind, values)
    return Target(kind, values)


def _retyped(arm: RC8Arm, target: Target, wanted: Kind) -> Numbers:
    """Convert a P to a T, or a T to a P, in the same frame, even if the pose is out of reach; keep the given figure."""
    kind, values = arm.space.resolve(target, arm.servo.command)
    frame = arm.space.frame_in_base(kind, values, NO_FRAME)
    result = frames.position_of_matrix(frame) if wanted == "P" else frames.trans_of_matrix(frame)
    return [*map(float, result), float(figure_of(kind, values))]


def dev(arm: RC8Arm, parameter: Variant) -> Variant:
    """Dev: return a pose after displacing and rotating it by another pose, relative to the axes of the work frame."""
    first, second, fig = _two(arm, parameter)
    moved = np.eye(4)
    moved[:3, :3] = second[:3, :3] @ first[:3, :3]
    moved[:3, 3] = first[:3, 3] + second[:3, 3]
    return _position(moved, fig)


def dev_hand(arm: RC8Arm, parameter: Variant) -> Variant:
    """DevH: return a pose after displacing and rotating it by another pose.

    The other pose is relative to the axes of the tool at the first pose.
    """
    first, second, fig = _two(arm, parameter)
    return _position(np.asarray(first @ second), fig)


def _two(arm: RC8Arm, parameter: Variant) -> tuple[Matrix, Matrix, float]:
    """Return two poses as frames in the work frame, and the figure of the first."""
    base, offset = parameters.poses(parameter, 2)
    kind, values = arm.space.resolve(base, arm.servo.command)
    if kind == "J":
        joints = arm.space.joints(base, arm.servo.command)
        first, fig = arm.space.in_work(arm.space.tcp(joints)), float(arm.space.figure(joints))
    else:
        first, fig = arm.space.frame_in_base(kind, values, NO_FRAME), float(figure_of(kind, values))
    kind, values = arm.space.resolve(parameters.position(offset), arm.servo.command)
    if kind == "J":
        raise error_for(hresult.DISP_E_TYPEMISMATCH, tr("the offset must be of type P or T"))
    return first, arm.space.frame_in_base(kind, values, NO_FRAME), fig


def t_multiply(arm: RC8Arm, parameter: Variant) -> Variant:
    """TMul: return the product of two T, with the figure of the first."""
    (first, fig), (second, _) = (_trans(arm, target) for target in parameters.poses(parameter, 2))
    return _trans_of(np.asarray(first @ second), fig)


def t_invert(arm: RC8Arm, parameter: Variant) -> Variant:
    """TInv: return the inverse of a T, with its figure."""
    frame, fig = _trans(arm, _named(parameter, "T"))
    return _trans_of(frames.inverse_of(frame), fig)


def t_normalize(arm: RC8Arm, parameter: Variant) -> Variant:
    """TNorm: return a T whose orient and approach vector have the length 1 and are perpendicular."""
    return _trans_of(*_trans(arm, _named(parameter, "T")))


def _trans(arm: RC8Arm, target: Target) -> tuple[Matrix, float]:
    """Return the frame of a T and its figure."""
    kind, values = arm.space.resolve(target, arm.servo.command)
    if kind != "T":
        raise error_for(hresult.DISP_E_TYPEMISMATCH, tr("{target} is not of type {given}", target=target, given="T"))
    return arm.space.frame_in_base(kind, values, 0), float(figure_of(kind, values))


def _trans_of(frame: Matrix, fig: float) -> Variant:
    return Variant(_R8_ARRAY, [*map(float, frames.trans_of_matrix(frame)), fig])


def mps(arm: RC8Arm, parameter: Variant) -> Variant:
    """MPS: return the value of SPEED, %, for a velocity of the tool, mm/s."""
    (velocity,) = parameters.numbers(parameter, None)
    return _percent(velocity, arm.model.path_speed)


def rpm(arm: RC8Arm, parameter: Variant) -> Variant:
    """RPM: return the value of SPEED, %, for a velocity of an axis in turns per minute."""
    axis, turns = parameters.numbers(parameter, None, None)
    return _percent(turns * _DEGREES_PER_SECOND, _velocity(arm, axis))


def dps(arm: RC8Arm, parameter: Variant) -> Variant:
    """DPS: return the value of SPEED, %, for a velocity in deg/s: of an axis by PTP, or of the tool on a path."""
    one_text = isinstance(parameter.value, str) and "," in parameter.value
    if one_text or len(parameters.elements(parameter)) > 1:
        axis, velocity = parameters.numbers(parameter, None, None)
        return _percent(velocity, _velocity(arm, axis))
    (velocity,) = parameters.numbers(parameter, None)
    return _percent(velocity, arm.model.path_rotation)


def _velocity(arm: RC8Arm, axis: float) -> float:
    return arm.model.axes[check_axis(arm.model, parameters.whole(axis)) - 1].velocity


def _percent(velocity: float, largest: float) -> Variant:
    """Return a velocity as a percentage of the largest one, a VT_R4.

    Raises:
        CallError: VALUE_OUT_OF_RANGE if it is not above 0 and at most 100 %.
    """
    share = velocity / largest * _FULL
    if not 0 < share <= _FULL:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{velocity:g} is not above 0 and at most {largest:g}", velocity=velocity, largest=largest),
        )
    return Variant(VarType.R4, rounded_to_single(share))


def _position(frame: Matrix, fig: float) -> Variant:
    return Variant(_R8_ARRAY, [*map(float, frames.position_of_matrix(frame)), fig])


def out_range(arm: RC8Arm, parameter: Variant) -> Variant:
    """OutRange: return 0 if the arm can reach a pose.

    Return -1 if the pose is out of reach, and -2 if it is singular. If axes exceed their limits, return a number
    with one bit for each of them; bit 0 is axis 1.
    """
    space, start = arm.space, arm.servo.command
    target, rest = parameters.pose_and_rest(parameter, 2)
    if arm.switches.loose_poses:
        target = parameters.position(target)
    tool, work = [conversion.whole(each) for each in rest] + [_IN_USE] * (2 - len(rest))
    try:
        joints = space.joints(target, start, space.tools.check(tool, _IN_USE), space.works.check(work, _IN_USE))
    except CallError as error:
        if error.code in (hresult.TARGET_OUT_OF_RANGE, hresult.FIGURE_INVALID):
            return Variant(VarType.I4, _UNREACHABLE)
        raise
    beyond = space.kinematics.limits_exceeded(joints)
    if beyond:
        return Variant(VarType.I4, beyond)
    return Variant(VarType.I4, _SINGULAR if space.kinematics.is_singular(joints) else 0)


_KINDS: Final[tuple[Kind, ...]] = ("P", "J", "T")
CALCULATIONS: Final[Mapping[str, Answer]] = {
    **{f"{a}2{b}": conversion_command(a, b) for a in _KINDS for b in _KINDS if a != b},
    "Dev": dev,
    "DevH": dev_hand,
    "OutRange": out_range,
    "TMul": t_multiply,
    "TInv": t_invert,
    "TNorm": t_normalize,
    "MPS": mps,
    "RPM": rpm,
    "DPS": dps,
}
"""Commands that programs can call as functions, by name."""


def calculate(arm: RC8Arm, name: str, given: Sequence[Variant]) -> Variant:
    """Return the result of a function that a program calls, such as J2P; ``given`` are its arguments.

    Raises:
        CallError: As for the command of that name.
    """
    return CALCULATIONS[name](arm, given[0] if len(given) == 1 else Variant(VARIANT_ARRAY, list(given)))
