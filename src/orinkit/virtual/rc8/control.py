"""The control port: a provider with which programs on the same machine operate the pendant, over b-CAP.

Serve this provider on a separate port that only this machine can reach. A program that presses the emergency stop there
is not a client of the controller: it needs no access rights, and its calls do not wait for the calls of clients that
move the robot. Every user account of the machine can reach the port, so each program must send a secret.
"""

from __future__ import annotations

import hmac
import ipaddress
import json
import logging
import re
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from orinkit.cao.error_description import DESCRIBE, get_error_description
from orinkit.cao.options import Options
from orinkit.cao.provider import BlockingCall, ClientInfo, ControllerObject, Deferred, Provider
from orinkit.cao.shared_secret import SecretAttempts, check_secret
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import quoted, tr
from orinkit.values.variant import Variant
from orinkit.virtual.rc8.pendant import Pendant
from orinkit.virtual.rc8.provider import VirtualRC8
from orinkit.virtual.rc8.robot import parameters
from orinkit.virtual.rc8.robot.waiting_calls import all_of
from orinkit.virtual.rc8.switches import ModeSwitch
from orinkit.virtual.rc8.variables import conversion

PROVIDER_NAME: Final = "CaoProv.orinkit.Pendant"

MODE_NAMES: Final = {"manual": ModeSwitch.MANUAL, "teach": ModeSwitch.TEACH_CHECK, "auto": ModeSwitch.AUTOMATIC}

logger = logging.getLogger("orinkit.rc8")

# Maximum number of replies that are delayed at the same time. Further wrong secrets are refused immediately; this is
# safe, because a secret has at least 16 characters.
_HELD: Final = 8
_SECRET_OPTION: Final = "secret"  # noqa: S105 - the name of the option, not a secret
_ROBOT_OPTION: Final = "robot"
_LONGEST: Final = 500  # maximum length of a string in characters; the rest is cut off
# of a surface: pose, size, stiffness, damping, friction, thickness, radius
_SURFACE_DEFAULTS: Final = (0.0,) * 6 + (200.0, 200.0, 10.0, 0.0, 0.0, 100.0, 0.0)
_HEX: Final = re.compile(r"\s*0[xX]([0-9A-Fa-f]{1,8})\s*")


class ControlProvider(Provider):
    """Provider of the buttons of a virtual RC8 for clients on this machine that send the secret.

    A client sends the secret in the option of Controller_Connect: ``Secret=...``. Other clients receive E_ACCESSDENIED.
    From the sixth wrong secret on, counted over all clients, refusals are delayed by up to one second. Closing the
    provider does not affect the virtual RC8.

    Args:
        rc8: The controller.
        secret: 16 to 256 ASCII letters, digits and ``-._~``; if it is empty, a random secret is generated.

    Attributes:
        secret: The secret that clients must send.

    Raises:
        InvalidValue: If the secret is not valid.
    """

    provider_names: Sequence[str] = (PROVIDER_NAME,)
    requires_secret: bool = True

    def __init__(self, rc8: VirtualRC8, *, secret: str = "") -> None:
        self.guard = rc8.guard
        self.secret = check_secret(secret) if secret else secrets.token_urlsafe()
        self._rc8 = rc8
        self._guesses = SecretAttempts()
        self._held = threading.Semaphore(_HELD)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> ControlPanel | BlockingCall:
        """Return the control panel of a client, or refuse the client.

        If the refusal has to be delayed, return a call that raises the exception after the delay.

        Raises:
            CallError: E_ACCESSDENIED if the client is on another machine, or if its secret is missing or wrong;
                E_CAO_OBJECT_NOTFOUND if its robot does not exist.
        """
        if not _is_here(client):
            raise error_for(hresult.E_ACCESSDENIED, client.address)
        given = Options(option)
        if _SECRET_OPTION in given.repeated or not self._is_right(given.text_of(_SECRET_OPTION)):
            return self._refuse(given=_SECRET_OPTION in given)
        return ControlPanel(self._rc8, name, client.describe_error, self._robot(given))

    def _robot(self, given: Options) -> int | None:
        """Return the number of the robot in the option ``Robot``, or None.

        Raises:
            CallError: E_CAO_OBJECT_NOTFOUND if the robot does not exist.
        """
        text = given.text_of(_ROBOT_OPTION).strip()
        if not text:
            return None
        last = len(self._rc8.state.robots) - 1
        if not text.isdecimal() or int(text) > last:
            raise error_for(
                hresult.E_CAO_OBJECT_NOTFOUND,
                tr("robot {number} does not exist; robots: 0 to {last}", number=quoted(text), last=last),
            )
        return int(text)

    def _is_right(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "replace"), self.secret.encode())

    def _refuse(self, *, given: bool) -> BlockingCall:
        """Refuse a client: immediately, or after a delay if many clients have been refused.

        ``given`` is True if the client sent a secret.

        Raises:
            CallError: E_ACCESSDENIED.
        """
        failure = self._guesses.failed("", time.monotonic())  # one counter for all clients: all are on this machine
        if failure.failures_to_log:
            logger.warning(
                "control port: %d clients with a wrong secret, or with none, were refused", failure.failures_to_log
            )
        if not failure.delay or not self._held.acquire(blocking=False):
            raise _denied(given=given)

        def refuse_later() -> None:
            try:
                time.sleep(failure.delay)
            finally:
                self._held.release()
            raise _denied(given=given)

        return BlockingCall(refuse_later)


