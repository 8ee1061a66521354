"""What all clients of one virtual RC8 share: variables, errors, logs, switches, time.

Objects that clients hold (controller, variables; robots, tasks and files beside them) refer to one :class:`State` and
keep nothing of the controller themselves. Clients are served on one thread; the switches (raising an error, the mode,
the emergency stop) may be thrown from another, as each of their steps is one that Python does not interrupt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from enum import IntEnum
from typing import Final

from orinkit import hresult
from orinkit.language import pick
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8.calendar import Calendar
from orinkit.virtual.rc8.events import EventKind, Events
from orinkit.virtual.rc8.faults import Faults
from orinkit.virtual.rc8.logs import ErrorRecord, OperationLog, OperationRecord
from orinkit.virtual.rc8.memory import Variables
from orinkit.virtual.rc8.pendant import Mode, Pendant
from orinkit.virtual.rc8.permission import Permission
from orinkit.virtual.rc8.speech import Say
from orinkit.virtual.rc8.store import Store

_BATTERY_LIFE: Final = timedelta(days=2 * 365)
_MODE_NAMES: Final[Mapping[Mode, tuple[str, str]]] = {
    Mode.MANUAL: ("manual", "手動"),
    Mode.TEACH_CHECK: ("teach check", "ティーチチェック"),
    Mode.AUTOMATIC: ("automatic", "自動"),
}


class Operation(IntEnum):
    """Kinds of operations in the operation log."""

    CONNECT = 1
    DISCONNECT = 2
    CLEAR_ERROR = 3
    MODE = 4
    EMERGENCY_STOP = 5
    MACHINE_LOCK = 6
    SET_TIME = 7


@dataclass(frozen=True, slots=True)
class Identity:
    """What the controller says it is.

    Attributes:
        serial_no: serial number, ``@SERIAL_NO`` and SysInfo 0.
        version: software version, ``@VERSION``.
        maker: ``@MAKER_NAME``.
        type: ``@TYPE``, and the source of its messages.
    """

    serial_no: str
    version: str
    maker: str = "orinkit"
    type: str = "RC8"


@dataclass(frozen=True, slots=True)
class Origin:
    """Who does something: a client by the name of its controller object and its address, or nobody in particular."""

    caller: str = ""
    address: str = ""


_NOBODY: Final = Origin()


class State:
    """The controller.

    Args:
        clock: its clock.
        identity: what it says it is.
        permission: who may read and write.
        say: picks its texts' language.
        counts: how many of each class of variables it has.
        io_points: how many I/O points it has.
        store: where its variables are kept, ``None`` for nowhere.

    Attributes:
        programs_running: how many program tasks run.
        supervisors_running: how many supervisory (TSR) tasks run.
        battery_due: when the encoder batteries have to be replaced.
    """

    def __init__(
        self,
        *,
        clock: Clock,
        identity: Identity,
        permission: Permission,
        say: Say,
        counts: Mapping[str, int] | None,
        io_points: int,
        store: Store | None,
    ) -> None:
        self.clock = clock
        self.identity = identity
        self.permission = permission
        self.say = say
        self.calendar = Calendar(clock)
        self.variables = Variables(counts, io_points, store, self.calendar.now)
        self.pendant = Pendant()
        self.faults = Faults(say)
        self.operations = OperationLog()
        self.events = Events()
        self.programs_running = 0
        self.supervisors_running = 0
        self.battery_due = self.calendar.now() + _BATTERY_LIFE
        self._began = clock.now()

    @property
    def seconds(self) -> float:
        """Seconds since the controller was switched on."""
        return self.clock.now() - self._began

    @property
    def battery_passed(self) -> bool:
        """Whether the encoder batteries should have been replaced by now."""
        return self.calendar.now() > self.battery_due

    def raise_error(
        self,
        code: int,
        message: str | None = None,
        *,
        subcode: int = 0,
        program: str = "",
        line: int = 0,
        file_id: int = 0,
        original: int = 0,
        origin: Origin = _NOBODY,
    ) -> None:
        """Put an error on the current list and into the log, and tell the clients; a notice is only logged.

        Args:
            code: signed or unsigned; level 0 and successes are notices.
            message: text, ``None`` for that of the code.
            subcode: more about the error.
            program: name of the program that it happened in.
            line: line of that program, counted from 1.
            file_id: number of that program's file.
            original: the code that led to this one.
            origin: the client that caused it.

        Raises:
            ValueError: a code that has more than 32 bits.
        """
        code = hresult.unsigned(code)
        text = self.faults.text(code) if message is None else message
        moment = self.calendar.now()
        original = hresult.unsigned(original)
        record = ErrorRecord(
            code, text, moment, subcode, program, line, file_id, original, origin.caller, origin.address
        )
        if self.faults.add(record):
            self.events.publish(EventKind.ERROR, hresult.signed(code), text, moment)

    def clear_errors(self, origin: Origin = _NOBODY) -> None:
        """Forget the current errors; the log keeps them."""
        self.faults.clear()
        self.log(Operation.CLEAR_ERROR, self.say("Errors cleared", "エラーをクリア"), origin)

    def set_mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic.

        Raises:
            ValueError: another number.
        """
        wanted = _read_mode(mode)
        if wanted is self.pendant.mode:
            return
        self.pendant.mode = wanted
        en, ja = _MODE_NAMES[wanted]
        text = self.say(f"Mode: {en}", f"モード: {ja}")
        self.log(Operation.MODE, text)
        self.events.publish(EventKind.MODE, wanted, text, self.calendar.now())

    def emergency_stop(self, on: bool) -> None:
        """Press or release the emergency stop."""
        on = bool(on)
        if on is self.pendant.emergency_stop:
            return
        self.pendant.emergency_stop = on
        text = (
            self.say("Emergency stop pressed", "非常停止 ON")
            if on
            else self.say("Emergency stop released", "非常停止 OFF")
        )
        self.log(Operation.EMERGENCY_STOP, text)
        self.events.publish(EventKind.EMERGENCY_STOP, int(on), text, self.calendar.now())

    def log(self, operation: Operation, text: str, origin: Origin = _NOBODY) -> None:
        """Write a line into the operation log."""
        self.operations.add(OperationRecord(operation, text, self.calendar.now(), origin.caller, origin.address))

    def close(self) -> None:
        """Write down what has to be kept."""
        self.variables.close()


def _read_mode(mode: int) -> Mode:
    try:
        return Mode(mode)
    except ValueError:
        raise ValueError(
            pick(
                f"the mode is 1 manual, 2 teach check or 3 automatic, not {mode!r}",
                f"モードは 1 手動、2 ティーチチェック、3 自動のいずれかです: {mode!r}",
            )
        ) from None
