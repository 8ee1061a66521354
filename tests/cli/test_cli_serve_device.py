"""serve device, and devices served with the virtual RC8, in separate processes."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import orinkit
from support.distributions import device, environment, forgetting, install

GRIPPER = "CaoProv.Example.Gripper"
Serve = Callable[..., "tuple[subprocess.Popen[str], str]"]


@pytest.fixture(autouse=True)
def _as_before(tmp_path) -> Iterator[None]:
    with forgetting(tmp_path):
        yield


@pytest.fixture
def serve(program, tmp_path) -> Iterator[Serve]:
    """Start ``orinkit serve``, with the packages of ``tmp_path/site``; returns the process and its first address."""
    started: list[subprocess.Popen[str]] = []

    def serve(*options: str, where: tuple[str, ...] = ("--tcp", "127.0.0.1:0")) -> tuple[subprocess.Popen[str], str]:
        process = subprocess.Popen(
            [*program, "serve", *options, *where], env=environment(tmp_path / "site"), cwd=tmp_path,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        )  # fmt: skip
        started.append(process)
        return process, next_url(process)

    yield serve
    for process in started:
        process.kill()
        process.communicate()


def next_url(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    word, _, url = process.stdout.readline().rstrip("\n").partition(" ")
    assert word == "ready"
    return url


def stop(process: subprocess.Popen[str]) -> str:
    """Stop a server as Ctrl-C does, and return its log."""
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "")
    return err


def width(url: str, provider: str = GRIPPER) -> float:
    with orinkit.connect(url, provider=provider) as controller:
        return controller.variable("WIDTH").value


@pytest.fixture
def site(tmp_path) -> Path:
    """The directory of an installed gripper package."""
    return install(tmp_path / "site", "my-gripper", f"{GRIPPER} = my_gripper:Gripper", my_gripper=device("Test.Own"))


# --- with the virtual RC8 ---------------------------------------------------------------------------------------------


def test_an_installed_device_is_served_by_name_with_the_virtual_rc8(serve, site):
    process, url = serve("rc8")
    with orinkit.connect(url) as rc8, orinkit.connect(url, provider=GRIPPER) as gripper:
        rc8.variable("I1").value = 5
        assert (gripper.variable("WIDTH").value, rc8.variable("I1").value) == (30.0, 5)
        assert gripper.variable_names() == ["WIDTH"]
    assert width(url, "test.own") == 30.0
    log = stop(process)
    assert f"INFO orinkit.providers: serving Test.Own, {GRIPPER} (my-gripper 1.0)\n" in log
    assert log.count("INFO orinkit.providers: serving") == 1
    assert "WARNING" not in log


def test_without_providers(serve, site):
    _, url = serve("rc8", "--no-providers")
    with pytest.raises(orinkit.CallError, match="E_CAO_PROV_INVALID"):
        width(url)


def test_a_device_that_cannot_be_loaded_is_a_warning(serve, site):
    install(site, "zz-bad", "Test.Bad = zz_bad:Bad\nTest.Gone = zz_bad:Gone", zz_bad="import no_such_module_at_all\n")
    process, url = serve("rc8")
    assert width(url) == 30.0
    with orinkit.connect(url) as rc8:
        assert rc8.variable("@TYPE").value == "RC8 Controller"
    log = stop(process)
    assert (
        "WARNING orinkit.providers: Test.Bad (zz-bad 1.0) was not loaded: Test.Bad = zz_bad:Bad: ModuleNotFoundError: "
        in log
    )
    assert "No module named 'no_such_module_at_all' (zz_bad.py:1)" in log
    assert "Test.Gone (zz-bad 1.0) was not loaded" in log
    assert "Traceback" not in log


def test_a_given_device_takes_precedence(serve, site, tmp_path):
    """A new version can be tried while the old one is installed: it gets the name, and a warning is logged."""
    (tmp_path / "gripper.py").write_text(device(GRIPPER, width=1.0), encoding="utf-8")
    process, url = serve("rc8", "--provider", "gripper.py:Gripper")
    assert (width(url), width(url, "Test.Own")) == (1.0, 30.0)
    log = stop(process)
    assert (
        f"WARNING orinkit.providers: provider name {GRIPPER} is used by gripper.Gripper and by "
        f"{GRIPPER} = my_gripper:Gripper (my-gripper 1.0): the first one takes precedence\n" in log
    )
    assert f"serving {GRIPPER} (gripper.Gripper)\n" in log
    assert "serving Test.Own (my-gripper 1.0)\n" in log


def test_several_given_devices_with_and_without_installed_ones(serve, site, tmp_path):
    (tmp_path / "pump.py").write_text(device("Test.Pump", width=2.0, kind="Pump"), encoding="utf-8")
    (site / "lamp.py").write_text(device("Test.Lamp", width=3.0, kind="Lamp"), encoding="utf-8")
    process, url = serve("rc8", "--no-providers", "--provider", "pump.py", "--provider", "lamp:Lamp")
    assert (width(url, "Test.Pump"), width(url, "Test.Lamp")) == (2.0, 3.0)
    with pytest.raises(orinkit.CallError):
        width(url)
    _, url = serve("rc8", "--provider", GRIPPER.lower())  # by its name: it is served only once
    assert width(url) == 30.0
    assert "WARNING" not in stop(process)


def test_a_given_device_that_cannot_be_served_ends_the_command(refused, tmp_path):
    message = refused("serve", "rc8", "--tcp", "127.0.0.1:0", "--provider", str(tmp_path / "none.py"), code=2)
    assert message.endswith("none.py: the file does not exist")
    message = refused("serve", "rc8", "--provider", "orinkit.virtual.ve026a:VirtualVE026A", code=2)
    assert "VirtualRC8 and VirtualVE026A use different dialects of b-CAP" in message


def test_two_entry_points_keep_their_own_names(serve, site):
    install(site, "a-greedy", "Aaa.Greedy = greedy:Gripper", greedy=device(GRIPPER, width=1.0))
    for options in (("device", "Aaa.Greedy", GRIPPER), ("rc8",)):
        process, url = serve(*options)
        assert (width(url, "Aaa.Greedy"), width(url)) == (1.0, 30.0)
        assert "the entry point of that name takes precedence" in stop(process)


def test_no_devices_are_served_with_a_ve026a(serve, site):
    process, url = serve("ve026a", where=("--pty",))
    with orinkit.connect(url) as arm:
        assert "VE026A" in arm.variable("@VERSION").value
    assert "WARNING" not in stop(process)


# --- alone ------------------------------------------------------------------------------------------------------------


def test_devices_alone_on_every_transport(serve, site, tmp_path):
    pytest.importorskip("serialx")
    pytest.importorskip("uvicorn")
    (tmp_path / "neighbour.py").write_text("NAME = 'Test.Pump'\n", encoding="utf-8")
    source = "from neighbour import NAME\n" + device("", kind="Pump").replace("''", "NAME")
    (tmp_path / "pump.py").write_text(source, encoding="utf-8")
    where = ("--tcp", "127.0.0.1:0", "--udp", "127.0.0.1:0", "--http", "127.0.0.1:0", "--pty")
    process, first = serve("device", "pump.py", GRIPPER, where=where)
    urls = [first, *(next_url(process) for _ in range(3))]
    assert [url.partition(":")[0] for url in urls] == ["tcp", "udp", "http", "serial"]
    for url in urls:
        assert width(url, "Test.Pump") == width(url) == 30.0
    with pytest.raises(orinkit.CallError, match="E_CAO_PROV_INVALID"):
        orinkit.connect(first)  # no virtual RC8
    log = stop(process)
    assert log.count("listening on") == 4
    assert "INFO orinkit.providers: serving Test.Pump (pump.Pump)\n" in log
    assert "Traceback" not in log


def test_an_exception_of_a_handler_is_logged_and_reported_to_its_client(serve, tmp_path):
    source = (
        device("Test.Faulty") + "\n    @variable('BROKEN')\n    def broken(self):\n        raise OSError('no cable')\n"
    )
    (tmp_path / "faulty.py").write_text(source, encoding="utf-8")
    process, url = serve("device", "faulty.py")
    with orinkit.connect(url, provider="Test.Faulty") as one, orinkit.connect(url, provider="Test.Faulty") as other:
        with pytest.raises(orinkit.CallError) as caught:
            one.variable("BROKEN").get_value()
        assert one.error_description(caught.value.code) == "OSError: no cable"
        assert other.error_description(caught.value.code) != "OSError: no cable"
        assert one.variable("WIDTH").value == other.variable("WIDTH").value == 30.0
    log = stop(process)
    assert "Variable_GetValue: the device raised an exception" in log
    assert 'faulty.py", line 13, in broken' in log


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("none.py:Gripper", "none.py:Gripper: the file does not exist"),
        ("gripper.py:Grip", "gripper.py:Grip: it has no attribute Grip. Try: Gripper"),
        ("gripper.py:device", "gripper.py:device: device(name: "),
        ("json:loads", "json:loads: loads(s, *, cls=None"),
        ("broken.py", "broken.py: ZeroDivisionError: division by zero (broken.py:2)"),
        ("Nobody", "Nobody: neither a module nor a provider Nobody exists"),
    ],
)
def test_a_wrong_target_is_reported_in_one_line(refused, monkeypatch, tmp_path, target, message):
    monkeypatch.chdir(tmp_path)
    Path("gripper.py").write_text(f"{device(GRIPPER)}\nfrom support.distributions import device\n", encoding="utf-8")
    Path("broken.py").write_text("\n1 / 0\n", encoding="utf-8")
    assert refused("serve", "device", target, "--tcp", "127.0.0.1:0", code=2).startswith(message)


def test_the_target_is_required(refused):
    assert refused("serve", "device", code=2) == "TARGET is missing (see orinkit serve device --help)"


def test_the_listen_options_are_checked_first(refused):
    assert "--clients must be 1 or more" in refused("serve", "device", "none.py", "--clients", "0", code=2)
