"""``orinkit abh3 drive``: turn the motors of an ABH3 for some seconds, and bring them to rest, whatever happens."""

from __future__ import annotations

from dataclasses import dataclass
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Group, Parameter

from orinkit.abh3.table.signals import CURRENT, VELOCITY, Quantity
from orinkit.cli._shared.errors import CommandError, unusable, whole_number
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
_PERIODS: Final = (0.01, 0.3)  # s; a driver stops by itself when no command has come for 0.5 s
_HELD_UP: Final = 0.45  # s without a command after which it may have done so
_RAMP: Final = 5.0  # s that the motors get to come to rest
_STILL: Final = 1.0  # min^-1
_LOOK: Final = 0.02  # s

_DRIVER: Final = Group(tr("Driver"), sort_key=7)
_VEHICLE: Final = Group(tr("Vehicle with two driven wheels, instead of --ay and --bx"),
                        sort_key=6)  # fmt: skip


@Parameter(name="*", group=_DRIVER)
@dataclass(frozen=True)
class DriverOptions:
    """Which driver, and what its parameters are."""

    address: Annotated[
        int,
        Parameter(converter=whole_number, help=tr("Address of the driver, 0 to 253.")),
    ] = 1
    host: Annotated[int, Parameter(converter=whole_number, help=tr("Address of this host."))] = 2
    group: Annotated[
        int,
        Parameter(
            converter=whole_number,
            help=tr("Group of its broadcasts, 0 to 31."),
        ),
    ] = 5
    dialect: Annotated[
        str,
        Parameter(help=tr("v1, the document's, or v2 of 2023: a wrong one switches other inputs on.")),
    ] = "v1"
    load_unit: Annotated[
        float, Parameter(help=tr("It counts loads in 1 or 0.1 %."))
    ] = 1.0  # fmt: skip


@Parameter(name="*", group=_VEHICLE)
@dataclass(frozen=True)
class VehicleOptions:
    """How a vehicle is to move, and its measures."""

    velocity: Annotated[float | None, Parameter(help=tr("Forwards, in m/s."))] = None
    turn: Annotated[float | None, Parameter(help=tr("Turning in rad/s, positive to the left."))] = None
    wheel_diameter: Annotated[float | None, Parameter(help=tr("Diameter of the wheels in m."))] = None
    track: Annotated[float | None, Parameter(help=tr("From one wheel to the other in m."))] = None
    gear: Annotated[
        float | None,
        Parameter(help=tr("Turns of a wheel for one of its motor, 0.1 for a gear of 10:1.")),
    ] = None  # fmt: skip

    @property
    def given(self) -> list[str]:
        """The options that are given."""
        names = ("velocity", "turn", "wheel_diameter", "track", "gear")
        return ["--" + name.replace("_", "-") for name in names if getattr(self, name) is not None]

    def differential(self) -> Differential:
        """Return the measures.

        Raises:
            Failure: one is missing, or nothing is to move.
            InvalidValue: one cannot be.
        """
        from orinkit.abh3.differential import Differential

        if self.velocity is None and self.turn is None:
            raise unusable(tr("{options}: --velocity or --turn is missing", options=', '.join(self.given)))  # fmt: skip
        if self.wheel_diameter is None or self.track is None or self.gear is None:
            raise unusable(tr("--velocity and --turn need --wheel-diameter, --track and --gear"))  # fmt: skip
        return Differential(wheel_diameter=self.wheel_diameter, track=self.track, gear=self.gear)

    def commands(self, *, travel: bool) -> tuple[float, float]:
        """Return A/Y and B/X in min^-1, as the driver's model wants them."""
        measures = self.differential()
        v, omega = self.velocity or 0.0, self.turn or 0.0
        return measures.to_travel(v, omega) if travel else measures.to_wheels(v, omega)


