"""Who may call over HTTP: everything that the header of a request tells, and what those are told who may not."""

from __future__ import annotations

import hmac
import socket
from collections.abc import Iterable
from ipaddress import ip_address
from typing import Final, TypeAlias

from starlette.responses import PlainTextResponse

from orinkit.core.i18n import tr
from orinkit.server.http.limits import closing
from orinkit.server.http.options import HttpOptions

Headers: TypeAlias = dict[bytes, bytes]

_REMEMBERED: Final = 64  # headers that have been looked at
_FORM: Final = b"application/x-www-form-urlencoded"
_UTF8: Final = (b"utf-8", b"utf8")
_WEB: Final = {"http": "80", "https": "443"}  # schemes of pages, and their ports


class AccessCheck:
    """Looks at a request's header: whether it is a call, of somebody who may call, for this server.

    Args:
        options: who is let in.
        secure: it is https.
    """

    def __init__(self, options: HttpOptions, *, secure: bool) -> None:
        own = socket.gethostname().lower().rstrip(".")
        self._hosts = {"localhost", own, own.partition(".")[0], *(host.lower().rstrip(".") for host in options.hosts)}
        self._token = options.token.encode()
        self._port = "443" if secure else "80"
        self._known_hosts: set[bytes] = {b""}
        self._known_types: set[bytes] = {_FORM}

    def refusal(self, method: str, headers: Headers) -> PlainTextResponse | None:
        """Return the answer for one who is not let in; ``None`` for a call."""
        host = headers.get(b"host", b"")
        if host not in self._known_hosts and not self._is_ours(host):
            return _wrong_host(host)
        if b"origin" in headers and not self._is_own(headers[b"origin"], host):
            return plain(
                403,
                tr("calls of other web sites are refused (Origin)"),
            )
        if method != "POST":
            return _not_post(method)
        if self._token and not self._shows_token(headers.get(b"authorization", b"")):
            text = tr("a token is needed: Authorization: Bearer ...")
            return plain(401, text, {"WWW-Authenticate": "Bearer"})
        kind = headers.get(b"content-type", _FORM)
        if (kind not in self._known_types and not self._is_form(kind)) or not _is_unpacked(headers):
            return plain(415, tr("Content-Type: {type}, UTF-8 is needed", type=_FORM.decode()))
        return None

    def _is_ours(self, given: bytes) -> bool:
        """Whether a Host header names this server. A web page can have a name of its own point here, but no address."""
        host, _ = _host_and_port(given.decode("latin-1").lower(), "")
        name = host.removesuffix(".")
        if name in self._hosts or name.endswith(".localhost") or _is_address(host):
            _remember(self._known_hosts, given)
            return True
        return False

    def _is_own(self, origin: bytes, host: bytes) -> bool:
        """Whether a web page is of this server itself."""
        scheme, mark, place = origin.decode("latin-1").lower().partition("://")
        called = host.decode("latin-1").lower()
        scheme_port = _WEB.get(scheme, "")
        return bool(scheme_port and mark and called) and (
            place == called or _host_and_port(place, scheme_port) == _host_and_port(called, self._port)
        )

    def _shows_token(self, given: bytes) -> bool:
        kind, _, token = given.partition(b" ")
        return hmac.compare_digest(token.strip(), self._token) and kind.lower() == b"bearer"

    def _is_form(self, given: bytes) -> bool:
        kind, *parameters = (part.strip() for part in given.lower().split(b";"))
        for parameter in parameters:
            name, _, value = parameter.partition(b"=")
            if name.strip() == b"charset" and value.strip().strip(b'"') not in _UTF8:
                return False
        if kind == _FORM:
            _remember(self._known_types, given)
        return kind == _FORM


# --- what is told ------------------------------------------------------------------------------------------------------

_ONCE: Final = (b"host", b"origin", b"authorization", b"content-length", b"content-type")
_CLOSE: Final = {"Connection": "close"}


def plain(status: int, text: str, headers: dict[str, str] | None = None) -> PlainTextResponse:
    """Return an answer with a text of one line."""
    return PlainTextResponse(f"{text}\n", status, headers)


def ambiguous(headers: Iterable[tuple[bytes, bytes]]) -> PlainTextResponse | None:
    """Return the answer to a request whose header can be read in more than one way; ``None`` for any other.

    A proxy in front may have read it in the other way. Equal lengths count once: h11 has made one of them.
    """
    names = [name for name, _ in headers]
    for name in _ONCE:
        if names.count(name) > 1:
            shown = name.decode().title()
            return plain(400, tr("{shown} is there more than once", shown=shown), _CLOSE)
    if b"content-length" in names and b"transfer-encoding" in names:
        text = tr("Content-Length and Transfer-Encoding exclude each other")
        return plain(400, text, _CLOSE)
    return None


def closed() -> PlainTextResponse:
    """Return the answer of a server that is being closed."""
    return plain(503, closing(), {"Connection": "close"})


def too_many_guesses() -> PlainTextResponse:
    """Return the answer to a request whose token is not looked at: its address is being slowed down."""
    text = tr("too many wrong tokens from this address; try again in a second")
    return plain(429, text, {**_CLOSE, "Retry-After": "1"})


def full() -> PlainTextResponse:
    """Return the answer to a body for which there is no room, because others are sending too much."""
    return plain(
        503,
        tr("too many requests are under way; try again"),
        _CLOSE,
    )


def _not_post(method: str) -> PlainTextResponse:
    text = tr("e-CAP is spoken with POST")
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
            "this server is not {shown}; it is called by its address, or a name that it has been told (--http-host)",
            shown=shown,
        ),
    )


def too_long(most: int) -> PlainTextResponse:
    """Return the answer to a body that has more bytes than that."""
    return plain(413, tr("a body has at most {most} bytes", most=most))


# --- small things ------------------------------------------------------------------------------------------------------


def _is_unpacked(headers: Headers) -> bool:
    return headers.get(b"content-encoding", b"identity").lower() == b"identity"


def _remember(known: set[bytes], given: bytes) -> None:
    if len(known) < _REMEMBERED:
        known.add(given)


def _host_and_port(place: str, usual: str) -> tuple[str, str]:
    """Cut ``[::1]:8080`` or ``name:8080``; an IPv6 address keeps its brackets."""
    host, bracket, rest = place.rpartition("]")
    name, colon, port = (rest if bracket else place).partition(":")
    if bracket and name:  # something between the bracket and the port
        return place, ""
    return (host + bracket if bracket else name), (port if colon else usual)


def _is_address(host: str) -> bool:
    try:
        address = ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return (address.version == 6) is host.startswith("[")
