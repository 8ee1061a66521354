"""A web page of another site sends packets to every port of a server: nothing is executed (curl and Chromium)."""

from __future__ import annotations

import base64
import http.server
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from orinkit.bcap.packet import decode
from orinkit.cao import functions as cao
from orinkit.values.variant import R8_ARRAY, Variant, VarType
from orinkit.virtual.rc8.control import PROVIDER_NAME
from support.attacked import PATIENT, Served, served
from support.attackers import packet, text

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--virtual-time-budget=20000",
)


def number(value: int) -> Variant:
    return Variant(VarType.I4, value)


def attack_on(provider: str) -> bytes:
    """Return packets that connect, write I1 and I/O 128, and press every button of the pendant."""
    none = Variant(VarType.EMPTY, None)
    handle = number(2)
    packets = [
        (cao.service_start, (text(""),)),
        (cao.controller_connect, (text("page"), text(provider), text("localhost"), text("Server=localhost"))),
        (cao.controller_get_variable, (handle, text("I1"), text(""))),
        (cao.variable_put_value, (number(3), number(666))),
        (cao.controller_execute, (handle, text("Motor"), number(1))),
        (cao.controller_execute, (handle, text("EmergencyStop"), Variant(VarType.BOOL, True))),
        (cao.controller_get_robot, (handle, text("Arm"), text(""))),
        (cao.robot_execute, (number(4), text("TakeArm"), none)),
        (cao.robot_execute, (number(4), text("Motor"), Variant(R8_ARRAY, [1.0]))),
        (cao.robot_move, (number(4), number(1), text("J(60, 45, 90, 0, 45, 0)"), text("NEXT"))),
    ]
    return b"".join(packet(serial, function.id, *arguments) for serial, (function, arguments) in enumerate(packets, 1))


class Observer:
    """A legitimate client, which reads the state of the controller."""

    def __init__(self, target: Served) -> None:
        self._target = target

    def state(self) -> dict[str, Any]:
        with self._target.connect() as controller, controller.robot("Arm") as robot:
            values = {name: controller.variable(name).value for name in ("I1", "IO128", "@EMERGENCY_STOP")}
            values["joints"] = robot.execute("CurJnt")
            values["motor"] = robot.variable("@SERVO_ON").value
        return values


@pytest.fixture(params=["plain", "gateway"])
def ports(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[list[int], Observer]]:
    """Serve a virtual RC8, or a gateway to it, on all ports, with a token if there is one."""
    with served(tmp_path) as target:
        observer = Observer(target)
        own = [urlsplit(url).port or 0 for url in (target.bcap, target.http, target.control)]
        if request.param == "plain":
            yield own, observer
            return
        token_file = tmp_path / "token"
        listeners = ["--tcp", "127.0.0.1:0", "--http", "127.0.0.1:0", "--token-file", str(token_file)]
        gateway = subprocess.Popen(
            [sys.executable, "-m", "orinkit", "gateway", "--upstream", target.bcap, *listeners],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        try:
            assert gateway.stdout is not None
            yield [urlsplit(gateway.stdout.readline().split()[-1]).port or 0 for _ in range(2)], observer
        finally:
            gateway.terminate()
            gateway.communicate(timeout=PATIENT)


pytestmark = pytest.mark.soak

PROVIDERS = ("CaoProv.DENSO.VRC", PROVIDER_NAME)


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_a_post_of_curl(ports: tuple[list[int], Observer], tmp_path: Path) -> None:
    numbers, observer = ports
    before = observer.state()
    for provider in PROVIDERS:
        (tmp_path / "body").write_bytes(attack_on(provider))
        for port in numbers:
            for kind in ("text/plain", "application/x-www-form-urlencoded"):
                done = subprocess.run(
                    ["curl", "-s", "-m", "20", "-H", f"Content-Type: {kind}", "-H", "Origin: http://evil.example",
                     "--data-binary", f"@{tmp_path / 'body'}", "--http0.9", f"http://127.0.0.1:{port}/"],
                    capture_output=True, check=False,
                )  # fmt: skip
                if done.stdout[:1] == b"\x01":  # one packet with an error code, the reply to an invalid request
                    answer = decode(done.stdout)
                    assert (answer.serial, answer.code >= 0x8000_0000) == (0, True)
                    assert answer.arguments in ([], [None])
    assert observer.state() == before


PAGE = """<!doctype html><title>waiting</title><script>
const bytes = Uint8Array.from(atob("%s"), sign => sign.charCodeAt(0));
const kinds = ["text/plain", "application/x-www-form-urlencoded"];
async function attack() {
  for (const port of %s) for (const kind of kinds) for (const body of [bytes, new Blob([bytes], {type: kind})]) {
    try { await fetch(`http://127.0.0.1:${port}/`, {method: "POST", mode: "no-cors", body, headers: {"Content-Type": kind}}); }
    catch (error) { }
    try { navigator.sendBeacon(`http://127.0.0.1:${port}/`, new Blob([bytes], {type: kind})); } catch (error) { }
    try { new WebSocket(`ws://127.0.0.1:${port}/`).onopen = socket => socket.target.send(bytes); } catch (error) { }
  }
  document.title = "done";
  await fetch("/done", {method: "POST"});
}
attack();
</script>"""


class Site(http.server.BaseHTTPRequestHandler):
    """The web server of another site."""

    page = b""
    done: threading.Event

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(self.page)

    def do_POST(self) -> None:
        self.done.set()
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (Debian: apt-get install chromium)")
@pytest.mark.parametrize("provider", PROVIDERS)
def test_a_page_in_chromium(ports: tuple[list[int], Observer], tmp_path: Path, provider: str) -> None:
    numbers, observer = ports
    before = observer.state()
    done = threading.Event()
    page = PAGE % (base64.b64encode(attack_on(provider)).decode(), numbers)
    handler = type("Evil", (Site,), {"page": page.encode(), "done": done})
    site = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=site.serve_forever, daemon=True).start()
    assert CHROMIUM is not None
    browser = subprocess.Popen(
        [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", f"http://127.0.0.1:{site.server_port}/"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        assert done.wait(2 * PATIENT), "the script of the page was not executed"
    finally:
        browser.terminate()
        browser.wait(PATIENT)
        site.shutdown()
        site.server_close()
    assert observer.state() == before
