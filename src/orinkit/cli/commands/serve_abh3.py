"""``orinkit serve abh3``: virtual ABH3 motor drivers on a CAN bus."""

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

from orinkit.cli._shared.errors import CommandError, unusable, whole_number
from orinkit.cli._shared.interrupts import ending
from orinkit.cli._shared.places import LISTENING, ListenAddresses, places_class
from orinkit.cli._shared.serving import ServerOptions, begin_log, check, run
from orinkit.cli._shared.web import HttpServerOptions
from orinkit.cli.abh3.bus import BusOptions, Url, joined, whole_numbers
from orinkit.core.i18n import tr
from orinkit.transport.address import CanAddress

if TYPE_CHECKING:
    from orinkit.virtual.abh3 import VirtualABH3

_DRIVER: Final = Group(tr("Driver"), sort_key=7)
_MODE: Final = re.compile(r"([0-7])=(\d{1,4})", re.ASCII)
_BROADCASTS: Final = 8
_LOOK: Final = 0.1  # s between two looks whether there was a signal


if TYPE_CHECKING:
    AdmittingPlaces = ListenAddresses
else:
    AdmittingPlaces = places_class(
        tr(
            "HOST:PORT to let CAO clients in at, or PORT alone for 127.0.0.1; may be given again. "
            "Port 0 takes a free one. Without these options nobody is let in."
        )
    )

_NOWHERE: Final = AdmittingPlaces()
_WEB: Final = HttpServerOptions()


@Parameter(name="*", group=LISTENING)
@dataclass(frozen=True)
class ProviderOptions(ServerOptions):
    """Where CAO clients are let in, if anywhere."""

    at: AdmittingPlaces = _NOWHERE
    web: HttpServerOptions = _WEB  # said again: the annotation is looked up in this module


_BUS: Final = BusOptions()
_ADMITTING: Final = ProviderOptions()


def serve_abh3(
    url: Url = None,
    /,
    *,
    address: Annotated[
        tuple[int, ...],
        Parameter(
            group=_DRIVER,
            converter=whole_numbers,
            show_default=joined,
            help=tr("Address of the driver, 0 to 253; may be given again for several drivers on the bus."),
        ),
    ] = (1,),
    host: Annotated[
        int,
        Parameter(group=_DRIVER, converter=whole_number, help=tr("Address of the host that it obeys.")),
    ] = 2,
    any_host: Annotated[
        bool, Parameter(group=_DRIVER, help=tr("It obeys every host."))
    ] = False,
    group: Annotated[
        int,
        Parameter(group=_DRIVER, converter=whole_number, help=tr("Group of its broadcasts, 0 to 31.")),
    ] = 5,
    dialect: Annotated[
        str,
        Parameter(group=_DRIVER, help=tr("v1, the document's, or v2 of 2023.")),
    ] = "v1",
    load_unit: Annotated[
        float,
        Parameter(group=_DRIVER, help=tr("It counts loads in 1 or 0.1 %.")),
    ] = 1.0,
    model: Annotated[
        str,
        Parameter(
            group=_DRIVER,
            help=tr("What is commanded: motor (A and B), or travel (Y moves, X turns)."),
        ),
    ] = "motor",
    broadcast: Annotated[
        tuple[str, ...],
        Parameter(
            group=_DRIVER,
            help=tr("Send a broadcast unasked: 2=100 sends number 2 every 100 ms; may be given again."),
        ),
    ] = (),
    single_period: Annotated[
        int | None,
        Parameter(
            group=_DRIVER,
            converter=whole_number,
            help=tr("Send the feedback every so many ms too, 1 to 1000; only when asked by default."),
        ),
    ] = None,
    command_timeout: Annotated[
        int,
        Parameter(
            group=_DRIVER,
            converter=whole_number,
            help=tr("ms without a command after which it stops; 0 for never."),
        ),
    ] = 500,
    error_timeout: Annotated[
        int,
        Parameter(
            group=_DRIVER,
            converter=whole_number,
            help=tr("ms without a command after which that is an error; 0 for never."),
        ),
    ] = 1000,
    time_scale: Annotated[
        float,
        Parameter(
            group=_DRIVER,
            help=tr("How many seconds of the driver pass in one real second."),
        ),
    ] = 1.0,
    bus: BusOptions = _BUS,
    listening: ProviderOptions = _ADMITTING,
) -> int:  # fmt: skip
    """Serve virtual ABH3 drivers on a CAN bus, which is told on stdout as "ready URL". Stops on SIGINT, SIGTERM and SIGHUP.

    With an address, as --tcp HOST:PORT, CAO clients are let in too: CaoProv.Waco.ABH3 on this bus, "ready URL" for each.
    """
    served = any(listening.at.given())
    check(listening)
    at = bus.address(url)
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