def _denied(*, given: bool) -> CallError:
    wrong = tr("the secret is wrong") if given else tr("the control port requires a secret")
    return error_for(
        hresult.E_ACCESSDENIED,
        wrong
        + tr(
            ". Try: add Secret=... to the option string, with the secret that the server printed. orinkit pendant "
            "finds the secret automatically if it runs under the same account as the server"
        ),
    )


class ControlPanel(ControllerObject):
    """The Controller object of one client of the control port; every button is a command of Controller_Execute.

    The enable switch that the client has pressed, and its jog, belong to the client: if the client is lost, the switch
    is released, and the jog stops. If it disconnects, as ``orinkit pendant`` does after each action, the switch remains
    pressed, and a jog continues.

    Args:
        rc8: The controller.
        name: Name that the client has chosen.
        describe_error: The client's :attr:`ClientInfo.describe_error`.
        robot: Number of the robot that the client has chosen; ``None`` if it has not chosen one.

    Attributes:
        rc8: The controller.
        chosen: Number of the robot that the client has chosen, or ``None``: Motor then concerns all robots.
        robot: The robot to which the buttons of one robot belong; the first one by default.
        workspace: The surroundings of its arm.
    """

    def __init__(
        self, rc8: VirtualRC8, name: str, describe_error: Callable[[int], str], robot: int | None = None
    ) -> None:
        super().__init__(name, help=rc8.state.say("Buttons of a virtual RC8"))
        self.rc8 = rc8
        self.chosen = robot
        self.robot = rc8.state.robots[robot or 0]
        self.workspace = rc8.workspaces[robot or 0]
        self._describe_error = describe_error

    def execute(self, command: str, parameter: Variant) -> Any:
        """Execute the command of a button (:data:`CONTROLS`), or GetErrorDescription.

        Raises:
            CallError: E_INVALID_CMD_NAME; E_INVALIDARG; the error code with which the controller refuses the operation.
        """
        name = command.strip().lower()
        if name == DESCRIBE:
            return get_error_description(self._describe_error, parameter)
        run = CONTROLS.get(name)
        if run is None:
            raise error_for(hresult.E_INVALID_CMD_NAME, f"{command:.40}")
        try:
            return run(self, parameter)
        except ValueError as error:  # the pendant reports an invalid argument
            raise error_for(hresult.E_INVALIDARG, f"{error}") from error

    def get_command_names(self, option: str) -> Sequence[str]:
        """Return the names of the buttons, and GetErrorDescription."""
        return [*CONTROL_NAMES, "GetErrorDescription"]

    def is_moving(self) -> bool:
        """Return True if a jog of the client is in progress."""
        return self.rc8.pendant.is_jogging(self)

    def stop_moving(self) -> None:
        """Release the enable switch if the client holds it or jogs."""
        self.rc8.pendant.lose_operator(self)

    def connection_lost(self) -> None:
        """Release the enable switch if the client holds it or jogs."""
        self.rc8.pendant.lose_operator(self)


