"""Entry point of the streaming process, which the module ``launcher`` starts as ``python -c "...; main(3, ...)"``."""

from __future__ import annotations

import signal
import socket
from typing import Any

from orinkit.core.errors import CallError, ConnectionLost, OrinError, StreamError
from orinkit.rc8.slave_formats import OFF
from orinkit.streaming.planning.planners import planner_for
from orinkit.streaming.process import realtime
from orinkit.streaming.process.channel import Channel, encode_error
from orinkit.streaming.process.config import StreamerConfig
from orinkit.streaming.process.shared_memory import StreamMemory
from orinkit.streaming.process.streamer import ParentMonitor, Streamer, StreamerConnection
from orinkit.transport.registry import Reference, resolve
from orinkit.transport.runner import Link

_FOREVER = 1e6


def main(
    channel_descriptor: int, link_descriptor: int, memory_descriptor: int, adopt: Reference, profile: Reference
) -> None:
    """Stream set-points for the program at the other end of the channel.

    Args:
        channel_descriptor: Descriptor of the channel: the socket for messages to and from the program.
        link_descriptor: Descriptor of the link, which the program has opened to the controller.
        memory_descriptor: Descriptor of the memory shared with the program.
        adopt: Reference (``"module:attribute"``) to the function that returns a link for ``link_descriptor``.
        profile: Reference to the profile of the link's transport.
    """
    for name in ("SIGINT", "SIGHUP"):  # the program handles Ctrl-C and the end of the terminal
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    channel = Channel(socket.socket(fileno=channel_descriptor))
    shared = StreamMemory(memory_descriptor)
    link: Link = resolve(adopt)(link_descriptor)
    obtained = realtime.obtain()
    channel.send({"ready": True, "priority": obtained.priority, "locked": obtained.locked})
    message = channel.receive(_FOREVER)
    if message is None:
        return
    setup = StreamerConfig.from_message(message)
    connection = StreamerConnection(link, setup, resolve(profile))
    watch = ParentMonitor(channel, setup.parent_pid)
    signal.signal(signal.SIGTERM, lambda *_: setattr(watch, "terminated", True))
    outcome: dict[str, Any] = {"reason": "", "error": None}
    try:
        _stream(setup, connection, shared, watch, channel, outcome)
    except CallError as error:
        first = connection.read_first_error(error)
        connection.leave()
        outcome["error"] = encode_error(first)
    except ConnectionLost as error:
        outcome["error"] = encode_error(error)
    except OrinError as error:
        connection.leave()
        outcome["error"] = encode_error(error)
    except Exception as error:  # noqa: BLE001 - reported to the program
        outcome["error"] = encode_error(StreamError(f"{type(error).__name__}: {error}"))
    if outcome["reason"] in ("gone", "abandoned") or not channel.open:
        connection.send_close()
    outcome["ended"] = True
    outcome["serial"] = connection.conversation.serial
    channel.send(outcome)
    link.close_local()
    channel.receive(_FOREVER)  # returns when the program closes the channel; until then it may read the shared memory


def _stream(
    setup: StreamerConfig,
    connection: StreamerConnection,
    shared: StreamMemory,
    watch: ParentMonitor,
    channel: Channel,
    outcome: dict[str, Any],
) -> None:
    planner = planner_for(setup.limits, setup.period, setup.start, setup.mode.kind)
    reports_lateness = connection.lateness(0) is not None
    connection.execute("slvChangeMode", setup.mode.number)
    channel.send({"streaming": True})
    outcome["reason"] = Streamer(setup, connection, shared, watch, planner, reports_lateness=reports_lateness).run()
    connection.execute("slvChangeMode", OFF)
