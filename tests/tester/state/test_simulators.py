"""The virtual controllers of the Tester: virtual ABH3 drivers do not share a bus, and an ended one is not used again."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from orinkit.core.errors import ConnectFailed, OrinError
from orinkit.tester.state.driver_connection import DriverConnection
from orinkit.tester.state.workspace import Workspace
from support.drivers import soon

if not hasattr(os, "openpty"):
    pytest.skip("this system has no pseudo-terminals", allow_module_level=True)


def test_virtual_drivers_of_two_testers_do_not_share_a_bus(tmp_path: Path):
    async def run() -> None:
        testers = [Workspace(tmp_path / f"{number}.json") for number in range(2)]
        try:
            first, second = await asyncio.gather(*(each.start_simulator("abh3") for each in testers))
            assert isinstance(first, DriverConnection)
            assert isinstance(second, DriverConnection)
            assert first.spec.url != second.spec.url
            await first.driver.reset_errors()
            await first.driver.set_input("servo_on", 1)
            await first.driver.set_input("start", 1)
            await first.driver.command(ay=100.0)
            await soon(lambda: True)
            assert (await first.driver.velocities()).ay_velocity_command == 100
            assert (await second.driver.velocities()).ay_velocity_command == 0
            assert not (await second.driver.states()).control["ay_start"]
            assert all(each.frame.id >> 16 & 0xFF != 0xEF for each in second.frames.newest(4))
            await second_survives(testers[0], first, second)
        finally:
            for each in testers:
                await each.close()

    asyncio.run(run())


async def second_survives(tester: Workspace, first: DriverConnection, second: DriverConnection) -> None:
    """Kill the first virtual driver: its connection cannot be opened again, and the second one still works."""
    assert first.simulator is not None
    os.kill(first.simulator._process.pid, signal.SIGKILL)
    await soon(lambda: first.simulator is not None and not first.simulator.running)
    with pytest.raises(OrinError):
        for _ in range(2):  # a pseudo-terminal of a killed process may return one more reply
            await first.driver.command()
    with pytest.raises(ConnectFailed, match="has ended"):
        await first.open()
    assert (await second.driver.command()).a_velocity == 0
    assert list(tester.simulators) == []
