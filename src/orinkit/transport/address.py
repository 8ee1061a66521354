"""Where to connect or listen: ``tcp://192.168.0.1:5007``, ``udp://...``, ``serial:///dev/ttyUSB0``, ``http://...``.

DENSO's connection strings too: ``tcp:192.168.0.1:5007``, ``udp:192.168.0.1:5007``, ``com:1:38400:N:8:1:0``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, TypeAlias

from orinkit._pose_checks import brief
from orinkit.errors import InvalidAddress
from orinkit.language import pick

DEFAULT_PORT: Final = 5007
"""The port of b-CAP (List 3-1)."""

_HOSTS: Final = ("tcp", "udp")
_PORTS: Final = ("serial", "com")
_WEB: Final = {"http": 80, "https": 443}
_LATER: Final = ("can",)
_KNOWN: Final = (*_HOSTS, *_PORTS, "pty", *_WEB, *_LATER)
_LONGEST: Final = 4000  # characters of a path
_BAUDRATES: Final = range(50, 20_000_001)
_STOPS: Final = {"1": 1.0, "1.0": 1.0, "1.5": 1.5, "2": 2.0, "2.0": 2.0}
_EXAMPLE: Final = "tcp://192.168.0.1:5007"
_SERIAL_EXAMPLE: Final = "serial:///dev/ttyUSB0?baudrate=38400"


class Address(NamedTuple):
    """A host and a port.

    Attributes:
        scheme: ``"tcp"`` or ``"udp"``.
        host: name or address; an IPv6 address without its brackets.
        port: 0 to 65535; 0 lets a server take a free one.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """A serial port and how it is set; ``str`` gives its URL.

    Attributes:
        path: as the system names it: ``/dev/ttyUSB0``, ``COM3``.
        baudrate: bits in a second.
        parity: ``"N"`` none, ``"E"`` even, ``"O"`` odd, ``"M"`` mark, ``"S"`` space.
        bits: of a character, 5 to 8.
        stop: stop bits: 1, 1.5 or 2.
        flow: 0 no flow control, 1 XON/XOFF, 2 hardware (RTS/CTS).
    """

    scheme: ClassVar[str] = "serial"
    path: str
    baudrate: int = 38400
    parity: str = "N"
    bits: int = 8
    stop: float = 1.0
    flow: int = 0

    def __str__(self) -> str:
        from urllib.parse import quote  # few programs have a serial port

        settings = f"baudrate={self.baudrate}&parity={self.parity}&bits={self.bits}&stop={self.stop:g}&flow={self.flow}"
        return f"serial://{quote(self.path, safe=_PLAIN)}?{settings}"


class HttpAddress(NamedTuple):
    """Where e-CAP is spoken; ``str`` gives its URL.

    Attributes:
        scheme: ``"http"`` or ``"https"``.
        host: name or address; an IPv6 address without its brackets.
        port: 0 to 65535; 0 lets a server take a free one.
        path: from the first slash on; a server answers at every path.
    """

    scheme: str
    host: str
    port: int
    path: str = "/"

    def __str__(self) -> str:
        return f"{Address(self.scheme, self.host, self.port)}{self.path if self.path != '/' else ''}"


@dataclass(frozen=True, slots=True)
class PtyAddress:
    """A pair of pseudo-terminals that a server opens: a serial line without any hardware."""

    scheme: ClassVar[str] = "pty"

    def __str__(self) -> str:
        return "pty://"


AnyAddress: TypeAlias = Address | HttpAddress | SerialAddress | PtyAddress
_PLAIN: Final = "/\\:.,-_+@"  # what a path has often, and stays readable


