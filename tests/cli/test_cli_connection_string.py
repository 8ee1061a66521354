"""Connection strings in place of a URL on the command line."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.cli.commands.gateway import _named, _settings
from orinkit.client._shared.connection_string import ConnectArguments
from orinkit.core.hresult import S_OK
from orinkit.gateway import RemoteProvider, Upstream
from orinkit.virtual.rc8 import VirtualRC8


@pytest.fixture
def place(rc8: VirtualRC8) -> Iterator[str]:
    """Host and port of a virtual RC8 on TCP."""
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        yield server.url.removeprefix("tcp://")


@pytest.fixture
def rc8() -> VirtualRC8:
    return VirtualRC8()


def test_get_put_info_and_call(run, place):
    text = f"Server={place}, Timeout=20000"
    assert run("put", text, "I1", "42").code == 0
    assert run("get", text, "I1").out == "42\n"
    assert text in run("info", text).out
    assert run("call", text, "Controller_GetName").out == "Controller1\n"
    assert int(run("call", text, "Controller_Connect").out) > 0


def test_over_udp(run, rc8):
    with orinkit.serve(rc8, "udp://127.0.0.1:0") as server:
        text = f"Server={server.url.removeprefix('udp://')}, UDP=True, Timeout=20000"
        assert run("get", text, "I1").out == "0\n"
        assert run("get", text.replace("UDP=True, ", ""), "I1").code == 1


def test_the_last_packet(run, place):
    done = run("get", f"Server={place}, Timeout=20000, Debug", "$LAST_RECEIVE_PACKET$")
    assert done.code == 0
    assert packet.decode(bytes(map(int, done.out.split()))).code == S_OK
    assert "E_CAO_OBJECT_NOTFOUND" in run("get", f"Server={place}", "$LAST_RECEIVE_PACKET$").err


def test_disabled_messages(refused, place):
    for function in ("Controller_GetMessage", "Message_GetNumber"):
        said = refused("call", f"Server={place}, Message=False", function)
        assert said.startswith("Controller_GetMessage was not sent: messages are disabled")


def test_the_provider_of_the_string(refused, run, place):
    assert "E_CAO_PROV" in refused("get", f"Server={place}, Provider=Frob", "I1")
    assert "E_CAO_PROV" in refused("call", f"Server={place}, Provider=Frob", "Controller_Connect")


@pytest.mark.parametrize("command", ["get", "move", "stream", "call", "info"])
def test_an_invalid_string(run, tmp_path, command):
    arguments = {"get": ["I1"], "move": ["J(0, 0, 90, 0, 90, 0)"], "stream": ["x.csv"], "call": ["17", "x"], "info": []}
    done = run(command, "Server=127.0.0.1, Frob=1", *arguments[command])
    assert done.code != 0
    assert "unknown option 'Frob=1'; known options: Server" in done.err


def test_a_contradiction(refused):
    said = refused("get", "Server=127.0.0.1, Timeout=800", "I1", "--timeout", "2", code=2)
    assert "Timeout=800 in the connection string contradicts timeout=2.0" in said


def test_streaming_refuses_http(run, tmp_path):
    done = run("stream", "Server=http://127.0.0.1:1", str(tmp_path / "x.csv"))
    assert "slave mode requires b-CAP; http://127.0.0.1:1 uses e-CAP" in done.err


def test_the_hint_of_an_error_can_be_pasted_into_a_shell(run, rc8, place):
    rc8.raise_error(0x83204071, "axis 1 is at its limit")
    text = f"Server={place}, Timeout=20000"
    done = run("move", text, "J(10, 45, 90, 0, 45, 0)")
    assert done.code == 1
    command = f"orinkit call '{text}' Controller_Execute ClearError"
    assert command in done.err
    assert run(*shlex.split(command)[1:]).code == 0


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("Server=127.0.0.1, Provider=X", "the clients of the gateway choose Provider and Option"),
        ("cell=Server=127.0.0.1, Debug", "Message and Debug do not apply"),
        ("cell=Server=127.0.0.1, Frob=1", "unknown option 'Frob=1'"),
        ("Server=127.0.0.1, TORetry=x", "TORetry cannot be 'x'"),
    ],
)
def test_strings_that_a_gateway_refuses(refused, text, reason):
    assert reason in refused("gateway", "--upstream", text, code=2)


def test_a_string_for_each_controller_of_a_gateway():
    cells = _named(("cell1=Server=10.0.0.1, UDP=1, TORetry=2, Machine=VRC", "cell2=tcp://10.0.0.2"))
    assert [name for name, _ in cells] == ["cell1", "cell2"]
    given = ConnectArguments(cells[0][1], tries=5)
    assert _settings(given) == ConnectArguments("udp://10.0.0.1:5007", machine="VRC", timeout=0.5, tries=2)
    assert _named(("Server=10.0.0.1",)) == [("", "Server=10.0.0.1")]


def test_a_gateway_to_a_string(run, place, rc8):
    rc8.raise_error(0x83204071, "axis 1 is at its limit")
    found = _settings(ConnectArguments(f"Server={place}, Timeout=20000"))
    with orinkit.serve(RemoteProvider({"": Upstream(found.url, timeout=found.timeout)}), "tcp://127.0.0.1:0") as server:
        assert "axis 1 is at its limit" in run("info", server.url).out
