"""Variables, names and files as the provider guide describes them (5.2.1 to 5.2.18, 5.3), with exact types."""

from __future__ import annotations

import zlib
from datetime import datetime

import pytest

from orinkit.cao.outcomes import CallReply
from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.variables.table import MOST_RESIZED
from support.guide_client import GuideClient

I1, I2, I4, R4, R8, BSTR, BOOL = (
    VarType.I1, VarType.I2, VarType.I4, VarType.R4, VarType.R8, VarType.BSTR, VarType.BOOL,
)  # fmt: skip
R4S, R8S = R4 | ARRAY, R8 | ARRAY


@pytest.fixture
def client():
    made = GuideClient()
    yield made
    made.close()


# --- user variables ---------------------------------------------------------------------------------------------------


@pytest.mark.guide(
    "5.3.1 I", "5.3.1 F", "5.3.1 D", "5.3.1 V", "5.3.1 P", "5.3.1 J", "5.3.1 T", "5.3.1 S", "5.3.1 IO", "5.3.1 IOB",
    "5.3.1 IOW", "5.3.1 IOD", "5.3.1 IOF", "5.2.34 Variable get_Value", "5.2.35 Variable put_Value",
)  # fmt: skip
@pytest.mark.parametrize(
    ("name", "vt", "value"),
    [
        ("I5", I4, -7),
        ("F5", R4, 0.5),
        ("D5", R8, 0.1),
        ("V5", R4S, [1, 2, 3]),
        ("P5", R4S, [1, 2, 3, 4, 5, 6, 5]),
        ("J5", R4S, [1, 2, 3, 4, 5, 6, 7, 8]),
        ("T5", R4S, [1, 2, 3, 0, 1, 0, 0, 0, 1, 5]),
        ("S5", BSTR, "text"),
        ("IO128", BOOL, True),
        ("IOB128", I1, -56),
        ("IOW128", I2, -2),
        ("IOD128", I4, -3),
        ("IOF128", R4, 1.5),
    ],
)
def test_types_of_user_variables(name, vt, value, client):
    handle = client.variable(name)
    assert client.code("Variable_PutValue", handle, Variant(vt, value)) == 0
    assert client.call("Variable_GetValue", handle) == Variant(vt, value)
    assert client.get(name.lower()) == Variant(vt, value)


def test_eight_points_as_a_byte(client):
    assert client.put("IOB128", Variant(I4, 200)) == 0  # as programs without a signed byte send it
    assert client.get("IOB128") == Variant(I1, -56)
    assert [client.get(f"IO{128 + bit}").value for bit in range(8)] == [False] * 3 + [True] + [False] * 2 + [True] * 2
    for wrong in (256, -129):
        assert client.put("IOB128", wrong) == hresult.DISP_E_OVERFLOW
    task = client.program("Pro", "Sub Main\n  I1 = IOB[128]\nEnd Sub\n")
    client.call("Task_Start", task, 1, "")
    client.clock.advance(0.1)
    assert client.get("I1").value == 200  # a program reads the bits of a number


@pytest.mark.guide("5.2.5 AddVariable names")
def test_forms_of_names(client):
    client.put("I12", 5)
    client.put("IO128", True)
    for name in ("I12", "i12", "I[12]", "i[12]", "I012"):
        assert client.get(name) == Variant(I4, 5), name
    assert client.get("io[128]") == Variant(BOOL, True)
    handles = {name: client.variable(name) for name in ("I*", "I[*]", "I*_1", "I*_22", "i[*]_3")}
    for number, handle in enumerate(handles.values()):
        client.put(f"I{number}", number)
        client.call("Variable_PutID", handle, number)
    for number, (name, handle) in enumerate(handles.items()):  # independent of each other
        assert client.call("Variable_GetValue", handle) == Variant(I4, number), name
    assert client.call("Variable_GetValue", client.variable("IO[*]")) == Variant(BOOL, False)
    for wrong in ("I[1", "I1]", "I[]", "I1_1", "I[1]_1", "I*_", "I*_x", "X1", "I"):
        assert client.code("Controller_GetVariable", client.controller, wrong, "") == hresult.E_CAO_OBJECT_NOTFOUND, (
            wrong
        )


# --- variables of the controller --------------------------------------------------------------------------------------


