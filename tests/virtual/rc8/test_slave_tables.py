"""The tables of section 4 of the RC8 document, row by row, against the virtual RC8 on a clock moved by hand.

Written from the document; "reference" is the known behaviour of real controllers. If both are silent, a test says so.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from orinkit.arms import load_model
from orinkit.cao.provider import Deferred, ResultWithCode
from orinkit.core.errors import CallError
from orinkit.values.variant import ARRAY, Variant, VarType, plain, variant
from orinkit.virtual.engine.control_loop import PERIOD
from orinkit.virtual.rc8.robot.slave_mode.limits import SERVO_LIMIT
from support.cell import Cell

S_OK, S_BUF_FULL, E_BUF_FULL = 0, 0x0F200501, 0x83201483
E_INVALIDARG = 0x80070057
COMMAND_DELAY, SLAVE_MODE_OFF, NOT_IN_SLAVE_MODE = 0x84201482, 0x83500121, 0x83501032
ARM_NOT_TAKEN, MOTOR_NOT_ON, ROBOT_MOVING, ERROR_PRESENT = 0x83501024, 0x81501003, 0x8150100D, 0x81501025
ACCELERATION_OVER, SPEED_OVER = 0x84204040, 0x84204050  # plus the number of the axis

I4, R8S, UI1S, VARIANTS = VarType.I4, VarType.R8 | ARRAY, VarType.UI1 | ARRAY, VarType.VARIANT | ARRAY
HOME = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)
REACH, HEIGHT = 515 * math.sqrt(0.5), 275 + 5 * math.sqrt(0.5)  # of a VS-050 at HOME: links 345, 250, -10, 255, 70
STEP = 0.1  # deg of J1 in one cycle, from rest: within all limits

MODES = {
    0x001: "P", 0x002: "J", 0x003: "T", 0x101: "P", 0x102: "J", 0x103: "T", 0x201: "P", 0x202: "J", 0x203: "T",
}  # fmt: skip
OFF = 0x000


def j(turn: float = 0.0) -> list[float]:
    """Return HOME with another J1."""
    return [turn, *HOME[1:], 0.0, 0.0]


def p(turn: float = 0.0) -> list[float]:
    rz = turn - 180 if turn > 0 else turn + 180
    angle = math.radians(turn)
    return [REACH * math.cos(angle), REACH * math.sin(angle), HEIGHT, 180.0, 0.0, rz, 5.0]


def t(turn: float = 0.0) -> list[float]:
    angle = math.radians(turn)
    c, s = math.cos(angle), math.sin(angle)
    return [REACH * c, REACH * s, HEIGHT, -s, c, 0.0, 0.0, 0.0, -1.0, 5.0]


POSES: dict[str, Callable[[float], list[float]]] = {"P": p, "J": j, "T": t}


class SlaveCell(Cell):
    """A cell whose client has the arm, and its use of slave mode."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            **{"strict": True, "strict_time": True, "user_io_unit": "bytes", **options}
        )  # as in the document
        self.take()

    def on(self, mode: int = 0x002) -> SlaveCell:
        self.execute("slvChangeMode", mode)
        return self

    def off(self) -> None:
        self.execute("slvChangeMode", OFF)

    @property
    def mode(self) -> int:
        value: int = self.execute("slvGetMode")
        return value

    def ask(self, parameter: Any) -> tuple[int, Any]:
        """Send a set-point that is replied to at once; return the code, and the result with its type."""
        try:
            result = self.robot.execute("slvMove", variant(parameter))
        except CallError as error:
            return error.code, None
        assert not isinstance(result, Deferred)
        return (result.code, variant(result.value)) if isinstance(result, ResultWithCode) else (S_OK, variant(result))

    def codes(self, *parameters: Any) -> list[int]:
        return [self.ask(parameter)[0] for parameter in parameters]

    def feed(self, points: Sequence[Sequence[float]]) -> None:
        """Send J set-points and wait until each is consumed, up to the first error."""
        for point in points:
            if self.error:
                return
            assert self.ask(list(point))[0] == S_OK
            self.clock.advance(PERIOD)

    def pass_cycles(self, count: int) -> None:
        for _ in range(count):
            self.clock.advance(PERIOD)

    @property
    def joints(self) -> tuple[float, ...]:
        """The command position."""
        return self.arm.queue.joints

    @property
    def error(self) -> int:
        """The controller's error, 0 if there is none."""
        return int(plain(self.controller.get_variable("@ERROR_CODE", "").get_value())) & 0xFFFF_FFFF

    def io(self, first: int, count: int = 8) -> int:
        """Return I/O points as bits; the lowest bit is the first point."""
        points = [self.controller.get_variable(f"IO{first + bit}", "").get_value().plain for bit in range(count)]
        return sum(1 << bit for bit, point in enumerate(points) if point)

    def set_io(self, first: int, states: int, count: int = 8) -> None:
        for bit in range(count):
            self.put(f"IO{first + bit}", bool(states >> bit & 1))

    def other(self) -> Any:
        """Return a robot object of another client."""
        return self.connect("192.168.0.8").get_robot("Arm", "")


@pytest.fixture
def cell() -> Iterator[SlaveCell]:
    made = SlaveCell()
    yield made
    made.close()


@pytest.fixture(scope="module")
def shared() -> Iterator[SlaveCell]:
    """One cell for many formats; slave mode is off before and after each test."""
    made = SlaveCell()
    yield made
    made.close()


def i4s(*numbers: int) -> Variant:
    return Variant(I4 | ARRAY, list(numbers))


def pose_array(values: Sequence[float]) -> Variant:
    return Variant(R8S, list(values))


# --- table 4-1: slvChangeMode, slvGetMode ----------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
def test_4_1_mode(cell: SlaveCell, mode: int) -> None:
    pose = POSES[MODES[mode]]
    answer = cell.robot.execute("slvChangeMode", variant(mode))
    assert variant(cell.run(answer)).type == VarType.EMPTY
    told = variant(cell.robot.execute("slvGetMode", variant(None)))
    assert (told.type, told.value) == (I4, mode)
    for turn in (0.0, STEP, 2 * STEP, 2 * STEP):
        assert cell.ask(pose(turn))[0] == S_OK
        cell.clock.advance(PERIOD)
        assert cell.joints == pytest.approx((turn, *HOME[1:]), abs=1e-9)
    cell.off()
    assert cell.mode == OFF
    assert cell.error == 0


def test_4_1_mode_000_is_off(cell: SlaveCell) -> None:
    assert cell.mode == OFF
    cell.off()
    assert cell.mode == OFF
    assert cell.codes(j()) == [SLAVE_MODE_OFF]


