"""User-defined functions of a device (e-CAP 3.3), as a session executes them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import pytest

from orinkit.bcap import packet
from orinkit.bcap.requests import encode_request
from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.provider import BlockingCall, ClientInfo, ControllerObject, Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.cao.table import Argument
from orinkit.cao.user_functions import UserFunction, foreign_entry, user_entry
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.values.variant import Variant, VarType, variant

pytestmark = pytest.mark.core

BLINK = user_entry(
    300, "Blink",
    (Argument("times", VarType.I4), Argument("color", VarType.BSTR, optional=True, default="")),
    VarType.VARIANT, "", "",
)  # fmt: skip
OF_HTTP = user_entry(255, "Beep", (), VarType.VARIANT, "", "")
NO_RESULT = user_entry(301, "Rest", (), None, "", "")
LATER = user_entry(302, "Later", (), VarType.VARIANT, "", "")


class Lamp(Provider):
    """A device with user-defined functions; ``guard`` records when it is entered."""

    provider_names = ("Lamp",)

    def __init__(self) -> None:
        self.entered: list[str] = []

    @property
    def guard(self) -> Any:
        return self

    def __enter__(self) -> None:
        self.entered.append("in")

    def __exit__(self, *_: object) -> None:
        self.entered.append("out")

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        return ControllerObject(name)

    def user_functions(self) -> Sequence[UserFunction]:
        return [
            UserFunction(BLINK, self.blink),
            UserFunction(OF_HTTP, lambda: "beep"),
            UserFunction(NO_RESULT, lambda: None),
            UserFunction(LATER, lambda: BlockingCall(lambda: 7)),
        ]

    def blink(self, times: int, color: str = "white") -> str:
        if times < 0:
            raise error_for(hresult.E_INVALIDARG, "negative")
        if times > 100:
            raise RuntimeError("burnt out")
        self.entered.append("blink")
        return f"{times} {color}"


class Private(Lamp):
    """A device that expects a secret at Controller_Connect."""

    requires_secret = True


def session(provider: Provider | None = None, transport: str = "tcp", **parameters: Any) -> Session:
    return Session(ProviderRegistry(provider or Lamp()), ClientInfo("127.0.0.1", transport, 5000), **parameters)


def call(client: Session, number: int, *arguments: Any) -> Any:
    return client.invoke(number, [variant(each) for each in arguments])


def test_the_arguments_have_their_types_and_the_function_has_its_own_defaults():
    client = session()
    assert call(client, 300, 3, "red") == CallReply(0, variant("3 red"))
    assert call(client, 300, "3") == CallReply(0, variant("3 white"))
    assert call(client, 301) == CallReply()
    assert call(client, 300, "three").code == hresult.E_INVALIDARGTYPE
    assert call(client, 300).code == hresult.E_INVALIDARG


def test_the_guard_of_the_device_is_entered():
    lamp = Lamp()
    call(session(lamp), 300, 1)
    assert lamp.entered == ["in", "blink", "out"]


def test_a_blocking_function_is_completed_later():
    client = session()
    pending = call(client, 302)
    assert isinstance(pending, Pending)
    assert client.complete(pending, pending.work.run()) == CallReply(0, variant(7))


def test_a_function_that_no_device_has_is_not_implemented():
    client = session()
    for number in (299, 2**31, 2**32 - 1):
        assert call(client, number) == CallReply(hresult.E_NOTIMPL, detail=f"unknown function {number}")


def test_number_255_exists_only_over_e_cap():
    assert call(session(), 255).code == hresult.E_NOTIMPL
    assert call(session(transport="http"), 255) == CallReply(0, variant("beep"))


def test_errors_of_the_function_become_replies(caplog):
    client = session()
    assert call(client, 300, -1) == CallReply(hresult.E_INVALIDARG, detail="negative")
    reply = call(client, 300, 101)
    assert (reply.code, reply.detail) == (hresult.E_FAIL, "RuntimeError: burnt out")
    assert "Blink: the device raised an exception" in caplog.text


def test_a_device_with_a_secret_serves_its_functions_after_controller_connect():
    client = session(Private())
    assert call(client, 300, 1).code == hresult.E_ACCESSDENIED
    assert call(client, 3, "", "Lamp", "", "").code == 0
    assert call(client, 300, 1) == CallReply(0, variant("1 white"))


def test_two_devices_with_the_same_number_are_refused():
    class Other(Lamp):
        provider_names = ("Other",)

    with pytest.raises(ValueError, match="Lamp and Other both have the user-defined function 300"):
        ProviderRegistry([Lamp(), Other()])


@pytest.mark.parametrize(("number", "name"), [(300, "Blink"), (101, "Variable_GetValue")])
def test_a_result_that_cannot_be_sent_is_logged_with_the_name_of_the_function(number, name, caplog):
    client = session()
    error = CallError(hresult.E_OUTOFMEMORY, "too large")
    with caplog.at_level(logging.INFO, "orinkit"):
        assert client.refuse(number, error) == CallReply(hresult.E_OUTOFMEMORY, detail="too large")
    assert client.client.describe_error(hresult.E_OUTOFMEMORY) == "too large"
    assert [record.getMessage().split(":")[0] for record in caplog.records] == [name]


def test_a_client_sends_any_number_of_arguments():
    """The client does not know the arguments, so that each of them is sent with its own type."""
    for arguments in ((), (3,), (3, "red", 0.5, None, Variant(VarType.I2, 7))):
        data = encode_request(foreign_entry(300, len(arguments)), arguments, 5)
        read = packet.decode(data, exact=True)
        assert (read.serial, read.code, read.arguments) == (5, 300, [variant(each) for each in arguments])
    with pytest.raises(InvalidValue, match="User_300, argument 2"):
        encode_request(foreign_entry(300, 2), (3, object()), 5)
