"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``client.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from random import randint
from types import TracebackType
from typing import Any, Final, ParamSpec, Self, TypeVar

from orinkit.bcap.client import sign_of_life
from orinkit.bcap.profiles import DEFAULT_TRIES, STREAM
from orinkit.cao.dialect import Dialect
from orinkit.cao.functions import controller_connect, controller_get_name
from orinkit.cao.replies import Reply, Trace
from orinkit.cao.table import Function
from orinkit.cao.transport_profile import TransportProfile
from orinkit.client._shared.common import HandleTable, check_deadline, check_timeout, check_tries, forgotten_after
from orinkit.client._shared.endpoint import (
    access_to,
    another,
    beside,
    closing_deadline,
    conversation,
    opening_of,
    parting,
    share,
)
from orinkit.core import hresult
from orinkit.core.errors import CallError, ConnectFailed, ConnectionLost, ProtocolError
from orinkit.rc8.motion_calls import MOVING
from orinkit.transport.fork_safety import keep_from_children
from orinkit.transport.keepalive import KeepAlive, take_now
from orinkit.transport.links import open_link
from orinkit.transport.runner import Deadline, DetachedLink, Link, run, send_close
from orinkit.transport.tcp_keepalive import DEAD_AFTER, check_dead_after
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits

_LAST_SERIAL: Final = 0xFFFF
_BEAT: Final = 0.5  # s between signs of life
_SIGNS: Final = 4  # within the time that was promised
P = ParamSpec("P")
R = TypeVar("R")


