"""Commands for programs and tasks as the provider guide describes them (5.2.11, 5.2.29 to 33, 5.3.3)."""

from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.engine.control_loop import PERIOD
from support.guide_client import GuideClient

I4, R4, R8, BSTR, BOOL = VarType.I4, VarType.R4, VarType.R8, VarType.BSTR, VarType.BOOL
SUSPENDED, READY, RUNNING, STEP_STOPPED = 1, 2, 3, 4

FOREVER = "Sub Main\n  Do\n    {0} = {0} + 1\n    Delay 20\n  Loop\nEnd Sub\n"
MOVE = "Sub Main\n  Takearm\n  Move P, J(60, 45, 90, 0, 45, 0), Speed = 20\n  Givearm\n  I9 = I9 + 1\nEnd Sub\n"


@pytest.fixture
def client():
    made = GuideClient()
    yield made
    made.close()


def start(client, name, text, mode=2):
    task = client.program(name, text)
    client.call("Task_Start", task, mode, "")
    return task


def status(client, task):
    found = client.call("Task_Execute", task, "GetStatus", None)
    assert found.type == I4
    return found.value


def get(client, task, name):
    return client.call("Variable_GetValue", client.value("Task_GetVariable", task, name, ""))


@pytest.fixture
def three(client):
    """A program that counts, one that moves the arm, and a supervisory task; all of them run."""
    tasks = [
        start(client, "Count", FOREVER.format("I1")),
        start(client, "Move", MOVE, 1),
        start(client, "TSR1", FOREVER.format("I2")),
    ]
    client.clock.advance(0.4)
    assert client.rc8.state.arm.busy
    return tasks


# --- all programs -----------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.11.3 KillAll")
@pytest.mark.parametrize("sync", [None, 0, 1])
def test_kill_all(sync, client, three):
    call = client.begin("Controller_Execute", client.controller, "KillAll", variant(sync))
    client.end(call)
    assert client.rc8.state.arm.busy is (not sync)
    assert [status(client, task) for task in three] == [READY, READY, RUNNING]
    client.clock.advance(2)
    assert not client.rc8.state.arm.busy
    assert client.rc8.state.arm.holder is None
    assert client.get("I9").value == 0
    assert client.get("@TSR_BUSY_STATUS").value is True
    client.call("Task_Start", three[0], 1, "")  # from the beginning
    assert status(client, three[0]) == RUNNING


@pytest.mark.guide("5.2.11.4 KillAllTsr", "5.3.1 @TSR_BUSY_STATUS", "5.3.1 @BUSY_STATUS")
def test_kill_all_supervisory_tasks(client, three):
    assert client.execute("KillAllTsr", Variant(I4, 1)).type == VarType.EMPTY
    assert status(client, three[2]) == READY
    assert status(client, three[0]) == RUNNING
    assert client.get("@TSR_BUSY_STATUS") == Variant(BOOL, False)
    assert client.get("@BUSY_STATUS") == Variant(BOOL, True)


@pytest.mark.guide("5.2.11.5 RunAllTsr")
def test_run_all_supervisory_tasks(client):
    count = FOREVER.format
    tasks = [client.program(name, count(f"I{n}")) for n, name in enumerate(("TSR1", "tsr_b", r"lib\Tsr3", "Other"))]
    client.execute("RunAllTsr")
    assert [status(client, task) for task in tasks] == [RUNNING, RUNNING, READY, READY]
    assert client.execute("SysInfo", 6) == Variant(I4, -1)
    client.execute("RunAllTsr", 1)
    assert [status(client, task) for task in tasks] == [RUNNING, RUNNING, RUNNING, READY]
    client.clock.advance(0.5)
    assert all(client.get(f"I{n}").value > 3 for n in range(3))
    client.execute("KillAllTsr")
    assert client.execute("SysInfo", 6) == Variant(I4, 0)


def test_supervisory_tasks_survive_errors_and_modes_and_cannot_take_the_arm(client, three):
    client.rc8.raise_error(0x83204071)
    client.rc8.set_mode(1)
    client.clock.advance(0.1)
    assert [status(client, task) for task in three] == [READY, READY, RUNNING]
    assert client.get("@BUSY_STATUS").value is False
    client.execute("KillAllTsr")
    client.execute("RunAllTsr")  # also in manual mode
    assert status(client, three[2]) == RUNNING
    client.rc8.clear_errors()
    client.rc8.set_mode(3)
    task = start(client, "TSR2", MOVE)
    client.clock.advance(0.1)
    assert status(client, task) == READY
    assert client.execute("GetCurErrorInfo", 0).plain[0] == hresult.signed(hresult.E_ACCESSDENIED)


