"""Overhead of a gateway for a call, and slave mode through a gateway. Part of ``make bench``.

Controller and gateway run in separate processes.
"""

from __future__ import annotations

import multiprocessing.connection
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import orinkit
from measuring import ROUNDS, in_turn, line, middle, process
from orinkit import functions
from orinkit.core.i18n import choose
from orinkit.gateway import RemoteProvider
from served import PROVIDER, both_servers, serve_until_terminated
from stalls import Stalls
from stream import PERIOD, as_if_elsewhere, busy, controller, ours, show_ours


def gateway_to(url: str) -> Callable[[multiprocessing.connection.Connection], None]:
    """Return a function that serves a gateway to a controller over b-CAP and e-CAP."""
    return _Gateway(url)


class _Gateway:
    """The function; it is an object of a class, because a nested function cannot be sent to another process."""

    def __init__(self, url: str) -> None:
        self.url = url

    def __call__(self, pipe: multiprocessing.connection.Connection) -> None:
        serve_until_terminated(RemoteProvider(self.url), pipe, "tcp://127.0.0.1:0", "http://127.0.0.1:0")


def gateway(count: int) -> None:
    """Measure Variable_GetValue through a gateway; the reference is the same call without a gateway."""
    with process(both_servers) as direct:
        tcp, http = direct.split()
        with process(gateway_to(tcp)) as through:
            gateway_tcp, gateway_http = through.split()
            routes = {
                choose("gateway, b-CAP to b-CAP (bare: b-CAP)", "ゲートウェイ, b-CAP→b-CAP (素: b-CAP)"): (gateway_tcp, tcp),
                choose("gateway, e-CAP to b-CAP (bare: b-CAP)", "ゲートウェイ, e-CAP→b-CAP (素: b-CAP)"): (gateway_http, tcp),
                choose("gateway, e-CAP to b-CAP (bare: e-CAP)", "ゲートウェイ, e-CAP→b-CAP (素: e-CAP)"): (gateway_http, http),
            }  # fmt: skip
            for what, (url, bare) in routes.items():
                mine, other, ratio = middle([by_turns(url, bare, count) for _ in range(ROUNDS)])
                adds = choose(f"adds {mine - other:.0f} us", f"追加分 {mine - other:.0f} us")
                line(what, mine, other, ratio, "us", adds)


def by_turns(url: str, bare: str, count: int) -> tuple[float, float, float]:
    """Alternate calls to both addresses; return both medians and their ratio."""
    with ExitStack() as stack:

        def call(place: str) -> Callable[[], object]:
            client = stack.enter_context(orinkit.open_client(place))
            client.call(functions.service_start, "")
            handle = client.call(functions.controller_connect, "", PROVIDER, "localhost", "")
            variable = client.call(functions.controller_get_variable, handle, "D1", "")
            return lambda: client.call(functions.variable_get_value, variable)

        return in_turn(call(url), call(bare), count)


# --- slave mode -------------------------------------------------------------------------------------------------------


@contextmanager
def served_gateway(url: str) -> Iterator[str]:
    """Run ``orinkit gateway`` over TCP; yield its address."""
    command = [sys.executable, "-m", "orinkit", "gateway", "--upstream", url, "--tcp", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        try:
            ready = server.stdout.readline()  # "ready URL"
            as_if_elsewhere(server.pid)
            yield ready.split()[1]
        finally:
            server.terminate()


def slave_through_gateway(seconds: float = 60.0, threads: int = 1, *, stalls: Stalls) -> None:
    """Measure set-points every 8 ms through a gateway to a virtual RC8, with busy threads in the streaming program."""
    with controller() as url, served_gateway(url) as through, busy(threads):
        outcome = ours(through, seconds, 2)
    load = os.getloadavg()[0]
    what = choose(
        f"orinkit, 8 ms, mode 2, gateway, {threads} busy, load {load:.1f}",
        f"orinkit, 8 ms, モード 2, ゲートウェイ, 負荷スレッド {threads}, ロード {load:.1f}",
    )
    show_ours(what, outcome, PERIOD, stalls)
