"""Commands of the robot that calculate or read, as the provider guide describes them (5.2.27 to 5.2.28.43)."""

from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, Variant, VarType, variant
from support.guide_client import GuideClient

I4, R4, R8, BOOL = VarType.I4, VarType.R4, VarType.R8, VarType.BOOL
R8S = R8 | ARRAY
J = "J(10, 45, 90, 0, 45, 0)"


@pytest.fixture
def client():
    made = GuideClient()
    yield made
    made.close()


def poses(client):
    p, t = client.robot_execute("J2P", J).value, client.robot_execute("J2T", J).value
    return {"P": list(p), "T": list(t), "J": [10, 45, 90, 0, 45, 0, 0, 0]}


@pytest.mark.parametrize(
    ("command", "given", "wanted"),
    [
        pytest.param("J2T", "J", "T", marks=pytest.mark.guide("5.2.28.4 J2T")),
        pytest.param("T2J", "T", "J", marks=pytest.mark.guide("5.2.28.5 T2J")),
        pytest.param("J2P", "J", "P", marks=pytest.mark.guide("5.2.28.6 J2P")),
        pytest.param("P2J", "P", "J", marks=pytest.mark.guide("5.2.28.7 P2J")),
        pytest.param("T2P", "T", "P", marks=pytest.mark.guide("5.2.28.8 T2P")),
        pytest.param("P2T", "P", "T", marks=pytest.mark.guide("5.2.28.9 P2T")),
    ],
)
@pytest.mark.parametrize("form", ["text", "array", "index"])
def test_conversions(command, given, wanted, form, client):
    values = poses(client)
    argument = {
        "text": variant(f"{given}({', '.join(map(str, values[given]))})"),
        "array": variant([values[given], given]),
        "index": variant(f"{given}7"),
    }[form]
    client.put(f"{given}7", values[given])
    found = client.robot_execute(command, argument)
    assert found.type == R8S
    assert list(found.value) == pytest.approx(values[wanted], abs=1e-3)


@pytest.mark.parametrize(
    ("command", "moved"),
    [
        pytest.param("Dev", [100, 200, -50], marks=pytest.mark.guide("5.2.28.10 Dev")),
        pytest.param("DevH", None, marks=pytest.mark.guide("5.2.28.11 DevH")),
    ],
)
def test_offsets(command, moved, client):
    base = poses(client)["P"]
    found = client.robot_execute(command, variant([f"P({', '.join(map(str, base))})", "P(100, 200, -50, 0, 0, 0)"]))
    assert found.type == R8S
    assert len(found.value) == 7
    way = [after - before for after, before in zip(found.value, base, strict=True)][:3]
    assert sum(step * step for step in way) == pytest.approx(100**2 + 200**2 + 50**2)
    if moved is not None:
        assert way == pytest.approx(moved)
    assert found.value[6] == base[6]


@pytest.mark.guide("5.2.28.12 OutRange")
@pytest.mark.parametrize(
    ("parameter", "result"),
    [(J, 0), ([J, -1, -1], 0), ("J(300, 45, 90, 0, 45, 0)", 1), ("P(5000, 0, 0, 180, 0, 180, 5)", -1)],
)
def test_out_of_range(parameter, result, client):
    assert client.robot_execute("OutRange", variant(parameter)) == Variant(I4, result)


READINGS = [
    pytest.param("CurPos", 7, False, marks=pytest.mark.guide("5.2.28.16 CurPos")),
    pytest.param("DestPos", 7, False, marks=pytest.mark.guide("5.2.28.17 DestPos")),
    pytest.param("CurPosEx", 7, True, marks=pytest.mark.guide("5.2.28.18 CurPosEx")),
    pytest.param("HighCurPosEx", 7, True, marks=pytest.mark.guide("5.2.28.20 HighCurPosEx")),
    pytest.param("CurJnt", 8, False, marks=pytest.mark.guide("5.2.28.21 CurJnt")),
    pytest.param("DestJnt", 8, False, marks=pytest.mark.guide("5.2.28.22 DestJnt")),
    pytest.param("CurJntEx", 8, True, marks=pytest.mark.guide("5.2.28.23 CurJntEx")),
    pytest.param("HighCurJntEx", 8, True, marks=pytest.mark.guide("5.2.28.25 HighCurJntEx")),
    pytest.param("CurTrn", 10, False, marks=pytest.mark.guide("5.2.28.26 CurTrn")),
    pytest.param("DestTrn", 10, False, marks=pytest.mark.guide("5.2.28.27 DestTrn")),
    pytest.param("CurTrnEx", 10, True, marks=pytest.mark.guide("5.2.28.28 CurTrnEx")),
    pytest.param("HighCurTrnEx", 10, True, marks=pytest.mark.guide("5.2.28.30 HighCurTrnEx")),
]


@pytest.mark.parametrize(("command", "length", "stamped"), READINGS)
def test_where_the_arm_is(command, length, stamped, client):
    client.clock.advance(2.0)
    kind = {7: "POSITION", 8: "ANGLE", 10: "TRANS"}[length]
    found = client.robot_execute(command)
    assert found.type == R8S
    assert len(found.value) == length + stamped
    assert list(found.value)[stamped:] == list(client.robot_get(f"@CURRENT_{kind}").value)
    if stamped:
        assert found.value[0] == pytest.approx(2000, abs=8)
    client.take()
    client.code("Robot_Move", client.robot, 1, "J(30, 45, 90, 0, 45, 0)", "NEXT")
    client.clock.advance(0.2)
    during = client.robot_execute(command).value
    assert list(during) != list(found.value)
    client.clock.advance(10)
    after = client.robot_execute(command).value
    assert (list(during)[stamped:] == pytest.approx(list(after)[stamped:], abs=1e-3)) is command.startswith("Dest")


