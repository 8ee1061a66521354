"""Where to connect or listen: ``tcp://192.168.0.1:5007`` and DENSO's ``tcp:192.168.0.1:5007``."""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.errors import InvalidAddress
from orinkit.language import pick

DEFAULT_PORT: Final = 5007
"""The port of b-CAP (List 3-1)."""

_LATER: Final = ("udp", "serial", "com", "http", "https", "can")


class Address(NamedTuple):
    """A host and a port.

    Attributes:
        scheme: ``"tcp"``.
        host: name or address; an IPv6 address without its brackets.
        port: 0 to 65535; 0 lets a server take a free one.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def parse_address(text: str) -> Address:
    """Read a URL or a connection string; a bare host means TCP, a missing port 5007.

    Raises:
        InvalidAddress: it is none, or its transport is not there.
    """
    if not isinstance(text, str):
        raise _bad(repr(text), pick("a text is needed", "文字列が必要です"))
    scheme, rest = _split_scheme(text.strip())
    if scheme in _LATER:
        raise _bad(text, pick(f"{scheme} is not there yet; tcp is", f"{scheme} は未対応です (tcp のみ)"))
    if scheme != "tcp":
        raise _bad(text, pick(f"unknown transport {scheme!r}", f"トランスポート {scheme!r} は不明です"))
    host, port = _split_port(text, rest.removesuffix("/"))
    return Address(scheme, host, port)


def _split_scheme(place: str) -> tuple[str, str]:
    scheme, mark, rest = place.partition("://")
    if mark:
        return scheme.lower(), rest
    scheme, mark, rest = place.partition(":")
    if mark and scheme.lower() in ("tcp", *_LATER):
        return scheme.lower(), rest
    return "tcp", place


def _split_port(text: str, place: str) -> tuple[str, int]:
    if place.startswith("["):
        host, closing, rest = place[1:].partition("]")
        colon, port = rest[:1], rest[1:]
        whole = bool(closing) and colon in ("", ":")
    else:
        host, colon, port = place.partition(":")
        whole = ":" not in port
    if host.isdecimal():
        raise _bad(text, pick(f"{host} is no host", f"{host} はホストではありません"))
    if not whole or not host or any(sign in host for sign in " /?@#\0\t\r\n"):
        raise _bad(text, pick("a host and perhaps a port are needed", "ホストと、必要ならポートを指定してください"))
    if not colon:
        return host, DEFAULT_PORT
    number = int(port) if port.isascii() and port.isdecimal() and len(port) < 9 else -1
    if not 0 <= number <= 65535:
        raise _bad(text, pick(f"port {port!r} is not 0 to 65535", f"ポート {port!r} は 0～65535 ではありません"))
    return host, number


def _bad(text: str, reason: str) -> InvalidAddress:
    return InvalidAddress(
        pick(
            f"{text!r:.200} is no address: {reason}. Example: tcp://192.168.0.1:5007",
            f"アドレス {text!r:.200} が不正です: {reason}。例: tcp://192.168.0.1:5007",
        )
    )
