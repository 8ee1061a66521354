"""What slave mode is asked for, checked before anything is sent. Plain data, no calls."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NoReturn, TypeAlias

from orinkit._pose_checks import brief, finite
from orinkit.arms import model_of_type
from orinkit.cao.slave_formats import (
    POSE_SIZES,
    Receive,
    ReceiveFormat,
    Send,
    SetPoint,
    SlaveMode,
    UserWindow,
    encode_set_point,
    mode_number,
    mode_of,
)
from orinkit.errors import InvalidValue, StreamError
from orinkit.language import pick
from orinkit.slave.limits import Limits, PathLimits
from orinkit.slave.shared import QUEUE_ROOM, Outputs

Wanted: TypeAlias = Literal["time", "joints", "position", "trans", "mini", "hand", "current"]
"""What can come back with each set-point; the controller's time and the joints are by default."""
OnRange: TypeAlias = Literal["clamp", "refuse"]
"""What is done with a live target beyond the arm's range."""

PERIOD: Final = 0.008
"""Seconds of a controller's cycle (RC8 4.1)."""

_POSES: Final[dict[frozenset[str], int]] = {
    frozenset(): 2,
    frozenset({"position"}): 1,
    frozenset({"joints"}): 2,
    frozenset({"trans"}): 3,
    frozenset({"position", "joints"}): 4,
    frozenset({"trans", "joints"}): 5,
}
_FLAGS: Final[dict[str, Receive]] = {
    "time": Receive.TIME,
    "hand": Receive.HAND,
    "current": Receive.CURRENT,
    "mini": Receive.MINI,
}
_POSE_NAMES: Final = frozenset({"position", "joints", "trans"})
_LONGEST_PERIOD: Final = 1.0  # s
_LONGEST_IDLE: Final = 1e6  # s
_FULL: Final = 100.0


@dataclass(slots=True)
class Options:
    """What slave mode is asked for; as of ``Robot.slave_mode``."""

    mode: SlaveMode
    receive: ReceiveFormat
    send: Send
    outputs: Outputs
    window: UserWindow | None
    limits: Limits | PathLimits | None
    speed: float
    period: float
    queue: int
    idle: float | None
    on_range: OnRange
    record: Path | None


def read_options(
    mode: int, pose: str, recv: Iterable[str], *, mini: int | None, hand: int | None, user: tuple[int, bytes] | None,
    user_window: tuple[int, int] | None, limits: Limits | PathLimits | None, speed: float, period: float, queue: int,
    idle: float | None, on_range: OnRange, record: str | os.PathLike[str] | None,
) -> Options:  # fmt: skip
    """Return the options of slave mode.

    Raises:
        InvalidValue: one of them is none.
    """
    wanted = mode_of(mode_number(mode, pose))
    assert wanted is not None
    outputs = read_outputs(mini, hand, user)
    window = _window(user_window)
    number = _receive(recv) | (Receive.USER if window else 0)
    if on_range not in ("clamp", "refuse"):
        _refuse("on_range", on_range, "clamp, refuse")
    if limits is not None and not isinstance(limits, Limits if wanted.kind == "J" else PathLimits):
        raise InvalidValue(
            pick(
                "limits: joints (pose J) have Limits, positions (pose P, T) have PathLimits",
                "limits: 関節 (pose J) には Limits、位置 (pose P, T) には PathLimits を指定してください",
            )
        )
    options = Options(
        wanted, ReceiveFormat(number, microseconds=True), _send(outputs), outputs, window, limits,
        _amount("speed", speed, _FULL), _amount("period", period, _LONGEST_PERIOD),
        int(_amount("queue", queue, QUEUE_ROOM)), None if idle is None else _amount("idle", idle, _LONGEST_IDLE),
        on_range, _path(record),
    )  # fmt: skip
    nowhere = SetPoint((0.0,) * POSE_SIZES[wanted.kind], (), mini, hand, outputs.user, window)
    encode_set_point(wanted.kind, nowhere, options.send, options.receive)  # what it refuses could not be sent
    return options


