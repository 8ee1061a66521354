"""Expected replies of an e-CAP server to a stream of bytes, and a check of the actual ones.

:func:`expected` determines the requests in a stream with h11 alone, independently of the server. :class:`Reader` reads
replies and accepts only valid HTTP/1.1. :func:`judge` compares both.
"""

from __future__ import annotations

import re
import select
import socket
import struct
import time
from dataclasses import dataclass, field
from typing import NamedTuple
from urllib.parse import unquote

import h11

from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.ecap.message import read_reply, read_request
from orinkit.values.codec import PacketLimits
from orinkit.values.variant import VarType
from support.http_garbage import WANTED

LONGEST_HEADER = 32 * 1024
PATIENCE = 30.0
DOCUMENTED = {200, 400, 403, 405, 408, 413, 415, 421, 431}
SAY_WHY = {b"text/plain; charset=utf-8"}
CODE = re.compile(rb"\n*0x[0-9A-F]{8}(?:,|\Z)")


class Broken(Exception):
    """The server has sent invalid HTTP/1.1, or a wrong reply."""


class Answer(NamedTuple):
    """A reply as received; names of headers are in lower case."""

    status: int
    headers: dict[bytes, bytes]
    body: bytes

    @property
    def closes(self) -> bool:
        """True if it announces the end of the connection."""
        return self.headers.get(b"connection") == b"close"


@dataclass
class Asked:
    """A request in a stream.

    Attributes:
        method: the method of the request.
        target: the target of the request.
        body: the body of the request; ``None`` if it is incomplete in the stream.
        length: the value of Content-Length.
        last: True if the connection must end after the reply.
        beats: True if the request has the header Orinkit-Executing.
    """

    method: bytes
    target: bytes
    length: int
    beats: bool
    body: bytes | None = None
    last: bool = False


ONCE = (b"host", b"origin", b"authorization", b"content-length", b"content-type")
"""Headers that may occur only once in a request."""


@dataclass
class Expected:
    """The contents of a stream.

    Attributes:
        asked: the requests; all but the last are complete.
        wrong: True if the stream ends in invalid or ambiguous HTTP.
        long: True if it contains a header that exceeds the limit.
    """

    asked: list[Asked] = field(default_factory=list)
    wrong: bool = False
    long: bool = False

    def answers(self, limits: PacketLimits) -> int:
        """Return the number of replies due."""
        last = self.asked[-1] if self.asked else None
        if last is None or last.body is not None:
            return len(self.asked) + self.wrong
        return len(self.asked) - (not self.wrong and last.length <= 2 * limits.packet)


def expected(stream: bytes) -> Expected:
    """Return the contents of a stream as an HTTP/1.1 parser finds them."""
    found = Expected(long=any(len(head) > LONGEST_HEADER for head in re.split(rb"\r?\n\r?\n", stream)))
    peer = h11.Connection(h11.SERVER, max_incomplete_event_size=1 << 30)
    peer.receive_data(stream)
    body = bytearray()
    while True:
        try:
            event = peer.next_event()
        except h11.RemoteProtocolError:
            found.wrong = True
            return found
        if event in (h11.NEED_DATA, h11.PAUSED):
            return found
        if isinstance(event, h11.Request):
            headers = dict(event.headers)
            names = [name for name, _ in event.headers]
            if any(names.count(name) > 1 for name in ONCE) or {b"content-length", b"transfer-encoding"} <= set(names):
                found.wrong = True
                return found
            found.asked.append(
                Asked(
                    event.method,
                    event.target,
                    int(headers.get(b"content-length", b"0")),
                    b"orinkit-executing" in headers,
                )
            )
            body = bytearray()
        elif isinstance(event, h11.Data):
            body += event.data
        elif isinstance(event, h11.EndOfMessage):
            found.asked[-1].body = bytes(body)
            peer.send(h11.Response(status_code=405, headers=[("Content-Length", "0")]))
            peer.send(h11.EndOfMessage())
            if peer.our_state is not h11.DONE or found.asked[-1].method == b"CONNECT":
                found.asked[-1].last = True
                return found
            peer.start_next_cycle()


