"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``_async_client.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

from orinkit.bcap.client import Conversation, Reply, Trace
from orinkit.cao.table import Function
from orinkit.client._common import DEFAULT_TIMEOUT, Garbage, check_timeout
from orinkit.errors import ConnectionLost, ProtocolError
from orinkit.transport.address import parse_address
from orinkit.transport.drive import LentLink, Link, run
from orinkit.transport.tcp import TcpLink
from orinkit.variant_bytes import DEFAULT_LIMITS, Limits

P = ParamSpec("P")
R = TypeVar("R")


class Client:
    """Raw calls over one connection; the objects below are built on it.

    Calls are carried out one at a time; several threads may use one client. A call that times out leaves
    the connection in step: its answer, should it come, is dropped.

    Attributes:
        timeout: seconds that a call waits for its answer; every S_EXECUTING from the controller starts it anew.
    """

    def __init__(
        self,
        link: Link,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        limits: Limits = DEFAULT_LIMITS,
        trace: Trace | None = None,
    ) -> None:
        self._timeout = check_timeout(timeout)
        self._link: Link = link
        self._conversation = Conversation(limits, trace)
        self._lock = threading.RLock()
        self.garbage = Garbage()

    @property
    def timeout(self) -> float:
        """Seconds that a call waits for its answer; may be set."""
        return self._timeout

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self._timeout = check_timeout(seconds)

    @classmethod
    def open(
        cls,
        url: str,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        limits: Limits = DEFAULT_LIMITS,
        trace: Trace | None = None,
    ) -> Self:
        """Open a connection and nothing more: Service_Start is yours to call.

        Args:
            url: ``tcp://host:port`` or ``tcp:host:port``.
            timeout: seconds for connecting and for each call.
            limits: bounds on what is received.
            trace: is told every packet: ``">"`` or ``"<"``, and its bytes.

        Raises:
            InvalidAddress: the URL cannot be used.
            ConnectFailed: nobody there.
        """
        link = TcpLink(parse_address(url), check_timeout(timeout))
        return cls(link, timeout=timeout, limits=limits, trace=trace)

    def call(self, function: Function[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function of the table (:mod:`orinkit.functions`) and return its result.

        Raises:
            TypeError: the arguments are not the function's.
            InvalidValue: an argument does not fit its type; nothing was sent.
            CallError: the controller answered with an error code.
            CallTimeout: it did not answer in time.
            ConnectionLost: the connection broke.
            ProtocolError: what came back is not b-CAP.
        """
        arguments = function.bind(args, kwargs)
        with self._lock:
            _, result = self._carry(function, arguments, self._timeout)
        value: R = result
        return value

    def request(
        self, function: Function[..., Any], *arguments: Any, timeout: float | None = None, exact: bool = False
    ) -> Reply:
        """Like :meth:`call`, with the success code beside the result.

        Args:
            function: an entry of the table.
            arguments: its arguments.
            timeout: seconds, instead of the client's.
            exact: give the result as a :class:`~orinkit.variant.Variant` with its type.
        """
        seconds = self.timeout if timeout is None else check_timeout(timeout)
        bound = function.bind(arguments, {})
        with self._lock:
            return Reply(*self._carry(function, bound, seconds, exact))

    def _carry(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool = False,
    ) -> tuple[int, Any]:
        try:
            return run(self._conversation.call(function, arguments, seconds, exact=exact), self._link)
        except ConnectionLost:
            self._link.close()
            raise
        except ProtocolError as error:
            if error.fatal:
                self._link.close()
            raise

    def descriptor(self) -> int:
        """Return the descriptor of the connection, to be given to another process."""
        return self._link.fileno()

    def lend(self, closing: Callable[[], None]) -> int:
        """Lend the connection to another process: until it is taken back, every call here is refused.

        Args:
            closing: is called when the connection is closed here meanwhile.

        Returns:
            serial number of the next request.
        """
        self._link.fileno()  # whoever has it receives from now on
        self._link = LentLink(self._link, closing)
        return self._conversation.serial

    def take_back(self, serial: int) -> None:
        """Use the connection again.

        Args:
            serial: of the next request.
        """
        if isinstance(self._link, LentLink):
            self._link = self._link.link
        self._conversation.serial = serial

    def abandon(self) -> None:
        """Leave the connection to the other process for good; here it is closed."""
        if isinstance(self._link, LentLink):
            self._link = self._link.link
        self._link.release()

    @property
    def dropped(self) -> int:
        """How many answers came late, twice, or for nobody."""
        return self._conversation.dropped

    def close(self) -> None:
        """Close the connection at once; the controller then releases every object of it."""
        self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