@pytest.mark.parametrize(
    "mode", [0x004, 0x005, 0x010, 0x100, 0x104, 0x200, 0x204, 0x300, 0x301, 0x1001, 0x10001, -1, -(2**31), 2**31 - 1]
)
def test_4_1_there_is_no_other_mode(cell: SlaveCell, mode: int) -> None:
    assert cell.code_of(lambda: cell.robot.execute("slvChangeMode", variant(mode))) == E_INVALIDARG
    assert cell.mode == OFF


@pytest.mark.parametrize("mode", MODES)
def test_4_1_the_robot_has_to_stand(cell: SlaveCell, mode: int) -> None:
    cell.move(1, "J(30, 45, 90, 0, 45, 0)", "NEXT")
    cell.pass_cycles(5)
    assert cell.code_of(lambda: cell.robot.execute("slvChangeMode", variant(mode))) == ROBOT_MOVING
    assert cell.mode == OFF


def test_4_1_the_client_has_to_have_the_arm(cell: SlaveCell) -> None:
    stranger = cell.other()
    assert cell.code_of(lambda: stranger.execute("slvChangeMode", variant(0x002))) == ARM_NOT_TAKEN
    cell.execute("GiveArm")
    assert cell.code_of(lambda: cell.robot.execute("slvChangeMode", variant(0x002))) == ARM_NOT_TAKEN
    assert cell.mode == OFF


def test_4_1_the_motor_has_to_be_on(cell: SlaveCell) -> None:
    """Reference: 0x81501003."""
    cell.execute("Motor", [0, 0])
    assert cell.code_of(lambda: cell.robot.execute("slvChangeMode", variant(0x002))) == MOTOR_NOT_ON


FORMS: dict[str, Callable[[int], Variant]] = {
    "I2": lambda number: Variant(VarType.I2, number),
    "R8": lambda number: Variant(VarType.R8, number),
    "BSTR": lambda number: Variant(VarType.BSTR, str(number)),
    "array": lambda number: Variant(I4 | ARRAY, [number]),
}


@pytest.mark.parametrize("form", FORMS)
def test_4_1_numbers_as_old_clients_send_them(cell: SlaveCell, form: str) -> None:
    """Ruling: numbers of any type, as a string, in an array of one; names in any case (reference 4.4)."""
    write = FORMS[form]
    cell.execute("SLVSENDFORMAT", write(0x0020))
    cell.execute("slvrecvformat", write(0x0011))
    cell.execute("SlvChangeMode", write(0x102))
    assert cell.mode == 0x102
    code, answer = cell.ask([Variant(VarType.R4 | ARRAY, list(HOME)), FORMS["I2"](0x81)])
    assert code == S_OK
    check_answer(answer, 0x0011)
    cell.pass_cycles(2)
    assert cell.io(64) == 0x81
    cell.execute("slvChangeMode", write(OFF))
    assert cell.mode == OFF


@pytest.mark.parametrize("pose", [j(STEP)[:6], j(STEP)[:7], j(STEP)])
def test_4_1_joints_that_are_not_there_may_be_left_out(cell: SlaveCell, pose: list[float]) -> None:
    """Reference 4.4: VT_R4 arrays of seven or eight."""
    cell.on()
    for _ in range(2):
        assert cell.codes(Variant(VarType.R4 | ARRAY, pose)) == [S_OK]
        cell.pass_cycles(1)
    assert cell.joints == pytest.approx((STEP, *HOME[1:]), abs=1e-6)


# --- table 4-1: slvSendFormat and slvRecvFormat ----------------------------------------------------------------------

SEND_FORMATS = (0x0000, 0x0020, 0x0100, 0x0120, 0x0200, 0x0220)


@pytest.mark.parametrize("number", SEND_FORMATS)
def test_4_1_send_format(cell: SlaveCell, number: int) -> None:
    assert variant(cell.robot.execute("slvSendFormat", variant(number))).type == VarType.EMPTY


@pytest.mark.parametrize(
    "number", [0x0001, 0x0010, 0x0021, 0x0030, 0x0040, 0x0080, 0x0300, 0x0320, 0x0400, 0x0420, 0x10020, -1]
)
def test_4_1_there_is_no_other_send_format(cell: SlaveCell, number: int) -> None:
    """MiniIO and general I/O exclude each other; the current format is kept."""
    cell.execute("slvSendFormat", 0x0020)
    assert cell.code_of(lambda: cell.robot.execute("slvSendFormat", variant(number))) == E_INVALIDARG
    cell.on()
    assert cell.codes([pose_array(j()), 0x81]) == [S_OK]
    cell.pass_cycles(2)
    assert cell.io(64) == 0x81


POSE_PARTS = {0x0001: [p], 0x0002: [j], 0x0003: [t], 0x0004: [p, j], 0x0005: [t, j]}
BESIDE = (0x0010, 0x0020, 0x0040, 0x0100, 0x0200)
WINDOW = (160, 3)  # requested general I/O: first point, bytes
WINDOW_STATES = bytes([0xA5, 0x00, 0x3C])
SUBSETS = [sum(chosen) for count in range(6) for chosen in itertools.combinations(BESIDE, count)]


def types_of(number: int) -> list[int]:
    """Return the types of the elements of a result, in the order of table 4-3."""
    beside_pose = {0x0100: I4, 0x0200: UI1S, 0x0020: I4, 0x0040: R8S}  # MiniIO, general I/O, HandIO, current
    found: list[int] = [I4] if number & 0x0010 else []
    return [*found, R8S, *(kind for bit, kind in beside_pose.items() if number & bit)]


def check_answer(answer: Variant, number: int) -> list[Any]:
    """Check a result's types, and its pose, which is that of HOME; return the elements."""
    types = types_of(number)
    if types == [R8S]:
        assert answer.type == R8S
        elements = [answer]
    else:
        assert answer.type == VARIANTS
        elements = answer.value
    assert [element.type for element in elements] == types
    values = [element.value for element in elements]
    wanted = [value for pose in POSE_PARTS[number & 0xF] for value in pose()]
    assert values[types.index(R8S)] == pytest.approx(wanted, abs=1e-6)
    if number & 0x0040:
        assert len(values[-1]) == 8
    if number & 0x0200:
        assert bytes(values[types.index(UI1S)]) == WINDOW_STATES
    return values


