"""Facts about a packet for a list: :class:`PacketFacts`, and its summary in one line."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from orinkit.bcap import packet as bcap
from orinkit.bcap.dissect import one_line
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, OrinError
from orinkit.core.i18n import cut, tr
from orinkit.tester.state.packet_log import CAPACITY, LoggedPacket

LONGEST_DECODED: Final = 8 * 1024
"""Largest packet that is decoded completely, bytes: decoding takes the event loop a few ms at most."""

_FAILED: Final = 0x8000_0000
_LONGEST: Final = 300  # characters of a summary
_SERIAL_LINE: Final = "serial"
_CAN: Final = "can"


@dataclass(frozen=True, slots=True)
class PacketFacts:
    """Facts from the header of a packet.

    Attributes:
        function: Id of the function that the packet calls, or to whose call it replies; 0 if it is unknown.
        code: Return code of a reply, unsigned; ``None`` for a request, or if the packet is malformed.
        retry: True if a request is not the first attempt: the reserved field has another serial (UDP, serial line).
        malformed: True if the packet is not valid.
    """

    function: int = 0
    code: int | None = None
    retry: bool = False
    malformed: bool = False

    @property
    def failed(self) -> bool:
        """True if the packet is a reply with an error code."""
        return self.code is not None and self.code >= _FAILED

    @property
    def executing(self) -> bool:
        """True for S_EXECUTING: the call is still in progress, and another reply follows."""
        return self.code == hresult.S_EXECUTING

    @property
    def is_error(self) -> bool:
        """True if the packet is malformed, or a reply with an error code."""
        return self.malformed or self.failed


def is_can(packet: LoggedPacket) -> bool:
    """Return True for a frame of a CAN bus."""
    return packet.scheme == _CAN


def is_binary(packet: LoggedPacket) -> bool:
    """Return True for a packet of b-CAP or a frame, False for a body of e-CAP, which is text."""
    return packet.scheme not in ("http", "https")


def facts_of(packet: LoggedPacket) -> PacketFacts:
    """Return the facts from the header of a packet; the arguments are not decoded."""
    if is_can(packet):
        return PacketFacts()
    if not is_binary(packet):
        return _facts_of_body(packet)
    data = packet.data
    if not bcap.is_whole(data) or not _is_crc_correct(packet):
        return PacketFacts(malformed=True)
    _, _, serial, reserved, code, _ = bcap.HEADER.unpack_from(data)
    if packet.direction == ">":
        return PacketFacts(code, None, retry=reserved not in (0, serial))
    return PacketFacts(_function_id(packet.request), code)


def _is_crc_correct(packet: LoggedPacket) -> bool:
    if packet.scheme != _SERIAL_LINE or len(packet.data) > LONGEST_DECODED:
        return True
    return len(packet.data) >= bcap.OVERHEAD + 2 and bcap.has_correct_crc(packet.data)


def _function_id(request: bytes | None) -> int:
    return bcap.HEADER.unpack_from(request)[4] if request is not None and bcap.is_whole(request) else 0


def _facts_of_body(packet: LoggedPacket) -> PacketFacts:
    from orinkit.ecap.message import read_request

    request = packet.data if packet.direction == ">" else packet.request
    function = 0
    if request is not None and len(request) <= LONGEST_DECODED:
        try:
            function = read_request(request).function.id
        except (CallError, OrinError):
            function = 0
    if packet.direction == ">":
        return PacketFacts(function, malformed=not function and len(packet.data) <= LONGEST_DECODED)
    try:
        return PacketFacts(function, int(packet.data[:10], 16))
    except ValueError:
        return PacketFacts(function, malformed=True)


def summary(packet: LoggedPacket) -> str:
    """Return a packet in one line, in the current language; a large packet is not decoded."""
    if len(packet.data) > LONGEST_DECODED:
        return _summary_of_large(packet)
    if is_can(packet):
        return cut(packet.data.hex(" "), _LONGEST)
    request = packet.request if packet.direction == "<" else None
    if request is not None and len(request) > LONGEST_DECODED:
        request = request[: bcap.OVERHEAD]  # only the function id in its header is needed
    if is_binary(packet):
        return cut(one_line(packet.data, request), _LONGEST)
    from orinkit.ecap.message import explain_reply, explain_request

    return cut(explain_request(packet.data) if packet.direction == ">" else explain_reply(packet.data), _LONGEST)


def _summary_of_large(packet: LoggedPacket) -> str:
    facts = facts_of(packet)
    size = tr("{count} bytes, not decoded", count=f"{len(packet.data):,}")
    if facts.code is not None:
        return f"{hresult.lookup(facts.code).name} ({size})"
    name = FUNCTIONS[facts.function].name if facts.function in FUNCTIONS else tr("not decoded")
    return f"{name} ({size})"


class Summaries:
    """Summaries, kept in memory so that searching and scrolling again decode nothing.

    Args:
        capacity: Maximum number of summaries of each language that are kept.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._texts: dict[str, OrderedDict[int, str]] = {}

    def of(self, packet: LoggedPacket) -> str:
        """Return the summary of a packet in the current language."""
        return self.in_language(i18n.current())(packet)

    def in_language(self, language: str) -> Callable[[LoggedPacket], str]:
        """Return a function that returns the summary of a packet; the current language must be ``language``."""
        texts = self._texts.setdefault(language, OrderedDict())

        def of(packet: LoggedPacket) -> str:
            text = texts.get(packet.number)
            if text is None:
                text = texts[packet.number] = summary(packet)
                if len(texts) > self._capacity:
                    texts.popitem(last=False)
            return text

        return of
