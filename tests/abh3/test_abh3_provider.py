"""CaoProv.Waco.ABH3: b-CAP and e-CAP clients turn a virtual motor, over a bus inside this process."""

from __future__ import annotations

import itertools
import socket
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import orinkit
from orinkit.abh3.aio import AsyncDriver
from orinkit.abh3.provider.provider import ABH3Provider
from orinkit.abh3.provider.variables import entries_of
from orinkit.abh3.table.signals import V1, V2
from orinkit.can.server import serve_can
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError
from orinkit.device.discovery import load
from orinkit.values.variant import ARRAY, VarType
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from support.waiting import until

pytestmark = pytest.mark.usefixtures("no_errors_are_logged")
NAME = "CaoProv.Waco.ABH3"
FAST = Parameters(acceleration_time=0.05, deceleration_time=0.05)
_CHANNELS = itertools.count()


@pytest.fixture
def channel():
    return f"provider{next(_CHANNELS)}"


@pytest.fixture
def device(channel):
    device = VirtualABH3(FAST)
    with serve_can(device, VirtualABH3(Parameters(address=3, dialect="v2")), at=f"can://virtual/{channel}"):
        yield device


@pytest.fixture
def option(channel):
    return f"Interface=virtual, Channel={channel}, Address=1"


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Keep keep-alives from ending on a busy machine; the driver always replies here."""
    real = AsyncDriver.keep_alive

    async def keep_alive(driver, period, *, idle):
        await real(driver, period, patience=30.0, idle=idle)

    monkeypatch.setattr(AsyncDriver, "keep_alive", keep_alive)


@pytest.fixture
def provider():
    return load(NAME)


@pytest.fixture(params=["tcp", "http"])
def server(request, device, provider):
    with orinkit.serve(provider, f"{request.param}://127.0.0.1:0") as server:
        yield server


def allow_silence(provider, seconds):
    """Change the option Idle of all clients that are there: what came before did not depend on a short time."""
    for controller in list(provider._clients):
        controller._wanted = controller._wanted._replace(idle=seconds)
        heart = controller.motor._keep_alive_timer
        if heart is not None:
            heart.idle = seconds


def connect(server, option):
    return orinkit.connect(server.url, provider=NAME, option=option)


def turn(motor, ay=100.0, bx=50.0):
    motor.execute("ResetErrors")
    motor.variable("servo_on").value = True
    motor.variable("START").value = True
    motor.variable("COMMAND").value = [ay, bx]


def at_rest(device):
    state = device.state()
    return state.a_velocity == 0 and state.b_velocity == 0


def refused(code, call, *args):
    with pytest.raises(CallError) as caught:
        call(*args)
    assert caught.value.code == code
    return caught.value


def test_a_client_turns_the_motor_and_reads_its_pulses(server, device, option):
    with connect(server, option) as motor:
        turn(motor)
        until(lambda: motor.variable("FEEDBACK").value == [100.0, 50.0, 75.0, 25.0])
        first = motor.variable("A_PULSES").value
        until(lambda: motor.variable("A_PULSES").value > first + 20)
        assert motor.variable("B_PULSES").value < motor.variable("A_PULSES").value
        assert motor.variable("COMMAND").value == [100.0, 50.0]
        assert motor.variable("AY_COMMAND").value == 100.0
        assert motor.variable("INPUTS").value == 0x3003
        assert motor.variable("BX_START").value is True
        assert motor.variable("AY_VELOCITY").value == 100.0
        assert motor.variable("ERRORS").value == 0
        motor.variable("BX_COMMAND").value = "-50"  # as text, as clients may send numbers
        until(lambda: motor.variable("B_VELOCITY").value == -50.0)
        motor.execute("Stop")
        until(lambda: motor.variable("FEEDBACK").value == [0.0] * 4)
        assert motor.variable("SERVO_ON").value is True
        assert motor.variable("START").value is False
    until(lambda: at_rest(device))


def test_every_variable_has_its_type_and_help(server, option):
    with connect(server, option) as motor:
        items = entries_of(V1)
        assert motor.variable_names() == list(items)
        for name, item in items.items():
            variable = motor.variable(name.lower())
            exact = motor.client.request(orinkit.functions.variable_get_value, variable.handle, exact=True)
            assert exact[1].type == item.type, name
            assert variable.help == item.help
            assert variable.attribute == (3 if item.put else 1)
            assert variable.microsecond >= 0
            if not item.put:
                refused(hresult.E_CAO_NOT_WRITABLE, setattr, variable, "value", 1)


def test_dialect_2_has_other_variables(server, channel):
    with connect(server, f"Interface=virtual,Channel={channel},Address=3,Dialect=v2,LoadUnit=0.1") as motor:
        assert motor.variable_names() == list(entries_of(V2))
        turn(motor, 20.0, 20.0)
        assert motor.variable("INPUTS").value == 0x0303
        assert motor.variable("EXTERNAL").value >= 0
        assert len(motor.variable("FEEDBACK").value) == 3


def test_commands(server, option):
    with connect(server, option) as motor:
        assert motor.execute("init") == [0.0] * 4
        motor.execute("ResetErrors")
        assert motor.execute("SetInputs", [0x3003, 0x3003]) == [0.0] * 4
        assert motor.variable("INPUTS").value == 0x3003
        motor.execute("SetInput", ["Start", 0])
        motor.execute("SetInput", [0, 0])
        assert motor.variable("INPUTS").value == 0x1000
        assert motor.execute("Command", [1.0, 2.0])[0] == 0.0
        assert motor.execute("RequestBroadcast", 4) == [0.0, 0.0]
        assert motor.execute("RequestBroadcast", 0x2A)[0] == 1.0 or motor.execute("RequestBroadcast", 0x2A)[0] == 0.0
        assert motor.execute("RequestSingle") == [0.0] * 4
        assert motor.execute("ReadParameter", 0x4102) == 1
        motor.execute("WriteParameter", [0x4118, 2000])
        assert motor.execute("ReadParameter", 0x4118) == 2000
        assert motor.execute("ReadMonitor", 0x1004) == 24.0
        motor.execute("Release")
        assert motor.variable("COMMAND").value == [0.0, 0.0]
        assert motor.variable("INPUTS").value == 0
        error = refused(hresult.E_INVALID_CMD_NAME, motor.execute, "Fly")
        assert "Release" in motor.error_description(error.code)
        refused(hresult.E_INVALIDARG, motor.execute, "Command", [1.0])
        refused(hresult.E_INVALIDARG, motor.execute, "SetInput", ["wings", 1])
        for value in ("2", 2, float("nan"), 0.5):
            refused(hresult.E_INVALIDARG, motor.execute, "SetInput", ["start", value])
        motor.execute("SetInput", ["start", "0"])  # as text, as clients may send numbers
        refused(hresult.E_INVALIDARG, setattr, motor.variable("INPUTS"), "value", 1.5)
        refused(hresult.E_INVALIDARG, setattr, motor.variable("INPUTS"), "value", True)
        refused(hresult.E_INVALIDARG, setattr, motor.variable("SERVO_ON"), "value", 1e308)
        assert motor.variable("INPUTS").value == 0
        assert motor.execute("Command", ["1", "2"])[0] == 0.0
        refused(hresult.E_INVALIDARGTYPE, motor.execute, "WriteParameter", [0x4118, [1, 2]])
        refused(hresult.E_INVALIDARG, motor.execute, "RequestBroadcast", 999)
        refused(hresult.E_FAIL, motor.execute, "ReadParameter", 0x0001)


@pytest.mark.parametrize("value", [7000, -7000, float("nan"), float("inf"), "x", [1.0], None])
def test_an_invalid_value_sends_nothing(server, device, option, value):
    with connect(server, option) as motor:
        turn(motor, 20.0, 20.0)
        with pytest.raises(CallError):
            motor.variable("COMMAND").value = value
        with pytest.raises((CallError, orinkit.core.errors.InvalidValue)):
            motor.variable("AY_COMMAND").value = value if value != [1.0] else [1.0, 2.0]
        assert motor.variable("COMMAND").value == [20.0, 20.0]


def test_error_descriptions(server, option):
    with connect(server, option) as motor:
        error = refused(hresult.E_INVALIDARG, setattr, motor.variable("AY_COMMAND"), "value", 7000)
        assert "-6553.6 to 6553.4 min^-1" in motor.error_description(error.code)
        refused(hresult.E_CAO_OBJECT_NOTFOUND, motor.variable, "SPEED")


@pytest.mark.parametrize(
    ("option", "code", "text"),
    [
        ("", hresult.E_INVALIDARG, "the options do not select a CAN bus"),
        ("Interface=virtual,Channel={},Adress=3", hresult.E_INVALIDARG, "unknown option adress"),
        ("Interface=virtual,Channel={},Address=300", hresult.E_INVALIDARG, "0 to 253, not 300"),
        ("Interface=virtual,Channel={},Address=x", hresult.E_INVALIDARG, "is not a whole number"),
        ("Interface=virtual,Channel={},Timeout=soon", hresult.E_INVALIDARG, "is not a number"),
        ("Interface=virtual,Channel={},Idle=-1", hresult.E_INVALIDARG, "0 to 3600 s"),
        ("Interface=virtual,Channel={},KeepAlive=2", hresult.E_INVALIDARG, "0.01 to 0.4 s"),
        ("Interface=virtual,Channel={},KeepAlive=1e-9", hresult.E_INVALIDARG, "0.01 to 0.4 s"),
        (
            "Interface=virtual,Channel={},Bus=can://virtual/1",
            hresult.E_INVALIDARG,
            "or Bus=URL without these three options",
        ),
        ("Bitrate=500000", hresult.E_INVALIDARG, "the options do not select a CAN bus"),
        ("Interface=virtual,Channel=1,Bitrate=500000&port=7", hresult.E_INVALIDARG, "is not a whole number"),
        ("Interface=slcan,Channel=spy:///dev/ptmx?file=/tmp/x", hresult.E_INVALIDARG, "can only be set on the server"),
        ("Interface=serial,Channel=socket://127.0.0.1:5007", hresult.E_INVALIDARG, "can only be set on the server"),
        ("Bus=can://usb2can/1?dll=x.dll", hresult.E_INVALIDARG, "dll can only be set on the server"),
        ("Bus=can://udp_multicast/239.74.163.2?port=x", hresult.E_INVALIDARG, "port can only be set on the server"),
        ("Interface=virtual,Channel={},Dialect=v3", hresult.E_INVALIDARG, "available: v1, v2"),
        ("Interface=virtual,Channel={},LoadUnit=2", hresult.E_INVALIDARG, "1 or 0.1"),
        ("Interface=virtual,Channel={},Bitrate=7", hresult.E_INVALIDARG, "bitrate"),
        ("Interface=nothing,Channel=1", hresult.E_INVALIDARG, "no interface 'nothing'"),
        ("Bus=tcp://127.0.0.1:5007", hresult.E_INVALIDARG, "is not a CAN bus"),
        ("Interface=slcan,Channel=/dev/no-such-port", hresult.E_CAO_REMOTE_PROVIDER, "/dev/no-such-port"),
    ],
)
def test_invalid_options(server, channel, caplog, option, code, text):
    caplog.set_level("INFO", "orinkit.session")
    refused(code, connect, server, option.format(channel))
    assert text in caplog.text


def test_a_driver_that_does_not_reply(server, channel, caplog):
    caplog.set_level("INFO", "orinkit.session")
    refused(hresult.E_TIMEOUT, connect, server, f"Interface=virtual,Channel={channel},Address=9,Timeout=0.2")
    assert "no reply from ABH3 9 within 0.2 s" in caplog.text


def test_one_client_commands_and_others_read(server, device, option):
    with connect(server, f"{option}, Idle=0") as motor, connect(server, option) as other:
        turn(motor)
        until(lambda: other.variable("AY_VELOCITY").value == 100.0)
        error = refused(hresult.E_ACCESSDENIED, other.execute, "Init")
        assert "another client commands ABH3 1" in other.error_description(error.code)
        refused(hresult.E_ACCESSDENIED, setattr, other.variable("AY_COMMAND"), "value", 5)
        other.close()
        assert device.state().a_velocity == 100.0  # a reading client that disconnects does not stop it
        other = connect(server, option)
        other.execute("Release")  # it has nothing to release
        other.close()
        time.sleep(0.3)
        assert device.state().a_velocity == 100.0
        motor.execute("Release")
        until(lambda: at_rest(device))
        with connect(server, option) as third:
            turn(third, 10.0, 10.0)
            refused(hresult.E_ACCESSDENIED, motor.execute, "Command", [1.0, 1.0])


@pytest.mark.parametrize("keep_alive", ["", ",KeepAlive=0"])
def test_every_client_may_stop(server, device, option, keep_alive):
    with connect(server, f"{option},Idle=0{keep_alive}") as motor, connect(server, option) as other:
        turn(motor)
        until(lambda: device.state().a_velocity > 0)
        assert len(other.execute("Stop")) == 4
        until(lambda: at_rest(device))
        error = refused(hresult.E_ABORT, setattr, motor.variable("COMMAND"), "value", [50.0, 50.0])
        assert "another client called Stop" in motor.error_description(error.code)
        motor.variable("COMMAND").value = [50.0, 50.0]  # start is off
        time.sleep(0.2)
        assert at_rest(device)
        motor.execute("ResetErrors")
        turn(motor)
        until(lambda: device.state().a_velocity > 0)


def test_only_one_of_two_simultaneous_clients_commands(server, device, option):
    for _ in range(5):
        with connect(server, option) as one, connect(server, option) as other:
            done: list[object] = []

            def resets(motor, done=done):
                try:
                    done.append(motor.execute("ResetErrors"))
                except orinkit.CallError as error:
                    done.append(error.code)

            threads = [threading.Thread(target=resets, args=(each,)) for each in (one, other)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert sorted(map(str, done)) == sorted(map(str, [hresult.E_ACCESSDENIED, None]))


def test_clients_that_read_parameters_get_their_own(server, option):
    with connect(server, option) as one, connect(server, option) as other:
        found: list[tuple[int, object]] = []

        def reads(motor, address):
            found.extend((address, motor.execute("ReadParameter", [address])) for _ in range(40))

        threads = [
            threading.Thread(target=reads, args=each) for each in ((one, 0x4102), (other, 0x4117), (other, 0x4118))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert set(found) == {(0x4102, 1), (0x4117, 500), (0x4118, 1000)}


def test_an_idle_client_without_keep_alive_gets_an_error(server, provider, device, option):
    with connect(server, f"{option},KeepAlive=0,Idle=30") as motor:
        turn(motor)
        until(lambda: device.state().a_velocity > 0)
        brake = motor.variable("BRAKE_RELEASE")
        allow_silence(provider, 0.3)
        time.sleep(0.8)
        error = refused(hresult.E_ABORT, setattr, brake, "value", False)
        assert "made no call for 0.3 s" in motor.error_description(error.code)
        allow_silence(provider, 30)
        brake.value = False
        assert at_rest(device)


def test_an_idle_client_loses_the_motor(server, provider, device, option):
    with connect(server, f"{option}, Idle=30") as motor, connect(server, f"{option}, Idle=30") as other:
        turn(motor)
        until(lambda: device.state().a_velocity == 100.0)
        allow_silence(provider, 0.4)
        until(lambda: at_rest(device))
        error = refused(hresult.E_ABORT, setattr, motor.variable("COMMAND"), "value", [50.0, 50.0])
        assert "made no call for 0.4 s" in motor.error_description(error.code)
        allow_silence(provider, 30)
        assert motor.variable("COMMAND").value == [0.0, 0.0]
        turn(motor)  # once is enough
        until(lambda: device.state().a_velocity == 100.0)
        allow_silence(provider, 0.4)
        until(lambda: at_rest(device))
        allow_silence(provider, 30)
        until(lambda: _stops(other))
        turn(other, 5.0, 5.0)
        until(lambda: device.state().a_velocity == 5.0)
        motor.client.close()  # its command has ended, and is not sent again
        time.sleep(0.3)
        assert device.state().a_velocity == 5.0


@pytest.mark.parametrize("reading", ["INPUTS", "COMMAND", "MAIN_VOLTAGE", "parameter"])
def test_a_client_that_reads_is_not_idle(server, device, option, reading):
    with connect(server, f"{option}, Idle=1") as motor:
        turn(motor)
        until(lambda: device.state().a_velocity == 100.0)
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            motor.execute("ReadParameter", 0x4102) if reading == "parameter" else motor.variable(reading).value
            time.sleep(0.05)
        assert device.state().a_velocity == 100.0


@pytest.mark.parametrize(
    "spelled", ["Bus=can://virtual/{}", "Bus=can:virtual/{}", "Bus=CAN://virtual/{}", "Bus=can://virtual/%{}"]
)
def test_spellings_of_a_bus_share_one_right_to_command(server, option, channel, spelled):
    name = channel if "%" not in spelled else f"{ord(channel[0]):02x}{channel[1:]}"
    with connect(server, f"{option}, Idle=0") as motor, connect(server, spelled.format(name)) as other:
        turn(motor)
        refused(hresult.E_ACCESSDENIED, other.execute, "Command", [1.0, 1.0])


def test_a_provider_is_for_one_server(device, option):
    provider = ABH3Provider()
    with orinkit.serve(provider, "tcp://127.0.0.1:0") as first, orinkit.serve(provider, "tcp://127.0.0.1:0") as second:
        with connect(first, option) as motor:
            assert motor.execute("Init") == [0.0] * 4
        refused(hresult.E_FAIL, connect, second, option)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # python-can leaves its socket behind
def test_a_bus_that_does_not_open_blocks_no_other_client(device, option, monkeypatch):
    monkeypatch.setattr("orinkit.abh3.provider.buses.PATIENCE", 1.0)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        host, port = silent.getsockname()
        provider = load(NAME)
        monkeypatch.setattr("orinkit.abh3.provider.options._CLIENT_OPTIONS", ("host", "port"))
        monkeypatch.setattr("orinkit.abh3.provider.options.is_number", lambda _: True)
        with orinkit.serve(provider, "tcp://127.0.0.1:0") as server:
            wanted = f"Bus=can://socketcand/x?host={host}&port={port}"
            with ThreadPoolExecutor() as threads:
                hanging = threads.submit(connect, server, wanted)
                until(lambda: provider._buses._buses)  # its time has begun
                monkeypatch.setattr("orinkit.abh3.provider.buses.PATIENCE", 30.0)
                with connect(server, option) as motor:
                    assert motor.execute("Init") == [0.0] * 4
                assert isinstance(hanging.exception(), CallError)
    until(lambda: all(thread.name != "orinkit can opening" for thread in threading.enumerate()))


def _stops(client):
    try:
        client.execute("Stop")
    except CallError:
        return False
    return True


def test_the_motor_turns_while_the_client_makes_calls(server, device, option):
    with connect(server, f"{option}, Idle=1") as motor:
        turn(motor)
        until(lambda: device.state().a_velocity == 100.0)
        end = time.monotonic() + 2.5
        while time.monotonic() < end:
            assert motor.variable("AY_VELOCITY").value == 100.0
            time.sleep(0.1)


def test_without_keep_alive_the_driver_stops_by_itself(server, device, option):
    with connect(server, f"{option}, KeepAlive=0") as motor:
        turn(motor)
        until(lambda: device.state().a_velocity == 100.0)
        until(lambda: at_rest(device))
        assert motor.variable("WARNINGS").value == 1 << 22
        assert "CAN communication time-out" in motor.variable("ERROR_TEXTS").value


def test_a_killed_client_stops_the_motor(server, device, option, tmp_path):
    if server.url.startswith("http"):
        option += ", Idle=1"  # an HTTP client is connected only while it makes calls
    script = tmp_path / "client.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import time
            import orinkit
            motor = orinkit.connect({server.url!r}, provider={NAME!r}, option={option + ", Idle=0"!r})
            motor.execute("ResetErrors")
            motor.variable("SERVO_ON").value = True
            motor.variable("START").value = True
            motor.variable("COMMAND").value = [100.0, 100.0]
            print("turning", flush=True)
            time.sleep(60)
            """
            if server.url.startswith("tcp")
            else f"""
            import time
            import orinkit
            motor = orinkit.connect({server.url!r}, provider={NAME!r}, option={option!r})
            motor.execute("ResetErrors")
            motor.variable("SERVO_ON").value = True
            motor.variable("START").value = True
            while True:
                motor.variable("COMMAND").value = [100.0, 100.0]
                print("turning", flush=True)
                time.sleep(0.1)
            """
        )
    )
    client = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE)
    try:
        assert client.stdout is not None
        assert client.stdout.readline() == b"turning\n"
        until(lambda: device.state().a_velocity == 100.0)
        client.kill()
        until(lambda: at_rest(device))
    finally:
        client.kill()
        client.wait()
        client.stdout.close()
    with connect(server, option) as motor:
        turn(motor, 5.0, 5.0)


