"""Options that select a controller, the connection to it, and an object on it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Final, TypeAlias

from cyclopts import Group, Parameter

import orinkit
from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao.dialect import RC8 as RC8_DIALECT
from orinkit.cao.dialect import Dialect
from orinkit.cao.replies import Trace
from orinkit.cli._shared.errors import usage_error, whole_number
from orinkit.cli._shared.files import read_token, warn_of_exposure
from orinkit.cli._shared.transcript import TracedPacket, Transcript
from orinkit.client._shared.common import LOCALHOST, RC8, check_timeout, dialect_of
from orinkit.client._shared.connection_string import ConnectArguments, evaluate
from orinkit.core.errors import CallError, OrinError
from orinkit.core.hresult import signed
from orinkit.core.i18n import printable, tr
from orinkit.transport.address import parse_address
from orinkit.transport.registry import examples

Owner: TypeAlias = orinkit.Controller | orinkit.Robot | orinkit.Task | orinkit.Extension | orinkit.File

_OF_DENSO: Final = ("caoprov.denso.", "ve026a")
_DESCRIPTION_TIMEOUT: Final = 1.0  # s
_MAX_DESCRIPTION: Final = 1000  # characters
CONNECTION = Group(tr("Connection"), sort_key=8)
OBJECT = Group(tr("Object"), sort_key=7)

Url: TypeAlias = Annotated[
    str,
    Parameter(
        help=tr(
            "Address of the controller: {examples}. A host name alone means TCP. A connection string is accepted, "
            'too: "Server=192.168.0.1, UDP=True".',
            examples=examples(),
        )
    ),
]
SlaveModeUrl: TypeAlias = Annotated[
    str,
    Parameter(
        help=tr(
            "Address of the controller: {examples}. A host name alone means TCP. A connection string is accepted, "
            'too: "Server=192.168.0.1, UDP=True".',
            examples=examples(slave_mode=True),
        )
    ),
]
Capture: TypeAlias = Annotated[
    str | None,
    Parameter(help=tr("Write every packet to a new pcapng file, for Wireshark (see orinkit dissector).")),
]
RobotId: TypeAlias = Annotated[
    int | None,
    Parameter(
        group=OBJECT,
        converter=whole_number,
        help=tr("Number of the robot, if the controller has two: 0 for the first one, 1 for the second one."),
    ),
]
Json: TypeAlias = Annotated[bool, Parameter(help=tr("Print one JSON document, with bytes in hex and dates in ISO 8601."))]  # fmt: skip


@Parameter(name="*", group=CONNECTION)
@dataclass(frozen=True)
class ConnectionOptions:
    """Options of the connection."""

    provider: Annotated[
        str,
        Parameter(help=tr("Provider name; CaoProv.DENSO.VRC9 for RC9 and COBOTTA PRO.")),
    ] = RC8
    timeout: Annotated[
        float | None,
        Parameter(
            help=tr(
                "Time-out in seconds for connecting and for each call (3 by default); over UDP and serial "
                "lines for each attempt (0.5)."
            )
        ),
    ] = None
    trace: Annotated[bool, Parameter(help=tr("Print every packet to stderr."))] = False
    tries: Annotated[
        int,
        Parameter(help=tr("How many times to send a request over UDP and serial lines if no reply arrives, 1 to 7.")),
    ] = DEFAULT_TRIES

    dialect: Annotated[
        str | None,
        Parameter(help=tr("rc8 or ve026a; by default determined from the provider and the version.")),
    ] = None

    token_file: Annotated[
        str | None,
        Parameter(help=tr("File with the token for an HTTP server.")),
    ] = None
    charset: Annotated[
        str,
        Parameter(help=tr("Encoding of text over e-CAP: utf-8 or shift_jis.")),
    ] = "utf-8"
    cafile: Annotated[
        str | None,
        Parameter(help=tr("PEM file with the CA certificates that verify an https server.")),
    ] = None

    machine: Annotated[
        str,
        Parameter(help=tr("Machine name for Controller_Connect; behind a gateway it selects the controller.")),
    ] = LOCALHOST
    option: Annotated[
        str | None,
        Parameter(
            help=tr(
                "Option string for Controller_Connect; depends on the provider, for example "
                '"Interface=socketcan, Channel=can0, Address=1" with CaoProv.Waco.ABH3.'
            ),
        ),
    ] = None
    capture: Capture = None

    def known_dialect(self, url: str) -> Dialect:
        """Return the dialect that the options determine; RC8 if they do not determine one."""
        return dialect_of(self.dialect, self.with_url(url).provider) or RC8_DIALECT

    def with_url(self, url: str) -> ConnectArguments:
        """Return the options together with those of a connection string in place of the URL."""
        return evaluate(
            ConnectArguments(url, self.provider, self.machine, self.option or "", self._timeout(), self.tries)
        )

    def open(self, url: str, alive: float | None = None, trace: Trace | None = None) -> orinkit.Controller:
        """Connect to the controller; for ``alive`` see :func:`orinkit.connect`.

        Args:
            url: Address of the controller.
            alive: See :func:`orinkit.connect`.
            trace: Callback instead of the option ``--trace``.
        """
        return orinkit.connect(
            url,
            provider=self.provider,
            machine=self.machine,
            option=self.option or "",
            timeout=self._timeout(),
            tries=self.tries,
            trace=trace or self.tracer(url),
            dialect=self.dialect,
            token=self._token(),
            cafile=self.cafile or "",
            alive=alive,
            charset=self.charset,
        )

    @contextmanager
    def opened(self, url: str, alive: float | None = None) -> Iterator[orinkit.Controller]:
        """Connect for the duration of a ``with`` statement; add the controller's own description to errors of calls.

        Args:
            url: Address of the controller.
            alive: See :func:`orinkit.connect`.
        """
        with self.open(url, alive) as controller, self.described(url, controller):
            yield controller

    @contextmanager
    def described(self, url: str, controller: orinkit.Controller) -> Iterator[None]:
        """Add the controller's own description to errors of calls."""
        try:
            yield
        except CallError as error:
            if not error.detail and not _is_denso(self.with_url(url).provider):
                error.detail = _description(controller, error)
            raise

    def open_client(self, url: str) -> orinkit.Client:
        """Open the connection without calling Controller_Connect."""
        return orinkit.open_client(
            url,
            timeout=self._timeout(),
            tries=self.tries,
            trace=self.tracer(url),
            token=self._token(),
            cafile=self.cafile or "",
            charset=self.charset,
        )

    def _timeout(self) -> float | None:
        return None if self.timeout is None else check_timeout(self.timeout, "--timeout")

    def _token(self) -> str:
        if self.token_file is None:
            return ""
        token = read_token(self.token_file)
        warn_of_exposure("--token-file", self.token_file)
        return token

    def capture_file(self, url: str) -> Trace | None:
        """Create the file of ``--capture``; return the callback that writes packets to it; None without this option."""
        if self.capture is None:
            return None
        from orinkit.cli._shared.capture import CaptureFile

        return CaptureFile(self.capture, parse_address(self.with_url(url).url))

    def tracer(self, url: str) -> Trace | None:
        """Return the callback for packets that ``--trace`` and ``--capture`` require; None without these options."""
        callbacks: list[Trace] = [Transcript(print_packet)] if self.trace else []
        capture = self.capture_file(url)
        if capture is not None:
            callbacks.append(capture)
        if len(callbacks) < 2:
            return callbacks[0] if callbacks else None

        def both(direction: str, data: bytes) -> None:
            for callback in callbacks:
                callback(direction, data)

        return both


