"""What the links over HTTP have in common, without I/O: headers, cookies, and what each reply means.

A reply with status 200 has an answer of e-CAP in its body. Any other is an exception, which says what to try:

==================================================  ===============================================================
301 and other redirects, 401, 403, 404, 405, 407,   ``ConnectFailed``: no e-CAP for this client at this address; the
421                                                 call was not carried out. A redirect is named, never followed.
408, 429                                            ``TransportError``: the call was not carried out; another one may be
413, 414, 431                                       ``LimitExceeded``: the request is too long for this server
502, 503, 504                                       ``ConnectionLost``: the server, or the one behind it, has gone
any other                                           ``ProtocolError``: not what e-CAP answers
==================================================  ===============================================================

What is no HTTP at all is a ``ProtocolError`` too. None of them is fatal: each reply has its own beginning, so nothing is
ever out of step.
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
"""Bytes of a reply, by default."""
BEGIN: Final = 5
"""How many bytes at the beginning of a reply are looked at."""
PATIENCE: Final = 180.0
"""Seconds that a server gets for a call that cannot say that it is at work."""
KEPT: Final = 4.0
"""Seconds that an idle connection is used again; servers close theirs after 5 s and more."""
SHOWN: Final = 4096
"""How many bytes of the body are read that comes with an error."""
SHOWING: Final = 1.0
"""Seconds that are waited for them."""
NEED: Final = N_("e-CAP over HTTP")

_ALERT: Final = b"\x15\x03"  # how TLS says no to what is none
_EXECUTING: Final = "Orinkit-Executing"
_SIGNS: Final = 400  # ms between the signs of a server that it is at work
_FEWEST: Final = 80  # ms, the least that is allowed
_QUICK: Final = re.compile(rb"Func=[12](?![0-9])")  # Service_Start and Service_Stop: no work for any server
_WATCHED: Final = re.compile(r"orinkit-[0-9]{1,5}")
_COOKIES: Final = 20
_COOKIE: Final = 4096  # characters
_LINE: Final = 200  # characters of a text of the server
_HTTP: Final = b"HTTP/"
_TITLE: Final = re.compile(r"<title[^>]*>([^<]*)", re.IGNORECASE)
_PLAIN: Final = ("", "identity")
_DETAIL: Final = "orinkit-detail"
_READ: Final = ("orinkit-executing", "set-cookie", "content-encoding", "content-length", _DETAIL)
_LONGEST_DETAIL: Final = 4096  # characters

_KINDS: Final[dict[int, Callable[[str], OrinError]]] = {
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
_NO_ECAP: Final = N_("That is no answer of e-CAP. Try: are host, port and path those of the server of e-CAP?")
_HINTS: Final = {
    403: N_("The server does not let this client in. Try: what it says of itself, or ask whoever runs it"),
    405: N_("There is a server, which does not take POST at this path. Try: the path of e-CAP"),
    407: N_("A proxy is in the way, and wants a password. Try: an address that is reached without one"),
    408: N_("The request took too long to arrive; it was not carried out. Try: again, over a faster network"),
    421: N_("The server does not go by this name. Try: its address, or have it serve this name too"),
    429: N_("There were too many requests; this one was not carried out. Try: again, a little later"),
    500: N_("The server has failed; whether the call was carried out is not known. Try: the server's log"),
    502: N_(
        "The server behind it cannot be reached; whether the call was carried out is not known. "
        "Try: connect again, later"
    ),
    503: N_("The server is closing, or has too much to do. Try: connect again, later"),
    504: N_(
        "The server behind it does not answer; whether the call was carried out is not known. Try: connect again, later"
    ),
}

Fields: TypeAlias = Iterable[tuple[str, str]]
"""Headers of a reply: names in lower case, and values."""


class HttpServerInfo:
    """What a client knows of a server, from one request to the next.

    Args:
        address: of the server.
        access: what lets a client in.
        most: bytes of a reply.

    Attributes:
        address: of the server.
        most: bytes of a reply.
        patience: seconds that a server gets for a call that cannot say that it is at work.
        tells: whether the server says that it is at work; ``None`` where that is not known yet.

    Raises:
        InvalidValue: the token cannot be sent.
    """

    def __init__(self, address: HttpAddress, access: Credentials, most: int) -> None:
        self.address = address
        self.most = most
        self.patience = PATIENCE
        self.tells: bool | None = None
        self._token = _checked(access.token)
        self._forgotten = False
        self._cookies: dict[str, str] = {}

    @property
    def url(self) -> str:
        """What the server is called in a request: without the zone of an IPv6 address, which is of this computer."""
        host = self.address.host
        return str(self.address._replace(host=host.partition("%")[0] if ":" in host else host))

    def fields(self, seconds: float) -> list[tuple[str, str]]:
        """Return the headers of a request.

        Args:
            seconds: that its answer is waited for; a sign of work comes twice in that time at least.

        Raises:
            ConnectionLost: the server knows this client no more.
        """
        if self._forgotten:
            raise _forgotten()
        fields = [
            ("Accept-Encoding", "identity"),
            ("User-Agent", "orinkit"),
            ("Content-Type", "application/x-www-form-urlencoded"),
            (_EXECUTING, str(int(max(_FEWEST, min(_SIGNS, seconds * 500))))),
        ]
        if self._token:
            fields.append(("Authorization", f"Bearer {self._token}"))
        if self._cookies:
            fields.append(("Cookie", "; ".join(f"{name}={value}" for name, value in dict(self._cookies).items())))
        return fields

    def wait(self, request: bytes, seconds: float) -> float:
        """Return how many seconds to wait for an answer where a client wants to wait ``seconds``."""
        if self.tells is False and not _QUICK.match(request):
            return max(seconds, self.patience)
        return seconds

    def accept(self, fields: Fields) -> Body:
        """Take note of the headers of a reply with status 200 and return its body, which has still to come.

        Raises:
            ConnectionLost: the server knows this client no more.
            ProtocolError: the body is compressed, which was not asked for.
            LimitExceeded: the body is too long.
        """
        known = [(name, value) for name, value in fields if name in _READ]
        self.tells = any(name == _EXECUTING.lower() for name, _ in known)
        replaced = [self._keep(value) for name, value in known if name == "set-cookie"]
        if any(replaced):
            self._forgotten = (
                True  # for good, whoever hears of it: what comes now is of a session that nobody has begun
            )
            raise _forgotten()
        for name, value in known:
            if name == "content-encoding" and value.strip().lower() not in _PLAIN:
                what = tidy(value)
                raise self._strange(tr("an answer compressed with {what}", what=what))
            if name == "content-length" and value.isdecimal() and int(value) > self.most:
                raise self._too_long()
        detail = next((value for name, value in known if name == _DETAIL), "")
        return Body(self.most, self._too_long, self._strange, unquote_to_bytes(detail[:_LONGEST_DETAIL]))

    def _keep(self, text: str) -> bool:
        """Keep a cookie, or throw it away where the server says so; returns whether it stands for another session."""
        pair, *attributes = text.split(";")
        name, equals, value = (part.strip() for part in pair.partition("="))
        if not name or not equals or len(pair) > _COOKIE or not (pair.isascii() and pair.isprintable()):
            return False
        before = self._cookies.get(name)
        if not value or any(map(_ends_it, attributes)):
            self._cookies.pop(name, None)
            return False
        if before is None and len(self._cookies) >= _COOKIES:
            return False
        self._cookies[name] = value
        return before not in (None, value) and _WATCHED.fullmatch(name) is not None

    def refusal(self, status: int, fields: Fields, body: bytes, asked: int) -> OrinError:
        """Return the exception for a reply with another status than 200.

        Args:
            status: of the reply.
            fields: its headers.
            body: as much as has come of it.
            asked: bytes of the request.
        """
        where = next((tidy(value) for name, value in fields if name == "location"), "")
        told = first_line(body)
        name = f"{status} {_phrase(status)}".strip()
        said = f"{name} ({told})" if told and told != name else name
        kind = ConnectFailed if 300 <= status < 400 else _KINDS.get(status, ProtocolError)
        hint = self._hint(status, kind, where, asked)
        return kind(tr("{address} answered HTTP {said}. {hint}", address=self.address, said=said, hint=hint))

    def _hint(self, status: int, kind: Callable[[str], OrinError], where: str, asked: int) -> str:
        if status == HTTPStatus.UNAUTHORIZED:
            return _wrong_token() if self._token else _missing_token()
        if where and kind is ConnectFailed:
            return _elsewhere(where)
        if kind is LimitExceeded:
            return _long_request(asked)
        return tr(_HINTS.get(status, _NO_ECAP))

    def check_begin(self, begin: bytes) -> None:
        """Check the first bytes of a reply.

        Raises:
            ProtocolError: what answers does not speak HTTP.
        """
        if begin[:2] == _ALERT:
            raise self._speaks_tls()
        if begin[:BEGIN] != _HTTP[: len(begin)]:
            raise self._strange(tr("something that is no HTTP, {begin!r}", begin=begin[:BEGIN]))

    def broken(self, reason: Exception, *, ended: bool) -> OrinError:
        """Return the exception for a reply that breaks the rules of HTTP.

        Args:
            reason: which of them.
            ended: it has ended too early, that is all.
        """
        if ended:
            return lost(tr("the other side closed it in the middle of the answer"))
        return self._strange(tidy(str(reason)))

    def _strange(self, what: str) -> ProtocolError:
        return ProtocolError(
            tr(
                "what answers at {address} is no server of e-CAP: {what}. Try: is the port right? A "
                "server with TLS is https://, b-CAP is tcp://",
                address=self.address,
                what=what,
            )
        )

    def _speaks_tls(self) -> ProtocolError:
        secure = str(self.address._replace(scheme="https"))
        return ProtocolError(
            tr("what answers at {address} is a server with TLS. Try: {secure}", address=self.address, secure=secure)
        )

    def _too_long(self) -> LimitExceeded:
        return LimitExceeded(tr("{address} answered with more than {most} bytes", address=self.address, most=self.most))


def first_line(body: bytes) -> str:
    """Return the first line of a text that a server sent, or the title of a page; short, and fit to be shown."""
    text = body.decode("utf-8", "replace").lstrip("\ufeff \t\r\n")
    if text.startswith("<"):
        title = _TITLE.search(text)
        return tidy(title[1]) if title else ""
    return tidy(text.partition("\n")[0])


def tidy(text: str) -> str:
    """Return a text of the other side as one line that can be shown."""
    line = " ".join(text.split())
    return "".join(sign for sign in line[: _LINE + 1] if sign.isprintable())[:_LINE]


def tls_failed(address: HttpAddress, error: Exception) -> ConnectFailed:
    """Return the exception for a server whose certificate is not trusted, or that has no TLS."""
    return ConnectFailed(
        tr(
            "cannot connect to {address}: {error}. Try: cafile= (--cafile), a PEM file with the "
            "server's certificate or the one that it is signed by; the name in the certificate; "
            "http:// if the server has no TLS",
            address=address,
            error=error,
        )
    )


def no_url(address: HttpAddress, error: Exception) -> InvalidAddress:
    """Return the exception for an address that no URL can have."""
    return InvalidAddress(
        tr(
            "'{address!s:.200}' is no address: {error}. Try: a name of letters, digits and hyphens, or an IP address",
            address=address,
            error=error,
        )
    )


def no_certificates(cafile: str, error: Exception) -> InvalidValue:
    """Return the exception for a file that has no certificates."""
    return InvalidValue(
        tr(
            "cafile (--cafile) {cafile!r:.200} cannot be used: {error}. Try: a PEM file, -----BEGIN CERTIFICATE-----",
            cafile=cafile,
            error=error,
        )
    )


def _checked(token: str) -> str:
    if any(not "!" <= sign <= "~" for sign in token):
        raise InvalidValue(
            tr(
                "the token has signs in it that a header cannot have. Try: letters, digits and - . _ ~ + "
                "/ = only, and no line feed at its end"
            )
        )
    return token


def _ends_it(attribute: str) -> bool:
    name, _, value = (part.strip().lower() for part in attribute.partition("="))
    return name == "max-age" and (value == "0" or value.startswith("-"))


def _phrase(status: int) -> str:
    try:
        return HTTPStatus(status).phrase
    except ValueError:
        return ""


def _forgotten() -> ConnectionLost:
    return ConnectionLost(
        tr(
            "the session has ended: the server was started again, or nothing was said to it for too "
            "long; the objects of this connection are gone. Try: connect again"
        )
    )


def _wrong_token() -> str:
    return tr("The token is wrong")


def _missing_token() -> str:
    return tr("The server lets in only who has its token. Try: token= (--token-file)")


def _elsewhere(where: str) -> str:
    return tr(
        "It names another address, which is not gone to by itself. Try, if it is the right one: {where}", where=where
    )


def _long_request(asked: int) -> str:
    return tr("A request of {asked} bytes is too long for it; it was not carried out", asked=asked)
