"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``parameters.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Generic, TypeVar

from orinkit.abh3.api._sync.shared import SharedBus
from orinkit.abh3.session import parameter_value, telabh3
from orinkit.abh3.session.host import Host
from orinkit.abh3.session.parameter_value import ParameterValue
from orinkit.abh3.table.records import Feedback
from orinkit.core.closing import Closing

F = TypeVar("F", bound=Feedback)


class ParameterAccess(Closing, Generic[F]):
    """The parameters, monitors and identifications of an ABH3 driver: base class of :class:`Driver`.

    Attributes:
        bus: The bus that the driver is on.
        host: The state of the driver as its host has recorded it.
    """

    bus: SharedBus
    host: Host[F]

    @property
    @abstractmethod
    def address(self) -> int:
        """Address of the driver."""

    @abstractmethod
    def _begin_call(self) -> None:
        """Record that the program makes a call.

        Raises:
            ConnectionClosed: If the driver was closed.
        """

    def exchange_message(self, message: bytes) -> bytes:
        """Send a multi-packet message and return the driver's reply.

        Args:
            message: 1 to 1785 bytes, for example a TelABH3 text from :mod:`orinkit.abh3.session.telabh3`.

        Raises:
            InvalidValue: If the message is empty, too long, or not bytes; nothing was sent.
            ProtocolError: If the driver aborted the transfer.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        self._begin_call()
        return self.bus.exchange(message, self.host)

    def read_parameter(self, address: int) -> ParameterValue:
        """Read a parameter of the driver.

        Args:
            address: 0 to 0xFFFF; the known addresses are in :data:`orinkit.abh3.session.telabh3.PARAMETERS`.

        Raises:
            InvalidValue: If the address is out of range.
            ParameterRefused: If the driver refuses the request.
            ProtocolError: If the driver aborted the transfer, or its reply cannot be read.
            DriverTimeout: If the driver does not reply.
            TransportError: If the bus is broken or closed.
        """
        return parameter_value.parameter(address, (self._ask(telabh3.read_parameter(address))).word)

    def write_parameter(self, address: int, value: float, *, raw: bool = False) -> None:
        """Write a parameter of the driver.

        Args:
            address: As for :meth:`read_parameter`.
            value: The value in the parameter's unit; with ``raw``, the 32-bit word that represents it.
            raw: True if ``value`` is the 32-bit word.

        Raises:
            InvalidValue: If the value or the address is not valid; nothing was sent.
            ParameterRefused, ProtocolError, DriverTimeout, TransportError: As for :meth:`read_parameter`.
        """
        word = parameter_value.word_of(address, value, raw=raw)
        (self._ask(telabh3.write_parameter(address, word))).confirmed()

    def read_monitor(self, address: int) -> ParameterValue:
        """Read a monitor of the driver. For exceptions, see :meth:`read_parameter`.

        Args:
            address: 0 to 0xFFFF; the known addresses are in :data:`orinkit.abh3.session.telabh3.MONITORS`.
        """
        return parameter_value.monitor(address, (self._ask(telabh3.read_monitor(address))).word)

    def read_identification(self, number: int = telabh3.VERSION) -> str:
        """Read an identification of the driver, by default its version. For exceptions, see :meth:`read_parameter`.

        Args:
            number: One of :data:`orinkit.abh3.session.telabh3.IDENTIFICATIONS`.
        """
        return (self._ask(telabh3.read_identification(number))).confirmed()

    def _ask(self, request: bytes) -> telabh3.TelReply:
        """Send a TelABH3 request; return the driver's reply, with a description of the request for error messages."""
        reply = self.exchange_message(request)
        return telabh3.parse_reply(reply, f"ABH3 {self.address}, {telabh3.parse_request(request)}")
