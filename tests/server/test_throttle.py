"""How much log a client can cause, and that every logger that a client reaches is watched."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit.cao.functions import controller_execute
from orinkit.core import hresult
from orinkit.server import log_limiter as throttle_module
from orinkit.server.log_limiter import BURST, CLIENT, INTERVAL, LOGGERS, THROTTLE, LogLimiter
from orinkit.virtual.rc8 import VirtualRC8
from support.peers import RawClient
from support.waiting import until

SOURCE = Path(orinkit.__file__).parent
OUT_OF_REACH = {
    "orinkit.providers",  # of the start
    "orinkit.server.uvicorn",  # says errors only
    "httpx2", "asyncio",
}  # fmt: skip


class Alarm:
    """What the throttle wants to do later."""

    def __init__(self) -> None:
        self.waiting: list[Callable[[], None]] = []

    def __call__(self, seconds: float, function: Callable[[], None]) -> Alarm:
        assert seconds == INTERVAL
        self.waiting.append(function)
        return self

    def cancel(self) -> None:
        self.waiting.clear()

    def ring(self) -> None:
        due, self.waiting = self.waiting, []
        for each in due:
            each()


class Said(logging.Handler):
    """What is written."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@pytest.fixture
def now() -> list[float]:
    return [1000.0]


@pytest.fixture
def alarm() -> Alarm:
    return Alarm()


@pytest.fixture
def throttle(now, alarm) -> LogLimiter:
    return LogLimiter(lambda: now[0], alarm)


@pytest.fixture
def said(throttle) -> Iterator[Said]:
    logger = logging.getLogger("orinkit.test.throttle")
    handler = Said()
    logger.setLevel(logging.INFO)
    logger.addFilter(throttle)
    logger.addHandler(handler)
    yield handler
    logger.removeFilter(throttle)
    logger.removeHandler(handler)


def log(message: str = "%s failed", *arguments: object, client: str = "", **extra: object) -> None:
    before = CLIENT.set(client)
    logging.getLogger("orinkit.test.throttle").info(message, *arguments, extra=extra or None)
    CLIENT.reset(before)


def test_a_burst_then_one_in_ten_seconds_and_how_many_were_left_out(said, now, alarm):
    for number in range(4322):
        log("%s failed", number)
    assert said.lines == [f"{number} failed" for number in range(BURST)]
    said.lines.clear()
    now[0] += INTERVAL
    alarm.ring()
    assert said.lines == ["4,312 similar messages suppressed: 9 failed"]
    for number in range(5):
        log("%s failed", number)
    assert said.lines[1:] == ["0 failed"]
    now[0] += INTERVAL
    alarm.ring()
    assert said.lines[2:] == ["4 similar messages suppressed: 0 failed"]
    assert alarm.waiting == []  # nothing is left out any more


def test_a_quiet_time_gives_the_whole_burst_back(said, now, alarm):
    for _ in range(2 * BURST):
        log("again")
    alarm.ring()
    said.lines.clear()
    now[0] += 100 * BURST * INTERVAL
    for _ in range(2 * BURST):
        log("again")
    assert said.lines == ["again"] * BURST


def test_clients_messages_and_kinds_count_apart(said):
    for _ in range(2 * BURST):
        log("%s failed", 1, client="10.0.0.1")
        log("%s failed", 2, client="10.0.0.2")
        log("%s went", 3, client="10.0.0.2")
        log("%s failed", 4, client="10.0.0.2", kind="Robot_Move")
    assert {line: said.lines.count(line) for line in said.lines} == dict.fromkeys(
        ("1 failed", "2 failed", "3 went", "4 failed"), BURST
    )


def test_the_memory_is_bounded_and_so_is_what_many_addresses_can_cause(said, throttle, now, alarm):
    for number in range(5000):
        for _ in range(BURST + 1):
            log("failed", client=f"10.{number >> 8}.{number & 255}.1")
    assert len(throttle._counts) <= 1025
    assert len(said.lines) <= 1025 * BURST
    said.lines.clear()
    alarm.ring()
    suppressed = sum(int(line.split()[0].replace(",", "")) for line in said.lines)
    assert suppressed == 5000 * (BURST + 1) - 1025 * BURST
    now[0] += 1000 * INTERVAL  # all of them have been quiet: room for others
    said.lines.clear()
    log("failed", client="192.168.0.1")
    assert said.lines == ["failed"]
    assert len(throttle._counts) <= 1025


def test_a_record_whose_arguments_do_not_fit_is_for_its_handler(said):
    logging.getLogger("orinkit.test.throttle").removeHandler(said)
    previous, logging.raiseExceptions = logging.raiseExceptions, False
    try:
        log("%d of %d", 1)
    finally:
        logging.raiseExceptions = previous


def test_every_logger_of_a_server_is_watched():
    pattern = re.compile(r'getLogger\("([a-z0-9_.]+)"\)')
    inside = ("server", "cao", "bcap", "ecap", "virtual", "gateway", "device.py", "declared.py")
    found = {
        name
        for path in SOURCE.rglob("*.py")
        if path.relative_to(SOURCE).parts[0] in inside
        for name in pattern.findall(path.read_text("utf-8"))
    }
    assert found - OUT_OF_REACH == set(LOGGERS)


def test_a_client_that_is_refused_again_and_again_fills_no_log(caplog):
    caplog.set_level(logging.DEBUG, "orinkit")
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server, RawClient(server.url) as client:
        for _ in range(500):
            assert client.ask(controller_execute.id, 9999, "x", None) == hresult.E_HANDLE
    refused = [record for record in caplog.records if record.name == "orinkit.session"]
    told = [record.getMessage() for record in refused if "similar messages suppressed" in record.getMessage()]
    assert len(refused) - len(told) == BURST
    assert len(told) == 1
    assert told[0].startswith("490 similar messages suppressed: ")


def test_clients_that_come_and_go_fill_no_log(caplog):
    caplog.set_level(logging.INFO, "orinkit.server")
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server:
        for _ in range(50):
            with RawClient(server.url) as client:
                client.ask(1, "")
    assert len([record for record in caplog.records if " connected" in record.getMessage()]) <= BURST + 1


def test_the_throttle_of_the_process_reports_from_a_thread_of_its_own(monkeypatch):
    monkeypatch.setattr(throttle_module, "INTERVAL", 0.01)
    said = Said()
    made = LogLimiter()
    logger = logging.getLogger("orinkit.test.thread")
    logger.addFilter(made)
    logger.addHandler(said)
    logger.setLevel(logging.INFO)
    try:
        until(lambda: logger.info("again") or any("suppressed" in line for line in said.lines))
    finally:
        logger.removeFilter(made)
        logger.removeHandler(said)
        made.forget()
    assert THROTTLE is not made
