"""Waco Giken ABH3 motor drivers on CAN.

In this package, "the document" is Waco Giken's "ABH3 CAN 通信 ホスト用サンプルソフト仕様". Section numbers refer to it.
:mod:`orinkit.abh3.aio` is the asyncio counterpart of this module.

>>> from orinkit import abh3
>>> with abh3.connect("can://socketcan/can0") as driver:  # doctest: +SKIP
...     driver.reset_errors()
...     driver.set_input("servo_on", True)
"""

from __future__ import annotations

from orinkit.abh3.api.names import Driver, MotorBus, connect, open_bus
from orinkit.abh3.differential import Differential
from orinkit.abh3.table.decoder import DecodedFrame, Decoder
from orinkit.abh3.table.records import BR0, BR1, BR1V2, BR2, BR3, BR4, BR5, BR6, BUF, DP0R, DP0RV2, DP0S, DP1R, Flags
from orinkit.abh3.table.signals import DIALECTS, V1, V2, Dialect
from orinkit.core.errors import DriverFault, DriverTimeout, ParameterRefused

__all__ = [
    "BR0",
    "BR1",
    "BR1V2",
    "BR2",
    "BR3",
    "BR4",
    "BR5",
    "BR6",
    "BUF",
    "DIALECTS",
    "DP0R",
    "DP0RV2",
    "DP0S",
    "DP1R",
    "V1",
    "V2",
    "DecodedFrame",
    "Decoder",
    "Dialect",
    "Differential",
    "Driver",
    "DriverFault",
    "DriverTimeout",
    "Flags",
    "MotorBus",
    "ParameterRefused",
    "connect",
    "open_bus",
]
