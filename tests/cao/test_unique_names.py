"""Names of controllers that are unique over all clients of a server (provider guide 5.2.1)."""

from __future__ import annotations

import pytest

from orinkit.cao import functions as f
from orinkit.cao.controller_names import ControllerNames, starts_anew
from orinkit.cao.outcomes import CallReply
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.values.variant import variant

pytestmark = pytest.mark.core

TAKEN = hresult.E_CAO_COLLECTION_REGISTERED
MEMBER = "@IfNotMember"


class Unique(Provider):
    """A provider whose clients may not use the same names."""

    provider_names = ("Unique",)
    unique_names = True

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        return ControllerObject(name)


def clients(*transports: str) -> list[Session]:
    host = ProviderRegistry(Unique())
    return [Session(host, ClientInfo("127.0.0.1", transport, 5000)) for transport in transports]


def reply(session: Session, function: int, *arguments: object) -> CallReply:
    outcome = session.invoke(function, [variant(each) for each in arguments])  # type: ignore[arg-type]  # loosely typed by the table of the test
    assert isinstance(outcome, CallReply)
    return outcome


def connect(session: Session, name: str, option: str = "") -> int:
    """Return the handle of a new controller, or the return code of the refusal."""
    made = reply(session, f.controller_connect.id, name, "Unique", "", option)
    return made.code or made.result.plain  # type: ignore[union-attr,no-any-return]  # it exists here


def name_of(session: Session, handle: int) -> str:
    return reply(session, f.controller_get_name.id, handle).result.plain  # type: ignore[union-attr,no-any-return]  # it exists here


def test_a_name_is_taken_until_its_last_holder_frees_it():
    names = ControllerNames()
    names.hold("Arm", 1)
    names.hold("ARM", 2)
    names.free("arm", 1)
    assert names.is_taken("aRM")
    names.free("Arm", 3)  # never held it
    assert names.is_taken("Arm")
    names.free("Arm", 2)
    assert not names.is_taken("Arm")
    names.free("Arm", 2)
    assert not names.is_taken("Arm")


def test_another_client_cannot_use_a_name_until_it_is_free():
    one, other = clients("tcp", "tcp")
    handle = connect(one, "Arm")
    assert connect(other, "ARM") == TAKEN
    assert connect(one, "Arm") == TAKEN
    assert connect(other, "Leg") == 2
    assert reply(one, f.controller_disconnect.id, handle).code == 0
    assert connect(other, "ARM") == 3
    assert connect(one, "Arm") == TAKEN


@pytest.mark.parametrize("leave", [Session.close, lambda session: reply(session, f.service_stop.id)])
def test_the_names_of_a_client_that_leaves_are_free(leave):
    one, other = clients("tcp", "tcp")
    connect(one, "Arm")
    connect(one, "Leg")
    leave(one)
    assert [connect(other, "Arm"), connect(other, "Leg")] == [2, 3]


def test_clients_share_a_name_on_request():
    one, other, third = clients("tcp", "tcp", "tcp")
    assert connect(one, "Arm", MEMBER) == 2
    assert connect(other, "Arm", MEMBER) == 2
    one.close()
    assert connect(third, "Arm") == TAKEN
    other.close()
    assert connect(third, "Arm") == 2


def test_a_name_that_the_server_makes_is_not_one_of_another_client():
    one, other = clients("tcp", "tcp")
    assert connect(one, "controller1") == 2
    assert connect(other, "Controller2") == 2
    assert name_of(other, connect(other, "")) == "Controller3"
    assert name_of(one, connect(one, "")) == "Controller4"


@pytest.mark.parametrize("transport", ["udp", "serial", "http", "tcp", "memory"])
def test_a_program_that_starts_again_without_a_connection_frees_the_names_of_its_session(transport):
    """On UDP, a serial line and HTTP, no connection ends when the program does."""
    one, other = clients(transport, "tcp")
    handle = connect(one, "Arm")
    assert reply(one, f.service_start.id, "").code == 0
    assert starts_anew(transport) == (transport in ("udp", "serial", "http"))
    assert connect(other, "Arm") == (2 if starts_anew(transport) else TAKEN)
    assert name_of(one, handle) == "Arm"
    assert reply(one, f.controller_disconnect.id, handle).code == 0
    assert connect(one, "Arm") == (TAKEN if starts_anew(transport) else handle + 1)
