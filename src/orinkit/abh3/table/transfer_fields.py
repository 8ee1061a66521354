"""What is in the control frames of multi-packet messages, as data (J1939-21)."""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.core.i18n import N_

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
REASONS: Final[dict[int, str]] = {
    BUSY: N_("busy with another message"),
    RESOURCES: N_("out of resources"),
    LATE: N_("time-out"),
    4: N_("packets were asked for while some were sent"),
    RESENT: N_("packets were asked for again too often"),
    6: N_("unexpected packet"),
    SEQUENCE: N_("wrong packet number"),
    8: N_("a packet came twice"),
    9: N_("message too long"),
}
"""Why a side gives up."""
PGN_AT: Final = 5
"""Where the PGN begins, in bytes: it has the last three."""


class ControlField(NamedTuple):
    """A number in a control frame, little endian.

    Attributes:
        name: for programs.
        title: what it is.
        unit: of the number.
        start: its first byte, from 0.
        size: how many bytes it has.
        kinds: control bytes of the frames that have it.
    """

    name: str
    title: str
    unit: str
    start: int
    size: int
    kinds: tuple[int, ...]


PARTS: Final = (
    ControlField("size", N_("message"), "byte", 1, 2, (RTS, END, BAM)),
    ControlField("packets", N_("packets"), "", 3, 1, (RTS, END, BAM)),
    ControlField("most_at_once", N_("most packets for one CTS"), "", 4, 1, (RTS,)),
    ControlField("allowed", N_("packets that may be sent"), "", 1, 1, (CTS,)),
    ControlField("next", N_("next packet"), "", 2, 1, (CTS,)),
    ControlField("reason", N_("reason"), "", 1, 1, (ABORT,)),
)