def _is_denso(provider: str) -> bool:
    """Return True if the provider is one of DENSO's, whose return codes are in the table of orinkit."""
    name = provider.strip().casefold()
    return not name or any(known in name for known in _OF_DENSO)


def _description(controller: orinkit.Controller, error: CallError) -> str:
    """Return the controller's description of an error; ``""`` if it adds nothing to the text of the return code."""
    client = controller.client
    # these limits also apply to the calls that disconnect, because the error must be reported soon
    client.timeout, client.tries = min(client.timeout, _DESCRIPTION_TIMEOUT), 1
    try:
        words = controller.execute("GetErrorDescription", signed(error.code))
    except (OrinError, KeyboardInterrupt):  # the original error matters more than its description
        return ""
    if not isinstance(words, str) or words.strip() in ("", error.info.en, error.info.ja):
        return ""
    return printable(" ".join(words.split()), _MAX_DESCRIPTION)


def print_packet(packet: TracedPacket) -> None:
    """Print a packet to stderr."""
    for line in packet.lines():
        print(line, file=sys.stderr)


def robot_option(number: int | None) -> str:
    """Return the option of Controller_GetRobot for a robot number; ``None`` for the default of the controller."""
    return "" if number is None else f"ID={number}"


@Parameter(name="*", group=OBJECT)
@dataclass(frozen=True)
class OwnerOptions:
    """Options that select the object that owns a variable: without these options, the controller."""

    robot: Annotated[str | None, Parameter(help=tr("Name of a robot."))] = None
    robot_id: RobotId = None
    task: Annotated[str | None, Parameter(help=tr("Name of a task."))] = None
    extension: Annotated[str | None, Parameter(help=tr("Name of an extension board."))] = None
    file: Annotated[str | None, Parameter(help=tr("Name of a file."))] = None

    def of(self, controller: orinkit.Controller) -> Owner:
        """Return the object that the options name; the controller if no option is set."""
        named = [name for name in ("robot", "task", "extension", "file") if getattr(self, name) is not None]
        if len(named) > 1:
            options = " ".join(f"--{name}" for name in named)
            raise usage_error(tr("give only one of {options}", options=options))
        if self.robot is not None:
            return controller.robot(self.robot, robot_option(self.robot_id))
        if self.robot_id is not None:
            raise usage_error(tr("--robot-id requires --robot"))
        if self.task is not None:
            return controller.task(self.task)
        if self.extension is not None:
            return controller.extension(self.extension)
        return controller.file(self.file) if self.file is not None else controller
