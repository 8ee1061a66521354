from __future__ import annotations

import json
from datetime import datetime

import pytest

import orinkit
from orinkit.cao.functions import BY_NAME
from orinkit.cao.provider import BlockingCall, ClientInfo, Deferred
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType, variant
from orinkit.virtual.rc8 import ModeSwitch, control
from orinkit.virtual.rc8.control import CONTROL_NAMES, PROVIDER_NAME, ControlPanel, ControlProvider
from orinkit.virtual.rc8.robot.motor import MotorState
from support.peers import RawClient
from support.waiting import PATIENCE, until

SECRET = "0123456789abcdef"
OPTION = f"Secret={SECRET}"


@pytest.fixture
def panel(rc8):
    """A client of the control port."""
    return ControlProvider(rc8, secret=SECRET).connect("panel", "localhost", OPTION, ClientInfo("127.0.0.1", "tcp"))


@pytest.fixture
def press(panel):
    return lambda command, parameter=None: panel.execute(command, variant(parameter))


@pytest.fixture
def status(press):
    return lambda: json.loads(press("Status"))


def switches(rc8):
    return rc8.state.switches


# --- the buttons ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameter", "mode"),
    [(1, ModeSwitch.MANUAL), (2, ModeSwitch.TEACH_CHECK), ("manual", ModeSwitch.MANUAL), ("TEACH", ModeSwitch.TEACH_CHECK), (["auto"], ModeSwitch.AUTOMATIC), ("3", ModeSwitch.AUTOMATIC)],
)  # fmt: skip
def test_mode(parameter, mode, press, rc8, status):
    rc8.set_mode(1 if mode is not ModeSwitch.MANUAL else 3)
    assert press("Mode", parameter) is None
    assert switches(rc8).mode is mode
    assert status()["mode"] == mode.name.lower()


@pytest.mark.parametrize(
    ("command", "name", "at_first"),
    [
        ("EmergencyStop", "emergency_stop", False),
        ("ProtectiveStop", "protective_stop", False),
        ("AutoEnable", "auto_enable", True),
        ("Deadman", "deadman", False),
        ("MachineLock", "machine_lock", False),
    ],
)
def test_switches(command, name, at_first, press, rc8, status):
    assert getattr(switches(rc8), name) is at_first
    for parameter, on in [
        (True, True),
        (0, False),
        ([1], True),
        ("0", False),
        (None, True),
        (-1, True),
        (False, False),
    ]:
        press(command, parameter)
        assert getattr(switches(rc8), name) is on
        assert status()[name] is on


def test_token(press, rc8, status):
    press("Token", "ethernet:192.168.0.7")
    assert str(switches(rc8).token) == status()["token"] == "ethernet:192.168.0.7"


def test_motor(press, clock, status, refused):
    assert press("Motor", 1) is None
    assert status()["motor"] == "switching on"
    clock.advance(2)
    assert status()["motor"] == "on"
    waiting = press("Motor", [0, 1])
    assert isinstance(waiting, Deferred)
    assert not waiting.done()
    clock.advance(1)
    assert waiting.done()
    assert status()["motor"] == "off"
    press("EmergencyStop")
    assert refused(press, "Motor", 1) == hresult.EMERGENCY_STOP_ON


def test_waiting_for_a_motor_that_is_cut(press, clock):
    waiting = press("Motor", [1, 1])
    clock.advance(0.5)
    press("EmergencyStop")
    assert waiting.done()
    with pytest.raises(CallError) as caught:
        waiting.result()
    assert caught.value.code == hresult.MOTOR_ON_FAILED


@pytest.fixture
def manual(press, rc8):
    """Establish all conditions for jogging."""
    press("Mode", "manual")
    press("Deadman")
    rc8.state.arm.motor.state = MotorState.ON


def test_jog(press, manual, clock, status):
    start = status()["joints"][0]
    assert press("Jog", [1, 5.5]) is None
    assert status()["moving"] is True
    clock.advance(3)
    assert status()["moving"] is False
    assert status()["joints"][0] == pytest.approx(start + 5.5, abs=1e-3)
    waiting = press("Jog", ["1", "-5.5", 1])
    assert not waiting.done()
    clock.advance(3)
    assert waiting.done()
    assert status()["joints"][0] == pytest.approx(start, abs=1e-3)


