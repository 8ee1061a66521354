"""The switches of the controller: mode switch, executable token, emergency stop, enabling inputs, machine lock."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final

from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.rc8.user_io_unit import UserIoUnit


class ModeSwitch(IntEnum):
    """The mode switch, with the values of ``@MODE``."""

    MANUAL = 1
    TEACH_CHECK = 2
    AUTOMATIC = 3


class SlaveLimit(IntEnum):
    """The limit of commands in slave mode ("153: b-CAP Slave speed setting", RC8 4.8)."""

    SERVO = 0
    SERVO_EXTERNAL = 1
    COMMAND = 2
    COMMAND_EXTERNAL = 3

    @classmethod
    def read(cls, number: int) -> SlaveLimit:
        """Return the setting for a number.

        Raises:
            ValueError: If the number is not 0 to 3.
        """
        try:
            return cls(number)
        except ValueError:
            raise ValueError(
                tr(
                    "the number that selects the limits in slave mode must be 0 (servo limits), 1 (servo limits x "
                    "external speed), 2 (command limits) or 3 (command limits x external speed), not {number!r}",
                    number=number,
                )
            ) from None


class TokenKind(Enum):
    """The type of the device that has the executable token (RC8 2.1).

    This device may start programs, switch the motor on and move the robot.
    """

    TP = "tp"
    IO = "io"
    ETHERNET = "ethernet"
    ANY = "any"


@record
class Token:
    """The executable token.

    Attributes:
        kind: Type of the holder.
        address: For ``ETHERNET``, the address of the client that has the token; ``""`` if every client has it.
    """

    kind: TokenKind = TokenKind.ANY
    address: str = ""

    @classmethod
    def parse(cls, text: str) -> Token:
        """Parse a token: ``any``, ``tp``, ``io``, ``ethernet`` or ``ethernet:192.168.0.7``.

        Raises:
            ValueError: If the text is not one of these.
        """
        name, _, address = (part.strip() for part in text.partition(":"))
        try:
            kind = TokenKind(name.lower())
            if address:
                ipaddress.ip_address(address)
            if address and kind is not TokenKind.ETHERNET:
                raise ValueError(address)
        except ValueError:
            raise ValueError(
                tr("unknown executable token {text!r}. Try: any, tp, io, ethernet or ethernet:ADDRESS", text=text)
            ) from None
        return cls(kind, address)

    def __str__(self) -> str:
        return f"{self.kind.value}:{self.address}" if self.address else self.kind.value

    def refusal(self, address: str) -> int:
        """Return the error code for a client at this address, or 0 if the client has the token."""
        if self.kind is TokenKind.ANY:
            return 0
        if self.kind is not TokenKind.ETHERNET or not address:  # a client without an address is not a network client
            return hresult.START_RIGHT_NOT_ETHERNET
        if not self.address or _same(self.address, address):
            return 0
        return hresult.START_RIGHT_NOT_THIS_ADDRESS


ANYONE: Final = Token()
"""The token with which any device may start motions."""


@dataclass(slots=True)
class Switches:
    """The switches and inputs of the controller. Initially the mode is automatic (RC8 2.2) and no stop is active.

    Change the switches through :class:`~orinkit.virtual.rc8.state.RC8State`, which notifies the clients and stops the
    robot.

    Attributes:
        slave_licence: True if the licence of the slave function is registered.
        slave_limit: Limit of commands in slave mode.
        strict_time: True if a late set-point has the same effect as on a real controller; False if the controller waits
            for the set-point.
        user_io_unit: Unit of the size of user I/O in slvMove, if the bytes that are sent along do not show it.
        loose_poses: True to read six bare numbers in OutRange as a position, and the pose type L as P.
        strict: True to follow the b-CAP document where programs that run on real controllers show that these are more
            tolerant.
        create_files: True if File_PutValue creates a missing file that was opened without ``@Create``.
    """

    mode: ModeSwitch = ModeSwitch.AUTOMATIC
    token: Token = ANYONE
    emergency_stop: bool = False
    deadman: bool = False
    auto_enable: bool = True
    protective_stop: bool = False
    machine_lock: bool = False
    slave_licence: bool = True
    slave_limit: SlaveLimit = SlaveLimit.SERVO
    strict_time: bool = False
    loose_poses: bool = False
    strict: bool = False
    create_files: bool = False
    user_io_unit: UserIoUnit = UserIoUnit.BITS

    @property
    def torque_off(self) -> bool:
        """True while the emergency stop or the protective stop keeps the torque off (STO)."""
        return self.emergency_stop or self.protective_stop


def _same(first: str, second: str) -> bool:
    try:
        return _plain(first) == _plain(second)
    except ValueError:
        return False


def _plain(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    found = ipaddress.ip_address(address)
    return found.ipv4_mapped or found if isinstance(found, ipaddress.IPv6Address) else found
