"""Motions begun by a client: classification of calls, and the query of a session to its devices."""

from __future__ import annotations

import logging
from typing import Any

import pytest

from orinkit.bcap import packet
from orinkit.bcap.actions import Execute, Send
from orinkit.bcap.client import sign_of_life
from orinkit.bcap.packet import Packet
from orinkit.bcap.server import ServerConversation
from orinkit.cao import functions as f
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.rc8.motion_calls import begins_together, leaves_moving
from orinkit.values.variant import Variant, VarType, variant

pytestmark = pytest.mark.core


@pytest.mark.parametrize(
    ("function", "arguments", "answer"),
    [
        (f.robot_move, (1, "J(1,2,3,4,5,6)", "NEXT"), True),
        (f.robot_move, (1, variant("@P J(1,2,3,4,5,6)"), "speed=50, next"), True),
        (f.robot_move, (1, "J(1,2,3,4,5,6)"), False),
        (f.robot_execute, ("Approach", variant([1, "P1", 10.0, "NEXT"])), True),
        (f.robot_execute, (variant("GiveArm"),), False),
        (f.robot_execute, ("Motor", variant([1, 0])), None),
        (f.robot_execute, (), None),
        (f.robot_execute, ("SyncTimeEnd", variant(1)), True),
        (f.robot_execute, (variant(" syncmoveend "), variant([1])), True),
        (f.robot_execute, ("SyncMoveEnd", variant("1")), True),
        (f.robot_execute, ("SyncTimeEnd", variant(0)), False),
        (f.robot_execute, ("SyncTimeEnd",), False),
        (f.robot_execute, ("SyncTimeStart",), None),
        (f.robot_halt, (), False),
        (f.variable_get_value, (), None),
    ],
)  # fmt: skip
def test_which_calls_leave_an_arm_moving(function: Any, arguments: Any, answer: bool | None) -> None:
    assert leaves_moving(function, arguments) is answer


def test_which_calls_begin_the_motions_of_several_arms() -> None:
    assert begins_together(f.robot_execute, ("SyncTimeEnd", variant(0)))
    assert begins_together(f.robot_execute, (variant("syncmoveend"),))
    assert not begins_together(f.robot_execute, ("SyncMoveStart", variant([1])))
    assert not begins_together(f.robot_execute, ())
    assert not begins_together(f.controller_execute, ("SyncTimeEnd", variant(0)))


class Axis(ControllerObject):
    """A device that moves, or fails."""

    moves = True
    fails = False
    stopped = 0

    def is_moving(self) -> bool:
        if self.fails:
            raise ValueError("no idea")
        return self.moves

    def stop_moving(self) -> None:
        self.stopped += 1
        if self.fails:
            raise ValueError("no way")


class Axes(Provider):
    provider_names = ("Test.Axes",)

    def __init__(self) -> None:
        self.made: list[Axis] = []

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControllerObject:
        if name == "plain":
            return ControllerObject(name)
        self.made.append(Axis(name))
        return self.made[-1]


def connect(session: Session, name: str) -> None:
    session.invoke(3, [Variant(VarType.BSTR, text) for text in (name, "Test.Axes", "localhost", "")])


def test_a_session_asks_its_controllers(caplog: pytest.LogCaptureFixture) -> None:
    axes = Axes()
    session = Session(ProviderRegistry(axes))
    assert not session.is_moving()
    connect(session, "plain")
    assert not session.is_moving()
    session.stop_moving()
    connect(session, "x")
    assert session.is_moving()
    session.stop_moving()
    (axis,) = axes.made
    assert axis.stopped == 1
    axis.moves = False
    assert not session.is_moving()
    axis.fails = True
    with caplog.at_level(logging.CRITICAL, "orinkit"):
        assert session.is_moving()  # unknown counts as moving, so that it is stopped
        session.stop_moving()
    assert axis.stopped == 2


def test_a_conversation_records_the_times_of_requests_and_replies() -> None:
    conversation = ServerConversation()
    request = packet.encode(Packet(1, 1, ["WDT=400,Alive=1000"]))
    (call,) = conversation.receive(request, 5.0)
    assert isinstance(call, Execute)
    assert conversation.max_silence == 1.0
    assert (conversation.last_request_at, conversation.last_reply_at) == (5.0, 0.0)
    (busy,) = conversation.receive(sign_of_life(2), 6.0)
    assert isinstance(busy, Send)
    assert packet.decode(busy.data).serial == 0
    assert conversation.last_request_at == 6.0
    conversation.update_time(7.0)
    assert conversation.finish(call, 0, None)
    assert (conversation.last_request_at, conversation.last_reply_at) == (6.0, 7.0)
    list(conversation.receive(packet.encode(Packet(2, 21, [2])), 8.0))
    conversation.abandon()
    assert not conversation.busy
    assert conversation.max_silence is None
