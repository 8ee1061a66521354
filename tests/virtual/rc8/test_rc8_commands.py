from __future__ import annotations

from datetime import datetime, timedelta

import pytest

from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.rc8 import VirtualRC8

I4, BSTR = VarType.I4, VarType.BSTR
EMPTY = Variant(VarType.EMPTY)
UNDEFINED = hresult.CODES[hresult.UNDEFINED_ERROR].en
DELAY = 0x84201482


@pytest.fixture
def run(controller):
    return lambda command, parameter=None: controller.execute(command, variant(parameter))


@pytest.mark.parametrize("parameter", [EMPTY, Variant(I4, 0), Variant(BSTR, ""), Variant(I4 | ARRAY, [0]), variant([])])
@pytest.mark.parametrize("name", ["ClearError", "clearerror", " CLEARERROR "])
def test_clear_error(name, parameter, controller, rc8):
    rc8.raise_error(DELAY)
    rc8.raise_error(0x83500121)
    assert controller.execute(name, parameter) is None
    assert controller.execute("GetCurErrorCount", EMPTY) == 0
    assert controller.execute("GetErrorLogCount", EMPTY) == 2


@pytest.mark.parametrize("name", ["", "NoSuchCommand", "ClearError2", "TakeArm"])
def test_unknown_commands(name, controller, refused):
    assert refused(controller.execute, name, EMPTY) == 0x80000904


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (Variant(I4, DELAY - 2**32), hresult.lookup(DELAY).en),
        (Variant(VarType.UI4, DELAY), hresult.lookup(DELAY).en),
        (Variant(VarType.R8, float(DELAY)), hresult.lookup(DELAY).en),
        (Variant(BSTR, str(DELAY)), hresult.lookup(DELAY).en),
        (Variant(I4 | ARRAY, [DELAY - 2**32]), hresult.lookup(DELAY).en),
        (Variant(I4, 0), "Success"),
        (Variant(I4, 12345), UNDEFINED),
        (Variant(VarType.UI4, 0x83FF1234), UNDEFINED),
    ],
)
def test_error_descriptions(code, text, controller):
    assert controller.execute("GetErrorDescription", code) == text


@pytest.mark.parametrize(
    ("code", "refusal"),
    [
        (EMPTY, 0x80020005),
        (Variant(BSTR, "abc"), 0x80020005),
        (Variant(VarType.I8, 2**32), 0x80070057),
        (Variant(VarType.I8, -(2**31) - 1), 0x80070057),
        (Variant(VarType.R8, 0.5), 0x80070057),
    ],
)
def test_error_descriptions_of_invalid_codes(code, refusal, controller, refused):
    assert refused(controller.execute, "GetErrorDescription", code) == refusal


def test_current_errors_newest_first(rc8, run, refused):
    rc8.raise_error(DELAY - 2**32, subcode=7, program="Pro1", line=12, file_id=3)
    rc8.raise_error(0x83500121, "my own words")
    assert run("GetCurErrorCount") == 2
    assert run("GetCurErrorInfo", 0) == [0x83500121 - 2**32, "my own words", 0, 0, "", 0, 0]
    for index in (1, "1", [1], 1.0):
        info = run("GetCurErrorInfo", index)
        assert info == [DELAY - 2**32, hresult.lookup(DELAY).en, 7, 3 << 16 | 12, "Pro1", 12, 3]
    assert [element.type for element in variant(info).value] == [I4, BSTR, I4, I4, BSTR, I4, I4]
    for index in (2, -1):
        assert refused(run, "GetCurErrorInfo", index) == 0x8002000B
    assert refused(run, "GetCurErrorInfo", "x") == 0x80020005
    rc8.clear_errors()
    assert refused(run, "GetCurErrorInfo", 0) == 0x8002000B


def test_current_errors_and_the_log_are_bounded(rc8, run):
    for number in range(1005):
        rc8.raise_error(DELAY, str(number))
    assert (run("GetCurErrorCount"), run("GetErrorLogCount")) == (100, 1000)
    assert run("GetCurErrorInfo", 99)[1] == "905"
    assert run("GetErrorLog", 999)[12] == "5"


