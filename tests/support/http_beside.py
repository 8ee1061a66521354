"""The environment of the garbage tests: a server, correct clients, clients that never finish, and a check for leaks."""

from __future__ import annotations

import asyncio
import gc
import http.client
import logging
import re
import threading
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, NamedTuple, Self

import orinkit
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.provider import CaoObject
from orinkit.cao.session import Session
from orinkit.server.log_limiter import LOG_LIMITER
from orinkit.server.threaded import Server
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Recorder, Workshop
from support.http_garbage import FORM
from support.waiting import PATIENCE, until

IDLE = 3.0  # s
DESCRIPTORS = Path("/proc/self/fd")
SLOW_HEADERS, SILENT, HALF_BODIES = 250, 125, 75


class Served(NamedTuple):
    """A server over HTTP and TCP, and its providers."""

    server: Server
    rc8: VirtualRC8
    recorder: Recorder
    workshop: Workshop

    @property
    def address(self) -> tuple[str, int]:
        return place(self.server)


def place(server: Server) -> tuple[str, int]:
    """Return the host and port of the first address of a server."""
    return "127.0.0.1", int(server.urls[0].rstrip("/").rpartition(":")[2])


class Neighbour:
    """A client that writes and reads its variable continuously."""

    def __init__(self, url: str, variable: str, cafile: str = "") -> None:
        self.turns = 0
        self.error: BaseException | None = None
        self._url = url
        self._cafile = cafile
        self._variable = variable
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        try:
            with orinkit.connect(self._url, timeout=PATIENCE, cafile=self._cafile) as controller:
                variable = controller.variable(self._variable)
                while not self._stop.is_set():
                    variable.value = f"turn {self.turns}"
                    assert variable.value == f"turn {self.turns}"
                    self.turns += 1
                    self._stop.wait(0.002)  # yields the CPU to the others
                assert controller.client.stray_replies == 0
        except BaseException as error:  # noqa: BLE001 - checked by the test
            self.error = error

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


class Guest:
    """A raw client that gets handles of all objects. Without a cookie, its session is identified by its IP address."""

    def __init__(self, address: tuple[str, int], *, keeps_cookie: bool) -> None:
        self.cookie = b""
        self.handles: dict[str, list[int]] = {}
        self._connection = http.client.HTTPConnection(*address, timeout=PATIENCE)
        try:
            self._call(1, "InvokeTimeout=200" if keeps_cookie else "", keep=keeps_cookie)
            self._make("Workshop", 3, "", "Test.Workshop", "", "")
            for provider in ("CaoProv.DENSO.VRC", "Test.Recorder"):
                self._open(provider)
        finally:
            self._connection.close()

    def _open(self, provider: str) -> None:
        controller = self._make("Controller", 3, "", provider, "localhost", "")
        if not controller:
            return
        for entry in FUNCTIONS.values():
            if entry.interface == "Controller" and entry.creates and entry.creates != "Controller":
                name = {"Variable": "IO150", "Task": "Pro1"}.get(entry.creates, "")
                self._make(entry.creates, entry.id, controller, *([name, ""] if len(entry.arguments) > 1 else []))

    def _make(self, interface: str, function: int, *arguments: object) -> int:
        match = re.fullmatch(r"0x00000000,3,([0-9]+)", self._call(function, *arguments))
        if match:
            self.handles.setdefault(interface, []).append(int(match[1]))
        return int(match[1]) if match else 0

    def _call(self, function: int, *arguments: object, keep: bool = False) -> str:
        fields = "".join(f"&Arg{number}={value}" for number, value in enumerate(arguments, 1))
        headers = {"Content-Type": FORM.decode(), **({"Cookie": self.cookie.decode()} if self.cookie else {})}
        self._connection.request("POST", "/", f"Func={function}{fields}", headers)
        reply = self._connection.getresponse()
        if keep:
            self.cookie = (reply.getheader("Set-Cookie") or "").partition(";")[0].encode()
        return reply.read().decode()


# --- leaks ------------------------------------------------------------------------------------------------------------


def alive() -> dict[int, object]:
    """Return every session, object and task, and all other objects of the server."""
    gc.collect()
    found: dict[int, object] = {}
    for thing in gc.get_objects():
        kind = type(thing)
        ours = isinstance(thing, Session | CaoObject) or str(kind.__module__).startswith(
            ("orinkit.server.", "uvicorn.protocols", "starlette.")
        )
        if ours or (isinstance(thing, asyncio.Task | asyncio.TimerHandle) and not _over(thing)):
            found[id(thing)] = thing
    return found


def _over(thing: Any) -> bool:
    return bool(thing.cancelled() if isinstance(thing, asyncio.TimerHandle) else thing.done())


def counted() -> tuple[int, int]:
    """Return the numbers of threads and descriptors."""
    return threading.active_count(), len(list(DESCRIPTORS.iterdir())) if DESCRIPTORS.exists() else 0