def test_the_server_stops_the_motor_when_it_stops(device, option):
    with orinkit.serve(load(NAME), "tcp://127.0.0.1:0") as server:
        motor = connect(server, f"{option}, Idle=0")
        turn(motor)
        until(lambda: device.state().a_velocity == 100.0)
    until(lambda: at_rest(device))
    motor.client.close()


def test_a_server_may_fix_the_bus(device, channel):
    provider = ABH3Provider(f"can://virtual/{channel}", address=1, timeout=5)
    with orinkit.serve(provider, "tcp://127.0.0.1:0") as server:
        with connect(server, "") as motor:
            assert motor.execute("Init") == [0.0] * 4
        with connect(server, f"Interface=virtual, Channel={channel}") as motor:  # the same bus
            assert motor.execute("Init") == [0.0] * 4
        refused(hresult.E_INVALIDARG, connect, server, f"Interface=virtual,Channel={channel}2")
        refused(hresult.E_INVALIDARG, connect, server, "Bitrate=500000")
        refused(hresult.E_INVALIDARG, connect, server, "Address=1,address=2")


def test_the_names_of_the_table_are_the_variables_and_texts_are_in_both_languages():
    for dialect in (V1, V2):
        items = entries_of(dialect)
        for layout in dialect.broadcasts.values():
            for field in layout.fields:
                assert items[field.name.upper()].put is None
        for name in dialect.inputs.masks:
            assert items[name.upper()].put is not None
        for item in items.values():
            english = item.help
            i18n.use("ja")
            assert "" != english != item.help
            i18n.use("en")
            assert item.count == 0 or item.type == VarType.R8 | ARRAY
    i18n.use("ja")
    assert entries_of(V1)["A_PULSES"].help == "A パルス積算値、pulse"