@pytest.mark.parametrize("unit", [0, 1])
@pytest.mark.parametrize("beside", SUBSETS, ids=hex)
@pytest.mark.parametrize("pose", POSE_PARTS, ids=hex)
def test_4_1_receive_format(shared: SlaveCell, pose: int, beside: int, unit: int) -> None:
    """Every combination of a pose, the fields beside it, and the unit of the timestamp."""
    cell, number = shared, pose | beside
    cell.set_io(WINDOW[0], int.from_bytes(WINDOW_STATES, "little"), 24)
    told = cell.robot.execute("slvRecvFormat", i4s(number, unit))
    assert variant(told).type == VarType.EMPTY
    cell.on()
    parameter = [pose_array(j()), *WINDOW] if number & 0x0200 else pose_array(j())
    code, answer = cell.ask(parameter)
    assert code == S_OK
    check_answer(answer, number)
    cell.off()


@pytest.mark.parametrize(("parameter", "per_cycle"), [([0x12, 0], 8), ([0x12, 1], 8000), ([0x12], 8)])
def test_4_1_unit_of_the_timestamp(cell: SlaveCell, parameter: list[int], per_cycle: int) -> None:
    """0: ms, 1: µs; ms if it is omitted."""
    cell.execute("slvRecvFormat", i4s(*parameter))
    cell.on()
    times = []
    for _ in range(5):
        times.append(cell.ask(j())[1].value[0].value)
        cell.pass_cycles(10)
    gaps = [after - before for before, after in itertools.pairwise(times)]
    assert gaps == pytest.approx([10 * per_cycle] * 4, abs=1)


@pytest.mark.parametrize(
    "parameter", [[0x0006], [0x000F], [0x0082], [0x0402], [0x1002], [0x10002], [-1], [2, 2], [2, -1]]
)
def test_4_1_there_is_no_other_receive_format(cell: SlaveCell, parameter: list[int]) -> None:
    assert cell.code_of(lambda: cell.robot.execute("slvRecvFormat", i4s(*parameter))) == E_INVALIDARG
    cell.on()
    assert cell.ask(j())[1].type == R8S


# --- table 4-2: what slvMove takes -----------------------------------------------------------------------------------

MINI, HAND = 0xA5C3, 0x5A
SENT = (136, 2, bytes([0x0F, 0xF1]))  # sent general I/O: first point, bytes, states
SEND_ROWS = {
    "position": (0x0000, 0, []),
    "position, received general I/O": (0x0000, 1, [*WINDOW]),
    "position, hand": (0x0020, 0, [HAND]),
    "position, hand, received general I/O": (0x0020, 1, [*WINDOW, HAND]),
    "position, mini": (0x0100, 0, [MINI]),
    "position, mini, received general I/O": (0x0100, 1, [MINI, *WINDOW]),
    "position, mini, hand": (0x0120, 0, [MINI, HAND]),
    "position, mini, hand, received general I/O": (0x0120, 1, [MINI, *WINDOW, HAND]),
    "position, sent general I/O": (0x0200, 0, [*SENT]),
    "position, sent and received general I/O": (0x0200, 1, [*SENT, *WINDOW]),
    "position, sent general I/O, hand": (0x0220, 0, [*SENT, HAND]),
    "position, sent and received general I/O, hand": (0x0220, 1, [*SENT, *WINDOW, HAND]),
}


@pytest.mark.parametrize("kind", ["P", "J", "T"])
@pytest.mark.parametrize("row", SEND_ROWS)
def test_4_2_parameter(cell: SlaveCell, row: str, kind: str) -> None:
    """The documented order is accepted, the outputs are set, and no others."""
    send, receives, beside = SEND_ROWS[row]
    cell.set_io(WINDOW[0], int.from_bytes(WINDOW_STATES, "little"), 24)
    cell.execute("slvSendFormat", send)
    cell.execute("slvRecvFormat", i4s(0x0202 if receives else 0x0002))
    cell.on({"P": 0x001, "J": 0x002, "T": 0x003}[kind])
    position = pose_array(POSES[kind](0.0))
    for _ in range(2):
        code, answer = cell.ask([position, *beside] if beside else position)
        assert code == S_OK
        check_answer(answer, 0x0202 if receives else 0x0002)
    cell.pass_cycles(3)
    assert cell.error == 0
    assert cell.io(16, 16) == (MINI if send & 0x0100 else 0)
    assert cell.io(64) == (HAND if send & 0x0020 else 0)
    assert cell.io(SENT[0], 16) == (int.from_bytes(SENT[2], "little") if send & 0x0200 else 0)
    assert cell.io(WINDOW[0], 24) == int.from_bytes(WINDOW_STATES, "little")
    assert cell.io(0, 16) == 0
    assert cell.io(72, 56) == 0
    assert len(SEND_ROWS) == 12


@pytest.mark.parametrize("row", [name for name, (_, _, beside) in SEND_ROWS.items() if beside])
def test_4_2_another_number_of_parameters_is_refused(cell: SlaveCell, row: str) -> None:
    """Nothing of it is executed. No document defines the code."""
    send, receives, beside = SEND_ROWS[row]
    cell.execute("slvSendFormat", send)
    cell.execute("slvRecvFormat", i4s(0x0202 if receives else 0x0002))
    cell.on()
    for wrong in (beside[:-1], [*beside, 1]):
        assert cell.codes([pose_array(j(STEP)), *wrong])[0] & 0x8000_0000, wrong
    cell.pass_cycles(3)
    assert cell.joints == HOME
    assert cell.io(16, 64) == 0
    assert cell.io(SENT[0], 16) == 0


# --- table 4-3: what slvMove answers ---------------------------------------------------------------------------------

T, M, H, U, C = 0x0010, 0x0100, 0x0020, 0x0200, 0x0040  # timestamp, MiniIO, HandIO, general I/O, current
ANSWER_ROWS: list[tuple[int, list[int]]] = [
    (0, [R8S]),
    (M, [R8S, I4]),
    (T, [I4, R8S]),  # the second line is missing in print
    (T | M, [I4, R8S, I4]),
    (H, [R8S, I4]),
    (M | H, [R8S, I4, I4]),
    (T | H, [I4, R8S, I4]),
    (T | M | H, [I4, R8S, I4, I4]),
    (U, [R8S, UI1S]),
    (T | U, [I4, R8S, UI1S]),
    (U | H, [R8S, UI1S, I4]),
    (T | U | H, [I4, R8S, UI1S, I4]),
    (C, [R8S, R8S]),
    (M | C, [R8S, I4, R8S]),
    (T | M | C, [I4, R8S, I4, R8S]),
    (H | C, [R8S, I4, R8S]),
    (M | H | C, [R8S, I4, I4, R8S]),
    (T | H | C, [I4, R8S, I4, R8S]),
    (T | M | H | C, [I4, R8S, I4, I4, R8S]),
    (U | C, [R8S, UI1S, R8S]),
    (T | U | C, [I4, R8S, UI1S, R8S]),
    (M | U | C, [R8S, I4, UI1S, R8S]),
    (T | U | H | C, [I4, R8S, UI1S, I4, R8S]),
]


