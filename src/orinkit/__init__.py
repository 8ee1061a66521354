"""orinkit: clients and servers for DENSO robot controllers over b-CAP and e-CAP.

>>> import orinkit
>>> with orinkit.connect("tcp://192.168.0.1:5007") as rc8:  # doctest: +SKIP
...     rc8.variable("IO150").value = True
"""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Final

from orinkit.core import hresult
from orinkit.core.errors import (
    AccessDenied,
    AlreadyRegistered,
    BusyError,
    CallError,
    CallTimeout,
    CaoError,
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    ControllerError,
    DriverFault,
    DriverTimeout,
    ExecutionTimeout,
    GeneralError,
    InvalidAddress,
    InvalidArgument,
    InvalidHandle,
    InvalidValue,
    LanguageError,
    LimitExceeded,
    MessagesDisabled,
    MissingExtra,
    MotionError,
    NotationError,
    NotImplementedCall,
    ObjectNotFound,
    ObjectReleased,
    OptionError,
    OrinError,
    PacketError,
    ParameterRefused,
    PendantError,
    ProgramError,
    ProtocolError,
    ProviderLoadFailed,
    SafetyError,
    ServoError,
    SocketError,
    StreamError,
    TransportError,
    UnknownError,
    UserDefinedError,
    error_for,
)
from orinkit.core.i18n import use as set_language

if TYPE_CHECKING:
    from orinkit.can.server import serve_can
    from orinkit.cao import functions
    from orinkit.cao.provider import Provider
    from orinkit.client._shared.common import ErrorInfo
    from orinkit.client._shared.connection_string import ConnectionString
    from orinkit.client._shared.stream import Progress, StreamResult, Timing
    from orinkit.client._sync.client import Client
    from orinkit.client._sync.controller import Command, Controller, Extension, Message, connect
    from orinkit.client._sync.file import File
    from orinkit.client._sync.motion import Motion
    from orinkit.client._sync.objects import PreparedCall, Variable
    from orinkit.client._sync.robot import Robot
    from orinkit.client._sync.stream import Stream
    from orinkit.client._sync.task import Task
    from orinkit.device import Device, Part, command, variable
    from orinkit.rc8.slave_lateness import Lateness
    from orinkit.server.http.options import HttpOptions
    from orinkit.server.threaded import Server, serve, serve_many
    from orinkit.streaming.planning.limits import Limits, PathLimits
    from orinkit.streaming.process.realtime import RealTime
    from orinkit.streaming.recording.samples import Sample
    from orinkit.streaming.trajectory.limit_violations import TrajectoryError
    from orinkit.values.poses import J, P, PassMark, T, V
    from orinkit.values.variant import Variant, VarType

    open_client = Client.open

__version__ = "0.1.0"

__all__ = [
    "AccessDenied",
    "AlreadyRegistered",
    "BusyError",
    "CallError",
    "CallTimeout",
    "CaoError",
    "Client",
    "Command",
    "ConnectFailed",
    "ConnectionClosed",
    "ConnectionLost",
    "ConnectionString",
    "Controller",
    "ControllerError",
    "Device",
    "DriverFault",
    "DriverTimeout",
    "ErrorInfo",
    "ExecutionTimeout",
    "Extension",
    "File",
    "GeneralError",
    "HttpOptions",
    "InvalidAddress",
    "InvalidArgument",
    "InvalidHandle",
    "InvalidValue",
    "J",
    "LanguageError",
    "Lateness",
    "LimitExceeded",
    "Limits",
    "Message",
    "MessagesDisabled",
    "MissingExtra",
    "Motion",
    "MotionError",
    "NotImplementedCall",
    "NotationError",
    "ObjectNotFound",
    "ObjectReleased",
    "OptionError",
    "OrinError",
    "P",
    "PacketError",
    "ParameterRefused",
    "Part",
    "PassMark",
    "PathLimits",
    "PendantError",
    "PreparedCall",
    "ProgramError",
    "Progress",
    "ProtocolError",
    "Provider",
    "ProviderLoadFailed",
    "RealTime",
    "Robot",
    "SafetyError",
    "Sample",
    "Server",
    "ServoError",
    "SocketError",
    "Stream",
    "StreamError",
    "StreamResult",
    "T",
    "Task",
    "Timing",
    "TrajectoryError",
    "TransportError",
    "UnknownError",
    "UserDefinedError",
    "V",
    "VarType",
    "Variable",
    "Variant",
    "command",
    "connect",
    "error_for",
    "functions",
    "hresult",
    "open_client",
    "serve",
    "serve_can",
    "serve_many",
    "set_language",
    "variable",
]