# --- the buttons ------------------------------------------------------------------------------------------------------


def _mode(panel: ControlPanel, parameter: Variant) -> None:
    given = parameters.elements(parameter)
    text = given[0].value if given else None
    named = MODE_NAMES.get(parameters.check_length(text).strip().lower()) if isinstance(text, str) else None
    panel.rc8.pendant.mode(parameters.whole_numbers(parameter, None)[0] if named is None else named)


def _token(panel: ControlPanel, parameter: Variant) -> None:
    panel.rc8.pendant.token(_text(_first(parameter)))


def _switch(press: Callable[[Pendant, bool], None]) -> Callable[[ControlPanel, Variant], None]:
    """Return the handler of a button whose parameter is True to press it (the default) or False to release it."""

    def run(panel: ControlPanel, parameter: Variant) -> None:
        press(panel.rc8.pendant, _flag(parameters.elements(parameter), 0, missing=True))

    return run


def _deadman(panel: ControlPanel, parameter: Variant) -> None:
    panel.rc8.pendant.deadman(_flag(parameters.elements(parameter), 0, missing=True), operator=panel)


def _motor(panel: ControlPanel, parameter: Variant) -> Deferred[None] | None:
    given = parameters.elements(parameter)
    on, wait = _flag(given, 0, missing=True), _flag(given, 1, missing=False)
    panel.rc8.pendant.motor(on, robot=panel.chosen)
    if not wait:
        return None
    # The motors are already switching. A second call only returns another Deferred of the same switching.
    robots = panel.rc8.state.robots if panel.chosen is None else (panel.robot,)
    return all_of([robot.arm.switch_motor(on) for robot in robots])


def _jog(panel: ControlPanel, parameter: Variant) -> Deferred[None] | None:
    axis, distance, wait = parameters.numbers(parameter, None, None, 0)
    ticket = panel.rc8.pendant.jog(parameters.whole(axis), distance, operator=panel, robot=panel.robot.number)
    return panel.robot.arm.when_done(ticket) if wait else None


def _raise_error(panel: ControlPanel, parameter: Variant) -> None:
    given = parameters.elements(parameter)
    message = _text(given[1]) if len(given) > 1 else None
    panel.rc8.pendant.raise_error(_code(_first(parameter)), message)


def _slave_limit(panel: ControlPanel, parameter: Variant) -> None:
    panel.rc8.pendant.slave_limit(parameters.whole_numbers(parameter, None)[0])


def _clear_errors(panel: ControlPanel, _: Variant) -> None:
    panel.rc8.pendant.clear_errors()


def _restart(panel: ControlPanel, _: Variant) -> None:
    panel.rc8.pendant.restart()


def _status(panel: ControlPanel, _: Variant) -> str:
    rc8 = panel.rc8
    state = rc8.state
    time = state.calendar.now().isoformat(" ", "seconds")
    hand, workspace = state.hand.status(), panel.workspace.status()
    return json.dumps(
        {**rc8.pendant.status(robot=panel.robot.number), "time": time, "hand": hand, "workspace": workspace}
    )


def _workpiece(panel: ControlPanel, parameter: Variant) -> None:
    given = parameters.elements(parameter)
    width = conversion.double(given[0]) if given and given[0].value is not None else None
    hand = panel.rc8.state.hands.fingers(_text(given[2]) if len(given) > 2 else "")
    hand.put(width, inside=_flag(given, 1, missing=False))


def _time(panel: ControlPanel, parameter: Variant) -> None:
    panel.rc8.pendant.set_time(conversion.moment(_first(parameter)))


def _surface(panel: ControlPanel, parameter: Variant) -> None:
    """Place a surface: name, six numbers of its pose, two of its size, then the other numbers; the name alone removes it."""
    given = parameters.elements(parameter)
    name = _text(_first(parameter))
    if len(given) == 1:
        panel.workspace.remove(name)
        return
    values = [conversion.double(each) for each in given[1:]]
    if not 6 <= len(values) <= len(_SURFACE_DEFAULTS):
        raise error_for(
            hresult.E_INVALIDARG,
            tr(
                "got {given} parameters, expected {wanted}", given=len(given), wanted=f"7..{1 + len(_SURFACE_DEFAULTS)}"
            ),
        )
    values += _SURFACE_DEFAULTS[len(values) :]
    x, y, stiffness, damping, friction, thickness, radius = values[6:]
    panel.workspace.place(
        name, values[:6], size=(x, y), stiffness=stiffness, damping=damping, friction=friction, thickness=thickness,
        radius=radius,
    )  # fmt: skip