@dataclass(frozen=True)
class DrivePlan:
    """What is to be done.

    Attributes:
        ay: command of A/Y in min^-1, or % of the rated current.
        bx: the same of B/X.
        torque: commands are currents.
        vehicle: that says the commands instead, or ``None``.
        seconds: that it takes.
        period: s between commands.
        reset: errors are to be reset.
        keep_servo: the servo is to stay on.
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
        """Find out that something cannot be before anything is sent.

        Raises:
            Failure, InvalidValue: something cannot be.
        """
        low, high = _PERIODS
        if not 0 < self.seconds <= _LONGEST:
            raise unusable(tr("--seconds must be more than 0 and at most {longest:g}, not {seconds:g}", longest=_LONGEST, seconds=self.seconds))  # fmt: skip
        if not low <= self.period <= high:
            raise unusable(
                tr(
                    "--period must be {low:g} to {high:g} s, not {period:g}: the driver stops by itself "
                    "without commands",
                    low=low,
                    high=high,
                    period=self.period,
                ),
            )
        self.commands(travel=True)  # if Y and X cannot be, A and B cannot either

    @property
    def quantity(self) -> Quantity:
        """What commands are."""
        return CURRENT if self.torque else VELOCITY

    def commands(self, *, travel: bool) -> tuple[float, float]:
        """Return the commands, of which each has a code.

        Args:
            travel: the driver has the travel-axis model.

        Raises:
            InvalidValue: one is out of its range.
        """
        ay, bx = (self.ay, self.bx) if self.vehicle is None else self.vehicle.commands(travel=travel)
        names = ("--ay", "--bx") if self.vehicle is None else self._wheels
        for name, value in zip(names, (ay, bx), strict=True):
            try:
                self.quantity.encode(value)
            except InvalidValue as error:
                raise InvalidValue(f"{name}: {error}") from None
        return ay, bx

    @property
    def _wheels(self) -> tuple[str, str]:
        """What a vehicle's commands that cannot be are told of."""
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
    seconds: Annotated[float, Parameter(help=tr("How long, in s."))],
    ay: Annotated[
        float | None, Parameter(help=tr("Command of A/Y in min^-1; 0 by default."))
    ] = None,
    bx: Annotated[
        float | None, Parameter(help=tr("Command of B/X in min^-1; 0 by default."))
    ] = None,
    torque: Annotated[
        bool, Parameter(help=tr("--ay and --bx are currents in %: nothing limits the velocity but the driver."))
    ] = False,
    period: Annotated[
        float, Parameter(help=tr("s between commands, and between lines."))
    ] = 0.1,
    no_reset: Annotated[
        bool, Parameter(help=tr("Do not reset errors of the driver; without errors only."))
    ] = False,
    keep_servo: Annotated[
        bool, Parameter(help=tr(
"Leave the servo on at the end; the driver has an error when it hears no host for a "
"second."))
    ] = False,
    json: Annotated[
        bool, Parameter(name="--json", help=tr("Print one JSON object for each line."))
    ] = False,
    vehicle: VehicleOptions = _STANDING,
    options: DriverOptions = _OPTIONS,
    bus: BusOptions = _BUS,
) -> int:  # fmt: skip
    """Turn the motors of an ABH3: reset errors, servo on, start, commands; then to rest and servo off, whatever happens.

    Ctrl-C and SIGTERM end it early. A line for each command tells what the driver says.
    """
    _check_together(ay, bx, vehicle, torque=torque)
    plan = DrivePlan(
        ay or 0.0, bx or 0.0, torque, vehicle if vehicle.given else None, seconds, period, not no_reset, keep_servo
    )
    plan.check()
    address = bus.address(url)

    from orinkit.abh3.api.names import connect

    with (
        FeedbackDisplay(as_json=json) as shown,  # the last to end: signals end its waiting then, the motors are at rest
        Interrupts() as interrupts,
        connect(
            str(address), address=options.address, host=options.host, group=options.group, dialect=options.dialect,
            load_unit=options.load_unit,
        ) as driver,
    ):  # fmt: skip
        return _drive(driver, plan, interrupts, shown)


def _check_together(ay: float | None, bx: float | None, vehicle: VehicleOptions, *, torque: bool) -> None:
    axes = [name for name, value in (("--ay", ay), ("--bx", bx), ("--torque", torque or None)) if value is not None]
    if axes and vehicle.given:
        raise unusable(tr("{axes} cannot be given beside {options}", axes=', '.join(axes), options=', '.join(vehicle.given)))  # fmt: skip
    if ay is None and bx is None and not vehicle.given:
        raise unusable(tr("nothing is to turn: --ay or --bx is missing (or --velocity or --turn)"))  # fmt: skip


