"""Options of slave mode, and their checks before anything is sent; no I/O."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NoReturn, TypeAlias

from orinkit.arms import model_of_type
from orinkit.cao.dialect import VE026A, Dialect
from orinkit.core.errors import InvalidValue, StreamError
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_range
from orinkit.rc8.slave_fields import EXCLUSIVE, OUTPUTS, PARAMETERS, POSE_PARTS, POSES, RECEIVED, WORDS, FieldType
from orinkit.rc8.slave_formats import (
    POSE_SIZES,
    ReceiveFormat,
    SendBits,
    SetPoint,
    SlaveMode,
    UserIoUnit,
    UserWindow,
    encode_set_point,
    mode_number,
    mode_of,
)
from orinkit.rc8.user_io_unit import read_unit
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.process.shared_memory import QUEUE_ROOM, Outputs

FeedbackField: TypeAlias = Literal["time", "joints", "position", "trans", "mini", "hand", "current"]
"""Feedback that a controller can return for each set-point; by default, the controller's time and the joints.

The names are those of the table of fields (:mod:`orinkit.rc8.slave_fields`), repeated here for type checkers.
"""
OnRange: TypeAlias = Literal["clamp", "refuse"]
"""Handling of a target of a stream that is beyond the range of an axis."""

PERIOD: Final = 0.008
"""Default cycle time of a controller in s (RC8 4.1)."""
MIN_SPEED: Final = 0.1
"""Smallest percentage of the limits."""
MAX_SPEED: Final = 100.0
"""Largest percentage of the limits."""

_POSES: Final[dict[frozenset[str], int]] = {
    frozenset(POSES[kind].name for kind in kinds): number for number, kinds in POSE_PARTS.items()
}
_JOINTS: Final = _POSES[frozenset({POSES["J"].name})]  # also used if ``recv`` names no pose
_POSE_NAMES: Final = frozenset(row.name for row in POSES.values())
_FLAGS: Final = {row.name: row.receive for row in WORDS if row.receive}
_STAMP: Final = sum(row.receive for row in RECEIVED if row.form is FieldType.STAMP)
_WINDOW: Final = sum(row.receive for row in PARAMETERS if row.form is FieldType.WINDOW)
_MAX_PERIOD: Final = 1.0  # s
_MAX_IDLE: Final = 1e6  # s
_MAX_QUEUED: Final = QUEUE_ROOM // 2  # several threads may push at the same time
_MIN_AHEAD: Final = 0.1  # s
_LEAST_QUEUED: Final = 8  # set-points; the streaming process waits for four of them before it begins
_UNEVEN: Final = 0.6  # velocity scale that leaves room for two set-points in one cycle
_PATH_SPEED: Final = 0.5  # default scale of the tool's velocity limits
_PATH_ACCELERATION: Final = 0.25  # default scale of the tool's acceleration limits


@dataclass(slots=True)
class StreamOptions:
    """The checked options of ``Robot.slave_mode``."""

    mode: SlaveMode
    receive: ReceiveFormat
    send: SendBits
    outputs: Outputs
    window: UserWindow | None
    user_io_unit: UserIoUnit
    limits: Limits | PathLimits | None
    speed: float
    period: float
    queue: int
    idle: float | None
    on_range: OnRange
    record: Path | None


def read_options(
    dialect: Dialect, mode: int, pose: str, recv: Iterable[str], *, limits: Limits | PathLimits | None, speed: float,
    period: float, queue: int, idle: float | None, on_range: OnRange, record: str | os.PathLike[str] | None,
    user_window: tuple[int, int] | None = None, user_io_unit: str = UserIoUnit.BITS.value, **outputs: int | tuple[int, bytes] | None,
) -> StreamOptions:  # fmt: skip
    """Check the options of slave mode and return them.

    Raises:
        InvalidValue: If an option is invalid.
    """
    if type(mode) is not int:
        _refuse("mode", mode, "0, 1, 2")
    wanted = mode_of(mode_number(mode, pose))
    assert wanted is not None
    states = read_outputs(**outputs)
    window = _window(user_window)
    number = _receive(recv) | (_WINDOW if window else 0)
    if not dialect.slave_formats:
        number = _plain(mode, pose, number, states)
    if on_range not in ("clamp", "refuse"):
        _refuse("on_range", on_range, "clamp, refuse")
    if limits is not None and not isinstance(limits, Limits if wanted.kind == "J" else PathLimits):
        raise InvalidValue(
            tr("limits must be an object of class Limits for joints (pose J), or PathLimits for positions (pose P, T)")
        )
    options = StreamOptions(
        wanted, ReceiveFormat(int(number), microseconds=True), _send(states), states, window, read_unit(user_io_unit), limits,
        check_range("speed", speed, MIN_SPEED, MAX_SPEED), check_range("period", period, 0.0005, _MAX_PERIOD),
        int(check_range("queue", queue, 1, _MAX_QUEUED)), None if idle is None else check_range("idle", idle, 0.01, _MAX_IDLE),
        on_range, _path(record),
    )  # fmt: skip
    check_sendable(options, states)
    return options


def _plain(mode: int, pose: str, number: int, outputs: Outputs) -> int:
    """Return the receive format of a controller without configurable formats (VE026A 2.2).

    Raises:
        InvalidValue: If the controller does not support an option.
    """
    if mode == 2 or pose != "J" or number & ~_STAMP != _JOINTS or outputs != Outputs():
        raise InvalidValue(
            tr(
                'this controller supports only slave modes 0 and 1 with pose "J", returns only joints, and accepts '
                "no outputs"
            )
        )
    return _JOINTS


def check_sendable(options: StreamOptions, outputs: Outputs) -> None:
    """Check that the values of outputs can be sent; omitted outputs keep their values.

    Raises:
        InvalidValue: If a value cannot be sent.
    """
    pose_type, given = options.mode.kind, options.outputs.updated(outputs).present_items()
    dummy = SetPoint((0.0,) * POSE_SIZES[pose_type], (), **given, window=options.window)
    encode_set_point(pose_type, dummy, options.send, options.receive)


def read_outputs(**given: int | tuple[int, bytes] | None) -> Outputs:
    """Check the values of outputs and return them.

    Args:
        **given: Outputs by their names in the table of fields.

    Raises:
        InvalidValue: If the value of mini or hand outputs is not an integer, or that of user outputs is not a pair of
            an integer and bytes.
    """
    found: dict[str, Any] = {}
    for row in OUTPUTS:
        value = given.get(row.name)
        if value is not None:
            found[row.name] = _OUTPUT_READERS[row.form](row.name, value)
    return Outputs(**found)


def check_outputs_enabled(options: StreamOptions, outputs: Outputs) -> None:
    """Check that slave mode was entered with these outputs.

    Raises:
        InvalidValue: If slave mode was entered without one of them.
    """
    opened = options.outputs.present_items()
    for name in outputs.present_items():
        if name not in opened:
            raise InvalidValue(tr("{name} outputs are not enabled. Try: slave_mode({name}=...)", name=name))


def queue_room(ahead: float | None, period: float) -> int:
    """Return the number of set-points of a trajectory that are queued at most.

    Args:
        ahead: Time in s for which set-points are queued; ``None`` for no limit.
        period: Cycle time in s.

    Raises:
        InvalidValue: If the time is too short.
    """
    if ahead is None:
        return QUEUE_ROOM
    return min(QUEUE_ROOM, max(_LEAST_QUEUED, round(check_range("ahead", ahead, _MIN_AHEAD, _MAX_IDLE) / period)))


def _bits(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        _refuse(name, value, tr("an integer"))
    return value


def _bytes(name: str, value: object) -> tuple[int, bytes]:
    first, data = _pair(name, value, '(128, b"\\x01")')
    if not isinstance(first, int) or not isinstance(data, bytes | bytearray):
        _refuse(name, value, '(128, b"\\x01")')
    return first, bytes(data)


_OUTPUT_READERS: Final[dict[FieldType, Callable[[str, object], object]]] = {
    FieldType.BITS: _bits,
    FieldType.BYTES: _bytes,
}


def _send(outputs: Outputs) -> SendBits:
    given = outputs.present_items()
    for first, second in EXCLUSIVE:
        if first in given and second in given:
            raise InvalidValue(
                tr("{first} and {second} outputs cannot be sent together (RC8 table 4-1)", first=first, second=second)
            )
    return SendBits(sum(int(row.send) for row in OUTPUTS if row.name in given))


def _receive(recv: Iterable[str]) -> int:
    if not isinstance(recv, Iterable):
        _refuse("recv", recv, ", ".join(sorted(_FLAGS.keys() | _POSE_NAMES)))
    given: list[object] = [recv] if isinstance(recv, str) else list(recv)
    names = frozenset(name for name in given if isinstance(name, str))
    for name in given:
        if not isinstance(name, str) or name not in _FLAGS.keys() | _POSE_NAMES:
            _refuse("recv", name, ", ".join(sorted(_FLAGS.keys() | _POSE_NAMES)))
    poses = _POSES.get(names & _POSE_NAMES or frozenset({POSES["J"].name}))
    if poses is None:
        raise InvalidValue(
            tr("recv: position and trans cannot be combined; either can be combined with joints (RC8 table 4-1)")
        )
    number = poses | _STAMP
    for name in names & _FLAGS.keys():
        number |= _FLAGS[name]
    return number


def _window(given: tuple[int, int] | None) -> UserWindow | None:
    if given is None:
        return None
    first, size = _pair("user_window", given, "(128, 2)")
    if not isinstance(first, int) or not isinstance(size, int):
        _refuse("user_window", given, "(128, 2)")
    return UserWindow(first, size)


def _pair(name: str, given: object, known: str) -> tuple[object, object]:
    if not isinstance(given, Sequence) or len(given) != 2:
        _refuse(name, given, known)
    return given[0], given[1]


def _path(record: object) -> Path | None:
    if record is None:
        return None
    if not isinstance(record, str | os.PathLike) or Path(record).suffix.lower() not in (".csv", ".mcap"):
        _refuse("record", record, "run.csv, run.mcap")
    path = Path(record)
    if not path.absolute().parent.is_dir():
        raise InvalidValue(tr("record: directory {directory} does not exist", directory=path.parent))
    return path


def _refuse(name: str, value: object, known: str) -> NoReturn:
    raise InvalidValue(tr("{name}: invalid value {value}. Try: {known}", name=name, value=brief(value), known=known))


def limits_for(options: StreamOptions, type_name: object) -> Limits | PathLimits:
    """Return the limits of a stream: those in the options or, by default, those of the arm with this type name.

    The limits are then reduced to the percentage ``speed`` in the options.

    Raises:
        StreamError: If the type of arm is unknown.
    """
    limits = options.limits
    if limits is None:
        model = model_of_type(str(type_name))
        if model is None:
            raise StreamError(
                tr(
                    "the limits of a {type} are unknown. Try: slave_mode(limits=...)",
                    type=brief(type_name),
                )
            )
        if options.mode.kind == "J" and options.mode.buffering == 1 and type_name == VE026A.name:
            # each cycle uses the newest set-point only: two set-points in one cycle make one larger step (VE026A 2.2)
            limits = Limits.of_model(model).scaled(_UNEVEN, 1.0, 1.0)
        elif options.mode.kind == "J":
            limits = Limits.of_model(model)
        else:  # in many poses, the tool's full acceleration exceeds the limits of the joints
            limits = PathLimits.of_model(model).scaled(_PATH_SPEED, _PATH_ACCELERATION, _PATH_ACCELERATION)
    part = options.speed / MAX_SPEED
    return limits if part == 1.0 else limits.scaled(part, part, part)