class Client:
    """Raw calls over one connection; the objects below are built on it.

    Calls are carried out one at a time; several threads may use one client. A call that times out leaves
    the connection in step: its answer, should it come, is dropped.

    Where packets may be lost (UDP, serial lines), a request that is not answered in time is sent again, and the
    controller carries it out once: it knows a request again.

    Args:
        link: to the controller.
        timeout: seconds, see below; by default what is usual on the profile.
        tries: see below.
        limits: bounds on what is received; those of the profile count too.
        trace: is told every packet, or body of e-CAP: ``">"`` or ``"<"``, and its bytes.
        profile: how calls travel over the link.

    Attributes:
        timeout: seconds that a call waits for its answer, on UDP and serial lines in each of its tries; every
            S_EXECUTING from the controller starts it anew.
        tries: how often a request is sent in all on UDP and serial lines, 1 to 7.
        profile: how calls travel.
        deadline: seconds that a call may take in all, S_EXECUTING or not; ``None`` (the default) for no such limit.
    """

    def __init__(
        self,
        link: Link,
        *,
        timeout: float | None = None,
        tries: int = DEFAULT_TRIES,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        profile: TransportProfile = STREAM,
    ) -> None:
        self._timeout = check_timeout(profile.timeout if timeout is None else timeout)
        self._tries = check_tries(tries)
        self._link: Link = link
        self._conversation = conversation(profile, limits, trace)
        if profile.shared:  # answers to the client before it may be under way still: they are not to fit
            self._conversation.serial = randint(1, _LAST_SERIAL)  # noqa: S311 - no secret
        self._lock = threading.RLock()
        self._left = False
        self._deadline: float | None = None
        self._end: Deadline | None = None  # of connecting, or closing
        self.handles = HandleTable()
        keep_from_children(self)
        self._pulse: KeepAlive | None = None
        self._quiet = Deadline(0.0)  # passes when the program has not called anything for a while
        self._every = _BEAT
        self._second: Client | None = None  # says that it lives while a call is at work, where one link cannot
        self._controller = 0
        self._beats = bool(profile.memory or profile.shared)  # where no connection tells that the program lives
        self._remembered = (
            Deadline(profile.memory) if profile.memory else None
        )  # how long the controller knows this client

    @property
    def timeout(self) -> float:
        """Seconds that a call waits for its answer, on UDP and serial lines in each of its tries; may be set."""
        return self._timeout

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self._timeout = check_timeout(seconds)

    @property
    def deadline(self) -> float | None:
        """Seconds that a call may take in all, S_EXECUTING or not; ``None`` (the default) for no such limit; may be set."""
        return self._deadline

    @deadline.setter
    def deadline(self, seconds: float | None) -> None:
        self._deadline = check_deadline(seconds)

    @property
    def tries(self) -> int:
        """How often a request is sent in all on UDP and serial lines; may be set (RC8 table 5-1: TORetry)."""
        return self._tries

    @tries.setter
    def tries(self, number: int) -> None:
        self._tries = check_tries(number)

    @property
    def dialect(self) -> Dialect:
        """Dialect of the controller; may be set once it is known."""
        return self._conversation.dialect

    @dialect.setter
    def dialect(self, dialect: Dialect) -> None:
        self._conversation.dialect = dialect

    @property
    def echoes(self) -> bool:
        """Whether the last answer had its request's reserved field, as those of a VE026A (UDP, serial lines)."""
        return self._conversation.echoes_reserved

    @property
    def profile(self) -> TransportProfile:
        """How calls travel."""
        return self._conversation.profile

    @classmethod
    def open(
        cls,
        url: str,
        *,
        timeout: float | None = None,
        tries: int = DEFAULT_TRIES,
        limits: PacketLimits = DEFAULT_LIMITS,
        trace: Trace | None = None,
        token: str = "",
        cafile: str = "",
        dead_after: float = DEAD_AFTER,
        deadline: float | None = None,
    ) -> Self:
        """Open a connection and nothing more: Service_Start is yours to call.

        Args:
            url: ``tcp://host:port``, ``udp://host:port`` or ``serial:///dev/ttyUSB0?baudrate=38400&parity=N&bits=8&stop=1&flow=0``;
                ``tcp:host:port``, ``udp:host:port`` and ``com:1:38400:N:8:1:0`` too. ``http://host:port/path`` and
                ``https://...`` for e-CAP.
            timeout: seconds for connecting and for each call; with UDP and serial lines for each try of a call, so that
                it may take ``timeout * tries`` in all. By default 3.0 with TCP and HTTP, 0.5 with the others; a slow
                serial line needs longer where packets are long. A server of e-CAP that cannot say that it is at work,
                as others than orinkit's, gets 180 s for a call.
            tries: how often a request is sent in all with UDP and serial lines, 1 to 7: below is 1, above is 7
                (RC8 table 5-1: TORetry). With TCP and HTTP nothing is sent twice.
            limits: bounds on what is received; a packet with UDP has at most 504 bytes, on a serial line 65,536.
            trace: is told every packet, or body of e-CAP: ``">"`` or ``"<"``, and its bytes.
            token: for HTTP, what lets a client in; it is sent as ``Authorization: Bearer``.
            cafile: for https, a PEM file of certificates that the server's is to be signed by, instead of the system's.
            dead_after: seconds without an answer from the controller's machine after which a TCP connection counts as
                lost (cable pulled, machine off): 2 to 7,200.
            deadline: seconds that opening may take in all, if less than the time-out; that of calls is
                :attr:`Client.deadline`.

        Raises:
            InvalidAddress: the URL cannot be used.
            InvalidValue: timeout, tries or dead_after cannot be used.
            ConnectFailed: nobody there; with UDP and HTTP that shows with the first call.
            MissingExtra: serial lines need serialx, HTTP needs httpx2.
        """
        address, profile, seconds = opening_of(url, timeout, tries)
        seconds = min(seconds, check_deadline(deadline) or seconds)
        link = open_link(
            address, seconds, access_to(address, token, cafile), limits.packet, check_dead_after(dead_after)
        )
        return cls(link, timeout=timeout, tries=tries, limits=limits, trace=trace, profile=profile)

    def call(self, function: Function[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function of the table (:mod:`orinkit.functions`) and return its result.

        Raises:
            TypeError: the arguments are not the function's.
            InvalidValue: an argument does not fit its type; nothing was sent.
            CallError: the controller answered with an error code.
            CallTimeout: it did not answer in time.
            ConnectFailed: with UDP and HTTP, nobody listens there.
            ConnectionLost: the connection broke.
            ProtocolError: what came back is not b-CAP, or not e-CAP.
        """
        arguments = function.bind(args, kwargs)
        with self._lock:
            _, result = self._carry(function, arguments, self._timeout)
        value: R = result
        return value

    def request(
        self,
        function: Function[..., Any],
        *arguments: Any,
        timeout: float | None = None,
        deadline: float | None = None,
        exact: bool = False,
    ) -> Reply:
        """Like :meth:`call`, with the success code beside the result.

        Args:
            function: an entry of the table.
            arguments: its arguments.
            timeout: seconds, of each try where there are several, instead of the client's.
            deadline: seconds that the call may take in all, instead of the client's.
            exact: give the result as a :class:`~orinkit.values.variant.Variant` with its type.
        """
        seconds = self.timeout if timeout is None else check_timeout(timeout)
        limit = check_deadline(deadline)
        bound = function.bind(arguments, {})
        with self._lock:
            return Reply(*self._carry(function, bound, seconds, exact, limit))

    def end_within(self, seconds: float | None) -> None:
        """Have all calls from now on end within so many seconds together; ``None`` for no such limit."""
        self._end = None if seconds is None else Deadline(seconds)

    def usual_deadline(self) -> float:
        """Return the seconds that connecting, or closing, may take in all unless the program says otherwise."""
        return closing_deadline(self._timeout, self._tries, self.profile)

    def _carry(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool = False,
        deadline: float | None = None,
    ) -> tuple[int, Any]:
        deadline = self._deadline if deadline is None else deadline
        if self._end is not None:
            deadline = min(self._end.left, self._end.left if deadline is None else deadline)
        if self._beats:
            return self._carry_and_beat(function, arguments, seconds, exact, deadline)
        return self._carry_now(function, arguments, seconds, exact, deadline)

    def promise(self, seconds: float, controller: int) -> None:
        """Show signs of life from now on, also while a call is at work: three and more within that time.

        To be called after Controller_Connect, and once. Where packets may be lost a call at work is shown by its tries, so
        :attr:`timeout` is shortened to a third of the time.

        Args:
            seconds: that the server has been told (``Alive=<ms>``).
            controller: handle of the controller.
        """
        self._beats, self._every, self._controller = True, seconds / _SIGNS, controller
        if self.profile.lossy:
            self._timeout = min(self._timeout, seconds / _SIGNS)
        share(self._link)
        link = another(self._link)
        if link is not None:
            self._second = type(self)(link, timeout=self._timeout, profile=self.profile)
        if self._pulse is not None:
            self._pulse.end()
        self._pulse = KeepAlive(self._show, self._every)

    def _show(self) -> None:
        """Show a sign of life: a call if nothing is at work, else something beside it."""
        if take_now(self._lock):
            try:
                if self._quiet.passed and not self._left:
                    self._carry_in_time(controller_get_name, (self._controller,), self._timeout, exact=False)
            finally:
                self._lock.release()
        elif self._second is not None:
            self._second.call(controller_get_name, self._controller)
        elif not self.profile.lossy:
            beside(self._link, sign_of_life(self._controller))

    def _carry_and_beat(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        deadline: float | None,
    ) -> tuple[int, Any]:
        """Carry out a call; with the first one that may begin a motion, begin to show signs of life (:meth:`_beat`)."""
        if function.id in MOVING and self._pulse is None and not self._left:
            self._pulse = KeepAlive(self._beat, _BEAT)
        try:
            code, result = self._carry_in_time(function, arguments, seconds, exact, deadline)
        finally:
            self._quiet = Deadline(self._every / 2)
        if function is controller_connect:
            self._controller = result.value if exact else result
        return code, result

    def _beat(self) -> None:
        """Ask for the controller's name, unless the program has just called something.

        A server stops the arm of a client that it does not hear where no connection tells that it is there.
        """
        with self._lock:
            if self._quiet.passed and not self._left:
                self._carry_in_time(controller_get_name, (self._controller,), self._timeout, exact=False)

    def _carry_in_time(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        deadline: float | None = None,
    ) -> tuple[int, Any]:
        """Carry out a call where the controller forgets a client that is silent, and say so where it has."""
        forgotten = self._remembered is not None and self._remembered.passed
        try:
            return self._carry_now(function, arguments, seconds, exact, deadline)
        except CallError as error:
            if forgotten and error.code == hresult.E_HANDLE:
                error.detail = forgotten_after(self.profile)
            raise
        finally:
            if self._remembered is not None:
                self._remembered = Deadline(self.profile.memory)

    def _carry_now(
        self,
        function: Function[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        exact: bool,
        deadline: float | None,
    ) -> tuple[int, Any]:
        try:
            operation = self._conversation.call(
                function, arguments, seconds, exact=exact, tries=self._tries, deadline=deadline
            )
            return run(operation, self._link, self._conversation.close_sequence)
        except (ConnectFailed, ConnectionLost):
            self._link.close()
            raise
        except ProtocolError as error:
            if error.fatal:
                self._link.close()
            raise

    def patience(self, command: str) -> float | None:
        """Return the time-out for a command, of each try, where the controller is known to take long for it."""
        longest = self.dialect.patience.get(str(command).strip().lower())
        if longest is None:
            return None
        return max(self._timeout, longest / self._tries if self.profile.lossy else longest)

    def _fileno(self) -> int:
        """Return the descriptor of the connection, to be given to another process."""
        return self._link.fileno()

    def _detach(self, closing: Callable[[], None]) -> int:
        """Lend the connection to another process: until it is taken back, every call here is refused.

        Args:
            closing: is called when the connection is closed here meanwhile.

        Returns:
            serial number of the next request.
        """
        self._link.fileno()  # whoever has it receives from now on
        self._link = DetachedLink(self._link, closing)
        return self._conversation.serial

    def _reattach(self, serial: int) -> None:
        """Use the connection again.

        Args:
            serial: of the next request.
        """
        if isinstance(self._link, DetachedLink):
            self._link = self._link.link
        self._conversation.serial = serial

    def _forfeit(self) -> None:
        """Leave the connection to the other process for good; here it is closed."""
        if isinstance(self._link, DetachedLink):
            self._link = self._link.link
        self._link.release()

    @property
    def dropped(self) -> int:
        """How many answers came late, twice, or for nobody."""
        return self._conversation.stray_replies

    def left_behind(self) -> Iterable[int]:
        """Be of no more use in a forked child, where a thread that held the lock is not there to give it back."""
        self._lock = threading.RLock()
        self._left, self._pulse = True, None
        return ()

    def close(self) -> None:
        """Close the connection at once; the controller then releases every object of it.

        With UDP and serial lines Service_Stop is sent before, and no answer is waited for; with HTTP for a second at most.
        """
        link = self._link
        if self._pulse is not None:
            self._pulse.end()
        second, self._second = self._second, None
        if second is not None:
            second._left = True
            second.close()
        try:
            words = [] if self._left else self._conversation.close_sequence()
            self._left = True
            if words:
                link = parting(link)
            send_close(link, words)
        finally:  # being cancelled, or interrupted, leaves nothing open
            link.close()
            self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
