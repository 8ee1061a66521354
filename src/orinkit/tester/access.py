"""Access to the pages of the Tester: Host and Origin checks, and a token if other machines can reach it.

A web page of another site, open in the user's browser, can send requests to the Tester. Its ``Origin`` header differs, or
(DNS rebinding) the ``Host`` header does, so such requests are refused.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final
from urllib.parse import parse_qs, unquote

from starlette.types import ASGIApp, Receive, Scope, Send

from orinkit.core.i18n import tr
from orinkit.transport.address import is_loopback

USER_COOKIE: Final = "orinkit_user"
TOKEN_COOKIE: Final = "orinkit_token"  # noqa: S105 - the name of the cookie
_LOCAL_NAMES: Final = ("127.0.0.1", "localhost", "[::1]")
_SAFE: Final = ("GET", "HEAD")
# no other web page may show the Tester in a frame: it could guide a click onto a button that moves the arm
_HEADERS: Final = (
    (b"content-security-policy", b"frame-ancestors 'none'"), (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class AccessRules:
    """Which requests are accepted.

    Attributes:
        host: Address that the Tester listens on.
        names: Further host names under which users reach it.
        token: The token that users must send once; ``""`` if none is required.
    """

    host: str
    names: tuple[str, ...] = ()
    token: str = field(default="", repr=False)

    @classmethod
    def for_host(cls, host: str, names: Iterable[str] = ()) -> AccessRules:
        """Return the rules for an address; if other machines can reach it, with a new random token."""
        return cls(host, tuple(names), "" if is_loopback(host) else secrets.token_urlsafe(16))

    def refusal(self, headers: dict[str, str], method: str) -> str:
        """Return why a request is refused because of its headers; ``""`` if it is accepted.

        Args:
            headers: The headers, with names in lower case.
            method: Method of the request; ``"WEBSOCKET"`` for a WebSocket.
        """
        host = headers.get("host", "")
        if not self._accepts_host(_name(host)):
            return tr("the host name {host} is not allowed. Try: orinkit tester --allow-host NAME", host=host[:100])
        origin = headers.get("origin", "")
        if origin:
            if origin.lower() not in (f"http://{host.lower()}", f"https://{host.lower()}"):
                return tr("requests of other web pages are refused")
        elif method not in _SAFE and headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return tr("requests of other web pages are refused")
        return ""

    def _accepts_host(self, name: str) -> bool:
        names = {*_LOCAL_NAMES, *(each.lower() for each in self.names)}
        if not is_loopback(self.host):
            return name in names or name == self.host or _is_numeric(name)
        return name in names or name == self.host

    def accepts_token(self, token: str) -> bool:
        """Return True if a token is right, or none is required."""
        return not self.token or hmac.compare_digest(token.encode(), self.token.encode())


class AccessMiddleware:
    """ASGI middleware that applies :class:`AccessRules`, and gives each browser a cookie that identifies the user."""

    def __init__(self, app: ASGIApp, rules: AccessRules) -> None:
        self._app = app
        self._rules = rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request (ASGI)."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        method = scope.get("method", "WEBSOCKET")
        reason = self._rules.refusal(headers, method)
        cookies = read_cookies(headers.get("cookie", ""))
        token = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        fresh = bool(self._rules.token) and bool(token)
        if not reason and not self._rules.accepts_token(token or cookies.get(TOKEN_COOKIE, "")):
            reason = tr("a token is required. Try: the address that orinkit tester has printed, with ?token=")
        if reason:
            await _refuse(scope, send, reason)
            return
        new = {} if cookies.get(USER_COOKIE) else {USER_COOKIE: secrets.token_urlsafe(16)}
        scope.setdefault("state", {})["user"] = cookies.get(USER_COOKIE) or new[USER_COOKIE]
        if fresh:
            new[TOKEN_COOKIE] = token
        await self._app(scope, receive, _with_headers(send, new))


def read_cookies(header: str) -> dict[str, str]:
    """Return the cookies of a request.

    Other programs on this computer may have set cookies of any form, because cookies are not bound to a port. Therefore a
    cookie that cannot be read must not hide the others. ``http.cookies`` would then return none.
    """
    pairs = (each.partition("=") for each in header.split(";"))
    return {name.strip(): unquote(value.strip()) for name, equals, value in pairs if equals}


def _with_headers(send: Send, cookies: dict[str, str]) -> Send:
    """Add the headers of every response, and cookies."""

    async def send_with_headers(message: dict[str, object]) -> None:
        if message["type"] == "http.response.start":
            added = [
                *_HEADERS,
                *(
                    (b"set-cookie", f"{name}={value}; Path=/; HttpOnly; SameSite=Strict".encode())
                    for name, value in cookies.items()
                ),
            ]
            message = {**message, "headers": [*message.get("headers", ()), *added]}  # type: ignore[misc]  # a list of pairs
        await send(message)

    return send_with_headers  # type: ignore[return-value]  # Message is a MutableMapping


async def _refuse(scope: Scope, send: Send, reason: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": reason[:100]})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"orinkit: {reason}\n".encode()})


def _name(host: str) -> str:
    """Return a Host header without its port, in lower case."""
    host = host.lower()
    return host.partition("]")[0] + "]" if host.startswith("[") else host.partition(":")[0]


def _is_numeric(name: str) -> bool:
    return name.startswith("[") or name.replace(".", "").isdigit()
