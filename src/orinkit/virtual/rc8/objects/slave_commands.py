"""The slave mode commands of Robot_Execute (RC8 table 4-1), and slvGetLateness, which only virtual controllers have."""

from __future__ import annotations

from functools import partial
from typing import Final

from orinkit.cao.provider import Deferred, ResultWithCode
from orinkit.core.errors import CallError, error_for
from orinkit.core.hresult import CodeFamily
from orinkit.rc8.slave_formats import (
    OFF,
    SetPoint,
    SlaveMode,
    mode_of,
    read_receive_parameter,
    read_set_point,
    send_format,
)
from orinkit.rc8.slave_lateness import build_lateness
from orinkit.values.variant import Value, Variant
from orinkit.virtual.engine.set_point_buffer import PlannedSetPoint
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.slave_feedback import reply_of, require_supported
from orinkit.virtual.rc8.robot.slave_mode import io
from orinkit.virtual.rc8.robot.slave_mode.set_point import joints_of
from orinkit.virtual.rc8.robot.target import Joints

_MALFORMED: Final = (CodeFamily.GENERAL, CodeFamily.CAO)


def change_mode(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    """Switch slave mode on, in the mode whose number is the parameter, or off if the parameter is 0.

    Switching off completes when the buffer is empty and the arm is at standstill.

    Raises:
        CallError: E_INVALIDARG if the mode is unknown; other codes if a condition is not met.
    """
    mode = mode_of(parameters.whole_numbers(parameter, None)[0])
    arm = caller.robot.arm
    require("slvChangeMode off" if mode is None else "slvChangeMode on", arm, caller)
    if mode is not None:
        arm.slave.begin(caller, mode, caller.when_input_processed)
    return arm.slave.leave() if mode is None and arm.slave.on else None


def get_mode(caller: ClientContext, _: Variant) -> int:
    """Return the number of the mode, 0 for off."""
    mode = caller.robot.arm.slave.mode
    return OFF if mode is None else mode.number


def get_lateness(caller: ClientContext, parameter: Variant) -> Variant:
    """Return the number and the delays of the late set-points in the current stream, or in the last stream.

    The parameter is the number of late set-points at the beginning of the stream that are not counted, by default 0.
    For the layout of the result see :mod:`orinkit.rc8.slave_lateness`.
    """
    (skip_first,) = parameters.whole_numbers(parameter, 0)
    return build_lateness(caller.robot.arm.slave.lateness(skip_first))


def set_send_format(caller: ClientContext, parameter: Variant) -> None:
    """Set the fields that this client sends with slvMove in addition to the pose.

    Raises:
        CallError: E_INVALIDARG if the format or an I/O point does not exist; other codes if a condition is not met.
    """
    require("slvSendFormat", caller.robot.arm, caller)
    wanted = send_format(parameters.whole_numbers(parameter, None)[0])
    io.require_sent(caller.state.variables, wanted)
    caller.formats.send = wanted


def set_receive_format(caller: ClientContext, parameter: Variant) -> None:
    """Set the fields that slvMove returns to this client.

    Raises:
        CallError: E_INVALIDARG if the format or an I/O point does not exist; E_NOTIMPL if a field is not simulated;
            other codes if a condition is not met.
    """
    require("slvRecvFormat", caller.robot.arm, caller)
    wanted = read_receive_parameter(parameter)
    require_supported(wanted)
    io.require_received(caller.state.variables, wanted)
    caller.formats.receive = wanted


def move(caller: ClientContext, parameter: Variant) -> Value | ResultWithCode | Deferred[Value]:
    """Accept a set-point and return the feedback in this client's format.

    Raises:
        CallError: The code of the error that has ended slave mode, once; then SLAVE_MODE_OFF.
        CallError: E_INVALIDARG or DISP_E_TYPEMISMATCH if the parameter is malformed; E_BUF_FULL if the buffer is full
            in mode 0. These errors change nothing. Other errors of
            :func:`~orinkit.virtual.rc8.robot.slave_mode.set_point.joints_of` are errors of the controller and end slave
            mode.
    """
    state, formats = caller.state, caller.formats
    arm, slave = caller.robot.arm, caller.robot.arm.slave
    ended = slave.report_end(caller)
    if ended:
        raise error_for(ended)
    require("slvMove", arm, caller)
    assert slave.mode is not None
    point = read_set_point(slave.mode.kind, parameter, formats.send, formats.receive, state.switches.user_io_unit)
    outputs = io.outputs_of(state.variables, point)
    if point.window is not None:
        io.require_window(state.variables, point.window)
    slave.require_room()
    command = PlannedSetPoint(_joints(caller, slave.mode, point), partial(io.set_outputs, state.variables, outputs))
    return slave.put(command, partial(reply_of, arm, state.variables, formats.receive, point.window))


def _joints(caller: ClientContext, mode: SlaveMode, point: SetPoint) -> Joints:
    arm, slave = caller.robot.arm, caller.robot.arm.slave
    try:
        return joints_of(arm.space, mode.kind, point, slave.newest)
    except CallError as error:
        if error.info.family not in _MALFORMED:  # the arm cannot reach the set-point (RC8 4.7)
            slave.fail(error.code, error.detail)
            slave.report_end(caller)  # this call reports it
        raise
