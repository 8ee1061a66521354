"""The main loop of the streaming process: sends slvMove in each cycle of the controller."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from time import monotonic
from typing import Any, Final, Literal

from orinkit.bcap.client import BcapConversation
from orinkit.bcap.profiles import SILENCE, BcapProfile
from orinkit.cao import functions
from orinkit.cao.dialect import DIALECTS
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, InvalidValue, OrinError, error_for
from orinkit.core.i18n import N_, tr
from orinkit.rc8.slave_fields import RECEIVED, FieldType
from orinkit.rc8.slave_formats import OFF, SetPoint, SlaveReply, encode_set_point, read_reply
from orinkit.rc8.slave_lateness import COMMAND as LATENESS
from orinkit.rc8.slave_lateness import Lateness, read_lateness
from orinkit.streaming.planning.planners import Planner
from orinkit.streaming.process.channel import Channel
from orinkit.streaming.process.config import StreamerConfig
from orinkit.streaming.process.pacing import FLOWS, Call, Delivery
from orinkit.streaming.process.shared_memory import (
    RESTS,
    Outputs,
    RawSample,
    SetPointSource,
    StreamCommand,
    StreamMemory,
)
from orinkit.transport.direct import SyncDirectLink, run_prepared
from orinkit.transport.runner import Link, run, send_close
from orinkit.values.variant import ARRAY, Variant, VarType

_AHEAD: Final = 4  # the first set-point is sent after this many have been queued, or after this many cycles
_WATCH: Final = 0.02  # s between two checks of the program's process
_MOST_SECONDS: Final = 3.0  # s: longest time-out of the reply to a set-point
_CYCLES: Final = 1.5  # cycles after which a set-point without a reply is sent again, if packets may be lost
_TRIPS: Final = 3  # on a serial line, round-trip times of a command after which a set-point is sent again
_WRAP_US: Final = 1 << 31
_ROBOT_AXES: Final = 6
_STAMP: Final = next(row.name for row in RECEIVED if row.form is FieldType.STAMP)
_STOPPED: Final = frozenset(b"Tt")
_STALL: Final = 0.25  # s for which a program may be stopped (SIGSTOP), for example by a debugger
_STOPS: Final = {  # bits of the result of SysState (in DENSO's published implementations)
    10: N_("the emergency stop is on"),
    12: N_("the protective stop is on"),
    18: N_("the controller is in manual mode"),
}


Reason = Literal["", "left", "abandoned", "stopped", "gone", "idle", "terminated"]
"""Reason why streaming ended.