@pytest.mark.parametrize(("beside", "types"), ANSWER_ROWS, ids=[hex(row[0]) for row in ANSWER_ROWS])
@pytest.mark.parametrize("pose", POSE_PARTS, ids=hex)
def test_4_3_answer(cell: SlaveCell, pose: int, beside: int, types: list[int]) -> None:
    """Each row for each pose: types and order, and the source of each value.

    That inputs are the lowest bits of a state is the reading of this project: 0 to 15 of MiniIO, 48 to 55 of HandIO.
    """
    mini_inputs, hand_inputs = 0x8001, 0x42
    cell.set_io(0, mini_inputs, 16)
    cell.set_io(48, hand_inputs)
    cell.set_io(WINDOW[0], int.from_bytes(WINDOW_STATES, "little"), 24)
    cell.pass_cycles(7)
    number = pose | beside
    cell.execute("slvRecvFormat", i4s(number))
    cell.on()
    _, answer = cell.ask([pose_array(j()), *WINDOW] if beside & U else pose_array(j()))
    values = check_answer(answer, number)
    assert types_of(number) == types
    if beside & T:
        assert 0 <= values[0] < 60_000
    states = [value for value in values[1 if beside & T else 0 :] if isinstance(value, int)]
    if beside & M:
        assert states.pop(0) & 0xFFFF == mini_inputs
    if beside & H:
        assert states.pop(0) & 0xFF == hand_inputs
    assert states == []
    assert len(ANSWER_ROWS) == 23


def test_4_3_an_answer_is_of_joints_before_any_receive_format(cell: SlaveCell) -> None:
    """4.6.3: J of eight numbers, whichever pose type was sent (ruling)."""
    for mode, pose in ((0x001, p), (0x002, j), (0x003, t)):
        cell.on(mode)
        answer = cell.ask(pose())[1]
        assert answer.type == R8S
        assert answer.value == pytest.approx(j(), abs=1e-6)
        cell.off()


# --- table 4-4 and 4.3: buffers and return codes ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["P", "J", "T"])
def test_4_4_mode_0_answers_at_once_as_the_buffer_is(cell: SlaveCell, kind: str) -> None:
    """4.3.1: room, full, overflow; an overflowing set-point is not queued and is no error of the controller."""
    pose = POSES[kind]
    cell.on({"P": 0x001, "J": 0x002, "T": 0x003}[kind])
    turns = [STEP, 2 * STEP, 3 * STEP]
    assert cell.codes(*map(pose, turns)) == [S_OK, S_OK, S_BUF_FULL]
    assert cell.codes(pose(90.0), pose(91.0)) == [E_BUF_FULL] * 2
    assert cell.error == 0
    assert cell.joints == HOME
    assert cell.trace(1)[0][0] == pytest.approx(turns[0], abs=1e-9)
    assert cell.codes(pose(4 * STEP), pose(90.0)) == [S_BUF_FULL, E_BUF_FULL]
    assert [joints[0] for joints in cell.trace(2)] == pytest.approx([2 * STEP, 3 * STEP], abs=1e-9)
    assert cell.codes(pose(4 * STEP), pose(4 * STEP), pose(90.0)) == [S_OK, S_BUF_FULL, E_BUF_FULL]
    assert [joints[0] for joints in cell.trace(5)] == pytest.approx([4 * STEP] * 5, abs=1e-9)
    assert cell.error == 0
    assert cell.codes(pose(4 * STEP)) == [S_OK]


@pytest.mark.parametrize("kind", ["P", "J", "T"])
def test_4_4_mode_1_has_one_set_point_that_is_overwritten(cell: SlaveCell, kind: str) -> None:
    """4.3.2: the last set-point sent is executed."""
    pose = POSES[kind]
    cell.on({"P": 0x101, "J": 0x102, "T": 0x103}[kind])
    assert cell.codes(pose(90.0), pose(-90.0), pose(50.0), pose(45.0), pose(STEP)) == [S_OK] * 5
    assert cell.joints == HOME
    assert [joints[0] for joints in cell.trace(3)] == pytest.approx([STEP] * 3, abs=1e-9)
    assert cell.codes(pose(90.0), pose(2 * STEP)) == [S_OK] * 2
    assert [joints[0] for joints in cell.trace(3)] == pytest.approx([2 * STEP] * 3, abs=1e-9)
    assert cell.error == 0


@pytest.mark.parametrize("kind", ["P", "J", "T"])
def test_4_4_mode_2_answers_when_there_is_room(cell: SlaveCell, kind: str) -> None:
    """4.3.3: three are replied to at once, each further one when one has been consumed; all are executed in order."""
    pose = POSES[kind]
    cell.on({"P": 0x201, "J": 0x202, "T": 0x203}[kind])
    turns = [STEP, 2 * STEP, 3 * STEP, 4 * STEP, 5 * STEP, 5 * STEP]
    for turn in turns[:3]:
        code, answer = cell.ask(pose(turn))
        assert not code & 0x8000_0000
        assert answer.type == R8S
    done = []
    for number, turn in enumerate(turns[3:]):
        answer = cell.robot.execute("slvMove", variant(pose(turn)))
        assert isinstance(answer, Deferred)
        assert not answer.done()
        assert cell.joints[0] == pytest.approx(number * STEP, abs=1e-9)
        done.append(cell.trace(1)[0][0])
        assert answer.done()
        result = answer.result()
        assert not (isinstance(result, ResultWithCode) and result.code & 0x8000_0000)
    done += [joints[0] for joints in cell.trace(5)]
    assert done == pytest.approx([*turns, 5 * STEP, 5 * STEP], abs=1e-9)
    assert cell.error == 0
    assert cell.mode == {"P": 0x201, "J": 0x202, "T": 0x203}[kind]


# --- table 4-5: extended joints ----------------------------------------------------------------------------------------