@pytest.mark.guide("5.2.11.6 SuspendAll", "5.2.11.8 ContinueStartAll", "5.3.3 task @STATUS_DETAILS")
@pytest.mark.parametrize("sync", [0, 1])
def test_suspend_all_and_continue(sync, client, three):
    client.execute("SuspendAll", sync)
    suspended = client.rc8.state.arm.queue.joints
    assert [status(client, task) for task in three] == [SUSPENDED, SUSPENDED, RUNNING]
    assert [get(client, task, "@STATUS_DETAILS").value for task in three[:2]] == [5, 5]
    client.clock.advance(1)
    held, counted = client.rc8.state.arm.queue.joints, client.get("I1").value
    assert held == suspended or not sync  # with 1, the arm is at standstill when the command completes
    client.clock.advance(1)
    assert (client.rc8.state.arm.queue.joints, client.get("I1").value) == (held, counted)
    assert client.execute("ContinueStartAll").type == VarType.EMPTY
    assert [status(client, task) for task in three] == [RUNNING, RUNNING, RUNNING]
    client.clock.advance(20)
    assert client.rc8.state.arm.queue.joints[0] == 60
    assert client.get("I1").value > counted
    assert client.get("I9").value == 1
    assert status(client, three[1]) == READY


def test_continue_requires_what_a_start_requires(client, three):
    client.execute("SuspendAll", 1)
    client.rc8.set_mode(1)
    code = client.code("Controller_Execute", client.controller, "ContinueStartAll", None)
    assert code == hresult.AUTO_MODE_REQUIRED


@pytest.mark.guide("5.2.11.7 StepStopAll")
def test_step_stop_all(client, three):
    client.execute("StepStopAll", 1)
    assert [status(client, task) for task in three] == [STEP_STOPPED, STEP_STOPPED, RUNNING]
    assert client.rc8.state.arm.queue.joints[0] == 60  # the motion was completed first
    client.execute("ContinueStartAll")
    client.clock.advance(1)
    assert client.get("I9").value == 1


def test_commands_for_all_programs_require_the_right_to_write():
    from orinkit.virtual.rc8 import Permission

    client = GuideClient(permission=Permission.parse("192.168.0.7=r"))
    for name in (
        "KillAll",
        "KillAllTsr",
        "RunAllTsr",
        "SuspendAll",
        "StepStopAll",
        "ContinueStartAll",
        "SetPublicValue",
    ):
        code = client.code("Controller_Execute", client.controller, name, variant([1, "A", "b"]))
        assert code == hresult.NO_WRITE_RIGHT, name
    client.close()


# --- Public variables -------------------------------------------------------------------------------------------------

PUBLIC = """Public count As Integer = 5, ratio As Single, exact As Double = 0.1
Public text As String = "abc", flag As Boolean, place As Position, list(3) As Integer, grid(1, 2) As Double
Public pose(2) As Joint
Sub Main
  Do
    count = count + 1
    Call Other
    Delay 16
  Loop
End Sub
Sub Other
  ratio = count / 2
  list(1) = count
  place = P(count, 2, 3, 4, 5, 6, 5)
End Sub
"""


def public(client, *names):
    return client.execute("GetPublicValue", variant(["Pro", *names]))


@pytest.mark.guide("5.2.11.13 GetPublicValue")
def test_public_variables_are_read(client):
    task = client.program("Pro", PUBLIC)
    assert public(client, "count") == Variant(I4, 5)
    assert public(client, "RATIO") == Variant(R4, 0.0)
    assert public(client, "exact") == Variant(R8, 0.1)
    assert public(client, "text") == Variant(BSTR, "abc")
    assert public(client, "flag") == Variant(BOOL, False)
    assert public(client, "place") == Variant(R4 | ARRAY, [0, 0, 0, 0, 0, 0, -1])
    assert public(client, "list") == Variant(I4 | ARRAY, [0] * 4)
    assert public(client, "grid") == Variant(R8 | ARRAY, [0] * 2)
    client.call("Task_Start", task, 1, "")
    client.clock.advance(0.1)
    count = public(client, "count").value
    assert count > 8
    assert public(client, "ratio").value == count / 2
    assert public(client, "list", 1) == Variant(I4, count)
    assert public(client, "place").value[0] == count