* ``""``: There was an error, or streaming has not ended.
* ``"left"``: The program requested the end.
* ``"abandoned"``: The program requested the end, and does not use the connection any more.
* ``"stopped"``: The program was stopped (SIGSTOP) for more than 0.25 s.
* ``"gone"``: The program has ended.
* ``"idle"``: The queue was empty for longer than the configured time.
* ``"terminated"``: The streaming process received SIGTERM.
"""


class ParentMonitor:
    """Detects that the program that started the streaming process has ended or was stopped."""

    def __init__(self, channel: Channel, process: int) -> None:
        self._channel = channel
        self._parent_pid = process
        self._next = 0.0
        self._stopped_at: float | None = None
        self.terminated = False
        try:
            self._stat = os.open(f"/proc/{process}/stat", os.O_RDONLY)
        except OSError:  # not Linux: it is not detected if the program is stopped
            self._stat = -1

    def end_reason(self) -> Reason:
        """Return the reason to end the stream; ``""`` to continue."""
        if self.terminated:
            return "terminated"
        now = monotonic()
        if now < self._next:
            return ""
        self._next = now + _WATCH
        self._channel.receive(0)
        orphan = os.getppid() != self._parent_pid  # a forked child of the program may keep the channel open
        if orphan or not self._channel.open:
            return "gone"
        return "stopped" if self._has_stopped(now) else ""

    def _has_stopped(self, now: float) -> bool:
        """Return True if the program has been stopped (SIGSTOP) for more than 0.25 s."""
        if not self._is_stopped():
            self._stopped_at = None
        elif self._stopped_at is None:
            self._stopped_at = now
        return self._stopped_at is not None and now - self._stopped_at > _STALL

    def _is_stopped(self) -> bool:
        if self._stat < 0:
            return False
        try:
            text = os.pread(self._stat, 512, 0)
        except OSError:  # the program has ended
            return False
        state = text.rpartition(b")")[2].split()[:1]
        return bool(state) and state[0][0] in _STOPPED


class StreamerConnection:
    """The connection to the controller, while the streaming process uses it.

    Args:
        link: Link to the controller.
        setup: Configuration of the streaming process.
        profile: Profile of the transport.
    """

    def __init__(self, link: Link, setup: StreamerConfig, profile: BcapProfile) -> None:
        self._link = link
        self._controller = setup.controller
        self._handle = setup.handle
        self._timeout = setup.timeout
        self._tries = setup.tries
        self._cycle = setup.period
        self._trip = 0.0  # s: round-trip time of the last command
        self._receive = setup.receive
        self.conversation = BcapConversation(profile=profile, dialect=DIALECTS[setup.dialect], clock=monotonic)
        self.conversation.serial = setup.serial
        self._direct_link = link if self.conversation.direct and isinstance(link, SyncDirectLink) else None
        self._template = self.conversation.template(functions.robot_execute, (setup.handle, "slvMove"))

    def execute(self, command: str, parameter: Any) -> tuple[int, Any]:
        """Execute a command of the robot; return its return code and its result."""
        began = monotonic()
        answer = self._call(functions.robot_execute, (self._handle, command, parameter), self._timeout, self._tries)
        self._trip = monotonic() - began
        return answer

    def move(self, parameter: Any) -> Delivery:
        """Send slvMove; return the reply, and the times of sending and of the reply."""
        arguments = (self._handle, "slvMove", parameter)
        seconds, tries = self._patience()
        # After noise on a serial line, the controller finds the next packet only after a pause in the received data.
        retry_timeout = SILENCE + self._cycle if self.conversation.profile.shared else 0.0
        sent = monotonic()
        code, value = self._call_directly(arguments, seconds) or self._call(
            functions.robot_execute, arguments, seconds, tries, retry_timeout
        )
        return Delivery(sent, monotonic(), code, read_reply(self._receive, value))

    def lateness(self, skip_first: int) -> Lateness | None:
        """Return the statistics of the late set-points, without the first ``skip_first`` of them.

        Only virtual controllers have the command slvGetLateness; for a real one, ``None`` is returned. Call this method
        once before slave mode is on. If it returns ``None``, do not call it again, so that a real controller does not
        receive an unknown command in slave mode.
        """
        try:
            return read_lateness(self.execute(LATENESS, skip_first)[1])
        except (CallError, CallTimeout):
            return None

    def _patience(self) -> tuple[float, int]:
        """Return the time-out of the reply to a set-point, s, and the maximum number of times that slvMove is sent.

        If packets may be lost, the time-out is short, because a lost set-point must be repeated soon.
        """
        profile = self.conversation.profile
        if not profile.lossy:
            return min(self._timeout, _MOST_SECONDS), 1
        seconds = _CYCLES * self._cycle
        if profile.shared:  # on a slow serial line, a set-point and its reply take longer
            seconds = max(seconds, min(_TRIPS * self._trip, self._timeout))
        return seconds, max(1, int(_MOST_SECONDS / seconds))

    def send_close(self) -> None:
        """Notify the controller that the connection ends, if the controller cannot detect the end on this transport."""
        send_close(self._link, self.conversation.close_sequence())

    def leave(self) -> None:
        """Turn slave mode off after an error; after most errors it is already off."""
        try:
            self.execute("slvChangeMode", OFF)
        except OrinError:
            pass

    def _call(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        tries: int,
        retry_timeout: float = 0.0,
    ) -> tuple[int, Any]:
        try:
            return run(
                self.conversation.call(function, arguments, seconds, tries=tries, retry_timeout=retry_timeout),
                self._link,
            )
        except CallError as error:
            raise _named(error, arguments) from None

    def _call_directly(self, arguments: tuple[Any, ...], seconds: float) -> tuple[int, Any] | None:
        """Send slvMove as a prepared call; return ``None`` if this is not possible."""
        link, template, conversation = self._direct_link, self._template, self.conversation
        if link is None or template is None or not conversation.direct:
            return None
        try:
            return run_prepared(conversation, link, functions.robot_execute, template, arguments[2], arguments, seconds)
        except CallError as error:
            raise _named(error, arguments) from None

    def read_first_error(self, error: CallError) -> CallError:
        """Return the controller's first error, which turned slave mode off (RC8 4.7).

        The following errors, such as the return code of slvMove, only report that slave mode is off.

        Args:
            error: The error that slvMove returned. It is returned if the controller reports no other error.
        """
        try:
            count = self._ask("GetCurErrorCount", None)
            info = self._ask("GetCurErrorInfo", int(count) - 1) if count else None
            state = 0 if count else int(self._ask("SysState", None))
        except (OrinError, TypeError, ValueError):
            return error
        if isinstance(info, list) and len(info) > 1 and isinstance(info[0], int):
            code = hresult.unsigned(info[0])
            return error_for(code, str(info[1]) if info[1] != hresult.lookup(code).text else "", error.function)
        reasons = [tr(text) for bit, text in _STOPS.items() if state >> bit & 1]
        if not reasons:
            return error
        return error_for(error.code, "; ".join(filter(None, (*reasons, error.detail))), error.function)

    def _ask(self, command: str, parameter: Any) -> Any:
        arguments = (self._controller, command, parameter)
        return self._call(functions.controller_execute, arguments, self._timeout, self._tries)[1]


def _named(error: CallError, arguments: tuple[Any, ...]) -> CallError:
    """Return the error of a call with the name of its command, which is more specific than the function."""
    return error_for(error.code, error.detail, str(arguments[1]))


@dataclass(slots=True)
class _ControllerClock:
    """The controller's time, computed from time stamps that wrap around (RC8 table 4-1: VT_I4)."""

    microseconds: bool
    _last: int | None = None
    _ticks: int = field(default=0)

    def read(self, stamp: int) -> float:
        """Return the controller's time for a time stamp, s; it continues to increase if the time stamps wrap around."""
        last = stamp if self._last is None else self._last
        self._ticks = stamp if self._last is None else self._ticks + (stamp - last) % _WRAP_US
        self._last = stamp
        return self._ticks / (1e6 if self.microseconds else 1e3)


