"""The connection of an interactive session, which the commands of the session share."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import orinkit
from orinkit.cao.table import Function
from orinkit.cli._shared.connection import ConnectionOptions, print_packet
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli._shared.transcript import Transcript
from orinkit.core.errors import OrinError, ProtocolError, TransportError
from orinkit.core.i18n import tr
from orinkit.rc8.motion_calls import MOVING, leaves_moving

_RobotKey: TypeAlias = tuple[str, str]
"""Name of a robot, and the option of Controller_GetRobot."""


class Session:
    """A connection to a controller that stays open until it is closed or lost.

    Args:
        url: Address of the controller.
        options: Options of the connection.
        alive: See :func:`orinkit.connect`.

    Attributes:
        url: Address of the controller.
        tracing: True to print every packet to stderr.
        connection: The options with which the other commands use this connection.
    """

    def __init__(self, url: str, options: ConnectionOptions, alive: float | None = None) -> None:
        self.url = url
        self.tracing = options.trace
        self.connection = HeldConnection(provider=options.provider, session=self)
        self._options = options
        self._alive = alive
        self._transcript = Transcript(print_packet)
        self._capture = options.capture_file(url)
        self._controller: orinkit.Controller | None = None
        self._robots: dict[_RobotKey, orinkit.Robot] = {}
        self._moving: set[_RobotKey] = set()

    @property
    def controller(self) -> orinkit.Controller:
        """The connected controller.

        Raises:
            CommandError: If the connection was lost.
        """
        if self._controller is None:
            raise CommandError(tr("there is no connection to {url}. Try: reconnect", url=self.url))
        return self._controller

    @property
    def connected(self) -> bool:
        """True unless the connection was lost."""
        return self._controller is not None

    def connect(self) -> None:
        """Open the connection.

        Raises:
            OrinError: If the connection cannot be opened.
        """
        self.close()
        self._controller = self._options.open(self.url, self._alive, self._trace)

    def close(self) -> None:
        """Close the connection; the controller releases all objects."""
        self._robots.clear()
        controller, self._controller = self._controller, None
        if controller is not None:
            with suppress(OrinError):
                controller.close()

    @contextmanager
    def noticing_loss(self) -> Iterator[None]:
        """Close the session if a call shows that the connection is lost, or if the call is interrupted.

        After an interruption, the client has closed the connection. It is opened again, and the robots that may be
        moving are halted.
        """
        try:
            yield
        except TransportError:
            self.close()
            raise
        except ProtocolError as error:
            if error.fatal:
                self.close()
            raise
        except KeyboardInterrupt:
            self._recover()
            raise

    def _recover(self) -> None:
        moving = set(self._moving)
        try:
            self.controller.get_name()
        except (OrinError, CommandError):
            self.connect()
        self._moving = moving
        self.halt()

    def halt(self) -> None:
        """Halt the robots that calls of this session have set in motion."""
        for key in sorted(self._moving):
            self.controller.robot(*key).halt()
            self._moving.discard(key)
            print(tr("robot {name} halted", name=" ".join(filter(None, key))), file=sys.stderr)

    @contextmanager
    def following(
        self, function: Function[..., Any], arguments: tuple[str, ...], robot: str | None, option: str = ""
    ) -> Iterator[int | None]:
        """Keep the handle of a robot during the session, and remember whether a call leaves the robot moving.

        The ``with`` statement returns the handle, ``None`` without a robot. Other objects are released after each call.

        Args:
            function: The function to call.
            arguments: Its arguments without the handle.
            robot: Name of the robot; ``None`` if the call does not apply to a robot.
            option: Option of Controller_GetRobot.
        """
        if robot is None:
            yield None
            return
        key = robot, option
        if key not in self._robots:
            with self.noticing_loss():
                self._robots[key] = self.controller.robot(*key)
        moves = leaves_moving(function, arguments)
        was_moving = key in self._moving
        if function.id in MOVING:
            self._moving.add(key)  # if the call is interrupted
        yield self._robots[key].handle
        if moves is False or (moves is None and not was_moving):
            self._moving.discard(key)

    def _trace(self, direction: str, data: bytes) -> None:
        if self._capture is not None:
            self._capture(direction, data)
        if self.tracing:
            self._transcript(direction, data)
            self._transcript.packets.clear()


@dataclass(frozen=True)
class HeldConnection(ConnectionOptions):
    """Options whose connection is that of a session; commands that connect use the open connection."""

    session: Session = field(kw_only=True)

    @contextmanager
    def opened(self, url: str, alive: float | None = None) -> Iterator[orinkit.Controller]:
        """Return the controller of the session for the duration of a ``with`` statement; it stays connected."""
        controller = self.session.controller
        with self.session.noticing_loss(), self.described(self.session.url, controller):
            yield controller

    def open_client(self, url: str) -> orinkit.Client:
        """Refuse a connection of its own.

        Raises:
            CommandError: Always.
        """
        raise usage_error(
            tr("the session calls this function itself. Try: reconnect, or orinkit call outside the session")
        )
