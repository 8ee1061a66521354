"""What is in the control frames of multi-packet messages, as data (J1939-21)."""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.abh3.signals import Texts

RTS: Final = 0x10
CTS: Final = 0x11
END: Final = 0x13
ABORT: Final = 0xFF
BAM: Final = 0x20
"""An announcement to everybody; no driver sends it."""
KINDS: Final = {RTS: "RTS", CTS: "CTS", END: "EndOfMsgACK", BAM: "BAM", ABORT: "Abort"}
"""The control bytes that have a meaning."""
BUSY: Final = 1
RESOURCES: Final = 2
LATE: Final = 3
RESENT: Final = 5
SEQUENCE: Final = 7
REASONS: Final[dict[int, Texts]] = {
    BUSY: ("busy with another message", "別のメッセージを処理中"),
    RESOURCES: ("out of resources", "リソース不足"),
    LATE: ("time-out", "フレーム待ちタイムアウト"),
    4: ("packets were asked for while some were sent", "データ転送中に CTS を受信"),
    RESENT: ("packets were asked for again too often", "再送要求の回数超過"),
    6: ("unexpected packet", "予期しないデータパケット"),
    SEQUENCE: ("wrong packet number", "パケット番号の誤り"),
    8: ("a packet came twice", "パケット番号の重複"),
    9: ("message too long", "メッセージが長すぎる"),
}
"""Why a side gives up."""
PGN_AT: Final = 5
"""Where the PGN begins, in bytes: it has the last three."""


class Part(NamedTuple):
    """A number in a control frame, little endian.

    Attributes:
        name: for programs.
        text: what it is.
        unit: of the number.
        start: its first byte, from 0.
        size: how many bytes it has.
        kinds: control bytes of the frames that have it.
    """

    name: str
    text: Texts
    unit: str
    start: int
    size: int
    kinds: tuple[int, ...]


PARTS: Final = (
    Part("size", ("message", "メッセージ長"), "byte", 1, 2, (RTS, END, BAM)),
    Part("packets", ("packets", "パケット数"), "", 3, 1, (RTS, END, BAM)),
    Part("most_at_once", ("most packets for one CTS", "CTS あたりの最大パケット数"), "", 4, 1, (RTS,)),
    Part("allowed", ("packets that may be sent", "送信可能なパケット数"), "", 1, 1, (CTS,)),
    Part("next", ("next packet", "次のパケット番号"), "", 2, 1, (CTS,)),
    Part("reason", ("reason", "理由"), "", 1, 1, (ABORT,)),
)
