"""serve rc8 in a separate process: its output, its shutdown, and its stored variables."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterator

import pytest

import orinkit
from orinkit.core.errors import CallError
from orinkit.transport.address import is_loopback

Serve = Callable[..., "tuple[subprocess.Popen[str], str]"]


@pytest.fixture
def serve(program) -> Iterator[Serve]:
    """Start ``orinkit serve rc8``, on TCP by default; returns the process and the address of its first listener."""
    started: list[subprocess.Popen[str]] = []

    def serve(*options: str, where: tuple[str, ...] = ("--tcp", "127.0.0.1:0")) -> tuple[subprocess.Popen[str], str]:
        process = subprocess.Popen(
            [*program, "serve", "rc8", *where, *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        word, _, url = process.stdout.readline().rstrip("\n").partition(" ")
        assert word == "ready"
        return process, url

    yield serve
    for process in started:
        process.kill()
        process.communicate()


def stop(process: subprocess.Popen[str], number: int) -> tuple[int, str, str]:
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ready_line_service_and_clean_stop(serve, number):
    process, url = serve()
    with orinkit.connect(url) as controller:
        controller.variable("I1").value = 5
        assert controller.variable("I1").value == 5
        code, out, err = stop(process, number)  # a connected client does not prevent it
    assert (code, out) == (0, "")
    assert f"listening on {url}" in err
    assert "Traceback" not in err


def test_one_line_for_each_listener(serve):
    process, first = serve("--tcp", "tcp://localhost:0")
    assert process.stdout is not None
    second = process.stdout.readline()
    assert second.startswith("ready tcp://localhost:")
    for url in (first, second.removeprefix("ready ").strip()):
        with orinkit.connect(url) as controller:
            assert controller.variable("@TYPE").value == "RC8 Controller"


@pytest.mark.parametrize("where", [("--udp", "127.0.0.1:0"), ("--udp", "udp:127.0.0.1:0"), ("--pty",)])
def test_other_listeners_replace_the_default_one(serve, where):
    process, url = serve(where=where)
    with orinkit.connect(url) as controller:
        assert controller.variable("@TYPE").value == "RC8 Controller"
    code, out, err = stop(process, signal.SIGTERM)
    assert (code, out) == (0, "")  # no other listener
    assert url.startswith("udp://127.0.0.1:" if "--udp" in where else "serial:///dev/")
    assert err.count("listening on") == 1


def test_every_kind_of_listener(serve, tmp_path):
    pytest.importorskip("serialx")
    far_end, near_end = os.openpty()
    (tmp_path / "port").symlink_to(os.ttyname(near_end))
    try:
        process, first = serve("--pty", "--serial", str(tmp_path / "port"), "--udp", "127.0.0.1:0")
        assert process.stdout is not None
        urls = [first, *(process.stdout.readline().removeprefix("ready ").strip() for _ in range(3))]
        assert [url.partition("://")[0] for url in urls] == ["tcp", "udp", "serial", "serial"]
        assert urls[2] == f"serial://{tmp_path / 'port'}"
        for url in (urls[0], urls[1], urls[3]):
            with orinkit.connect(url) as controller:
                assert controller.variable("@TYPE").value == "RC8 Controller"
        assert stop(process, signal.SIGTERM)[0] == 0
    finally:
        os.close(far_end)
        os.close(near_end)


def test_options_of_the_controller(serve):
    _, url = serve("--variables", "I=7", "--variables", "s=3", "--io-points", "256", "--clients", "1", "--objects", "3")
    with orinkit.connect(url) as controller:
        assert controller.variable("@VAR_I_LEN").value == 7
        assert controller.variable("@VAR_S_LEN").value == 3
        assert controller.variable("@VAR_IO_LEN").value == 256
        with pytest.raises(CallError, match="E_MAX_CONNECT"):
            orinkit.connect(url)
        kept = [controller.variable("I1"), controller.variable("I2")]
        with pytest.raises(CallError, match="E_MAX_OBJECT"):
            controller.variable("I3")
        assert len(kept) == 2


def test_the_pc_provider_is_accepted_if_requested(serve):
    _, url = serve()
    with pytest.raises(orinkit.CallError) as caught:
        orinkit.connect(url, provider="CaoProv.DENSO.RC8")
    assert caught.value.code == 0x80000201
    _, url = serve("--accept-pc-provider")
    with orinkit.connect(url, provider="CaoProv.DENSO.RC8") as rc8:
        assert rc8.variable("@MODE").value == 3


def test_permission(serve):
    _, url = serve("--permission", "*=r")
    with orinkit.connect(url) as controller:
        assert controller.variable("I1").value == 0
        with pytest.raises(CallError):
            controller.variable("I1").value = 1


def test_variables_are_stored_in_the_state_directory(serve, tmp_path, refused):
    state = str(tmp_path / "state")
    process, url = serve("--state", state)
    with orinkit.connect(url) as controller:
        controller.variable("S1").value = "kept"
    assert "is in use by another process" in refused("serve", "rc8", "--tcp", "127.0.0.1:0", "--state", state)
    assert stop(process, signal.SIGTERM)[0] == 0
    _, url = serve("--state", state)
    with orinkit.connect(url) as controller:
        assert controller.variable("S1").value == "kept"


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", "other accounts can access the directory (mode 755). Try: chmod 700 {state}"),
        ("ja", "他のアカウントがアクセスできるディレクトリです (モード 755)。対処: chmod 700 {state}"),
    ],
)
def test_a_state_directory_that_others_can_access(serve, tmp_path, monkeypatch, language, words):
    """The warning is a record of the log, with its time, in the language of the user."""
    state = tmp_path / "state"
    state.mkdir()
    state.chmod(0o755)
    monkeypatch.setenv("ORINKIT_LANG", language)
    process, _ = serve("--state", str(state))
    _, errors = stop(process, signal.SIGTERM)[1:]
    (line,) = [line for line in errors.splitlines() if "755" in line]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d [\d:,]+ WARNING orinkit\.\S+: .*", line)
    assert line.endswith(f": {state}: {words.format(state=state)}")


def test_a_port_that_is_taken(refused):
    with orinkit.serve(orinkit.Provider(), "tcp://127.0.0.1:0") as server:
        message = refused("serve", "rc8", "--tcp", server.url)
    assert message.startswith(f"cannot listen on {server.url}: ")
    assert message.endswith(". Try: use another port, or port 0 for a free one")


@pytest.mark.parametrize("option", ["--tcp", "--udp"])
def test_a_warning_if_other_machines_can_connect(serve, option):
    process, _ = serve(where=(option, "0.0.0.0:0"))
    _, errors = stop(process, signal.SIGTERM)[1:]
    assert "orinkit: warning: 0.0.0.0:0 is reachable from other machines, and b-CAP has no authentication" in errors


@pytest.mark.parametrize("option", ["--tcp", "--udp"])
@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid"])
def test_an_address_of_another_machine(refused, option, host):
    """Nobody can reach it, so there is no warning."""
    message = refused("serve", "rc8", option, f"{host}:5007")
    assert message.startswith(f"cannot listen on {option[2:]}://{host}:5007: ")
    assert message.endswith(". Try: HOST:PORT with an address of this machine")


def test_a_serial_port_that_does_not_exist(refused):
    pytest.importorskip("serialx")
    message = refused("serve", "rc8", "--serial", "/dev/ttyThereIsNone?baudrate=9600")
    assert message.startswith("cannot open the serial port /dev/ttyThereIsNone: ")


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("127.1.2.3", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False), ("robot", False)],
)  # fmt: skip
def test_is_loopback(host, expected):
    assert is_loopback(host) is expected


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--tcp", "ftp://127.0.0.1:0"], "unknown transport 'ftp'"),
        (["--tcp", "127.0.0.1:99999"], "is not 0 to 65535"),
        (["--tcp", "udp://127.0.0.1:0"], "--tcp udp://127.0.0.1:0: this is an address for udp"),
        (["--udp", "127.0.0.1:0", "--udp", "pty://"], "--udp pty://: this is an address for pty"),
        (["--serial", "tcp://127.0.0.1:0"], "--serial tcp://127.0.0.1:0: this is an address for tcp"),
        (["--serial", "/dev/ttyS0?speed=9600"], "unknown setting 'speed'"),
        (["--serial", "com:1:fast"], "baudrate cannot be 'fast'"),
        (["--control", "udp://127.0.0.1:0"], "--control udp://127.0.0.1:0: only loopback addresses are allowed"),
        (["--permission", "me=rw"], "'me' is not an IP address or network"),
        (["--variables", "I"], "--variables I: not CLASS=NUMBER. Try: I=200"),
        (["--variables", "I=-1"], "--variables I=-1: not CLASS=NUMBER"),
        (["--variables", "Q=1"], "unknown variable class Q"),
        (["--io-points", "-1"], "IO"),
        (["--clients", "0"], "--clients must be 1 or more, not 0"),
        (["--objects", "0"], "--objects must be 1 or more, not 0"),
        (["--alive", "0.1"], "--alive must be 0.5 to 3600 s, not 0.1"),
        (["--http", "0", "--http-idle", "0"], "--http-idle must be 0.1 to 86400 s, not 0.0"),
        (["--dead-after", "1"], "--dead-after must be 2 to 7200 s, not 1.0"),
    ],
)
def test_invalid_options(refused, options, message):
    assert message in refused("serve", "rc8", *options, code=2)
