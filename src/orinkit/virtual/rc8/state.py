"""The state shared by all clients of one virtual RC8: variables, arm, programs, files, errors, logs, switches, time.

The objects of clients (controller, variables, robots, tasks, files) refer to one :class:`RC8State` and contain no state
of the controller themselves. The lock ``cycles`` protects the state: the server holds the lock during every call of a
client, and the control loop during every cycle. The methods of this module that change the state acquire the lock
themselves, so they are thread-safe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final

from orinkit.arms import ArmModel
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.hresult import CodeFamily
from orinkit.core.i18n import N_, Language, tr
from orinkit.core.record import record
from orinkit.virtual.clock import Clock
from orinkit.virtual.engine.calendar import Calendar
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.engine.lane import Lane
from orinkit.virtual.engine.timers import Timers
from orinkit.virtual.rc8.error_list import ErrorList, level_of
from orinkit.virtual.rc8.events import EventKind, Events
from orinkit.virtual.rc8.files import FileStore
from orinkit.virtual.rc8.hand.cobotta import CobottaHand
from orinkit.virtual.rc8.hand.hands import Hands
from orinkit.virtual.rc8.logs import ClientId, ErrorRecord, OperationLog, OperationRecord
from orinkit.virtual.rc8.permission import Permission
from orinkit.virtual.rc8.profiles import Profile
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.moves import Moves
from orinkit.virtual.rc8.robot.unit import RobotUnit
from orinkit.virtual.rc8.robots import Robots
from orinkit.virtual.rc8.starts import START_LIMITS
from orinkit.virtual.rc8.switches import ModeSwitch, Switches, Token
from orinkit.virtual.rc8.task import Task
from orinkit.virtual.rc8.tasks import SUFFIX, Tasks
from orinkit.virtual.rc8.translations import translator
from orinkit.virtual.rc8.usage import Usage
from orinkit.virtual.rc8.variables.database import VariableDatabase
from orinkit.virtual.rc8.variables.table import VariableTable

if TYPE_CHECKING:
    from orinkit.virtual.rc8.pacscript.compiler import Program

_STOPPING_LEVEL: Final = 2
_CUTTING_MOTION_LEVEL: Final = 3
_CUTTING_LEVEL: Final = 4
LOGIN_LEVEL: Final = 2000
_BATTERY_LIFE: Final = timedelta(days=2 * 365)
_MODE_NAMES: Final[Mapping[ModeSwitch, str]] = {
    ModeSwitch.MANUAL: N_("manual"),
    ModeSwitch.TEACH_CHECK: N_("teach check"),
    ModeSwitch.AUTOMATIC: N_("automatic"),
}


class Operation(IntEnum):
    """Types of operations in the operation log."""

    CONNECT = 1
    DISCONNECT = 2
    CLEAR_ERROR = 3
    MODE = 4
    EMERGENCY_STOP = 5
    MACHINE_LOCK = 6
    SET_TIME = 7
    PROTECTIVE_STOP = 8
    AUTO_ENABLE = 9
    TOKEN = 10
    RESTART = 11
    PROGRAM_OUTPUT = 12


@record
class Identity:
    """The identity that the controller reports.

    Attributes:
        serial_no: Serial number (``@SERIAL_NO``, SysInfo 0).
        version: Software version (``@VERSION``).
        maker: Maker (``@MAKER_NAME``); by default the one that clients of real controllers expect.
        type: Type of the controller (``@TYPE``); messages of the controller also name it as their source.
    """

    serial_no: str
    version: str
    maker: str = "DENSO CORPORATION"
    type: str = "RC8 Controller"


@record
class Origin:
    """The client that has caused an operation; both attributes are empty if no client has caused it.

    Attributes:
        caller: Name of the client's controller object.
        address: Address of the client.
    """

    caller: str = ""
    address: str = ""

    @property
    def client_id(self) -> int:
        """The number of a client in the logs; 0 if no client has caused the operation."""
        return ClientId.PC if self.caller or self.address else ClientId.SYSTEM


_NOBODY: Final = Origin()
_SOURCES: Final = {Operation.RESTART: ClientId.SYSTEM, Operation.PROGRAM_OUTPUT: ClientId.PAC}


class RC8State:
    """The state of the controller.

    Args:
        clock: The clock of the controller.
        identity: The identity that the controller reports.
        profile: The controller that it represents.
        permission: Access rights by client address.
        language: Language of the controller's texts; None for the current language of the process.
        counts: Number of variables of each class.
        io_points: Number of I/O points.
        store: Database of the variables, or ``None`` to keep them in memory only.
        models: The model of each arm.
        files: Directory of the controller's files.
        switches: Initial state of the switches, and settings such as ``strict``.
        hands: Numbers of the boards for electric grippers that are fitted.

    Attributes:
        cycles: The 8 ms control loop, which is also the lock of the whole state.
        robots: The robots.
        arm, moves: The arm of the first robot, on which programs act, and the planner of its motions.
        planning: The thread in which motions are planned.
        disk: The thread in which the files are accessed.
        compiling: The thread in which programs are compiled.
        hands, timers: The hands, and the timers of the controller.
        tasks: The programs.
        connections: Functions that close the connections of the clients, by client.
        executing_commands: Number of Command objects that are executing.
        login_level: Level of the pendant's user: 1000 operator, 2000 programmer, 3000 maintainer.
        usage: Hours of operation, and how often the motor was switched on.
        battery_due: Local date and time at which the encoder batteries have to be replaced.
    """

    def __init__(
        self,
        *,
        clock: Clock,
        identity: Identity,
        profile: Profile,
        permission: Permission,
        language: Language | None,
        counts: Mapping[str, int] | None,
        io_points: int,
        store: VariableDatabase | None,
        models: Sequence[ArmModel],
        files: Path,
        switches: Switches,
        hands: Iterable[int] = (0,),
    ) -> None:
        self.clock = clock
        self.identity = identity
        self.profile = profile
        self.connections: dict[object, Callable[[str], None]] = {}
        self.permission = permission
        self.say = translator(language)
        self.calendar = Calendar(clock)
        self.variables = VariableTable(counts, io_points, store, self.calendar.now)
        self.switches = switches
        self.faults = ErrorList(language)
        self.operations = OperationLog()
        self.events = Events()
        self.executing_commands = 0
        self.battery_due = self.calendar.now() + _BATTERY_LIFE
        self.cycles = ControlLoop(clock)
        self.disk = Lane("orinkit-disk", clock)
        self.files = FileStore(files, self.calendar.now)
        self.planning = Lane("orinkit-planning", clock)
        self.robots = Robots([self._robot(number, model) for number, model in enumerate(models)])
        self.arm, self.moves = self.robots[0].arm, self.robots[0].moves
        self.hands = Hands(self.cycles, self.switches, hands)
        self.timers = Timers(self.cycles)
        self.login_level = LOGIN_LEVEL
        self.compiling = Lane("orinkit-compiling", clock, START_LIMITS)
        self.tasks = Tasks(
            self.cycles, self.arm, self.moves, self.variables, self.files,
            lambda: self.last_cycle_time, self._program_fault, self._show,
        )  # fmt: skip
        moving, motor_on = self.robots.activity()
        self.usage = Usage(lambda: self.seconds, lambda: moving() or self.tasks.running > 0, motor_on)
        arms = [robot.arm for robot in self.robots]
        self.cycles.add(self.tasks, *arms, self.hands, self.timers, self.usage, on_error=self._crashed)

    @property
    def seconds(self) -> float:
        """Seconds since the controller was switched on."""
        return self.cycles.now

    @property
    def last_cycle_time(self) -> float:
        """Time of the last cycle, in s since the controller was switched on; it is the time stamp of poses."""
        return self.cycles.last_cycle_time

    @property
    def hand(self) -> CobottaHand:
        """The parallel hand of a COBOTTA."""
        return self.hands.cobotta

    @property
    def running_programs(self) -> int:
        """Number of running program tasks, without supervisory ones."""
        return self.tasks.running

    @property
    def battery_overdue(self) -> bool:
        """True if the replacement of the encoder batteries is overdue."""
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
        """Add an error to the current errors and to the log, and notify the clients; a notice is only logged.

        Args:
            code: Return code, signed or unsigned; success codes and codes of level 0 are notices.
            message: Text; ``None`` for the text of the code.
            subcode: Additional code.
            program: Name of the program in which the error occurred.
            line: Line of that program, counted from 1.
            file_id: Number of that program's file.
            original: Code that caused this error.
            origin: Client that caused this error.

        Raises:
            ValueError: If the code has more than 32 bits.
        """
        code = hresult.unsigned(code)
        text = self.faults.default_message(code) if message is None else message
        moment = self.calendar.now()
        original = hresult.unsigned(original)
        record = ErrorRecord(
            code, text, moment, subcode, program, line, file_id, original, self.milliseconds(),
            origin.client_id or (ClientId.PAC if program else ClientId.SYSTEM),
        )  # fmt: skip
        with self.cycles:
            if self.faults.add(record):
                self.events.publish(EventKind.ERROR, hresult.signed(code), text, moment)
                self._react(code)

    def _react(self, code: int) -> None:
        """Apply the effect of an error with this code to robot and programs (docs/howto/robot.md)."""
        level = level_of(code)
        if level < _STOPPING_LEVEL:
            return
        motion = hresult.family(code) in (CodeFamily.MOTION, CodeFamily.SERVO)
        if level >= _CUTTING_LEVEL or (motion and level >= _CUTTING_MOTION_LEVEL):
            self.robots.stop_and_power_off(code)
        else:
            self.robots.stop(code)
        self.tasks.stop_all()

    def clear_errors(self, origin: Origin = _NOBODY) -> None:
        """Clear the current errors; they remain in the log.

        Raises:
            CallError: FATAL_ERROR_BEFORE if an error has level 5; the controller has to be restarted.
        """
        with self.cycles:
            if self.faults.fatal:
                raise error_for(hresult.FATAL_ERROR_BEFORE)
            self.faults.clear()
            self.log(Operation.CLEAR_ERROR, self.say("Errors cleared"), origin)

    def restart(self) -> None:
        """Reset errors, motor, motions and programs, as if switched off and on; the clients are disconnected."""
        with self.cycles:
            self.robots.stop_and_power_off(hresult.STOPPED_DURING_PC_MOTION)
            self.tasks.power_on()
            self.robots.power_on()
            self.hands.power_on()
            self.usage.power_on()
            self.faults.clear()
            self.log(Operation.RESTART, self.say("Restarted"))
            connections, self.connections = self.connections, {}
        for disconnect in connections.values():
            disconnect("the controller restarts")

    def set_mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic.

        A change of the mode stops the arm and then switches the motor off.

        Raises:
            ValueError: If the number is not 1, 2 or 3.
        """
        new = read_mode(mode)
        with self.cycles:
            if new is self.switches.mode:
                return
            self.switches.mode = new
            self._halt_all(hresult.EMERGENCY_STOP_OR_MODE_CHANGE)
            text = self.say("Mode: {mode}", mode=self.say(_MODE_NAMES[new]))
            self.log(Operation.MODE, text)
            self.events.publish(EventKind.MODE, new, text, self.calendar.now())

    def set_token(self, token: Token) -> None:
        """Assign the executable token; running motions and programs continue."""
        with self.cycles:
            if token != self.switches.token:
                self.switches.token = token
                self.log(Operation.TOKEN, self.say("Executable token: {token}", token=token))

    def set_time(self, moment: datetime) -> None:
        """Set the local date and time."""
        with self.cycles:
            self.calendar.set(moment)
            self.log(Operation.SET_TIME, self.say("Time set to {moment:%Y-%m-%d %H:%M:%S}", moment=moment))

    def emergency_stop(self, on: bool) -> None:
        """Press or release the emergency stop; pressing it stops the arm and then switches the motor off."""
        on = bool(on)
        with self.cycles:
            if on is self.switches.emergency_stop:
                return
            self.switches.emergency_stop = on
            if on:
                self._halt_all(hresult.EMERGENCY_STOP_ON)
            text = self.say("Emergency stop pressed") if on else self.say("Emergency stop released")
            self.log(Operation.EMERGENCY_STOP, text)
            self.events.publish(EventKind.EMERGENCY_STOP, int(on), text, self.calendar.now())

    def protective_stop(self, on: bool) -> None:
        """Set or clear the protective stop; setting it stops the arm and then switches the motor off."""
        with self.cycles:
            if bool(on) is self.switches.protective_stop:
                return
            self.switches.protective_stop = bool(on)
            if on:
                self._halt_all(hresult.PROTECTIVE_STOP_ON)
            text = self.say("Protective stop on") if on else self.say("Protective stop off")
            self.log(Operation.PROTECTIVE_STOP, text)

    def auto_enable(self, on: bool) -> None:
        """Set or clear the auto-enable input.

        Clearing it raises an error, stops the arm and then switches the motor off.
        """
        with self.cycles:
            if bool(on) is self.switches.auto_enable:
                return
            self.switches.auto_enable = bool(on)
            text = self.say("Auto enable on") if on else self.say("Auto enable off")
            self.log(Operation.AUTO_ENABLE, text)
            if not on:
                self.raise_error(hresult.AUTO_ENABLE_WENT_OFF)
                self._halt_all(hresult.AUTO_ENABLE_WENT_OFF)

    def machine_lock(self, on: bool, origin: Origin = _NOBODY) -> None:
        """Set or clear the machine lock: while it is set, motions are executed, but the arm does not move.

        Raises:
            CallError: MOTOR_IS_ON if the motor is not off, because the arm must not jump when the lock is cleared.
        """
        with self.cycles:
            if bool(on) is self.switches.machine_lock:
                return
            self.robots.require_motors_off()
            self.robots.lock(bool(on))
            text = self.say("Machine lock on") if on else self.say("Machine lock off")
            self.log(Operation.MACHINE_LOCK, text, origin)

    def _halt_all(self, code: int) -> None:
        self.robots.stop_and_power_off(code)
        self.tasks.stop_all()

    def load_program(self, task: Task, origin: Origin) -> Program:
        """Return the compiled program of a task; a syntax error is written to the error log.

        Call this method outside the lock.

        Raises:
            CallError: As for :meth:`Tasks.load`.
        """
        try:
            return self.tasks.load(task)
        except CallError as error:
            if error.code == hresult.SYNTAX_ERROR:
                record = ErrorRecord(
                    error.code, error.detail, self.calendar.now(), program=task.name,
                    tick=self.milliseconds(), client_id=origin.client_id,
                )  # fmt: skip
                with self.cycles:
                    self.faults.log.add(record)
            raise

    def _robot(self, number: int, model: ArmModel) -> RobotUnit:
        def fault(code: int, detail: str) -> None:
            self._motion_fault(code, f"{unit.name}: {detail}".rstrip(": ") if number else detail)

        arm = RC8Arm(
            model, self.cycles, self.switches, self.faults, self.variables, lambda: self.last_cycle_time, fault
        )
        unit = RobotUnit(number, arm, Moves(arm, self.cycles, self.planning, self.variables, fault))
        return unit

    def _motion_fault(self, code: int, detail: str) -> None:
        text = self.faults.default_message(code)
        self.raise_error(code, f"{text}: {detail}" if detail else text)

    def _show(self, program: str, kind: str, text: str) -> None:
        """Add a text printed by PrintMsg or PrintDbg to the operation log; for PrintMsg, also publish an event.

        The text is not written to stderr: if no process reads stderr, a program that prints without end would block the
        controller.
        """
        self.log(Operation.PROGRAM_OUTPUT, f"{program}: {text}")
        if kind == "msg":
            self.events.publish(EventKind.MESSAGE, 0, f"{program}: {text}", self.calendar.now())

    def _program_fault(self, code: int, detail: str, program: str, line: int) -> None:
        text = self.faults.default_message(code)
        number = self.files.number(program + SUFFIX)
        self.raise_error(code, f"{text}: {detail}" if detail else text, program=program, line=line, file_id=number)

    def _crashed(self, error: Exception) -> None:
        """Raise an error and stop everything after an unexpected exception in the control loop."""
        self.raise_error(hresult.UNDEFINED_ERROR, f"{type(error).__name__}: {error}")
        self._halt_all(hresult.UNDEFINED_ERROR)

    def log(self, operation: Operation, text: str, origin: Origin = _NOBODY) -> None:
        """Add a line to the operation log."""
        client_id = origin.client_id or _SOURCES.get(operation, ClientId.PENDANT)
        self.operations.add(OperationRecord(operation, text, self.calendar.now(), self.milliseconds(), client_id))

    def milliseconds(self) -> int:
        """Return the milliseconds since power-on; after 24.8 days the value wraps to the lowest VT_I4."""
        return (int(self.seconds * 1000) + 2**31) % 2**32 - 2**31

    def close(self) -> None:
        """Stop the controller and close the database of the variables."""
        self.cycles.close()
        with self.cycles:
            self.robots.close()
            self.hands.stop(hresult.E_ABORT)
            self.tasks.close()
            self.variables.close()
        self.planning.close()
        self.compiling.close()
        self.disk.close(waits=True)  # the directory may be deleted afterwards


def read_mode(mode: int) -> ModeSwitch:
    """Return the position of the mode switch for a number.

    Raises:
        ValueError: If the number is not 1, 2 or 3.
    """
    try:
        return ModeSwitch(mode)
    except ValueError:
        raise ValueError(
            tr("mode must be 1 (manual), 2 (teach check) or 3 (automatic), not {mode!r}", mode=mode)
        ) from None