def _serve(drivers: list[VirtualABH3], at: CanAddress, cao: tuple[ServerOptions, dict[str, Any]] | None) -> int:
    """Serve drivers until a signal comes.

    Args:
        drivers: to serve.
        at: bus to serve them on.
        cao: where CAO clients are let in, and what holds where they say nothing.
    """
    from orinkit.can.server import serve_can

    with serve_can(*drivers, at=str(at)) as server:
        if cao is not None:
            from orinkit.abh3.provider.provider import ABH3Provider

            return run([ABH3Provider(server.url, **cao[1])], cao[0], before=(f"ready {server.url}",))
        with _told_to_stop() as wait:
            if at.interface == "virtual":
                print(_only_here(), file=sys.stderr)
            print(f"ready {server.url}", flush=True)
            wait()
    return 0


def _only_here() -> str:
    return tr(
        "orinkit: warning: the interface virtual is within one process: no other program can "
        "reach this driver. Try: --interface udp_multicast"
    )


@contextmanager
def _told_to_stop() -> Iterator[Callable[[], None]]:
    """Give what waits for SIGINT, SIGTERM or SIGHUP; the same signal a second time ends the process at once."""
    told: list[int] = []  # no threading.Event: to set one here, while wait() holds its lock, would wait for ever

    def handle(number: int, _frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)
        told.append(number)

    def wait() -> None:
        while not told:
            sleep(_LOOK)

    before = {number: signal.signal(number, handle) for number in ending()}
    try:
        yield wait
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _drivers(addresses: tuple[int, ...], settings: dict[str, Any], time_scale: float) -> list[VirtualABH3]:
    """Return the drivers.

    Raises:
        Failure, InvalidValue: a setting cannot be.
    """
    from orinkit.virtual.abh3 import Parameters, VirtualABH3
    from orinkit.virtual.clock import Clock

    try:
        clock = Clock(time_scale)
    except ValueError as error:
        raise CommandError(str(error), 2) from None
    return [VirtualABH3(Parameters(address=address, **settings), clock=clock) for address in addresses]


def _period(milliseconds: int) -> int:
    """Return a period for single packets: 0 and -1 mean other things to a driver.

    Raises:
        Failure: it is less than 1.
    """
    if milliseconds < 1:
        raise unusable(
            tr("--single-period must be 1 to 1000 ms, not {milliseconds}", milliseconds=milliseconds),
        )
    return milliseconds


def _modes(given: tuple[str, ...]) -> tuple[int, ...]:
    """Return for each broadcast how many ms are between two; 0 for when asked.

    Raises:
        Failure: one cannot be read.
    """
    modes = [0] * _BROADCASTS
    for text in given:
        match = _MODE.fullmatch(text)
        if match is None:
            raise unusable(
                tr("--broadcast {text}: N=MS is needed, as 2=100: number 0 to 7, 1 to 1000 ms", text=text),
            )
        modes[int(match[1])] = int(match[2])
    return tuple(modes)
