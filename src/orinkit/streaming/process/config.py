"""Configuration of a streaming process, and its serialization."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

from orinkit.cao.dialect import DIALECTS, RC8
from orinkit.rc8.slave_formats import ReceiveFormat, SendBits, SlaveMode, UserIoUnit, UserWindow, mode_of
from orinkit.streaming.planning.limits import Limits, PathLimits
from orinkit.streaming.process.shared_memory import Outputs


@dataclass(slots=True)
class StreamerConfig:
    """The configuration of a streaming process.

    Attributes:
        controller: Handle of the Controller object.
        handle: Handle of the Robot object.
        mode: Slave mode: buffering and pose type.
        send: Format of the parameter of slvMove.
        receive: Format of the result of slvMove.
        window: User I/O to receive; ``None`` if none is received.
        outputs: Outputs sent with the first set-point.
        period: Period of a cycle, s.
        limits: Limits of the planner.
        start: Pose at which the arm stands, with as many values as a command of the planner.
        unlimited_joints: Values of the joints for which there are no limits; they are sent unchanged.
        serial: Serial number of the next packet.
        timeout: Time-out of a reply, s.
        idle: Time in s without a set-point in the queue after which slave mode is left; ``None`` for no limit.
        parent_pid: Process id of the program.
        dialect: Name of the controller's dialect.
        tries: Largest number of attempts for a request, on transports that may lose packets.
        user_io_unit: Unit in which the size of user I/O is sent.
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
    unlimited_joints: tuple[float, ...]
    serial: int
    timeout: float
    idle: float | None
    parent_pid: int
    dialect: str = RC8.name
    tries: int = 1
    user_io_unit: UserIoUnit = UserIoUnit.BITS

    @property
    def joints_only(self) -> bool:
        """True if the parameter of slvMove contains only the joints (VE026A 2.2)."""
        return not DIALECTS[self.dialect].slave_formats

    def to_message(self) -> dict[str, Any]:
        """Return the configuration as a message that JSON can represent; :meth:`from_message` is the inverse."""
        message: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(self)}
        message |= {
            "mode": self.mode.number,
            "send": int(self.send),
            "user_io_unit": self.user_io_unit.value,
            "receive": (self.receive.number, self.receive.microseconds),
            "window": self.window and (self.window.offset, self.window.size),
            "outputs": {name: _to_json(value) for name, value in self.outputs.present_items().items()},
            "limits": [getattr(self.limits, each.name) for each in fields(self.limits)],
        }
        return message

    @classmethod
    def from_message(cls, message: dict[str, Any]) -> Self:
        """Return the configuration that a message represents."""
        mode = mode_of(message["mode"])
        assert mode is not None
        window, limits = message["window"], message["limits"]
        parts: dict[str, Any] = {
            "mode": mode,
            "send": SendBits(message["send"]),
            "user_io_unit": UserIoUnit(message["user_io_unit"]),
            "receive": ReceiveFormat(*message["receive"]),
            "window": window and UserWindow(*window),
            "outputs": Outputs(**{name: _from_json(value) for name, value in message["outputs"].items()}),
            "limits": Limits(*map(tuple, limits)) if mode.kind == "J" else PathLimits(*limits),
            "start": tuple(message["start"]),
            "unlimited_joints": tuple(message["unlimited_joints"]),
        }
        return cls(**message | parts)


def _to_json(output: int | tuple[int, bytes]) -> int | tuple[int, str]:
    return output if isinstance(output, int) else (output[0], output[1].hex())


def _from_json(output: Any) -> Any:
    return output if isinstance(output, int) else (output[0], bytes.fromhex(output[1]))
