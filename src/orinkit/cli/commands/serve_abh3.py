"""``orinkit serve abh3``: serve virtual ABH3 motor drivers on a CAN bus."""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import sleep
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Group, Parameter

from orinkit.cli._shared.collector import collect_as_usual
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.cli._shared.http import HttpServerOptions
from orinkit.cli._shared.interrupts import termination_signals
from orinkit.cli._shared.listen_addresses import LISTENING, ListenAddresses, listen_addresses_class
from orinkit.cli._shared.serving import ServerOptions, begin_log, check, run
from orinkit.cli.abh3.bus import BusOptions, Url, default_text, whole_numbers
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from orinkit.virtual.abh3 import VirtualABH3

_DRIVER: Final = Group(tr("Driver"), sort_key=6)
_MODE: Final = re.compile(r"([0-7])=(\d{1,4})", re.ASCII)
_BROADCASTS: Final = 8
_POLL: Final = 0.1  # s between two checks for a signal
_PTY: Final = "pty://"
_VIRTUAL: Final = "can://virtual/"


if TYPE_CHECKING:
    CaoListenAddresses = ListenAddresses
else:
    CaoListenAddresses = listen_addresses_class(
        tr(
            "HOST:PORT to listen on for CAO clients, or PORT alone for 127.0.0.1; may be repeated. Port 0 selects "
            "a free port. If no option for an address to listen on is given, CAO clients cannot connect."
        )
    )

_NOWHERE: Final = CaoListenAddresses()
_HTTP: Final = HttpServerOptions()


@Parameter(name="*", group=LISTENING)
@dataclass(frozen=True)
class CaoListenOptions(ServerOptions):
    """Addresses to listen on for CAO clients; none by default."""

    listen: CaoListenAddresses = _NOWHERE
    http: HttpServerOptions = _HTTP  # repeated because annotations are resolved in this module


_BUS: Final = BusOptions()
_LISTENING: Final = CaoListenOptions()


def serve_abh3(
    url: Url = None,
    /,
    *,
    address: Annotated[
        tuple[int, ...],
        Parameter(
            group=_DRIVER,
            converter=whole_numbers,
            show_default=default_text,
            help=tr("Address of the driver, 0 to 253. Repeat the option to put several drivers on the bus."),
        ),
    ] = (1,),
    host: Annotated[
        int,
        Parameter(group=_DRIVER, converter=whole_number, help=tr("Address of the host whose commands the driver accepts.")),
    ] = 2,
    any_host: Annotated[
        bool, Parameter(group=_DRIVER, help=tr("Accept commands of every host."))
    ] = False,
    group: Annotated[
        int,
        Parameter(group=_DRIVER, converter=whole_number, help=tr("Broadcast group, 0 to 31.")),
    ] = 5,
    dialect: Annotated[
        str,
        Parameter(group=_DRIVER, help=tr("v1 (as in the manufacturer's document) or v2 (2023 and later).")),
    ] = "v1",
    load_unit: Annotated[
        float,
        Parameter(group=_DRIVER, help=tr("Unit of load values in %: 1 or 0.1.")),
    ] = 1.0,
    model: Annotated[
        str,
        Parameter(
            group=_DRIVER,
            help=tr("Axis model. motor: the commands apply to the motors A and B. travel: the commands apply to "
                "travelling (Y) and turning (X)."),
        ),
    ] = "motor",
    broadcast: Annotated[
        tuple[str, ...],
        Parameter(
            group=_DRIVER,
            help=tr("Send a broadcast periodically: 2=100 sends broadcast 2 every 100 ms; may be repeated."),
        ),
    ] = (),
    single_period: Annotated[
        int | None,
        Parameter(
            group=_DRIVER,
            converter=whole_number,
            help=tr("Send the feedback also periodically, with this period in ms (1 to 1000); by default only on "
                "request."),
        ),
    ] = None,
    command_timeout: Annotated[
        int,
        Parameter(
            group=_DRIVER,
            converter=whole_number,
            help=tr("Time in ms without a command after which the driver stops; 0 for never."),
        ),
    ] = 500,
    error_timeout: Annotated[
        int,
        Parameter(
            group=_DRIVER,
            converter=whole_number,
            help=tr("Time in ms without a command after which the driver reports an error; 0 for never."),
        ),
    ] = 1000,
    time_scale: Annotated[
        float,
        Parameter(
            group=_DRIVER,
            help=tr("Simulated seconds per real second."),
        ),
    ] = 1.0,
    bus: BusOptions = _BUS,
    listening: CaoListenOptions = _LISTENING,
) -> int:  # fmt: skip
    """Serve virtual ABH3 drivers on a CAN bus; print "ready URL" for the bus. Stop on SIGINT, SIGTERM or SIGHUP.

    With an address such as --tcp HOST:PORT, also serve the provider CaoProv.Waco.ABH3 for this bus to CAO clients, and
    print "ready URL" for each listener.

    With the URL pty://, the bus is a pseudo-terminal of this machine, which one program can open: the printed URL.
    """
    served = any(listening.listen.items())
    check(listening)
    at = _PTY if url == _PTY and bus == BusOptions() else str(bus.address(url))
    period = -1 if single_period is None else _period(single_period)
    settings = {
        "host": None if any_host else host, "group": group, "dialect": dialect, "load_unit": load_unit, "model": model,
        "broadcast_modes": _modes(broadcast), "single_mode": period,
        "command_timeout": command_timeout, "error_timeout": error_timeout,
    }  # fmt: skip
    drivers = _drivers(address, settings, time_scale)
    begin_log(listening)
    defaults = {"host": host, "group": group, "dialect": dialect, "load_unit": load_unit, "address": address[0]}
    return _serve(drivers, at, (listening, defaults) if served else None)


