from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest

import orinkit
from orinkit.cli.app import main
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Recorder
from support.waiting import until


class Done(NamedTuple):
    """The exit code and output of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Run = Callable[..., Done]


@pytest.fixture
def run(capsys) -> Run:
    """Run a command line in this process."""

    def run(*argv: str) -> Done:
        capsys.readouterr()
        code = main(argv)
        out, err = capsys.readouterr()
        return Done(code, out, err)

    return run


@pytest.fixture
def refused(run) -> Callable[..., str]:
    """Run a command line that must fail with one line on stderr, and return that line without the prefix."""

    def refused(*argv: str, code: int = 1) -> str:
        done = run(*argv)
        assert (done.code, done.out) == (code, "")
        assert done.err.startswith("orinkit: ")
        assert done.err.count("\n") == 1
        return done.err.removeprefix("orinkit: ").rstrip("\n")

    return refused


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(serial_no="SN-42", language="en")
    yield device
    device.close()


@pytest.fixture
def url(rc8) -> Iterator[str]:
    """The address of the served virtual RC8."""
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        yield server.url


@pytest.fixture(scope="module")
def recorder() -> Recorder:
    """A device that implements every function of the table."""
    return Recorder()


@pytest.fixture(scope="module")
def recorder_url(recorder) -> Iterator[str]:
    with orinkit.serve(recorder, "tcp://127.0.0.1:0") as server:
        yield server.url


@pytest.fixture
def program() -> list[str]:
    """The command that runs orinkit in a separate process."""
    return [sys.executable, "-m", "orinkit"]


@pytest.fixture
def when() -> Iterator[Callable[[Callable[[], object], Callable[[], object]], None]]:
    """Perform an action in another thread as soon as a condition is true."""
    threads: list[threading.Thread] = []

    def when(condition: Callable[[], object], act: Callable[[], object]) -> None:
        def wait() -> None:
            until(condition)
            act()

        threads.append(threading.Thread(target=wait))
        threads[-1].start()

    yield when
    for thread in threads:
        thread.join()
