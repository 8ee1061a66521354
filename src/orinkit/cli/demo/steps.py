"""The steps of the RC8 demo (``orinkit demo``), as data: one list of steps for each program in the RC8 document.

A step contains a call and a check of the reply, which must be as the document specifies.

To add another program of the document, add a list here and an entry in :data:`LISTS`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from orinkit import functions as f
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.i18n import N_, tr
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8

DEMO_ERROR: Final = hresult.MOTOR_NOT_ON
"""The error that the demo raises in the virtual controller."""


@dataclass(frozen=True, slots=True)
class HandleOf:
    """Placeholder, in the arguments of a step, for the result of an earlier step; the result is usually a handle."""

    name: str


Check = Callable[[list[Variant]], str]
"""Function that checks the arguments of a reply.

It returns ``""`` if they match the document, otherwise a text with the arguments that the document specifies.
"""


@dataclass(frozen=True, slots=True)
class DemoStep:
    """A call, and the expected reply.

    Attributes:
        text: Description in English; the message catalogue contains the translation.
        section: Section of the document.
        function: The function to call.
        arguments: Arguments of the call. A :class:`HandleOf` takes the place of a handle that an earlier step returned.
        check: Function that checks the arguments of the reply.
        save_as: Name under which the result, usually a handle, is stored for later steps; ``""`` if it is not stored.
        before: Function that is invoked with the virtual controller before the call; ``None`` for none.
        watch: True to show the joint position while the call is executing.
        log: True to keep the control log of the motion, from which the demo draws a picture.
    """

    text: str
    section: str
    function: Function[..., Any]
    arguments: tuple[Any, ...]
    check: Check
    save_as: str = ""
    before: Callable[[VirtualRC8], None] | None = None
    watch: bool = False
    log: bool = False

    @property
    def title(self) -> str:
        """The description in the current language."""
        return tr(self.text)


@dataclass(frozen=True, slots=True)
class StreamStep:
    """Set-points sent in slave mode, one in each cycle of the controller.

    Attributes:
        text: Description in English; the message catalogue contains the translation.
        section: Section of the document.
        controller, robot: Handles of the controller and of the robot.
        start: Placeholder for the initial joint position, which an earlier step has read.
        mode: Slave mode: 0, 1 or 2.
        points: Function that returns the set-points (joints) of the stream for an initial joint position.
    """

    text: str
    section: str
    controller: HandleOf
    robot: HandleOf
    start: HandleOf
    mode: int
    points: Callable[[Sequence[float]], list[tuple[float, ...]]]

    @property
    def title(self) -> str:
        """The description in the current language."""
        return tr(self.text)


# --- checks of replies ------------------------------------------------------------------------------------------------


def nothing(answer: list[Variant]) -> str:
    """Check that a reply contains no result."""
    return tr("no argument") if answer else ""


def a_handle(answer: list[Variant]) -> str:
    """Check that a reply consists of a handle: one VT_I4 above zero."""
    right = len(answer) == 1 and answer[0].type == VarType.I4 and answer[0].value > 0
    return "" if right else tr("a handle (VT_I4 above 0)")


def exactly(vt: VarType, value: Any = None) -> Check:
    """Return a function that checks that a reply consists of exactly this value of this type."""
    wanted = Variant(vt, value)

    def check(answer: list[Variant]) -> str:
        return "" if answer == [wanted] else repr(wanted)

    return check


def an_error(code: int) -> Check:
    """Return a function that checks for an array, which begins with this error code and a text (GetCurErrorInfo)."""

    def check(answer: list[Variant]) -> str:
        right = len(answer) == 1 and answer[0].type == VARIANT_ARRAY and len(answer[0].value) > 1
        if right:
            first, second = answer[0].plain[:2]
            right = first == hresult.signed(code) and isinstance(second, str) and second != ""
        return "" if right else tr("an array of 0x{code:08X} and its text", code=code)

    return check


def a_text(answer: list[Variant]) -> str:
    """Check for a text that is not empty."""
    right = len(answer) == 1 and answer[0].type == VarType.BSTR and answer[0].value
    return "" if right else tr("a text (VT_BSTR)")


# --- common steps -----------------------------------------------------------------------------------------------------

_CONTROLLER: Final = HandleOf("controller")

# fmt: off
_ENTER: Final[tuple[DemoStep, ...]] = (
    DemoStep(N_("Start the service of this connection"), "RC8 3.1.1",
         f.service_start, (), nothing),
    DemoStep(N_("Connect to the controller"), "RC8 3.1.2",
         f.controller_connect, ("", "CaoProv.DENSO.VRC", "localhost", ""), a_handle, save_as=_CONTROLLER.name),
)
_LEAVE: Final[tuple[DemoStep, ...]] = (
    DemoStep(N_("Disconnect from the controller"), "RC8 3.1.4",
         f.controller_disconnect, (_CONTROLLER,), nothing),
    DemoStep(N_("Stop the service"), "RC8 3.1.5",
         f.service_stop, (), nothing),
)
# fmt: on

# --- List 3-1 ---------------------------------------------------------------------------------------------------------


def _raise_error(rc8: VirtualRC8) -> None:
    rc8.raise_error(DEMO_ERROR)


_IO150: Final = HandleOf("IO150")
_MODE: Final = HandleOf("@MODE")
_AUTOMATIC: Final = 3

# fmt: off
LIST_3_1: Final[tuple[DemoStep, ...]] = (
    *_ENTER,
    DemoStep(N_("Connect to the variable IO150"), "RC8 3.1.2",
         f.controller_get_variable, (_CONTROLLER, "IO150", ""), a_handle, save_as=_IO150.name),
    DemoStep(N_("Read IO150: the point is off"), "RC8 3.1.3",
         f.variable_get_value, (_IO150,), exactly(VarType.BOOL, False)),
    DemoStep(N_("Write VT_I4 -1 to IO150, as the sample in the document does"), "RC8 3.1.7",
         f.variable_put_value, (_IO150, Variant(VarType.I4, -1)), nothing),
    DemoStep(N_("Read IO150 again: the point is on"), "RC8 3.1.3",
         f.variable_get_value, (_IO150,), exactly(VarType.BOOL, True)),
    DemoStep(N_("Connect to the system variable @MODE"), "RC8 3.1.6",
         f.controller_get_variable, (_CONTROLLER, "@MODE", ""), a_handle, save_as=_MODE.name),
    DemoStep(N_("Read @MODE: 3 (automatic)"), "RC8 2.2",
         f.variable_get_value, (_MODE,), exactly(VarType.I4, _AUTOMATIC)),
    DemoStep(N_("The demo has caused an error in the virtual RC8: read the number of errors"), "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetCurErrorCount", None), exactly(VarType.I4, 1), before=_raise_error),
    DemoStep(N_("Read the error"), "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetCurErrorInfo", 0), an_error(DEMO_ERROR)),
    DemoStep(N_("Get the text of the error code"), "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetErrorDescription", hresult.signed(DEMO_ERROR)), a_text),
    DemoStep(N_("Clear the error"), "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "ClearError", None), exactly(VarType.EMPTY)),
    DemoStep(N_("Check that there are no more errors"), "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetCurErrorCount", None), exactly(VarType.I4, 0)),
    DemoStep(N_("Release @MODE"), "RC8 3.1.4",
         f.variable_release, (_MODE,), nothing),
    DemoStep(N_("Release IO150"), "RC8 3.1.4",
         f.variable_release, (_IO150,), nothing),
    *_LEAVE,
)
# fmt: on

# --- List 3-2 ---------------------------------------------------------------------------------------------------------


def _motor_on(rc8: VirtualRC8) -> None:
    """Switch the motor on at the pendant, because List 3-2 does not switch it on."""
    rc8.pendant.motor()
    while rc8.pendant.status()["motor"] != "on":
        time.sleep(_POLL)


_POLL: Final = 0.02
_TASK: Final = HandleOf("Pro1")
_CONTINUOUS: Final = 2
_CYCLE_STOP: Final = 3

# fmt: off
LIST_3_2: Final[tuple[DemoStep, ...]] = (
    *_ENTER,
    DemoStep(N_("Connect to the task Pro1"), "RC8 3.2.1",
         f.controller_get_task, (_CONTROLLER, "Pro1", ""), a_handle, save_as=_TASK.name),
    DemoStep(N_("Start the task in continuous mode; the motor has been switched on at the pendant"), "RC8 3.2.2",
         f.task_start, (_TASK, _CONTINUOUS, ""), nothing, before=_motor_on),
    DemoStep(N_("Check that the task is running"), "RC8 3.2",
         f.task_execute, (_TASK, "GetStatus", None), exactly(VarType.I4, 3)),
    DemoStep(N_("Stop the task at the end of its cycle"), "RC8 3.2.2",
         f.task_stop, (_TASK, _CYCLE_STOP, ""), nothing),
    DemoStep(N_("Release the task"), "RC8 3.2.3",
         f.task_release, (_TASK,), nothing),
    *_LEAVE,
)
# fmt: on

# --- List 3-3 ---------------------------------------------------------------------------------------------------------

_ROBOT: Final = HandleOf("Arm")
_P1: Final = (330.0, 180.0, 320.0, 180.0, 0.0, 180.0, 5.0)
_SLOW: Final = 20.0


def _teach(rc8: VirtualRC8) -> None:
    """Teach P1 and set the speed at the pendant."""
    rc8.pendant.teach("P", 1, _P1)
    rc8.pendant.speed(_SLOW)


def near_p1(answer: list[Variant]) -> str:
    """Check for a position of seven numbers, each within 0.001 mm or 0.001 deg of P1."""
    right = len(answer) == 1 and isinstance(answer[0].value, list) and len(answer[0].value) == len(_P1)
    right = right and all(abs(a - b) < 1e-3 for a, b in zip(answer[0].value, _P1, strict=True))
    return "" if right else f"P{_P1}"


# fmt: off
LIST_3_3: Final[tuple[DemoStep, ...]] = (
    *_ENTER,
    DemoStep(N_("Connect to the robot"), "RC8 3.3.1",
         f.controller_get_robot, (_CONTROLLER, "Arm", ""), a_handle, save_as=_ROBOT.name),
    DemoStep(N_("Take the arm with an empty text as parameter, as the sample in the document does"), "RC8 3.3.2",
         f.robot_execute, (_ROBOT, "Takearm", ""), exactly(VarType.EMPTY)),
    DemoStep(N_("Switch the motor on with the text 1 as parameter, as the sample in the document does"), "RC8 3.3.3",
         f.robot_execute, (_ROBOT, "Motor", "1"), exactly(VarType.EMPTY)),
    DemoStep(N_("Move to P1; meanwhile the joints are read over a second connection"), "RC8 3.3.4",
         f.robot_move, (_ROBOT, 1, "P1", ""), nothing, before=_teach, watch=True, log=True),
    DemoStep(N_("Check that the robot has arrived"), "RC8 3.3.6",
         f.robot_execute, (_ROBOT, "DestPos", None), near_p1),
    DemoStep(N_("Switch the motor off"), "RC8 3.3.3",
         f.robot_execute, (_ROBOT, "Motor", "0"), exactly(VarType.EMPTY)),
    DemoStep(N_("Give the arm back"), "RC8 3.3.2",
         f.robot_execute, (_ROBOT, "Givearm", ""), exactly(VarType.EMPTY)),
    DemoStep(N_("Release the robot"), "RC8 3.3.5",
         f.robot_release, (_ROBOT,), nothing),
    *_LEAVE,
)
# fmt: on

# --- List 4-1 ---------------------------------------------------------------------------------------------------------

_JOINTS: Final = HandleOf("joints")
_FIRST: Final = (45.0, 30.0, 120.0, 0.0, -60.0, 0.0)
_PERIOD: Final = 100  # set-points
_AMPLITUDE: Final = 10.0  # deg
_TIMES: Final = 3


def sine(start: Sequence[float]) -> list[tuple[float, ...]]:
    """Return the set-points of List 4-1: joints 1 and 2 go up and down three times.

    The last set-point is repeated, so that the arm stops.
    """
    points = []
    for number in [*range(_PERIOD + 1)] * _TIMES:
        sway = _AMPLITUDE - _AMPLITUDE * math.cos(2 * math.pi * number / _PERIOD)
        points.append((start[0] + sway, start[1] + sway, *start[2:6]))
    return [*points, points[-1]]


def near_first(answer: list[Variant]) -> str:
    """Check for the joints of the pose from which the stream starts: eight numbers, each within 0.001 deg.

    The last two numbers are unused and must be 0.
    """
    right = len(answer) == 1 and isinstance(answer[0].value, list) and len(answer[0].value) == len(_FIRST) + 2
    right = right and all(abs(a - b) < 1e-3 for a, b in zip(answer[0].value, (*_FIRST, 0.0, 0.0), strict=True))
    return "" if right else f"J{_FIRST}"


# fmt: off
LIST_4_1: Final[tuple[DemoStep | StreamStep, ...]] = (
    DemoStep(N_("Start the service of this connection, with a watchdog"), "RC8 3.1.1",
         f.service_start, ("WDT=400",), nothing),
    DemoStep(N_("Connect to the controller"), "RC8 3.1.2",
         f.controller_connect, ("b-CAP", "CaoProv.DENSO.VRC", "localhost", ""), a_handle, save_as=_CONTROLLER.name),
    DemoStep(N_("Clear errors"), "RC8 4.7.1",
         f.controller_execute, (_CONTROLLER, "ClearError", None), exactly(VarType.EMPTY)),
    DemoStep(N_("Connect to the robot"), "RC8 3.3.1",
         f.controller_get_robot, (_CONTROLLER, "Robot", ""), a_handle, save_as=_ROBOT.name),
    DemoStep(N_("Take the arm without resetting speeds, tool and work"),
         "RC8 3.3.2",
         f.robot_execute, (_ROBOT, "Takearm", [0, 1]), exactly(VarType.EMPTY)),
    DemoStep(N_("Set the external speed to 20 %"), "RC8 4.9",
         f.robot_execute, (_ROBOT, "ExtSpeed", [20.0]), exactly(VarType.EMPTY)),
    DemoStep(N_("Switch the motor on"), "RC8 3.3.3",
         f.robot_execute, (_ROBOT, "Motor", 1), exactly(VarType.EMPTY)),
    DemoStep(N_("Move to the first pose; meanwhile the joints are read over a second connection"), "RC8 4.6.1",
         f.robot_move, (_ROBOT, 1, "@E J(45, 30, 120, 0, -60, 0)", ""), nothing, watch=True),
    DemoStep(N_("Read the current joints"), "RC8 4.9",
         f.robot_execute, (_ROBOT, "CurJnt", None), near_first, save_as=_JOINTS.name),
    StreamStep(N_(
"Slave mode 0, J type: send three periods of a sine wave, one set-point every 8 ms, send the last pose once more, "
"then switch slave mode off"), "RC8 4.9",
           _CONTROLLER, _ROBOT, _JOINTS, 0, sine),
    DemoStep(N_("Check that slave mode is off"), "RC8 4.2",
         f.robot_execute, (_ROBOT, "slvGetMode", None), exactly(VarType.I4, 0)),
    DemoStep(N_("Switch the motor off"), "RC8 3.3.3",
         f.robot_execute, (_ROBOT, "Motor", 0), exactly(VarType.EMPTY)),
    DemoStep(N_("Give the arm back"), "RC8 3.3.2",
         f.robot_execute, (_ROBOT, "Givearm", None), exactly(VarType.EMPTY)),
    DemoStep(N_("Release the robot"), "RC8 3.3.5",
         f.robot_release, (_ROBOT,), nothing),
    *_LEAVE,
)
# fmt: on


@dataclass(frozen=True, slots=True)
class DemoProgram:
    """A program of the document.

    Attributes:
        text: Title in English; the message catalogue contains the translation.
        steps: Steps of the program, in the order of execution.
    """

    text: str
    steps: tuple[DemoStep | StreamStep, ...]

    @property
    def title(self) -> str:
        """The title in the current language."""
        return tr(self.text)


LISTS: Final[dict[str, DemoProgram]] = {
    "List 3-1": DemoProgram(N_("variables, @MODE and errors"), LIST_3_1),
    "List 3-2": DemoProgram(N_("a task"), LIST_3_2),
    "List 3-3": DemoProgram(N_("the robot"), LIST_3_3),
    "List 4-1": DemoProgram(N_("slave mode"), LIST_4_1),
}
"""The programs of the RC8 document that the demo runs, by their names in the document."""