def test_jogging_ends_when_the_enable_switch_is_let_go(press, manual, clock, status):
    waiting = press("Jog", [1, 90, 1])
    clock.advance(1)
    press("Deadman", 0)
    clock.advance(1)
    with pytest.raises(CallError) as caught:
        waiting.result()
    assert caught.value.code == hresult.STOPPED_DURING_PC_MOTION
    assert 0 < status()["joints"][0] < 90


@pytest.mark.parametrize(
    ("parameter", "refusal"),
    [
        ([0, 1], hresult.E_INVALIDARG),
        ([7, 1], hresult.E_INVALIDARG),
        ([1.5, 1], hresult.E_INVALIDARG),
        ([1e300, 1], hresult.E_INVALIDARG),
        ([1], hresult.E_INVALIDARG),
        ([1, 2, 3, 4], hresult.E_INVALIDARG),
        ([1, float("nan")], hresult.E_INVALIDARG),
        ([1, 1e300], hresult.MANUAL_SOFT_LIMIT_AXIS1),
        ([2, -1000], hresult.MANUAL_SOFT_LIMIT_AXIS1 + 1),
        ([1, "far"], hresult.DISP_E_TYPEMISMATCH),
        (None, hresult.E_INVALIDARG),
    ],
)
def test_jogging_that_is_refused(parameter, refusal, press, manual, refused):
    assert refused(press, "Jog", parameter) == refusal


def test_jogging_in_automatic_mode(press, refused):
    assert refused(press, "Jog", [1, 5]) == hresult.REFUSED_IN_AUTO_MODE


@pytest.mark.parametrize(
    "parameter", ["MOTOR_NOT_ON", "motor_not_on", "0x81501003", "0X81501003", 0x81501003 - 2**32, Variant(VarType.UI4, 0x81501003)]
)  # fmt: skip
def test_errors(parameter, press, rc8, status):
    press("RaiseError", parameter)
    assert rc8.state.faults.code == hresult.MOTOR_NOT_ON
    assert status()["error"] == "81501003"
    press("ClearErrors")
    assert (rc8.state.faults.code, status()["error"]) == (0, "")


def test_the_message_of_an_error(press, rc8):
    press("RaiseError", ["MOTOR_NOT_ON", "my words"])
    assert rc8.state.faults.current.at(0).message == "my words"
    press("RaiseError", ["MOTOR_NOT_ON", "x" * 1_000_000])
    assert len(rc8.state.faults.current.at(0).message) == 500


def test_a_fatal_error_requires_a_restart(press, rc8, refused):
    press("RaiseError", "0x85000001")
    assert refused(press, "ClearErrors") == hresult.FATAL_ERROR_BEFORE
    press("Restart")
    assert rc8.state.faults.code == 0


def test_workpiece(press, rc8, status):
    press("Workpiece", 12.5)
    assert (rc8.state.hand.workpiece.width, rc8.state.hand.workpiece.inside) == (12.5, False)
    assert status()["hand"]["workpiece"] == 12.5
    press("Workpiece")
    assert status()["hand"]["workpiece"] is None
    rc8.state.hand.position = 5.0
    press("Workpiece", [12.5, True])
    assert rc8.state.hand.workpiece.inside


def test_workpieces_of_other_hands(press, rc8, refused):
    press("Workpiece", [12.5, False, "hand0"])
    press("Workpiece", [20, False, "2FG7"])
    hands = rc8.state.hands
    widths = [hand.workpiece and hand.workpiece.width for hand in (hands.cobotta, hands.grippers[0], hands.two_finger)]
    assert widths == [None, 12.5, 20]
    assert refused(press, "Workpiece", [12.5, False, "Hand1"]) == hresult.E_INVALIDARG


def test_time(press, rc8, status):
    press("Time", datetime(2030, 1, 2, 3, 4, 5))
    assert status()["time"].startswith("2030-01-02 03:04:0")


