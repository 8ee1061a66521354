"""Communication permission: which clients may read, and which may also write (RC8 2.1).

On an RC8, the communication permission is set on the pendant, for each device. Here it is set for each address or
network of clients. The most specific entry that contains the address of the client applies, for every transport. A
client without an IP address (on a serial line, or in the same process) has the default rights.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from enum import IntFlag
from typing import Final, TypeAlias

from orinkit.core.i18n import tr


class AccessRight(IntFlag):
    """The rights of a client; also the attribute bits of a variable: 1 readable, 2 writable."""

    NONE = 0
    READ = 1
    WRITE = 2
    READ_WRITE = 3


_Network: TypeAlias = "ipaddress.IPv4Network | ipaddress.IPv6Network"
_NAMES: Final = {"none": AccessRight.NONE, "r": AccessRight.READ, "rw": AccessRight.READ_WRITE}
_EVERYONE: Final = "*"


class Permission:
    """The access rights of clients by address.

    Args:
        default: The right of every address that is not listed: ``"rw"``, ``"r"`` or ``"none"``.
        by_address: The right for each IPv4 or IPv6 address, or for each network such as ``"10.0.0.0/8"``.

    Raises:
        ValueError: If an address, a network or a right is not valid, or if an address is listed twice.
    """

    def __init__(self, default: str = "rw", by_address: Mapping[str, str] | None = None) -> None:
        self.default = _access(default)
        networks: dict[_Network, AccessRight] = {}
        for text, right in (by_address or {}).items():
            network = _network(text)
            if network in networks:
                raise _twice(text)
            networks[network] = _access(right)
        self._networks = dict(sorted(networks.items(), key=lambda entry: entry[0].prefixlen, reverse=True))

    @classmethod
    def parse(cls, text: str) -> Permission:
        """Parse a text such as ``"192.168.0.7=r,10.0.0.0/8=rw,*=none"``; ``*`` is the default.

        Raises:
            ValueError: If the text is not valid; the message quotes the invalid part.
        """
        rights: dict[str, str] = {}
        for part in map(str.strip, text.split(",")):  # an empty part is refused: a missing right must not grant access
            address, equals, right = map(str.strip, part.partition("="))
            if not equals:
                raise ValueError(tr("{part!r} is not ADDRESS=RIGHT. Try: for example 192.168.0.7=r,*=rw", part=part))
            if address in rights:
                raise _twice(address)
            rights[address] = right
        return cls(rights.pop(_EVERYONE, "rw"), rights)

    def of(self, address: str) -> AccessRight:
        """Return the rights of a client at this address; the default if it is not listed or is not an IP address."""
        try:
            host = ipaddress.ip_address(address)
        except ValueError:
            return self.default
        if isinstance(host, ipaddress.IPv6Address) and host.ipv4_mapped:
            host = host.ipv4_mapped  # an IPv4 client of a server that listens on IPv6
        for network, access in self._networks.items():
            if host in network:
                return access
        return self.default


def _access(name: str) -> AccessRight:
    access = _NAMES.get(name.strip().lower())
    if access is None:
        raise ValueError(
            tr('{name!r} is not a valid right. Try: "rw" (read and write), "r" (read only) or "none"', name=name)
        )
    return access


def _network(text: str) -> _Network:
    try:
        return ipaddress.ip_network(text.strip())
    except ValueError as error:
        raise ValueError(tr("{text!r} is not an IP address or network ({error})", text=text, error=error)) from None


def _twice(address: str) -> ValueError:
    return ValueError(tr("{address} is given twice", address=address))
