"""The parameters of a connection, as users enter and save them: :class:`ConnectionSpec`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final, Self

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.transport.address import parse_address

VRC: Final = "CaoProv.DENSO.VRC"
_CAN: Final = "can"
_LONGEST_NAME: Final = 60
_LAST_ROBOT: Final = 1


@dataclass(frozen=True, slots=True)
class ConnectionSpec:
    """The parameters of a connection (RC8 table 5-1).

    Attributes:
        name: Name of the connection in the Tester, unique.
        url: Address of the controller: ``tcp://``, ``udp://``, ``serial://``, ``http://``, ``https://`` or ``can://``.
        provider: Provider name.
        machine: Machine name; ``""`` for ``localhost``.
        option: Option string of Controller_Connect.
        messages: True if messages of the controller are fetched.
        timeout: Time-out of a call in ms, over UDP and on serial lines of each attempt; 0 for the default.
        tries: Number of attempts over UDP and on serial lines, 1 to 7.
        debug: True if the variables ``$LAST_SEND_PACKET$`` and ``$LAST_RECEIVE_PACKET$`` exist.
        token: Access token, for HTTP. It is not saved.
        robot: Number of the robot (``ID`` of Controller_GetRobot), 0 or 1.
        driver: Address of the ABH3 driver, for CAN.
        dialect: Dialect of the ABH3 driver, ``"v1"`` or ``"v2"``, for CAN.
        control: Address of the control port of a virtual RC8; ``""`` if there is none. It is not saved.
        secret: Secret of the control port. It is not saved.
    """

    name: str
    url: str
    provider: str = VRC
    machine: str = ""
    option: str = ""
    messages: bool = True
    timeout: int = 0
    tries: int = 5
    debug: bool = False
    token: str = ""
    robot: int = 0
    driver: int = 1
    dialect: str = "v1"
    control: str = ""
    secret: str = ""

    @property
    def scheme(self) -> str:
        """The scheme of the address: tcp, udp, serial, http, https, can.

        Raises:
            InvalidAddress: If the address is invalid.
        """
        return parse_address(self.url).scheme

    @property
    def is_can(self) -> bool:
        """True for an ABH3 driver on a CAN bus."""
        return self.scheme == _CAN

    def check(self) -> Self:
        """Return the specification if all parameters are valid.

        Raises:
            InvalidAddress: If the address is invalid.
            InvalidValue: If another parameter is invalid.
        """
        if not self.name.strip() or len(self.name) > _LONGEST_NAME:
            raise InvalidValue(tr("the name must have 1 to {most} characters", most=_LONGEST_NAME))
        parse_address(self.url)
        if not 0 <= self.timeout <= 3_600_000:
            raise InvalidValue(tr("the time-out must be 0 (default) to 3,600,000 ms, not {value}", value=self.timeout))
        if not 1 <= self.tries <= 7:
            raise InvalidValue(tr("the number of attempts must be 1 to 7, not {value}", value=self.tries))
        if not 0 <= self.robot <= _LAST_ROBOT:
            raise InvalidValue(tr("the number of the robot must be 0 or 1, not {value}", value=self.robot))
        if self.dialect not in ("v1", "v2"):
            raise InvalidValue(tr("the dialect must be v1 or v2, not {value}", value=self.dialect))
        return self

    def renamed(self, name: str) -> Self:
        """Return the same specification with another name."""
        return replace(self, name=name)

    def to_json(self) -> dict[str, Any]:
        """Return the parameters to save: all except those that give access."""
        return {key: value for key, value in asdict(self).items() if key not in _UNSAVED}

    @classmethod
    def from_json(cls, saved: Mapping[str, Any]) -> Self:
        """Return the specification for saved parameters; unknown ones are ignored.

        Raises:
            InvalidValue: If a parameter is missing or has the wrong type.
        """
        types = {each.name: each.type for each in fields(cls)}
        given = {key: value for key, value in saved.items() if key in types and key not in _UNSAVED}
        if (
            any(type(value).__name__ != types[key] for key, value in given.items())
            or not {"name", "url"} <= given.keys()
        ):
            raise InvalidValue(tr("a saved connection is damaged: {saved}", saved=str(dict(saved))[:200]))
        return cls(**given)


_UNSAVED: Final = frozenset({"token", "control", "secret"})
