"""Where to connect or listen: ``tcp://192.168.0.1:5007`` and DENSO's ``tcp:192.168.0.1:5007``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from orinkit.errors import InvalidAddress
from orinkit.language import pick

DEFAULT_PORT: Final = 5007
"""The port of b-CAP (List 3-1)."""

_LATER: Final = {"udp", "serial", "com", "http", "https", "can"}
_FORM: Final = re.compile(
    r"(?:(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*):(?://)?)?(?P<host>\[[^\]]*\]|[^:/?#\[\]]*)(?::(?P<port>[^:/]*))?/?"
)


@dataclass(frozen=True, slots=True)
class Address:
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
    match = _FORM.fullmatch(text.strip())
    bare = match and match["scheme"] and not match["host"] and match["port"] is None
    if match is None or bare or not (match["host"] or "").strip("[]"):
        # "robot:5007" reads as a scheme and a host: it is a host and a port
        raise _bad(text, pick("no host is named", "ホストがありません"))
    scheme, host, port = (match["scheme"] or "tcp").lower(), match["host"].strip("[]"), match["port"]
    if match["scheme"] and "//" not in text and port is None and host.isdecimal() and scheme not in _LATER | {"tcp"}:
        scheme, host, port = "tcp", match["scheme"], host
    if scheme in _LATER:
        raise _bad(text, pick(f"{scheme} is not there yet; tcp is", f"{scheme} は未対応です (tcp のみ)"))
    if scheme != "tcp":
        raise _bad(text, pick(f"unknown transport {scheme!r}", f"トランスポート {scheme!r} は不明です"))
    number = DEFAULT_PORT if not port else int(port) if port.isdecimal() else -1
    if not 0 <= number <= 65535:
        raise _bad(text, pick(f"port {port} is not 0 to 65535", f"ポート {port} は 0～65535 ではありません"))
    return Address(scheme, host, number)


def _bad(text: str, reason: str) -> InvalidAddress:
    return InvalidAddress(
        pick(
            f"{text!r} is no address: {reason}. Example: tcp://192.168.0.1:5007",
            f"アドレス {text!r} が不正です: {reason}。例: tcp://192.168.0.1:5007",
        )
    )
