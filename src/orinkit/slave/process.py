"""The streaming process itself: ``python -c "...; orinkit.slave.process.main(3, 4, 5)"``, started by ``launch``."""

from __future__ import annotations

import signal
import socket
from typing import Any

from orinkit.cao.slave_formats import OFF, ReceiveFormat, Send, UserWindow, mode_of
from orinkit.errors import CallError, ConnectionLost, OrinError, StreamError
from orinkit.slave import realtime
from orinkit.slave.channel import Channel, describe
from orinkit.slave.limits import Limits, PathLimits
from orinkit.slave.planners import planner_for
from orinkit.slave.shared import Outputs, Shared
from orinkit.slave.streamer import Setup, Streamer, Watch, Wire
from orinkit.transport.tcp import AdoptedTcpLink

_FOREVER = 1e6


def main(channel_descriptor: int, link_descriptor: int, memory_descriptor: int) -> None:
    """Stream for the program at the other end of the channel."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program, which says what is to be done
    channel = Channel(socket.socket(fileno=channel_descriptor))
    shared = Shared(memory_descriptor)
    link = AdoptedTcpLink(link_descriptor)
    obtained = realtime.obtain(wanted=True)
    channel.send({"ready": True, "priority": obtained.priority, "locked": obtained.locked})
    message = channel.receive(_FOREVER)
    if message is None:
        return
    setup = _setup(message)
    wire = Wire(link, setup)
    watch = Watch(channel, setup.program)
    signal.signal(signal.SIGTERM, lambda *_: setattr(watch, "terminated", True))
    outcome: dict[str, Any] = {"reason": "", "error": None}
    try:
        _stream(setup, wire, shared, watch, channel, outcome)
    except CallError as error:
        first = wire.first_error(error)
        wire.leave()
        outcome["error"] = describe(first)
    except ConnectionLost as error:
        outcome["error"] = describe(error)
    except OrinError as error:
        wire.leave()
        outcome["error"] = describe(error)
    except Exception as error:  # noqa: BLE001 - the program is told
        outcome["error"] = describe(StreamError(f"{type(error).__name__}: {error}"))
    outcome["ended"] = True
    outcome["serial"] = wire.conversation.serial
    channel.send(outcome)
    link.release()
    channel.receive(_FOREVER)  # until the program lets go: what it asks of this process's memory is then done


def _stream(setup: Setup, wire: Wire, shared: Shared, watch: Watch, channel: Channel, outcome: dict[str, Any]) -> None:
    planner = planner_for(setup.limits, setup.period, setup.start, setup.mode.kind)
    wire.execute("slvChangeMode", setup.mode.number)
    channel.send({"streaming": True})
    outcome["reason"] = Streamer(setup, wire, shared, watch, planner).run()
    wire.execute("slvChangeMode", OFF)


def _setup(message: dict[str, Any]) -> Setup:
    mode = mode_of(message["mode"])
    assert mode is not None
    window, limits = message["window"], message["limits"]
    mini, hand, user = message["outputs"]
    return Setup(
        controller=message["controller"],
        handle=message["handle"],
        mode=mode,
        send=Send(message["send"]),
        receive=ReceiveFormat(message["receive"], microseconds=True),
        window=UserWindow(*window) if window else None,
        outputs=Outputs(mini, hand, (user[0], bytes.fromhex(user[1])) if user else None),
        period=message["period"],
        limits=Limits(*map(tuple, limits)) if mode.kind == "J" else PathLimits(*limits),
        start=tuple(message["start"]),
        beyond=tuple(message["beyond"]),
        serial=message["serial"],
        timeout=message["timeout"],
        idle=message["idle"],
        program=message["program"],
    )
