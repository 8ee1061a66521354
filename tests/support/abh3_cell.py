"""A virtual ABH3 with a manual clock, and a host that exchanges frames with it."""

from __future__ import annotations

from typing import Any

from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.ids import EVERYONE, broadcast, pgn, request, single
from orinkit.abh3.table.records import BR0, BR1, BR1V2, BR2, BR3, BR4, BR5, BR6, DP0R, DP0RV2
from orinkit.abh3.table.signals import dialect_of
from orinkit.can.frame import CanFrame
from orinkit.virtual.abh3 import Parameters, VirtualABH3
from orinkit.virtual.clock import ManualClock

MS = 0.001
GO = ("servo_on", "start")


class Abh3Cell:
    """A virtual ABH3 and the operations of a host."""

    def __init__(self, **parameters: Any) -> None:
        self.clock = ManualClock()
        self.device = VirtualABH3(Parameters(**parameters), clock=self.clock)
        given = self.device.parameters
        self.dialect = dialect_of(given.dialect).with_load_unit(given.load_unit)
        self.codec = Codec(self.dialect)
        self.host = 2 if given.host is None else given.host

    def mask(self, *names: str) -> int:
        word = 0
        for name in names:
            word |= self.dialect.inputs.mask(name)
        return word

    def frame(self, ay: int = 0, bx: int = 0, inputs: int = 0, host: int | None = None) -> CanFrame:
        """Return a command frame; the arguments are raw codes."""
        data = ay.to_bytes(2, "little", signed=True) + bx.to_bytes(2, "little", signed=True)
        source = self.host if host is None else host
        return CanFrame(single(self.device.address, source), data + inputs.to_bytes(4, "little"))

    def put(self, ay: int = 0, bx: int = 0, *names: str, sel: int = 0) -> DP0R | DP0RV2:
        """Send a command with raw codes and the names of inputs; v1 encodes set 0 as bits 111."""
        number = self.mask(*names) | self._select(sel)
        (answer,) = self.device.receive(self.frame(ay, bx, number))
        assert answer.id & 0x03FFFFFF == single(self.host, self.device.address)
        record = self.codec.decode("DP0R", answer.data)
        assert isinstance(record, DP0R | DP0RV2)
        return record

    def hold(self, seconds: float, ay: int = 0, bx: int = 0, *names: str, sel: int = 0) -> DP0R | DP0RV2:
        """Repeat a command every 0.1 s for the given time."""
        record = self.put(ay, bx, *names, sel=sel)
        for _ in range(round(seconds * 10)):
            self.clock.advance(0.1)
            record = self.put(ay, bx, *names, sel=sel)
        return record

    def ask(self, number: int, *, everyone: bool = False) -> Any:
        """Request a broadcast and return its record."""
        parameters = self.device.parameters
        data = pgn(0xFF, parameters.group * 8 + number)
        destination = EVERYONE if everyone else self.device.address
        (answer,) = self.device.receive(CanFrame(request(destination, self.host), data))
        assert answer.id & 0x03FFFFFF == broadcast(parameters.group, number, self.device.address)
        return self.codec.decode(f"BR{number}", answer.data)

    def br0(self) -> BR0:
        record = self.ask(0)
        assert isinstance(record, BR0)
        return record

    def br1(self) -> BR1:
        record = self.ask(1)
        assert isinstance(record, BR1)
        return record

    def br1_v2(self) -> BR1V2:
        record = self.ask(1)
        assert isinstance(record, BR1V2)
        return record

    def br2(self) -> BR2:
        record = self.ask(2)
        assert isinstance(record, BR2)
        return record

    def br3(self) -> BR3:
        record = self.ask(3)
        assert isinstance(record, BR3)
        return record

    def br4(self) -> BR4:
        record = self.ask(4)
        assert isinstance(record, BR4)
        return record

    def br5(self) -> BR5:
        record = self.ask(5)
        assert isinstance(record, BR5)
        return record

    def br6(self) -> BR6:
        record = self.ask(6)
        assert isinstance(record, BR6)
        return record

    def wait(self, seconds: float) -> None:
        self.clock.advance(seconds)

    def reset(self) -> None:
        """Reset errors as a host does: set the bit, wait 2 ms, clear the bit."""
        self.put(0, 0, "error_reset")
        self.wait(2 * MS)
        self.put()

    def _select(self, sel: int) -> int:
        bits = 7 - sel if self.dialect.name == "v1" else sel
        names = [f"{axis}_select_{n}" for n in range(3) if bits >> n & 1 for axis in ("ay", "bx")]
        return self.mask(*names)