def test_status_is_json_of_plain_values(press, status):
    answer = press("Status", "ignored")
    assert isinstance(answer, str)
    assert set(status()) >= {
        "mode",
        "token",
        "emergency_stop",
        "motor",
        "moving",
        "error",
        "joints",
        "programs",
        "hand",
    }
    assert "NaN" not in answer


@pytest.mark.parametrize(
    ("command", "parameter", "refusal"),
    [
        ("Mode", 0, hresult.E_INVALIDARG),
        ("Mode", 4, hresult.E_INVALIDARG),
        ("Mode", "asleep", hresult.DISP_E_TYPEMISMATCH),
        ("Mode", None, hresult.E_INVALIDARG),
        ("Token", "me", hresult.E_INVALIDARG),
        ("Token", "x" * 1_000_000, hresult.E_INVALIDARG),
        ("Token", 1, hresult.DISP_E_TYPEMISMATCH),
        ("Token", None, hresult.E_INVALIDARG),
        ("EmergencyStop", "on", hresult.DISP_E_TYPEMISMATCH),
        ("EmergencyStop", 2, hresult.DISP_E_OVERFLOW),
        ("RaiseError", "NO_SUCH", hresult.E_INVALIDARG),
        ("RaiseError", "0x123456789", hresult.E_INVALIDARG),
        ("RaiseError", Variant(VarType.I8, 2**40), hresult.E_INVALIDARG),
        ("RaiseError", 1e300, hresult.E_INVALIDARG),
        ("RaiseError", None, hresult.E_INVALIDARG),
        ("RaiseError", ["MOTOR_NOT_ON", 5], hresult.DISP_E_TYPEMISMATCH),
        ("Workpiece", 31, hresult.E_INVALIDARG),
        ("Workpiece", "x", hresult.DISP_E_TYPEMISMATCH),
        ("ClearError", None, hresult.E_INVALID_CMD_NAME),
        ("", None, hresult.E_INVALID_CMD_NAME),
        ("x" * 1_000_000, None, hresult.E_INVALID_CMD_NAME),
    ],
)
def test_refused_buttons(command, parameter, refusal, press, refused):
    assert refused(press, command, parameter) == refusal


def test_the_message_of_the_pendant_is_the_detail(press):
    with pytest.raises(CallError, match="axis 7 does not exist; valid axes: 1 to 6"):
        press("Jog", [7, 1])


def test_the_machine_lock_requires_the_motor_off(press, rc8, refused):
    rc8.state.arm.motor.state = MotorState.ON
    assert refused(press, "MachineLock", 1) == hresult.MOTOR_IS_ON


# --- who may press them -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("address", ["127.0.0.1", "127.9.9.9", "::1", "::ffff:127.0.0.1", ""])
def test_clients_of_this_machine(address, rc8):
    panel = ControlProvider(rc8, secret=SECRET).connect("", "", OPTION, ClientInfo(address, "tcp"))
    assert panel.execute("Status", variant(None))


@pytest.mark.parametrize(
    "address", ["192.168.0.7", "0.0.0.0", "fd00::1", "::ffff:10.0.0.1", "/dev/ttyUSB0", "localhost.evil"]
)
def test_clients_of_other_machines(address, rc8, refused):
    client = ClientInfo(address, "tcp")
    assert refused(ControlProvider(rc8, secret=SECRET).connect, "", "", OPTION, client) == hresult.E_ACCESSDENIED


@pytest.mark.parametrize(
    "option", ["", "Secret=", "Secret", f"Secret={SECRET[:-1]}", f"Secret={SECRET}0", f"secret={SECRET.upper()}",
               f"Secret={SECRET},Secret={SECRET}", f"Token={SECRET}", "Secret=\ud800", "Secret=" + "x" * 4_000],
)  # fmt: skip
def test_clients_without_the_secret(option, rc8, refused):
    provider = ControlProvider(rc8, secret=SECRET)
    assert refused(provider.connect, "", "", option, ClientInfo("127.0.0.1", "tcp")) == hresult.E_ACCESSDENIED
    with pytest.raises(CallError, match=r"the secret is wrong|requires a secret") as caught:
        provider.connect("", "", option, ClientInfo("127.0.0.1", "tcp"))
    assert "Try: add Secret=... to the option" in str(caught.value)
    assert SECRET not in str(caught.value)


