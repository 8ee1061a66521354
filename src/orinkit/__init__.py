"""orinkit: clients and servers for DENSO robot controllers over b-CAP and e-CAP.

>>> import orinkit
>>> with orinkit.connect("tcp://192.168.0.1:5007") as rc8:  # doctest: +SKIP
...     rc8.variable("IO150").value = True
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from orinkit.can.server import serve_can
from orinkit.cao import functions
from orinkit.cao.provider import Provider
from orinkit.client._shared.common import ErrorInfo
from orinkit.client._shared.connection_string import ConnectionString
from orinkit.client._sync.client import Client
from orinkit.client._sync.controller import Command, Controller, Extension, Message, connect
from orinkit.client._sync.file import File
from orinkit.client._sync.motion import Motion
from orinkit.client._sync.objects import PreparedCall, Variable
from orinkit.client._sync.robot import Robot
from orinkit.client._sync.task import Task
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
from orinkit.device import Device, Part, command, variable
from orinkit.server.http.options import HttpOptions
from orinkit.server.threaded import Server, serve
from orinkit.values.poses import J, P, PassMark, T, V
from orinkit.values.variant import Variant, VarType

if TYPE_CHECKING:
    from orinkit.client._shared.stream import Progress, StreamResult, Timing
    from orinkit.client._sync.stream import Stream
    from orinkit.rc8.slave_lateness import Lateness
    from orinkit.streaming.planning.limits import Limits, PathLimits
    from orinkit.streaming.process.realtime import RealTime
    from orinkit.streaming.recording.samples import Sample
    from orinkit.streaming.trajectory.limit_violations import TrajectoryError

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
    "set_language",
    "variable",
]

_ON_FIRST_USE: Final = {
    "Lateness": "rc8.slave_lateness",
    "Limits": "streaming.planning.limits",
    "PathLimits": "streaming.planning.limits",
    "Progress": "client._shared.stream",
    "RealTime": "streaming.process.realtime",
    "Sample": "streaming.recording.samples",
    "Stream": "client._sync.stream",
    "StreamResult": "client._shared.stream",
    "Timing": "client._shared.stream",
    "TrajectoryError": "streaming.trajectory.limit_violations",
}
"""Names of streaming and their modules; most programs do not stream, and importing these modules takes 30 ms."""


if not TYPE_CHECKING:  # or type checkers would accept any name

    def __getattr__(name: str) -> object:
        """Import a name of streaming on first use (PEP 562)."""
        if name not in _ON_FIRST_USE:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = getattr(import_module(f"{__name__}.{_ON_FIRST_USE[name]}"), name)
        return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *_ON_FIRST_USE})


# help() and tracebacks show orinkit as the module of the public names
for _name in globals().keys() & set(__all__):
    _public = globals()[_name]
    if isinstance(_public, type) or getattr(_public, "__name__", "") == _name:
        _public.__module__ = __name__