@pytest.mark.guide(
    "5.3.1 @VAR_I_LEN",
    "5.3.1 @VAR_F_LEN",
    "5.3.1 @VAR_D_LEN",
    "5.3.1 @VAR_V_LEN",
    "5.3.1 @VAR_J_LEN",
    "5.3.1 @VAR_P_LEN",
    "5.3.1 @VAR_T_LEN",
    "5.3.1 @VAR_S_LEN",
)
@pytest.mark.parametrize("name", ["I", "F", "D", "V", "J", "P", "T", "S"])
def test_the_number_of_variables_grows_and_shrinks(name, client):
    length = f"@VAR_{name}_LEN"
    assert client.get(length) == Variant(I4, 100)
    missing = ("Controller_GetVariable", client.controller, f"{name}150", "")
    assert client.code(*missing) == hresult.VARIABLE_INDEX_INVALID
    assert client.put(length, Variant(I4, 200)) == 0
    assert client.get(length) == Variant(I4, 200)
    default = client.get(f"{name}150")
    value = {"S": "x", "I": 5, "F": 5, "D": 5}.get(name) or [1] * len(default.value)
    handle = client.variable(f"{name}150")
    assert client.code("Variable_PutValue", handle, value) == 0
    assert client.put(length, 120) == 0
    assert client.code("Variable_GetValue", handle) == hresult.VARIABLE_INDEX_INVALID
    assert client.put(length, 200) == 0
    assert client.get(f"{name}150") == default  # deleted when the table became smaller
    for wrong in (-1, MOST_RESIZED + 1):
        assert client.put(length, wrong) == hresult.VALUE_OUT_OF_RANGE
    assert client.put(length, MOST_RESIZED) == 0
    assert client.get(f"{name}{MOST_RESIZED - 1}") == default


def test_a_changed_number_of_variables_is_kept(tmp_path):
    first = GuideClient(state=tmp_path)
    first.put("@VAR_I_LEN", 150)
    first.put("I149", 7)
    first.put("D99", 7)
    first.put("@VAR_D_LEN", 50)
    first.close()
    second = GuideClient(state=tmp_path)
    assert (second.get("@VAR_I_LEN").value, second.get("I149").value) == (150, 7)
    second.put("@VAR_D_LEN", 100)
    assert second.get("D99").value == 0
    second.close()
    third = GuideClient(VirtualRC8(clock=ManualClock(), counts={"I": 20}, state=tmp_path, samples=False))
    assert third.get("@VAR_I_LEN").value == 20  # a number that is given explicitly
    third.close()


@pytest.mark.parametrize(
    ("name", "vt", "value"),
    [
        pytest.param("@VAR_IO_LEN", I4, 512, marks=pytest.mark.guide("5.3.1 @VAR_IO_LEN")),
        pytest.param("@MODE", I4, 3, marks=pytest.mark.guide("5.3.1 @MODE")),
        pytest.param("@LOCK", BOOL, False, marks=pytest.mark.guide("5.3.1 @LOCK")),
        pytest.param("@TIME", I4, 1500, marks=pytest.mark.guide("5.3.1 @TIME")),
        pytest.param(
            "@CURRENT_TIME",
            VarType.DATE,
            datetime(2024, 4, 1, 9, 0, 1, 500_000),
            marks=pytest.mark.guide("5.3.1 @CURRENT_TIME"),
        ),
        pytest.param("@BUSY_STATUS", BOOL, False, marks=pytest.mark.guide("5.3.1 @BUSY_STATUS")),
        pytest.param("@TSR_BUSY_STATUS", BOOL, False, marks=pytest.mark.guide("5.3.1 @TSR_BUSY_STATUS")),
        pytest.param("@NORMAL_STATUS", BOOL, True, marks=pytest.mark.guide("5.3.1 @NORMAL_STATUS")),
        pytest.param("@ERROR_CODE", I4, 0, marks=pytest.mark.guide("5.3.1 @ERROR_CODE")),
        pytest.param("@ERROR_CODE_HEX", BSTR, "00000000", marks=pytest.mark.guide("5.3.1 @ERROR_CODE_HEX")),
        pytest.param("@ERROR_DESCRIPTION", BSTR, "Success", marks=pytest.mark.guide("5.3.1 @ERROR_DESCRIPTION")),
        pytest.param("@EMERGENCY_STOP", BOOL, False, marks=pytest.mark.guide("5.3.1 @EMERGENCY_STOP")),
        pytest.param("@DEADMAN_SW", BOOL, False, marks=pytest.mark.guide("5.3.1 @DEADMAN_SW")),
        pytest.param("@AUTO_ENABLE", BOOL, True, marks=pytest.mark.guide("5.3.1 @AUTO_ENABLE")),
        pytest.param("@MAKER_NAME", BSTR, "DENSO CORPORATION", marks=pytest.mark.guide("5.3.1 @MAKER_NAME")),
        pytest.param("@TYPE", BSTR, "RC8 Controller", marks=pytest.mark.guide("5.3.1 @TYPE")),
        pytest.param("@VERSION", BSTR, "2.6.0", marks=pytest.mark.guide("5.3.1 @VERSION")),
        pytest.param("@SERIAL_NO", BSTR, "VIRTUAL-0001", marks=pytest.mark.guide("5.3.1 @SERIAL_NO")),
        pytest.param("@PROTECTIVE_STOP", BOOL, False, marks=pytest.mark.guide("5.3.1 @PROTECTIVE_STOP")),
    ],
)
def test_variables_of_the_controller(name, vt, value, client):
    client.clock.advance(1.5)
    found = client.get(name)
    assert found.type == vt
    assert found.plain == value
    if name not in ("@LOCK", "@ERROR_CODE"):
        assert client.put(name, found) == hresult.E_CAO_NOT_WRITABLE


