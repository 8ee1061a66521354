"""``orinkit shell``: an interactive session that keeps its connection.

The commands of the session are those of the command line, without the address: they run the same functions, on the
connection of the session.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Annotated, Any, Final

from cyclopts import App, Parameter

from orinkit.cao.functions import FUNCTIONS
from orinkit.cli._shared.connection import ConnectionOptions, Json, OwnerOptions, Url, robot_option
from orinkit.cli._shared.errors import usage_error
from orinkit.cli._shared.line_editor import LineEditor, history_file
from orinkit.cli._shared.session import Session
from orinkit.cli.app import DONE, INTERRUPTED, bare_app, guarded
from orinkit.cli.commands import call as calling
from orinkit.cli.commands import functions as listing
from orinkit.cli.commands import get as reading
from orinkit.cli.commands import info as informing
from orinkit.cli.commands import move as motions
from orinkit.cli.commands import put as writing
from orinkit.cli.commands import raw as raw_packets
from orinkit.core.i18n import tr
from orinkit.values.notation import format_variant

_CONNECTION: Final = ConnectionOptions()
_OWNING: Final = OwnerOptions()
_OTHER: Final = calling.ObjectOptions()
_PROMPT: Final = "orinkit> "
_COMMENT: Final = "#"


def shell(
    url: Url,
    /,
    *,
    keep_going: Annotated[bool, Parameter(help=tr("Continue a script after an error."))] = False,
    alive: Annotated[
        float,
        Parameter(
            help=tr(
                "Seconds without signs of life of the session after which the server stops the arm, 0.3 to 3600; 0 omits "
                "the option Alive of Service_Start."
            )
        ),
    ] = 0.0,
    connection: ConnectionOptions = _CONNECTION,
) -> int:
    """Read commands and execute them on one connection; the command help lists them.

    Ctrl-C ends the current call and halts a robot that the session has set in motion, Ctrl-D ends the session. If the
    input is not a terminal, it is a script: the first error ends it.
    """
    session = Session(url, connection, alive or None)
    commands = ShellCommands(session)
    session.connect()
    try:
        if sys.stdin.isatty():
            return _interact(commands)
        return _run_script(commands, sys.stdin, keep_going=keep_going)
    finally:
        session.close()


# --- the commands -----------------------------------------------------------------------------------------------------


class ShellCommands:
    """The commands of a session.

    Args:
        session: The session.

    Attributes:
        session: The session.
        ended: True after the command quit.
        names: Names of the commands.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.ended = False
        self._app = self._build()
        self.names = sorted(name for name in self._app if not name.startswith("-"))

    def run(self, line: str) -> int:
        """Execute a line and return the exit code; errors are printed to stderr."""
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            return DONE
        return guarded(lambda: self._app(_words(line)))

    def _build(self) -> App:
        app = bare_app("", tr("Commands of the session; Ctrl-D ends it."))
        app.version_flags = ()
        app.usage = "COMMAND"
        app["--help"].help = tr("Show this help.")
        table: tuple[tuple[Callable[..., Any], str, str], ...] = (
            (self.get, "get [OPTIONS] NAME", tr("Read a variable of a controller.")),
            (self.put, "put [OPTIONS] NAME VALUE...", tr("Write a variable of a controller.")),
            (self.call, "call [OPTIONS] FUNCTION [ARGS...]", tr("Call any CAO function; the handle is inserted.")),
            (self.execute, "execute [OPTIONS] COMMAND [VALUE...]", tr("Execute a command of the controller or an object.")),
            (self.move, "move [OPTIONS] POSE", tr("Move a robot to a pose.")),
            (self.info, "info [--json]", tr("Show information about a controller and its state.")),
            (self.functions, "functions [FILTER]", tr("List the {count} CAO functions.", count=len(FUNCTIONS))),
            (self.raw, "raw [--hex] HEX...", tr("Send raw packets in hex and explain the replies.")),
            (self.trace, "trace on|off", tr("Print every packet to stderr.")),
            (self.reconnect, "reconnect", tr("Close the connection and open it again.")),
            (self.help, "help [COMMAND]", tr("Show the commands, or the help of a command.")),
            (self.quit, "quit", tr("End the session.")),
        )  # fmt: skip
        for number, (command, usage, text) in enumerate(table):
            app.command(command, name=usage.partition(" ")[0], usage=usage, sort_key=number, help=text)
        return app

    def get(self, name: reading.Name, /, *, owning: OwnerOptions = _OWNING, json: Json = False) -> None:
        """Read a variable and print its value."""
        reading.get(self.session.url, name, owning=owning, connection=self.session.connection, json=json)

    def put(
        self, name: reading.Name, /, *value: writing.Text, owning: OwnerOptions = _OWNING, json: Json = False
    ) -> None:
        """Write a variable."""
        writing.put(self.session.url, name, *value, owning=owning, connection=self.session.connection, json=json)

    def call(
        self,
        function: Annotated[str, Parameter(help=tr("Id, name or Python name of the function."))],
        /,
        *args: Annotated[str, Parameter(help=tr("Arguments after the handle, as for orinkit call."))],
        owning: OwnerOptions = _OWNING,
        other: calling.ObjectOptions = _OTHER,
        json: Json = False,
    ) -> None:
        """Call a function and print its result."""
        entry = calling.find(function)
        held = self.session.connection
        with self.session.following(entry, args, owning.robot, robot_option(owning.robot_id)) as robot:
            if entry.interface == "Robot" and other.handle is None:
                other = replace(other, handle=robot)
            calling.call(self.session.url, function, *args, owning=owning, other=other, connection=held, json=json)

    def execute(
        self,
        command: Annotated[str, Parameter(help=tr("Name of the command: ClearError, TakeArm."))],
        /,
        *parameter: Annotated[str, Parameter(help=tr("Values; several numbers form an array, as for orinkit put."))],
        owning: OwnerOptions = _OWNING,
        json: Json = False,
    ) -> None:
        """Execute a command of the controller, or of the object that an option names."""
        given = [kind for kind in ("robot", "task", "extension", "file") if getattr(owning, kind) is not None]
        values = [format_variant(writing.read_values(parameter))] if parameter else []
        name = f"{given[0] if given else 'controller'}_execute"
        self.call(name, command, *values, owning=owning, json=json)

    def move(
        self,
        pose: Annotated[str, Parameter(help=tr("Target pose, as for orinkit move."))],
        /,
        *,
        line: Annotated[bool, Parameter(help=tr("Move the tool along a straight line."))] = False,
        speed: Annotated[float | None, Parameter(help=tr("Speed in percent; 100 by default."))] = None,
        mark: Annotated[str | None, Parameter(help=tr("Pass mark: @0, @E, @P or @10."))] = None,
        json: Json = False,
    ) -> None:
        """Move a robot to a pose; Ctrl-C halts it."""
        held = self.session.connection
        motions.move(self.session.url, pose, line=line, speed=speed, mark=mark, connection=held, json=json)

    def info(self, *, json: Json = False) -> None:
        """Show information about the controller."""
        informing.info(self.session.url, connection=self.session.connection, json=json)

    def functions(self, name: Annotated[str, Parameter(help=tr("Part of the name."))] = "", /) -> None:
        """List the functions whose name contains a text."""
        listing.functions(name or None)

    def raw(
        self,
        *hex_bytes: Annotated[
            str, Parameter(name="HEX", required=True, help=tr("Packets in hex, as for orinkit raw."))
        ],
        hex: Annotated[bool, Parameter(help=tr("Print only the hex of the replies."))] = False,  # noqa: A002 - the name of the option
    ) -> int:
        """Send packets unchanged on the connection of the session."""
        from orinkit.bcap.profiles import STREAM, BcapProfile

        client = self.session.controller.client
        profile = client.profile if isinstance(client.profile, BcapProfile) else STREAM
        missing = 0
        for number, data in enumerate(raw_packets.read_packets(hex_bytes, profile), 1):
            with self.session.noticing_loss():
                reply = client.send_raw(data)
            if reply is not None:
                raw_packets.show_packet(reply, data, only_hex=hex)
            else:
                missing += 1
                print(raw_packets.no_reply(number, client.timeout), file=sys.stderr)
        return int(missing > 0)

    def trace(self, state: Annotated[str, Parameter(help=tr("on or off."))] = "on", /) -> None:
        """Print every packet to stderr, or stop printing."""
        if state not in ("on", "off"):
            raise usage_error(tr("trace cannot be {state!r}. Try: trace on, trace off", state=state))
        self.session.tracing = state == "on"

    def reconnect(self) -> None:
        """Close the connection and open it again."""
        self.session.connect()

    def help(self, command: Annotated[str, Parameter(help=tr("Name of a command."))] = "", /) -> None:
        """Show the commands, or the help of a command."""
        self._app([*([command] if command else []), "--help"])

    def quit(self) -> None:
        """End the session."""
        self.ended = True


def _words(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError as error:
        raise usage_error(tr("invalid quotes: {error}", error=error)) from None


# --- input ------------------------------------------------------------------------------------------------------------


def _interact(commands: ShellCommands) -> int:
    from orinkit.cli._shared.session_words import SessionWords

    session = commands.session
    print(tr("connected to {url}; help lists the commands, Ctrl-D ends the session", url=session.url))
    with LineEditor(SessionWords(session, commands.names), history_file()) as editor:
        while not commands.ended:
            try:
                line = editor.read(_PROMPT)
            except EOFError:
                print()
                break
            except KeyboardInterrupt:
                print()
                guarded(session.halt)
                continue
            commands.run(line)
    return DONE


def _run_script(commands: ShellCommands, lines: Iterable[str], *, keep_going: bool) -> int:
    """Execute the lines of a script; return the exit code of the first error."""
    first = DONE
    for line in lines:
        code = commands.run(line.rstrip("\n"))
        first = first or code
        if commands.ended or code == INTERRUPTED or (code and not keep_going):
            break
    return first
