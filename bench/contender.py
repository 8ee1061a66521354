"""A process of the round trips: ``python bench/contender.py {sync,asyncio,uvloop} PORT``, for bench/natural.py.

The process first prints its actions and the state of the C extension as JSON. For each line "ACTIONS COUNT INTERVAL" of
its standard input, it performs some actions in turn, COUNT times each, one action every INTERVAL ns (0: back to back), and
prints the durations in ns. Each action has a connection of its own.
"""

from __future__ import annotations

import asyncio
import importlib
import json
import socket
import struct
import sys
import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, cast

import orinkit
from measuring import on_core
from orinkit import aio, functions
from orinkit.bcap import packet
from orinkit.bcap.requests import request_template
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS
from packets import ARGUMENTS, POSE, REPLY, REQUEST, VALUE, encode_request

PREPARE = "prepare"
BATCH = 200  # number of encodings or decodings that one sample contains
HOST = "127.0.0.1"
RESULT = struct.Struct("<8d")
clock = time.perf_counter_ns


def extension() -> str:
    """Return whether the C extension is in use: "in use", "off" or "absent"."""
    try:
        speedups: Any = importlib.import_module("orinkit.core.speedups")
    except ImportError:
        return "absent"
    if speedups.EXTENSION is not None:
        return "in use"
    try:
        importlib.import_module("orinkit.core._speedups")
    except ImportError:
        return "absent"
    return "off"


def bare_socket(port: int) -> Callable[[], object]:
    """Return an exchange over a plain socket."""
    peer = socket.create_connection((HOST, port))
    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    send, receive = peer.sendall, peer.recv

    def exchange() -> None:
        send(REQUEST)
        receive(65536)

    return exchange


def natural(connection: Any) -> dict[str, Callable[[], Any]]:
    """Return what programs call, on one connection: functions in Python, as in programs."""
    robot, variable = connection.robot(), connection.variable("D1")
    found: dict[str, Callable[[], Any]] = {
        "execute": lambda: robot.execute("slvMove", POSE),
        "read a variable": lambda: variable.value,
        "write a variable": lambda: setattr(variable, "value", VALUE),
    }
    if hasattr(robot, PREPARE):
        slv_move = robot.prepare("slvMove")
        found["prepared"] = lambda: slv_move(POSE)
    return found


def synchronous(port: int) -> dict[str, Callable[[], object]]:
    """Return the actions of the synchronous client."""
    url = f"tcp://{HOST}:{port}"
    client = orinkit.open_client(url)
    body, end = packet.HEADER.size, len(REPLY) - 1
    return {
        "bare": bare_socket(port),
        "call": partial(client.call, functions.robot_execute, *ARGUMENTS),
        **natural(orinkit.connect(url)),
        "encode": partial(repeated, partial(encode_request, functions.robot_execute, ARGUMENTS, 1)),
        "encode prepared": partial(repeated, partial(prepared_packet(), 1, POSE)),
        "decode": partial(repeated, partial(codec.decode, REPLY, body, end)),
    }


def prepared_packet() -> Callable[[int, Any], object]:
    """Return the function that creates the packets of ``robot.execute("slvMove", pose)``."""
    template = request_template(functions.robot_execute, ARGUMENTS[:2], DEFAULT_LIMITS.packet)
    assert template is not None
    return template.request


def repeated(action: Callable[[], object]) -> None:
    """Perform an action without I/O many times."""
    for _ in range(BATCH):
        action()


class BareProtocol(asyncio.BufferedProtocol):
    """An exchange in asyncio: a transport, and a future for the reply.

    With a buffer of its own, it is faster than ``asyncio.Protocol``, for which asyncio allocates 256 KiB for each reply.
    """

    reply: asyncio.Future[bytes]
    transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self.transport = cast("asyncio.Transport", transport)  # uvloop's class is not a subclass of it
        self._loop = asyncio.get_running_loop()
        self._buffer = bytearray(65536)

    def get_buffer(self, sizehint: int) -> bytearray:
        """Return the buffer for the next data."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Set the result of the future."""
        self.reply.set_result(bytes(self._buffer[:nbytes]))

    async def exchange(self) -> bytes:
        """Send a request and wait for the reply."""
        self.reply = self._loop.create_future()
        self.transport.write(REQUEST)
        return await self.reply


async def asynchronous(port: int) -> dict[str, Callable[[], Awaitable[object]]]:
    """Return the actions of the asyncio client."""
    url = f"tcp://{HOST}:{port}"
    _, protocol = await asyncio.get_running_loop().create_connection(BareProtocol, HOST, port)
    client = await aio.open_client(url)
    connection = await aio.connect(url)
    robot, variable = await connection.robot(), await connection.variable("D1")
    found: dict[str, Callable[[], Awaitable[object]]] = {
        "bare": protocol.exchange,
        "call": partial(client.call, functions.robot_execute, *ARGUMENTS),
        "execute": partial(robot.execute, "slvMove", POSE),
        "read a variable": variable.get_value,
        "write a variable": partial(variable.put_value, VALUE),
    }
    if hasattr(robot, PREPARE):
        found["prepared"] = partial(getattr(robot, PREPARE)("slvMove"), POSE)
    return found


def run(actions: list[Callable[[], object]], count: int, interval: int) -> list[int]:
    """Perform actions in turn, repeatedly; return the durations in ns."""
    samples = []
    due = clock()
    for action in actions * count:
        if interval:
            time.sleep(max(0, due - clock()) / 1e9)
            due += interval
        begin = clock()
        action()
        samples.append(clock() - begin)
    return samples


async def arun(actions: list[Callable[[], Awaitable[object]]], count: int, interval: int) -> list[int]:
    """Perform actions in turn, repeatedly, in asyncio; return the durations in ns."""
    samples = []
    due = clock()
    for action in actions * count:
        if interval:
            await asyncio.sleep(max(0, due - clock()) / 1e9)
            due += interval
        begin = clock()
        await action()
        samples.append(clock() - begin)
    return samples


def obey(names: list[str], perform: Callable[[list[str], int, int], list[int]]) -> None:
    """Print the state, then execute the commands of the standard input until it ends."""
    print(json.dumps({"actions": names, "extension": extension()}), flush=True)
    for line in sys.stdin:
        chosen, count, interval = json.loads(line)
        samples = perform(chosen, count, interval)
        if chosen[0] in ("encode", "encode prepared", "decode"):
            samples = [round(each / BATCH) for each in samples]
        print(*samples, flush=True)


def main() -> None:
    """Run the process."""
    kind, port = sys.argv[1], int(sys.argv[2])
    on_core(0)
    if kind == "sync":
        actions = synchronous(port)
        obey(list(actions), lambda chosen, *how: run([actions[each] for each in chosen], *how))
        return
    new_loop = importlib.import_module("uvloop").new_event_loop if kind == "uvloop" else None
    with asyncio.Runner(loop_factory=new_loop) as runner:
        found = runner.run(asynchronous(port))
        obey(list(found), lambda chosen, *how: runner.run(arun([found[each] for each in chosen], *how)))


if __name__ == "__main__":
    main()