def test_variables_follow_the_state_of_the_controller(client):
    client.rc8.raise_error(0x83204071)
    client.rc8.set_mode(1)
    client.rc8.emergency_stop(True)
    client.rc8.state.protective_stop(True)
    client.rc8.pendant.deadman(True)
    names = (
        "@MODE",
        "@NORMAL_STATUS",
        "@ERROR_CODE",
        "@ERROR_CODE_HEX",
        "@EMERGENCY_STOP",
        "@DEADMAN_SW",
        "@PROTECTIVE_STOP",
    )
    assert [client.get(name).value for name in names] == [1, False, 0x83204071 - 2**32, "83204071", True, True, True]
    assert client.get("@ERROR_DESCRIPTION").value == hresult.lookup(0x83204071).en
    assert client.put("@ERROR_CODE", Variant(I4, 0)) == 0
    assert client.get("@NORMAL_STATUS").value is True


@pytest.mark.field("3.1")
def test_the_variable_error(client):
    client.rc8.raise_error(0x83204071)
    assert client.get("@ERROR") == Variant(I4, 0x83204071 - 2**32)
    assert client.put("@ERROR", Variant(I4, 0)) == 0
    assert client.get("@ERROR") == Variant(I4, 0)


def test_the_pendant_sets_the_time(client):
    client.rc8.pendant.set_time(datetime(2030, 1, 2, 3, 4, 5))
    assert client.get("@CURRENT_TIME").plain == datetime(2030, 1, 2, 3, 4, 5)


# --- variables of the robot -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "vt", "length"),
    [
        pytest.param("@CURRENT_POSITION", R8S, 7, marks=pytest.mark.guide("5.3.2 robot @CURRENT_POSITION")),
        pytest.param("@CURRENT_ANGLE", R8S, 8, marks=pytest.mark.guide("5.3.2 robot @CURRENT_ANGLE")),
        pytest.param("@CURRENT_TRANS", R8S, 10, marks=pytest.mark.guide("5.3.2 robot @CURRENT_TRANS")),
        pytest.param("@HIGH_CURRENT_POSITION", R8S, 7, marks=pytest.mark.guide("5.3.2 robot @HIGH_CURRENT_POSITION")),
        pytest.param("@HIGH_CURRENT_ANGLE", R8S, 8, marks=pytest.mark.guide("5.3.2 robot @HIGH_CURRENT_ANGLE")),
        pytest.param("@HIGH_CURRENT_TRANS", R8S, 10, marks=pytest.mark.guide("5.3.2 robot @HIGH_CURRENT_TRANS")),
        pytest.param("@DEST_POSITION", R8S, 7, marks=pytest.mark.guide("5.3.2 robot @DEST_POSITION")),
        pytest.param("@DEST_ANGLE", R8S, 8, marks=pytest.mark.guide("5.3.2 robot @DEST_ANGLE")),
        pytest.param("@DEST_TRANS", R8S, 10, marks=pytest.mark.guide("5.3.2 robot @DEST_TRANS")),
        pytest.param("@BUSY_STATUS", BOOL, 0, marks=pytest.mark.guide("5.3.2 robot @BUSY_STATUS")),
        pytest.param("@TYPE_NAME", BSTR, 0, marks=pytest.mark.guide("5.3.2 robot @TYPE_NAME")),
        pytest.param("@TYPE", I4, 0, marks=pytest.mark.guide("5.3.2 robot @TYPE")),
    ],
)
def test_variables_of_the_robot_that_are_read_only(name, vt, length, client):
    found = client.robot_get(name)
    assert found.type == vt
    assert not length or len(found.value) == length
    assert client.robot_put(name, found) == hresult.E_CAO_NOT_WRITABLE


