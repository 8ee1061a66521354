"""Calls that a client serves itself: the variables of the debug mode (RC8 table 5-1: Debug), and refused messages.

No I/O. In debug mode, the last packets are the variables ``$LAST_SEND_PACKET$`` and ``$LAST_RECEIVE_PACKET$`` of the
controller object. The handles of such variables exceed the range of VT_I4, so that they differ from all handles of the
controller.
"""

from __future__ import annotations

from datetime import datetime
from itertools import count
from typing import Any, Final

from orinkit.cao.functions import FUNCTIONS, controller_disconnect, controller_get_message, controller_get_variable
from orinkit.cao.provider import VariableObject
from orinkit.cao.replies import Trace
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, MessagesDisabled, error_for
from orinkit.core.i18n import tr
from orinkit.values.variant import ARRAY, Variant, VarType, trusted, variant

_FIRST_HANDLE: Final = 1 << 32
_READABLE: Final = 1  # attribute bit
_MARKS: Final = {"$last_send_packet$": ">", "$last_receive_packet$": "<"}
_MESSAGE_FUNCTIONS: Final = frozenset(
    {controller_get_message.id, *(entry.id for entry in FUNCTIONS.values() if entry.interface == "Message")}
)


class LastPackets:
    """The last packet of each direction, with its time: a trace that passes each packet on to another trace.

    Args:
        trace: Callback of the program; ``None`` if there is none.
    """

    def __init__(self, trace: Trace | None) -> None:
        self._trace = trace
        self._packets: dict[str, tuple[bytes, datetime | None]] = {">": (b"", None), "<": (b"", None)}

    def __call__(self, mark: str, data: bytes) -> None:
        """Store a packet, ``">"`` for a sent one, ``"<"`` for a received one."""
        self._packets[mark] = data, datetime.now()
        if self._trace is not None:
            self._trace(mark, data)

    def packet(self, mark: str) -> bytes:
        """Return the last packet of a direction; ``b""`` if there is none."""
        return bytes(self._packets[mark][0])

    def moment(self, mark: str) -> datetime:
        """Return the local time of the last packet of a direction; the current time if there is none."""
        return self._packets[mark][1] or datetime.now()


class PacketVariable(VariableObject):
    """A variable that contains the last packet of one direction; read-only."""

    def __init__(self, name: str, owner: int, packets: LastPackets) -> None:
        mark = _MARKS[name.lower()]
        text = tr("bytes of the last packet sent") if mark == ">" else tr("bytes of the last packet received")
        super().__init__(name.upper(), attribute=_READABLE, help=text)
        self.owner = owner
        self._mark = mark
        self._packets = packets

    def get_value(self) -> Variant:
        """Return the packet; over HTTP the body."""
        return Variant(VarType.UI1 | ARRAY, self._packets.packet(self._mark))

    def get_date_time(self) -> datetime:
        """Return the local time at which the packet was sent or received."""
        return self._packets.moment(self._mark)

    def get_microsecond(self) -> int:
        """Return the microseconds of the time returned by :meth:`get_date_time`."""
        return self._packets.moment(self._mark).microsecond


class LocalCalls:
    """The calls of one connection that are not sent to the controller.

    Args:
        messages: False to refuse the message functions.
        packets: The last packets; ``None`` outside debug mode.
    """

    def __init__(self, messages: bool, packets: LastPackets | None) -> None:
        self._refused = frozenset() if messages else _MESSAGE_FUNCTIONS
        self._packets = packets
        self._variables: dict[int, PacketVariable] = {}
        self._handles = count(_FIRST_HANDLE)

    def reply(self, function: Function[..., Any], arguments: tuple[Any, ...], exact: bool) -> tuple[int, Any] | None:
        """Return the return code and the result of a call; ``None`` if the call is to be sent to the controller.

        Raises:
            MessagesDisabled: If the function is a message function, and these are disabled.
            CallError: E_HANDLE; E_CAO_NOT_WRITABLE.
        """
        if function.id in self._refused:
            raise MessagesDisabled(
                tr(
                    "{name} was not sent: messages are disabled on this connection. Try: messages=True",
                    name=function.name,
                )
            )
        owner = arguments[0] if arguments else None
        if self._packets is None or not isinstance(owner, int):
            return None
        if function is controller_get_variable and str(arguments[1]).lower() in _MARKS:
            result = self._create(arguments[1], owner)
        elif owner >= _FIRST_HANDLE:
            result = self._call(function, arguments)
        else:
            if function is controller_disconnect:  # releases the variables of the controller
                self._variables = {each: kept for each, kept in self._variables.items() if kept.owner != owner}
            return None
        if function.result is None:
            return hresult.S_OK, None
        return hresult.S_OK, result if exact else result.plain

    def _create(self, name: str, owner: int) -> Variant:
        assert self._packets is not None
        handle = next(self._handles)
        self._variables[handle] = PacketVariable(name, owner, self._packets)
        return trusted(VarType.I4, handle)

    def _call(self, function: Function[..., Any], arguments: tuple[Any, ...]) -> Variant:
        handle, *values = arguments
        found = self._variables.get(handle)
        if found is None or function.interface != "Variable":
            raise error_for(hresult.E_HANDLE, "", function.name, arguments)
        if function.releases:
            del self._variables[handle]
            return variant(None)
        try:
            return variant(getattr(found, function.method)(*map(variant, values)))
        except CallError as error:
            raise error_for(error.code, error.detail, function.name, arguments) from None


def local_calls(trace: Trace | None, *, messages: bool, debug: bool) -> tuple[LocalCalls | None, Trace | None]:
    """Return the local calls of a connection, ``None`` if it has none, and the trace for its conversation.

    Args:
        trace: Callback of the program; ``None`` if there is none.
        messages: False to refuse the message functions.
        debug: True for debug mode.
    """
    if not debug:
        return None if messages else LocalCalls(messages, None), trace
    packets = LastPackets(trace)
    return LocalCalls(messages, packets), packets