@pytest.mark.guide("5.2.11.14 SetPublicValue")
def test_public_variables_are_written(client):
    task = client.program("Pro", PUBLIC)

    def write(value, *names):
        return client.code(
            "Controller_Execute", client.controller, "SetPublicValue", [value, *map(variant, ("Pro", *names))]
        )

    assert write(Variant(I4, 100), "count") == 0
    assert write(Variant(BSTR, "x"), "text") == 0
    assert write(Variant(BOOL, True), "flag") == 0
    assert write(Variant(R4 | ARRAY, [1, 2, 3, 4, 5, 6, 5]), "place") == 0
    assert write(Variant(I4 | ARRAY, [1, 2, 3, 4]), "list") == 0
    assert write(Variant(I4, 9), "list", 3) == 0
    assert write(Variant(R8, 0.5), "grid", 1, 2) == 0
    assert public(client, "list").value == [1, 2, 3, 9]
    assert public(client, "grid", 1, 2) == Variant(R8, 0.5)
    assert (public(client, "text").value, public(client, "flag").value) == ("x", True)
    client.call("Task_Start", task, 1, "")
    client.clock.advance(0.1)
    count = public(client, "count").value
    assert 103 < count < 120
    assert write(Variant(I4, 1000), "count") == 0  # while it runs
    client.clock.advance(0.1)
    assert public(client, "ratio").value >= 500
    assert write(Variant(I4 | ARRAY, [1, 2, 3]), "list") == hresult.E_INVALIDARG
    assert write(Variant(R4 | ARRAY, [1, 2, 3, 4]), "list") == hresult.DISP_E_TYPEMISMATCH
    assert write(Variant(R8 | ARRAY, [1.0] * 6), "grid") == hresult.E_INVALIDARG
    assert write(Variant(I4, 1), "list", 4) == hresult.DISP_E_BADINDEX
    assert write(Variant(I4, 1), "list", 1, 1) == hresult.DISP_E_BADINDEX
    assert write(Variant(I4, 1), "count", 0) == hresult.DISP_E_BADINDEX
    assert write(Variant(R4 | ARRAY, [0.0] * 8), "pose", 0) == hresult.E_INVALIDARG
    assert write(Variant(BSTR, "x"), "count") == hresult.DISP_E_TYPEMISMATCH


@pytest.mark.parametrize(
    ("parameter", "code"),
    [
        (["Pro", "nothing"], hresult.E_CAO_OBJECT_NOTFOUND),
        (["Nobody", "count"], hresult.E_CAO_OBJECT_NOTFOUND),
        (["Pro"], hresult.E_INVALIDARG),
        (["Pro", 1], hresult.E_INVALIDARG),
        (["Pro", "pose"], hresult.E_INVALIDARG),
        (["Pro", "list", 4], hresult.DISP_E_BADINDEX),
        (["Wrong", "count"], hresult.SYNTAX_ERROR),
    ],
)
def test_public_variables_that_cannot_be_read(parameter, code, client):
    client.program("Pro", PUBLIC)
    client.program("Wrong", "Sub Main\n  x = = 1\nEnd Sub\n")
    assert client.code("Controller_Execute", client.controller, "GetPublicValue", variant(parameter)) == code


def test_public_values_stay_until_their_declarations_are_changed(client):
    task = client.program("Pro", "Public n As Integer\nSub Main\n  n = n + 1\nEnd Sub\n")
    for expected in (1, 2, 3):
        client.call("Task_Start", task, 1, "")
        client.clock.advance(0.1)
        assert public(client, "n").value == expected
    client.program("Pro", "Public n As Integer\nSub Main\n  n = n + 2\nEnd Sub\n")
    assert public(client, "n").value == 3  # the declaration is the same
    client.rc8.state.restart()
    assert public(client, "n").value == 0
    client.program("Pro", "Public n As Integer = 7\nSub Main\n  n = n + 1\nEnd Sub\n")
    assert public(client, "n").value == 7


