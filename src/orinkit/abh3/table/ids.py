"""The 29-bit identifiers of ABH3 frames, as in J1939 (section 2 of the ABH3 document).

The fields of an identifier, with their numbers of bits, are ``priority(3) R(1) DP(1) PF(8) PS(8) SA(8)``; see
:class:`FrameId`. If PF is below 240, PS is the destination address. Receivers ignore the priority.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import check_whole

SINGLE: Final = 0xEF
"""PDU format (PF) of single packets."""
REQUEST: Final = 0xEA
"""PDU format (PF) of requests."""
BROADCAST: Final = 0xFF
"""PDU format (PF) of broadcasts. Their field PS is group * 8 + number."""
CONTROL: Final = 0xEC
"""PDU format (PF) of the control frames of multi-packet messages."""
TRANSFER: Final = 0xEB
"""PDU format (PF) of the data frames of multi-packet messages."""
EVERYONE: Final = 0xFF
"""The address of all drivers."""
LAST_ADDRESS: Final = 253
GROUPS: Final = 32
BROADCASTS: Final = 8


class FrameId(NamedTuple):
    """The parts of an identifier.

    Attributes:
        pf: PDU format.
        ps: PDU specific: the destination, or group and number of a broadcast.
        sa: Source address.
        dp: Data page.
        priority: 0 (highest) to 7.
        reserved: The bit R; 0 in every frame of an ABH3.
    """

    pf: int
    ps: int
    sa: int
    dp: int = 0
    priority: int = 0
    reserved: int = 0

    @classmethod
    def parse(cls, number: int) -> FrameId:
        """Return the parts of an identifier."""
        return cls(
            number >> 16 & 0xFF, number >> 8 & 0xFF, number & 0xFF, number >> 24 & 1, number >> 26 & 7, number >> 25 & 1
        )

    def __int__(self) -> int:
        return (
            self.priority << 26 | self.reserved << 25 | self.dp << 24 | self.pf << 16 | self.ps << 8 | self.sa
        )  # fmt: skip

    def with_priority(self, priority: int) -> int:
        """Return the identifier of the same frame with another priority."""
        return int(self._replace(priority=priority))


def single(destination: int, source: int, *, dp: int = 0, priority: int = 0) -> int:
    """Return the identifier of a single packet (sections 2.1, 2.2)."""
    return int(FrameId(SINGLE, destination, source, dp, priority))


def request(destination: int, source: int, *, priority: int = 0) -> int:
    """Return the identifier of a request; the destination :data:`EVERYONE` means all drivers."""
    return int(FrameId(REQUEST, destination, source, 0, priority))


def broadcast(group: int, number: int, source: int, *, priority: int = 0) -> int:
    """Return the identifier of a broadcast (sections 2.3 to 2.9)."""
    return int(FrameId(BROADCAST, group * BROADCASTS + number, source, 0, priority))


def pgn(pf: int, ps: int, *, dp: int = 0) -> bytes:
    """Return the three bytes of the PGN (parameter group number) in a request; PS is 0 for a single packet."""
    return bytes((ps, pf, dp))


def check_address(name: str, address: object) -> int:
    """Check the address of a driver or a host, and return it.

    Raises:
        InvalidValue: If the address is not a whole number from 0 to 253.
    """
    return check_whole(name, address, LAST_ADDRESS)


def check_group(group: object) -> int:
    """Check the group of a driver's broadcasts, and return it.

    Raises:
        InvalidValue: If the group is not a whole number from 0 to 31.
    """
    return check_whole("group", group, GROUPS - 1)


def check_priority(priority: object) -> int:
    """Check a priority, and return it.

    Raises:
        InvalidValue: If the priority is not a whole number from 0 to 7.
    """
    return check_whole("priority", priority, 7)


def broadcast_number(number: object, group: int) -> int:
    """Return the PS of a broadcast: group * 8 + number.

    Args:
        number: 0 to 7 for a broadcast of the group. A value of 8 or more is the PS itself, as in the document (4.7); it
            must belong to the same group.
        group: Group of the drivers.

    Raises:
        InvalidValue: If the number is not valid, or belongs to another group.
    """
    name = tr("broadcast (0 to 6, or group * 8 + number)")
    given = check_whole(name, number, 0xFF)
    ps = given if given >= BROADCASTS else group * BROADCASTS + given
    if ps // BROADCASTS != group:
        other, place = divmod(ps, BROADCASTS)
        raise InvalidValue(
            tr(
                "0x{number:02X} is broadcast {place} of group {other}, but the group of this host is {group} (group=)",
                number=ps,
                place=place,
                other=other,
                group=group,
            )
        )
    return ps
