"""The formats that a client has set with slvSendFormat and slvRecvFormat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from orinkit.rc8.slave_formats import ReceiveFormat, SendBits

_POSE_ONLY: Final = SendBits(0)
_JOINTS: Final = ReceiveFormat()


@dataclass(slots=True)
class Formats:
    """The formats of one client's slvMove; they apply while the client is connected (RC8 table 4-1).

    Attributes:
        send: Fields that a set-point has in addition to the pose.
        receive: Fields of the result.
    """

    send: SendBits = _POSE_ONLY
    receive: ReceiveFormat = _JOINTS
