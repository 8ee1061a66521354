"""The host API of ABH3: drivers on a CAN bus, synchronous and in asyncio (section 4 of the ABH3 document).

::

    with connect("can://socketcan/can0") as abh3:
        abh3.reset_errors()
        abh3.set_input("servo_on", True)
        abh3.set_input("start", True)
        abh3.keep_alive()
        print(abh3.command(ay=100.0, bx=100.0).a_velocity)
"""

from __future__ import annotations

from orinkit.abh3.api._async.bus import AsyncMotorBus
from orinkit.abh3.api._async.driver import AsyncDriver
from orinkit.abh3.api._sync.bus import MotorBus, connect, open_bus
from orinkit.abh3.api._sync.driver import Driver
from orinkit.abh3.api.common import BusSettings, HostSettings, Settings, make_host

__all__ = [
    "AsyncDriver",
    "AsyncMotorBus",
    "BusSettings",
    "Driver",
    "HostSettings",
    "MotorBus",
    "Settings",
    "connect",
    "make_host",
    "open_bus",
]
