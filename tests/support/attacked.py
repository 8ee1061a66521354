"""A virtual RC8 served by a separate program whose log is not read, and programs that attack it."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import orinkit
from orinkit.virtual.rc8.control import PROVIDER_NAME

TOKEN = "a-token-that-is-long-enough"
PATIENT = 60.0
HERE = Path(__file__).parent


@dataclass
class Served:
    """The program and the addresses at which it listens."""

    process: subprocess.Popen[str]
    bcap: str
    http: str
    control: str
    secret_file: Path

    def connect(self, **options: Any) -> orinkit.Controller:
        return orinkit.connect(self.bcap, **{"timeout": PATIENT, **options})

    def pendant(self) -> orinkit.Controller:
        secret = self.secret_file.read_text(encoding="utf-8").strip()
        return orinkit.connect(self.control, provider=PROVIDER_NAME, option=f"Secret={secret}", timeout=PATIENT)

    @property
    def ports(self) -> tuple[int, ...]:
        """The ports of b-CAP, e-CAP and the control port."""
        return tuple(urlsplit(url).port or 0 for url in (self.bcap, self.http, self.control))

    def figures(self) -> tuple[int, int, int]:
        """Return resident memory in KiB, descriptors and threads of the program."""
        proc = Path(f"/proc/{self.process.pid}")
        status = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
        return int(status["VmRSS"].split()[0]), len(list((proc / "fd").iterdir())), int(status["Threads"])


@contextmanager
def served(folder: Path, *options: str) -> Iterator[Served]:
    """Serve a virtual RC8 on b-CAP, e-CAP with a token, and a control port; its stderr is not read."""
    token_file, secret_file = folder / "token", folder / "secret"
    for file, secret in ((token_file, TOKEN), (secret_file, "pendant-of-the-attack-tests")):
        file.touch(mode=0o600)
        file.write_text(secret, encoding="utf-8")
    listeners = ["--tcp", "127.0.0.1:0", "--http", "127.0.0.1:0", "--token-file", str(token_file)]
    control = ["--control", "127.0.0.1:0", "--control-secret-file", str(secret_file)]
    process = subprocess.Popen(
        [sys.executable, "-m", "orinkit", "serve", "rc8", *listeners, *control, "--motor-on", *options],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
    )  # fmt: skip
    try:
        assert process.stdout is not None
        urls: list[str] = []
        while len(urls) < 3:
            line = process.stdout.readline()
            assert line
            if line.startswith("ready"):
                urls.append(line.split()[-1])
        bcap, http, control_url = urls
        yield Served(process, bcap, http, control_url, secret_file)
    finally:
        process.terminate()
        try:
            process.communicate(timeout=PATIENT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


@dataclass
class Attackers:
    """Programs that attack a server for the duration of a ``with`` block."""

    served: Served
    names: tuple[str, ...]
    did: dict[str, Any] = field(default_factory=dict)

    def __enter__(self) -> Self:
        ports = [str(port) for port in self.served.ports]
        self._programs = [
            subprocess.Popen(
                [sys.executable, str(HERE / "attackers.py"), name, *ports],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )
            for name in self.names
        ]  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        for name, program in zip(self.names, self._programs, strict=True):
            try:
                out, _err = program.communicate("", timeout=PATIENT)
                self.did[name] = json.loads(out or "{}")
            except (subprocess.TimeoutExpired, ValueError):
                program.kill()
                program.communicate()


class Crowd:
    """Ordinary clients that read and write variables continuously, at the pace of a normal program."""

    def __init__(self, served: Served, count: int, pause: float = 0.1) -> None:
        self._served = served
        self._pause = pause
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=self._run, args=(number,)) for number in range(count)]
        self.calls = 0
        self.errors: list[BaseException] = []
        self.slowest = 0.0

    def __enter__(self) -> Self:
        for each in self._threads:
            each.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for each in self._threads:
            each.join(PATIENT)

    def _run(self, number: int) -> None:
        try:
            with self._served.connect() as controller:
                variable = controller.variable(f"I{number + 1}")
                value = 0
                while not self._ended.wait(self._pause):
                    value += 1
                    began = time.monotonic()
                    variable.value = value
                    assert variable.value == value  # no other client writes this one: an acknowledged write persists
                    self.slowest = max(self.slowest, time.monotonic() - began)
                    self.calls += 2
        except BaseException as error:  # noqa: BLE001 - reported by the test
            self.errors.append(error)