EXTRA = 0x00400000
J7, J8 = 0.02, -0.15  # deg, mm, in one cycle from rest
EIGHT_AXES = """
name = "VS-050 on a rail"
type_name = "VS050A3-RAIL"
origins = [[0, 0, 181.5], [0, 0, 163.5], [0, 0, 250], [-10, 0, 119.5], [0, 0, 135.5], [0, 0, 70]]
axes = [
    { lower = -170, upper = 170, velocity = 425 },
    { lower = -120, upper = 120, velocity = 340 },
    { lower = -120, upper = 151, velocity = 385.72 },
    { lower = -270, upper = 270, velocity = 425 },
    { lower = -120, upper = 120, velocity = 327.01 },
    { lower = -360, upper = 360, velocity = 680 },
    { lower = -180, upper = 180, velocity = 100 },
    { lower = -300, upper = 300, velocity = 1000, linear = true },
]
home = [0, 45, 90, 0, 45, 0, 10, 20]
"""
EXTRA_ROWS: dict[str, tuple[int, list[float], bool, bool]] = {  # mode, elements, whether J7 and J8 move
    "P, 7": (0x001, [*p(STEP), EXTRA | 0x40, 10 + J7], True, False),
    "P, 8": (0x001, [*p(STEP), EXTRA | 0x80, 20 + J8], False, True),
    "P, 7 and 8": (0x001, [*p(STEP), EXTRA | 0xC0, 10 + J7, 20 + J8], True, True),
    "J, 7": (0x002, [STEP, *HOME[1:], 10 + J7, 20 + J8, EXTRA | 0x40], True, False),
    "J, 8": (0x002, [STEP, *HOME[1:], 10 + J7, 20 + J8, EXTRA | 0x80], False, True),
    "J, 7 and 8": (0x002, [STEP, *HOME[1:], 10 + J7, 20 + J8, EXTRA | 0xC0], True, True),
    "T, 7": (0x003, [*t(STEP), EXTRA | 0x40, 10 + J7], True, False),
    "T, 8": (0x003, [*t(STEP), EXTRA | 0x80, 20 + J8], False, True),
    "T, 7 and 8": (0x003, [*t(STEP), EXTRA | 0xC0, 10 + J7, 20 + J8], True, True),
}
EXTRA_SIZES = {0x001: {9, 10}, 0x002: {9}, 0x003: {12, 13}}


@pytest.fixture
def rail(tmp_path: Path) -> Iterator[SlaveCell]:
    """A cell whose arm has two extended joints, the seventh in deg and the eighth in mm."""
    file = tmp_path / "rail.toml"
    file.write_text(EIGHT_AXES, encoding="utf-8")
    made = SlaveCell(model=load_model(file))
    yield made
    made.close()


@pytest.mark.parametrize("buffering", [0x000, 0x100, 0x200])
@pytest.mark.parametrize("row", EXTRA_ROWS)
def test_4_5_extra_axes(rail: SlaveCell, row: str, buffering: int) -> None:
    """The axes named by the option move in the cycle of the set-point; the other one stays."""
    mode, elements, seventh, eighth = EXTRA_ROWS[row]
    assert len(elements) in EXTRA_SIZES[mode]
    rail.on(mode | buffering)
    wanted = (STEP, *HOME[1:], 10 + J7 * seventh, 20 + J8 * eighth)
    for _ in range(2):
        assert rail.ask([float(element) for element in elements])[0] == S_OK
        rail.clock.advance(PERIOD)
        assert rail.joints == pytest.approx(wanted, abs=1e-9)
    rail.off()
    assert rail.joints == pytest.approx(wanted, abs=1e-9)
    assert rail.error == 0


@pytest.mark.parametrize("mode", [0x001, 0x002, 0x003])
def test_4_5_without_the_option_extra_axes_stay(rail: SlaveCell, mode: int) -> None:
    """4.4: to move them the option is added."""
    rail.on(mode)
    for _ in range(2):
        assert rail.ask(POSES[MODES[mode]](STEP))[0] == S_OK
        rail.clock.advance(PERIOD)
    assert rail.joints == pytest.approx((STEP, *HOME[1:], 10, 20), abs=1e-9)


@pytest.mark.parametrize("row", [row for row in EXTRA_ROWS if row.endswith(", 7")])
def test_4_5_an_arm_of_seven_axes(tmp_path: Path, row: str) -> None:
    file = tmp_path / "seven.toml"
    lines = [line for line in EIGHT_AXES.splitlines() if "linear" not in line]
    file.write_text("\n".join(lines).replace("10, 20]", "10]"), encoding="utf-8")
    seven = SlaveCell(model=load_model(file))
    mode, elements, _, _ = EXTRA_ROWS[row]
    seven.on(mode)
    for _ in range(2):
        assert seven.ask([float(element) for element in elements])[0] == S_OK
        seven.clock.advance(PERIOD)
    assert seven.joints == pytest.approx((STEP, *HOME[1:], 10 + J7), abs=1e-9)
    assert seven.error == 0
    seven.close()


@pytest.mark.parametrize(("axis", "velocity", "option", "place"), [(7, 100.0, 0x40, 6), (8, 1000.0, 0x80, 7)])
def test_4_5_extra_axes_have_limits_too(rail: SlaveCell, axis: int, velocity: float, option: int, place: int) -> None:
    """Table 4-5 and 4.8: the digit is that of the axis."""
    rail.on()
    pose = [*HOME, 10.0, 20.0, float(EXTRA | option)]
    pose[place] += 1.001 * SERVO_LIMIT * velocity * PERIOD
    rail.feed([pose])
    assert rail.error in (SPEED_OVER + axis, ACCELERATION_OVER + axis)


# --- table 4-6: an empty buffer --------------------------------------------------------------------------------------

SLOW = 0.01  # deg in a cycle: 1.25 deg/s, and a stop within the limits


@pytest.mark.parametrize("mode", [number for number in MODES if not number & 0x100])
def test_4_6_modes_0_and_2_moving(cell: SlaveCell, mode: int) -> None:
    """An error, and slave mode is off."""
    cell.on(mode)
    assert cell.codes(POSES[MODES[mode]](SLOW)) == [S_OK]
    cell.pass_cycles(1)
    assert cell.error == 0
    cell.pass_cycles(1)
    assert cell.error == COMMAND_DELAY
    assert cell.mode == OFF
    assert cell.codes(POSES[MODES[mode]](SLOW)) == [SLAVE_MODE_OFF]


