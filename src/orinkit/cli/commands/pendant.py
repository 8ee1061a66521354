"""``orinkit pendant``: operate the pendant of a virtual RC8 through its control port."""

from __future__ import annotations

import json as json_texts
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Final

from cyclopts import Parameter

from orinkit.cli._shared.connection import CONNECTION, Capture, ConnectionOptions
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.client._shared.common import DEFAULT_TIMEOUT
from orinkit.client._shared.connection_string import url_of
from orinkit.core.errors import AccessDenied, CallError, InvalidArgument, ObjectNotFound, ProtocolError
from orinkit.core.hresult import E_CAO_PROV_INVALID
from orinkit.core.i18n import N_, tr
from orinkit.transport.address import Address, is_loopback, parse_address

PROVIDER: Final = "CaoProv.orinkit.Pendant"

MODES: Final = {"manual": 1, "teach": 2, "auto": 3}


def read_mode(word: str) -> int:
    """Return the number of a mode from its name.

    Raises:
        CommandError: If the word is not the name of a mode.
    """
    mode = MODES.get(word.strip().lower())
    if mode is None:
        raise usage_error(
            tr("{word!r:.40} is not a mode. Try: manual, teach or auto", word=word),
        )
    return mode


@dataclass(frozen=True, slots=True)
class PendantAction:
    """An action of ``orinkit pendant``.

    Attributes:
        command: Command of the control port.
        metavar: The arguments of the action, for people.
        read: Function that returns the parameter of the command from the arguments, or raises CommandError.
        shows: Items of the status that are shown afterwards; if empty, all items are shown.
        waits: True if the action supports ``--wait``.
    """

    command: str
    metavar: str
    read: Callable[[PendantArguments], Any]
    shows: tuple[str, ...] = ()
    waits: bool = False


@dataclass(frozen=True, slots=True)
class PendantArguments:
    """The arguments of an action.

    Attributes:
        given: The words after the name of the action on the command line.
        wait: True to wait until the action has ended.
        usage: Usage of the action, for error messages.
    """

    given: tuple[str, ...]
    wait: bool
    usage: str

    def none(self) -> None:
        """Check that there are no words."""
        self.words(0)

    def one(self) -> str:
        """Return the only word."""
        return self.words(1)[0]

    def flag(self) -> bool:
        """Return True for ``on`` and False for ``off``."""
        word = self.one().lower()
        if word not in ("on", "off"):
            raise self.wrong()
        return word == "on"

    def number(self, index: int) -> float:
        """Return the word at an index as a number."""
        try:
            return float(self.given[index])
        except ValueError:
            raise self.wrong() from None

    def words(self, least: int, most: int | None = None) -> tuple[str, ...]:
        """Return the words after checking that there are ``least`` to ``most`` (default: ``least``) words."""
        if not least <= len(self.given) <= (least if most is None else most):
            raise self.wrong()
        return self.given

    def wrong(self) -> CommandError:
        """Return the exception for invalid arguments."""
        return usage_error(tr("usage: {usage}", usage=self.usage))


def _jog(given: PendantArguments) -> list[float]:
    given.words(2)
    axis, distance = given.number(0), given.number(1)
    if not axis.is_integer():
        raise given.wrong()
    return [int(axis), distance, int(given.wait)]


def _whole(given: PendantArguments) -> int:
    given.words(1)
    number = given.number(0)
    if not number.is_integer():
        raise given.wrong()
    return int(number)


def _time(given: PendantArguments) -> datetime:
    try:
        moment = datetime.fromisoformat(" ".join(given.words(1, 2)))
    except ValueError:
        raise given.wrong() from None
    if moment.tzinfo is not None:  # the controller has local time
        raise given.wrong()
    return moment


def _workpiece(given: PendantArguments) -> list[float] | None:
    word = given.one()
    return None if word.lower() == "none" else [given.number(0)]