@pytest.mark.parametrize("code", [0x80201418, 0x0F200501, 0x803022EF])
def test_notices_are_only_logged(code, rc8, run):
    rc8.raise_error(code)
    assert (run("GetCurErrorCount"), run("GetErrorLogCount")) == (0, 1)
    assert run("GetErrorLog", 0)[0] == hresult.signed(code)


@pytest.mark.parametrize("code", [0x81501003, 0x8420FFFF, 0x80004005, 0x80000204, 0x80040201, 0x8A000000])
def test_other_codes_are_errors(code, rc8, run):
    rc8.raise_error(code)
    assert run("GetCurErrorInfo", 0)[1] == hresult.lookup(code).en


def test_codes_of_more_than_32_bits(rc8, run):
    for code in (2**32, -(2**31) - 1):
        with pytest.raises(ValueError, match="32 bits"):
            rc8.raise_error(code)
    assert run("GetErrorLogCount") == 0


def test_the_error_log(rc8, clock, run, refused):
    clock.advance(3661.0625)
    rc8.raise_error(DELAY, "late", program="Pro1", line=5, file_id=2, original=0x83500121)
    record = run("GetErrorLog", 0)
    assert record[:9] == [DELAY - 2**32, 2024, 4, 1, 1, 10, 1, 1, 62]
    assert record[9:] == [3661062, "Pro1", 5, "late", 0x83500121 - 2**32, 4]
    assert [e.type for e in variant(record).value] == [I4] * 10 + [BSTR, I4, BSTR, I4, I4]
    for index in (1, -1):
        assert refused(run, "GetErrorLog", index) == 0x8002000B


def test_a_week_begins_on_sunday(run):
    sunday = ManualClock(datetime(2024, 3, 31))
    device = VirtualRC8(clock=sunday)
    device.raise_error(DELAY)
    assert device.state.faults.log.at(0).as_logged()[3] == 0


def test_the_operation_log(rc8, connect, controller, run, clock, refused):
    clock.advance(1)
    rc8.raise_error(DELAY)
    run("ClearError")
    rc8.clear_errors()
    rc8.set_mode(1)
    rc8.emergency_stop(True)
    controller.get_variable("@LOCK", "").put_value(variant(True))
    controller.get_variable("@LOCK", "").put_value(variant(False))
    rc8.pendant.set_time(datetime(2030, 1, 2, 3, 4, 5))
    connect("second", address="10.0.0.9").release()
    records = [run("GetOprLog", index) for index in range(run("GetOprLogCount"))]
    assert [(r[0], r[9], r[10], r[11]) for r in reversed(records)] == [
        (1, 0, 3, "Client connected"),
        (3, 1000, 3, "Errors cleared"),
        (3, 1000, 1, "Errors cleared"),
        (4, 1000, 1, "Mode: manual"),
        (5, 1000, 1, "Emergency stop pressed"),
        (6, 1000, 3, "Machine lock on"),
        (6, 1000, 3, "Machine lock off"),
        (7, 1000, 1, "Time set to 2030-01-02 03:04:05"),
        (1, 1000, 3, "Client connected"),
        (2, 1000, 3, "Client disconnected"),
    ]
    assert records[-1][1:9] == [2024, 4, 1, 1, 9, 0, 0, 0]
    assert records[0][1:9] == [2030, 1, 3, 2, 3, 4, 5, 0]
    assert refused(run, "GetOprLog", len(records)) == 0x8002000B


def test_system_information(rc8, run, clock, refused):
    assert run("SysInfo", 0) == run("sysinfo", [0]) == Variant(BSTR, "SN-42")
    assert run("SysInfo", 15) == Variant(I4, 0)
    rc8.state.battery_due = clock.wall() - timedelta(days=1)
    assert run("SysInfo", 15) == Variant(I4, -1)
    for item in (-1, 17):
        assert refused(run, "SysInfo", item) == 0x80070057


def bits(number):
    return {bit for bit in range(32) if number >> bit & 1}


FOREVER = b"Sub Main\n  Do\n    I1 = I1 + 1\n  Loop\nEnd Sub\n"


def test_system_state_bits_are_live(rc8, run, clock):
    still = {3, 17, 24}
    assert bits(run("SysState")) == {4, 5, 11} | still
    rc8.pendant.token("tp")
    assert bits(run("SysState")) == {4, 11} | still
    rc8.set_mode(1)
    rc8.raise_error(DELAY)
    assert bits(run("SysState")) == {1, 11, 18} | still
    rc8.emergency_stop(True)
    rc8.clear_errors()
    rc8.set_mode(2)
    assert bits(run("SysState")) == {10, 11} | still
    rc8.pendant.protective_stop()
    rc8.state.switches.auto_enable = False
    clock.advance(731 * 86400)
    assert bits(run("SysState")) == {6, 10, 12} | still


