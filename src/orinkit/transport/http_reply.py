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

from orinkit.errors import (
    ConnectFailed,
    ConnectionLost,
    InvalidAddress,
    InvalidValue,
    LimitExceeded,
    OrinError,
    ProtocolError,
    TransportError,
)
from orinkit.language import pick
from orinkit.transport.access import Access
from orinkit.transport.address import HttpAddress
from orinkit.transport.http_body import Body
from orinkit.transport.link_errors import lost
from orinkit.variant_bytes import DEFAULT_LIMITS

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
NEED: Final = ("e-CAP over HTTP", "HTTP による e-CAP ")

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
_NO_ECAP: Final = (
    "That is no answer of e-CAP. Try: are host, port and path those of the server of e-CAP?",
    "e-CAP の応答ではありません。対処: e-CAP サーバのホスト、ポート、パスを確認してください",
)
_HINTS: Final = {
    403: (
        "The server does not let this client in. Try: what it says of itself, or ask whoever runs it",
        "サーバがこのクライアントを拒否しています。対処: サーバのメッセージを確認するか、管理者に問い合わせてください",
    ),
    405: (
        "There is a server, which does not take POST at this path. Try: the path of e-CAP",
        "サーバはこのパスで POST を受け付けません。対処: e-CAP のパスを指定してください",
    ),
    407: (
        "A proxy is in the way, and wants a password. Try: an address that is reached without one",
        "途中のプロキシが認証を求めています。対処: プロキシを経由しないアドレスを使ってください",
    ),
    408: (
        "The request took too long to arrive; it was not carried out. Try: again, over a faster network",
        "要求の受信に時間がかかりすぎました。実行されていません。対処: もう一度実行するか、ネットワークを確認してください",
    ),
    421: (
        "The server does not go by this name. Try: its address, or have it serve this name too",
        "サーバはこの名前では応答しません。対処: サーバのアドレスを使うか、この名前をサーバに登録してください",
    ),
    429: (
        "There were too many requests; this one was not carried out. Try: again, a little later",
        "要求が多すぎます。実行されていません。対処: 少し待ってからもう一度実行してください",
    ),
    500: (
        "The server has failed; whether the call was carried out is not known. Try: the server's log",
        "サーバ内部のエラーです。実行されたかどうかは不明です。対処: サーバのログを確認してください",
    ),
    502: (
        "The server behind it cannot be reached; whether the call was carried out is not known. Try: connect again, later",
        "中継先のサーバに接続できません。実行されたかどうかは不明です。対処: 後で接続し直してください",
    ),
    503: (
        "The server is closing, or has too much to do. Try: connect again, later",
        "サーバが終了中か、過負荷です。対処: 後で接続し直してください",
    ),
    504: (
        "The server behind it does not answer; whether the call was carried out is not known. Try: connect again, later",
        "中継先のサーバから応答がありません。実行されたかどうかは不明です。対処: 後で接続し直してください",
    ),
}

Fields: TypeAlias = Iterable[tuple[str, str]]
"""Headers of a reply: names in lower case, and values."""


