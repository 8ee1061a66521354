from __future__ import annotations

from datetime import datetime, timedelta

import pytest

from orinkit.values.variant import Variant, VarType

I4, BSTR, BOOL, DATE = VarType.I4, VarType.BSTR, VarType.BOOL, VarType.DATE

# name -> type, initial value, writable
TABLE = {
    "@MODE": (I4, 3, False),
    "@ERROR": (I4, 0, True),
    "@ERROR_CODE": (I4, 0, True),
    "@ERROR_CODE_HEX": (BSTR, "00000000", False),
    "@ERROR_DESCRIPTION": (BSTR, "Success", False),
    "@EMERGENCY_STOP": (BOOL, False, False),
    "@DEADMAN_SW": (BOOL, False, False),
    "@AUTO_ENABLE": (BOOL, True, False),
    "@PROTECTIVE_STOP": (BOOL, False, False),
    "@LOCK": (BOOL, False, True),
    "@BUSY_STATUS": (BOOL, False, False),
    "@NORMAL_STATUS": (BOOL, True, False),
    "@TSR_BUSY_STATUS": (BOOL, False, False),
    "@TIME": (I4, 0, False),
    "@CURRENT_TIME": (DATE, datetime(2024, 4, 1, 9), False),
    "@MAKER_NAME": (BSTR, "DENSO CORPORATION", False),
    "@TYPE": (BSTR, "RC8 Controller", False),
    "@VERSION": (BSTR, "9.8.7", False),
    "@SERIAL_NO": (BSTR, "SN-42", False),
    "@IO_ALLOC_MODE": (I4, 0, False),
    **{f"@VAR_{name}_LEN": (I4, 100, True) for name in "IFDVPJTS"},
    "@VAR_IO_LEN": (I4, 512, False),
}


@pytest.fixture
def value(controller):
    return lambda name: controller.get_variable(name, "").get_value().value


@pytest.mark.parametrize("name", TABLE)
def test_types_initial_values_and_attributes(name, controller, refused):
    vt, start, writable = TABLE[name]
    one = controller.get_variable(name.lower(), "")
    assert one.get_value() == Variant(vt, start)
    assert one.get_attribute() == (3 if writable else 1)
    assert one.get_help()
    if writable:
        one.put_value(Variant(vt, start))
    else:
        assert refused(one.put_value, Variant(vt, start)) == 0x8000020A


def test_the_table_is_complete(controller):
    assert {name for name in controller.get_variable_names("") if name.startswith("@")} == set(TABLE)


def test_values_are_live(rc8, value):
    rc8.set_mode(1)
    rc8.emergency_stop(True)
    rc8.raise_error(0x84201482)
    switches = rc8.state.switches
    switches.deadman = switches.protective_stop = True
    switches.auto_enable = False
    assert (value("@MODE"), value("@EMERGENCY_STOP"), value("@DEADMAN_SW")) == (1, True, True)
    assert (value("@AUTO_ENABLE"), value("@PROTECTIVE_STOP")) == (False, True)
    assert (value("@BUSY_STATUS"), value("@TSR_BUSY_STATUS"), value("@NORMAL_STATUS")) == (False, False, False)
    assert value("@ERROR_CODE") == 0x84201482 - 2**32
    assert value("@ERROR_CODE_HEX") == "84201482"
    assert value("@ERROR_DESCRIPTION").startswith("Late set-point")
    rc8.raise_error(0x83500121)
    assert value("@ERROR_CODE_HEX") == "83500121"


def test_writing_zero_clears_the_errors(rc8, controller, value, refused):
    code = controller.get_variable("@ERROR_CODE", "")
    rc8.raise_error(0x84201482)
    assert refused(code.put_value, Variant(I4, 1)) == 0x80070057
    assert refused(code.put_value, Variant(VarType.EMPTY)) == 0x80020005
    assert value("@NORMAL_STATUS") is False
    code.put_value(Variant(BSTR, "0"))
    assert (value("@ERROR_CODE"), value("@NORMAL_STATUS")) == (0, True)


def test_the_machine_lock(controller, value, refused):
    lock = controller.get_variable("@LOCK", "")
    for given, kept in [(Variant(BOOL, True), True), (Variant(I4, 0), False), (Variant(I4, -1), True)]:
        lock.put_value(given)
        assert value("@LOCK") is kept
    assert refused(lock.put_value, Variant(I4, 5)) == 0x8002000A
    assert value("@LOCK") is True


def test_milliseconds_since_power_on_wrap_at_32_bits(clock, value):
    clock.advance(1.2345)
    assert value("@TIME") == 1234
    clock.advance(2**31 / 1000 - 1.2345)
    assert value("@TIME") == -(2**31)
    clock.advance(2**31 / 1000)
    assert value("@TIME") == 0


def test_the_pendant_sets_the_time(clock, rc8, value, refused):
    rc8.pendant.set_time(datetime(2031, 5, 6, 7, 8, 9))
    clock.advance(60)
    assert value("@CURRENT_TIME") == datetime(2031, 5, 6, 7, 9, 9)
    for wrong in (datetime(1979, 12, 31), datetime(2100, 1, 1)):
        assert refused(rc8.pendant.set_time, wrong) == 0x80070057
    assert value("@CURRENT_TIME") == datetime(2031, 5, 6, 7, 9, 9)
    assert value("@TIME") == 60_000


def test_time_stamps_are_those_of_the_last_read(clock, controller):
    mode = controller.get_variable("@MODE", "")
    start = clock.wall()
    clock.advance(1)
    assert mode.get_date_time() == start + timedelta(seconds=1)
    mode.get_value()
    clock.advance(0.5)
    assert mode.get_date_time() == start + timedelta(seconds=1)
    assert mode.get_microsecond() == 0
    mode.get_value()
    assert (mode.get_date_time(), mode.get_microsecond()) == (start + timedelta(seconds=1.5), 500_000)