class Streamer:
    """Streams set-points until the program requests the end, or there is another reason to end.

    Args:
        setup: Configuration of the process.
        connection: Connection to the controller.
        shared: Memory shared with the program.
        watch: Monitor of the program.
        planner: Planner of the commands.
        reports_lateness: True if the controller reports late set-points.
    """

    def __init__(
        self,
        setup: StreamerConfig,
        connection: StreamerConnection,
        shared: StreamMemory,
        watch: ParentMonitor,
        planner: Planner,
        *,
        reports_lateness: bool = False,
    ) -> None:
        self._setup = setup
        self._shared = shared
        self._watch = watch
        self._planner = planner
        self._connection = connection
        call: Call = connection.move
        buffering = setup.mode.buffering
        # A VE026A delays its reply until its buffer has room, as a real RC8 does in mode 2 (VE026A 2.2.1).
        if setup.joints_only and buffering == 0:
            buffering = 2
        self._flow = FLOWS[buffering](call, setup.period)
        self._clock = _ControllerClock(setup.receive.microseconds)
        self._outputs = setup.outputs
        self._beside: dict[str, Any] = {}  # the parts of a set-point except the pose
        self._note_outputs()
        self._outputs_seen = 0
        self._target: tuple[float, ...] | None = None  # the last live target that could be read
        self._target_seen = 0
        self._delay_from = 0  # ns; time at which the live target was set; 0 after a set-point towards it was sent
        self._sent = 0
        self._dry = 0
        self._was_dry = True
        self._patience = _AHEAD
        self._waits_since = monotonic()
        self._rests = 0
        self._late = 0 if reports_lateness else None  # number of late set-points that the controller has reported
        self._moved = False  # True if the arm has moved since the last query for late set-points
        self._previous: tuple[float, ...] = ()
        self._aim: tuple[float, ...] | None = None

    def run(self) -> Reason:
        """Stream set-points; return the reason for which streaming ended. Slave mode must be on, and remains on."""
        reason: Reason = ""
        while True:
            reason = reason or self._reason()
            self._deliver(self._command(reason))
            if self._rests >= RESTS:
                if reason:
                    return reason
                if self._shared.wanted is StreamCommand.HALT:
                    self._shared.mark_done()

    def _reason(self) -> Reason:
        order = self._shared.wanted
        if order is StreamCommand.GOODBYE:
            return "abandoned"
        if order is StreamCommand.LEAVE or (order is StreamCommand.FINISH and self._finished()):
            return "left"
        if not self._waits():
            self._waits_since = monotonic()
        elif self._setup.idle is not None and monotonic() - self._waits_since > self._setup.idle:
            return "idle"
        return self._watch.end_reason()

    def _finished(self) -> bool:
        """Return True if the stream may end: all queued set-points were sent, or the queue is not in use."""
        shared = self._shared
        return shared.source is not SetPointSource.QUEUE or (not shared.queued and self._was_dry and self._aim is None)

    def _waits(self) -> bool:
        """Return True if the stream waits for set-points: some were sent, the arm stands, and the queue is empty."""
        shared = self._shared
        return shared.source is SetPointSource.QUEUE and not shared.queued and self._sent > 0 and self._rests > 0

    def _command(self, reason: Reason) -> tuple[float, ...]:
        if reason or self._shared.wanted is StreamCommand.HALT:
            self._aim, self._was_dry, self._target = None, True, None
            return self._planner.stop()
        source = self._shared.source
        if source is SetPointSource.TARGET:
            return self._to_target()
        self._target = None
        return self._from_queue() if source is SetPointSource.QUEUE else self._come_to_rest()

    def _to_target(self) -> tuple[float, ...]:
        newer = self._shared.newer_target(self._target_seen)
        if newer is not None:
            self._target_seen, self._delay_from, self._target = newer
        # If the program is writing a target at this moment, continue to the previous one and do not brake: the
        # operating system may suspend the program before it has written the target completely.
        return self._come_to_rest() if self._target is None else self._planner.goto(self._target)

    def _from_queue(self) -> tuple[float, ...]:
        taken = self._shared.take() if self._ready() else None
        if taken is None:
            if self._aim is not None:
                return self._towards(self._aim, self._planner.goto(self._aim))
            return self._come_to_rest()
        self._was_dry = False
        values, outputs = taken
        self._change(outputs)
        self._sent += 1
        return self._towards(values, self._planner.track(values))

    def _ready(self) -> bool:
        """Return True if the next set-point may be taken from the queue.

        After a pause, a few set-points must be in the queue, or a few cycles must have passed since the first one was
        queued. Because of this reserve, a set-point that the program then queues slightly late has no effect.
        """
        waiting = self._shared.queued
        if not self._was_dry or waiting >= _AHEAD or self._shared.wanted is StreamCommand.FINISH:
            return True
        self._patience = self._patience - 1 if waiting else _AHEAD
        return self._patience <= 0

    def _come_to_rest(self) -> tuple[float, ...]:
        """Return the next command if there is no set-point.

        It is the last command again if the limits permit that, otherwise a command of a stop.
        """
        if self._was_dry:
            return self._planner.stop()
        self._was_dry = True
        last = self._planner.command
        try:
            self._planner.check(last)
        except InvalidValue:
            self._dry += 1
            return self._planner.stop()
        return self._planner.track(last)

    def _towards(self, point: tuple[float, ...], command: tuple[float, ...]) -> tuple[float, ...]:
        """Return ``command``; if it has not reached ``point``, store ``point`` as the goal of the next commands."""
        self._aim = None if command == point else point
        return command

    def _deliver(self, command: tuple[float, ...]) -> None:
        newer = self._shared.newer_outputs(self._outputs_seen)
        if newer is not None:
            self._outputs_seen, outputs = newer
            self._change(outputs)
        delivery = self._flow.deliver(self._parameter(command))
        self._rests = self._rests + 1 if command == self._previous else 0
        self._moved = self._moved or not self._rests
        self._previous = command
        if self._rests >= RESTS and self._moved:
            self._moved = False
            self._ask_lateness()
        self._shared.add(self._sample(command, delivery))
        self._shared.report_counts(sent=self._sent, dry=self._dry, rests=self._rests if self._planner.at_rest else 0)

    def _change(self, outputs: Outputs) -> None:
        updated = self._outputs.updated(outputs)
        if updated is not self._outputs:
            self._outputs = updated
            self._note_outputs()

    def _note_outputs(self) -> None:
        self._beside = self._outputs.present_items()
        self._shared.report_outputs(self._outputs)
        if self._setup.window is not None:
            self._beside["window"] = self._setup.window

    def _ask_lateness(self) -> None:
        late = None if self._late is None else self._connection.lateness(self._late)
        if self._late is not None and late is not None and late.count:
            self._late += late.count
            self._shared.add_lateness(late)

    def _parameter(self, command: tuple[float, ...]) -> Any:
        setup = self._setup
        if setup.joints_only:
            return Variant(VarType.R4 | ARRAY, [*command, *setup.unlimited_joints])
        extra: tuple[tuple[int, float], ...] = ()
        if setup.mode.kind == "J":
            extra = tuple((axis + 1, command[axis]) for axis in range(_ROBOT_AXES, len(command)))
            command = (*command, *setup.unlimited_joints)
        point = SetPoint(command, extra, **self._beside)
        return encode_set_point(setup.mode.kind, point, setup.send, setup.receive, setup.user_io_unit)

    def _sample(self, command: tuple[float, ...], delivery: Delivery) -> RawSample:
        answer: SlaveReply = delivery.reply
        sent = round(delivery.sent * 1e9)
        delay = -1
        if self._delay_from:
            delay, self._delay_from = sent - self._delay_from, 0
        values = answer.values()
        if _STAMP in values:
            values[_STAMP] = self._clock.read(values[_STAMP])
        return RawSample(sent, round(delivery.replied_at * 1e9), delivery.code, command, delay, values)