def test_positions_during_a_motion(client):
    client.take()
    client.code("Robot_Move", client.robot, 1, "J(30, 45, 90, 0, 45, 0)", "NEXT")
    client.clock.advance(0.2)
    current, high, dest = (client.robot_get(f"@{name}_ANGLE").value[0] for name in ("CURRENT", "HIGH_CURRENT", "DEST"))
    assert 0 < current == high < dest == pytest.approx(30)
    assert client.robot_get("@BUSY_STATUS").value is True
    client.clock.advance(10)
    assert client.robot_get("@CURRENT_ANGLE").value[0] == pytest.approx(30)
    assert client.robot_get("@BUSY_STATUS").value is False


@pytest.mark.guide("5.3.2 robot @SERVO_ON", "5.3.2 robot @CURRENT_TOOL", "5.3.2 robot @CURRENT_WORK")
def test_motor_tool_and_work(client):
    assert client.robot_get("@SERVO_ON") == Variant(BOOL, True)
    assert client.robot_put("@SERVO_ON", Variant(BOOL, False)) == 0
    assert client.robot_get("@SERVO_ON") == Variant(BOOL, False)
    client.take()
    for name in ("@CURRENT_TOOL", "@CURRENT_WORK"):
        assert client.robot_get(name) == Variant(I4, 0)
        assert client.robot_put(name, Variant(I4, 1)) == 0
        assert client.robot_get(name) == Variant(I4, 1)


SPEEDS = ("@SPEED", "@ACCEL", "@DECEL", "@JSPEED", "@JACCEL", "@JDECEL")


@pytest.mark.guide(
    "5.3.2 robot @SPEED",
    "5.3.2 robot @ACCEL",
    "5.3.2 robot @DECEL",
    "5.3.2 robot @JSPEED",
    "5.3.2 robot @JACCEL",
    "5.3.2 robot @JDECEL",
)
@pytest.mark.parametrize(("name", "changes"), [
    ("@SPEED", ("@SPEED", "@JSPEED")), ("@JSPEED", ("@JSPEED",)), ("@ACCEL", ("@ACCEL", "@JACCEL")), ("@JACCEL", ("@JACCEL",)),
    ("@DECEL", ("@DECEL", "@JDECEL")), ("@JDECEL", ("@JDECEL",)),
])  # fmt: skip
def test_internal_speeds(name, changes, client):
    assert client.robot_put(name, Variant(R4, 50)) == hresult.ARM_NOT_TAKEN
    client.take()
    assert client.robot_put(name, Variant(R4, 50)) == 0
    assert {each: client.robot_get(each) for each in SPEEDS} == {
        each: Variant(R4, 50.0 if each in changes else 100.0) for each in SPEEDS
    }
    assert client.robot_put(name, 101) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.guide("5.3.2 robot @EXTSPEED", "5.3.2 robot @EXTACCEL", "5.3.2 robot @EXTDECEL")
