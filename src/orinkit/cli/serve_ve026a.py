"""``orinkit serve ve026a``: the virtual VE026A on a serial line, a pseudo-terminal or the network."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.cli._errors import Failure
from orinkit.cli._serving import Listening, check, run
from orinkit.cli.serve_rc8 import read_joints
from orinkit.language import pick
from orinkit.virtual.clock import Clock
from orinkit.virtual.ve026a import VirtualVE026A

_ROBOT: Final = Group(pick("Robot", "ロボット"), sort_key=7)
_LISTENING: Final = Listening()


def serve_ve026a(
    *,
    joints: Annotated[
        str | None,
        Parameter(
            group=_ROBOT,
            allow_leading_hyphen=True,
            help=pick('Where the arm stands, in degrees, J7 is the hand: "J(0, 30, 120, 0, 30, 0, 0)" or 0,30,120,0,30,0,0; its home pose by default.',
                      'アームの初期姿勢 (度、J7 はハンド): "J(0, 30, 120, 0, 30, 0, 0)" または 0,30,120,0,30,0,0。既定はホーム姿勢。'),
        ),
    ] = None,
    motor_on: Annotated[
        bool, Parameter(group=_ROBOT, help=pick("The motor is on from the beginning.", "モータ ON の状態で起動する。"))
    ] = False,
    strict_time: Annotated[
        bool,
        Parameter(
            group=_ROBOT,
            help=pick("A late set-point is an error at once, as on a real VE026A, instead of being waited for (250 ms).",
                      "遅れた位置指令を待たず (既定は 250 ms 待つ)、実機と同じく直ちにエラーにする。"),
        ),
    ] = False,
    time_scale: Annotated[
        float,
        Parameter(
            group=_ROBOT,
            help=pick("How many seconds of the arm pass in one real second; 20 makes it 20 times as fast.",
                      "実時間 1 秒あたりに進むアームの秒数。20 なら 20 倍速になる。"),
        ),
    ] = 1.0,
    listening: Listening = _LISTENING,
) -> int:  # fmt: skip
    """Serve a virtual VE026A; each listener is told on stdout as "ready URL". Stops on SIGINT, SIGTERM and SIGHUP."""
    check(listening)
    try:
        arm = VirtualVE026A(
            clock=Clock(time_scale),
            joints=None if joints is None else read_joints(joints),
            motor=motor_on,
            strict_time=strict_time,
        )
    except ValueError as error:
        raise Failure(str(error), 2) from None
    try:
        return run([arm], listening)
    finally:
        arm.close()