_SURFACE: Final = ("size", "stiffness", "damping", "friction", "thickness", "radius")
_SURFACE_DEFAULTS: Final = {
    "size": [200.0, 200.0], "stiffness": [10.0], "damping": [0.0], "friction": [0.0], "thickness": [100.0],
    "radius": [0.0],
}  # fmt: skip


def _numbers(given: PendantArguments, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise given.wrong() from None
    if len(values) != count:
        raise given.wrong()
    return values


def _surface(given: PendantArguments) -> list[Any]:
    name, pose, *settings = given.words(2, 2 + len(_SURFACE))
    if pose.lower() == "none":
        return [name]
    values = dict(_SURFACE_DEFAULTS)
    for setting in settings:
        key, _, text = setting.partition("=")
        if key.lower() not in values:
            raise given.wrong()
        values[key.lower()] = _numbers(given, text, len(values[key.lower()]))
    return [name, *_numbers(given, pose, 6), *(number for key in _SURFACE for number in values[key])]


def _fence(given: PendantArguments) -> list[float] | None:
    words = given.words(1, 3)
    if len(words) == 1 and words[0].lower() == "none":
        return None
    if len(words) != 3 or words[2].lower() not in ("inside", "outside"):
        raise given.wrong()
    return [*_numbers(given, words[0], 6), *_numbers(given, words[1], 3), float(words[2].lower() == "inside")]


def _scene(given: PendantArguments) -> list[Any]:
    number, sub, *settings = given.words(2, 6)
    values: dict[str, Any] = {"tool": -1.0, "work": -1.0, "speed": -1.0, "name": ""}
    for setting in settings:
        key, _, text = setting.partition("=")
        if key.lower() not in values:
            raise given.wrong()
        values[key.lower()] = text if key.lower() == "name" else _numbers(given, text, 1)[0]
    return [*_numbers(given, f"{number},{sub}", 2), *values.values()]


_STOPS: Final = ("motor", "error")
ACTIONS: Final[dict[str, PendantAction]] = {
    "mode": PendantAction("Mode", "manual|teach|auto", lambda given: read_mode(given.one()), ("mode",)),
    "token": PendantAction("Token", "any|tp|io|ethernet[:ADDRESS]", PendantArguments.one, ("token",)),
    "estop": PendantAction("EmergencyStop", "on|off", PendantArguments.flag, ("emergency_stop", *_STOPS)),
    "protective": PendantAction("ProtectiveStop", "on|off", PendantArguments.flag, ("protective_stop", *_STOPS)),
    "auto-enable": PendantAction("AutoEnable", "on|off", PendantArguments.flag, ("auto_enable", *_STOPS)),
    "deadman": PendantAction("Deadman", "on|off", PendantArguments.flag, ("deadman",)),
    "motor": PendantAction("Motor", "on|off", lambda given: [given.flag(), given.wait], ("motor",), waits=True),
    "jog": PendantAction("Jog", "AXIS DISTANCE", _jog, ("moving", "joints"), waits=True),
    "lock": PendantAction("MachineLock", "on|off", PendantArguments.flag, ("machine_lock",)),
    "slave-limit": PendantAction("SlaveLimit", "0|1|2|3", _whole, ("slave_limit",)),
    "error": PendantAction("RaiseError", "NAME|0xCODE [MESSAGE]", lambda given: list(given.words(1, 2)), ("error",)),
    "clear": PendantAction("ClearErrors", "", PendantArguments.none, ("error",)),
    "restart": PendantAction("Restart", "", PendantArguments.none, _STOPS),
    "workpiece": PendantAction("Workpiece", "WIDTH|none", _workpiece, ("hand.workpiece", "hand.holding")),
    "time": PendantAction("Time", "YYYY-MM-DD [HH:MM:SS]", _time, ("time",)),
    "surface": PendantAction(
        "Surface",
        "NAME X,Y,Z,RX,RY,RZ|none [size=X,Y] [stiffness=N/mm] [damping=] [friction=] [thickness=] [radius=]",
        _surface,
        ("workspace.surfaces", "workspace.force"),
    ),
    "fence": PendantAction("Fence", "X,Y,Z,RX,RY,RZ DX,DY,DZ inside|outside | none", _fence, ("workspace.fences",)),
    "scene": PendantAction("Scene", "NUMBER SUB [tool=N] [work=N] [speed=%] [name=TEXT]", _scene, ("workspace.scene",)),
    "arm-button": PendantAction("ArmButton", "0|1|2", _whole, ("workspace.buttons",)),
    "lose-calibration": PendantAction("LoseCalibration", "", PendantArguments.none, ("workspace.calibrated",)),
    "save-path": PendantAction("SavePath", "1..20", _whole, ("error",)),
    "status": PendantAction("Status", "", PendantArguments.none),
}
"""The actions, by name."""


def pendant(
    url: Annotated[
        str,
        Parameter(help=tr("Control port, as printed by orinkit serve rc8 --control: tcp://127.0.0.1:5008.")),
    ],
    action: Annotated[
        str,
        Parameter(
            help=tr("One of: ") + ", ".join(f"{name} {each.metavar}".rstrip() for name, each in ACTIONS.items()) + "."
        ),
    ],
    /,
    *value: Annotated[
        str,
        Parameter(help=tr("Arguments of the action, as listed for ACTION; DISTANCE is in deg, WIDTH in mm.")),
    ],
    wait: Annotated[
        bool, Parameter(help=tr("Wait until the action has ended; only for the actions jog and motor."))
    ] = False,
    robot: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=tr(
                "Number of the robot, if the controller has two: 0 for the first one, 1 for the second one. Without it, "
                "motor concerns all robots, and the other actions the first one."
            ),
        ),
    ] = None,
    json: Annotated[
        bool,
        Parameter(help=tr("Print the whole status as one JSON document.")),
    ] = False,
    control_secret_file: Annotated[
        str | None,
        Parameter(
            group=CONNECTION,
            help=tr(
                "File with the secret of the control port; by default the file that a server running under the "
                "same account has stored."
            ),
        ),
    ] = None,
    timeout: Annotated[
        float,
        Parameter(
            group=CONNECTION,
            help=tr("Time-out in seconds for connecting and for each call."),
        ),
    ] = DEFAULT_TIMEOUT,
    trace: Annotated[bool, Parameter(group=CONNECTION, help=tr("Print every packet to stderr."))] = False,
    capture: Annotated[Capture, Parameter(group=CONNECTION)] = None,
) -> None:
    """Press a button of a virtual RC8 and print the resulting state."""
    from orinkit.cli._shared.output import print_json
    from orinkit.cli._shared.terminal import one_line

    wanted = _find(action)
    usage = f"{action} {wanted.metavar}".rstrip() + (" [--wait]" if wanted.waits else "")
    if wait and not wanted.waits:
        raise usage_error(tr("--wait does not apply to {action}", action=action))
    secret = _secret(url, control_secret_file)
    seconds = None if timeout == DEFAULT_TIMEOUT else timeout  # a connection string may contain another one
    options = (f"Secret={secret}" if secret else "", "" if robot is None else f"Robot={robot}")
    connection = ConnectionOptions(
        PROVIDER, seconds, trace, option=",".join(filter(None, options)) or None, capture=capture
    )
    status = _press(url, connection, wanted, PendantArguments(value, wait, usage), robot)
    if json:
        print_json(status)
    else:
        for line in lines(status, wanted.shows):
            print(one_line(line))