class Reader:
    """Reads replies.

    Args:
        asked: the requests, because a reply to HEAD has no body.
    """

    def __init__(self, asked: list[Asked]) -> None:
        self.answers: list[Answer] = []
        self._asked = asked
        self._data = b""

    def feed(self, data: bytes, *, ended: bool = False) -> None:
        """Process received bytes.

        Raises:
            Broken: If they are not valid HTTP/1.1.
        """
        self._data += data
        while self._data:
            used = self._take(ended)
            if not used:
                break
            self._data = self._data[used:]

    @property
    def pending(self) -> bytes:
        """The bytes received of an incomplete reply."""
        return self._data

    def _take(self, ended: bool) -> int:
        head, mark, rest = self._data.partition(b"\r\n\r\n")
        if not mark:
            return 0
        first, *lines = head.split(b"\r\n")
        match = re.fullmatch(rb"HTTP/1\.1 ([0-9]{3}) ?[ -~]*", first)
        if not match:
            raise Broken(f"status line {first!r}")
        headers: dict[bytes, bytes] = {}
        for line in lines:
            name, colon, value = line.partition(b":")
            if (
                not colon
                or not re.fullmatch(rb"[!#$%&'*+.^_`|~0-9A-Za-z-]+", name)
                or re.search(rb"[\0-\x08\x0a-\x1f\x7f]", value)
            ):
                raise Broken(f"header {line!r}")
            headers[name.lower()] = value.strip()
        status = int(match[1])
        if status == 100:
            return len(head) + 4
        number = len(self.answers)
        if number < len(self._asked) and self._asked[number].method == b"HEAD":
            body, used = b"", 0
        elif b"transfer-encoding" in headers:
            body, used = _unchunked(rest)
        elif b"content-length" in headers:
            used = int(headers[b"content-length"])
            body = rest[:used]
        elif ended:
            body, used = rest, len(rest)
        else:
            return 0
        if used < 0 or len(rest) < used:
            return 0
        self.answers.append(Answer(status, headers, body))
        return len(head) + 4 + used


def _unchunked(data: bytes) -> tuple[bytes, int]:
    """Return the body of a chunked reply and its encoded length; -1 if it is incomplete."""
    body, place = b"", 0
    while True:
        line, mark, _ = data[place:].partition(b"\r\n")
        if not mark:
            return b"", -1
        if not re.fullmatch(rb"[0-9a-fA-F]+", line):
            raise Broken(f"chunk {line!r}")
        size = int(line, 16)
        place += len(line) + 2
        if len(data) < place + size + 2:
            return b"", -1
        if data[place + size : place + size + 2] != b"\r\n":
            raise Broken("a chunk does not end where it should")
        body += data[place : place + size]
        place += size + 2
        if not size:
            return body, place


def converse(
    address: tuple[str, int], stream: bytes, wanted: Expected, limits: PacketLimits
) -> tuple[list[Answer], bool]:
    """Send a stream and read all replies that are due.

    Returns:
        The replies, and True if the connection was reset: the system resets a connection that a server closes with unread
        bytes, and discards what the client has not received yet.

    Raises:
        Broken: If the replies are invalid, or a reply does not arrive in time.
    """
    reader = Reader(wanted.asked)
    due = wanted.answers(limits)
    last = wanted.asked[-1] if wanted.asked else None
    ends = wanted.wrong or (last is not None and (last.last or (last.body is None and due == len(wanted.asked))))
    deadline = time.monotonic() + PATIENCE
    reset = False
    with socket.create_connection(address, PATIENCE) as connection:
        connection.setblocking(False)
        unsent = memoryview(stream)
        while len(reader.answers) < due or ends:
            if time.monotonic() > deadline:
                raise Broken(f"hangs after {len(reader.answers)} of {due} replies, then {reader.pending[:200]!r}")
            waited = select.poll()  # not select(), which knows descriptors up to 1,023 only
            waited.register(connection, select.POLLIN | (select.POLLOUT if unsent else 0))
            events = sum(event for _, event in waited.poll(1000))
            received = None
            try:
                if unsent and events & select.POLLOUT:
                    unsent = unsent[connection.send(unsent[:65536]) :]
                if events & ~select.POLLOUT:
                    received = connection.recv(1 << 20)
            except ConnectionError:
                reset = True
                received = _rest(connection)
                unsent = unsent[:0]
            if received is not None:
                reader.feed(received, ended=not received)
                if not received:
                    break
    if reader.pending and not reset:
        raise Broken(f"the end of a reply is missing: {reader.pending[:200]!r}")
    return reader.answers, reset


def _rest(connection: socket.socket) -> bytes:
    try:
        return connection.recv(1 << 20)
    except ConnectionError:
        return b""


