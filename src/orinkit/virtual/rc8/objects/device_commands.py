"""Commands of Robot_Execute about I/O, files, logs, scenes and buttons of the controller."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from typing import Any, Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.values.poses import Target
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.engine.servo import ControlLog
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.hardware.arm_hardware import BUTTONS
from orinkit.virtual.rc8.variables.types import CLASSES

FIRST_HAND_POINT, LAST_HAND_POINT = 48, 71
"""Points of the hand: inputs from 48, outputs from 64 (mini allocation)."""
SERVO_LOG_FILE: Final = "ServoLog.csv"
"""File to which StopServoLog writes the servo log."""
CALIBRATION_TIME: Final = 1000
"""Duration of AutoCal, ms (an assumption of this project)."""

_BITS: Final = 32
_POSITION: Final = 7
_JOINTS: Final = 8
_ENCODING: Final = "utf-8"


@record
class DeviceCommand:
    """A command; the attributes are those of :class:`orinkit.virtual.rc8.robot.shared_command.SharedCommand`."""

    name: str
    run: Callable[[ClientContext, Variant], Any]
    reads: bool = True
    in_slave: bool = True


# --- I/O of the hand --------------------------------------------------------------------------------------------------


def _points(first: int, count: int) -> range:
    if not (1 <= count <= _BITS and first >= FIRST_HAND_POINT and first + count - 1 <= LAST_HAND_POINT):
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("{count} points from {first}; the points of the hand are {least} to {last}", count=count, first=first,
               least=FIRST_HAND_POINT, last=LAST_HAND_POINT),
        )  # fmt: skip
    return range(first, first + count)


def _set_hand_io(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    first, value, count = parameters.whole_numbers(parameter, None, None, None)
    for bit, point in enumerate(_points(first, count)):
        caller.state.variables.write(CLASSES["IO"], point, Variant(VarType.BOOL, bool(value >> bit & 1)))


def _hand_io(caller: ClientContext, parameter: Variant) -> Variant:
    first, count = parameters.whole_numbers(parameter, None, None)
    value = 0
    for bit, point in enumerate(_points(first, count)):
        value |= bool(caller.state.variables.read(CLASSES["IO"], point).value) << bit
    return Variant(VarType.I4, value)


# --- paths in files ---------------------------------------------------------------------------------------------------


def path_file(number: int) -> str:
    """Return the name of the file that contains a stored path."""
    return f"Path{number}.csv"


def path_text(points: Sequence[Sequence[float]]) -> bytes:
    """Return the poses of a path as the text of its file: X, Y, Z, RX, RY, RZ, Fig in each line."""
    text = io.StringIO()
    csv.writer(text).writerows(points)
    return text.getvalue().encode(_ENCODING)


def _path_of_text(name: str, data: bytes) -> list[Target]:
    points = []
    try:
        for row in csv.reader(io.StringIO(data.decode(_ENCODING))):
            if row:
                x, y, z, rx, ry, rz, fig = (float(value) for value in row[:_POSITION])
                points.append(Target("P", (x, y, z, rx, ry, rz, fig)))
    except (ValueError, csv.Error) as error:
        raise error_for(hresult.E_INVALIDARG, tr("{name} is not a path: {error}", name=name, error=error)) from None
    return points


def _load_path(caller: ClientContext, parameter: Variant) -> Deferred[None] | None:
    """LoadPathPoint: empty a path, then read it from its file."""
    caller.require_write()
    (number,) = parameters.whole_numbers(parameter, None)
    state, moves = caller.state, caller.robot.moves
    moves.clear_path(number)
    name = path_file(number)

    def job() -> None:
        points = _path_of_text(name, state.files.read(name))
        with state.cycles:
            moves.set_path(number, points)

    return state.disk.run(job)


# --- logs -------------------------------------------------------------------------------------------------------------


def _start_servo_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    hardware = caller.robot.arm.hardware
    hardware.servo_log.running = True
    hardware.wake()


def _clear_servo_log(caller: ClientContext, _: Variant) -> None:
    caller.require_write()
    caller.robot.arm.hardware.servo_log.empty()


def _stop_servo_log(caller: ClientContext, _: Variant) -> Deferred[None] | None:
    """StopServoLog: end the log and write it to a file."""
    caller.require_write()
    state, hardware = caller.state, caller.robot.arm.hardware
    hardware.servo_log.running = False
    log = hardware.servo_log.copy()
    return state.disk.run(lambda: state.files.write(SERVO_LOG_FILE, _log_text(log)))


def _log_text(log: ControlLog) -> bytes:
    columns = ("command", "encoder", "current", "load")
    head = [f"J{axis} {column}" for axis in range(1, _JOINTS + 1) for column in columns]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["cycle", *head])
    for index in range(len(log)):
        record = log.record(index)
        writer.writerow([record[-3], *record[: len(head)]])
    return text.getvalue().encode(_ENCODING)


def _set_log_time(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    log = caller.robot.arm.log
    log.configure(parameters.whole_numbers(parameter, None)[0], log.interval)


def _set_log_interval(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    log = caller.robot.arm.log
    log.configure(log.max_time, parameters.whole_numbers(parameter, None)[0])


# --- calibration, scenes, buttons -------------------------------------------------------------------------------------


def _calibrate(caller: ClientContext, _: Variant) -> Deferred[None]:
    """AutoCal: determine the reference positions of the encoders."""
    state, arm = caller.state, caller.robot.arm
    require("AutoCal", arm, caller)
    done = Deferred[None]()

    def calibrated() -> None:
        arm.hardware.calibrated = True
        done.set_result()

    state.timers.after(CALIBRATION_TIME, calibrated)
    return done


def _change_scene(caller: ClientContext, parameter: Variant) -> None:
    arm = caller.robot.arm
    require("ChangeScene", arm, caller)
    number, sub = parameters.whole_numbers(parameter, None, 1)
    scene = arm.hardware.scenes.scene(number, sub)
    if scene.tool >= 0:
        arm.space.tools.current = arm.space.tools.check(scene.tool)
    if scene.work >= 0:
        arm.space.works.current = arm.space.works.check(scene.work)
    if scene.speed >= 0:
        arm.speeds.set_external(scene.speed)
    arm.hardware.scenes.current = (number, sub)


def _scene_info(caller: ClientContext, parameter: Variant) -> Variant:
    number, sub = parameters.whole_numbers(parameter, None, 1)
    scene = caller.robot.arm.hardware.scenes.scene(number, sub)
    return Variant(
        VARIANT_ARRAY,
        [
            Variant(VarType.BSTR, scene.name),
            Variant(VarType.I4, scene.tool),
            Variant(VarType.I4, scene.work),
            Variant(VarType.R4, scene.speed),
        ],
    )


def _button(number: int) -> int:
    if not 0 <= number < BUTTONS:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("button {number} does not exist; buttons: 0 to {last}", number=number, last=BUTTONS - 1),
        )
    return number


def _button_state(caller: ClientContext, parameter: Variant) -> int:
    (number,) = parameters.whole_numbers(parameter, None)
    return int(caller.robot.arm.hardware.buttons[_button(number)])


def _clear_button(caller: ClientContext, parameter: Variant) -> None:
    caller.require_write()
    (number,) = parameters.whole_numbers(parameter, None)
    caller.robot.arm.hardware.buttons[_button(number)] = False


def _number(read: Callable[[ClientContext], int]) -> Callable[[ClientContext, Variant], Variant]:
    return lambda caller, _: Variant(VarType.I4, read(caller))


DEVICE_COMMANDS: Final = (
    DeviceCommand("SetHandIO", _set_hand_io, reads=False),
    DeviceCommand("GetHandIO", _hand_io),
    DeviceCommand("LoadPathPoint", _load_path, reads=False, in_slave=False),
    DeviceCommand("StartServoLog", _start_servo_log, reads=False),
    DeviceCommand("ClearServoLog", _clear_servo_log, reads=False),
    DeviceCommand("StopServoLog", _stop_servo_log, reads=False),
    DeviceCommand("GetCtrlLogMaxTime", _number(lambda caller: caller.robot.arm.log.max_time)),
    DeviceCommand("SetCtrlLogMaxTime", _set_log_time, reads=False),
    DeviceCommand("GetCtrlLogInterval", _number(lambda caller: caller.robot.arm.log.interval)),
    DeviceCommand("SetCtrlLogInterval", _set_log_interval, reads=False),
    DeviceCommand("AutoCal", _calibrate, reads=False, in_slave=False),
    DeviceCommand("CurScene", _number(lambda caller: caller.robot.arm.hardware.scenes.current[0])),
    DeviceCommand("CurSubScene", _number(lambda caller: caller.robot.arm.hardware.scenes.current[1])),
    DeviceCommand("SceneInfo", _scene_info),
    DeviceCommand("ChangeScene", _change_scene, reads=False, in_slave=False),
    DeviceCommand("GetMechaButtonState", _button_state),
    DeviceCommand("ClearMechaButtonState", _clear_button, reads=False),
)
