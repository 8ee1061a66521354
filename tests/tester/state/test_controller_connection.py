"""The connection of the Tester to a controller."""

from __future__ import annotations

import asyncio

import pytest

import orinkit
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.controller_connection import ControllerConnection
from orinkit.tester.state.packet_log import PacketLog
from orinkit.virtual.rc8 import VirtualRC8


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
