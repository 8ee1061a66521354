"""Options shared by the commands for ABH3: the CAN bus, and how to decode its frames."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import cyclopts
from cyclopts import Group, Parameter

from orinkit.cli._shared.errors import usage_error, whole_number
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress, parse_address

if TYPE_CHECKING:
    from orinkit.abh3.table.decoder import Decoder

INTERFACE: Final = "udp_multicast"
CHANNEL: Final = "239.74.163.2"
BUS: Final = Group(tr("Bus"), sort_key=7)
FRAMES: Final = Group(tr("Frames"), sort_key=6)
_EXAMPLE: Final = f"can://{INTERFACE}/{CHANNEL}"


def whole_numbers(_kind: object, tokens: Sequence[cyclopts.Token]) -> tuple[int, ...]:
    """Parse whole numbers; cyclopts' own conversion would round 10.7."""
    return tuple(int(token.value, 10) for token in tokens)


def default_text(given: object) -> str:
    """Return the text for a default that consists of several numbers."""
    return ", ".join(map(str, given)) if isinstance(given, tuple) else str(given)


Url: TypeAlias = Annotated[
    str | None,
    Parameter(
        help=tr(
            "URL of the bus, instead of --interface and --channel: can://socketcan/can0, "
            "can://slcan//dev/ttyACM0?bitrate=500000, can://udp_multicast/239.74.163.2."
        )
    ),
]
JsonLines: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--json",
        help=tr("Print one JSON object per frame, each on its own line."),
    ),
]


def _interface(_given: object) -> str:
    return INTERFACE


def _channel(_given: object) -> str:
    return tr("{channel} if the interface is udp_multicast", channel=CHANNEL)


@Parameter(name="*", group=BUS)
@dataclass(frozen=True)
class BusOptions:
    """Options that select the bus."""

    interface: Annotated[
        str | None,
        Parameter(
            show_default=_interface,
            help=tr("Interface of python-can: socketcan, slcan, serial, pcan, udp_multicast (needs no hardware) ..."),
        ),
    ] = None
    channel: Annotated[
        str | None,
        Parameter(
            show_default=_channel,
            help=tr("Channel of the interface: can0, /dev/ttyACM0, COM3, 239.74.163.2."),
        ),
    ] = None
    bitrate: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=tr("Bit rate in bit/s, for interfaces that require it: 250000, 500000 or 1000000."),
        ),
    ] = None

    def address(self, url: str | None) -> CanAddress:
        """Return the address of the bus.

        Raises:
            CommandError: If URL and options are combined, or the channel is missing.
            InvalidAddress: If the URL is not valid.
        """
        if url is not None:
            return self._of_url(url)
        interface = INTERFACE if self.interface is None else self.interface
        channel = self.channel if self.channel is not None else CHANNEL if interface == INTERFACE else None
        if channel is None:
            raise usage_error(
                tr("--interface {interface} requires --channel", interface=interface),
            )
        return _can_address(str(CanAddress(interface, channel, self.bitrate)))

    def _of_url(self, url: str) -> CanAddress:
        given = {"--interface": self.interface, "--channel": self.channel, "--bitrate": self.bitrate}
        twice = ", ".join(name for name, value in given.items() if value is not None)
        if twice:
            raise usage_error(
                tr(
                    "{url}: {options} cannot be combined with a bus URL. Try: {example}?bitrate=500000",
                    url=url,
                    options=twice,
                    example=_EXAMPLE,
                ),
            )
        return _can_address(url)


def _can_address(url: str) -> CanAddress:
    suggestion = _suggestion(url)
    if suggestion:
        raise usage_error(tr("{url} is not a URL of a CAN bus. Try: {suggestion}", url=url, suggestion=suggestion))
    address = parse_address(url)
    if not isinstance(address, CanAddress):
        raise usage_error(tr("{url} is not a CAN bus. Try: {example}", url=url, example=_EXAMPLE))
    return address


def _suggestion(text: str) -> str:
    """Return the URL of a bus for a text that seems to be only its channel (``can0``); otherwise ``""``."""
    if "://" in text:
        return ""
    for pattern, before, behind in _CHANNELS:
        if pattern.fullmatch(text):
            return f"can://{before}/{text}{behind}"
    return ""


_CHANNELS: Final = (
    (re.compile(r"[a-z]*can\d+", re.ASCII), "socketcan", ""),
    (re.compile(r"/dev/.+|COM\d+", re.ASCII | re.IGNORECASE), "slcan", "?bitrate=500000"),
    (re.compile(r"PCAN_.+", re.ASCII), "pcan", "?bitrate=500000"),
    (re.compile(r"2(2[4-9]|3\d)(\.\d{1,3}){3}", re.ASCII), INTERFACE, ""),
)


@Parameter(name="*", group=FRAMES)
@dataclass(frozen=True)
class FrameOptions:
    """Options for decoding frames."""

    dialect: Annotated[
        str,
        Parameter(
            help=tr(
                "v1 (as in the manufacturer's document) or v2 (2023 and later). The dialect must be that of the "
                "drivers; it cannot be recognized from frames."
            )
        ),
    ] = "v1"
    host: Annotated[
        tuple[int, ...],
        Parameter(
            converter=whole_numbers,
            show_default=default_text,
            help=tr("Address of a host; may be repeated. Hosts are also detected from requests and broadcasts."),
        ),
    ] = (2,)
    group: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=tr("Decode only broadcasts of this group; by default all."),
        ),
    ] = None
    load_unit: Annotated[float, Parameter(help=tr("Unit of load values in %: 1 or 0.1."))] = 1.0

    def decoder(self) -> Decoder:
        """Return a decoder for frames.

        Raises:
            InvalidValue: If an option is invalid.
        """
        from orinkit.abh3.table.decoder import Decoder

        return Decoder(self.dialect, hosts=self.host, group=self.group, load_unit=self.load_unit)
