"""What the commands for ABH3 have in common: which bus, and what its frames mean."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import cyclopts
from cyclopts import Group, Parameter

from orinkit.cli._errors import unusable, whole_number
from orinkit.language import pick
from orinkit.transport.address import CanAddress, parse_address

if TYPE_CHECKING:
    from orinkit.abh3.decoder import Decoder

INTERFACE: Final = "udp_multicast"
CHANNEL: Final = "239.74.163.2"
BUS: Final = Group(pick("Bus", "バス"), sort_key=8)
FRAMES: Final = Group(pick("Frames", "フレーム"), sort_key=7)
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
        help=pick(
            "The bus as a URL, instead of --interface and --channel: can://socketcan/can0, can://slcan//dev/ttyACM0?bitrate=500000, "
            "can://udp_multicast/239.74.163.2.",
            "バスの URL (--interface と --channel の代わり): can://socketcan/can0, can://slcan//dev/ttyACM0?bitrate=500000, "
            "can://udp_multicast/239.74.163.2",
        )
    ),
]
JsonLines: TypeAlias = Annotated[
    bool,
    Parameter(
        name="--json",
        help=pick("Print one JSON object for each frame, on a line.", "フレームごとに 1 行の JSON で出力する。"),
    ),
]


def _interface(_given: object) -> str:
    return INTERFACE


def _channel(_given: object) -> str:
    return pick(f"{CHANNEL} with udp_multicast", f"udp_multicast では {CHANNEL}")


@Parameter(name="*", group=BUS)
@dataclass(frozen=True)
class BusOptions:
    """Which bus."""

    interface: Annotated[
        str | None,
        Parameter(
            show_default=_interface,
            help=pick(
                "Interface of python-can: socketcan, slcan, serial, pcan, udp_multicast (needs no hardware) ...",
                "python-can のインタフェース: socketcan、slcan、serial、pcan、udp_multicast (ハードウェア不要) など。",
            ),
        ),
    ] = None
    channel: Annotated[
        str | None,
        Parameter(
            show_default=_channel,
            help=pick(
                "Channel of the interface: can0, /dev/ttyACM0, COM3, 239.74.163.2.",
                "インタフェースのチャンネル: can0、/dev/ttyACM0、COM3、239.74.163.2 など。",
            ),
        ),
    ] = None
    bitrate: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=pick(
                "Bit rate in bit/s, for interfaces that want to be told: 250000, 500000 or 1000000.",
                "ビットレート (bit/s)。設定が必要なインタフェースのみ: 250000、500000、1000000。",
            ),
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
                f"--interface {interface} needs a --channel",
                f"--interface {interface} には --channel が必要です",
            )
        return _can_address(str(CanAddress(interface, channel, self.bitrate)))

    def _of_url(self, url: str) -> CanAddress:
        given = {"--interface": self.interface, "--channel": self.channel, "--bitrate": self.bitrate}
        twice = ", ".join(name for name, value in given.items() if value is not None)
        if twice:
            raise unusable(
                f"{url} says all about the bus; {twice} cannot be given beside it. Try: {_EXAMPLE}?bitrate=500000",
                f"{url} でバスを指定済みのため、{twice} は指定できません。例: {_EXAMPLE}?bitrate=500000",
            )
        return _can_address(url)


def _can_address(url: str) -> CanAddress:
    meant = _meant(url)
    if meant:
        raise unusable(
            f"{url} is no URL of a CAN bus. Try: {meant}", f"{url} は CAN バスの URL ではありません。対処: {meant}"
        )
    address = parse_address(url)
    if not isinstance(address, CanAddress):
        raise unusable(f"{url} is no CAN bus. Example: {_EXAMPLE}", f"{url} は CAN バスではありません。例: {_EXAMPLE}")
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
        Parameter(
            help=pick(
                "v1, the document's, or v2 of 2023, as the drivers have it: no frame says which.",
                "v1 (仕様書) または v2 (2023 年の新仕様)。フレームからは判別できないため、ドライバに合わせて指定する。",
            )
        ),
    ] = "v1"
    host: Annotated[
        tuple[int, ...],
        Parameter(
            converter=whole_numbers,
            show_default=joined,
            help=pick(
                "Address of a host; may be given again. Requests and broadcasts tell who is who, too.",
                "ホスト機器のアドレス。複数指定可。リクエストとブロードキャストからも判別する。",
            ),
        ),
    ] = (2,)
    group: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=pick(
                "Only broadcasts of this group are decoded; any by default.",
                "このグループ番号のブロードキャストのみ解読する。既定はすべて。",
            ),
        ),
    ] = None
    load_unit: Annotated[
        float, Parameter(help=pick("Loads are counted in 1 or 0.1 %.", "負荷率の単位 (1 または 0.1 %)。"))
    ] = 1.0

    def decoder(self) -> Decoder:
        """Return what decodes frames.

        Raises:
            InvalidValue: an option cannot be.
        """
        from orinkit.abh3.decoder import Decoder

        return Decoder(self.dialect, hosts=self.host, group=self.group, load_unit=self.load_unit)