def parse_address(text: str) -> AnyAddress:
    """Read a URL or a connection string; a bare host means TCP, a missing port 5007.

    Raises:
        InvalidAddress: it is none, or its transport is not there.
    """
    if not isinstance(text, str):
        raise _bad(brief(text), pick("a text is needed", "文字列が必要です"))
    scheme, rest, url = _split_scheme(text.strip())
    if text.strip().startswith("/"):
        raise _bad(
            text,
            pick("a serial port has serial:// before it", "シリアルポートは serial:// を付けてください"),
            _SERIAL_EXAMPLE,
        )
    if scheme in _HOSTS:
        return Address(scheme, *_split_port(text, rest.removesuffix("/"), scheme))
    if scheme in _WEB:
        return _http(text, rest, scheme)
    if scheme in _PORTS:
        return _serial(text, rest) if url or scheme == "serial" else _com(text, rest)
    if scheme == "pty":
        if rest:
            raise _bad(
                text,
                pick(f"pty takes nothing more, not {rest!r:.80}", f"pty に {rest!r:.80} は指定できません"),
                "pty://",
            )
        return PtyAddress()
    known = "tcp, udp, http, https, serial, com"
    if scheme in _LATER:
        raise _bad(text, pick(f"{scheme} is not there yet; {known} are", f"{scheme} は未対応です (対応: {known})"))
    raise _bad(
        text,
        pick(
            f"unknown transport {scheme!r:.80}; {known} are known",
            f"トランスポート {scheme!r:.80} は不明です (対応: {known})",
        ),
    )


def _split_scheme(place: str) -> tuple[str, str, bool]:
    scheme, mark, rest = place.partition("://")
    if mark:
        return scheme.lower(), rest, True
    scheme, mark, rest = place.partition(":")
    if mark and scheme.lower() in _KNOWN:
        return scheme.lower(), rest, False
    return "tcp", place, False


def _split_port(text: str, place: str, scheme: str) -> tuple[str, int]:
    usual = _WEB.get(scheme, DEFAULT_PORT)
    example = f"{scheme}://192.168.0.1:{usual if scheme not in _WEB else 8080}"
    if place.startswith("["):
        host, closing, rest = place[1:].partition("]")
        colon, port = rest[:1], rest[1:]
        whole = bool(closing) and colon in ("", ":")
    else:
        host, colon, port = place.partition(":")
        whole = ":" not in port
    if host.isdecimal():
        raise _bad(text, pick(f"{host:.80} is no host", f"{host:.80} はホストではありません"), example)
    if not whole or not host or any(sign in host for sign in " /?@#[]\0\t\r\n"):
        reason = pick("a host and perhaps a port are needed", "ホストと、必要ならポートを指定してください")
        raise _bad(text, reason, example)
    if not colon:
        return host, usual
    number = _whole(port)
    if not 0 <= number <= 65535:
        reason = pick(f"port {port!r:.80} is not 0 to 65535", f"ポート {port!r:.80} は 0～65535 ではありません")
        raise _bad(text, reason, example)
    return host, number


def _http(text: str, rest: str, scheme: str) -> HttpAddress:
    """Read ``127.0.0.1:8080/path?query``."""
    place, slash, path = rest.partition("/")
    if "?" in place or "#" in rest or any(not "!" <= sign <= "~" for sign in path):
        reason = pick(
            "a path has no blanks, no # and only ASCII: others are written %XX",
            "パスに空白、#、ASCII 以外の文字は使えません (%XX の形で指定してください)",
        )
        raise _bad(text, reason, f"{scheme}://192.168.0.1:8080/ecap")
    return HttpAddress(scheme, *_split_port(text, place, scheme), slash + path or "/")


# --- serial ports -----------------------------------------------------------------------------------------------------


def _serial(text: str, rest: str) -> SerialAddress:
    """Read ``/dev/ttyUSB0?baudrate=38400&parity=N&bits=8&stop=1&flow=0``."""
    from urllib.parse import unquote

    place, mark, query = rest.partition("?")
    if place.startswith("dev/"):
        raise _bad(text, pick("a path begins with a slash", "パスはスラッシュで始まります"), _SERIAL_EXAMPLE)
    settings: dict[str, str] = {}
    for part in query.split("&") if mark and query else ():
        name, _, value = part.partition("=")
        name = name.strip().lower()
        if name not in _SETTINGS or name in settings:
            raise _bad(text, _wrong_setting(name, twice=name in settings), _SERIAL_EXAMPLE)
        settings[name] = value.strip()
    return _port(text, unquote(place, errors="surrogateescape"), settings, _SERIAL_EXAMPLE)


