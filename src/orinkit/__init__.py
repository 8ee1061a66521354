"""orinkit: drive and serve DENSO robot controllers over b-CAP and e-CAP.

>>> import orinkit
>>> with orinkit.connect("tcp://192.168.0.1:5007") as rc8:  # doctest: +SKIP
...     rc8.variable("IO150").value = True
"""

from __future__ import annotations

from orinkit.cao import functions
from orinkit.cao.provider import Provider
from orinkit.client._sync import (
    Command,
    Controller,
    Extension,
    File,
    Message,
)
from orinkit.client._sync import open_controller as connect
from orinkit.client._sync_client import Client
from orinkit.client._sync_motion import Motion
from orinkit.client._sync_nodes import Variable
from orinkit.client._sync_robot import Robot
from orinkit.client._sync_task import Task
from orinkit.device import Device, Part, command, variable
from orinkit.errors import CallError, CallTimeout, ConnectionLost, OrinError
from orinkit.poses import J, P, T, V
from orinkit.server.background import Server, serve
from orinkit.server.can_server import serve_can
from orinkit.server.http_options import HttpOptions
from orinkit.variant import Variant, VarType

open_client = Client.open

__version__ = "0.1.0"

__all__ = [
    "CallError",
    "CallTimeout",
    "Client",
    "Command",
    "ConnectionLost",
    "Controller",
    "Device",
    "Extension",
    "File",
    "HttpOptions",
    "J",
    "Message",
    "Motion",
    "OrinError",
    "P",
    "Part",
    "Provider",
    "Robot",
    "Server",
    "T",
    "Task",
    "V",
    "VarType",
    "Variable",
    "Variant",
    "command",
    "connect",
    "functions",
    "open_client",
    "serve",
    "serve_can",
    "variable",
]