@pytest.mark.parametrize("mode", [number for number in MODES if not number & 0x100])
@pytest.mark.parametrize("turns", [[0.0], [SLOW, SLOW], [SLOW, 2 * SLOW, 2 * SLOW], [SLOW, 0.0, 0.0, 0.0]])
def test_4_6_modes_0_and_2_standing(cell: SlaveCell, mode: int, turns: list[float]) -> None:
    """No error, and slave mode stays on: the command is the same twice. Then it continues."""
    cell.on(mode)
    cell.pass_cycles(20)
    for turn in turns:
        assert cell.codes(POSES[MODES[mode]](turn)) == [S_OK]
        cell.pass_cycles(1)
    cell.pass_cycles(50)
    assert cell.error == 0
    assert cell.mode == mode
    assert cell.joints == pytest.approx((turns[-1], *HOME[1:]), abs=1e-9)
    assert cell.codes(POSES[MODES[mode]](turns[-1])) == [S_OK]


@pytest.mark.parametrize(("mode", "told"), [(0x001, "CurPos"), (0x002, "CurJnt"), (0x003, "CurTrn")])
@pytest.mark.parametrize(
    "joints", [HOME, (30.0, 20.0, 70.0, 10.0, 45.0, 15.0), (-80.0, 55.0, 65.0, -60.0, 80.0, 170.0)]
)
def test_4_6_a_set_point_where_the_robot_stands(cell: SlaveCell, mode: int, told: str, joints: Sequence[float]) -> None:
    """The position reported by the controller: sent once, the robot stays, and that is no underflow.

    Rounding, of 1e-14 deg, is no motion: 4.5 refers to the present velocity of the axes.
    """
    cell.stand(*joints)
    pose = [float(value) for value in cell.execute(told)]
    cell.on(mode)
    cell.pass_cycles(5)
    assert cell.codes(pose) == [S_OK]
    cell.pass_cycles(50)
    assert cell.error == 0
    assert cell.mode == mode
    assert cell.joints == pytest.approx(joints, abs=1e-9)


@pytest.mark.parametrize("mode", [0x101, 0x102, 0x103])
def test_4_6_mode_1_moving(cell: SlaveCell, mode: int) -> None:
    """A command to stay in place, no error, and slave mode stays on."""
    cell.on(mode)
    for turn in (SLOW, 2 * SLOW):
        assert cell.codes(POSES[MODES[mode]](turn)) == [S_OK]
        cell.pass_cycles(1)
    assert [joints[0] for joints in cell.trace(20)] == pytest.approx([2 * SLOW] * 20, abs=1e-9)
    assert cell.error == 0
    assert cell.mode == mode
    assert cell.codes(POSES[MODES[mode]](3 * SLOW)) == [S_OK]
    assert cell.trace(2)[-1][0] == pytest.approx(3 * SLOW, abs=1e-9)


@pytest.mark.parametrize("mode", [0x101, 0x102, 0x103])
def test_4_6_mode_1_standing(cell: SlaveCell, mode: int) -> None:
    cell.on(mode)
    cell.pass_cycles(50)
    assert cell.codes(POSES[MODES[mode]](0.0), POSES[MODES[mode]](0.0)) == [S_OK, S_OK]
    cell.pass_cycles(50)
    assert cell.error == 0
    assert cell.mode == mode
    assert cell.joints == pytest.approx(HOME, abs=1e-9)


def fast(cell: SlaveCell) -> float:
    """Move J1 so fast that it cannot stop within a cycle; return its position."""
    turns = list(itertools.accumulate(0.5 * number for number in range(1, 6)))
    cell.feed([j(turn) for turn in turns])
    assert cell.error == 0
    return turns[-1]


def test_4_5_mode_1_stopping_fast(cell: SlaveCell) -> None:
    """4.5: the command to stay is a sudden stop if the robot is not slow enough; slave mode is off (4.7)."""
    cell.on(0x102)
    fast(cell)
    cell.pass_cycles(1)
    assert cell.error == ACCELERATION_OVER + 1
    assert cell.mode == OFF


@pytest.mark.parametrize("mode", [0x002, 0x202])
def test_4_5_two_equal_commands_while_fast(cell: SlaveCell, mode: int) -> None:
    """4.5: the same command twice is one too."""
    cell.on(mode)
    turn = fast(cell)
    cell.feed([j(turn)])
    assert cell.error == ACCELERATION_OVER + 1
    assert cell.mode == OFF


@pytest.mark.parametrize("mode", [0x002, 0x202])
def test_4_5_running_empty_while_fast(cell: SlaveCell, mode: int) -> None:
    cell.on(mode)
    fast(cell)
    cell.pass_cycles(1)
    assert cell.error == COMMAND_DELAY
    assert cell.mode == OFF


# --- 4.6: the procedure ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [0x002, 0x102, 0x202])
def test_4_6_1_the_first_set_point_is_where_the_robot_stands(cell: SlaveCell, mode: int) -> None:
    """A set-point that is far away is too fast; the document does not define which of the two errors comes first."""
    cell.on(mode)
    assert cell.codes(j(20.0)) == [S_OK]
    cell.pass_cycles(1)
    assert cell.error in (SPEED_OVER + 1, ACCELERATION_OVER + 1)
    assert cell.joints[0] < 20.0
    assert cell.mode == OFF


@pytest.mark.parametrize("mode", [0x002, 0x202])
def test_4_6_2_the_buffer_is_executed_before_the_end(cell: SlaveCell, mode: int) -> None:
    """slvChangeMode 0 returns when the buffer is empty, and the mode changes then."""
    stranger = cell.other()
    cell.on(mode)
    cell.feed([j(SLOW)])
    assert not any(code & 0x8000_0000 for code in cell.codes(j(2 * SLOW), j(3 * SLOW), j(3 * SLOW)))
    leaving = cell.robot.execute("slvChangeMode", variant(OFF))
    assert isinstance(leaving, Deferred)
    done = []
    while not leaving.done():
        assert plain(stranger.execute("slvGetMode", variant(None))) == mode
        done.append(cell.trace(1)[0][0])
        assert len(done) < 10
    assert done[:3] == pytest.approx([2 * SLOW, 3 * SLOW, 3 * SLOW], abs=1e-9)
    assert cell.joints[0] == pytest.approx(3 * SLOW, abs=1e-9)
    assert variant(cell.run(leaving)).type == VarType.EMPTY
    assert cell.mode == OFF
    assert cell.error == 0


def test_4_6_2_an_error_before_the_end_is_reported(cell: SlaveCell) -> None:
    """The client that waits for the end of the mode does not wait forever."""
    cell.on()
    cell.codes(j(SLOW), j(20.0), j(20.0))
    leaving = cell.robot.execute("slvChangeMode", variant(OFF))
    cell.pass_cycles(2)
    assert cell.error in (SPEED_OVER + 1, ACCELERATION_OVER + 1)
    assert leaving.done()
    assert cell.code(leaving) & 0x8000_0000
    assert cell.mode == OFF


