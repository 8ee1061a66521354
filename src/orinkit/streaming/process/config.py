"""What a streaming process is told when it begins, and the form in which that goes to it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

from orinkit.cao.dialect import DIALECTS, RC8
from orinkit.rc8.slave_formats import ReceiveFormat, SendBits, SlaveMode, UserWindow, mode_of
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.process.shared_memory import Outputs


@dataclass(slots=True)
class StreamerConfig:
    """What the streaming process has to know.

    Attributes:
        controller: handle of the controller object.
        handle: of the Robot object.
        mode: how and what it sends.
        send, receive, window: formats of slvMove.
        outputs: that go with the first set-point.
        period: seconds of a cycle.
        limits: of the planner.
        start: pose at which the arm stands, as many values as the planner has.
        beyond: values of the joints that there are no limits for; they stay as they are.
        serial: of the next packet.
        timeout: seconds that an answer may take.
        idle: seconds without a set-point in the queue after which slave mode is left, ``None`` for never.
        program: number of the program's process.
        dialect: name of the controller's.
        tries: how often a request is sent in all where packets may be lost.
    """

    controller: int
    handle: int
    mode: SlaveMode
    send: SendBits
    receive: ReceiveFormat
    window: UserWindow | None
    outputs: Outputs
    period: float
    limits: Limits | PathLimits
    start: tuple[float, ...]
    beyond: tuple[float, ...]
    serial: int
    timeout: float
    idle: float | None
    program: int
    dialect: str = RC8.name
    tries: int = 1

    @property
    def plain(self) -> bool:
        """Whether slvMove takes the joints and nothing else (VE026A 2.2)."""
        return not DIALECTS[self.dialect].slave_formats

    def to_message(self) -> dict[str, Any]:
        """Return it as JSON can have it; :meth:`from_message` is the other way."""
        message: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(self)}
        message |= {
            "mode": self.mode.number,
            "send": int(self.send),
            "receive": (self.receive.number, self.receive.microseconds),
            "window": self.window and (self.window.offset, self.window.size),
            "outputs": {name: _to_json(value) for name, value in self.outputs.given().items()},
            "limits": [getattr(self.limits, each.name) for each in fields(self.limits)],
        }
        return message

    @classmethod
    def from_message(cls, message: dict[str, Any]) -> Self:
        """Return what a message says."""
        mode = mode_of(message["mode"])
        assert mode is not None
        window, limits = message["window"], message["limits"]
        parts: dict[str, Any] = {
            "mode": mode,
            "send": SendBits(message["send"]),
            "receive": ReceiveFormat(*message["receive"]),
            "window": window and UserWindow(*window),
            "outputs": Outputs(**{name: _from_json(value) for name, value in message["outputs"].items()}),
            "limits": Limits(*map(tuple, limits)) if mode.kind == "J" else PathLimits(*limits),
            "start": tuple(message["start"]),
            "beyond": tuple(message["beyond"]),
        }
        return cls(**message | parts)


def _to_json(output: int | tuple[int, bytes]) -> int | tuple[int, str]:
    return output if isinstance(output, int) else (output[0], output[1].hex())


def _from_json(output: Any) -> Any:
    return output if isinstance(output, int) else (output[0], bytes.fromhex(output[1]))
