"""A simulated controller for programs in tests: stores variables and I/O, records motions, controls the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.virtual.rc8.pacscript.compiler import compile_program
from orinkit.virtual.rc8.pacscript.machine import Machine, MachineState

COUNT = 100
POINTS = 512
DEFAULTS = {
    "I": 0, "F": 0.0, "D": 0.0, "S": "", "V": (0.0,) * 3, "P": (*(0.0,) * 6, -1.0), "J": (0.0,) * 8,
    "T": (*(0.0,) * 9, -1.0),
}  # fmt: skip
BITS = {"IO": 1, "IOB": 8, "IOW": 16, "IOD": 32}


@dataclass
class FakeWorld:
    """A simulated controller; a motion takes ``polls`` polls of 8 ms."""

    polls: int = 3
    seconds: float = 0.0
    values: dict[tuple[str, int], Any] = field(default_factory=dict)
    points: int = 0
    log: list[tuple[Any, ...]] = field(default_factory=list)
    shown: list[tuple[str, str, str]] = field(default_factory=list)
    refuses: dict[str, int] = field(default_factory=dict)
    held: bool = False
    on_poll: Callable[[FakeWorld], None] | None = None

    def read(self, kind, index):
        self._check(index)
        return self.values.get((kind, index), DEFAULTS[kind])

    def write(self, kind, index, value):
        self._check(index)
        assert type(value) is type(DEFAULTS[kind])
        if kind == "S" and len(value.encode("cp932", "replace")) > 255:
            raise error_for(hresult.STRING_TOO_LONG)
        if isinstance(value, tuple):
            assert len(value) == len(DEFAULTS[kind])
        self.values[kind, index] = value

    def read_io(self, kind, point):
        self._check_point(point, BITS[kind])
        return self.points >> point & (1 << BITS[kind]) - 1

    def write_io(self, kind, point, value):
        self._check_point(point, BITS[kind])
        mask = (1 << BITS[kind]) - 1
        self.points = self.points & ~(mask << point) | (value & mask) << point

    def now(self):
        return self.seconds

    def show(self, kind, text, title=""):
        self.shown.append((kind, text, title))

    def take_arm(self, group, keep):
        self._did("take_arm", group, keep)

    def give_arm(self):
        return self._motion("give_arm")

    def motor(self, on):
        return self._motion("motor", on)

    def move(self, interpolation, targets, options):
        return self._motion("move", interpolation, *targets, options)

    def approach(self, interpolation, target, distance, mark, options):
        return self._motion("approach", interpolation, target, distance, mark, options)

    def depart(self, interpolation, distance, mark, options):
        return self._motion("depart", interpolation, distance, mark, options)

    def drive(self, pairs, absolute, mark, options):
        return self._motion("drive", pairs, absolute, mark, options)

    def rotate(self, plane, angle, pivot, options):
        return self._motion("rotate", plane, angle, pivot, options)

    def speed(self, percent):
        self._did("speed", percent)

    def accel(self, accel, decel):
        self._did("accel", accel, decel)

    def ext_speed(self, speed, accel, decel):
        self._did("ext_speed", speed, accel, decel)

    def change_tool(self, number):
        self._did("change_tool", number)

    def change_work(self, number):
        self._did("change_work", number)

    def hold(self):
        self._did("hold")
        self.held = True
        return lambda: not self.held

    def robot_command(self, name, arguments):
        return self._motion("robot_command", name, *arguments)

    def robot_value(self, name, arguments):
        self._did("robot_value", name, *arguments)
        return 0.0

    def current(self, kind, dest=False):
        self._did("current", kind, dest)
        return 5 if kind == "FIG" else tuple(float(n) for n in range(len(DEFAULTS[kind])))

    def convert(self, name, arguments):
        self._did("convert", name, *arguments)
        if name == "OutRange":
            return 0
        if name in ("Dev", "DevH"):
            first, second = arguments
            return (*(a + b for a, b in zip(first[:6], second[:6], strict=True)), first[6])
        return DEFAULTS[name[-1]]

    def _did(self, name, *arguments):
        if name in self.refuses:
            raise error_for(self.refuses[name], name)
        self.log.append((name, *arguments))

    def _motion(self, name, *arguments):
        self._did(name, *arguments)
        options = arguments[-1] if arguments else None
        left = 0 if getattr(options, "next", False) else self.polls

        def over():
            nonlocal left
            if f"{name} wait" in self.refuses:
                raise error_for(self.refuses[f"{name} wait"], name)
            if left == 0:
                return True
            left -= 1
            return False

        return over

    def _check(self, index):
        if not 0 <= index < COUNT:
            raise error_for(hresult.GLOBAL_VARIABLE_OUT_OF_RANGE, str(index))

    def _check_point(self, point, bits):
        if not 0 <= point <= POINTS - bits:
            raise error_for(hresult.VARIABLE_INDEX_INVALID, str(point))


def run(source: str, world: FakeWorld | None = None, *, budget: int = 1000, slices: int = 10_000) -> Machine:
    """Run a program to its end, with slices of 8 ms."""
    world = FakeWorld() if world is None else world
    machine = Machine(compile_program(source, "Pro1.pcs"), world)
    for _ in range(slices):
        machine.run(budget)
        if machine.state in (MachineState.DONE, MachineState.FAULT):
            break
        world.seconds += 0.008
        if world.on_poll is not None:
            world.on_poll(world)
    return machine


def body(*lines: str) -> str:
    """Return a program with these lines in Sub Main; the first of them is line 2 of the program."""
    return "\n".join(["Sub Main", *lines, "End Sub", ""])


def after(*lines: str, **how: Any) -> FakeWorld:
    """Run lines in Sub Main to their end and return the resulting state of the controller."""
    world = FakeWorld(**how)
    machine = run(body(*lines), world)
    assert machine.state is MachineState.DONE, machine.fault or machine.line
    return world