# --- logs, information ------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.11.9 GetErrorLogCount", "5.2.11.10 GetErrorLog")
def test_the_error_log(client):
    client.clock.advance(12.5)
    client.rc8.raise_error(0x83204071, "late", original=0x83500121)
    assert client.execute("GetErrorLogCount") == Variant(I4, 1)
    record = client.execute("GetErrorLog", Variant(I4, 0))
    assert record.type == VarType.VARIANT | ARRAY
    assert [each.type for each in record.value] == [I4] * 10 + [BSTR, I4, BSTR, I4, I4]
    assert record.plain[:9] == [0x83204071 - 2**32, 2024, 4, 1, 1, 9, 0, 12, 500]
    assert record.plain[9:] == [12500, "", 0, "late", 0x83500121 - 2**32, 0]
    client.rc8.clear_errors()
    task = start(client, "Bad", "Sub Main\n  I1 = 0\n  I1 = 1 / I1\nEnd Sub\n", 1)
    client.clock.advance(0.1)
    assert status(client, task) == READY
    record = client.execute("GetErrorLog", 0).plain
    assert (record[10], record[11], record[14]) == ("Bad", 3, 4)
    assert client.code("Controller_Execute", client.controller, "GetErrorLog", 2) == hresult.DISP_E_BADINDEX


@pytest.mark.guide("5.2.11.11 GetOprLogCount", "5.2.11.12 GetOprLog")
def test_the_operation_log(client):
    client.execute("ClearError")
    client.clock.advance(1.0)
    client.rc8.set_mode(1)
    count = client.execute("GetOprLogCount")
    assert count.type == I4
    records = [client.execute("GetOprLog", index) for index in range(count.value)]
    assert all([each.type for each in record.value] == [I4] * 11 + [BSTR] for record in records)
    plain = [record.plain for record in records]
    assert [(record[9], record[10], record[11]) for record in plain] == [
        (1000, 1, "Mode: manual"), (0, 3, "Errors cleared"), (0, 3, "Client connected"),
    ]  # fmt: skip
    assert plain[0][1:9] == [2024, 4, 1, 1, 9, 0, 1, 0]


@pytest.mark.guide("5.2.11.1 ClearError", "5.2.11.2 GetErrorDescription", "5.2.11.15 SysState")
def test_errors_and_state(client):
    client.rc8.raise_error(0x83204071)
    assert client.execute("SysState").value & 2
    text = client.execute("GetErrorDescription", Variant(I4, hresult.signed(0x83204071)))
    assert text == Variant(BSTR, hresult.lookup(0x83204071).en)
    assert client.execute("ClearError").type == VarType.EMPTY
    state = client.execute("SysState")
    assert state.type == I4
    assert not state.value & 2


