"""The fields of the control frames of multi-packet messages, as data (J1939-21)."""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.core.i18n import N_

RTS: Final = 0x10
CTS: Final = 0x11
END: Final = 0x13
ABORT: Final = 0xFF
BAM: Final = 0x20
"""An announcement to all nodes; no driver sends it."""
KINDS: Final = {RTS: "RTS", CTS: "CTS", END: "EndOfMsgACK", BAM: "BAM", ABORT: "Abort"}
"""The names of the defined control bytes."""
BUSY: Final = 1
RESOURCES: Final = 2
LATE: Final = 3
RESENT: Final = 5
SEQUENCE: Final = 7
REASONS: Final[dict[int, str]] = {
    BUSY: N_("busy with another message"),
    RESOURCES: N_("out of resources"),
    LATE: N_("time-out"),
    4: N_("packets were requested while others were being sent"),
    RESENT: N_("packets were requested again too often"),
    6: N_("unexpected packet"),
    SEQUENCE: N_("wrong packet number"),
    8: N_("duplicate packet"),
    9: N_("message too long"),
}
"""The reasons for an abort, in English, by number."""
PGN_AT: Final = 5
"""Offset in bytes of the PGN in a control frame. The PGN occupies the last three bytes of the frame."""


class ControlField(NamedTuple):
    """A number in a control frame, little endian.

    Attributes:
        name: Name for programs.
        title: Name for people.
        unit: Unit of the number.
        start: Offset of its first byte, from 0.
        size: Length in bytes.
        kinds: Control bytes of the frames that contain it.
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
    ControlField("most_at_once", N_("maximum packets per CTS"), "", 4, 1, (RTS,)),
    ControlField("allowed", N_("packets that may be sent"), "", 1, 1, (CTS,)),
    ControlField("next", N_("next packet"), "", 2, 1, (CTS,)),
    ControlField("reason", N_("reason"), "", 1, 1, (ABORT,)),
)
