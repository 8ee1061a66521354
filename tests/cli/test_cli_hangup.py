"""The end of the terminal (SIGHUP) shuts down every server as SIGTERM does, without leftovers."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit.virtual.rc8 import VirtualRC8
from support import multicast

COMMANDS = {
    "rc8": ["serve", "rc8", "--tcp", "127.0.0.1:0"],
    "ve026a": ["serve", "ve026a", "--tcp", "127.0.0.1:0"],
    "abh3": ["serve", "abh3", "BUS"],
    "device": ["serve", "device", "DEVICE", "--tcp", "127.0.0.1:0"],
    "gateway": ["gateway", "--upstream", "URL", "--tcp", "127.0.0.1:0"],
}

DEVICE = """
from orinkit import Device


class Lamp(Device):
    provider_names = ("Test.Lamp",)
"""


@pytest.fixture(autouse=True)
def _no_nohup() -> Iterator[None]:
    """Restore SIGHUP, so that child processes do not ignore it if the tests run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="SIGHUP does not exist")
@pytest.mark.parametrize("command", COMMANDS)
def test_sighup_is_a_clean_shutdown(program: list[str], command: str, tmp_path: Path) -> None:
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as upstream:
        device = tmp_path / "lamp.py"
        device.write_text(DEVICE, encoding="utf-8")
        known = {"URL": upstream.url, "BUS": multicast.bus(), "DEVICE": f"{device}:Lamp"}
        words = [known.get(word, word) for word in COMMANDS[command]]
        process = subprocess.Popen(
            [*program, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )  # fmt: skip
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("ready "), process.communicate()[1]
            process.send_signal(signal.SIGHUP)
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert [each.name for each in tmp_path.iterdir() if each.name.startswith("orinkit-rc8-")] == []


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="SIGHUP does not exist")
def test_nohup_keeps_a_server_running(program: list[str]) -> None:
    process = subprocess.Popen(
        [*program, *COMMANDS["rc8"]], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )  # fmt: skip
    try:
        assert process.stdout is not None
        url = process.stdout.readline().split()[1]
        process.send_signal(signal.SIGHUP)
        with orinkit.connect(url) as controller:
            controller.variable("I1").value = 1
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0
