"""Serve devices: the options, the listeners, the ``ready`` lines and the stop on a signal."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, AsyncExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from orinkit.bcap.profiles import LONGEST_ON_LINE, line_profile
from orinkit.cao.provider import Provider
from orinkit.cli._shared.collector import collect_as_usual
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.cli._shared.http import HttpServerOptions
from orinkit.cli._shared.interrupts import termination_signals
from orinkit.cli._shared.listen_addresses import LISTENING, ListenAddresses, listen_addresses_class
from orinkit.cli._shared.memory import return_large_blocks
from orinkit.core import logs
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.server.accepting import install_exception_handler
from orinkit.server.aio_group import AsyncServerGroup, ServerParameters
from orinkit.server.aio_server import DEFAULT_URL, AsyncServer
from orinkit.server.alive_option import ALIVE, check_alive
from orinkit.server.capacity import DEFAULT_CLIENTS
from orinkit.server.http.options import HttpOptions
from orinkit.transport.address import Address, is_loopback, parse_address
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after

if TYPE_CHECKING:
    ServerListenAddresses = ListenAddresses
else:
    ServerListenAddresses = listen_addresses_class()

_SWITCH_INTERVAL: Final = 0.0005  # s; with the default, 5 ms, busy threads delay the emergency stop by up to 200 ms
_NOWHERE: Final = ServerListenAddresses()
_HTTP: Final = HttpServerOptions()


@Parameter(name="*", group=LISTENING)
@dataclass(frozen=True)
class ServerOptions:
    """Addresses to listen on, and limits for clients."""

    listen: ServerListenAddresses = _NOWHERE
    http: HttpServerOptions = _HTTP
    clients: Annotated[int, Parameter(converter=whole_number, help=tr("Maximum number of clients at a time."))] = (
        DEFAULT_CLIENTS
    )
    clients_per_address: Annotated[
        int | None,
        Parameter(
            converter=whole_number,
            help=tr("Maximum number of clients from one IP address; three quarters of --clients by default."),
        ),
    ] = None
    objects: Annotated[
        int,
        Parameter(converter=whole_number, help=tr("Maximum number of objects of one client.")),
    ] = 1000
    dead_after: Annotated[
        float,
        Parameter(help=tr("Seconds after which the connection to an unreachable TCP client is closed.")),
    ] = DEAD_AFTER
    alive: Annotated[
        float,
        Parameter(
            help=tr(
                "Seconds without signs of life after which a client is disconnected while its arm moves; applies "
                "to UDP, serial lines, and HTTP without a persistent connection."
            )
        ),
    ] = ALIVE
    serial_packet: Annotated[
        int,
        Parameter(
            converter=whole_number,
            help=tr(
                "Maximum bytes of a packet on a serial line; 503 for clients with DENSO's libraries, "
                "which drop longer replies."
            ),
        ),
    ] = LONGEST_ON_LINE
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), help=tr("Log at debug level."))] = False


def check(listening: ServerOptions) -> None:
    """Check numbers and addresses before anything is opened.

    Raises:
        CommandError: If a number is out of its range, or an address belongs to another transport than its option.
        InvalidAddress: If an address is not valid.
    """
    numbers = {
        "--clients": listening.clients,
        "--clients-per-address": listening.clients_per_address,
        "--objects": listening.objects,
    }
    for option, number in numbers.items():
        if number is not None and number < 1:
            raise usage_error(tr("{option} must be 1 or more, not {number}", option=option, number=number))
    try:
        check_dead_after(listening.dead_after)
        check_alive(listening.alive)
        line_profile(listening.serial_packet)
    except InvalidValue as error:
        text = str(error).replace("dead_after", "--dead-after").replace("alive", "--alive")
        raise CommandError(text.replace("serial_packet", "--serial-packet"), 2) from None
    _urls(listening)
    _http_options(listening)


@dataclass(frozen=True, slots=True)
class PendantListener:
    """A second listener, for ``orinkit pendant`` on this machine only.

    Attributes:
        provider: The provider to serve.
        url: Address of the listener, checked by :func:`check_control`.
        publish_secret: Function that returns a context manager for a port. The context manager makes the secret
            available to commands of the same account, and yields the lines to print about the secret.
    """

    provider: Provider
    url: str
    publish_secret: Callable[[int], AbstractContextManager[Sequence[str]]]


def check_control(url: str) -> None:
    """Refuse a control port that other machines could reach, because it gives access to every button of the pendant.

    Raises:
        CommandError: If the URL is not a TCP address of a loopback interface.
        InvalidAddress: If the URL is not a valid address.
    """
    address = parse_address(url)
    if not isinstance(address, Address) or address.scheme != "tcp" or not is_loopback(address.host):
        raise usage_error(
            tr(
                "--control {url}: only loopback addresses are allowed. Try: 127.0.0.1:5008 or [::1]:5008",
                url=url,
            ),
        )


def begin_log(listening: ServerOptions) -> None:
    """Send the log to stderr; :func:`run` calls this function, which other code needs only to log earlier."""
    if not listening.verbose:  # httpx2 logs every request of a gateway
        logging.getLogger("httpx2").setLevel(logging.WARNING)
    logs.to_stderr(logging.DEBUG if listening.verbose else logging.INFO)


def run(
    providers: Sequence[Provider],
    listening: ServerOptions,
    *,
    before: Sequence[str] = (),
) -> int:
    """Serve devices until SIGINT, SIGTERM or SIGHUP.

    When all listeners are ready, print to stdout: the lines of ``before``, and ``ready URL`` for each listener.
    """
    begin_log(listening)
    asyncio.run(_serve([providers], listening, (), before))
    return 0


def run_many(
    hosts: Sequence[Sequence[Provider]], listening: ServerOptions, controls: Sequence[PendantListener] = ()
) -> int:
    """Serve several controllers like :func:`run`, each on the next port of each address.

    Also print ``ready control URL`` and the lines about its secret for each control port.

    Args:
        hosts: The providers of each controller.
        listening: The addresses of the first controller, and the limits of each.
        controls: The control ports.
    """
    begin_log(listening)
    asyncio.run(_serve(hosts, listening, controls, ()))
    return 0


async def _serve(
    hosts: Sequence[Sequence[Provider]],
    listening: ServerOptions,
    controls: Sequence[PendantListener],
    before: Sequence[str],
) -> None:
    stop = asyncio.Event()
    return_large_blocks()
    install_exception_handler(asyncio.get_running_loop())
    with _set_by_signals(stop):
        async with AsyncExitStack() as servers:
            server = _server(hosts, listening)
            await servers.enter_async_context(server)
            for warning in _warnings(listening):  # not earlier: an address that cannot be used is not reachable
                print(warning, file=sys.stderr)
            ready = [*before, *(f"ready {url}" for url in server.urls)]
            for control in controls:
                second = AsyncServer(
                    control.provider, control.url, per_address=DEFAULT_CLIENTS
                )  # all are on this machine
                await servers.enter_async_context(second)
                said = servers.enter_context(control.publish_secret(_port(second.url)))
                ready += [f"ready control {second.url}", *said]
            sys.setswitchinterval(_SWITCH_INTERVAL)
            collect_as_usual()
            for line in ready:
                print(line, flush=True)
            await stop.wait()


def _server(hosts: Sequence[Sequence[Provider]], listening: ServerOptions) -> AsyncServer | AsyncServerGroup:
    parameters = ServerParameters(
        clients=listening.clients,
        per_address=listening.clients_per_address,
        objects=listening.objects,
        dead_after=listening.dead_after,
        alive=listening.alive,
        http=_http_options(listening),
        serial_packet=listening.serial_packet,
    )
    urls = _urls(listening)
    if len(hosts) == 1:  # its addresses need no ports
        return AsyncServer(hosts[0], *urls, **parameters)
    return AsyncServerGroup(hosts, *urls, **parameters)


@contextmanager
def _set_by_signals(stop: asyncio.Event) -> Iterator[None]:
    """Set the event on SIGINT, SIGTERM or SIGHUP; the same signal a second time ends the process immediately."""
    loop = asyncio.get_running_loop()

    def handle(number: int, _frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)
        loop.call_soon_threadsafe(stop.set)

    # signal.signal because Windows does not support loop.add_signal_handler
    before = {number: signal.signal(number, handle) for number in termination_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _urls(listening: ServerOptions) -> list[str]:
    """Return the URLs to listen on.

    Raises:
        CommandError: If an address belongs to another transport than its option.
        InvalidAddress: If an address is not valid.
    """
    secure = listening.http.secure
    return [transport.url(address, secure=secure) for transport, address in listening.listen.items()] or [DEFAULT_URL]


def _http_options(listening: ServerOptions) -> HttpOptions:
    return listening.http.options(served=any(transport.http for transport, _ in listening.listen.items()))


def _port(url: str) -> int:
    address = parse_address(url)
    return address.port if isinstance(address, Address) else 0


def _warnings(listening: ServerOptions) -> Iterator[str]:
    """Yield a warning for each way in which unauthorized clients could use the device."""
    access = listening.http
    for transport, address in listening.listen.items():
        host = getattr(parse_address(transport.url(address, secure=access.secure)), "host", "")
        if host and not is_loopback(host) and not (transport.http and access.token_file is not None):
            yield _warning(
                address, tr("--token-file is not set") if transport.http else tr("b-CAP has no authentication")
            )
    for text in access.exposures():
        yield tr("orinkit: warning: {text}", text=text)
    beside = dict.fromkeys(f"--{transport.scheme}" for transport, _ in listening.listen.items() if not transport.http)
    if access.token_file is not None and beside:
        options = ", ".join(beside)
        yield tr(
            "orinkit: warning: --token-file protects --http only; b-CAP has no token: any client that can connect "
            "to the address of {options} can use the device",
            options=options,
        )


def _warning(url: str, reason: str) -> str:
    return tr(
        "orinkit: warning: {url} is reachable from other machines, and {reason}: any client that "
        "reaches it can use the device",
        url=url,
        reason=reason,
    )
