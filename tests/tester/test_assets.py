"""The files of the pages: complete, kept in memory, and compressed only for other machines."""

from __future__ import annotations

import asyncio
import gzip
import re
import urllib.request
from typing import Any

from orinkit.tester.assets import AssetCache
from support.browser import TesterProcess
from support.waiting import PATIENCE

SCRIPT = b"let many = 1;\n" * 1000


class Application:
    """An ASGI application with one file; it counts the requests."""

    def __init__(self) -> None:
        self.requests: list[dict[bytes, bytes]] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.requests.append(dict(scope["headers"]))
        found = scope["path"].endswith(".js")
        gone = asyncio.ensure_future(receive())
        await asyncio.sleep(0.01)
        if gone.done():  # the browser has closed the connection: as BaseHTTPMiddleware, send no body
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b""})
            return
        gone.cancel()
        headers = [(b"content-type", b"text/javascript; charset=utf-8"), (b"etag", b"1")]
        await send({"type": "http.response.start", "status": 200 if found else 404, "headers": headers})
        await send({"type": "http.response.body", "body": SCRIPT[:100], "more_body": True})
        await send({"type": "http.response.body", "body": SCRIPT[100:]})


def get(cache: AssetCache, path: str, peer: str = "127.0.0.1", **headers: str) -> tuple[int, dict[bytes, bytes], bytes]:
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.disconnect"}

    given = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "method": "GET", "path": path, "headers": given, "client": (peer, 1)}
    asyncio.run(cache(scope, receive, send))
    return sent[0]["status"], dict(sent[0]["headers"]), b"".join(each["body"] for each in sent[1:])


def test_a_file_is_fetched_once_and_whole():
    application = Application()
    cache = AssetCache(application)
    for _ in range(2):
        status, headers, body = get(cache, "/_nicegui/1/static/a.js", accept_encoding="gzip", range="bytes=0-9")
        assert (status, body) == (200, SCRIPT)
        assert headers[b"content-length"] == b"14000"
        assert b"immutable" in headers[b"cache-control"]
        assert b"content-encoding" not in headers
    assert application.requests == [{}]


def test_other_machines_receive_compressed_files():
    application = Application()
    cache = AssetCache(application)
    for _ in range(2):
        _, headers, body = get(cache, "/_nicegui/1/static/a.js", "192.168.0.7", accept_encoding="gzip, deflate")
        assert headers[b"content-encoding"] == b"gzip"
        assert len(body) < 200
        assert gzip.decompress(body) == SCRIPT
    assert get(cache, "/_nicegui/1/static/a.js", "192.168.0.7")[2] == SCRIPT
    assert len(application.requests) == 2


def test_pages_and_missing_files_are_not_kept():
    application = Application()
    cache = AssetCache(application)
    for path in ("/_nicegui/1/static/missing", "/arm", "/_nicegui/1/dynamic_resources/x.js"):
        before = len(application.requests)
        first = get(cache, path, "192.168.0.7", accept_encoding="gzip")
        assert first == get(cache, path, "192.168.0.7", accept_encoding="gzip")
        assert len(application.requests) == before + 2


def test_the_tester_delivers_the_files_of_its_pages(tmp_path):
    with TesterProcess(folder=tmp_path) as tester:
        with urllib.request.urlopen(f"{tester.url}/arm", timeout=PATIENCE) as reply:
            page = reply.read().decode()
        scripts = set(re.findall(r'"(/_nicegui/[^"]*\.js)"', page))
        assert any("quasar" in each for each in scripts)
        for each in scripts:
            with urllib.request.urlopen(tester.url + each, timeout=PATIENCE) as reply:
                assert "immutable" in reply.headers["Cache-Control"]
                assert len(reply.read()) == int(reply.headers["Content-Length"])
