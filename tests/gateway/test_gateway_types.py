"""All VARIANTs arrive bit-identical in both directions; over e-CAP, which sends text, all NaNs become the same one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings

import orinkit
from orinkit.cao import functions as f
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, RobotObject
from orinkit.client._sync.client import Client
from orinkit.values.codec import decode, encode_variant
from orinkit.values.types import SIZES
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from support.gateways import HTTP, LISTEN, PATIENCE, chain
from support.strategies import same, strings, variants

SIMPLE = [vt for vt in SIZES if vt not in (VarType.BOOL, VarType.DATE, VarType.CY, VarType.R4, VarType.R8)]
EACH = [
    Variant(VarType.EMPTY),
    Variant(VarType.NULL),
    *(Variant(vt, 1) for vt in SIMPLE),
    *(Variant(vt | ARRAY, [1, 2]) for vt in SIMPLE),
    *(Variant(vt, 0.1) for vt in (VarType.R4, VarType.R8, VarType.DATE)),
    *(Variant(vt | ARRAY, [0.1, -0.0, float("inf")]) for vt in (VarType.R4, VarType.R8)),
    Variant(VarType.R4, float("nan")),
    Variant(VarType.BOOL, True),
    Variant(VarType.BSTR, "日本語 \ud800"),
    Variant(VarType.BSTR | ARRAY, ["", "a"]),
    Variant(VARIANT_ARRAY, [Variant(VarType.R4, 0.1), Variant(VARIANT_ARRAY, [Variant(VarType.I2, 1)])]),
]


class EchoController(ControllerObject):
    """A controller that returns and stores the received values."""

    def __init__(self, received: list[Any]) -> None:
        super().__init__()
        self.received = received

    def execute(self, command: str, parameter: Variant) -> Variant:
        self.received[:] = [command, parameter]
        return parameter

    def get_robot(self, name: str, option: str) -> Any:
        return ReceivingRobot(self.received)


class ReceivingRobot(RobotObject):
    def __init__(self, received: list[Any]) -> None:
        super().__init__()
        self.received = received

    def accelerate(self, axis: int, accel: float, decel: float) -> None:
        self.received[:] = [axis, accel, decel]

    def move(self, interpolation: int, pose: Variant, option: str) -> None:
        self.received[:] = [interpolation, pose, option]


class ReceivingProvider(Provider):
    provider_names = ("*",)

    def __init__(self) -> None:
        self.received: list[Any] = []

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        return EchoController(self.received)


@pytest.fixture(scope="module")
def provider() -> ReceivingProvider:
    return ReceivingProvider()


class Route(NamedTuple):
    """A client, its controller, and True if values are sent as text between them."""

    raw: Client
    controller: int
    text: bool


@pytest.fixture(scope="module", params=[LISTEN, HTTP], ids=["tcp", "http"])
def route(provider: ReceivingProvider, request: pytest.FixtureRequest) -> Iterator[Route]:
    with chain(provider, 2, request.param, timeout=PATIENCE) as url, orinkit.open_client(url, timeout=PATIENCE) as raw:
        yield Route(raw, raw.call(f.controller_connect, "", "", "", ""), request.param == HTTP)


def check(provider: ReceivingProvider, route: Route, value: Variant) -> None:
    returned = route.raw.request(f.controller_execute, route.controller, "Echo", value, exact=True).value
    read, _ = decode(encode_variant(value), 0, exact=True)  # the value as decoded from a packet
    for arrived in (provider.received[1], returned):
        assert same(arrived, read)
        if not route.text or "nan" not in repr(value):
            assert encode_variant(arrived) == encode_variant(value)


@pytest.mark.parametrize("value", EACH, ids=lambda value: f"{int(value.type):#x}")
def test_each_type(provider: ReceivingProvider, route: Route, value: Variant) -> None:
    check(provider, route, value)


@given(value=variants())
@settings(max_examples=150)
def test_any_variant(provider: ReceivingProvider, route: Route, value: Variant) -> None:
    check(provider, route, value)


@given(text=strings())
@settings(max_examples=50)
def test_any_text(provider: ReceivingProvider, route: Route, text: str) -> None:
    route.raw.call(f.controller_execute, route.controller, text)
    assert provider.received == [text, Variant(VarType.EMPTY)]


def test_numbers_of_the_table(provider: ReceivingProvider, route: Route) -> None:
    raw = route.raw
    robot = raw.call(f.controller_get_robot, route.controller, "")
    for axis, accel in ((-1, 0.10000000149011612), (2**31 - 1, 3.4028234663852886e38), (-(2**31), -0.0)):
        raw.call(f.robot_accelerate, robot, axis, accel, 1.5)
        assert repr(provider.received) == repr([axis, accel, 1.5])
    pose = Variant(VarType.R4 | ARRAY, [0.1] * 7)
    raw.call(f.robot_move, robot, 1, pose, "NEXT")
    assert provider.received[0] == 1
    assert encode_variant(provider.received[1]) == encode_variant(pose)


@pytest.mark.parametrize("size", [0, 1, 65536, 4_000_000])
def test_large_values(provider: ReceivingProvider, route: Route, size: int) -> None:
    if route.text:
        size //= 10  # text is longer
    check(provider, route, Variant(VarType.UI1 | ARRAY, bytes(range(256)) * (size // 256) + bytes(size % 256)))
    check(provider, route, Variant(VarType.BSTR, "あ" * (size // 2)))
