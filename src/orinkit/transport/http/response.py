"""The HTTP exchange with an e-CAP server, without I/O: headers, cookies, and the meaning of each response.

A response with status 200 contains an e-CAP reply. Any other status raises an exception; its message contains a remedy:

==================================================  ===============================================================
301 and other redirects, 401, 403, 404, 405, 407,   ``ConnectFailed``: no e-CAP for this client at this address; the
421                                                 call was not executed. Redirects are reported, never followed.
408, 429                                            ``TransportError``: the call was not executed; it may be repeated
413, 414, 431                                       ``LimitExceeded``: the request is too long for this server
502, 503, 504                                       ``ConnectionLost``: the server, or its upstream server, is down
any other                                           ``ProtocolError``: not a valid response for e-CAP
==================================================  ===============================================================

A response that is not HTTP also raises ``ProtocolError``. After each of these errors, the link can still be used: the
beginning of each response is unambiguous, so that a reply cannot be assigned to a wrong request.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Final, TypeAlias
from urllib.parse import unquote_to_bytes

from orinkit.core.errors import (
    ConnectFailed,
    ConnectionLost,
    InvalidAddress,
    InvalidValue,
    LimitExceeded,
    OrinError,
    ProtocolError,
    TransportError,
)
from orinkit.core.i18n import N_, tr
from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import Credentials
from orinkit.transport.http.body import Body
from orinkit.transport.link_errors import lost
from orinkit.values.codec import DEFAULT_LIMITS

MOST: Final = DEFAULT_LIMITS.packet + 65536
"""The largest number of bytes of a reply, by default."""
BEGIN: Final = 5
"""Number of bytes at the beginning of a reply that are checked."""
PATIENCE: Final = 180.0
"""Time-out of a call, s, for a server that does not report that the call is still executing."""
KEPT: Final = 4.0
"""Time in s for which an idle connection is reused; servers close idle connections after 5 s or more."""
SHOWN: Final = 4096
"""The largest number of bytes that are read from the body of an error response."""
SHOWING: Final = 1.0
"""Time-out for reading the body of an error response, s."""
NEED: Final = N_("e-CAP over HTTP")

_ALERT: Final = b"\x15\x03"  # a TLS alert record: the reply of a TLS server to plain text
_EXECUTING: Final = "Orinkit-Executing"
_SIGNS: Final = 400  # requested interval at which a server reports that a call is executing, ms
_FEWEST: Final = 80  # smallest allowed interval, ms
_QUICK: Final = re.compile(rb"Func=[12](?![0-9])")  # Service_Start and Service_Stop: fast on every server
_WATCHED: Final = re.compile(r"orinkit-[0-9]{1,5}")
_COOKIES: Final = 20
_COOKIE: Final = 4096  # maximum number of characters of a cookie
_LINE: Final = 200  # maximum number of characters of a text from the server
_HTTP: Final = b"HTTP/"
_TITLE: Final = re.compile(r"<title[^>]*>([^<]*)", re.IGNORECASE)
_PLAIN: Final = ("", "identity")
_FORM: Final = "application/x-www-form-urlencoded"
_DETAIL: Final = "orinkit-detail"
_READ: Final = ("orinkit-executing", "set-cookie", "content-encoding", "content-length", _DETAIL)
_LONGEST_DETAIL: Final = 4096  # maximum number of characters of an error description
_ENCODED: Final = "utf-8''"  # precedes percent-encoded text in a header (RFC 8187)

_EXCEPTIONS: Final[dict[int, Callable[[str], OrinError]]] = {
    401: ConnectFailed,
    403: ConnectFailed,
    404: ConnectFailed,
    405: ConnectFailed,
    407: ConnectFailed,
    408: TransportError,
    413: LimitExceeded,
    414: LimitExceeded,
    421: ConnectFailed,
    429: TransportError,
    431: LimitExceeded,
    502: ConnectionLost,
    503: ConnectionLost,
    504: ConnectionLost,
}
_NO_ECAP: Final = N_("That is not an e-CAP response. Try: check host, port and path of the e-CAP server")
_HINTS: Final = {
    403: N_(
        "The server denies access to this client. Try: read the message of the server, or ask the administrator "
        "of the server"
    ),
    405: N_("The server does not accept POST at this path. Try: an address with the path of the e-CAP service"),
    407: N_("A proxy requires a password. Try: an address that is reachable without a proxy"),
    408: N_("The request took too long to arrive; it was not executed. Try: repeat the request over a faster network"),
    421: N_(
        "The server does not serve this host name. Try: the IP address of the server, or configure the server for "
        "this host name"
    ),
    429: N_("Too many requests; this one was not executed. Try: repeat the request later"),
    500: N_("The server failed; it is unknown whether the call was executed. Try: check the server's log"),
    502: N_(
        "The upstream server cannot be reached; it is unknown whether the call was executed. Try: connect again later"
    ),
    503: N_("The server is shutting down or overloaded. Try: connect again later"),
    504: N_(
        "The upstream server does not respond; it is unknown whether the call was executed. Try: connect again later"
    ),
}

Fields: TypeAlias = Iterable[tuple[str, str]]
"""Headers of a response: names in lower case, and values."""


class HttpServerInfo:
    """The state of a client's HTTP exchange with a server: session cookies, and capabilities of the server.

    Args:
        address: The address of the server.
        access: The client's credentials.
        most: The largest number of bytes of a reply.

    Attributes:
        address: The address of the server.
        most: The largest number of bytes of a reply.
        patience: Time-out of a call, s, for a server that does not report that the call is still executing.
        reports_executing: True if the server is one that reports that a call is still executing; ``None`` if that is
            not known yet.

    Raises:
        InvalidValue: If the token cannot be sent in a header.
    """

    def __init__(self, address: HttpAddress, access: Credentials, most: int) -> None:
        self.address = address
        self.most = most
        self.patience = PATIENCE
        self.reports_executing: bool | None = None
        self._token = _checked_token(access.token)
        self._content_type = _FORM + (f"; charset={access.charset}" if access.charset else "")
        self._session_ended = False
        self._cookies: dict[str, str] = {}

    @property
    def url(self) -> str:
        """The URL of the server in requests: without the zone of an IPv6 address, which is local to this machine."""
        host = self.address.host
        return str(self.address._replace(host=host.partition("%")[0] if ":" in host else host))

    def fields(self, seconds: float) -> list[tuple[str, str]]:
        """Return the headers of a request.

        Args:
            seconds: Time-out of the reply, s; the server is requested to report at least twice in this time that the
                call is executing.

        Raises:
            ConnectionLost: If the session has ended.
        """
        if self._session_ended:
            raise _session_ended()
        fields = [
            ("Accept-Encoding", "identity"),
            ("User-Agent", "orinkit"),
            ("Content-Type", self._content_type),
            (_EXECUTING, str(int(max(_FEWEST, min(_SIGNS, seconds * 500))))),
        ]
        if self._token:
            fields.append(("Authorization", f"Bearer {self._token}"))
        if self._cookies:
            fields.append(("Cookie", "; ".join(f"{name}={value}" for name, value in dict(self._cookies).items())))
        return fields

    def wait(self, request: bytes, seconds: float) -> float:
        """Return the time to wait for the reply to a request, s.

        It is ``seconds``, the time-out of the client. If the server does not report that a call is executing, the time
        is extended to :attr:`patience`.
        """
        if self.reports_executing is False and not _QUICK.match(request):
            return max(seconds, self.patience)
        return seconds

    def accept(self, fields: Fields) -> Body:
        """Process the headers of a response with status 200, and return its body, which is still to be received.

        Raises:
            ConnectionLost: If the session has ended.
            ProtocolError: If the body is compressed, which was not requested.
            LimitExceeded: If the body is too long.
        """
        known = [(name, value) for name, value in fields if name in _READ]
        self.reports_executing = any(name == _EXECUTING.lower() for name, _ in known)
        replaced = [self._keep(value) for name, value in known if name == "set-cookie"]
        if any(replaced):
            self._session_ended = True  # permanently, because later replies belong to a new session without objects
            raise _session_ended()
        for name, value in known:
            if name == "content-encoding" and value.strip().lower() not in _PLAIN:
                what = tidy(value)
                raise self._strange(tr("it sent a reply compressed with {what}", what=what))
            if name == "content-length" and value.isdecimal() and int(value) > self.most:
                raise self._too_long()
        detail = next((value for name, value in known if name == _DETAIL), "")
        return Body(self.most, self._too_long, self._strange, _detail_bytes(detail[:_LONGEST_DETAIL]))

    def _keep(self, text: str) -> bool:
        """Store a cookie, or delete it if the server requests that; return True if it belongs to a new session."""
        pair, *attributes = text.split(";")
        name, equals, value = (part.strip() for part in pair.partition("="))
        if not name or not equals or len(pair) > _COOKIE or not (pair.isascii() and pair.isprintable()):
            return False
        before = self._cookies.get(name)
        if not value or any(map(_deletes_cookie, attributes)):
            self._cookies.pop(name, None)
            return False
        if before is None and len(self._cookies) >= _COOKIES:
            return False
        self._cookies[name] = value
        return before not in (None, value) and _WATCHED.fullmatch(name) is not None

    def refusal(self, status: int, fields: Fields, body: bytes, asked: int) -> OrinError:
        """Return the exception for a response with a status other than 200.

        Args:
            status: The status of the response.
            fields: The headers of the response.
            body: The received part of the body.
            asked: The number of bytes of the request.
        """
        where = next((tidy(value) for name, value in fields if name == "location"), "")
        line = first_line(body)
        name = f"{status} {_phrase(status)}".strip()
        quoted = line and line != name and status != HTTPStatus.UNAUTHORIZED  # the hint describes the cause
        said = f"{name} ({line})" if quoted else name
        kind = ConnectFailed if 300 <= status < 400 else _EXCEPTIONS.get(status, ProtocolError)
        hint = self._hint(status, kind, where, asked)
        return kind(tr("{address} returned HTTP {said}. {hint}", address=self.address, said=said, hint=hint))

    def _hint(self, status: int, kind: Callable[[str], OrinError], where: str, asked: int) -> str:
        if status == HTTPStatus.UNAUTHORIZED:
            return _wrong_token() if self._token else _missing_token()
        if where and kind is ConnectFailed:
            return _redirected(where)
        if kind is LimitExceeded:
            return _long_request(asked)
        return tr(_HINTS.get(status, _NO_ECAP))

    def check_begin(self, begin: bytes) -> None:
        """Check the first bytes of a reply.

        Raises:
            ProtocolError: If the server does not use HTTP.
        """
        if begin[:2] == _ALERT:
            raise self._speaks_tls()
        if begin[:BEGIN] != _HTTP[: len(begin)]:
            raise self._strange(tr("it sent data that is not HTTP, {begin!r}", begin=begin[:BEGIN]))

    def check_closed(self) -> None:
        """Handle a connection that the server has closed without a reply.

        Raises:
            ConnectionLost: If the server has never replied; it may use TLS.
        """
        if self.reports_executing is None and self.address.scheme == "http":
            secure = str(self.address._replace(scheme="https"))
            raise ConnectionLost(
                tr(
                    "{address}: the server closed the connection without a reply. Try: {secure}, if the server uses TLS",
                    address=self.address,
                    secure=secure,
                )
            )

    def broken(self, reason: Exception, *, ended: bool) -> OrinError:
        """Return the exception for a response that violates HTTP.

        Args:
            reason: The violation.
            ended: True if the response is only truncated.
        """
        if ended:
            return lost(tr("the peer closed the connection in the middle of the reply"))
        return self._strange(tidy(str(reason)))

    def _strange(self, what: str) -> ProtocolError:
        return ProtocolError(
            tr(
                "the server at {address} is not an e-CAP server: {what}. Try: check the port; use "
                "https:// for a server with TLS, tcp:// for b-CAP",
                address=self.address,
                what=what,
            )
        )

    def _speaks_tls(self) -> ProtocolError:
        secure = str(self.address._replace(scheme="https"))
        return ProtocolError(tr("the server at {address} uses TLS. Try: {secure}", address=self.address, secure=secure))

    def _too_long(self) -> LimitExceeded:
        return LimitExceeded(
            tr("the reply of {address} has more than {most} bytes", address=self.address, most=self.most)
        )


def first_line(body: bytes) -> str:
    """Return the first line of a text from a server, or the title of an HTML page, shortened and printable."""
    text = body.decode("utf-8", "replace").lstrip("\ufeff \t\r\n")
    if text.startswith("<"):
        title = _TITLE.search(text)
        return tidy(title[1]) if title else ""
    return tidy(text.partition("\n")[0])


def tidy(text: str) -> str:
    """Return a text from the peer as one printable line."""
    line = " ".join(text.split())
    return "".join(sign for sign in line[: _LINE + 1] if sign.isprintable())[:_LINE]


def tls_failed(address: HttpAddress, error: Exception) -> ConnectFailed:
    """Return the exception for a server whose certificate is not trusted, or that does not use TLS."""
    return ConnectFailed(
        tr(
            "cannot connect to {address}: {error}. Try: pass a PEM file with the certificate of the server or of "
            "its issuer as cafile= (--cafile), or use the host name in the certificate; use http:// if the server "
            "does not use TLS",
            address=address,
            error=error,
        )
    )


def no_url(address: HttpAddress, error: Exception) -> InvalidAddress:
    """Return the exception for an address that cannot be part of a URL."""
    return InvalidAddress(
        tr(
            "invalid address '{address!s:.200}': {error}. Try: a name of letters, digits and hyphens, or an IP address",
            address=address,
            error=error,
        )
    )


def no_certificates(cafile: str, error: Exception) -> InvalidValue:
    """Return the exception for a file without certificates."""
    return InvalidValue(
        tr(
            "cannot use cafile (--cafile) {cafile!r:.200}: {error}. Try: a PEM file, which contains -----BEGIN "
            "CERTIFICATE-----",
            cafile=cafile,
            error=error,
        )
    )


def _checked_token(token: str) -> str:
    if any(not "!" <= sign <= "~" for sign in token):
        raise InvalidValue(
            tr(
                "the token contains characters that are not allowed in a header. Try: letters, digits and - . _ ~ + "
                "/ = only, without a line feed at the end"
            )
        )
    return token


def _deletes_cookie(attribute: str) -> bool:
    name, _, value = (part.strip().lower() for part in attribute.partition("="))
    return name == "max-age" and (value == "0" or value.startswith("-"))


def _phrase(status: int) -> str:
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return ""


def _session_ended() -> ConnectionLost:
    return ConnectionLost(
        tr(
            "the session has ended: the server was restarted, or the client was idle for too "
            "long; the objects of this connection no longer exist. Try: connect again"
        )
    )


def _wrong_token() -> str:
    return tr("The token is wrong. Try: pass the token of the server as token= (--token-file)")


def _missing_token() -> str:
    return tr("The server requires a token. Try: pass token= (--token-file)")


def _redirected(where: str) -> str:
    return tr(
        "The server redirects to another address; redirects are not followed. Try: connect to {where} if that "
        "address is correct",
        where=where,
    )


def _long_request(asked: int) -> str:
    return tr("A request of {asked} bytes is too long for the server; it was not executed", asked=asked)


def _detail_bytes(text: str) -> bytes:
    """Return the text of a header in UTF-8; only text that is not ASCII is percent-encoded."""
    if text[: len(_ENCODED)].lower() == _ENCODED:
        return unquote_to_bytes(text[len(_ENCODED) :])
    return text.encode("utf-8", "replace")
