"""What the streaming process does in odd states of the memory that it shares with the program."""

from __future__ import annotations

import dataclasses
import json
import os
import socket
from collections.abc import Callable, Iterator
from itertools import pairwise
from time import monotonic, monotonic_ns
from typing import Any

import pytest

from orinkit.arms import load_model
from orinkit.cao.slave_formats import ReceiveFormat, Send, SlaveAnswer, UserWindow, mode_of
from orinkit.slave.channel import Channel
from orinkit.slave.flow import Delivery
from orinkit.slave.limits import Limits, PathLimits
from orinkit.slave.plan import JointPlanner
from orinkit.slave.setup import Setup
from orinkit.slave.shared import Order, Outputs, Shared, _Word
from orinkit.slave.streamer import Connection, Streamer, Watch

HOME = (0.0, 0.0, 90.0, 0.0, 90.0, 0.0)
PERIOD = 0.008
LIMITS = Limits.of_model(load_model("vs-050"))


def setup() -> Setup:
    mode = mode_of(0x202)
    assert mode is not None
    return Setup(
        1, 2, mode, Send(0), ReceiveFormat(4, microseconds=True), None, Outputs(), PERIOD, LIMITS, HOME, (), 1, 1.0, None,
        os.getppid(),
    )  # fmt: skip


class Controller(Connection):
    """Takes every set-point at once; a script says what the program does meanwhile."""

    def __init__(self, script: Callable[[int], None]) -> None:
        super().__init__(None, setup(), "tcp")  # nothing goes over the wire
        self._script = script
        self.count = 0

    def move(self, parameter: Any) -> Delivery:
        self.count += 1
        assert self.count < 5000
        self._script(self.count)
        return Delivery(monotonic(), monotonic(), 0, SlaveAnswer())


@pytest.fixture
def shared() -> Iterator[Shared]:
    memory = Shared.make()
    yield memory
    memory.close()


def commands(shared: Shared, script: Callable[[int], None]) -> list[tuple[float, ...]]:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        watch = Watch(Channel(theirs), os.getppid())
        Streamer(setup(), Controller(script), shared, watch, JointPlanner(LIMITS, PERIOD, HOME)).run()
    samples = [shared.sample(number) for number in range(shared.samples)]
    return [sample.command for sample in samples if sample is not None]


def test_a_target_that_is_being_written_is_no_reason_to_brake(shared: Shared) -> None:
    def script(cycle: int) -> None:
        if cycle == 2:
            shared.set_target((40.0, *HOME[1:]), monotonic_ns())
        elif cycle == 10:  # the program is kept from finishing the next one
            shared._words[_Word.TARGET_BEGUN] += 1
        elif cycle == 1000:
            shared.order(Order.LEAVE)

    made = commands(shared, script)
    assert made[-1][0] == pytest.approx(40.0)
    steps = [after[0] - before[0] for before, after in pairwise(made)]
    first = next(place for place, step in enumerate(steps) if step > 0)
    fastest = steps.index(max(steps))
    assert all(after >= before for before, after in pairwise(steps[first : fastest + 1]))


def test_a_target_before_a_halt_is_not_taken_up_again(shared: Shared) -> None:
    def script(cycle: int) -> None:
        if cycle == 2:
            shared.set_target((150.0, *HOME[1:]), monotonic_ns())
        elif cycle == 30:
            shared.order(Order.HALT)
        elif cycle == 200:
            shared._words[_Word.TARGET_BEGUN] += 1  # of another target, which is not there yet
            shared.order(Order.RUN)
        elif cycle == 300:
            shared.order(Order.LEAVE)

    made = commands(shared, script)
    assert 0.0 < made[200][0] < 150.0
    assert {command[0] for command in made[200:]} == {made[200][0]}


@pytest.mark.parametrize(
    ("number", "changes"),
    [
        (0x202, {}),
        (0x201, {"limits": PathLimits(100.0, 200.0, 300.0, 40.0, 50.0, 60.0), "start": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)}),
        (0x102, {"window": UserWindow(128, 16), "outputs": Outputs(1, 2, (128, b"\x01\xff")), "beyond": (0.5,)}),
        (0x002, {"receive": ReceiveFormat(0x14, microseconds=False), "send": Send(0x20), "idle": 2.5}),
    ],
)
def test_what_the_process_is_told_arrives(number: int, changes: dict[str, Any]) -> None:
    mode = mode_of(number)
    assert mode is not None
    told = dataclasses.replace(setup(), mode=mode, **changes)
    assert Setup.from_message(json.loads(json.dumps(told.to_message()))) == told
