"""A server whose stderr is not read: it replies to calls, the arm continues, the emergency stop works."""

from __future__ import annotations

import json
import subprocess

import orinkit
from orinkit.cao.functions import FUNCTIONS
from orinkit.values.poses import J
from orinkit.virtual.rc8.control import PROVIDER_NAME
from support.peers import RawClient
from support.waiting import PATIENCE, until

ROUNDS = 25
SECRET = "a-secret-of-this-test"


def test_an_unread_log_does_not_block_the_server(program, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text(SECRET)
    secret.chmod(0o600)
    server = subprocess.Popen(
        [
            *program, "serve", "rc8", "--tcp", "127.0.0.1:0", "--control", "127.0.0.1:0", "--motor-on", "--verbose",
            "--control-secret-file", str(secret),
        ],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
    )  # fmt: skip
    try:
        assert server.stdout is not None
        url, control = (server.stdout.readline().split()[-1] for _ in range(2))
        with (
            orinkit.connect(url, timeout=PATIENCE) as controller,
            orinkit.connect(control, provider=PROVIDER_NAME, option=f"Secret={SECRET}", timeout=PATIENCE) as pendant,
            RawClient(url) as attacker,
        ):
            robot = controller.robot()
            with robot.arm():
                robot.move(J(60, 30, 90, 0, 60, 0), wait=False)
                refused = sum(_refuse_all(attacker) for _ in range(ROUNDS))
                assert refused > 3000
                # enough to fill the pipe several times; the motion must nevertheless have continued to its end
                until(lambda: abs(robot.joints[0] - 60) < 0.01)
                pendant.execute("EmergencyStop", True)
                until(lambda: json.loads(pendant.execute("Status"))["motor"] == "off")
        assert server.poll() is None
    finally:
        server.kill()
        server.communicate()


def _refuse_all(client: RawClient) -> int:
    """Call every function with an invalid handle, each for a different log message; return the number of calls."""
    count = 0
    for function in FUNCTIONS.values():
        if function.arguments and function.arguments[0].is_handle:
            values = [9999, *("x" * 100 for _ in function.arguments[1:])]
            assert client.ask(function.id, *values) >= 0x8000_0000
            count += 1
    return count