def _serve(drivers: list[VirtualABH3], at: str, cao: tuple[ServerOptions, dict[str, Any]] | None) -> int:
    """Serve drivers until a signal arrives.

    Args:
        drivers: The drivers.
        at: Address of the bus to serve them on.
        cao: The server options for CAO clients, and the defaults for the connection options that a client omits;
            ``None`` if CAO clients are not served.
    """
    from orinkit.can.server import serve_can

    with serve_can(*drivers, at=at) as server:
        if cao is not None:
            from orinkit.abh3.provider.provider import ABH3Provider

            return run([ABH3Provider(server.url, **cao[1])], cao[0], before=(f"ready {server.url}",))
        with _wait_for_signals() as wait:
            if at.startswith(_VIRTUAL):
                print(_only_here(), file=sys.stderr)
            collect_as_usual()
            print(f"ready {server.url}", flush=True)
            wait()
    return 0


def _only_here() -> str:
    return tr(
        "orinkit: warning: the interface virtual works within one process only: no other program can "
        "reach this driver. Try: --interface udp_multicast"
    )


@contextmanager
def _wait_for_signals() -> Iterator[Callable[[], None]]:
    """Yield a function that waits for SIGINT, SIGTERM or SIGHUP.

    The same signal a second time ends the process immediately.
    """
    received: list[int] = []  # not a threading.Event: set() in a handler would deadlock while wait() holds its lock

    def handle(number: int, _frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)
        received.append(number)

    def wait() -> None:
        while not received:
            sleep(_POLL)

    before = {number: signal.signal(number, handle) for number in termination_signals()}
    try:
        yield wait
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _drivers(addresses: tuple[int, ...], settings: dict[str, Any], time_scale: float) -> list[VirtualABH3]:
    """Return the drivers.

    Raises:
        CommandError, InvalidValue: If a setting is invalid.
    """
    from orinkit.virtual.abh3 import Parameters, VirtualABH3
    from orinkit.virtual.clock import Clock

    try:
        clock = Clock(time_scale)
    except ValueError as error:
        raise CommandError(str(error), 2) from None
    return [VirtualABH3(Parameters(address=address, **settings), clock=clock) for address in addresses]


def _period(milliseconds: int) -> int:
    """Return the period of single packets in ms after checking it, because 0 and -1 have other meanings for a driver.

    Raises:
        CommandError: If the period is less than 1 ms.
    """
    if milliseconds < 1:
        raise usage_error(
            tr("--single-period must be 1 to 1000 ms, not {milliseconds}", milliseconds=milliseconds),
        )
    return milliseconds


def _modes(given: tuple[str, ...]) -> tuple[int, ...]:
    """Return the period of each broadcast in ms; 0 if it is sent on request only.

    Raises:
        CommandError: If a text does not have the form N=MS.
    """
    modes = [0] * _BROADCASTS
    for text in given:
        match = _MODE.fullmatch(text)
        if match is None:
            raise usage_error(
                tr("--broadcast {text}: not N=MS with N from 0 to 7 and MS from 1 to 1000. Try: 2=100", text=text),
            )
        modes[int(match[1])] = int(match[2])
    return tuple(modes)
