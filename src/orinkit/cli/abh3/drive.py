"""``orinkit abh3 drive``: run the motors of an ABH3 for some seconds, and stop them in any case."""

from __future__ import annotations

from dataclasses import dataclass
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Group, Parameter

from orinkit.abh3.table.signals import CURRENT, VELOCITY, Quantity
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.cli._shared.interrupts import Interrupts
from orinkit.cli.abh3.bus import BusOptions, Url
from orinkit.cli.abh3.feedback import DriverFeedback, FeedbackDisplay, velocities_of, words
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from collections.abc import Callable

    from orinkit.abh3.api.names import Driver
    from orinkit.abh3.differential import Differential
    from orinkit.abh3.table.records import BR0

_LONGEST: Final = 3600.0  # s
_PERIODS: Final = (0.01, 0.3)  # s; a driver stops by itself if no command arrives for 0.5 s
_MAX_COMMAND_DELAY: Final = 0.45  # s without a command after which the driver may have stopped
_STOP_TIMEOUT: Final = 5.0  # s for the motors to stop
_STANDSTILL: Final = 1.0  # min^-1
_POLL: Final = 0.02  # s

_DRIVER: Final = Group(tr("Driver"), sort_key=6)
_VEHICLE: Final = Group(tr("Vehicle with two driven wheels, instead of --ay and --bx"),
                        sort_key=5)  # fmt: skip


@Parameter(name="*", group=_DRIVER)
@dataclass(frozen=True)
class DriverOptions:
    """Options that select the driver, and its settings."""

    address: Annotated[
        int,
        Parameter(converter=whole_number, help=tr("Address of the driver, 0 to 253.")),
    ] = 1
    host: Annotated[int, Parameter(converter=whole_number, help=tr("Address of this host."))] = 2
    group: Annotated[
        int,
        Parameter(
            converter=whole_number,
            help=tr("Broadcast group of the driver, 0 to 31."),
        ),
    ] = 5
    dialect: Annotated[
        str,
        Parameter(
            help=tr(
                "v1 (as in the manufacturer's document) or v2 (2023 and later). A wrong dialect switches on unintended inputs."
            ),
        ),
    ] = "v1"
    load_unit: Annotated[
        float, Parameter(help=tr("Unit of load values in %: 1 or 0.1."))
    ] = 1.0  # fmt: skip


@Parameter(name="*", group=_VEHICLE)
@dataclass(frozen=True)
class VehicleOptions:
    """Commands for a vehicle, and its dimensions."""

    velocity: Annotated[float | None, Parameter(help=tr("Forward velocity in m/s."))] = None
    turn: Annotated[float | None, Parameter(help=tr("Angular velocity in rad/s, positive to the left."))] = None
    wheel_diameter: Annotated[float | None, Parameter(help=tr("Diameter of the wheels in m."))] = None
    track: Annotated[float | None, Parameter(help=tr("Distance between the wheels in m."))] = None
    gear: Annotated[
        float | None,
        Parameter(help=tr("Turns of a wheel per turn of its motor, 0.1 for a gear of 10:1.")),
    ] = None  # fmt: skip

    @property
    def given_options(self) -> list[str]:
        """The names of the options that are set."""
        names = ("velocity", "turn", "wheel_diameter", "track", "gear")
        return ["--" + name.replace("_", "-") for name in names if getattr(self, name) is not None]

    def differential(self) -> Differential:
        """Return the kinematics of the vehicle.

        Raises:
            CommandError: If a dimension or both velocities are missing.
            InvalidValue: If a dimension is out of range.
        """
        from orinkit.abh3.differential import Differential

        if self.velocity is None and self.turn is None:
            raise usage_error(tr("{options}: --velocity or --turn is missing", options=', '.join(self.given_options)))  # fmt: skip
        if self.wheel_diameter is None or self.track is None or self.gear is None:
            raise usage_error(tr("--velocity and --turn require --wheel-diameter, --track and --gear"))  # fmt: skip
        return Differential(wheel_diameter=self.wheel_diameter, track=self.track, gear=self.gear)

    def commands(self, *, travel_model: bool) -> tuple[float, float]:
        """Return the commands of A/Y and B/X in min^-1; they depend on the axis model (motor or travel)."""
        differential = self.differential()
        v, omega = self.velocity or 0.0, self.turn or 0.0
        return differential.to_travel(v, omega) if travel_model else differential.to_motors(v, omega)