@pytest.mark.parametrize(
    "option", [OPTION, f",secret={SECRET}", f'SECRET="{SECRET}",@IfNotMember', f" Secret = {SECRET} "]
)
def test_forms_of_the_option(option, rc8):
    assert ControlProvider(rc8, secret=SECRET).connect("", "", option, ClientInfo("::1", "tcp"))


def test_the_secret_is_random_unless_one_is_given(rc8, refused):
    one, other = ControlProvider(rc8), ControlProvider(rc8)
    assert len(one.secret) >= 43  # 256 bits
    assert one.secret != other.secret
    assert one.connect("", "", f"Secret={one.secret}", ClientInfo("127.0.0.1", "tcp"))
    assert refused(other.connect, "", "", f"Secret={one.secret}", ClientInfo("127.0.0.1", "tcp"))
    with pytest.raises(orinkit.core.errors.InvalidValue, match="16 to 256"):
        ControlProvider(rc8, secret="short")


def test_wrong_secrets_are_delayed_and_logged_and_the_right_one_is_not(rc8, monkeypatch, caplog):
    slept = []
    monkeypatch.setattr(control.time, "sleep", slept.append)
    provider = ControlProvider(rc8, secret=SECRET)
    client = ClientInfo("127.0.0.1", "tcp")
    for _ in range(5):
        with pytest.raises(CallError):
            provider.connect("", "", "Secret=wrong", client)
    waiting = [provider.connect("", "", "Secret=wrong", client) for _ in range(8)]
    assert {type(each) for each in waiting} == {BlockingCall}
    assert isinstance(provider.connect("", "", OPTION, client), ControlPanel)
    with pytest.raises(CallError):  # the largest number of delayed replies
        provider.connect("", "", "Secret=wrong", client)
    assert slept == []
    for each in waiting:
        with pytest.raises(CallError, match="E_ACCESSDENIED"):
            each.run()
    assert slept == [0.125, 0.25, 0.5, 1, 1, 1, 1, 1]
    assert isinstance(provider.connect("", "", "Secret=wrong", client), BlockingCall)  # there is room again
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert told == ["control port: 5 clients with a wrong secret, or with none, were refused"]


def test_it_is_not_a_provider_of_the_controller(rc8, panel):
    session = Session(ProviderRegistry(ControlProvider(rc8, secret=SECRET)))
    names = [variant(part) for part in ("", "CaoProv.DENSO.VRC", "localhost", OPTION)]
    assert session.invoke(3, names).code == hresult.E_CAO_PROV_INVALID
    names[1] = variant(PROVIDER_NAME.upper())
    assert session.invoke(3, names).code == 0
    assert panel.get_command_names("") == [*CONTROL_NAMES, "GetErrorDescription"]


def test_over_the_wire(rc8):
    server = orinkit.serve(ControlProvider(rc8, secret=SECRET), "tcp://127.0.0.1:0")
    with server, orinkit.connect(server.url, provider=PROVIDER_NAME, option=OPTION) as panel:
        panel.execute("EmergencyStop", True)
        assert rc8.state.switches.emergency_stop
        assert json.loads(panel.execute("Status"))["emergency_stop"] is True
        with pytest.raises(orinkit.core.errors.InvalidArgument):
            panel.execute("Mode", 9)
        assert panel.command_names() == [*CONTROL_NAMES, "GetErrorDescription"]


def test_the_secret_over_the_wire(rc8):
    """Replies to wrong secrets are delayed, and the emergency stop of another client does not wait for them."""
    with orinkit.serve(ControlProvider(rc8, secret=SECRET), "tcp://127.0.0.1:0") as server:
        for _ in range(7):
            with pytest.raises(orinkit.core.errors.AccessDenied):
                orinkit.connect(server.url, provider=PROVIDER_NAME)
        with orinkit.connect(server.url, provider=PROVIDER_NAME, option=OPTION) as panel:
            panel.execute("EmergencyStop", True)
        assert rc8.state.switches.emergency_stop


