"""--option of the commands that connect, and error descriptions of devices."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

import orinkit
from orinkit import Device, command, variable
from orinkit.abh3.provider.provider import ABH3Provider
from orinkit.can.server import serve_can
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cli._shared import connection
from orinkit.core import i18n
from orinkit.core.errors import CallError, error_for
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from orinkit.virtual.rc8 import VirtualRC8
from support import multicast
from support.devices import Recorder
from support.waiting import PATIENCE, until

GRIPPER = "CaoProv.Example.Gripper"
BUS = multicast.bus()


class Gripper(Device):
    """A device whose errors have descriptions."""

    provider_names = (GRIPPER,)

    def __init__(self) -> None:
        self.asked = 0
        self.words = "61 mm: it opens\nfrom 0 \x1b[31mto 60 mm"

    @variable("WIDTH")
    def width(self) -> float:
        raise error_for(0x80040201, self.words)

    @width.setter
    def width(self, mm: float) -> None:
        raise error_for(0x80020005 if mm < 0 else 0x80040201, f"{mm:g} mm")

    @variable("PLAIN")
    def plain(self) -> float:
        raise CallError(0x80070057)

    @command("Move")
    def move(self, mm: float) -> None:
        raise error_for(0x80040202, f"{mm:g} mm is too far")


@pytest.fixture
def gripper() -> Gripper:
    return Gripper()


@pytest.fixture(params=["tcp://127.0.0.1:0", "udp://127.0.0.1:0", "http://127.0.0.1:0"])
def gripper_url(gripper, request) -> Iterator[str]:
    with orinkit.serve(gripper, request.param) as server:
        yield server.url


# --- error descriptions -----------------------------------------------------------------------------------------------

PATIENTLY = ("--timeout", f"{PATIENCE:g}")


@pytest.fixture
def _patient(monkeypatch) -> None:
    """Set the usual time-out for error descriptions, because over UDP they are requested only once."""
    monkeypatch.setattr(connection, "_DESCRIPTION_TIMEOUT", PATIENCE)


@pytest.mark.usefixtures("_patient")
def test_an_error_is_reported_with_the_description_of_the_device(refused, gripper_url):
    line = refused("get", gripper_url, "WIDTH", "--provider", GRIPPER, *PATIENTLY)
    assert line.startswith("Variable_GetValue(")
    assert "0x80040201" in line
    assert "[61 mm: it opens from 0 " in line
    assert "\x1b" not in line
    assert line.count("61 mm") == 1
    assert "[61 mm]" in refused("put", gripper_url, "WIDTH", "61", "--provider", GRIPPER, *PATIENTLY)
    assert "[99 mm is too far]" in refused(
        "call", gripper_url, "Controller_Execute", "Move", "99", "--provider", GRIPPER, *PATIENTLY
    )


@pytest.mark.usefixtures("_patient")
def test_the_hint_of_the_command_line_is_kept(refused, gripper_url):
    line = refused("put", gripper_url, "WIDTH", "--provider", GRIPPER, *PATIENTLY, "--", "-1")
    assert "[-1 mm]" in line
    assert "On the command line: " in line


@pytest.mark.parametrize("lang", ["en", "ja"])
def test_a_description_that_repeats_the_code_is_omitted(refused, gripper_url, lang):
    i18n.use(lang)
    assert "[" not in refused("get", gripper_url, "PLAIN", "--provider", GRIPPER)


def test_long_descriptions(refused, gripper, gripper_url):
    gripper.words = "x" * 100_000
    assert len(refused("get", gripper_url, "WIDTH", "--provider", GRIPPER)) < 2000


class Silent(Provider):
    """Refuses every command except GetErrorDescription, which returns or raises ``answer``, or blocks for None."""

    provider_names = ("Test.Silent",)

    def __init__(self, answer: object) -> None:
        self.answer = answer
        self.asked = 0
        self.release = threading.Event()

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        return _SilentController(self)


class _SilentController(ControllerObject):
    def __init__(self, provider: Silent) -> None:
        super().__init__("Silent")
        self.provider = provider

    def execute(self, command: str, parameter: object) -> object:
        if command != "GetErrorDescription":
            raise CallError(0x80040201)
        self.provider.asked += 1
        if self.provider.answer is None:
            self.provider.release.wait(60)
        if isinstance(self.provider.answer, Exception):
            raise self.provider.answer
        return self.provider.answer


@pytest.mark.parametrize("answer", [CallError(0x80004001), ValueError("a fault"), 5, [1, 2], "", "  "])
def test_a_device_without_descriptions(refused, answer):
    device = Silent(answer)
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        line = refused("call", server.url, "Controller_Execute", "Any", "--provider", "Test.Silent")
    assert "0x80040201" in line
    assert "[" not in line
    assert device.asked == 1


def test_a_device_that_does_not_reply_with_a_description(refused, monkeypatch):
    """The description is requested once, without retries; the first error is reported."""
    monkeypatch.setattr(connection, "_DESCRIPTION_TIMEOUT", 0.05)
    device = Silent(None)
    with orinkit.serve(device, "udp://127.0.0.1:0") as server:
        try:
            line = refused("call", server.url, "Controller_Execute", "Any", "--provider", "Test.Silent", *PATIENTLY)
            until(lambda: device.asked)
        finally:
            device.release.set()
    assert "0x80040201" in line
    assert device.asked == 1


def test_denso_controllers_are_not_queried(refused, run):
    """Their codes have built-in descriptions."""
    rc8 = VirtualRC8(language="en")
    try:
        with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
            done = run("get", server.url, "I100", "--trace")
    finally:
        rc8.close()
    assert done.code == 1
    assert "VARIABLE_INDEX_INVALID" in done.err
    assert "GetErrorDescription" not in done.err


# --- options ----------------------------------------------------------------------------------------------------------


def test_the_option_is_passed_to_controller_connect(run, recorder: Recorder, recorder_url):
    option = "Interface=socketcan, Channel=can0, Address=1"
    for argv in (
        ("get", recorder_url, "@X"),
        ("put", recorder_url, "@X", "5"),
        ("call", recorder_url, "Controller_GetName"),
        ("call", recorder_url, "Controller_Connect"),
        ("info", recorder_url),
    ):
        done = run(*argv, "--provider", "Test.Recorder", "--option", option, "--trace")
        assert done.code == 0
        assert f'Controller_Connect("", "Test.Recorder", "localhost", "{option}")' in done.err


def test_every_command_that_connects_has_it(run):
    for name in ("get", "put", "call", "info", "move", "stream"):
        assert "│ --option " in run(name, "--help").out


def test_an_abh3_by_its_option(run, refused):
    with (
        serve_can(VirtualABH3(Parameters(address=7)), at=BUS),
        orinkit.serve(ABH3Provider(), "tcp://127.0.0.1:0") as server,
    ):
        there = ("--provider", "CaoProv.Waco.ABH3", "--option", f"Bus={BUS}, Address=7")
        assert run("get", server.url, "MAIN_VOLTAGE", *there) == (0, "24\n", "")
        line = refused("get", server.url, "SPEED", *there)
        assert "'SPEED'; available: " in line
        refused("get", server.url, "MAIN_VOLTAGE", "--provider", "CaoProv.Waco.ABH3")