@dataclass(frozen=True)
class DrivePlan:
    """The operation that the command line requests.

    Attributes:
        ay: Command of A/Y in min^-1, or in % of the rated current.
        bx: Command of B/X in min^-1, or in % of the rated current.
        torque: True if the commands are currents.
        vehicle: Vehicle whose velocities determine the commands; ``None`` if ``ay`` and ``bx`` are the commands.
        seconds: Duration in s.
        period: Time between commands in s.
        reset: True to reset errors first.
        keep_servo: True to leave the servo on at the end.
    """

    ay: float
    bx: float
    torque: bool
    vehicle: VehicleOptions | None
    seconds: float
    period: float
    reset: bool
    keep_servo: bool

    def check(self) -> None:
        """Check the values before anything is sent.

        Raises:
            CommandError, InvalidValue: If a value is out of range.
        """
        low, high = _PERIODS
        if not 0 < self.seconds <= _LONGEST:
            raise usage_error(tr("--seconds must be more than 0 and at most {longest:g}, not {seconds:g}", longest=_LONGEST, seconds=self.seconds))  # fmt: skip
        if not low <= self.period <= high:
            raise usage_error(
                tr(
                    "--period must be {low:g} to {high:g} s, not {period:g}: the driver stops by itself "
                    "if no commands arrive",
                    low=low,
                    high=high,
                    period=self.period,
                ),
            )
        self.commands(travel_model=True)  # if the commands of Y and X are out of range, those of A and B are, too

    @property
    def quantity(self) -> Quantity:
        """The quantity that the commands specify: velocity or current."""
        return CURRENT if self.torque else VELOCITY

    def commands(self, *, travel_model: bool) -> tuple[float, float]:
        """Return the commands of A/Y and B/X after checking that they can be encoded.

        Args:
            travel_model: True if the driver has the travel-axis model.

        Raises:
            InvalidValue: If a command is out of range.
        """
        ay, bx = (self.ay, self.bx) if self.vehicle is None else self.vehicle.commands(travel_model=travel_model)
        names = ("--ay", "--bx") if self.vehicle is None else self._wheels
        for name, value in zip(names, (ay, bx), strict=True):
            try:
                self.quantity.encode(value)
            except InvalidValue as error:
                raise InvalidValue(f"{name}: {error}") from None
        return ay, bx

    @property
    def _wheels(self) -> tuple[str, str]:
        """The names of the axes of a vehicle, for error messages."""
        measures = "--velocity, --turn, --wheel-diameter, --track, --gear"
        text = tr("axis of this vehicle ({measures})", measures=measures)
        return f"A/Y {text}", f"B/X {text}"


_BUS: Final = BusOptions()
_OPTIONS: Final = DriverOptions()
_STANDING: Final = VehicleOptions()


def drive(
    url: Url = None,
    /,
    *,
    seconds: Annotated[float, Parameter(help=tr("Duration in s."))],
    ay: Annotated[
        float | None, Parameter(help=tr("Command of A/Y in min^-1; 0 by default."))
    ] = None,
    bx: Annotated[
        float | None, Parameter(help=tr("Command of B/X in min^-1; 0 by default."))
    ] = None,
    torque: Annotated[
        bool, Parameter(help=tr("Torque mode: --ay and --bx are currents in %. In this mode only the driver limits the velocity."))
    ] = False,
    period: Annotated[
        float, Parameter(help=tr("Time in s between commands, and between output lines."))
    ] = 0.1,
    no_reset: Annotated[
        bool, Parameter(help=tr("Do not reset errors of the driver; the command fails if the driver has errors."))
    ] = False,
    keep_servo: Annotated[
        bool, Parameter(help=tr(
"Leave the servo on at the end; the driver reports an error if it receives no command "
"for 1 s."))
    ] = False,
    json: Annotated[
        bool, Parameter(name="--json", help=tr("Print one JSON object per line."))
    ] = False,
    vehicle: VehicleOptions = _STANDING,
    options: DriverOptions = _OPTIONS,
    bus: BusOptions = _BUS,
) -> int:  # fmt: skip
    """Run the motors of an ABH3: reset errors, switch the servo on, start, and send commands.

    At the end, even after an error, stop the motors and switch the servo off. Ctrl-C and SIGTERM end the motion early.
    Print the feedback of the driver after each command.
    """
    _check_together(ay, bx, vehicle, torque=torque)
    plan = DrivePlan(
        ay or 0.0,
        bx or 0.0,
        torque,
        vehicle if vehicle.given_options else None,
        seconds,
        period,
        not no_reset,
        keep_servo,
    )
    plan.check()
    address = bus.address(url)

    from orinkit.abh3.api.names import connect

    with (
        FeedbackDisplay(as_json=json) as shown,  # outermost: it waits for its reader after the motors have stopped
        Interrupts() as interrupts,
        connect(
            str(address), address=options.address, host=options.host, group=options.group, dialect=options.dialect,
            load_unit=options.load_unit,
        ) as driver,
    ):  # fmt: skip
        return _drive(driver, plan, interrupts, shown)