def _fence(panel: ControlPanel, parameter: Variant) -> None:
    """Set one fence: six numbers of a pose, three of a size, and True to stay inside; without numbers, remove all."""
    given = parameters.elements(parameter)
    if not given:
        panel.workspace.fence()
        return
    values = parameters.numbers(parameter, *(None,) * 9, 1.0)
    panel.workspace.fence((values[:6], values[6:9], bool(values[9])))


def _scene(panel: ControlPanel, parameter: Variant) -> None:
    """Define a scene: number, sub-scene, tool, work, external speed, and optionally a name."""
    given = parameters.at_least(parameter, 2)
    name = _text(given[5]) if len(given) > 5 else ""
    values = [conversion.double(each) for each in given[:5]]
    number, sub, tool, work, speed = [*values, *(-1.0,) * (5 - len(values))]
    whole = parameters.whole
    panel.workspace.scene(whole(number), whole(sub), name=name, tool=whole(tool), work=whole(work), speed=speed)


def _press(panel: ControlPanel, parameter: Variant) -> None:
    panel.workspace.press(*parameters.whole_numbers(parameter, None))


def _lose_calibration(panel: ControlPanel, _: Variant) -> None:
    panel.workspace.lose_calibration()


def _save_path(panel: ControlPanel, parameter: Variant) -> Deferred[None] | None:
    return panel.rc8.state.disk.run(panel.workspace.path_writer(*parameters.whole_numbers(parameter, None)))


_BUTTONS: Final[dict[str, Callable[[ControlPanel, Variant], Any]]] = {
    "Mode": _mode,
    "Token": _token,
    "EmergencyStop": _switch(Pendant.emergency_stop),
    "ProtectiveStop": _switch(Pendant.protective_stop),
    "AutoEnable": _switch(Pendant.auto_enable),
    "Deadman": _deadman,
    "Motor": _motor,
    "Jog": _jog,
    "MachineLock": _switch(Pendant.machine_lock),
    "SlaveLimit": _slave_limit,
    "RaiseError": _raise_error,
    "ClearErrors": _clear_errors,
    "Restart": _restart,
    "Status": _status,
    "Workpiece": _workpiece,
    "Time": _time,
    "Surface": _surface,
    "Fence": _fence,
    "Scene": _scene,
    "ArmButton": _press,
    "LoseCalibration": _lose_calibration,
    "SavePath": _save_path,
}

CONTROL_NAMES: Final = tuple(_BUTTONS)
"""The names of the buttons."""

CONTROLS: Final = {name.lower(): run for name, run in _BUTTONS.items()}
"""The handlers of the buttons, by name in lower case."""


# --- parameters -------------------------------------------------------------------------------------------------------


def _first(parameter: Variant) -> Variant:
    return parameters.at_least(parameter, 1)[0]


def _flag(given: Sequence[Variant], index: int, *, missing: bool) -> bool:
    return conversion.boolean(given[index]) if index < len(given) else missing


def _text(given: Variant) -> str:
    if not isinstance(given.value, str):
        raise error_for(hresult.DISP_E_TYPEMISMATCH, tr("expected a string"))
    return given.value[:_LONGEST]


def _code(given: Variant) -> int | str:
    """Return an error code as a number, or as its name; a string of hex digits after 0x is converted to a number."""
    if not isinstance(given.value, str):
        return conversion.whole(given)
    found = _HEX.fullmatch(given.value)
    return int(found[1], 16) if found else given.value[:_LONGEST]


def _is_here(client: ClientInfo) -> bool:
    """Return True if a client is on this machine; a client without an address is in this process."""
    if not client.address:
        return True
    try:
        host = ipaddress.ip_address(client.address)
    except ValueError:
        return False
    if isinstance(host, ipaddress.IPv6Address) and host.ipv4_mapped:
        host = host.ipv4_mapped
    return host.is_loopback