@pytest.mark.guide("5.2.11.16 SysInfo")
def test_system_information(client):
    items = [client.execute("SysInfo", Variant(I4, item)) for item in range(17)]
    assert [each.type for each in items] == [BSTR, BSTR, I4, I4 | ARRAY] + [I4] * 13
    assert items[0].value == "VIRTUAL-0001"
    assert items[1].value.count(":") == 5
    assert items[3].value == [100] * 8
    assert [each.value for each in items[4:]] == [0, 2000, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    for item in (-1, 17):
        assert client.code("Controller_Execute", client.controller, "SysInfo", item) == hresult.E_INVALIDARG


def test_the_counters_count(client):
    def items(*numbers):
        return [client.execute("SysInfo", number).value for number in numbers]

    start(client, "Count", FOREVER.format("I1"))
    for _ in range(130):
        client.clock.advance(1)
    assert items(8, 9, 10, 11, 12, 13) == [2, 2, 2, 2, 2, 2]
    client.execute("KillAll")
    for _ in range(60):
        client.clock.advance(1)
    assert items(8, 9, 12, 13) == [3, 2, 3, 2]
    client.rc8.state.restart()
    assert items(8, 9, 10, 11, 12, 13) == [3, 2, 3, 2, 0, 0]
    client.rc8.state.usage.reset()
    assert items(8, 9, 10, 11, 12, 13) == [3, 2, 0, 0, 0, 0]
    switched = items(14)[0]
    client.take().robot_execute("Motor", 1)
    assert items(14) == [switched + 1]
    client.put("@VAR_J_LEN", 12)
    assert items(3) == [[100, 100, 100, 100, 100, 12, 100, 100]]


def test_maintenance_is_due(client):
    client.clock.advance(731 * 86400)
    assert [client.execute("SysInfo", item).value for item in (15, 16)] == [-1, -1]


def test_with_strict_the_battery_has_a_date():
    client = GuideClient(strict=True)
    assert client.execute("SysInfo", 15).type == VarType.DATE
    client.close()


# --- a task -----------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.33.2 GetThreadPriority", "5.2.33.3 SetThreadPriority")
def test_priorities_have_an_effect(client):
    busy = "Sub Main\n  Do\n    {0} = {0} + 1\n  Loop\nEnd Sub\n"
    tasks = [start(client, f"P{n}", busy.format(f"I{n}")) for n in range(5)]
    for n, task in enumerate(tasks):
        assert client.call("Task_Execute", task, "GetThreadPriority", None) == Variant(I4, 0)
        assert client.call("Task_Execute", task, "SetThreadPriority", Variant(I4, n - 2)).type == VarType.EMPTY
        assert client.call("Task_Execute", task, "GetThreadPriority", None) == Variant(I4, n - 2)
    before = [client.get(f"I{n}").value for n in range(5)]
    client.clock.advance(100 * PERIOD)
    counts = [client.get(f"I{n}").value - begun for n, begun in enumerate(before)]
    assert counts == sorted(counts)
    assert 0 < counts[0] * 3 < counts[4]
    client.call("Task_Execute", tasks[4], "SetThreadPriority", None)
    assert client.call("Task_Execute", tasks[4], "GetThreadPriority", None).value == 0
    for wrong in (3, -3):
        assert client.code("Task_Execute", tasks[0], "SetThreadPriority", wrong) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.guide("5.3.3 task @START", "5.3.3 task @STOP", "5.3.3 task @STATUS")
@pytest.mark.field("3.1")
def test_a_task_is_started_and_stopped_by_variables(client):
    task = client.program("Pro", FOREVER.format("I1"))

    def put(name, value):
        return client.code("Variable_PutValue", client.value("Task_GetVariable", task, name, ""), value)

    assert get(client, task, "@STATUS") == Variant(I4, READY)
    assert put("@START", Variant(I4, 2)) == 0
    assert get(client, task, "@STATUS") == Variant(I4, RUNNING)
    client.clock.advance(0.1)
    assert put("@STOP", Variant(I4, 1)) == 0
    assert get(client, task, "@STATUS") == Variant(I4, SUSPENDED)
    assert put("@START", 9) == hresult.E_INVALIDARG
    assert put("@STATUS", 1) == hresult.E_CAO_NOT_WRITABLE
    for name in ("@START", "@STOP", "@PRIORITY"):
        assert client.code("Variable_GetValue", client.value("Task_GetVariable", task, name, "")) == hresult.E_NOTIMPL


@pytest.mark.field("3.1")
def test_details_of_the_status(client):
    task = start(client, "Pro", "Sub Main\n  Delay 100\n  Wait IO[128] = On\n  I1 = 1\nEnd Sub\n", 1)
    client.clock.advance(0.05)
    assert get(client, task, "@STATUS_DETAILS") == Variant(I4, 7)
    client.clock.advance(0.2)
    assert get(client, task, "@STATUS_DETAILS") == Variant(I4, 6)
    client.put("IO128", True)
    client.clock.advance(0.1)
    assert get(client, task, "@STATUS_DETAILS") == Variant(I4, READY)


@pytest.mark.guide("5.3.3 task @PRIORITY")
def test_the_variable_priority_is_not_supported(client):
    task = client.program("Pro", FOREVER.format("I1"))
    handle = client.value("Task_GetVariable", task, "@PRIORITY", "")
    assert client.code("Variable_GetValue", handle) == hresult.E_NOTIMPL
    assert client.code("Variable_PutValue", handle, 1) == hresult.E_CAO_NOT_WRITABLE


@pytest.mark.guide("5.3.3 task @LINE_NO")
def test_line_and_file(client):
    task = start(client, "Pro", "Sub Main\n  I1 = 1\n  Delay 500\nEnd Sub\n", 1)
    client.clock.advance(0.1)
    file = client.value("Controller_GetFile", client.controller, "Pro.pcs", "")
    number = client.value("File_GetID", file)
    assert get(client, task, "@LINE_NO") == Variant(I4 | ARRAY, [3, number])
    other = client.program("Other", FOREVER.format("I1"))
    assert get(client, other, "@LINE_NO").value[1] != number


def test_with_strict_the_line_is_alone():
    client = GuideClient(strict=True)
    task = client.program("Pro", "Sub Main\nEnd Sub\n")
    assert get(client, task, "@LINE_NO") == Variant(I4, 0)
    client.close()


@pytest.mark.guide("5.3.3 task @CYCLE_TIME", "5.3.3 task @ELAPSED_TIME")
def test_times_of_a_task(client):
    task = start(client, "Pro", "Sub Main\n  Delay 200\nEnd Sub\n", 1)
    client.clock.advance(0.1)
    elapsed = get(client, task, "@ELAPSED_TIME")
    assert elapsed.type == I4
    assert 90 <= elapsed.value <= 110
    client.clock.advance(0.2)
    cycle = get(client, task, "@CYCLE_TIME")
    assert cycle.type == I4
    assert 200 <= cycle.value <= 220


STEPS = """Sub Main
  Takearm
  I1 = 1
  Move P, J(20, 45, 90, 0, 45, 0), Speed = 50
  I1 = 2
  Move P, J(40, 45, 90, 0, 45, 0), Speed = 50
  Call Other
  Givearm
End Sub
Sub Other
  I2 = I2 + 1
End Sub
"""


@pytest.mark.guide("5.2.31 Start", "5.2.32 Stop", "5.2.33.1 GetStatus")
def test_steps_forward_and_backward(client):
    task = client.program("Pro", STEPS)

    def step(mode):
        client.call("Task_Start", task, mode, "")
        for _ in range(3000):
            client.clock.advance(PERIOD)
            if status(client, task) != RUNNING:
                break
        assert status(client, task) == STEP_STOPPED
        return get(client, task, "@LINE_NO").value[0], round(client.rc8.state.arm.queue.joints[0], 6)

    assert client.code("Task_Start", task, 4, "") == hresult.PROGRAM_NOT_RUNNING
    assert [step(3) for _ in range(6)] == [(3, 0), (4, 0), (5, 20), (6, 20), (7, 40), (11, 40)]
    assert [step(4) for _ in range(3)] == [(7, 40), (6, 20), (5, 20)]
    assert client.get("I1").value == 2  # variables keep their values
    assert step(4) == (4, 0)
    assert step(3) == (5, 20)
    client.call("Task_Stop", task, 4, "")
    assert client.code("Task_Start", task, 4, "") == hresult.PROGRAM_NOT_RUNNING
    assert status(client, task) == READY


def test_a_stop_ends_the_motion_of_a_step_backward(client):
    task = client.program("Pro", STEPS)
    for _ in range(3):
        client.call("Task_Start", task, 3, "")
        client.clock.advance(10)
    client.call("Task_Start", task, 4, "")
    client.clock.advance(0.2)
    assert client.rc8.state.arm.busy
    client.call("Task_Stop", task, 4, "")
    client.clock.advance(3)
    assert 0 < client.rc8.state.arm.queue.joints[0] < 20
    assert client.rc8.state.arm.holder is None


@pytest.mark.guide("5.2.29 AddVariable", "5.2.30 get_VariableNames", "5.2.4 AddTask", "5.2.9 get_TaskNames")
def test_names_of_tasks_and_of_their_variables(client):
    task = client.program("Pro", FOREVER.format("I1"))
    client.program(r"lib\Sub1", FOREVER.format("I1"))
    assert client.value("Controller_GetTaskNames", client.controller, "") == [r"lib\Sub1", "Pro"]
    names = client.value("Task_GetVariableNames", task, "")
    assert {"@STATUS", "@STATUS_DETAILS", "@START", "@STOP", "@LINE_NO", "@CYCLE_TIME", "@ELAPSED_TIME"} <= set(names)
    for name in names:
        assert client.value("Task_GetVariable", task, name.lower(), "") > 0
    assert client.code("Task_GetVariable", task, "@NOTHING", "") == hresult.E_CAO_OBJECT_NOTFOUND
    assert client.code("Controller_GetTask", client.controller, "Nobody", "") == hresult.E_CAO_OBJECT_NOTFOUND
