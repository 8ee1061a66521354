"""``orinkit serve rc8``: serve a virtual RC8 on the network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from cyclopts import Group, Parameter

from orinkit.arms import MODEL_NAMES
from orinkit.cli._shared.control_secret import OPTION, read_secret, stored_secret
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.cli._shared.listen_addresses import LISTENING
from orinkit.cli._shared.serving import PendantListener, ServerOptions, begin_log, check, check_control, run_many
from orinkit.cli.commands.pendant import read_mode
from orinkit.cli.commands.serve_device import load_targets, name_and_log_providers
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.device.discovery import load_installed
from orinkit.transport.address import consecutive_addresses
from orinkit.values.poses import J, parse_target
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import Permission, VirtualRC8
from orinkit.virtual.rc8.control import ControlProvider
from orinkit.virtual.rc8.variables.table import DEFAULT_IO_POINTS
from orinkit.virtual.shared_clock import SharedClock

_CONTROLLER: Final = Group(tr("Controller"), sort_key=5)
ROBOT: Final = Group(tr("Robot"), sort_key=6)
JOINTS: Final = Parameter(group=ROBOT, allow_leading_hyphen=True)
MotorOn: TypeAlias = Annotated[bool, Parameter(group=ROBOT, help=tr("Start with the motor on."))]
_PROVIDERS: Final = Group(tr("Additional devices"), sort_key=7)
_LISTENING: Final = ServerOptions()


def serve_rc8(
    *,
    count: Annotated[
        int,
        Parameter(
            group=_CONTROLLER,
            converter=whole_number,
            help=tr(
"Number of controllers, all in this process. Each further one listens on the next port of each address; --control "
"likewise."),
        ),
    ] = 1,
    state: Annotated[
        str | None,
        Parameter(
            group=_CONTROLLER,
            help=tr("Directory in which to save the variables and files; without this option they are lost when the "
                "server ends. With --count, each controller uses a subdirectory: 1, 2, ..."),
        ),
    ] = None,
    permission: Annotated[
        str,
        Parameter(
            group=_CONTROLLER,
            help=tr("Clients that may read (r) or read and write (rw): \"192.168.0.7=r,10.0.0.0/8=none,*=rw\"."),
        ),
    ] = "*=rw",
    variables: Annotated[
        tuple[str, ...],
        Parameter(
            group=_CONTROLLER,
            help=tr(
"Number of variables of a class (I F D V P J T S), for example I=200; 100 by default; "
"may be repeated."),
        ),
    ] = (),
    io_points: Annotated[
        int, Parameter(group=_CONTROLLER, converter=whole_number, help=tr("Number of I/O points."))
    ] = DEFAULT_IO_POINTS,
    accept_pc_provider: Annotated[
        bool,
        Parameter(
            group=_CONTROLLER,
            help=tr("Also accept the provider name CaoProv.DENSO.RC8, which some clients send but real controllers refuse."),
        ),
    ] = False,
    controller: Annotated[
        Literal["rc8", "rc8a", "rc9", "cobotta"],
        Parameter(
            group=_CONTROLLER,
            help=tr("Controller that it represents; its arm, version, type and form of errors are the defaults."),
        ),
    ] = "rc8",
    version: Annotated[
        str | None,
        Parameter(group=_CONTROLLER, help=tr("Software version (@VERSION), for example 2.13.0.")),
    ] = None,
    model: Annotated[
        str | None,
        Parameter(
            group=ROBOT,
            help=tr(
                "Model of the arm: {models}, or your own TOML file. By default the usual arm of the controller.",
                models=", ".join(MODEL_NAMES),
            ),
        ),
    ] = None,
    type_name: Annotated[
        str | None,
        Parameter(
            group=ROBOT,
            help=tr("Type name of the arm (@TYPE_NAME), for example VS060A3-AV6-NNN-NNN; by default that of the model."),
        ),
    ] = None,
    second_model: Annotated[
        str | None,
        Parameter(
            group=ROBOT,
            help=tr(
"Model of the arm of a second robot (ID=1), or a TOML file; by default there is one robot."),
        ),
    ] = None,
    mode: Annotated[
        str, Parameter(group=ROBOT, help=tr("Initial position of the mode switch: manual, teach or auto."))
    ] = "auto",
    token: Annotated[
        str,
        Parameter(
            group=ROBOT,
            help=tr("Executable token (the device that may start motions): any, tp, io, ethernet or ethernet:ADDRESS."),
        ),
    ] = "any",  # noqa: S107 - not a password
    motor_on: MotorOn = False,
    joints: Annotated[
        str | None,
        JOINTS,
        Parameter(
            help=tr(
"Initial joint position in deg: \"J(0, 30, 90, 0, 60, 0)\" or 0,30,90,0,60,0; the home "
"pose by default."),
        ),
    ] = None,
    second_joints: Annotated[
        str | None,
        JOINTS,
        Parameter(
            help=tr("Initial joint position of the second robot; the home pose by default."),
        ),
    ] = None,
    no_samples: Annotated[
        bool,
        Parameter(
            group=ROBOT,
            help=tr("Do not add sample programs to an empty file store."),
        ),
    ] = False,
    no_slave_licence: Annotated[
        bool,
        Parameter(
            group=ROBOT,
            help=tr("Refuse slave mode, as a controller without the licence for slave mode does."),
        ),
    ] = False,
    slave_limit: Annotated[
        int,
        Parameter(
            group=ROBOT,
            converter=whole_number,
            help=tr(
"Limits in slave mode (RC8 4.8): 0 servo limits, 1 servo limits multiplied by the external speed, 2 command "
"limits, 3 command limits multiplied by the external speed."),
        ),
    ] = 0,
    strict_time: Annotated[
        bool,
        Parameter(
            group=ROBOT,
            help=tr(
"Do not wait for late set-points in slave mode. As on a real controller, a late set-point immediately causes an "
"error; in mode 1 the arm stops in place instead. By default, the virtual controller waits up to 250 ms."),
        ),
    ] = False,
    user_io_unit: Annotated[
        Literal["bits", "bytes"],
        Parameter(
            group=ROBOT,
            help=tr("Unit of the size of user I/O in slvMove, if the set-point contains no user I/O that shows the unit."),
        ),
    ] = "bits",
    loose_poses: Annotated[
        bool,
        Parameter(
            group=ROBOT,
            help=tr("Read six bare numbers in OutRange as a position, and the pose type L of Move as P."),
        ),
    ] = False,
    strict: Annotated[
        bool,
        Parameter(
            group=_CONTROLLER,
            help=tr(
"Follow the b-CAP document where programs in use show that real controllers are more tolerant."),
        ),
    ] = False,
    hand: Annotated[
        tuple[str, ...],
        Parameter(
            group=ROBOT,
            help=tr(
"Board with an electric gripper, 0 to 7 (Hand0 to Hand7), or none; 0 by default; may be repeated."),
        ),
    ] = (),
    create_files: Annotated[
        bool,
        Parameter(
            group=_CONTROLLER,
            help=tr("File_PutValue creates a missing file, also if it was opened without @Create."),
        ),
    ] = False,
    time_scale: Annotated[
        float,
        Parameter(
            group=_CONTROLLER,
            help=tr(
"Simulated seconds per real second; 20 makes motions 20 times as fast."),
        ),
    ] = 1.0,
    provider: Annotated[
        tuple[str, ...],
        Parameter(
            group=_PROVIDERS,
            help=tr(
"Additional device to serve: file.py:Class, module:Class, or the name of an installed "
"provider; may be repeated."),
        ),
    ] = (),
    no_providers: Annotated[
        bool,
        Parameter(
            group=_PROVIDERS,
            help=tr("Do not serve installed providers, which are served by default."),
        ),
    ] = False,
    control: Annotated[
        str | None,
        Parameter(
            group=LISTENING,
            help=tr(
"Control port for orinkit pendant: HOST:PORT on this machine. The server prints \"ready control URL\", and then the "
"secret unless --control-secret-file already contains one. Port 0 selects a free port."),
        ),
    ] = None,
    control_secret_file: Annotated[
        str | None,
        Parameter(
            group=LISTENING,
            help=tr(
"File with the secret of --control. If the file does not exist, it is created with a new secret, and removed when "
"the server ends. By default a file that orinkit pendant finds automatically."),
        ),
    ] = None,
    listening: ServerOptions = _LISTENING,
) -> int:  # fmt: skip
    """Serve virtual RC8 controllers; print "ready URL" for each listener. Stop on SIGINT, SIGTERM or SIGHUP."""
    check(listening)
    if count < 1:
        raise usage_error(tr("--count must be at least 1, not {count}", count=count))
    if control is not None and control.isascii() and control.isdecimal():  # a port alone, as for --tcp
        control = f"127.0.0.1:{control}"
    secret = _read_control(control, control_secret_file)
    begin_log(listening)  # a warning about the state directory is logged
    try:
        clock = SharedClock(time_scale) if count > 1 else Clock(time_scale)
    except ValueError as error:
        raise CommandError(str(error), 2) from None

    def made(number: int) -> VirtualRC8:
        return VirtualRC8(
            counts=read_counts(variables),
            io_points=io_points,
            state=_state_of(state, number, count),
            permission=Permission.parse(permission),
            accept_pc_provider=accept_pc_provider,
            controller=controller,
            version=version,
            model=model,
            type_name=type_name,
            second_model=second_model,
            mode=read_mode(mode),
            token=token,
            motor=motor_on,
            joints=None if joints is None else read_joints(joints),
            second_joints=None if second_joints is None else read_joints(second_joints),
            samples=not no_samples,
            slave_licence=not no_slave_licence,
            slave_limit=slave_limit,
            strict_time=strict_time,
            loose_poses=loose_poses,
            strict=strict,
            hands=read_boards(hand),
            create_files=create_files,
            user_io_unit=user_io_unit,
            clock=clock,
        )

    with ExitStack() as closing:
        arms: list[VirtualRC8] = []
        try:
            for number in range(1, count + 1):
                arms.append(made(number))
                closing.callback(arms[-1].close)
        except ValueError as error:
            raise CommandError(str(error), 2) from None
        served = load_targets(provider, arms[:1])
        if not no_providers:
            served += load_installed(served, exclude=provider)
        name_and_log_providers(served, arms[0])
        controls = _controls(arms, control, secret, control_secret_file)
        return run_many([served, *([arm] for arm in arms[1:])], listening, controls)


def _state_of(directory: str | None, number: int, count: int) -> str | None:
    return directory if directory is None or count == 1 else str(Path(directory) / str(number))


def _read_control(url: str | None, path: str | None) -> str:
    """Return the secret of the control port if the file with the secret exists, otherwise ``""``.

    Raises:
        CommandError: If other machines could reach the port, or the file cannot be used.
        InvalidAddress: If the control port is not a valid address.
    """
    if url is not None:
        check_control(url)
        return read_secret(path) if path is not None and Path(path).exists() else ""
    if path is not None:
        raise usage_error(tr("{option} requires --control HOST:PORT", option=OPTION))
    return ""


def _controls(arms: Sequence[VirtualRC8], url: str | None, secret: str, path: str | None) -> Sequence[PendantListener]:
    """Return a control port for each controller; all have the same secret, which is printed after the last one."""
    if url is None:
        return ()
    first = ControlProvider(arms[0], secret=secret)
    providers = [first, *(ControlProvider(arm, secret=first.secret) for arm in arms[1:])]

    @contextmanager
    def publish_secret(number: int, port: int) -> Iterator[Sequence[str]]:
        if secret:  # from a file of the user, so it need not be printed or stored
            yield ()
            return
        printed = [f"control secret {first.secret}"] if number == len(arms) else []
        if path is not None and number > 1:  # the first control port has stored it
            yield printed
            return
        with stored_secret(first.secret, port, path):
            yield printed

    return [
        PendantListener(provider, own, partial(publish_secret, number))
        for number, (provider, own) in enumerate(
            zip(providers, consecutive_addresses(url, len(arms)), strict=True), start=1
        )
    ]


def read_counts(texts: tuple[str, ...]) -> dict[str, int]:
    """Return the number of variables by class from texts like ``I=200``.

    Raises:
        CommandError: If a text does not have this form.
    """
    counts: dict[str, int] = {}
    for text in texts:
        name, equals, number = text.partition("=")
        if not equals or not number.isdecimal():
            raise usage_error(tr("--variables {text}: not CLASS=NUMBER. Try: I=200", text=text))
        counts[name.strip().upper()] = int(number)
    return counts


def read_boards(texts: tuple[str, ...]) -> tuple[int, ...]:
    """Return the numbers of the boards with grippers from texts like ``0`` or ``none``.

    Raises:
        CommandError: If a text is neither a number nor ``none``.
    """
    boards = []
    for text in texts or ("0",):
        if text.strip().lower() == "none":
            continue
        if not text.strip().isdecimal():
            raise usage_error(tr("--hand {text:.40}: not a number or none. Try: 0", text=text))
        boards.append(int(text))
    return tuple(boards)


def read_joints(text: str) -> tuple[float, ...]:
    """Return the joint position from ``J(0, 30, 90, 0, 60, 0)`` or from the numbers alone.

    Raises:
        CommandError: If the text has neither of these forms.
    """
    try:
        if text.strip()[:1] not in ("J", "j"):
            return tuple(J.of([float(part) for part in text.replace(",", " ").split()]))
        target = parse_target(text)
    except (NotationError, InvalidValue) as error:
        raise _invalid_joints(text, f": {error}") from None
    except ValueError:
        raise _invalid_joints(text) from None
    if target.kind != "J" or target.mark or target.extra or isinstance(target.value, int):
        raise _invalid_joints(text)
    return target.value


def _invalid_joints(text: str, reason: str = "") -> CommandError:
    return usage_error(
        tr(
            '--joints {text:.60}: not of the form "J(0, 30, 90, 0, 60, 0)" or 0,30,90,0,60,0{reason}',
            text=text,
            reason=reason,
        ),
    )