@pytest.mark.parametrize("mode", MODES)
def test_4_6_2_the_end_while_standing(cell: SlaveCell, mode: int) -> None:
    """The robot can be moved as before, and slave mode can begin again."""
    pose = POSES[MODES[mode]]
    cell.on(mode)
    for _ in range(2):
        cell.ask(pose(SLOW))
        cell.pass_cycles(1)
    cell.off()
    cell.run(cell.move(1, "@E J(5, 45, 90, 0, 45, 0)"))
    assert cell.joints == pytest.approx((5.0, *HOME[1:]), abs=1e-9)
    cell.on(mode)
    assert cell.codes(pose(5.0), pose(5.0)) == [S_OK, S_OK]
    cell.pass_cycles(5)
    assert cell.mode == mode
    assert cell.error == 0


# --- footnote 2: other commands in slave mode ------------------------------------------------------------------------

COMMANDS: list[tuple[str, Any]] = [
    ("TakeArm", [0, 0]), ("GiveArm", None), ("Motor", [0, 0]), ("Motor", [1, 0]), ("ExtSpeed", [50.0]), ("CurPos", None),
    ("CurJnt", None), ("CurTrn", None), ("CurFig", None), ("HighCurJnt", None), ("DestPos", None),
    ("SetToolDef", [1, "P(0, 0, 0, 0, 0, 0)"]), ("DriveEx", ["(1, 1)", ""]), ("Approach", [1, "J(1)", "@P 1", ""]),
    ("P2J", "P(300, 0, 300, 180, 0, 180, 5)"), ("StartLog", None), ("slvSendFormat", 0), ("slvSendFormat", 0x0020),
    ("slvRecvFormat", [2, 0]), ("GetRobotTypeName", None),
    *(("slvChangeMode", number) for number in MODES),
]  # fmt: skip
METHODS: dict[str, Callable[[Any], Any]] = {
    "Robot_Move": lambda robot: robot.move(1, variant("J(1, 45, 90, 0, 45, 0)"), ""),
    "Robot_Speed": lambda robot: robot.speed(-1, 50.0),
    "Robot_Accelerate": lambda robot: robot.accelerate(-1, 50.0, 50.0),
    "Robot_Change": lambda robot: robot.change("Tool1"),
    "Robot_GoHome": lambda robot: robot.go_home(),
    "Robot_Hold": lambda robot: robot.hold(""),
    "Robot_Unhold": lambda robot: robot.unhold(""),
}


@pytest.mark.parametrize(("command", "parameter"), COMMANDS)
@pytest.mark.parametrize("mode", [0x002, 0x102, 0x202])
def test_footnote_2_other_commands_are_refused(cell: SlaveCell, mode: int, command: str, parameter: Any) -> None:
    cell.on(mode)
    assert cell.code_of(lambda: cell.robot.execute(command, variant(parameter))) == NOT_IN_SLAVE_MODE
    assert cell.mode == mode
    assert cell.codes(j()) == [S_OK]
    cell.pass_cycles(1)
    assert cell.error == 0


@pytest.mark.parametrize("method", METHODS)
def test_footnote_2_other_functions_are_refused(cell: SlaveCell, method: str) -> None:
    cell.on()
    assert cell.code_of(lambda: METHODS[method](cell.robot)) == NOT_IN_SLAVE_MODE
    assert cell.mode == 0x002


@pytest.mark.parametrize("command", ["ClearError", "SysState", "GetCurErrorCount", "GetErrorDescription"])
def test_footnote_2_commands_of_the_controller_are_refused(cell: SlaveCell, command: str) -> None:
    """Reference, section 0, item 8."""
    cell.on()
    parameter = 0 if command == "GetErrorDescription" else None
    assert cell.code_of(lambda: cell.controller.execute(command, variant(parameter))) == NOT_IN_SLAVE_MODE


def test_footnote_2_another_client_can_read(cell: SlaveCell) -> None:
    """Ruling: another connection can read; it cannot command."""
    stranger = cell.other()
    cell.on()
    assert cell.run(stranger.execute("CurJnt", variant(None)))[:6] == pytest.approx(HOME)
    assert plain(stranger.execute("slvGetMode", variant(None))) == 0x002
    assert cell.code_of(lambda: stranger.execute("slvMove", variant(j()))) & 0x8000_0000
    assert cell.code_of(lambda: stranger.move(1, variant("J(1, 45, 90, 0, 45, 0)"), "")) & 0x8000_0000
    assert cell.code_of(lambda: stranger.execute("slvChangeMode", variant(OFF))) & 0x8000_0000
    assert cell.mode == 0x002


# --- 4.7: errors -----------------------------------------------------------------------------------------------------


def underflow(cell: SlaveCell) -> int:
    cell.feed([j(SLOW)])
    cell.pass_cycles(1)
    return COMMAND_DELAY


def leap(cell: SlaveCell) -> int:
    cell.feed([j(0.8)])
    return ACCELERATION_OVER + 1


def sprint(cell: SlaveCell) -> int:
    """J6 exceeds its velocity by a tenth of a percent."""
    goes = ramp(HOME, 5, SERVO_LIMIT * 680, SERVO_LIMIT * 3400)
    cell.feed([*goes, beyond(goes, 5, 1.001 * SERVO_LIMIT * 680)])
    return SPEED_OVER + 6


@pytest.mark.parametrize("happens", [underflow, leap, sprint])
@pytest.mark.parametrize("mode", [0x002, 0x202])
def test_4_7_after_an_error(cell: SlaveCell, mode: int, happens: Callable[[SlaveCell], int]) -> None:
    """Slave mode is off; ClearError and slvChangeMode start it again (with the motor on again, if it went off)."""
    cell.on(mode)
    assert cell.error == 0
    code = happens(cell)
    assert cell.error == code
    assert cell.mode == OFF
    assert cell.codes(j()) == [SLAVE_MODE_OFF]
    cell.pass_cycles(300)
    assert cell.code_of(lambda: cell.robot.execute("slvChangeMode", variant(mode))) == ERROR_PRESENT
    cell.run(cell.controller.execute("ClearError", variant(None)))
    assert cell.error == 0
    assert cell.codes(j()) == [SLAVE_MODE_OFF]
    if not cell.arm.motor.on:
        cell.execute("Motor", [1, 0])
    cell.on(mode)
    here = list(cell.joints)
    there = [here[0] + SLOW, *here[1:]]
    cell.feed([here, there, there])
    cell.pass_cycles(3)
    assert cell.error == 0
    assert cell.mode == mode
    assert cell.joints == pytest.approx(there, abs=1e-9)
    cell.off()


