"""ClientInfo: the information that a device receives on its client, and the allocation of handles."""

from __future__ import annotations

from typing import Any

import pytest

from orinkit.cao.functions import BY_NAME
from orinkit.cao.handles import HandleAllocator
from orinkit.cao.outcomes import CallReply
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.values.variant import Variant, VarType, plain, variant

pytestmark = pytest.mark.core


def call(session: Session, name: str, *arguments: Any) -> CallReply:
    reply = session.invoke(BY_NAME[name].id, [variant(argument) for argument in arguments])
    assert isinstance(reply, CallReply)
    return reply


def value(session: Session, name: str, *arguments: Any) -> Any:
    return plain(call(session, name, *arguments).result)


class ClientInfoProvider(Provider):
    """Stores the information on its client."""

    provider_names = ("Test.Told", "Test.Other")
    client: ClientInfo

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        self.client = client
        return Failing()


class Failing(ControllerObject):
    def execute(self, command: str, parameter: Variant) -> Any:
        if command == "Crash":
            raise RuntimeError("the spindle is stuck")
        raise error_for(int(plain(parameter)), command)


def test_a_device_receives_the_requested_provider_name() -> None:
    provider = ClientInfoProvider()
    session = Session(ProviderRegistry(provider))
    call(session, "Controller_Connect", "", "test.OTHER", "localhost", "")
    assert provider.client.provider == "test.OTHER"


def test_a_device_can_read_the_reason_of_a_failed_call() -> None:
    provider = ClientInfoProvider()
    session = Session(ProviderRegistry(provider))
    controller = value(session, "Controller_Connect", "", "Test.Told", "localhost", "")
    reason = provider.client.describe_error
    assert reason(hresult.E_FAIL) == ""
    call(session, "Controller_Execute", controller, "Crash", None)
    assert reason(hresult.E_FAIL) == reason(hresult.signed(hresult.E_FAIL)) == "RuntimeError: the spindle is stuck"
    call(session, "Controller_Execute", controller, "jammed", Variant(VarType.I4, hresult.signed(0x80020005)))
    assert reason(0x80020005) == "jammed"
    assert ClientInfo().describe_error(hresult.E_FAIL) == ""


def test_the_oldest_reason_is_dropped() -> None:
    session = Session(ProviderRegistry(ClientInfoProvider()))
    controller = value(session, "Controller_Connect", "", "Test.Told", "localhost", "")
    for number in range(40):
        call(
            session,
            "Controller_Execute",
            controller,
            f"no {number}",
            Variant(VarType.I4, hresult.signed(0x80020000 + number)),
        )
    assert session.client.describe_error(0x80020000 + 7) == ""
    assert session.client.describe_error(0x80020000 + 8) == "no 8"


def test_sessions_may_share_their_handles() -> None:
    numbers, host = HandleAllocator(), ProviderRegistry(ClientInfoProvider())
    one, other = Session(host, numbers=numbers), Session(host, numbers=numbers)
    handles = [value(session, "Controller_Connect", "", "Test.Told", "", "") for session in (one, other, one)]
    assert handles == [2, 3, 4]
