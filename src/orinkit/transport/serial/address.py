"""Addresses of serial lines: ``serial:///dev/ttyUSB0?baudrate=38400``, ``com:1:38400:N:8:1:0``, ``pty://``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import ClassVar, Final

from orinkit.core.i18n import tr
from orinkit.transport.address import LONGEST, PLAIN, bad_address, invalid_value_message, whole_number
from orinkit.transport.registry import SplitAddress

_BAUDRATES: Final = range(50, 20_000_001)
_STOPS: Final = {"1": 1.0, "1.0": 1.0, "1.5": 1.5, "2": 2.0, "2.0": 2.0}
_SETTINGS: Final = ("baudrate", "parity", "bits", "stop", "flow")


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """A serial port and its settings; ``str`` returns its URL.

    Attributes:
        path: The system's name of the port: ``/dev/ttyUSB0``, ``COM3``.
        baudrate: Bit rate, bit/s.
        parity: ``"N"`` none, ``"E"`` even, ``"O"`` odd, ``"M"`` mark, ``"S"`` space.
        bits: Data bits per character, 5 to 8.
        stop: Stop bits: 1, 1.5 or 2.
        flow: Flow control: 0 none, 1 XON/XOFF, 2 hardware (RTS/CTS).
    """

    scheme: ClassVar[str] = "serial"
    path: str
    baudrate: int = 38400
    parity: str = "N"
    bits: int = 8
    stop: float = 1.0
    flow: int = 0

    def __str__(self) -> str:
        from urllib.parse import quote  # imported here, because few programs use a serial port

        settings = f"baudrate={self.baudrate}&parity={self.parity}&bits={self.bits}&stop={self.stop:g}&flow={self.flow}"
        return f"serial://{quote(self.path, safe=PLAIN)}?{settings}"


@dataclass(frozen=True, slots=True)
class PtyAddress:
    """The address of a pair of pseudo-terminals that a server opens: a serial line without hardware."""

    scheme: ClassVar[str] = "pty"

    def __str__(self) -> str:
        return "pty://"


def parse_serial(given: SplitAddress) -> SerialAddress:
    """Parse the part after the scheme, for example ``/dev/ttyUSB0?baudrate=38400&parity=N&bits=8&stop=1&flow=0``."""
    from urllib.parse import unquote

    text = given.text
    place, mark, query = given.rest.partition("?")
    if place.startswith("dev/"):
        raise bad_address(text, tr("a path must begin with a slash"), "serial")
    settings: dict[str, str] = {}
    for part in query.split("&") if mark and query else ():
        name, _, value = part.partition("=")
        name = name.strip().lower()
        if name not in _SETTINGS or name in settings:
            raise bad_address(text, _wrong_setting(name, twice=name in settings), "serial")
        settings[name] = value.strip()
    return _port(text, unquote(place, errors="surrogateescape"), settings, "serial")


def parse_com(given: SplitAddress) -> SerialAddress:
    """Parse the part after ``com:``, for example ``1:38400:N:8:1:0``; a missing or empty setting has its default."""
    if given.url:
        return parse_serial(given)
    text = given.text
    place, *values = (part.strip() for part in given.rest.split(":"))
    if len(values) > len(_SETTINGS):
        reason = tr(
            "at most {count} settings may follow the port. Try: serial://PATH, if the path of the port contains colons",
            count=len(_SETTINGS),
        )
        raise bad_address(text, reason, "com")
    number = whole_number(place)
    if number > 0:
        place = f"COM{number}" if os.name == "nt" else f"/dev/ttyS{number - 1}"
    elif place.isdecimal():
        raise bad_address(text, tr("COM ports are numbered from 1"), "com")
    settings = {name: value for name, value in zip(_SETTINGS, values, strict=False) if value}
    return _port(text, place, settings, "com")


def _port(text: str, path: str, settings: dict[str, str], form: str) -> SerialAddress:
    path = path.strip()
    if not path or len(path) > LONGEST or any(sign < " " or "\ud800" <= sign <= "\udfff" for sign in path):
        reason = tr("a serial port is required")
        raise bad_address(text, reason, form)
    if os.name != "nt" and "/" not in path:
        path = f"/dev/{path}"
    baudrate = whole_number(settings.get("baudrate", "38400"))
    if baudrate not in _BAUDRATES:
        raise bad_address(
            text,
            invalid_value_message("baudrate", settings["baudrate"], f"{_BAUDRATES.start}-{_BAUDRATES.stop - 1}"),
            form,
        )
    parity = settings.get("parity", "N").upper()
    if len(parity) != 1 or parity not in "NEOMS":
        raise bad_address(text, invalid_value_message("parity", settings["parity"], "N, E, O, M, S"), form)
    bits = whole_number(settings.get("bits", "8"))
    if bits not in range(5, 9):
        raise bad_address(text, invalid_value_message("bits", settings["bits"], "5, 6, 7, 8"), form)
    stop = _STOPS.get(settings.get("stop", "1"))
    if stop is None:
        raise bad_address(text, invalid_value_message("stop", settings["stop"], "1, 1.5, 2"), form)
    flow = whole_number(settings.get("flow", "0"))
    if flow not in range(3):
        raise bad_address(
            text,
            invalid_value_message("flow", settings["flow"], tr("0 none, 1 XON/XOFF, 2 hardware")),
            form,
        )
    return SerialAddress(path, baudrate, parity, bits, stop, flow)


def parse_pty(given: SplitAddress) -> PtyAddress:
    """Parse ``pty://``, which has no further parts: the system chooses the terminals."""
    if given.rest:
        raise bad_address(given.text, tr("nothing may follow pty://, got {rest!r:.80}", rest=given.rest), "pty")
    return PtyAddress()


def _wrong_setting(name: str, *, twice: bool) -> str:
    if twice:
        return tr("{name} is given twice", name=name)
    known = ", ".join(_SETTINGS)
    return tr("unknown setting {name!r:.80}; known settings: {known}", name=name, known=known)
