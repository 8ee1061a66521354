"""Two network namespaces with a cable between them that can be unplugged (Linux, as root).

A thread that has entered a namespace stays in it, and so do the threads that it starts: a server started from within
:meth:`Cable.at_one_end` listens in that namespace only.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import pytest

T = TypeVar("T")
_NEW_NETWORK = 0x40000000  # CLONE_NEWNET
ADDRESSES = ("10.199.7.1", "10.199.7.2")


class Cable:
    """A cable between two namespaces, called ``names``."""

    def __init__(self) -> None:
        self.names = (f"orinkit-{os.getpid()}-a", f"orinkit-{os.getpid()}-b")
        near, far = self.names
        for name in self.names:
            _ip("netns", "add", name)
        _ip("-n", near, "link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", far)
        for name, address in zip(self.names, ADDRESSES, strict=True):
            _ip("-n", name, "addr", "add", f"{address}/24", "dev", "cable")
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "link", "set", "cable", "up")

    def pull(self) -> None:
        """Unplug the far end."""
        _ip("-n", self.names[1], "link", "set", "cable", "down")

    def at_one_end(self, make: Callable[[], T]) -> T:
        """Call a function in the near namespace and return its result."""
        outcome: list[T] = []
        failure: list[BaseException] = []

        def run() -> None:
            try:
                libc = ctypes.CDLL(None, use_errno=True)
                with Path(f"/var/run/netns/{self.names[0]}").open() as file:
                    if libc.setns(file.fileno(), _NEW_NETWORK):
                        raise OSError(ctypes.get_errno(), "setns")
                outcome.append(make())
            except BaseException as error:  # noqa: BLE001 - raised below
                failure.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        thread.join()
        if failure:
            raise failure[0]
        return outcome[0]

    def far_program(self, program: str, *arguments: str) -> subprocess.Popen[str]:
        """Start a Python program in the far namespace."""
        return subprocess.Popen(
            ["ip", "netns", "exec", self.names[1], sys.executable, "-c", program, *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def close(self) -> None:
        """Remove both namespaces and the cable."""
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


@contextmanager
def cable() -> Iterator[Cable]:
    """Provide a cable, or skip the test if that is not possible."""
    if not sys.platform.startswith("linux") or os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need Linux, root and ip (iproute2)")
    made: Cable | None = None
    try:
        made = Cable()
    except subprocess.CalledProcessError as error:
        pytest.skip(f"network namespaces are not available: {error.stderr.strip()}")
    try:
        yield made
    finally:
        made.close()


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)