def _com(text: str, rest: str) -> SerialAddress:
    """Read ``1:38400:N:8:1:0``; what is left out, or empty, is as usual."""
    example = "com:1:38400:N:8:1:0"
    place, *values = (part.strip() for part in rest.split(":"))
    if len(values) > len(_SETTINGS):
        reason = pick(
            f"at most {len(_SETTINGS)} settings follow the port, a path with colons needs the form serial://",
            f"ポートに続く設定は {len(_SETTINGS)} 個までです。コロンを含むパスは serial:// の形式で指定してください",
        )
        raise _bad(text, reason, example)
    number = _whole(place)
    if number > 0:
        place = f"COM{number}" if os.name == "nt" else f"/dev/ttyS{number - 1}"
    elif place.isdecimal():
        raise _bad(text, pick("COM ports count from 1", "COM ポートの番号は 1 からです"), example)
    settings = {name: value for name, value in zip(_SETTINGS, values, strict=False) if value}
    return _port(text, place, settings, example)


def _port(text: str, path: str, settings: dict[str, str], example: str) -> SerialAddress:
    path = path.strip()
    if not path or len(path) > _LONGEST or any(sign < " " or "\ud800" <= sign <= "\udfff" for sign in path):
        reason = pick("a serial port is needed", "シリアルポートを指定してください")
        raise _bad(text, reason, example)
    if os.name != "nt" and "/" not in path:
        path = f"/dev/{path}"
    baudrate = _whole(settings.get("baudrate", "38400"))
    if baudrate not in _BAUDRATES:
        raise _bad(
            text, _wrong_value("baudrate", settings["baudrate"], f"{_BAUDRATES.start}-{_BAUDRATES.stop - 1}"), example
        )
    parity = settings.get("parity", "N").upper()
    if len(parity) != 1 or parity not in "NEOMS":
        raise _bad(text, _wrong_value("parity", settings["parity"], "N, E, O, M, S"), example)
    bits = _whole(settings.get("bits", "8"))
    if bits not in range(5, 9):
        raise _bad(text, _wrong_value("bits", settings["bits"], "5, 6, 7, 8"), example)
    stop = _STOPS.get(settings.get("stop", "1"))
    if stop is None:
        raise _bad(text, _wrong_value("stop", settings["stop"], "1, 1.5, 2"), example)
    flow = _whole(settings.get("flow", "0"))
    if flow not in range(3):
        raise _bad(
            text,
            _wrong_value(
                "flow", settings["flow"], pick("0 none, 1 XON/XOFF, 2 hardware", "0 なし、1 XON/XOFF、2 ハードウェア")
            ),
            example,
        )
    return SerialAddress(path, baudrate, parity, bits, stop, flow)


_SETTINGS: Final = ("baudrate", "parity", "bits", "stop", "flow")


def _wrong_setting(name: str, *, twice: bool) -> str:
    if twice:
        return pick(f"{name} is given twice", f"{name} が 2 回指定されています")
    known = ", ".join(_SETTINGS)
    return pick(f"there is no setting {name!r:.80}; {known} are known", f"設定 {name!r:.80} はありません ({known})")


def _wrong_value(name: str, value: str, known: str) -> str:
    return pick(
        f"{name} cannot be {value!r:.80}; known: {known}", f"{name} に {value!r:.80} は指定できません ({known})"
    )


def _whole(text: str) -> int:
    """Return a whole number, -1 for what is none."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 9 else -1


def _bad(text: str, reason: str, example: str = _EXAMPLE) -> InvalidAddress:
    return InvalidAddress(
        pick(
            f"{text!r:.200} is no address: {reason}. Example: {example}",
            f"アドレス {text!r:.200} が不正です: {reason}。例: {example}",
        )
    )
