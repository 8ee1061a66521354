"""``orinkit serve ve026a``: the virtual VE026A on a serial line, a pseudo-terminal or the network."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.serving import ServerOptions, check, run
from orinkit.cli.commands.serve_rc8 import JOINTS, ROBOT, MotorOn, read_joints
from orinkit.core.i18n import tr
from orinkit.virtual.clock import Clock
from orinkit.virtual.ve026a import VirtualVE026A

_LISTENING: Final = ServerOptions()


def serve_ve026a(
    *,
    joints: Annotated[
        str | None,
        JOINTS,
        Parameter(
            help=tr(
"Initial joint position in deg (J7: the hand), as \"J(0, 30, 120, 0, 30, 0, 0)\" or "
"0,30,120,0,30,0,0. Default: the home pose."),
        ),
    ] = None,
    motor_on: MotorOn = False,
    strict_time: Annotated[
        bool,
        Parameter(
            group=ROBOT,
            help=tr(
"Do not wait for late set-points: a late set-point immediately causes an error, as on a real VE026A. By default, "
"the virtual VE026A waits up to 250 ms."),
        ),
    ] = False,
    time_scale: Annotated[
        float,
        Parameter(
            group=ROBOT,
            help=tr("Simulated seconds per real second; 20 makes the arm 20 times as fast."),
        ),
    ] = 1.0,
    listening: ServerOptions = _LISTENING,
) -> int:  # fmt: skip
    """Serve a virtual VE026A; print "ready URL" for each listener. Stop on SIGINT, SIGTERM or SIGHUP."""
    check(listening)
    try:
        arm = VirtualVE026A(
            clock=Clock(time_scale),
            joints=None if joints is None else read_joints(joints),
            motor=motor_on,
            strict_time=strict_time,
        )
    except ValueError as error:
        raise CommandError(str(error), 2) from None
    try:
        return run([arm], listening)
    finally:
        arm.close()