def quiet(server: Server) -> tuple[dict[int, object], tuple[int, int]]:
    """Wait until every client has disconnected and nothing changes any more; return the objects and counts of then."""
    pause = threading.Event()
    _wait_for_clients(server)
    gc.collect()  # remains of earlier tests
    same, numbers = 0, counted()
    while same < 5:
        pause.wait(0.05)
        same, numbers = (same + 1 if counted() == numbers else 0), counted()
    return alive(), numbers


_TRANSIENT = ("orinkit-worker", "orinkit-large", "orinkit-disk", "orinkit-planning", "orinkit-compiling")
"""Names of the threads that exist only while there is work."""


def settled(
    server: Server, before: dict[int, object], numbers: tuple[int, int]
) -> tuple[list[object], tuple[int, int]]:
    """Wait until every client has disconnected and nothing is left; return the leaked objects and the counts."""
    pause = threading.Event()
    _wait_for_clients(server)
    end = time.monotonic() + PATIENCE
    while True:
        left = [thing for key, thing in alive().items() if key not in before]
        if (not left and counted() == numbers) or time.monotonic() > end:
            return left, counted()
        del left  # it would keep referenced objects alive
        pause.wait(0.05)


def _wait_for_clients(server: Server) -> None:
    """Wait until the server has noticed that every client has disconnected and has finished all calls."""
    context = server._server._context
    until(lambda: not (context.open or context.all or context.opening or context.tasks), IDLE + PATIENCE)
    LOG_LIMITER.forget()  # it intentionally remembers what was logged
    until(lambda: not any(thread.name in _TRANSIENT for thread in threading.enumerate()))


class Breaks(logging.Filter):
    """Removes the exceptions of the workshop from the log, because their tracebacks keep objects alive.

    Attributes:
        count: the number of records removed.
    """

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def filter(self, record: logging.LogRecord) -> bool:
        raised = record.exc_info[1] if record.exc_info else None
        wanted = isinstance(raised, ZeroDivisionError) or str(raised) == "the device is broken"
        wanted = wanted and record.getMessage() == "Controller_Execute: the device raised an exception"
        self.count += wanted
        return not wanted


# --- clients that never finish a request ------------------------------------------------------------------------------


class Crowd:
    """Connections that occupy the server: a fixed number of each kind, opened again after the server has closed them.

    Attributes:
        there: the number of open connections.
        closed: the number of connections that the server has closed, by status line.
    """

    def __init__(self, address: tuple[str, int]) -> None:
        self.there = 0
        self.closed: Counter[str] = Counter()
        self._address = address
        self._enough = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True)

    async def _run(self) -> None:
        async with asyncio.TaskGroup() as group:
            for kind, count in (
                (self._slow_header, SLOW_HEADERS),
                (self._silent, SILENT),
                (self._half_body, HALF_BODIES),
            ):
                for _ in range(count):
                    await asyncio.sleep(0.001)  # the backlog of the system holds a few hundred while the server is busy
                    group.create_task(self._again_and_again(kind))

    async def _again_and_again(self, kind: Callable[[asyncio.StreamWriter], Awaitable[None]]) -> None:
        while not self._enough.is_set():
            reader, writer = await asyncio.open_connection(*self._address)
            self.there += 1
            sending = asyncio.create_task(self._send(kind, writer))
            try:
                said = await reader.read()
            except ConnectionResetError:
                said = b""
            self.there -= 1
            self.closed[said.decode().partition("\r\n")[0]] += 1
            sending.cancel()
            writer.close()
            await asyncio.wait((sending,))
            await asyncio.sleep(0.5)

    async def _send(
        self, kind: Callable[[asyncio.StreamWriter], Awaitable[None]], writer: asyncio.StreamWriter
    ) -> None:
        try:
            await kind(writer)
        except ConnectionError:
            pass

    async def _slow_header(self, writer: asyncio.StreamWriter) -> None:
        for letter in b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"x" * 1000:
            writer.write(bytes([letter]))
            await writer.drain()
            await asyncio.sleep(0.5)

    async def _silent(self, writer: asyncio.StreamWriter) -> None:
        """Send nothing except a letter at the very end: the system may hide a connection that did not fit into the backlog."""
        while not self._enough.is_set():  # noqa: ASYNC110 - a thread sets it
            await asyncio.sleep(0.5)
        await asyncio.sleep(15.0)  # by then, the server has closed it
        writer.write(b"P")
        await writer.drain()

    async def _half_body(self, writer: asyncio.StreamWriter) -> None:
        writer.write(b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n" + b"x" * 500)
        await writer.drain()

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition is true."""
        pause = threading.Event()
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, (self.there, self.closed)
            pause.wait(0.02)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Wait until the server has closed all connections; none is opened again."""
        self._enough.set()
        self._thread.join(60.0)
        assert not self._thread.is_alive(), self.there
