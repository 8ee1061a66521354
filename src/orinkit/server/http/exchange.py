"""One HTTP request and its response."""

from __future__ import annotations

import asyncio
import json
from typing import Final
from urllib.parse import quote

from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send

from orinkit.cao.outcomes import CallReply
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.ecap.fields import UTF_8, encoded
from orinkit.server.capacity import CallMemory, IncompleteRequests
from orinkit.server.http.access import Headers
from orinkit.server.http.json_text import as_json, is_view
from orinkit.server.http.limits import LimitedProtocol
from orinkit.server.http.sessions import HttpSession

EXECUTING: Final = b"orinkit-executing"
"""Header with the interval of keep-alive bytes, ms."""
PIECE: Final = 64 * 1024
"""Number of bytes of a response that one call of ``send`` transfers; no more is unsent after the last call."""

_LONGEST_DETAIL: Final = 500  # maximum number of characters of an error description
_INTERVALS: Final = range(80, 60_001)  # valid intervals of keep-alive bytes, ms
_PLAIN: Final = "".join(chr(sign) for sign in range(0x20, 0x7F) if chr(sign) != "%")
_CONTENT_TYPE: Final = b"text/plain; charset="
_ENCODED: Final = "UTF-8''"  # precedes percent-encoded text in a header


class Disconnected(Exception):
    """Raised when the client has closed its connection."""


