"""Access control for HTTP: checks of the header of a request, and the responses that refuse a request."""

from __future__ import annotations

import hmac
import socket
from collections.abc import Iterable
from ipaddress import ip_address
from typing import Final, TypeAlias

from starlette.responses import PlainTextResponse

from orinkit.core.i18n import tr
from orinkit.ecap.fields import find_charset
from orinkit.server.http.limits import server_closing_message
from orinkit.server.http.options import HttpOptions

Headers: TypeAlias = dict[bytes, bytes]

_CACHED: Final = 64  # maximum number of accepted header values in each cache
_FORM: Final = b"application/x-www-form-urlencoded"
_OF_PROXIES: Final = (b"via", b"forwarded")  # headers that proxies add
_FORWARDED: Final = b"x-forwarded-"
_PREFLIGHT: Final = b"access-control-request-method"
_ALLOWED: Final = {
    "Access-Control-Allow-Methods": "GET, POST",
    "Access-Control-Allow-Headers": "Authorization, Content-Type, Orinkit-Executing",
    "Access-Control-Max-Age": "600",
}
_WEB: Final = {"http": "80", "https": "443"}  # schemes of web pages, and their default ports


class AccessCheck:
    """Checks the header of a request: method, host, origin, token, and content type.

    Args:
        options: access control options.
        secure: True if the listener uses https.
    """

    def __init__(self, options: HttpOptions, *, secure: bool) -> None:
        own = socket.gethostname().lower().rstrip(".")
        self._hosts = {"localhost", own, own.partition(".")[0], *(host.lower().rstrip(".") for host in options.hosts)}
        self._token = options.token.encode()
        self._port = "443" if secure else "80"
        self._known_hosts: set[bytes] = {b""}
        self._known_types: set[bytes] = {_FORM}
        self._origins = {_origin(text) for text in options.origins}
        self._charset = options.charset

    def refusal(self, method: str, headers: Headers, *, reads: bool = False) -> PlainTextResponse | None:
        """Return the response that refuses a request or answers a preflight, or ``None`` if the request is permitted.

        Args:
            method: method of the request.
            headers: headers of the request.
            reads: True if the path of the request permits GET instead of POST.
        """
        host = headers.get(b"host", b"")
        if host not in self._known_hosts and not self._is_ours(host):
            return _wrong_host(host)
        if b"origin" in headers and not self._is_same_origin(headers[b"origin"], host):
            if not self.allowed_origin(headers):
                text = tr(
                    "requests from other web sites are refused (Origin). Try: start the server with --http-origin ORIGIN"
                )
                return plain(403, text)
            if method == "OPTIONS" and _PREFLIGHT in headers:
                return _preflight(headers)
        if method != ("GET" if reads else "POST"):
            return _not_post(method, reads=reads)
        if self._token and not self._has_token(headers.get(b"authorization", b"")):
            text = tr("a token is required (Authorization: Bearer ...)")
            return plain(401, text, {"WWW-Authenticate": "Bearer"})
        if reads:
            return None
        content_type = headers.get(b"content-type", _FORM)
        if (content_type not in self._known_types and not self._is_form(content_type)) or not _is_uncompressed(headers):
            text = tr("the body must be {type} in UTF-8 or Shift_JIS, uncompressed", type=_FORM.decode())
            return plain(415, text)
        return None

    def allowed_origin(self, headers: Headers) -> str:
        """Return the origin of the page that sends a request if this origin is in the list of origins; otherwise ``""``."""
        given = headers.get(b"origin")
        if given is None or not self._origins:
            return ""
        text = given.decode("latin-1")
        return text if _origin(text) in self._origins else ""

    def charset(self, headers: Headers) -> str:
        """Return the encoding of the body of a permitted request, and of its reply."""
        given = headers.get(b"content-type", _FORM)
        return self._charset if given == _FORM else _charset_of(given) or self._charset

    def _is_ours(self, given: bytes) -> bool:
        """Return True if a Host header names this server.

        Addresses are always accepted. Unknown names are refused, because the owner of a web site can make the host name
        of the site resolve to this server.
        """
        host, _ = _host_and_port(given.decode("latin-1").lower(), "")
        name = host.removesuffix(".")
        if name in self._hosts or name.endswith(".localhost") or _is_address(host):
            _remember(self._known_hosts, given)
            return True
        return False

    def _is_same_origin(self, origin: bytes, host: bytes) -> bool:
        """Return True if this server itself is the origin of the web page that sends the request."""
        scheme, mark, netloc = origin.decode("latin-1").lower().partition("://")
        called = host.decode("latin-1").lower()
        scheme_port = _WEB.get(scheme, "")
        return bool(scheme_port and mark and called) and (
            netloc == called or _host_and_port(netloc, scheme_port) == _host_and_port(called, self._port)
        )

    def _has_token(self, given: bytes) -> bool:
        kind, _, token = given.partition(b" ")
        return hmac.compare_digest(token.strip(), self._token) and kind.lower() == b"bearer"

    def _is_form(self, given: bytes) -> bool:
        content_type = given.lower().split(b";")[0].strip()
        if _charset_of(given) is None:
            return False
        if content_type == _FORM:
            _remember(self._known_types, given)
        return content_type == _FORM