def test_external_speeds(client):
    names = ("@EXTSPEED", "@EXTACCEL", "@EXTDECEL")
    assert client.robot_put("@EXTSPEED", Variant(R4, 50)) == 0
    assert [client.robot_get(name) for name in names] == [Variant(R4, 50.0), Variant(R4, 25.0), Variant(R4, 25.0)]
    assert client.robot_put("@EXTACCEL", Variant(R4, 40)) == 0
    assert client.robot_put("@EXTDECEL", Variant(R4, 30)) == 0
    assert [client.robot_get(name).value for name in names] == [50, 40, 30]
    assert client.robot_put("@EXTACCEL", 0) == hresult.VALUE_OUT_OF_RANGE


@pytest.mark.guide("5.3.2 robot Tool*", "5.3.2 robot Work*")
@pytest.mark.field("3.1")
def test_tool_and_work_frames(client):
    tool, work = [0, 0, 100, 0, 0, 45], [300, 0, 50, 0, 0, 90, 1]
    assert client.robot_get("Tool1") == Variant(R8S, [0] * 6)
    assert client.robot_get("WORK1") == Variant(R8S, [0] * 7)
    assert client.robot_put("Tool1", tool) == hresult.ARM_NOT_TAKEN
    client.take()
    assert client.robot_put("TOOL1", Variant(R8S, tool)) == 0
    assert client.robot_put("Work2", Variant(R8S, work)) == 0
    assert client.robot_get("tool1") == client.get("TOOL1") == Variant(R8S, tool)
    assert client.robot_get("work2") == client.get("WORK2") == Variant(R8S, work)
    assert list(client.robot_execute("GetToolDef", 1).value)[:6] == tool
    client.code("Robot_Change", client.robot, "Tool1")
    assert client.robot_put("Tool0", tool) == hresult.TOOL_NUMBER_OUT_OF_RANGE
    assert client.robot_put("Tool2", [1, 2]) == hresult.E_INVALIDARG
    assert client.robot_put("Work2", [0, 0, 0, 0, 0, 0, 2]) == hresult.VALUE_OUT_OF_RANGE
    handle = client.value("Robot_GetVariable", client.robot, "Work99", "")
    assert client.code("Variable_GetValue", handle) == hresult.WORK_NUMBER_OUT_OF_RANGE


@pytest.mark.guide("5.2.20 AddVariable", "5.2.21 get_VariableNames", "5.2.10 get_VariableNames")
def test_names_of_variables(client):
    names = client.call("Robot_GetVariableNames", client.robot, "")
    assert names.type == BSTR | ARRAY
    for name in names.value:
        assert client.value("Robot_GetVariable", client.robot, name.replace("*", "1"), "") > 0
    assert client.code("Robot_GetVariable", client.robot, "I1", "") == hresult.E_CAO_OBJECT_NOTFOUND
    names = client.call("Controller_GetVariableNames", client.controller, "")
    assert names.type == BSTR | ARRAY
    for name in names.value:
        assert client.value("Controller_GetVariable", client.controller, name, "") > 0


# --- connecting -------------------------------------------------------------------------------------------------------


@pytest.mark.guide("5.2.1 options, @IfNotMember, empty name", "5.2.3 AddRobot", "5.2.7 get_Name")
def test_objects_and_their_names(client):
    assert client.value("Controller_GetName", client.controller) != ""
    for option in ("Server=192.168.0.1,Timeout=3000,Interval=100,InvokeTimeout=180000", "WPJ=*", ""):
        again = client.value("Controller_Connect", "", "CaoProv.DENSO.VRC", "localhost", option)
        assert again != client.controller
    named = client.value("Controller_Connect", "Cell", "CaoProv.DENSO.VRC", "localhost", "")
    assert client.value("Controller_GetName", named) == "Cell"
    twice = ("Controller_Connect", "Cell", "CaoProv.DENSO.VRC", "localhost")
    assert client.code(*twice, "") == hresult.E_CAO_COLLECTION_REGISTERED
    assert client.value(*twice, "@IfNotMember") == named
    robot = client.value("Controller_GetRobot", named, "MyArm", "ID=0")
    assert client.value("Robot_GetName", robot) == "MyArm"
    assert client.value("Controller_GetRobot", named, "MyArm", "@IfNotMember") == robot


# --- files ------------------------------------------------------------------------------------------------------------


def file(client, name, option=""):
    return client.value("Controller_GetFile", client.controller, name, option)


