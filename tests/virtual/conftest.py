from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from orinkit.cao.provider import BlockingCall, ClientInfo
from orinkit.core.errors import CallError
from orinkit.virtual.clock import ManualClock
from orinkit.virtual.rc8 import VirtualRC8


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def rc8(clock) -> Iterator[VirtualRC8]:
    device = VirtualRC8(clock=clock, serial_no="SN-42", version="9.8.7")
    yield device
    device.close()


@pytest.fixture
def connect(rc8):
    def connect(name: str = "ctrl", option: str = "", address: str = "192.168.0.7", device: VirtualRC8 | None = None):
        return (device or rc8).connect(name, "localhost", option, ClientInfo(address, "tcp"))

    return connect


@pytest.fixture
def controller(connect):
    return connect()


@pytest.fixture
def refused():
    """Call something, to its end, and return the code that it is refused with."""

    def refused(call: Callable[..., Any], *arguments: Any) -> int:
        with pytest.raises(CallError) as caught:
            result = call(*arguments)
            if isinstance(result, BlockingCall):
                result.run()
        return caught.value.code

    return refused
