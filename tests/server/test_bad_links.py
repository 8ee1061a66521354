"""Clients and a server on a link that loses a fifth of all packets: every call is executed once."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

import orinkit
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout
from support import bad_links
from support.bad_links import BadSerial, BadUdp, Harm, Ledger, at_random, spoil_bytes
from support.both import Both
from support.waiting import PATIENCE

SHORT = 0.04  # s for one try
PACES = (1, 3, 9)
EARLY = 0.005  # s; tolerance of the clock


pytestmark = [pytest.mark.usefixtures("no_errors_are_logged"), pytest.mark.slow]


# --- a client that counts ---------------------------------------------------------------------------------------------


async def opened(both: Both, url: str, name: str, seconds: float, tries: int) -> Any:
    """Connect, and try again after a time-out; return ``None`` if every attempt timed out."""
    connect = orinkit.connect if both.kind == "sync" else orinkit.aio.connect
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            return await both.now(
                connect(url, provider="Test.Ledger", name=name, timeout=seconds, tries=tries, service="")
            )
        except CallTimeout:
            pass
    return None


async def outcome(both: Both, call: Any) -> Any:
    """Return the result of a call, or its exception."""
    try:
        return await both.now(call())
    except (CallTimeout, CallError) as error:
        return error


async def count(
    both: Both, ledger: Ledger, url: str, name: str, calls: int, slow: int, *, seconds: float = SHORT, tries: int = 7
) -> Counter[str]:
    """Call Count with successive numbers, every ``slow``-th time CountSlowly, and check every outcome."""
    controller = await opened(both, url, name, seconds, tries)
    assert controller is not None
    outcomes: Counter[str] = Counter()
    executed = ledger.carried[name]
    try:
        for number in range(calls):
            command = "CountSlowly" if slow and number % slow == slow - 1 else "Count"
            before = time.monotonic()
            result = await outcome(both, partial(controller.execute, command, number))
            if isinstance(result, CallTimeout):
                assert result.seconds == pytest.approx(seconds * tries)
                assert time.monotonic() - before >= seconds * tries - EARLY
                outcomes["time-out"] += 1
            elif isinstance(result, CallError):  # the previous call has timed out and is still executing
                assert (result.code, slow > 0) == (hresult.E_BUSY_PROC, True)
                outcomes["busy"] += 1
            else:
                assert result == [name, number, command]
                assert executed.count(number) == 1
                outcomes["done"] += 1
    finally:
        await both.now(controller.client.close())
    return outcomes


def check(ledger: Ledger, outcomes: list[Counter[str]]) -> Counter[str]:
    """Check that no call was executed twice, or after a later call of the same client; return the sum of the outcomes."""
    for executed in ledger.carried.values():
        assert executed == sorted(set(executed))
    total = sum(outcomes, Counter[str]())
    assert total["done"] <= sum(map(len, ledger.carried.values())) <= total["done"] + total["time-out"]
    return total


# --- the links --------------------------------------------------------------------------------------------------------


def over_udp(both: Both, clients: int, calls: int, harm: Harm, slow: int = 0, **options: Any) -> Counter[str]:
    """Make the calls of all clients on one link to one socket."""
    ledger = Ledger()
    with orinkit.serve(ledger, "udp://127.0.0.1:0") as server, BadUdp(server.url, at_random(1, harm)) as link:
        outcomes = both.side_by_side(
            *(count(both, ledger, link.url, f"client {n}", calls, slow, **options) for n in range(clients))
        )
        assert link.arrived < link.came * (1 - harm.loss / 2)  # the link has lost packets
    return check(ledger, outcomes)


def over_serial(both: Both, clients: int, calls: int, harm: Harm, slow: int = 0, **options: Any) -> Counter[str]:
    """Make the calls of each client on its own line."""
    ledger = Ledger()
    with (
        orinkit.serve(ledger, *["pty://"] * clients) as server,
        BadSerial(server.urls, at_random(1, harm, spoil_bytes)) as link,
    ):
        outcomes = both.side_by_side(
            *(count(both, ledger, url, f"client {n}", calls, slow, **options) for n, url in enumerate(link.urls))
        )
        assert link.arrived < link.came * (1 - harm.loss / 4)
    return check(ledger, outcomes)


def patiently(total_calls: int, least: int, run: Callable[[float], Counter[str]]) -> Counter[str]:
    """Make calls most of which must succeed; if the machine is too slow for the time-outs, repeat with longer ones.

    Args:
        total_calls: number of calls.
        least: number of calls that must succeed.
        run: makes the calls; its argument is the factor by which all times are longer.
    """
    for pace in PACES:
        total = run(pace)
        assert sum(total.values()) == total_calls
        if total["done"] > least:
            break
    assert total["done"] > least
    return total


@pytest.mark.timeout(300)
def test_three_thousand_calls_over_udp(both: Both) -> None:
    total = patiently(
        3_000, 2_850, lambda pace: over_udp(both, 50, 60, Harm(delay=SHORT / 2 * pace), seconds=SHORT * pace)
    )
    assert total["done"] + total["time-out"] == 3_000


@pytest.mark.timeout(300)
def test_two_thousand_calls_over_serial_lines(both: Both) -> None:
    total = patiently(
        2_000, 1_900, lambda pace: over_serial(both, 20, 100, Harm(delay=SHORT / 2 * pace), seconds=SHORT * pace)
    )
    assert total["done"] + total["time-out"] == 2_000


@pytest.mark.timeout(300)
@pytest.mark.parametrize("link", [over_udp, over_serial])
def test_calls_that_take_longer_than_an_attempt(both: Both, link: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The server reports that the call is executing, which restarts the time-out; the call is executed once."""

    def run(pace: float) -> Counter[str]:
        monkeypatch.setattr(bad_links, "SLOW", 2.5 * SHORT * pace)
        return link(both, 15, 20, Harm(delay=SHORT / 2 * pace), slow=5, seconds=SHORT * pace)

    patiently(300, 280, run)


@pytest.mark.timeout(300)
def test_packets_that_arrive_after_the_time_out_of_their_attempt(both: Both) -> None:
    """They arrive during later calls."""
    patiently(
        1_000,
        950,
        lambda pace: over_udp(both, 20, 50, Harm(loss=0.1, late=0.3, delay=3.75 * SHORT * pace), seconds=SHORT * pace),
    )


@pytest.mark.soak
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("link", "clients", "calls"), [(over_udp, 50, 200), (over_serial, 20, 100)])
def test_all_calls_with_the_usual_time_outs(both: Both, link: Any, clients: int, calls: int) -> None:
    total = link(both, clients, calls, Harm(delay=0.2), seconds=0.5, tries=5)
    assert total["done"] + total["time-out"] == clients * calls
    assert total["done"] > clients * calls * 0.95


@pytest.mark.soak
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("link", [over_udp, over_serial])
def test_a_hundred_thousand_calls(both: Both, link: Any) -> None:
    total = link(both, 50, 2_000, Harm())
    assert sum(total.values()) == 100_000
    assert total["done"] > 95_000