def _find(name: str) -> PendantAction:
    found = ACTIONS.get(name.lower())
    if found is None:
        raise usage_error(tr("unknown action {name!r:.40}. Try: {actions}", name=name, actions=", ".join(ACTIONS)))
    return found


def _secret(url: str, path: str | None) -> str:
    """Return the secret of a control port; ``""`` if it is unknown.

    Raises:
        CommandError: If the file cannot be used.
        InvalidAddress: If the URL is not a valid address.
    """
    from orinkit.cli._shared.control_secret import find_secret, read_secret

    if path is not None:
        return read_secret(path)
    address = parse_address(url_of(url))
    return find_secret(address) if isinstance(address, Address) and is_loopback(address.host) else ""


def _denied(url: str, *, known: bool) -> CommandError:
    if known:
        return CommandError(
            tr(
                "{url} refuses the secret. Try: --control-secret-file FILE with the secret that the server at "
                "this address has printed",
                url=url,
            )
        )
    return CommandError(
        tr(
            "{url} requires a secret, and there is no stored secret for this port: no server running under your "
            "account has created one. Try: --control-secret-file FILE with the secret that the server at this "
            "address has printed",
            url=url,
        )
    )


def _press(
    url: str, connection: ConnectionOptions, action: PendantAction, given: PendantArguments, robot: int | None
) -> dict[str, Any]:
    """Press a button and return the resulting status."""
    parameter = action.read(given)
    try:
        with connection.opened(url) as controller:
            if action.command != "Status":
                controller.execute(action.command, parameter)
            return _status(controller.execute("Status"))
    except AccessDenied:
        raise _denied(url, known=connection.option is not None) from None
    except ObjectNotFound:  # the description of the call would contain the secret
        if robot is None:
            raise
        raise CommandError(tr("the controller has no robot {number}. Try: --robot 0", number=robot)) from None
    except InvalidArgument as error:
        raise CommandError(f"{error} {given.wrong()}") from None
    except CallError as error:
        if error.code != E_CAO_PROV_INVALID:
            raise
        raise CommandError(
            tr("{url} is not a control port. Try: orinkit serve rc8 --control 127.0.0.1:5008", url=url)
        ) from None