class Contact:
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

    def __init__(self, address: HttpAddress, access: Access, most: int) -> None:
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
                raise self._strange(pick(f"an answer compressed with {what}", f"{what} で圧縮された応答です"))
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
        return kind(
            pick(f"{self.address} answered HTTP {said}. {hint}", f"{self.address} の応答は HTTP {said} です。{hint}")
        )

    def _hint(self, status: int, kind: Callable[[str], OrinError], where: str, asked: int) -> str:
        if status == HTTPStatus.UNAUTHORIZED:
            return _wrong_token() if self._token else _missing_token()
        if where and kind is ConnectFailed:
            return _elsewhere(where)
        if kind is LimitExceeded:
            return _long_request(asked)
        return pick(*_HINTS.get(status, _NO_ECAP))

    def check_begin(self, begin: bytes) -> None:
        """Check the first bytes of a reply.

        Raises:
            ProtocolError: what answers does not speak HTTP.
        """
        if begin[:2] == _ALERT:
            raise self._speaks_tls()
        if begin[:BEGIN] != _HTTP[: len(begin)]:
            raise self._strange(
                pick(f"something that is no HTTP, {begin[:BEGIN]!r}", f"HTTP ではありません ({begin[:BEGIN]!r})")
            )

    def broken(self, reason: Exception, *, ended: bool) -> OrinError:
        """Return the exception for a reply that breaks the rules of HTTP.

        Args:
            reason: which of them.
            ended: it has ended too early, that is all.
        """
        if ended:
            return lost(
                pick("the other side closed it in the middle of the answer", "応答の途中で相手が接続を閉じました")
            )
        return self._strange(tidy(str(reason)))

    def _strange(self, what: str) -> ProtocolError:
        return ProtocolError(
            pick(
                f"what answers at {self.address} is no server of e-CAP: {what}. Try: is the port right? "
                "A server with TLS is https://, b-CAP is tcp://",
                f"{self.address} は e-CAP サーバではありません: {what}。対処: ポートを確認してください。"
                "TLS のサーバは https://、b-CAP は tcp:// です",
            )
        )

    def _speaks_tls(self) -> ProtocolError:
        secure = str(self.address._replace(scheme="https"))
        return ProtocolError(
            pick(
                f"what answers at {self.address} is a server with TLS. Try: {secure}",
                f"{self.address} は TLS のサーバです。対処: {secure} を使ってください",
            )
        )

    def _too_long(self) -> LimitExceeded:
        return LimitExceeded(
            pick(
                f"{self.address} answered with more than {self.most} bytes",
                f"{self.address} の応答が上限 {self.most} バイトを超えました",
            )
        )


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
        pick(
            f"cannot connect to {address}: {error}. Try: cafile= (--cafile), a PEM file with the server's certificate or "
            "the one that it is signed by; the name in the certificate; http:// if the server has no TLS",
            f"{address} に接続できません: {error}。対処: サーバ証明書またはその発行者の証明書 (PEM) を cafile= (--cafile) で指定するか、"
            "証明書の名前を確認してください。TLS のないサーバなら http:// を使ってください",
        )
    )


def no_url(address: HttpAddress, error: Exception) -> InvalidAddress:
    """Return the exception for an address that no URL can have."""
    return InvalidAddress(
        pick(
            f"'{address!s:.200}' is no address: {error}. Try: a name of letters, digits and hyphens, or an IP address",
            f"'{address!s:.200}' はアドレスとして使えません: {error}。対処: 英数字とハイフンの名前か IP アドレスを使ってください",
        )
    )


def no_certificates(cafile: str, error: Exception) -> InvalidValue:
    """Return the exception for a file that has no certificates."""
    return InvalidValue(
        pick(
            f"cafile (--cafile) {cafile!r:.200} cannot be used: {error}. Try: a PEM file, -----BEGIN CERTIFICATE-----",
            f"cafile (--cafile) {cafile!r:.200} は使用できません: {error}。対処: PEM ファイル (-----BEGIN CERTIFICATE-----) を指定してください",
        )
    )


def _checked(token: str) -> str:
    if any(not "!" <= sign <= "~" for sign in token):
        raise InvalidValue(
            pick(
                "the token has signs in it that a header cannot have. Try: letters, digits and - . _ ~ + / = only, and no "
                "line feed at its end",
                "トークンに HTTP ヘッダで使えない文字があります。対処: 英数字と - . _ ~ + / = だけを使い、末尾の改行を除いてください",
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
        pick(
            "the session has ended: the server was started again, or nothing was said to it for too long; the objects of "
            "this connection are gone. Try: connect again",
            "セッションは終了しています。サーバが再起動されたか、長時間呼び出しがありませんでした。この接続のオブジェクトは"
            "無効です。対処: 接続し直してください",
        )
    )


def _wrong_token() -> str:
    return pick("The token is wrong", "トークンが間違っています")


def _missing_token() -> str:
    return pick(
        "The server lets in only who has its token. Try: token= (--token-file)",
        "このサーバにはトークンが必要です。対処: token= (--token-file) を指定してください",
    )


def _elsewhere(where: str) -> str:
    return pick(
        f"It names another address, which is not gone to by itself. Try, if it is the right one: {where}",
        f"別のアドレスが示されましたが、自動では移動しません。正しければ次のアドレスを使ってください: {where}",
    )


def _long_request(asked: int) -> str:
    return pick(
        f"A request of {asked} bytes is too long for it; it was not carried out",
        f"{asked} バイトの要求は長すぎます。実行されていません",
    )
