from __future__ import annotations

import pytest

from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8 import AccessRight, Permission, VirtualRC8

NO_READ, NO_WRITE = 0x80501043, 0x80501044
EMPTY = Variant(VarType.EMPTY)


@pytest.mark.parametrize(
    ("address", "access"),
    [
        ("192.168.0.7", AccessRight.READ),
        ("192.168.0.8", AccessRight.NONE),
        ("10.1.2.3", AccessRight.READ),
        ("10.9.0.1", AccessRight.READ_WRITE),
        ("::ffff:10.9.0.1", AccessRight.READ_WRITE),
        ("fd00::5", AccessRight.READ),
        ("172.16.0.1", AccessRight.NONE),
        ("/dev/ttyUSB0", AccessRight.NONE),
        ("", AccessRight.NONE),
    ],
)
def test_the_most_specific_entry_decides(address, access):
    rights = {"10.0.0.0/8": "r", "192.168.0.7": "r", "10.9.0.0/16": "rw", "fd00::/8": "R"}
    assert Permission("none", rights).of(address) is access


def test_by_default_everyone_may_read_and_write():
    assert Permission().of("1.2.3.4") is AccessRight.READ_WRITE


def test_permission_as_text():
    permission = Permission.parse(" 192.168.0.7 = r,10.0.0.0/8=rw , *=none")
    assert [permission.of(a) for a in ("192.168.0.7", "10.1.1.1", "8.8.8.8")] == [
        AccessRight.READ,
        AccessRight.READ_WRITE,
        AccessRight.NONE,
    ]


@pytest.mark.parametrize(
    ("text", "quoted"),
    [
        ("192.168.0.7", "192.168.0.7"),
        ("192.168.0.7=x", "'x'"),
        ("300.1.1.1=r", "300.1.1.1"),
        ("10.0.0.1/8=r", "10.0.0.1/8"),
        ("10.0.0.1=r,10.0.0.1=rw", "10.0.0.1"),
        ("10.0.0.1=r,10.0.0.1/32=rw", "10.0.0.1"),
        ("*=r,*=rw", "[*]"),
        ("", "''"),
        ("*=r,", "''"),
    ],
)
def test_permission_that_cannot_be_read(text, quoted):
    with pytest.raises(ValueError, match=quoted):
        Permission.parse(text)


def test_an_invalid_default():
    with pytest.raises(ValueError, match="write"):
        Permission("write")


def test_a_permission_is_a_permission_and_a_directory_has_a_name():
    with pytest.raises(TypeError, match=r"Permission\.parse"):
        VirtualRC8(permission="*=r")
    with pytest.raises(ValueError, match="is empty"):
        VirtualRC8(state="")


@pytest.fixture
def device():
    return VirtualRC8(permission=Permission.parse("10.0.0.1=r,10.0.0.2=none"))


def test_a_client_that_may_only_read(device, connect, refused):
    controller = connect(device=device, address="10.0.0.1")
    assert controller.get_attribute() == 1
    device.raise_error(0x84201482)
    i1 = controller.get_variable("I1", "")
    assert i1.get_attribute() == 1
    assert i1.get_value().value == 0
    for name, value in [("I1", 5), ("IO128", 1), ("@LOCK", 1), ("@ERROR_CODE", 0), ("@MODE", 1)]:
        assert refused(controller.get_variable(name, "").put_value, Variant(VarType.I4, value)) == NO_WRITE
    assert refused(controller.execute, "ClearError", EMPTY) == NO_WRITE
    assert controller.execute("GetCurErrorCount", EMPTY) == 1
    assert controller.get_message().get_number() == 1
    assert device.state.switches.machine_lock is False
    assert connect(device=device, address="10.0.0.3").get_variable("I1", "").get_value().value == 0


def test_a_client_that_may_nothing(device, connect, refused):
    controller = connect(device=device, address="10.0.0.2")
    device.raise_error(0x84201482)
    for name in ("I1", "I*", "@MODE"):
        one = controller.get_variable(name, "")
        assert one.get_attribute() == 0
        for call in (one.get_value, one.get_date_time, one.get_microsecond):
            assert refused(call) == NO_READ
        assert refused(one.put_value, Variant(VarType.I4, 1)) == NO_WRITE
    assert refused(controller.execute, "SysState", EMPTY) == NO_READ
    assert refused(controller.execute, "ClearError", EMPTY) == NO_WRITE
    assert refused(controller.get_message) == NO_READ
    assert refused(controller.execute, "NoSuchCommand", EMPTY) == 0x80000904