def read_outputs(mini: int | None, hand: int | None, user: tuple[int, bytes] | None) -> Outputs:
    """Return outputs.

    Raises:
        InvalidValue: what is given is no number, or no number and bytes.
    """
    given: tuple[tuple[str, object], ...] = (("mini", mini), ("hand", hand))
    for name, value in given:
        if value is not None and (isinstance(value, bool) or not isinstance(value, int)):
            _refuse(name, value, pick("a whole number", "整数"))
    if user is None:
        return Outputs(mini, hand)
    first, data = _pair("user", user, '(128, b"\\x01")')
    if not isinstance(first, int) or not isinstance(data, bytes | bytearray):
        _refuse("user", user, '(128, b"\\x01")')
    return Outputs(mini, hand, (first, bytes(data)))


def _send(outputs: Outputs) -> Send:
    if outputs.mini is not None and outputs.user is not None:
        raise InvalidValue(
            pick(
                "mini and user outputs cannot be sent together (RC8 table 4-1)",
                "mini と user の出力は同時に送信できません (表 4-1)",
            )
        )
    send = Send(0)
    for given, flag in ((outputs.mini, Send.MINI), (outputs.hand, Send.HAND), (outputs.user, Send.USER)):
        if given is not None:
            send |= flag
    return send


def _receive(recv: Iterable[str]) -> int:
    if not isinstance(recv, Iterable):
        _refuse("recv", recv, ", ".join(sorted(_FLAGS.keys() | _POSE_NAMES)))
    names = frozenset([recv] if isinstance(recv, str) else recv)
    for name in names:
        if name not in _FLAGS and name not in _POSE_NAMES:
            _refuse("recv", name, ", ".join(sorted(_FLAGS.keys() | _POSE_NAMES)))
    poses = _POSES.get(names & _POSE_NAMES)
    if poses is None:
        raise InvalidValue(
            pick(
                "recv: position and trans cannot come back together; joints can come with either (RC8 table 4-1)",
                "recv: position と trans は同時に受信できません。joints はどちらとも組み合わせられます (表 4-1)",
            )
        )
    number = poses | int(Receive.TIME)
    for name in names & _FLAGS.keys():
        number |= int(_FLAGS[name])
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


def _path(record: str | os.PathLike[str] | None) -> Path | None:
    if record is None:
        return None
    if not isinstance(record, str | os.PathLike):
        _refuse("record", record, "run.csv, run.mcap")
    return Path(record)


def _amount(name: str, value: float, most: float) -> float:
    number = finite("slave_mode", name, value)
    if not 0 < number <= most:
        raise InvalidValue(
            pick(
                f"{name}: {number:g} is not above 0 and at most {most:g}",
                f"{name}: {number:g} は範囲外です (0 より大きく {most:g} 以下)",
            )
        )
    return number


def _refuse(name: str, value: object, known: str) -> NoReturn:
    raise InvalidValue(
        pick(f"{name}: {brief(value)}; possible: {known}", f"{name}: {brief(value)} は使えません ({known})")
    )


def limits_for(options: Options, type_name: object) -> Limits | PathLimits:
    """Return the limits to stream within: as given, or those of the arm whose controller gives this type name.

    Raises:
        StreamError: no such arm is known here.
    """
    limits = options.limits
    if limits is None:
        model = model_of_type(str(type_name))
        if model is None:
            raise StreamError(
                pick(
                    f"the limits of a {brief(type_name)} are not known here; give them: slave_mode(limits=...)",
                    f"{brief(type_name)} の制限値は登録されていません。slave_mode(limits=...) で指定してください",
                )
            )
        limits = Limits.of_model(model) if options.mode.kind == "J" else PathLimits.of_model(model)
    part = options.speed / _FULL
    return limits if part == 1.0 else limits.scaled(part, part, part)