def test_closing_the_control_port_leaves_the_controller_as_it_is(rc8, controller, clock):
    orinkit.serve(ControlProvider(rc8), "tcp://127.0.0.1:0").close()
    controller.execute("HandMoveA", variant([10, 100]))
    clock.advance(1)
    assert rc8.state.hand.position == 10.0


# --- lost clients -----------------------------------------------------------------------------------------------------


@pytest.fixture
def port(rc8):
    """The address of the control port; the motor is on in manual mode."""
    rc8.set_mode(1)
    rc8.state.arm.motor.state = MotorState.ON
    with orinkit.serve(ControlProvider(rc8, secret=SECRET), "tcp://127.0.0.1:0") as server:
        yield server.url


@pytest.fixture
def jogging(port, clock):
    """Connect a client that presses the enable switch and jogs."""

    def connect(*, presses: bool = True, jogs: bool = True) -> orinkit.Controller:
        client = orinkit.connect(port, provider=PROVIDER_NAME, option=OPTION, timeout=PATIENCE)
        if presses:
            client.execute("Deadman", True)
        if jogs:
            client.execute("Jog", [1, 90])
            clock.advance(1)
        return client

    return connect


def lose(client):
    """End the connection without Controller_Disconnect, as the system does for a killed program."""
    client.client.close()


def test_a_jog_stops_if_its_client_is_lost(jogging, rc8, clock):
    """The attack: a pendant program is killed while it jogs."""
    lose(jogging())
    until(lambda: not switches(rc8).deadman)
    clock.advance(2)
    assert 0 < rc8.pendant.status()["joints"][0] < 45
    assert not rc8.state.arm.motor.on


def test_a_jog_that_is_waited_for_stops_if_its_client_is_lost(port, rc8, clock):
    with RawClient(port) as client:
        handle = client.ask(BY_NAME["Controller_Connect"].id, "", PROVIDER_NAME, "", OPTION)
        execute = BY_NAME["Controller_Execute"].id
        client.ask(execute, handle, "Deadman", True)
        client.request(execute, handle, "Jog", [1, 90, 1])
        until(lambda: rc8.state.arm.busy)
        clock.advance(1)
    until(lambda: not switches(rc8).deadman)
    clock.advance(2)
    assert 0 < rc8.pendant.status()["joints"][0] < 45


def test_the_enable_switch_is_released_if_its_client_is_lost(jogging, rc8):
    client = jogging(jogs=False)
    assert switches(rc8).deadman
    lose(client)
    until(lambda: not switches(rc8).deadman)
    assert not rc8.state.arm.motor.on


def test_a_lost_jog_also_releases_the_switch_that_another_client_has_pressed(jogging, rc8, clock):
    """The sequence of the command line: each action is a client of its own."""
    jogging(jogs=False).close()
    assert switches(rc8).deadman
    lose(jogging(presses=False))
    until(lambda: not switches(rc8).deadman)
    clock.advance(2)
    assert 0 < rc8.pendant.status()["joints"][0] < 45


def test_a_client_that_disconnects_leaves_switch_and_jog_as_they_are(jogging, rc8, clock):
    jogging().close()
    clock.advance(20)
    assert rc8.pendant.status()["joints"][0] == pytest.approx(90)
    assert switches(rc8).deadman


def test_the_loss_of_another_client_changes_nothing(jogging, rc8, clock):
    other = jogging(presses=False, jogs=False)
    first = jogging(jogs=False)
    second = jogging()  # presses the switch again, and jogs
    lose(first)
    lose(other)
    second.execute("Status")
    clock.advance(20)
    assert rc8.pendant.status()["joints"][0] == pytest.approx(90)
    assert switches(rc8).deadman
    lose(second)
    until(lambda: not switches(rc8).deadman)


def test_a_silent_client_that_jogs_is_stopped(panel, press, manual, clock, status):
    """The limit on silence that a client sets itself (Alive) applies to the control port as well."""
    assert not panel.is_moving()
    press("Jog", [1, 90])
    clock.advance(1)
    assert panel.is_moving()
    panel.stop_moving()
    clock.advance(2)
    assert not panel.is_moving()
    assert 0 < status()["joints"][0] < 45
    assert status()["deadman"] is False