@pytest.mark.guide("5.2.28.31 CurFig")
def test_figure(client):
    found = client.robot_execute("CurFig")
    assert found == Variant(I4, int(client.robot_execute("CurPos").value[6]))


@pytest.mark.parametrize(
    ("command", "variable"),
    [
        pytest.param("CurSpd", "@SPEED", marks=pytest.mark.guide("5.2.28.32 CurSpd")),
        pytest.param("CurAcc", "@ACCEL", marks=pytest.mark.guide("5.2.28.33 CurAcc")),
        pytest.param("CurDec", "@DECEL", marks=pytest.mark.guide("5.2.28.34 CurDec")),
        pytest.param("CurJSpd", "@JSPEED", marks=pytest.mark.guide("5.2.28.35 CurJSpd")),
        pytest.param("CurJAcc", "@JACCEL", marks=pytest.mark.guide("5.2.28.36 CurJAcc")),
        pytest.param("CurJDec", "@JDECEL", marks=pytest.mark.guide("5.2.28.37 CurJDec")),
    ],
)
def test_internal_speeds_are_read(command, variable, client):
    client.take()
    assert client.robot_execute(command) == Variant(R4, 100.0)
    client.robot_put(variable, 40)
    assert client.robot_execute(command) == client.robot_execute(command, 0) == Variant(R4, 40.0)


@pytest.mark.guide("5.2.27 Speed")
@pytest.mark.parametrize(("axis", "speeds"), [(-1, (30, 30)), (0, (100, 30))])
def test_speed(axis, speeds, client):
    call = ("Robot_Speed", client.robot, Variant(I4, axis), Variant(R4, 30))
    assert client.code(*call) == hresult.ARM_NOT_TAKEN
    client.take()
    assert client.code(*call) == 0
    assert (client.robot_execute("CurSpd").value, client.robot_execute("CurJSpd").value) == speeds
    client.robot_execute("GiveArm")
    client.take()  # sets the speeds to 100 %
    assert (client.robot_execute("CurSpd").value, client.robot_execute("CurJSpd").value) == (100, 100)


@pytest.mark.guide("5.2.28.39 StopLog")
def test_stop_log(client):
    for command in ("ClearLog", "StartLog"):
        client.robot_execute(command)
    client.take()
    client.code("Robot_Move", client.robot, 1, J, "")
    assert client.robot_execute("StopLog").type == VarType.EMPTY
    count = client.robot_execute("GetLogCount").value
    assert count > 0
    client.code("Robot_Move", client.robot, 1, "J(0, 45, 90, 0, 45, 0)", "")
    assert client.robot_execute("GetLogCount").value == count


@pytest.mark.guide("5.2.28.41 Motor")
@pytest.mark.parametrize("no_wait", [None, 0, 1])
def test_motor(no_wait, client):
    def switch(on):
        parameter = on if no_wait is None else [on, no_wait]
        before = client.clock.now()
        assert client.robot_execute("Motor", variant(parameter)).type == VarType.EMPTY
        waited = client.clock.now() - before > 0.1
        client.clock.advance(2)
        return waited, client.robot_get("@SERVO_ON").value

    assert switch(0) == (not no_wait, False)
    assert switch(1) == (not no_wait, True)


@pytest.mark.guide("5.2.28.42 ExtSpeed")
@pytest.mark.parametrize(
    ("parameter", "speeds"),
    [
        ([50, 25, 30], (50, 25, 30)),
        (50, (50, 25, 25)),
        ([50], (50, 25, 25)),
        ([80, -2, -2], (80, 64, 64)),
        ([-1, 40], (100, 40, 100)),
        ([60, -1, -1], (60, 100, 100)),
    ],
)
def test_external_speed(parameter, speeds, client):
    assert client.robot_execute("ExtSpeed", variant(parameter)).type == VarType.EMPTY
    assert tuple(client.robot_get(name).value for name in ("@EXTSPEED", "@EXTACCEL", "@EXTDECEL")) == speeds


@pytest.mark.guide("5.2.28.43 TakeArm")
@pytest.mark.parametrize(
    ("parameter", "kept"), [(None, False), (0, False), ([0, 0], False), ([0, 1], True), ([31, 1], True)]
)
def test_take_arm(parameter, kept, client):
    client.take()
    client.code("Robot_Speed", client.robot, -1, Variant(R4, 30))
    client.robot_put("@CURRENT_TOOL", 1)
    client.robot_execute("GiveArm")
    assert client.robot_execute("TakeArm", variant(parameter)).type == VarType.EMPTY
    found = client.robot_execute("CurSpd").value, client.robot_execute("CurTool").value
    assert found == ((30, 1) if kept else (100, 0))
    other = GuideClient(client.rc8, "192.168.0.8")
    assert other.code("Robot_Execute", other.robot, "TakeArm", None) == hresult.ARM_NOT_TAKEN