@pytest.mark.guide("5.2.2 AddFile @Create")
def test_the_option_create(client):
    for name in ("a.pcs", "dir\\"):
        missing = ("Controller_GetFile", client.controller, name)
        assert client.code(*missing, "") == hresult.FILE_NOT_FOUND
        assert client.code(*missing, "@Create=0") == hresult.FILE_NOT_FOUND
        assert client.code(*missing, "@Create=2") == 0
        assert client.code(*missing, "@Create=2") == hresult.E_CAO_COLLECTION_REGISTERED
        assert client.code(*missing, "@Create=1,@IfNotMember") == 0
        assert client.code(*missing, "@Create=0,@IfNotMember") == 0
    assert client.code("Controller_GetFile", client.controller, "b.pcs", "@Create=1") == 0


@pytest.mark.guide("5.2.8 get_FileNames", "5.2.12 file AddFile", "5.2.15 file get_FileNames")
def test_folders(client):
    assert client.call("Controller_GetFileNames", client.controller, "").value == []
    folder = file(client, "dir\\", "@Create=1")
    inner = client.value("File_GetFile", folder, "a.pcs", "@Create=1")
    assert client.value("File_GetPath", inner) == r"dir\a.pcs"
    assert client.call("File_GetFileNames", folder, "") == Variant(BSTR | ARRAY, ["a.pcs"])
    assert client.call("Controller_GetFileNames", client.controller, "") == Variant(BSTR | ARRAY, ["dir\\"])
    assert client.value("File_GetFileNames", inner, "") == []


@pytest.mark.guide("5.2.16 file get_Size", "5.2.17 file get_Value", "5.2.18 file put_Value")
@pytest.mark.parametrize("name", ["a.pcs", "a.h", "panel.PNS"])
def test_contents_are_text(name, client):
    handle = file(client, name, "@Create=1")
    assert client.code("File_PutValue", handle, Variant(BSTR, "動作\r\n")) == 0
    assert client.call("File_GetValue", handle) == Variant(BSTR, "動作\r\n")
    assert client.call("File_GetSize", handle) == Variant(I4, 8)
    client.rc8.state.files.write(name, "動作".encode("cp932"))
    assert client.call("File_GetValue", handle) == Variant(BSTR, "動作")


@pytest.mark.guide("5.3.4 file @CRC")
@pytest.mark.parametrize("name", ["@CRC", "@crc", "CRC"])
def test_checksum_of_a_file(name, client):
    handle = file(client, "a.pcs", "@Create=1")
    crc = client.value("File_GetVariable", handle, name, "")
    assert client.call("Variable_GetValue", crc) == Variant(I4, 0)
    for text in ("Sub Main\nEnd Sub\n", "x"):
        client.call("File_PutValue", handle, text)
        expected = zlib.crc32(text.encode())
        assert client.call("Variable_GetValue", crc) == Variant(I4, expected - (expected >> 31 << 32))
    assert client.code("Variable_PutValue", crc, 1) == hresult.E_CAO_NOT_WRITABLE
    assert client.call("File_GetVariableNames", handle, "").value == ["@CRC"]
    assert client.code("File_GetVariable", handle, "@SIZE", "") == hresult.E_CAO_OBJECT_NOTFOUND


@pytest.mark.field("3.6")
def test_a_file_is_created_by_its_first_content():
    client = GuideClient(create_files=True)
    handle = file(client, r"new\job.pcs")
    assert client.code("File_GetValue", handle) == hresult.FILE_NOT_FOUND
    assert client.value("Controller_GetFileNames", client.controller, "") == []
    assert client.code("File_PutValue", handle, "Sub Main\nEnd Sub\n") == 0
    assert client.value("File_GetValue", handle) == "Sub Main\nEnd Sub\n"
    assert client.value("Controller_GetTaskNames", client.controller, "") == [r"new\job"]
    assert client.code("Controller_GetFile", client.controller, "dir\\", "") == hresult.FILE_NOT_FOUND
    client.close()


@pytest.mark.field("3.6")
def test_by_default_a_missing_file_is_refused(client):
    reply = client.begin("Controller_GetFile", client.controller, "new.pcs", "")
    assert isinstance(reply, CallReply)
    assert reply.code == hresult.FILE_NOT_FOUND
