"""The address of a controller behind a gateway, and the settings for connecting to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao import functions as f
from orinkit.cao.dialect import DIALECTS, Dialect
from orinkit.client._async.client import AsyncClient
from orinkit.client._shared.common import dialect_of, service_option
from orinkit.client._shared.endpoint import access_to, opening_of
from orinkit.core.validation import check_range
from orinkit.transport.registry import resolve, row_of
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

LOCAL: Final = "localhost"
"""The default machine name of clients (RC8 3.1.2)."""

_MAX_SECONDS: Final = 1e6


class ConnectRequest(NamedTuple):
    """The arguments of a client's Controller_Connect."""

    name: str
    provider: str
    machine: str
    option: str


@dataclass(frozen=True, slots=True)
class Upstream:
    """The address of a controller behind a gateway, and the settings for connecting to it.

    Attributes:
        url: URL of the controller: ``tcp://192.168.0.1:5007``, ``udp://...``,
            ``serial:///dev/ttyUSB0?baudrate=38400``, ``http://...``.
        timeout: Time-out of a call in s; on UDP and serial lines, the time-out of each attempt. S_EXECUTING from the
            controller restarts the time-out. The default depends on the transport.
        tries: Maximum number of times that a request is sent on UDP and serial lines, 1 to 7.
        service: Option string of Service_Start; the default is that of :func:`orinkit.connect`.
        dialect: Dialect of the controller, ``"rc8"`` or ``"ve026a"``.
        machine: Machine name to send to the controller. The default is the machine name in the client's
            Controller_Connect, or ``localhost`` if the gateway selected this upstream by its name.
        token: Access token for HTTP.
        cafile: PEM file of CA certificates for verifying an https server.
        retry: Minimum time in s between two attempts to connect. The time doubles after each failure, up to ten times
            this setting.
        keep_alive: Idle time in s after which a keep-alive (Controller_GetName) is sent, so that the controller does
            not end the client's session; 0 for no keep-alives. The default on UDP and HTTP is a third of the time after
            which a controller ends an idle session; the default on TCP and serial lines is 0.
        dead_after: Time in s after which a TCP connection is considered lost if the controller's network stack does not
            reply: 2 to 7,200.
        limits: Limits on the size of received packets and on the values in them.

    Raises:
        InvalidAddress: If the URL is invalid.
        InvalidValue: If another setting is invalid.
        MissingExtra: If the URL is an HTTP address and httpx2 is not installed.
    """

    url: str
    timeout: float | None = None
    tries: int = DEFAULT_TRIES
    service: str | None = None
    dialect: str = "rc8"
    machine: str = ""
    token: str = field(default="", repr=False)
    cafile: str = ""
    retry: float = 0.5
    keep_alive: float | None = None
    dead_after: float = DEAD_AFTER
    limits: PacketLimits = DEFAULT_LIMITS

    def __post_init__(self) -> None:
        address, _, _ = opening_of(self.url, self.timeout, self.tries)
        access_to(address, self.token, self.cafile)
        resolve(row_of(address).aio_link)  # imports HTTP now, because the slow import would delay clients later
        dialect_of(self.dialect, self.url)
        check_range("retry", self.retry, 0, _MAX_SECONDS, seconds=True)
        check_dead_after(self.dead_after)
        if self.keep_alive is not None:
            check_range("keep_alive", self.keep_alive, 0, _MAX_SECONDS, seconds=True)

    @property
    def spoken(self) -> Dialect:
        """The dialect that ``dialect`` names."""
        return DIALECTS[self.dialect.lower()]

    @property
    def machine_names(self) -> tuple[str, ...]:
        """The machine names that select this controller: its host, and its host with the port.

        ``localhost`` without a port selects no controller, because it is the default machine name of clients. A
        controller on a serial line has no machine name.
        """
        address, _, _ = opening_of(self.url, self.timeout, self.tries)
        host, port = getattr(address, "host", "").lower(), getattr(address, "port", 0)
        if not host:
            return ()
        if ":" in host:
            return host, f"[{host}]", f"{host}:{port}", f"[{host}]:{port}"
        return (f"{host}:{port}",) if host == LOCAL else (host, f"{host}:{port}")

    async def open(self, wanted: ConnectRequest) -> tuple[AsyncClient, int]:
        """Connect to the controller for one client; return the connection and the handle of the controller object.

        This method calls Service_Start and Controller_Connect.

        Args:
            wanted: Arguments of the client's Controller_Connect.

        Raises:
            OrinError: As for :func:`orinkit.connect`.
        """
        client = await AsyncClient.open(
            self.url,
            timeout=self.timeout,
            tries=self.tries,
            limits=self.limits,
            token=self.token,
            cafile=self.cafile,
            dead_after=self.dead_after,
        )
        try:
            client.use_dialect(self.spoken)
            option = service_option(self.service, client.profile, client.dialect, client.timeout)
            await client.call(f.service_start, option)
            handle = await client.call(f.controller_connect, *wanted)
        except BaseException:
            await client.close()
            raise
        return client, handle
