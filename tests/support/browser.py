"""A Tester in a child process and a headless browser, for tests of the pages."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Self

import pytest

from support.waiting import PATIENCE

CHROMIUM: Final = shutil.which("chromium") or shutil.which("chromium-browser") or ""
needs_browser: Final = pytest.mark.skipif(
    not CHROMIUM, reason="Chromium is not installed. Try: apt-get install chromium, then make test"
)
ARGUMENTS: Final = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
)  # fmt: skip


@contextmanager
def open_browser() -> Iterator[Any]:
    """Yield a headless browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        yield browser
        browser.close()


class TesterProcess:
    """``orinkit tester`` in a child process.

    Args:
        *arguments: Further arguments, for example the addresses of controllers.
        folder: Directory for the user's configuration.
        http: Address to listen on.
        module: Module to run.

    Attributes:
        url: Address of the pages.
    """

    __test__ = False

    def __init__(self, *arguments: str, folder: Path, http: str = "127.0.0.1:0", module: str = "orinkit") -> None:
        environment = {**os.environ, "XDG_CONFIG_HOME": str(folder), "ORINKIT_LANG": "en", "PYTHONUNBUFFERED": "1"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", module, "tester", "--http", http, "--no-browser", *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True,
        )  # fmt: skip
        self.errors: list[str] = []
        self._reader = threading.Thread(target=self._read_errors, daemon=True)
        self._reader.start()
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line.startswith("ready "):
            self.__exit__()
            raise AssertionError(self.errors)
        self.url = line.split()[1]

    def _read_errors(self) -> None:
        assert self.process.stderr is not None
        self.errors.extend(self.process.stderr)

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Suspend the process inside the ``with`` block."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()


@contextmanager
def user(browser: Any, *, language: str = "en", **options: Any) -> Iterator[Any]:
    """Yield a page of a new user (own cookies), with a time-out for a busy machine."""
    context = browser.new_context(locale="ja-JP" if language == "ja" else "en-US", **options)
    context.set_default_timeout(PATIENCE * 1000)
    page = context.new_page()
    yield page
    context.close()
