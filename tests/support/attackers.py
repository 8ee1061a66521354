"""Attacks on a server, each a separate program: ``python attackers.py NAME B-CAP-PORT HTTP-PORT CONTROL-PORT``.

They run until stdin is closed and then print the number of their operations, as JSON. They have a lower priority than the
server, because real attackers run on other machines.
"""

from __future__ import annotations

import json
import os
import random
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from decimal import Decimal
from itertools import count, cycle
from typing import Any

from orinkit.bcap.packet import pack
from orinkit.values.codec import encode_variant
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType

HOST = "127.0.0.1"
MEGA = 1 << 20
_NICE = 10
_PATIENCE = 5.0  # s to wait for a reply


class Done(threading.Event):
    """An event that ends the attack; counts the operations."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: dict[str, int] = {}

    def count(self, what: str, number: int = 1) -> None:
        self.counts[what] = self.counts.get(what, 0) + number


def connected(port: int) -> socket.socket:
    opened = socket.create_connection((HOST, port), timeout=_PATIENCE)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return opened


def packet(serial: int, function: int, *arguments: Variant) -> bytes:
    return pack(serial, function, len(arguments), b"".join(map(encode_variant, arguments)))


def answer(link: socket.socket) -> bytes:
    """Return one packet; raises ConnectionError if the server has closed the connection."""
    head = receive(link, 5)
    (length,) = struct.unpack_from("<I", head, 1)
    return head + receive(link, length - 5)


def receive(link: socket.socket, size: int) -> bytes:
    parts = bytearray()
    while len(parts) < size:
        part = link.recv(min(size - len(parts), 1 << 16))
        if not part:
            raise ConnectionError
        parts += part
    return bytes(parts)


def text(value: str) -> Variant:
    return Variant(VarType.BSTR, value)


def serials() -> Iterator[int]:
    return cycle(range(1, 65536))


# --- the attacks ------------------------------------------------------------------------------------------------------


def refused_calls(done: Done, bcap: int, *_: int) -> None:
    """Send calls that are refused and logged, as fast as the server replies (row 2)."""
    names = ["\x1b[31mnobody" * 20, "日本語" * 100, "\n" * 300]
    while not done.is_set():
        try:
            with connected(bcap) as link:
                for serial in serials():
                    if done.is_set():
                        return
                    name = text(random.choice(names))
                    link.sendall(packet(serial, 3, text("x"), name, text(""), text("")))  # no such provider
                    answer(link)
                    done.count("refused")
        except OSError:
            done.count("disconnected")
            done.wait(0.05)


def large_packets(done: Done, bcap: int, http: int, *_: int) -> None:
    """Send packets that are expensive to read, log or answer (row 3)."""
    dates = Variant(int(VarType.DATE) | ARRAY, [45000.5] * 50_000)
    nested = Variant(VARIANT_ARRAY, [Variant(VARIANT_ARRAY, [Variant(VarType.CY, Decimal(1))] * 1000)] * 40)
    bodies = [
        packet(1, 3, text(""), text("\x01" * (7 * MEGA)), text(""), text("")),
        packet(1, 3, *[dates] * 5),
        packet(1, 20, Variant(VarType.I4, 2), nested),
        packet(1, 3, *[Variant(int(VarType.BSTR) | ARRAY, ["x"] * 50_000)] * 4),
        packet(1, 3, *[Variant(int(VarType.BOOL) | ARRAY, [True] * 500_000)] * 4),
        packet(1, 3, *[Variant(int(VarType.UI1) | ARRAY, bytes(3 * MEGA))] * 4),
    ]
    commas = b"," * (15 * MEGA)
    head = (
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/x-www-form-urlencoded\r\n"
        b"Authorization: Bearer wrong-but-long-enough\r\nContent-Length: %d\r\n\r\n" % len(commas)
    )
    for turn in count():
        if done.is_set():
            return
        try:
            if turn % 7 == 6:
                with connected(http) as link:
                    link.sendall(head + commas)
                    link.recv(1024)
            else:
                with connected(bcap) as link:
                    link.sendall(bodies[turn % 7])
                    answer(link)
            done.count("large")
        except OSError:
            done.count("disconnected")
            done.wait(0.01)


def silent_connections(done: Done, bcap: int, http: int, *_: int) -> None:
    """Open connections that send nothing, and replace those that the server closes (row 7)."""
    open_now: list[socket.socket] = []
    while not done.is_set():
        try:
            open_now.append(connected(bcap if len(open_now) % 4 else http))
            done.count("silent")
        except OSError:
            done.count("refused")
            done.wait(0.05)
        if len(open_now) >= 300:
            done.wait(0.1)
            open_now = [link for link in open_now if alive(link)]


def alive(link: socket.socket) -> bool:
    try:
        if link.recv(1024, socket.MSG_DONTWAIT):
            return True
    except BlockingIOError:
        return True
    except OSError:
        pass
    link.close()
    return False


def token_guesses(done: Done, _: int, http: int, *__: int) -> None:
    """Guess the token, as fast as the server replies (row 10)."""
    while not done.is_set():
        try:
            with connected(http) as link:
                for number in count():
                    if done.is_set():
                        return
                    link.sendall(
                        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/x-www-form-urlencoded\r\n"
                        b"Authorization: Bearer guess%d\r\nContent-Length: 6\r\n\r\nFunc=1" % number
                    )
                    if not link.recv(4096):
                        break
                    done.count("guesses")
        except OSError:
            done.count("disconnected")
            done.wait(0.05)


def web_pages(done: Done, bcap: int, *_: int) -> None:
    """Send what a browser sends for a page of another site: a POST whose body contains packets (row 1)."""
    body = packet(1, 1, text("")) + packet(2, 3, text("x"), text("CaoProv.DENSO.VRC"), text("localhost"), text(""))
    request = (
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://evil.example\r\nContent-Type: text/plain;charset=UTF-8\r\n"
        b"Content-Length: %d\r\n\r\n%b" % (len(body), body)
    )
    while not done.is_set():
        try:
            with connected(bcap) as link:
                link.sendall(request)
                while link.recv(4096):
                    done.count("answered")
        except OSError:
            pass
        done.count("posts")
        done.wait(0.002)


def pipelined(done: Done, port: int, block: bytes, what: str) -> None:
    """Send the same requests again and again without waiting for the replies, which another thread reads."""
    while not done.is_set():
        try:
            with connected(port) as link:
                reader = threading.Thread(target=drain, args=(link,), daemon=True)
                reader.start()
                while not done.is_set():
                    link.sendall(block)
                    done.count(what, len(block))
        except OSError:
            done.count("disconnected")
            done.wait(0.05)


def drain(link: socket.socket) -> None:
    """Read until the connection is closed."""
    while True:
        try:
            if not link.recv(1 << 20):
                return
        except TimeoutError:
            continue
        except OSError:
            return


_NUMBERS = count()
_CHUNK = 65_000


def pipelined_calls(done: Done, bcap: int, *_: int) -> None:
    """Send small calls and calls that are slow to decode, on many connections."""
    calls = (
        packet(1, 1, text("")),
        packet(1, 9999),
        packet(1, 3, text("x"), text("nobody"), text(""), text("")),
        packet(1, 20, Variant(VarType.I4, 2), Variant(int(VarType.DATE) | ARRAY, [45000.5] * 1900)),
    )
    call = calls[next(_NUMBERS) % len(calls)]
    pipelined(done, bcap, call * (_CHUNK // len(call)), "bytes")


def pipelined_http(done: Done, _: int, http: int, *__: int) -> None:
    """Send small requests, and bodies in chunks of one byte."""
    head = b"Host: 127.0.0.1\r\nContent-Type: application/x-www-form-urlencoded\r\n"
    requests = (
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 1000,
        b"POST / HTTP/1.1\r\n" + head + b"Transfer-Encoding: chunked\r\n\r\n" + b"1\r\na\r\n" * 10_000 + b"0\r\n\r\n",
    )
    pipelined(done, http, requests[next(_NUMBERS) % len(requests)], "bytes")


def pipelined_control(done: Done, _: int, __: int, control: int) -> None:
    """Send small and large packets to the control port, without the secret or with a wrong one."""
    name = text("CaoProv.orinkit.Pendant")
    calls = (
        packet(1, 1, text("")),
        packet(1, 3, text(""), name, text(""), text("Secret=wrong-wrong-wrong")),
        packet(1, 3, text(""), Variant(int(VarType.BSTR) | ARRAY, ["x"] * 4000), text("")),
    )
    call = calls[next(_NUMBERS) % len(calls)]
    pipelined(done, control, call * (_CHUNK // len(call)), "bytes")


def control_connections(done: Done, _: int, __: int, control: int) -> None:
    """Open connections to the control port as fast as possible."""
    open_now: list[socket.socket] = []
    while not done.is_set():
        try:
            open_now.append(connected(control))
            done.count("connections")
        except OSError:
            done.count("refused")
            done.wait(0.01)
        if len(open_now) >= 200:
            for link in open_now:
                link.close()
            open_now.clear()


ATTACKS: dict[str, tuple[Callable[..., None], int]] = {
    "refused-calls": (refused_calls, 4),
    "large-packets": (large_packets, 4),
    "silent-connections": (silent_connections, 1),
    "token-guesses": (token_guesses, 4),
    "web-pages": (web_pages, 2),
    "pipelined-calls": (pipelined_calls, 12),
    "pipelined-http": (pipelined_http, 8),
    "pipelined-control": (pipelined_control, 9),
    "control-connections": (control_connections, 1),
}
"""Name of the attack: its function and number of threads."""


def main(name: str, *ports: int) -> None:
    os.nice(_NICE)
    attack, threads = ATTACKS[name]
    done = Done()
    working = [threading.Thread(target=attack, args=(done, *ports), daemon=True) for _ in range(threads)]
    for each in working:
        each.start()
    sys.stdin.read()
    done.set()
    for each in working:
        each.join(2 * _PATIENCE)
    result: dict[str, Any] = {"attack": name, **done.counts}
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
