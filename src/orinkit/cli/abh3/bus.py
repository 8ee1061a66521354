"""What the commands for ABH3 have in common: which bus, and what its frames mean."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import cyclopts
from cyclopts import Group, Parameter

from orinkit.cli._shared.errors import unusable, whole_number
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress, parse_address

if TYPE_CHECKING:
    from orinkit.abh3.table.decoder import Decoder

INTERFACE: Final = "udp_multicast"
CHANNEL: Final = "239.74.163.2"
BUS: Final = Group(tr("Bus"), sort_key=8)
FRAMES: Final = Group(tr("Frames"), sort_key=7)
_EXAMPLE: Final = f"can://{INTERFACE}/{CHANNEL}"


def whole_numbers(_kind: object, tokens: Sequence[cyclopts.Token]) -> tuple[int, ...]:
    """Read whole numbers: cyclopts by itself would round 10.7."""
    return tuple(int(token.value, 10) for token in tokens)


def joined(given: object) -> str:
    """Return how a default of several numbers is shown."""
    return ", ".join(map(str, given)) if isinstance(given, tuple) else str(given)


Url: TypeAlias = Annotated[
    str | None,
    Parameter(
        help=tr(
            "The bus as a URL, instead of --interface and --channel: can://socketcan/can0, "
            "can://slcan//dev/ttyACM0?bitrate=500000, can://udp_multicast/239.74.163.2."
        )
    ),
]
JsonLines: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--json",
        help=tr("Print one JSON object for each frame, on a line."),
    ),
]


def _interface(_given: object) -> str:
    return INTERFACE


def _channel(_given: object) -> str:
    return tr("{channel} with udp_multicast", channel=CHANNEL)


@Parameter(name="*", group=BUS)
@dataclass(frozen=True)
class BusOptions:
    """Which bus."""

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
            help=tr("Bit rate in bit/s, for interfaces that want to be told: 250000, 500000 or 1000000."),
        ),
    ] = None

    def address(self, url: str | None) -> CanAddress:
        """Return where the bus is.

        Raises:
            Failure: it is told twice, or only half of it.
            InvalidAddress: the URL is none.
        """
        if url is not None:
            return self._of_url(url)
        interface = INTERFACE if self.interface is None else self.interface
        channel = self.channel if self.channel is not None else CHANNEL if interface == INTERFACE else None
        if channel is None:
            raise unusable(
                tr("--interface {interface} needs a --channel", interface=interface),
            )
        return _can_address(str(CanAddress(interface, channel, self.bitrate)))

    def _of_url(self, url: str) -> CanAddress:
        given = {"--interface": self.interface, "--channel": self.channel, "--bitrate": self.bitrate}
        twice = ", ".join(name for name, value in given.items() if value is not None)
        if twice:
            raise unusable(
                tr(
                    "{url} says all about the bus; {options} cannot be given beside it. Try: {example}?bitrate=500000",
                    url=url,
                    options=twice,
                    example=_EXAMPLE,
                ),
            )
        return _can_address(url)


def _can_address(url: str) -> CanAddress:
    meant = _meant(url)
    if meant:
        raise unusable(tr("{url} is no URL of a CAN bus. Try: {suggestion}", url=url, suggestion=meant))
    address = parse_address(url)
    if not isinstance(address, CanAddress):
        raise unusable(tr("{url} is no CAN bus. Example: {example}", url=url, example=_EXAMPLE))
    return address


def _meant(text: str) -> str:
    """Return the URL of what seems to be a channel alone, ``""`` where it is something else."""
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
    """What frames mean."""

    dialect: Annotated[
        str,
        Parameter(help=tr("v1, the document's, or v2 of 2023, as the drivers have it: no frame says which.")),
    ] = "v1"
    host: Annotated[
        tuple[int, ...],
        Parameter(
            converter=whole_numbers,
            show_default=joined,
            help=tr("Address of a host; may be given again. Requests and broadcasts tell who is who, too."),
        ),
    ] = (2,)
    group: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=tr("Only broadcasts of this group are decoded; any by default."),
        ),
    ] = None
    load_unit: Annotated[float, Parameter(help=tr("Loads are counted in 1 or 0.1 %."))] = 1.0

    def decoder(self) -> Decoder:
        """Return what decodes frames.

        Raises:
            InvalidValue: an option cannot be.
        """
        from orinkit.abh3.table.decoder import Decoder

        return Decoder(self.dialect, hosts=self.host, group=self.group, load_unit=self.load_unit)