@pytest.mark.parametrize("mode", MODES)
def test_4_7_an_error_from_elsewhere_ends_slave_mode(cell: SlaveCell, mode: int) -> None:
    pose = POSES[MODES[mode]]
    cell.on(mode)
    cell.ask(pose(0.0))
    cell.rc8.raise_error(0x84404541)
    assert cell.mode == OFF
    assert cell.codes(pose(0.0)) == [SLAVE_MODE_OFF]


def test_4_7_calls_waiting_for_room_fail(cell: SlaveCell) -> None:
    """Mode 2: a delayed reply becomes an error if an error occurs."""
    cell.on(0x202)
    cell.codes(j(), j(), j())
    waiting = cell.robot.execute("slvMove", variant(j()))
    assert not waiting.done()
    cell.rc8.raise_error(0x84404541)
    assert waiting.done()
    assert cell.code(waiting) & 0x8000_0000


# --- 4.8: limits -----------------------------------------------------------------------------------------------------

VELOCITY = (425.0, 340.0, 385.72, 425.0, 327.01, 680.0)  # of the model; its accelerations are five times as large
BEGIN = (-60.0, -50.0, -60.0, -60.0, -60.0, -80.0)
EXTERNAL = 20.0
ACCELERATION = 6300.0  # of every axis of the VS-050 in slave mode
LIMITS = {  # setting: fractions of the model's limits; ExtSpeed 20 has an acceleration of 20 * 20 / 100
    0: (SERVO_LIMIT, SERVO_LIMIT),
    1: (SERVO_LIMIT * 0.20, SERVO_LIMIT * 0.04),
    2: (1.0, 1.0),
    3: (0.20, 0.04),
}


def ramp(start: Sequence[float], axis: int, velocity: float, acceleration: float) -> list[list[float]]:
    """Accelerate an axis to a thousandth below a velocity, with nine tenths of an acceleration."""
    points, speed, position = [], 0.0, start[axis]
    while speed < 0.999 * velocity:
        speed = min(0.999 * velocity, speed + 0.9 * acceleration * PERIOD)
        position += speed * PERIOD
        points.append([*start[:axis], position, *start[axis + 1 :]])
    return points


def beyond(points: list[list[float]], axis: int, velocity: float) -> list[float]:
    """Return the next point at a velocity."""
    last = points[-1]
    return [*last[:axis], last[axis] + velocity * PERIOD, *last[axis + 1 :]]


@pytest.fixture(params=LIMITS)
def limited(request: pytest.FixtureRequest) -> Iterator[tuple[SlaveCell, float, float]]:
    """A cell with a setting and ExtSpeed 20; fractions of velocity and acceleration."""
    made = SlaveCell(slave_limit=request.param)
    made.execute("ExtSpeed", [EXTERNAL])
    yield made, *LIMITS[request.param]
    made.close()


def start_for(axis: int) -> list[float]:
    return [BEGIN[number] if number == axis else joint for number, joint in enumerate(HOME)]


@pytest.mark.parametrize("axis", range(6))
def test_4_8_velocity(limited: tuple[SlaveCell, float, float], axis: int) -> None:
    cell, speed, acceleration = limited
    velocity = VELOCITY[axis] * speed
    start = start_for(axis)
    cell.stand(*start)
    cell.on()
    points = ramp(start, axis, velocity, 5 * VELOCITY[axis] * acceleration)
    cell.feed([*points, beyond(points, axis, 0.999 * velocity)])
    assert cell.error == 0
    assert cell.joints[axis] == pytest.approx(points[-1][axis] + 0.999 * velocity * PERIOD, abs=1e-9)
    cell.feed([beyond([list(cell.joints)], axis, 1.001 * velocity)])
    assert cell.error == SPEED_OVER + axis + 1
    assert cell.mode == OFF


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("axis", range(6))
def test_4_8_acceleration(limited: tuple[SlaveCell, float, float], axis: int, way: int) -> None:
    """From rest, in either direction."""
    cell, _, part = limited
    change = way * ACCELERATION * part * PERIOD**2
    start = start_for(axis)
    cell.stand(*start)
    cell.on()
    allowed = [*start[:axis], start[axis] + 0.999 * change, *start[axis + 1 :]]
    cell.feed([allowed, allowed])
    assert cell.error == 0
    assert cell.mode == 0x002
    too_much = [*start[:axis], start[axis] + (0.999 + 1.001) * change, *start[axis + 1 :]]
    cell.feed([too_much])
    assert cell.error == ACCELERATION_OVER + axis + 1
    assert cell.mode == OFF


@pytest.mark.parametrize("axis", range(6))
def test_4_8_braking(limited: tuple[SlaveCell, float, float], axis: int) -> None:
    """An acceleration against the motion counts like any other."""
    cell, _, part = limited
    change = ACCELERATION * part * PERIOD**2
    start = start_for(axis)
    cell.stand(*start)
    cell.on()
    steps = [
        0.9,
        1.8,
        1.8 - 0.999,
        0.0,
        0.0,
        0.9,
        1.8,
        1.8 - 1.001,
    ]  # velocities; 1 is the largest change per cycle
    positions = itertools.accumulate((change * step for step in steps), initial=start[axis])
    points = [[*start[:axis], position, *start[axis + 1 :]] for position in list(positions)[1:]]
    cell.feed(points[:-1])
    assert cell.error == 0
    cell.feed(points[-1:])
    assert cell.error == ACCELERATION_OVER + axis + 1


def test_4_8_the_servo_limit_is_the_larger_one() -> None:
    assert SERVO_LIMIT > 1


@pytest.mark.parametrize("setting", LIMITS)
def test_4_8_the_pendant_changes_the_setting(cell: SlaveCell, setting: int) -> None:
    """153: b-CAP Slave speed setting; with an acceleration of its own, ExtSpeed [20, 30]."""
    cell.execute("ExtSpeed", [EXTERNAL, 30.0])
    cell.rc8.pendant.slave_limit(setting)
    part = (SERVO_LIMIT if setting < 2 else 1.0) * (0.30 if setting % 2 else 1.0)
    change = ACCELERATION * part * PERIOD**2
    cell.on()
    cell.feed([j(0.999 * change), j(0.999 * change)])
    assert cell.error == 0
    cell.feed([j((0.999 + 1.001) * change)])
    assert cell.error == ACCELERATION_OVER + 1
