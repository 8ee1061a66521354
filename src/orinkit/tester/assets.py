"""The files of the pages (scripts, styles, fonts), from memory: :class:`AssetCache`.

NiceGUI compresses each file for each request in the event loop, which takes up to 0.1 s for a large script. A file does
not change while the Tester runs, so its response is kept. Only browsers on other machines receive compressed files;
compressing is done once, in another thread.
"""

from __future__ import annotations

import asyncio
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from orinkit.transport.address import is_loopback

_PREFIX: Final = "/_nicegui/"
_CHANGING: Final = "/dynamic_resources/"
_CACHE: Final = b"public, max-age=31536000, immutable"
_LARGEST_CACHE: Final = 32 * 1024 * 1024  # bytes
_SHORTEST: Final = 1024  # bytes; shorter files are not compressed
_LEVEL: Final = 6
_TEXT: Final = (b"text/", b"application/json", b"image/svg")


@dataclass(frozen=True, slots=True)
class _Asset:
    headers: tuple[tuple[bytes, bytes], ...]
    body: bytes


class AssetCache:
    """ASGI middleware that keeps the responses with the files of the pages.

    Args:
        app: The application, which creates the responses, uncompressed.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._assets: dict[tuple[str, bool], _Asset] = {}
        self._size = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request (ASGI)."""
        if scope["type"] != "http" or scope["method"] != "GET" or not _is_file(scope["path"]):
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        packed = not is_loopback(_peer(scope)) and b"gzip" in headers.get(b"accept-encoding", b"")
        asset = self._assets.get((scope["path"], packed))
        if asset is None:
            asset = await self._fetch(scope, send, packed=packed)
        if asset is not None:
            await send({"type": "http.response.start", "status": 200, "headers": list(asset.headers)})
            await send({"type": "http.response.body", "body": asset.body})

    async def _fetch(self, scope: Scope, send: Send, *, packed: bool) -> _Asset | None:
        """Return a file; if there is no such file, send the response of the application and return None."""
        answer: list[Message] = []

        async def collect(message: Message) -> None:
            answer.append(message)

        # Conditions and ranges refer to a copy of the browser; the file is needed as a whole.
        plain = {**scope, "headers": [each for each in scope["headers"] if each[0] not in _CONDITIONS]}
        await self._app(plain, _never, collect)
        headers = dict(answer[0].get("headers", ())) if answer else {}
        body = b"".join(message.get("body", b"") for message in answer[1:])
        whole = int(headers.get(b"content-length", len(body))) == len(body)
        if not answer or answer[0].get("status") != 200 or not whole:
            for message in answer:
                await send(message)
            return None
        asset = await _prepare(headers, body, packed=packed)
        if self._size + len(asset.body) <= _LARGEST_CACHE:
            self._size += len(asset.body)
            self._assets[scope["path"], packed] = asset
        return asset


_CONDITIONS: Final = (b"range", b"if-none-match", b"if-modified-since", b"if-range", b"accept-encoding")


async def _never() -> Message:
    """Receive nothing: a file is fetched completely, even if the browser closes the connection meanwhile."""
    await asyncio.Event().wait()
    raise AssertionError


def _is_file(path: str) -> bool:
    return path.startswith(_PREFIX) and _CHANGING not in path


def _peer(scope: Mapping[str, Any]) -> str:
    client = scope.get("client")
    return str(client[0]) if client else ""


async def _prepare(headers: dict[bytes, bytes], body: bytes, *, packed: bool) -> _Asset:
    kind = headers.get(b"content-type", b"application/octet-stream")
    kept = [(b"content-type", kind), (b"cache-control", _CACHE), (b"vary", b"Accept-Encoding")]
    if packed and len(body) >= _SHORTEST and kind.startswith(_TEXT):
        body = await asyncio.to_thread(gzip.compress, body, _LEVEL)
        kept.append((b"content-encoding", b"gzip"))
    return _Asset((*kept, (b"content-length", f"{len(body)}".encode())), body)