def _drive(driver: Driver[Any, Any], plan: DrivePlan, interrupts: Interrupts, shown: FeedbackDisplay) -> int:
    """Do it; returns the exit code."""
    interrupts.check()
    _clear(driver, plan)
    commands = plan.commands(travel=plan.vehicle is not None and _travels(driver))
    try:
        interrupts.check()
        _start(driver, plan)
        began = monotonic()
        _keep_on(driver, plan, commands, interrupts, shown, began)
    finally:
        interrupts.resting = True
        notes = _rest(driver, keep_servo=plan.keep_servo)
        for note in notes:
            shown.note(note)
    if notes:
        return 1
    shown.show(_read(driver, driver.command, monotonic() - began))
    interrupts.check()
    return 0


def _clear(driver: Driver[Any, Any], plan: DrivePlan) -> None:
    """Reset errors, or make sure that there are none.

    Raises:
        DriverFault, Failure: there are.
    """
    if plan.reset:
        driver.reset_errors()
        return
    found = driver.errors()
    if found.errors:
        told = words(found.errors)
        raise CommandError(tr("the driver has errors: {errors}. Try: without --no-reset", errors=told))  # fmt: skip


def _travels(driver: Driver[Any, Any]) -> bool:
    """Whether the driver says that it has the travel-axis model, whose commands are those of Y and X."""
    feedback = driver.command()
    control = feedback.control if hasattr(feedback, "control") else driver.states().control
    return "travel_model" in control


def _start(driver: Driver[Any, Any], plan: DrivePlan) -> None:
    if plan.torque:
        driver.set_input("torque", 1)
    driver.set_input("servo_on", 1)
    driver.set_input("start", 1)


def _keep_on(
    driver: Driver[Any, Any],
    plan: DrivePlan,
    commands: tuple[float, float],
    interrupts: Interrupts,
    shown: FeedbackDisplay,
    began: float,
) -> None:
    """Command every period until the time is up.

    Raises:
        KeyboardInterrupt: somebody wants an end.
        Failure: the driver has errors, or this program was held up.
    """
    end, due, sent = began + plan.seconds, began, began
    while (now := monotonic()) < end:
        if now - sent > _HELD_UP:
            raise CommandError(tr(
"no command was sent for {seconds:.1f} s, so the driver may have stopped; it is not started "
"again", seconds=now - sent))  # fmt: skip
        feedback = _read(driver, lambda: driver.command(*commands), now - began)
        sent = now
        shown.show(feedback)
        _complain(feedback.faults)
        due = max(due + plan.period, monotonic())
        interrupts.wait(min(due, end))


def _complain(found: BR0) -> None:
    if found.errors:
        told = words(found.errors)
        raise CommandError(tr("the driver has stopped with errors: {errors}", errors=told))


def _read(driver: Driver[Any, Any], command: Callable[[], Any], time: float) -> DriverFeedback:
    """Send a command, and ask for all that is shown."""
    return DriverFeedback(time, command(), driver.pulses(), driver.currents(), driver.errors())


def _rest(driver: Driver[Any, Any], *, keep_servo: bool) -> list[str]:
    """Bring the motors to rest, then switch the servo off; returns what went wrong."""
    end = monotonic() + _RAMP
    notes = []
    while True:
        try:
            fastest = max(abs(velocity) for velocity in velocities_of(driver.stop()).values())
        except OrinError as error:  # a single answer may be lost
            wrong = str(error)
        else:
            if fastest < _STILL:
                break
            wrong = f"{fastest:.1f} min^-1"
        if monotonic() > end:
            notes.append(tr("the motors were not seen at rest within {seconds:g} s: {reason}", seconds=_RAMP, reason=wrong))  # fmt: skip
            break
        sleep(_LOOK)
    if not keep_servo:
        try:
            driver.init()  # commands and inputs 0
        except OrinError as error:
            notes.append(tr("the servo may still be on: {error}", error=error))
    return notes