def _charset_of(content_type: bytes) -> str | None:
    """Return the encoding that a Content-Type names; ``""`` if it names none, ``None`` if the encoding is unknown."""
    for parameter in content_type.split(b";")[1:]:
        name, _, value = parameter.partition(b"=")
        if name.strip().lower() == b"charset":
            return find_charset(value.decode("latin-1"))
    return ""


def _origin(text: str) -> tuple[str, str, str]:
    """Return scheme, host and port of an origin."""
    scheme, _, netloc = text.lower().partition("://")
    return (scheme, *_host_and_port(netloc, _WEB.get(scheme, "")))


# --- responses ---------------------------------------------------------------------------------------------------------

_ONCE: Final = (b"host", b"origin", b"authorization", b"content-length", b"content-type")
_CLOSE: Final = {"Connection": "close"}


def plain(status: int, text: str, headers: dict[str, str] | None = None) -> PlainTextResponse:
    """Return a response with one line of text."""
    return PlainTextResponse(f"{text}\n", status, headers)


def is_proxied(headers: Headers) -> bool:
    """Return True if a header shows that a proxy has forwarded the request."""
    return any(name in _OF_PROXIES or name.startswith(_FORWARDED) for name in headers)


def ambiguous(headers: Iterable[tuple[bytes, bytes]]) -> PlainTextResponse | None:
    """Return the response to a request with an ambiguous header, or ``None`` if the header is unambiguous.

    A proxy may have interpreted an ambiguous header differently. Repeated Content-Length headers with equal values are
    accepted, because h11 has merged them.
    """
    names = [name for name, _ in headers]
    for name in _ONCE:
        if names.count(name) > 1:
            shown = name.decode().title()
            return plain(400, tr("the header {shown} is repeated", shown=shown), _CLOSE)
    if b"content-length" in names and b"transfer-encoding" in names:
        text = tr("Content-Length and Transfer-Encoding cannot be combined")
        return plain(400, text, _CLOSE)
    return None


def closed() -> PlainTextResponse:
    """Return the response of a server that is closing."""
    return plain(503, server_closing_message(), {"Connection": "close"})


def too_many_guesses() -> PlainTextResponse:
    """Return the response to a request whose token is not checked, after too many wrong tokens from its address."""
    text = tr("too many wrong tokens from this address. Try: repeat the request after 1 s")
    return plain(429, text, {**_CLOSE, "Retry-After": "1"})


def too_many_request_bytes() -> PlainTextResponse:
    """Return the response to a body that is refused because the requests of all clients exceed the limit on bytes."""
    return plain(
        503,
        tr("too many requests in progress. Try: repeat the request later"),
        _CLOSE,
    )


def cors_headers(origin: str) -> dict[str, str]:
    """Return the headers with which a browser passes a response to a page of an allowed origin."""
    return {
        "Access-Control-Allow-Origin": origin,
        "Access-Control-Allow-Credentials": "true",
        "Access-Control-Expose-Headers": "Orinkit-Error, Orinkit-Detail",
        "Vary": "Origin",
    }


def _preflight(headers: Headers) -> PlainTextResponse:
    """Return the response to the request with which a browser asks if a page may call this server."""
    allowed = dict(_ALLOWED)
    if b"access-control-request-private-network" in headers:
        allowed["Access-Control-Allow-Private-Network"] = "true"
    return PlainTextResponse("", 204, allowed)


def _not_post(method: str, *, reads: bool) -> PlainTextResponse:
    if reads:
        return plain(405, tr("variables can only be read (GET)"), {"Allow": "GET"})
    text = tr("e-CAP requires POST")
    if method == "GET":
        text = (
            "orinkit: this is an e-CAP server. Try: curl -d 'Func=1' URL\n"
            "orinkit: e-CAP サーバです。例: curl -d 'Func=1' URL"
        )
    return plain(405, text, {"Allow": "POST"})


def _wrong_host(given: bytes) -> PlainTextResponse:
    shown = ascii(given[:60].decode("latin-1"))
    return plain(
        421,
        tr(
            "this server does not accept the host name {shown}. Try: use the address of the server, or start it "
            "with --http-host NAME",
            shown=shown,
        ),
    )


def too_long(most: int) -> PlainTextResponse:
    """Return the response to a body of more than ``most`` bytes."""
    return plain(413, tr("the body exceeds the limit of {most} bytes", most=most))


# --- helpers -----------------------------------------------------------------------------------------------------------


def _is_uncompressed(headers: Headers) -> bool:
    return headers.get(b"content-encoding", b"identity").lower() == b"identity"


def _remember(known: set[bytes], given: bytes) -> None:
    if len(known) < _CACHED:
        known.add(given)


def _host_and_port(netloc: str, default: str) -> tuple[str, str]:
    """Return host and port of ``[::1]:8080`` or ``name:8080``; the port is ``default`` if the text contains none.

    An IPv6 address keeps its brackets.
    """
    host, bracket, rest = netloc.rpartition("]")
    name, colon, port = (rest if bracket else netloc).partition(":")
    if bracket and name:  # there are characters between the bracket and the port
        return netloc, ""
    return (host + bracket if bracket else name), (port if colon else default)


def _is_address(host: str) -> bool:
    try:
        address = ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return (address.version == 6) is host.startswith("[")
