"""The rate limit of the log, and its presence on every logger to which a client can cause records."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import orinkit
from orinkit.cao.functions import controller_execute
from orinkit.core import hresult, i18n
from orinkit.server import log_limiter as throttle_module
from orinkit.server.log_limiter import BURST, CLIENT, INTERVAL, LOG_LIMITER, LOGGERS, LogLimiter
from orinkit.virtual.rc8 import VirtualRC8
from support.peers import RawClient
from support.waiting import until

SOURCE = Path(orinkit.__file__).parent
OUT_OF_REACH = {
    "orinkit.providers",  # used during start-up only
    "orinkit.server.uvicorn",  # logs errors only
    "httpx2", "asyncio",
}  # fmt: skip


class Timer:
    """A replacement for the timer of the rate limiter, which a test can fire."""

    def __init__(self) -> None:
        self.waiting: list[Callable[[], None]] = []

    def __call__(self, seconds: float, function: Callable[[], None]) -> Timer:
        assert seconds == INTERVAL
        self.waiting.append(function)
        return self

    def cancel(self) -> None:
        self.waiting.clear()

    def fire(self) -> None:
        due, self.waiting = self.waiting, []
        for each in due:
            each()


class LogLines(logging.Handler):
    """A handler that stores the messages."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@pytest.fixture
def now() -> list[float]:
    return [1000.0]


@pytest.fixture
def timer() -> Timer:
    return Timer()


@pytest.fixture
def limiter(now, timer) -> LogLimiter:
    return LogLimiter(lambda: now[0], timer)


@pytest.fixture
def output(limiter) -> Iterator[LogLines]:
    logger = logging.getLogger("orinkit.test.throttle")
    handler = LogLines()
    logger.setLevel(logging.INFO)
    logger.addFilter(limiter)
    logger.addHandler(handler)
    yield handler
    logger.removeFilter(limiter)
    logger.removeHandler(handler)


def log(message: str = "%s failed", *arguments: object, client: str = "", **extra: object) -> None:
    before = CLIENT.set(client)
    logging.getLogger("orinkit.test.throttle").info(message, *arguments, extra=extra or None)
    CLIENT.reset(before)


def test_a_burst_then_one_message_in_ten_seconds_with_the_number_suppressed(output, now, timer):
    for number in range(4322):
        log("%s failed", number)
    assert output.lines == [f"{number} failed" for number in range(BURST)]
    output.lines.clear()
    now[0] += INTERVAL
    timer.fire()
    assert output.lines == ["4,312 similar messages suppressed: 9 failed"]
    for number in range(5):
        log("%s failed", number)
    assert output.lines[1:] == ["0 failed"]
    now[0] += INTERVAL
    timer.fire()
    assert output.lines[2:] == ["4 similar messages suppressed: 0 failed"]
    assert timer.waiting == []  # nothing more was suppressed


@pytest.mark.parametrize(
    ("language", "lines"),
    [
        ("en", ["1 similar message suppressed: 9 failed", "2 similar messages suppressed: 9 failed"]),
        ("ja", ["同様のメッセージ 1 件を省略しました: 9 failed", "同様のメッセージ 2 件を省略しました: 9 failed"]),
    ],
)
def test_one_suppressed_message_is_singular(output, now, timer, language, lines):
    before = i18n.current()
    i18n.use(language)
    try:
        for suppressed, line in enumerate(lines, start=1):
            output.lines.clear()
            for number in range(BURST + suppressed):
                log("%s failed", number)
            now[0] += INTERVAL
            timer.fire()
            assert output.lines[-1] == line
            now[0] += 100 * INTERVAL
    finally:
        i18n.use(before)


def test_a_quiet_period_restores_the_whole_burst(output, now, timer):
    for _ in range(2 * BURST):
        log("again")
    timer.fire()
    output.lines.clear()
    now[0] += 100 * BURST * INTERVAL
    for _ in range(2 * BURST):
        log("again")
    assert output.lines == ["again"] * BURST


def test_clients_messages_and_kinds_count_separately(output):
    for _ in range(2 * BURST):
        log("%s failed", 1, client="10.0.0.1")
        log("%s failed", 2, client="10.0.0.2")
        log("%s went", 3, client="10.0.0.2")
        log("%s failed", 4, client="10.0.0.2", kind="Robot_Move")
    assert {line: output.lines.count(line) for line in output.lines} == dict.fromkeys(
        ("1 failed", "2 failed", "3 went", "4 failed"), BURST
    )


def test_the_memory_and_the_log_of_many_addresses_are_bounded(output, limiter, now, timer):
    for number in range(5000):
        for _ in range(BURST + 1):
            log("failed", client=f"10.{number >> 8}.{number & 255}.1")
    assert len(limiter._counts) <= 1025
    assert len(output.lines) <= 1025 * BURST
    output.lines.clear()
    timer.fire()
    suppressed = sum(int(line.split()[0].replace(",", "")) for line in output.lines)
    assert suppressed == 5000 * (BURST + 1) - 1025 * BURST
    now[0] += 1000 * INTERVAL  # all of them have been quiet: there is room for others
    output.lines.clear()
    log("failed", client="192.168.0.1")
    assert output.lines == ["failed"]
    assert len(limiter._counts) <= 1025


def test_a_record_with_wrong_arguments_is_left_to_its_handler(output):
    logging.getLogger("orinkit.test.throttle").removeHandler(output)
    previous, logging.raiseExceptions = logging.raiseExceptions, False
    try:
        log("%d of %d", 1)
    finally:
        logging.raiseExceptions = previous


def test_every_logger_of_a_server_is_limited():
    pattern = re.compile(r'getLogger\("([a-z0-9_.]+)"\)')
    inside = ("server", "cao", "bcap", "ecap", "virtual", "gateway", "device", "rc8")
    found = {
        name
        for path in SOURCE.rglob("*.py")
        if path.relative_to(SOURCE).parts[0] in inside
        for name in pattern.findall(path.read_text("utf-8"))
    }
    assert found - OUT_OF_REACH == set(LOGGERS)


def test_a_client_that_is_refused_repeatedly_does_not_fill_the_log(caplog):
    caplog.set_level(logging.DEBUG, "orinkit")
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server, RawClient(server.url) as client:
        for _ in range(500):
            assert client.ask(controller_execute.id, 9999, "x", None) == hresult.E_HANDLE
    refused = [record for record in caplog.records if record.name == "orinkit.session"]
    summaries = [record.getMessage() for record in refused if "similar messages suppressed" in record.getMessage()]
    assert len(refused) - len(summaries) == BURST
    assert len(summaries) == 1
    assert summaries[0].startswith("490 similar messages suppressed: ")


def test_clients_that_connect_and_disconnect_do_not_fill_the_log(caplog):
    caplog.set_level(logging.INFO, "orinkit.server")
    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server:
        for _ in range(50):
            with RawClient(server.url) as client:
                client.ask(1, "")
    assert len([record for record in caplog.records if " connected" in record.getMessage()]) <= BURST + 1


def test_the_limiter_of_the_process_reports_from_its_own_thread(monkeypatch):
    monkeypatch.setattr(throttle_module, "INTERVAL", 0.01)
    output = LogLines()
    created = LogLimiter()
    logger = logging.getLogger("orinkit.test.thread")
    logger.addFilter(created)
    logger.addHandler(output)
    logger.setLevel(logging.INFO)
    try:
        until(lambda: logger.info("again") or any("suppressed" in line for line in output.lines))
    finally:
        logger.removeFilter(created)
        logger.removeHandler(output)
        created.forget()
    assert LOG_LIMITER is not created