_ON_FIRST_USE: Final = {
    "Client": "client._sync.client:Client",
    "Command": "client._sync.controller:Command",
    "ConnectionString": "client._shared.connection_string:ConnectionString",
    "Controller": "client._sync.controller:Controller",
    "Device": "device:Device",
    "ErrorInfo": "client._shared.common:ErrorInfo",
    "Extension": "client._sync.controller:Extension",
    "File": "client._sync.file:File",
    "HttpOptions": "server.http.options:HttpOptions",
    "J": "values.poses:J",
    "Lateness": "rc8.slave_lateness:Lateness",
    "Limits": "streaming.planning.limits:Limits",
    "Message": "client._sync.controller:Message",
    "Motion": "client._sync.motion:Motion",
    "P": "values.poses:P",
    "Part": "device:Part",
    "PassMark": "values.poses:PassMark",
    "PathLimits": "streaming.planning.limits:PathLimits",
    "PreparedCall": "client._sync.objects:PreparedCall",
    "Progress": "client._shared.stream:Progress",
    "Provider": "cao.provider:Provider",
    "RealTime": "streaming.process.realtime:RealTime",
    "Robot": "client._sync.robot:Robot",
    "Sample": "streaming.recording.samples:Sample",
    "Server": "server.threaded:Server",
    "Stream": "client._sync.stream:Stream",
    "StreamResult": "client._shared.stream:StreamResult",
    "T": "values.poses:T",
    "Task": "client._sync.task:Task",
    "Timing": "client._shared.stream:Timing",
    "TrajectoryError": "streaming.trajectory.limit_violations:TrajectoryError",
    "V": "values.poses:V",
    "VarType": "values.variant:VarType",
    "Variable": "client._sync.objects:Variable",
    "Variant": "values.variant:Variant",
    "command": "device:command",
    "connect": "client._sync.controller:connect",
    "functions": "cao.functions:",
    "open_client": "client._sync.client:Client.open",
    "serve": "server.threaded:serve",
    "serve_can": "can.server:serve_can",
    "serve_many": "server.threaded:serve_many",
    "variable": "device:variable",
}
"""The names that are imported on first use, and their places.

Exceptions are imported with the package. All other names together take three times as long, and no program uses them
all: a client needs no server, a server no client, and most programs do not stream.
"""


def _publish(name: str, public: object) -> None:
    """Make help() and tracebacks show orinkit as the module of a public name."""
    if isinstance(public, type) or getattr(public, "__name__", "") == name:
        public.__module__ = __name__


if not TYPE_CHECKING:  # or type checkers would accept any name

    def __getattr__(name: str) -> object:
        """Import a name on first use (PEP 562)."""
        if name not in _ON_FIRST_USE:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        import_module(f"{__name__}.{_ON_FIRST_USE[name].partition(':')[0]}")
        for each, place in _ON_FIRST_USE.items():  # connect() also imports Robot, which is to be shown as orinkit.Robot
            module, _, path = place.partition(":")
            found = sys.modules.get(f"{__name__}.{module}")
            if found is None:
                continue
            with suppress(AttributeError):  # another thread is importing the module
                globals()[each] = attrgetter(path)(found) if path else found
                _publish(each, globals()[each])
        return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *_ON_FIRST_USE})


for _name in globals().keys() & set(__all__):
    _publish(_name, globals()[_name])