def _status(answer: object) -> dict[str, Any]:
    try:
        status = json_texts.loads(answer) if isinstance(answer, str) else None
    except (ValueError, RecursionError):
        status = None
    if isinstance(status, dict):
        return status
    raise ProtocolError(tr("unexpected reply to Status: {answer!r:.80}", answer=answer))


# --- for people -------------------------------------------------------------------------------------------------------

_LABELS: Final = {
    "mode": N_("mode"), "token": N_("executable token"), "emergency_stop": N_("emergency stop"),
    "protective_stop": N_("protective stop"), "auto_enable": N_("auto enable"),
    "deadman": N_("enable switch"), "machine_lock": N_("machine lock"),
    "motor": N_("motor"), "moving": N_("moving"), "held": N_("paused"),
    "arm_holder": N_("arm taken by"), "error": N_("error"), "joints": N_("joints"),
    "programs": N_("programs running"), "supervisory": N_("supervisory tasks"), "slave_mode": N_("slave mode"),
    "slave_limit": N_("limits in slave mode"), "hand.position": N_("hand: position"),
    "hand.motor": N_("hand: motor"), "hand.moving": N_("hand: moving"),
    "hand.holding": N_("hand: holding"), "hand.force": N_("hand: force"),
    "hand.workpiece": N_("hand: workpiece"), "time": N_("time"),
    "workspace.surfaces": N_("surfaces"), "workspace.force_control": N_("force control"),
    "workspace.force": N_("force on the tool"), "workspace.fences": N_("virtual fences"),
    "workspace.scene": N_("scene"), "workspace.buttons": N_("buttons of the arm"),
    "workspace.calibrated": N_("calibrated"),
}  # fmt: skip


def lines(status: Mapping[str, Any], shows: tuple[str, ...] = ()) -> list[str]:
    """Return the status for people: a line for each item, or for those in ``shows``."""
    from orinkit.cli._shared.output import padded, width

    rows = [
        (tr(_LABELS[name]) if name in _LABELS else name, _shown(value))
        for name, value in _flat(status)
        if not shows or name in shows
    ]
    widest = max((width(label) for label, _ in rows), default=0)
    return [f"{padded(label, widest)}  {value}" for label, value in rows]


def _flat(status: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    for name, value in status.items():
        rows += _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(f"{prefix}{name}", value)]
    return rows


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list):
        return " ".join(map(_shown, value))
    if isinstance(value, float):
        return f"{value:g}" if abs(value) < 1e6 else str(value)
    return "-" if value in (None, "") else str(value)