class Exchange:
    """One request and its response.

    Args:
        scope: the ASGI scope.
        receive: the ASGI receive callable.
        send: the ASGI send callable.
        memory: the memory of the call.

    Attributes:
        scope: the ASGI scope.
        memory: the memory of the call: of its arguments, then of its result, then of the unsent response.
        headers: headers of the request; the names are in lower case.
        connection: the connection of the request.
        interval: interval of keep-alive bytes during a call, ms; 0 if the client has not requested them.
        begun: True if the response has begun.
        session: the session of the client; ``None`` until it is found.
        content_type: content type of the response.
        charset: encoding of the body of the request, and of the response.
        path: path of the request.
        has_room: False if the limit on the bytes of incomplete requests does not permit the body of the request.
    """

    __slots__ = (
        "_counted",
        "_more",
        "_receive",
        "_send",
        "_whole",
        "begun",
        "charset",
        "connection",
        "content_type",
        "has_room",
        "headers",
        "interval",
        "memory",
        "path",
        "scope",
        "session",
    )

    def __init__(self, scope: Scope, receive: Receive, send: Send, memory: CallMemory) -> None:
        self.scope = scope
        self.memory = memory
        self.headers: Headers = dict(scope["headers"])
        self.connection: LimitedProtocol = scope["state"]["connection"]
        interval = self.headers.get(EXECUTING, b"")
        self.interval = int(interval) if interval.isdigit() and len(interval) < 6 and int(interval) in _INTERVALS else 0
        self.begun = False
        self.charset = UTF_8
        self.content_type = _CONTENT_TYPE + UTF_8.encode()
        self.path: str = scope.get("path", "")
        self.session: HttpSession | None = None
        self._receive = receive
        self._send = send
        self.has_room = True
        self._counted = 0
        self._whole = False
        self._more: list[tuple[bytes, bytes]] = []

    def use_charset(self, charset: str) -> None:
        """Set the encoding of the body of the request, and of the response."""
        self.charset = charset
        self.content_type = _CONTENT_TYPE + charset.encode()

    def add(self, name: bytes, value: bytes) -> None:
        """Add a header to the response."""
        self._more.append((name, value))

    def _add_text(self, name: bytes, text: str) -> None:
        """Add a header with a text: ASCII unchanged, any other text as in RFC 8187 (``UTF-8''%E3%81%82``)."""
        text = text[:_LONGEST_DETAIL].strip()
        if not text.isascii() or not text.isprintable():
            text = _ENCODED + quote(text, safe=_PLAIN, errors="replace")
        self.add(name, text.encode())

    async def _next(self) -> bytes:
        message = await self._receive()
        if message["type"] != "http.request":
            raise Disconnected
        self._whole = not message["more_body"]
        body: bytes = message["body"]
        return body

    def _length(self) -> int:
        return int(self.headers.get(b"content-length", b"0"))

    def give_room(self, partial: IncompleteRequests) -> None:
        """Stop counting the body of the request among the bytes of incomplete requests."""
        partial.change(self._counted, 0)
        self._counted = 0

    async def body(self, limit: int, partial: IncompleteRequests) -> bytes | None:
        """Return the body of the request, or ``None`` if it is too long or ``has_room`` is False.

        Args:
            limit: limit on the length, bytes.
            partial: the count of the bytes of incomplete requests; it includes the body until :meth:`give_room`.
        """
        if self._length() > limit:
            return None
        pieces: list[bytes] = []
        count = 0
        while not self._whole and count <= limit:
            pieces.append(await self._next())
            count += len(pieces[-1])
            self.has_room = partial.change(self._counted, count)
            self._counted = count
            if not self.has_room:
                return None
        if count > limit:
            return None
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    async def refuse(self, refusal: PlainTextResponse, limit: int) -> None:
        """Send a response that refuses the request; it contains no return code.

        The body of the request is read first and discarded, because a client that is still sending would not read the
        response. If the body is longer than 2 * ``limit``, or if the client waits for ``100 Continue``, the body is not
        read, and the connection is closed after the response.

        Args:
            refusal: the response.
            limit: half of the maximum length of a body that is read, bytes; if it is negative, no body is read.
        """
        count = 0
        reads_body = b"expect" not in self.headers and self._length() <= 2 * limit
        while reads_body and not self._whole and count <= 2 * limit:
            count += len(await self._next())
        if not self._whole or self.scope["method"] == "CONNECT":
            refusal.headers["connection"] = "close"
        self.begun = True
        for name, value in self._more:
            refusal.headers[name.decode()] = value.decode("latin-1")
        await (as_json(refusal) if is_view(self.path) else refusal)(self.scope, self._receive, self._send)

    async def answer_json(self, status: int, document: object) -> None:
        """Send a response with a JSON document."""
        # an unpaired surrogate, which UTF-8 cannot contain, becomes an escape sequence of JSON
        body = json.dumps(document, ensure_ascii=False, allow_nan=False).encode("utf-8", "backslashreplace")
        self.begun = True
        headers = [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(body)), *self._more]
        headers.append((b"cache-control", b"no-store"))
        await self._send({"type": "http.response.start", "status": status, "headers": headers})
        await self._send({"type": "http.response.body", "body": body})

    async def send_keep_alives(self, reply: asyncio.Future[CallReply | None]) -> None:
        """Send a line feed after each ``interval`` until the reply is available."""
        while True:
            await asyncio.wait((reply,), timeout=self.interval / 1000)
            if reply.done():
                return
            if not self.begun:
                await self._begin([])
            await self._send({"type": "http.response.body", "body": b"\n", "more_body": True})

    async def answer(self, body: bytes, code: int, detail: str) -> None:
        """Send a response with a return code.

        Args:
            body: the body, including the return code.
            code: the return code.
            detail: description of the error.
        """
        if not self.begun:
            if hresult.failed(code):  # curl users see the error in this header
                self._add_text(b"orinkit-error", str(error_for(code)))
            if detail:
                self._add_text(b"orinkit-detail", detail)
            await self._begin([(b"content-length", b"%d" % len(body))])
        elif detail and hresult.failed(code):
            # The header has been sent already. Clients that requested keep-alive bytes read the detail after the code.
            body += b"," + encoded(detail[:_LONGEST_DETAIL].strip(), self.charset)
        at = 0
        while len(body) - at > PIECE:  # one large piece would be copied several times within one turn of the loop
            await self._send({"type": "http.response.body", "body": body[at : at + PIECE], "more_body": True})
            await asyncio.sleep(0)
            at += PIECE
        await self._send({"type": "http.response.body", "body": body[at:]})

    async def _begin(self, headers: list[tuple[bytes, bytes]]) -> None:
        self.begun = True
        headers.append((b"content-type", self.content_type))
        if self.interval:
            headers.append((EXECUTING, b"%d" % self.interval))
        headers += self._more
        message: Message = {"type": "http.response.start", "status": 200, "headers": headers}
        await self._send(message)
