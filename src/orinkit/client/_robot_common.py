"""What both clients' robots share: option strings, poses in answers, how far a motion is. Plain data, no calls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypedDict, TypeVar

from orinkit import hresult
from orinkit._pose_checks import brief, finite, plain_decimal
from orinkit.client._common import not_understood
from orinkit.errors import CallError, InvalidValue, OrinError, TransportError, error_for
from orinkit.language import pick
from orinkit.poses import J, P, PassMark, PoseLike, T, Target, V, parse_target, to_text

PTP: Final = 1
LINE: Final = 2
ARC: Final = 3
CURVE: Final = 4

HOLDING_COMMANDS: Final = frozenset(("takearm", "givearm", "motor"))
"""Commands, in small letters, that surely move nothing."""

POLL: Final = 0.03
"""Seconds between two looks at a motion."""
SETTLE: Final = 0.05
"""Seconds after which a look that found the arm somewhere else is repeated: encoders are late, a motion may just begin."""
TOLERANCE: Final = 0.1
"""How far, in degrees or mm, a joint may be from where the motion ends; ten times what controllers stand still with."""
UNFINISHED: Final = 0.999
"""The most that is said of a motion that is not over."""

_MISSING: Final = (hresult.E_NOTIMPL, hresult.E_INVALID_CMD_NAME, hresult.E_INVALIDARG, hresult.FUNCTION_NOT_DEFINED)
_MOST_PERCENT: Final = 100.0
_MOST_SECONDS: Final = 3600.0

Pose = TypeVar("Pose", P, T, J)


class MoveOptions(TypedDict, total=False):
    """The options of a motion, as keywords; what is left out is as the controller has it.

    Attributes:
        speed: percent, above 0, at most 100.
        accel: acceleration in percent.
        decel: deceleration in percent.
        time: how long it is to take, in seconds, at most 3600.
        wait: True, the default, waits for the end; False returns at once (NEXT).
    """

    speed: float
    accel: float
    decel: float
    time: float
    wait: bool


def option_text(options: MoveOptions, mark: str = "") -> tuple[str, bool]:
    """Return the option string of a motion (RC8 3.3.4), and whether to wait for its end.

    Args:
        options: as given.
        mark: a pass mark that belongs to the option string, as that of Rotate does.

    Raises:
        TypeError: an option that there is not.
        InvalidValue: an amount is no number, or out of range.
    """
    if unknown := options.keys() - MoveOptions.__annotations__.keys():
        known = ", ".join(MoveOptions.__annotations__)
        raise TypeError(
            pick(
                f"a motion has no option {min(unknown)!r}; there are {known}",
                f"動作オプション {min(unknown)!r} はありません。使えるのは {known} です",
            )
        )
    parts = [mark] if mark else []
    parts += [
        f"{name.upper()}={plain_decimal(_amount(name, options.get(name), _MOST_PERCENT))}"
        for name in ("speed", "accel", "decel")
        if name in options
    ]
    if "time" in options:
        parts.append(f"TIME={max(1, round(_amount('time', options['time'], _MOST_SECONDS) * 1000))}")
    wait = options.get("wait", True)
    return ",".join(parts if wait else [*parts, "NEXT"]), bool(wait)


def waits(option: str) -> bool:
    """Return whether a motion with this option string is answered at its end."""
    return all(part.strip().upper() not in ("NEXT", "NEXT=1") for part in str(option).split(","))


def _amount(name: str, value: object, most: float) -> float:
    number = finite("move", name, value)
    if not 0 < number <= most:
        raise InvalidValue(
            pick(
                f"{name}: {number:g} is not above 0 and at most {most:.0f}",
                f"{name}: {number:g} は範囲外です (0 より大きく {most:.0f} 以下)",
            )
        )
    return number


# --- poses that are sent ----------------------------------------------------------------------------------------------


def arc_text(via: PoseLike, end: PoseLike, mark: str | PassMark) -> str:
    """Return the two poses of an arc (RC8 3.3.4): ``P1, @E P2``."""
    return f"{to_text(via)}, {to_text(end, mark)}"


def curve_text(path: int | Sequence[PoseLike], mark: str | PassMark) -> str:
    """Return the path of a free curve: the number of a stored one, or its poses.

    Raises:
        InvalidValue: no pose, or a number below 0.
    """
    if isinstance(path, int):
        if path < 0:
            raise InvalidValue(pick(f"{path} is no number of a path", f"{path} は経路番号ではありません"))
        return f"{_mark(mark)} {path}" if mark else str(path)
    poses: object = path
    if not isinstance(poses, list | tuple) or isinstance(poses, P | T | J | V) or not poses:
        raise InvalidValue(
            pick(
                f"{brief(path)}: a free curve takes the number of a stored path, or a list of poses",
                f"{brief(path)}: 自由曲線には経路番号かポーズのリストを指定してください",
            )
        )
    *middle, last = path
    return ", ".join([*map(to_text, middle), to_text(last, mark)])


def distance_text(distance: float, mark: str | PassMark) -> str:
    """Return a distance with its pass mark, as Approach and Depart take it: ``@P 10``."""
    return f"{_mark(mark or '@0')} {plain_decimal(finite('move', 'distance', distance))}"


def axes_text(axes: Mapping[int, float], mark: str | PassMark) -> str:
    """Return joints and values as DriveEx takes them: ``@0 (1,10),(2,20)``.

    Raises:
        InvalidValue: no joint, or one that is no number from 1 to 8, or a value that is no finite number.
    """
    given: object = axes
    if not isinstance(given, Mapping) or not given or not all(map(_is_axis, given)):
        raise InvalidValue(
            pick(
                f"{brief(axes)}: joints are given as {{number: value}}, numbers from 1 to 8",
                f"{brief(axes)}: 軸は {{軸番号: 値}} の形で指定してください (軸番号は 1～8)",
            )
        )
    pairs = ",".join(f"({axis},{plain_decimal(finite('drive', f'J{axis}', value))})" for axis, value in axes.items())
    return f"{_mark(mark or '@0')} {pairs}"


def _is_axis(axis: object) -> bool:
    return isinstance(axis, int) and 1 <= axis <= 8


def _mark(mark: str | PassMark) -> PassMark:
    return PassMark.parse(mark) if isinstance(mark, str) else mark


def kind_of(pose: PoseLike, wanted: str) -> str:
    """Return the kind of a pose that is to be converted, P, T or J, from what its text says.

    Args:
        pose: the pose.
        wanted: the kind that it is to become.

    Raises:
        InvalidValue: it is of that kind already, or a vector.
        NotationError: the text is no pose.
    """
    kind = target_of(pose).kind or "P"
    if kind in (wanted, "V"):
        raise InvalidValue(
            pick(f"{brief(pose)} cannot be converted to {wanted}", f"{brief(pose)} は {wanted} 型に変換できません")
        )
    return kind


def target_of(pose: PoseLike) -> Target:
    """Return a pose as a target.

    Raises:
        InvalidValue: no pose.
        NotationError: the text is none.
    """
    return pose if isinstance(pose, Target) else parse_target(to_text(pose))


def literal_end(pose: PoseLike) -> J | P | None:
    """Return where a motion to a pose surely ends, if the pose itself says it."""
    try:
        end = target_of(pose)
    except ValueError:  # the controller will say what is wrong with it
        return None
    if end.extra is not None:
        return None
    known = end.pose
    return known if isinstance(known, J | P) else None


# --- answers ----------------------------------------------------------------------------------------------------------


def read_pose(kind: type[Pose], command: str, answer: Any) -> Pose:
    """Return the pose that a command was answered with.

    Raises:
        ProtocolError: it is none.
    """
    try:
        return kind.of(answer)
    except InvalidValue:
        raise not_understood(command, answer) from None


def read_number(command: str, answer: Any) -> float:
    """Return the number that a command was answered with.

    Raises:
        ProtocolError: it is none.
    """
    if isinstance(answer, int | float) and math.isfinite(answer):
        return answer
    raise not_understood(command, answer)


def is_missing(error: CallError) -> bool:
    """Return whether a controller says that it does not have a command."""
    return error.code in _MISSING


# --- progress ---------------------------------------------------------------------------------------------------------


class Way:
    """From where to where a motion goes, as far as that is known.

    Attributes:
        target: where it ends, as its pose itself says.
        start, end: joints, as the controller says.
        behind: end of the motion before; while the controller says this, that one is not over.
    """

    __slots__ = ("behind", "end", "start", "target")

    def __init__(self, target: J | P | None = None) -> None:
        self.target = target
        self.start: J | None = None
        self.end: J | None = None
        self.behind: J | None = None

    @property
    def waits(self) -> bool:
        """Whether it is still to be seen where it ends, because another motion was not over."""
        return self.end is None and self.behind is not None

    def begin(self, now: J, end: J, before: Way | None) -> None:
        """Note where the arm is and where it is going, when the controller has just taken the motion.

        Args:
            now: joints of the arm.
            end: where it is going.
            before: the motion that was not over yet, if there was one.
        """
        if before is None:
            self.start, self.end = now, end
        elif before.end is not None:
            self.start = self.behind = before.end
            self.reach(end)

    def reach(self, end: J) -> None:
        """Note where the arm is going, while it moves: somewhere else than before once this motion has begun."""
        if self.waits and not near(end, self.behind or ()):
            self.end = end

    def fraction(self, now: J) -> float:
        """Return how far an arm at these joints is, from 0 to a little below 1; 0 where that is not known.

        It is the part of the way that the joints have left behind. They go together, so it is that of the path too
        where the path is a line in joint space, and roughly elsewhere.
        """
        if self.start is None or self.end is None:
            return 0.0
        whole = math.dist(self.start, self.end)
        return min(UNFINISHED, max(0.0, 1.0 - math.dist(now, self.end) / whole)) if whole else 0.0


def near(one: Iterable[float], other: Iterable[float], tolerance: float = TOLERANCE) -> bool:
    """Return whether two poses are the same, as far as both have numbers."""
    return all(abs(a - b) <= tolerance for a, b in zip(one, other, strict=False))


class Stop(NamedTuple):
    """How a motion was stopped before its end.

    Attributes:
        at: where the arm stands.
        reason: the first of the errors that the controller reports, ``""`` for none.
    """

    at: J
    reason: str

    def error(self, subject: str, function: str, arguments: tuple[object, ...], way: Way) -> CallError:
        """Return it as an exception.

        Args:
            subject: name of the robot.
            function: the call that began the motion.
            arguments: of the call.
            way: of the motion.
        """
        detail = pick(f"the arm stands at {_rounded(self.at)}", f"現在位置 {_rounded(self.at)}")
        end = way.end if way.target is None else way.target
        if end is not None:
            detail += pick(f", the motion ends at {_rounded(end)}", f"、目標 {_rounded(end)}")
        if self.reason:
            detail += pick(f"; the controller reports {self.reason}", f"。コントローラのエラー: {self.reason}")
        error = error_for(hresult.STOPPED_DURING_PC_MOTION, detail, function, arguments)
        error.subject = subject
        return error


def _rounded(pose: J | P) -> J | P:
    return pose.of(round(value, 3) for value in pose)


def not_in_time(seconds: float, en: str, ja: str) -> TimeoutError:
    """Return the error of waiting that has taken too long."""
    return TimeoutError(pick(f"{en} after {seconds:g} s", f"{seconds:g} 秒経過しても{ja}"))


# --- letting go -------------------------------------------------------------------------------------------------------


def note_failed(problem: OrinError) -> str:
    """Return the note that an exception gets where a step of the clean-up has failed too."""
    if isinstance(problem, TransportError):
        return pick(
            "orinkit: the connection is gone; the controller then stops the arm and takes it back by itself, "
            "the motor may still be on",
            "orinkit: 接続が失われました。アームの停止と占有解除はコントローラが行います。モータは ON のままの可能性があります",
        )
    return pick(f"orinkit: while cleaning up: {problem}", f"orinkit: 後始末の際のエラー: {problem}")


def note_closed() -> str:
    """Return the note that an exception gets where only closing the connection could stop the arm."""
    return pick(
        "orinkit: the controller is still busy with the call before, so the connection was closed to stop the arm; "
        "the motor may still be on",
        "orinkit: コントローラが前の呼び出しを実行中のため、接続を閉じてアームを停止させました。モータは ON のままの可能性があります",
    )
