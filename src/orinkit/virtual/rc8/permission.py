"""Communication permission: which client may read, and which may also write (RC8 2.1).

The RC8 sets it per device on the pendant; here it is set per client address, alone or as a network. The most specific
entry that holds the address decides. It applies to every transport; a client without an IP address (a serial line, an
in-process client) has the default.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from enum import IntFlag
from typing import Final, TypeAlias

from orinkit.core.i18n import tr


class AccessRight(IntFlag):
    """What a client may do; also the attribute bits of a variable: 1 readable, 2 writable."""

    NONE = 0
    READ = 1
    WRITE = 2
    READ_WRITE = 3


_Network: TypeAlias = "ipaddress.IPv4Network | ipaddress.IPv6Network"
_NAMES: Final = {"none": AccessRight.NONE, "r": AccessRight.READ, "rw": AccessRight.READ_WRITE}
_EVERYONE: Final = "*"


class Permission:
    """Who may do what.

    Args:
        default: ``"rw"``, ``"r"`` or ``"none"``, for every address not listed.
        by_address: the same by IPv4 or IPv6 address, or network such as ``"10.0.0.0/8"``.

    Raises:
        ValueError: an address, a network or a right that cannot be read, or an address given twice.
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
        """Return the permission written as ``"192.168.0.7=r,10.0.0.0/8=rw,*=none"``; ``*`` is everyone else.

        Raises:
            ValueError: it cannot be read; the message quotes the part.
        """
        rights: dict[str, str] = {}
        for part in map(str.strip, text.split(",")):  # an empty part is refused: forgetting a right must not grant one
            address, equals, right = map(str.strip, part.partition("="))
            if not equals:
                raise ValueError(tr("{part!r} is no ADDRESS=RIGHT; for example 192.168.0.7=r,*=rw", part=part))
            if address in rights:
                raise _twice(address)
            rights[address] = right
        return cls(rights.pop(_EVERYONE, "rw"), rights)

    def of(self, address: str) -> AccessRight:
        """Return what a client at this address may do."""
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
            tr('{name!r} is no right; "rw" reads and writes, "r" only reads, "none" does neither', name=name)
        )
    return access


def _network(text: str) -> _Network:
    try:
        return ipaddress.ip_network(text.strip())
    except ValueError as error:
        raise ValueError(tr("{text!r} is no IP address or network ({error})", text=text, error=error)) from None


def _twice(address: str) -> ValueError:
    return ValueError(tr("{address} is given twice", address=address))
