"""Non-blocking output: order, dropped texts and errors."""

from __future__ import annotations

import io
import os
import threading
import time
from collections.abc import Iterator
from typing import TextIO

import pytest

from orinkit.core import background_writer as outlet_module
from orinkit.core.background_writer import BackgroundWriter
from support.waiting import PATIENCE, until


@pytest.fixture
def pipe() -> Iterator[tuple[int, TextIO]]:
    """Return the read end of a pipe and a stream that writes to it."""
    ours, theirs = os.pipe()
    with os.fdopen(theirs, "w", encoding="utf-8") as stream:
        yield ours, stream
    os.close(ours)


def read_available(pipe: int) -> bytes:
    """Return the bytes that a pipe contains at present."""
    try:
        return os.read(pipe, 1 << 20)
    except BlockingIOError:
        time.sleep(0.002)
        return b""


def outlets() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name == "orinkit-outlet"]


def test_texts_are_written_in_order(pipe, monkeypatch):
    monkeypatch.setattr(outlet_module, "_PATIENCE", PATIENCE)
    ours, stream = pipe
    outlet = BackgroundWriter(stream)
    for number in range(500):
        outlet.write(f"{number} 行\n")
    outlet.close()
    assert os.read(ours, 65536).decode() == "".join(f"{number} 行\n" for number in range(500))
    assert (outlet.dropped, outlet.error) == (0, None)
    assert not outlets()
    stream.write("still open")


def test_unread_texts_are_dropped_and_counted(pipe):
    ours, stream = pipe
    outlet = BackgroundWriter(stream)
    line = "x" * 999 + "\n"
    for _ in range(3000):
        outlet.write(line)
    outlet.close()
    assert outlet.dropped > 1500
    outlet.check()  # no error
    os.set_blocking(ours, False)
    read = 0
    while outlets() or read % 1000:  # until the text in progress is written
        read += len(read_available(ours))
    read += len(read_available(ours))
    assert read // 1000 + outlet.dropped in (2999, 3000)  # the text in progress may be counted as neither


def test_a_reader_that_closed_the_pipe(pipe):
    ours, stream = pipe
    outlet = BackgroundWriter(stream)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, ours)  # closes the read end of the pipe
    os.close(null)
    outlet.write("x")
    until(lambda: outlet.error)
    with pytest.raises(BrokenPipeError):
        outlet.check()
    outlet.write("y")
    outlet.close()
    assert not outlets()


def test_a_stream_without_a_descriptor_is_written_to_synchronously():
    text = io.StringIO()
    outlet = BackgroundWriter(text)
    assert outlet.write("now") == 3
    assert text.getvalue() == "now"
    assert not outlet.isatty()
    assert not outlets()
    outlet.close()


def test_without_a_stream():
    outlet = BackgroundWriter(None)
    assert outlet.write("nowhere") == 7
    outlet.flush()
    outlet.close()
    assert (outlet.isatty(), outlet.dropped, outlet.error, outlet.encoding) == (False, 0, None, "utf-8")