def test_system_state_of_robot_and_programs(rc8, run, clock, controller):
    rc8.state.files.write("P.pcs", FOREVER)
    task, robot = controller.get_task("P", ""), controller.get_robot("", "")
    rc8.pendant.motor()
    assert 2 not in bits(run("SysState"))
    clock.advance(1.1)
    assert 2 in bits(run("SysState"))
    task.start(1, "")
    assert 0 in bits(run("SysState"))
    task.stop(4, "")
    robot.execute("TakeArm", variant([0, 0]))
    robot.move(1, variant("J(90, 45, 90, 0, 45, 0)"), "NEXT")
    clock.advance(0.1)
    assert bits(run("SysState")) & {13, 20, 21, 24} == {20, 21}
    robot.halt("")
    clock.advance(0.008)
    assert bits(run("SysState")) & {13, 20, 21, 24} == {13, 20, 21}
    clock.advance(1.0)
    assert bits(run("SysState")) & {0, 2, 13, 20, 21, 24} == {2, 24}


def test_the_safety_state(rc8, run):
    assert run("StoState") is False
    rc8.emergency_stop(True)
    assert run("StoState") is True
    rc8.emergency_stop(False)
    rc8.state.switches.protective_stop = True
    assert run("StoState") is True


def test_the_controller_object(controller, refused):
    assert (controller.get_name(), controller.get_attribute()) == ("ctrl", 3)
    assert controller.get_help() == "Virtual RC8 robot controller"
    controller.put_tag(variant(1))
    controller.put_id(variant("a"))
    assert (controller.get_tag(), controller.get_id()) == (variant(1), variant("a"))
    assert controller.get_robot_names("") == ["Arm0"]
    assert controller.get_task_names("") == ["Pro1", "Pro2", "Pro3"]
    assert controller.get_file_names("") == ["Pro1.pcs", "Pro2.pcs", "Pro3.pcs"]
    assert controller.get_robot("Arm", "ID=0").get_name() == "Arm"
    assert refused(controller.get_robot, "Arm", "ID=1") == 0x80000204


def test_provider_names():
    assert VirtualRC8().provider_names == ("CaoProv.DENSO.VRC", "CaoProv.DENSO.VRC9")
    assert "CaoProv.DENSO.RC8" in VirtualRC8(accept_pc_provider=True).provider_names


def test_calls_through_a_session(rc8):
    session = Session(ProviderRegistry(rc8))
    text = [variant(part) for part in ("b-CAP", "caoProv.denso.vrc", "192.168.0.1", "")]
    handle = session.invoke(3, text).result
    assert handle == Variant(I4, 2)
    variable = session.invoke(9, [handle, variant("IO150"), variant("")]).result
    assert session.invoke(102, [variable, variant(True)]).code == 0
    assert session.invoke(101, [variable]).result == Variant(VarType.BOOL, True)
    assert session.invoke(100, [variable]).result == variant(datetime(2024, 4, 1, 9))
    assert session.invoke(110, [variable]).result == Variant(I4, 0)
    assert session.invoke(17, [handle, variant("ClearError"), EMPTY]).result == EMPTY
    rc8.raise_error(DELAY)
    info = session.invoke(17, [handle, variant("GetCurErrorInfo"), variant(0)]).result
    assert [element.type for element in info.value] == [I4, BSTR, I4, I4, BSTR, I4, I4]
    message = session.invoke(18, [handle]).result
    assert message is not None
    assert session.invoke(134, [message]).code == 0
    assert session.invoke(18, [handle]).code == 0x80000204
    names = session.invoke(15, [handle, variant("")]).result
    assert names.type == BSTR | ARRAY
    assert session.invoke(4, [handle]).code == 0
    assert len(session) == 0


def test_the_default_clock_is_real_time():
    device = VirtualRC8()
    before = datetime.now()
    device.raise_error(DELAY)
    assert before <= device.state.faults.log.at(0).moment <= datetime.now()
