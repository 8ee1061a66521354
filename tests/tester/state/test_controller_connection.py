"""The connection of the Tester to a controller."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

import orinkit
from orinkit.tester.state.connection import ConnectionState
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.packet_log import PacketLog
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support.waiting import PATIENCE


@pytest.mark.parametrize("debug", [False, True])
def test_debug_mode_has_the_variable_of_the_last_packet(debug):
    async def name_is_known(url: str) -> bool:
        connection = ControllerConnection(ConnectionSpec("a", url, debug=debug), PacketLog())
        await connection.open()
        try:
            variable = await connection.controller.variable("$LAST_SEND_PACKET$")
            return bool(await variable.get_value())
        except orinkit.CallError:
            return False
        finally:
            await connection.close()

    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server:
        assert asyncio.run(name_is_known(server.url)) is debug


@pytest.mark.parametrize("messages", [False, True])
def test_messages_are_refused_if_they_are_not_fetched(messages):
    async def refused(url: str) -> bool:
        connection = ControllerConnection(ConnectionSpec("a", url, messages=messages), PacketLog())
        await connection.open()
        try:
            await connection.controller.message()
        except orinkit.MessagesDisabled:
            return True
        finally:
            await connection.close()
        return False

    with orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as server:
        assert asyncio.run(refused(server.url)) is not messages


def test_an_idle_serial_line_is_not_used_and_its_end_is_detected():
    async def lose(url: str, end: Callable[[], None]) -> tuple[int, int, ConnectionState, str]:
        packets = PacketLog()
        connection = ControllerConnection(ConnectionSpec("a", url, provider=""), packets)
        await connection.open()
        try:
            before = len(packets)
            await asyncio.sleep(2.5)  # at least two checks
            after = len(packets)
            await asyncio.to_thread(end)
            for _ in range(int(PATIENCE * 10)):
                if connection.state is ConnectionState.LOST:
                    break
                await asyncio.sleep(0.1)
            return before, after, connection.state, f"{connection.error}"
        finally:
            await connection.close()

    server = orinkit.serve(VirtualVE026A(), "pty://")
    before, after, state, error = asyncio.run(lose(server.url, server.close))
    assert before == after
    assert state is ConnectionState.LOST
    assert "does not exist any more" in error


@pytest.mark.parametrize("number", [0, 1])
def test_the_robot_of_a_connection_is_chosen_by_its_number(number):
    async def types(url: str) -> list[object]:
        connection = ControllerConnection(ConnectionSpec("a", url, robot=number).check(), PacketLog())
        await connection.open()
        try:
            robots = [await connection.robot(), await connection.monitored_robot()]
            robots.append(await connection.robot_of(connection.controller))
            return [await robot.execute("GetRobotTypeName") for robot in robots]
        finally:
            await connection.close()

    rc8 = VirtualRC8(second_model="VS-060")
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        assert asyncio.run(types(server.url)) == [rc8.state.robots[number].arm.model.type_name] * 3
    rc8.close()


def test_stopping_the_motion_stops_the_robot_of_the_connection():
    async def stop(url: str) -> None:
        connection = ControllerConnection(ConnectionSpec("a", url, robot=1), PacketLog())
        await connection.open()
        try:
            await connection.stop_motion()
        finally:
            await connection.close()

    rc8 = VirtualRC8(second_model="VS-060")
    with orinkit.serve(rc8, "tcp://127.0.0.1:0") as server:
        asyncio.run(stop(server.url))
        assert [robot.arm.interruptions for robot in rc8.state.robots] == [0, 1]
    rc8.close()


def test_a_connection_has_a_robot_0_or_1():
    with pytest.raises(orinkit.InvalidValue, match="robot"):
        ConnectionSpec("a", "tcp://127.0.0.1", robot=2).check()