def _check_together(ay: float | None, bx: float | None, vehicle: VehicleOptions, *, torque: bool) -> None:
    axes = [name for name, value in (("--ay", ay), ("--bx", bx), ("--torque", torque or None)) if value is not None]
    if axes and vehicle.given_options:
        raise usage_error(tr("{axes} cannot be combined with {options}", axes=', '.join(axes), options=', '.join(vehicle.given_options)))  # fmt: skip
    if ay is None and bx is None and not vehicle.given_options:
        raise usage_error(tr("no command given. Try: --ay and --bx, or --velocity and --turn"))  # fmt: skip


def _drive(driver: Driver[Any, Any], plan: DrivePlan, interrupts: Interrupts, shown: FeedbackDisplay) -> int:
    """Carry out the plan; return the exit code."""
    interrupts.check()
    _clear(driver, plan)
    commands = plan.commands(travel_model=plan.vehicle is not None and _travels(driver))
    try:
        interrupts.check()
        _start(driver, plan)
        began = monotonic()
        _command(driver, plan, commands, interrupts, shown, began)
    finally:
        interrupts.resting = True
        notes = _stop(driver, keep_servo=plan.keep_servo)
        for note in notes:
            shown.note(note)
    if notes:
        return 1
    shown.show(_read(driver, driver.command, monotonic() - began))
    interrupts.check()
    return 0


def _clear(driver: Driver[Any, Any], plan: DrivePlan) -> None:
    """Reset errors, or check that there are none.

    Raises:
        DriverFault, CommandError: If there are errors.
    """
    if plan.reset:
        driver.reset_errors()
        return
    found = driver.errors()
    if found.errors:
        errors = words(found.errors)
        raise CommandError(tr("the driver has errors: {errors}. Try: omit --no-reset", errors=errors))  # fmt: skip


def _travels(driver: Driver[Any, Any]) -> bool:
    """Return True if the driver reports the travel-axis model, in which the commands apply to Y and X."""
    feedback = driver.command()
    control = feedback.control if hasattr(feedback, "control") else driver.states().control
    return "travel_model" in control


def _start(driver: Driver[Any, Any], plan: DrivePlan) -> None:
    if plan.torque:
        driver.set_input("torque", 1)
    driver.set_input("servo_on", 1)
    driver.set_input("start", 1)


def _command(
    driver: Driver[Any, Any],
    plan: DrivePlan,
    commands: tuple[float, float],
    interrupts: Interrupts,
    shown: FeedbackDisplay,
    began: float,
) -> None:
    """Send a command in each period until the duration of the plan is over.

    Raises:
        KeyboardInterrupt: If a signal has arrived.
        CommandError: If the driver has errors, or a command is so late that the driver may have stopped.
    """
    end, due, sent = began + plan.seconds, began, began
    while (now := monotonic()) < end:
        if now - sent > _MAX_COMMAND_DELAY:
            raise CommandError(tr(
"no command was sent for {seconds:.1f} s, so the driver may have stopped; orinkit does not restart it", seconds=now - sent))  # fmt: skip
        feedback = _read(driver, lambda: driver.command(*commands), now - began)
        sent = now
        shown.show(feedback)
        _check_faults(feedback.faults)
        due = max(due + plan.period, monotonic())
        interrupts.wait(min(due, end))


def _check_faults(found: BR0) -> None:
    if found.errors:
        errors = words(found.errors)
        raise CommandError(tr("the driver has stopped with errors: {errors}", errors=errors))


def _read(driver: Driver[Any, Any], command: Callable[[], Any], time: float) -> DriverFeedback:
    """Send a command, and request all values that are shown."""
    return DriverFeedback(time, command(), driver.pulses(), driver.currents(), driver.errors())


def _stop(driver: Driver[Any, Any], *, keep_servo: bool) -> list[str]:
    """Stop the motors, then switch the servo off; return messages about failures."""
    end = monotonic() + _STOP_TIMEOUT
    notes = []
    while True:
        try:
            fastest = max(abs(velocity) for velocity in velocities_of(driver.stop()).values())
        except OrinError as error:  # a single reply may be lost
            wrong = str(error)
        else:
            if fastest < _STANDSTILL:
                break
            wrong = f"{fastest:.1f} min^-1"
        if monotonic() > end:
            notes.append(tr("standstill of the motors was not confirmed within {seconds:g} s: {reason}", seconds=_STOP_TIMEOUT, reason=wrong))  # fmt: skip
            break
        sleep(_POLL)
    if not keep_servo:
        try:
            driver.init()  # sets commands and inputs to 0
        except OrinError as error:
            notes.append(tr("the servo may still be on: {error}", error=error))
    return notes