def cut_off(address: tuple[str, int], stream: bytes, *, hard: bool) -> None:
    """Send a stream and disconnect without reading, with a reset if ``hard``."""
    with socket.create_connection(address, PATIENCE) as connection:
        if hard:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        try:
            connection.settimeout(0.2)  # the server stops reading if its replies are not read
            connection.sendall(stream)
        except (OSError, TimeoutError):
            pass


def judge(wanted: Expected, answers: list[Answer], limits: PacketLimits, *, reset: bool) -> None:
    """Compare replies with the expected ones.

    Args:
        wanted: the contents of the stream.
        answers: the replies.
        limits: the limits of the server.
        reset: True if the connection was reset, so that replies before an error may be missing.

    Raises:
        Broken: If a reply is wrong or missing.
    """
    for number, answer in enumerate(answers):
        asked = wanted.asked[number] if number < len(wanted.asked) else None
        _judge(asked, answer, wanted, limits)
        if answer.closes and number + 1 < len(answers):
            raise Broken(f"reply {number} closes the connection, but more replies follow")
    due = wanted.answers(limits)
    if wanted.long and answers and answers[-1].status == 431:
        return
    fewer = (bool(answers) and answers[-1].closes) or (reset and wanted.wrong)
    if len(answers) > due or (len(answers) < due and not fewer):
        raise Broken(f"{len(answers)} replies instead of {due}; the last one is {answers[-1:]!r:.300}")


def _judge(asked: Asked | None, answer: Answer, wanted: Expected, limits: PacketLimits) -> None:
    if answer.status not in DOCUMENTED:
        raise Broken(f"status {answer.status}: {answer!r:.300}")
    if answer.status == 431 and not wanted.long:
        raise Broken("431 for a header within the limit")
    whole = asked is not None and asked.body is not None
    if answer.status in (400, 431) or not whole:
        if (
            answer.status == 200
            or not answer.closes
            or not (wanted.wrong or wanted.long or answer.status in (403, 405, 413, 415, 421))
        ):
            raise Broken(f"{answer!r:.300} for {asked!r:.300}")
        return
    assert asked is not None
    if answer.closes and not asked.last and answer.status == 200:
        raise Broken("closes the connection for no reason")
    label = WANTED.match(asked.target)
    status = int(label[1]) if label and label[2] == asked.method else 0
    if status and answer.status != status:
        raise Broken(f"status {answer.status} instead of {status}: {answer!r:.300} for {asked!r:.300}")
    if answer.status == 405 and answer.headers.get(b"allow") != b"POST":
        raise Broken("405 without Allow")
    if answer.headers.get(b"content-type") not in SAY_WHY:
        raise Broken(f"wrong Content-Type: {answer!r:.300}")
    if answer.status == 200:
        _judge_reply(asked, answer, limits)


def _judge_reply(asked: Asked, answer: Answer, limits: PacketLimits) -> None:
    assert asked.body is not None
    if not CODE.match(answer.body) or (answer.body[:1] == b"\n" and not asked.beats):
        raise Broken(f"not an e-CAP reply: {answer.body[:200]!r}")
    code, result = read_reply(answer.body, limits)
    if hresult.lookup(code).name.startswith("0x"):
        raise Broken(f"undocumented code: {code:#x}")
    detail = answer.headers.get(b"orinkit-detail", b"").decode("ascii")
    if detail.startswith("UTF-8''"):  # RFC 8187
        detail = unquote(detail.removeprefix("UTF-8''"), errors="strict")
    if len(detail) > 500 or (detail and not hresult.failed(code)):
        raise Broken(f"detail {detail!r}")
    late = answer.body[:1] == b"\n"  # the header had already been sent, so the detail follows the code
    said = answer.body.partition(b",")[2]
    if hresult.failed(code) and said and (not late or len(said.decode()) > 500):
        raise Broken(f"an error with a result: {answer.body[:200]!r}")
    try:
        request = read_request(asked.body, limits)
    except CallError as error:
        if code != error.code:
            raise Broken(f"{code:#x} instead of {error.code:#x} ({error.detail}) for {asked.body[:300]!r}") from None
        return
    if not hresult.failed(code):
        kind = request.function.result
        right = (
            result is None if kind is None else kind is VarType.VARIANT or (result is not None and result.type == kind)
        )
        if not right or request.function.id not in FUNCTIONS:
            raise Broken(f"{request.function.name} returned {result!r:.200}")
