"""Log records on stderr: logging does not block, dropped records are counted, control characters are escaped."""

from __future__ import annotations

import io
import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from orinkit.core import logs
from orinkit.core.logs import BoundedQueueHandler
from support.waiting import until

PROGRAM = """
import logging, sys
from orinkit.core import logs
logs.to_stderr()
for number in range(20000):
    logging.getLogger("orinkit.test").info("record %d", number)
print(logging.getLogger().handlers[0].dropped, flush=True)
"""


@pytest.fixture
def logger() -> Iterator[logging.Logger]:
    made = logging.getLogger("orinkit.test.logs")
    made.propagate = False
    made.setLevel(logging.INFO)
    yield made
    for handler in list(made.handlers):
        made.removeHandler(handler)
        handler.close()


def text_of(logger: logging.Logger) -> io.StringIO:
    stream = io.StringIO()
    logger.addHandler(BoundedQueueHandler(stream))
    return stream


def test_a_program_continues_and_ends_if_its_stderr_is_not_read():
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert program.stdout is not None
    with program.stdout:
        dropped = int(program.stdout.readline())
    assert program.wait(30) == 0
    assert 10000 < dropped < 20000
    assert program.stderr is not None
    with program.stderr:
        lines = program.stderr.read().splitlines()
    assert lines[0].endswith("INFO orinkit.test: record 0")


def test_dropped_records_are_reported_when_there_is_room_again(logger):
    ours, theirs = os.pipe()
    with os.fdopen(ours) as reader, os.fdopen(theirs, "w") as stream:
        handler = BoundedQueueHandler(stream)
        logger.addHandler(handler)
        while handler.dropped < 7:
            logger.warning("%s", "x" * 1000)
        stream.close()
        logger.removeHandler(handler)
        read = [reader.readline() for _ in range(1000)]
        handler.close()  # writes the remaining records
        read += reader.readlines()
    notices = [line for line in read if not line.startswith("x")]
    assert notices == ["orinkit: 7 log records were dropped because stderr was not read fast enough\n"]


def test_a_full_queue_does_not_block(logger):
    ours, theirs = os.pipe()
    try:
        with os.fdopen(theirs, "w") as stream:
            handler = BoundedQueueHandler(stream)
            logger.addHandler(handler)
            for _ in range(5000):
                logger.warning("%s", "x" * 1000)
            until(lambda: handler.dropped > 0)
            began = time.monotonic()
            handler.close()  # the pipe is never read
            assert time.monotonic() - began < 20
            logger.removeHandler(handler)
    finally:
        os.close(ours)


def test_external_text_is_shortened_before_it_is_formatted(logger):
    stream = text_of(logger)
    before = time.process_time()
    logger.info("%s is %r", "\x1b" * 16_000_000, 5)
    assert time.process_time() - before < 1
    assert len(stream.getvalue()) < 5 * logs.LONGEST


def test_the_middle_of_a_long_record_is_omitted(logger):
    stream = text_of(logger)
    try:
        _deep(400)
    except ValueError:
        logger.exception("deep")
    text = stream.getvalue()
    assert text.startswith("deep\nTraceback")
    assert "\n...\n" in text
    assert text.endswith("ValueError: the end\n")
    assert len(text) <= logs.LONGEST + 10


def _deep(number: int) -> None:
    if not number:
        raise ValueError("the end")
    _other(number - 1)  # alternate two functions: a traceback abbreviates direct recursion


def _other(number: int) -> None:
    _deep(number)


def test_control_characters_are_escaped(logger):
    stream = text_of(logger)
    logger.info("%s", "\x1b[2J\r bell\a\nsecond line")
    assert stream.getvalue() == "\\x1b[2J\\r bell\\x07\nsecond line\n"


def test_arguments_that_do_not_fit_the_format_are_reported_in_one_line(logger):
    stream = text_of(logger)
    record = logger.makeRecord(logger.name, logging.INFO, __file__, 1, "%d of %d", (1,), None)
    logger.handlers[-1].handle(record)
    assert stream.getvalue() == "orinkit.test.logs: %d of %d: TypeError\n"


def test_an_existing_log_configuration_is_kept(monkeypatch):
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [logging.NullHandler()])
    logs.to_stderr()
    assert [type(handler) for handler in root.handlers] == [logging.NullHandler]


def test_the_notice_is_in_japanese_too():
    from orinkit.core import i18n

    i18n.use("ja")
    assert "1,234 件" in logs._notice(1234)
