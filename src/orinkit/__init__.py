"""orinkit: drive and serve DENSO robot controllers over b-CAP.

>>> import orinkit
>>> with orinkit.connect("tcp://192.168.0.1:5007") as rc8:  # doctest: +SKIP
...     rc8.variable("IO150").value = True
"""

from __future__ import annotations

from orinkit.cao import functions
from orinkit.cao.provider import Provider
from orinkit.client._sync import (
    Client,
    Command,
    Controller,
    Extension,
    File,
    Message,
    Robot,
    Task,
    Variable,
)
from orinkit.client._sync import open_controller as connect
from orinkit.errors import CallError, CallTimeout, ConnectionLost, OrinError
from orinkit.server.background import Server, serve
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
    "Extension",
    "File",
    "Message",
    "OrinError",
    "Provider",
    "Robot",
    "Server",
    "Task",
    "VarType",
    "Variable",
    "Variant",
    "connect",
    "functions",
    "open_client",
    "serve",
]
