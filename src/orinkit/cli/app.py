"""Entry point of the command line: registers the commands and turns errors into messages and exit codes."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from cyclopts import App, CycloptsError, Group, Parameter

import orinkit
from orinkit.cli._shared.errors import CommandError, usage_text
from orinkit.cli._shared.help import HelpFormatter
from orinkit.cli._shared.terminal import screened
from orinkit.core.errors import InvalidAddress, InvalidValue, MissingExtra, NotationError, OrinError
from orinkit.core.i18n import tr

DONE: Final = 0
FAILED: Final = 1
USAGE: Final = 2
INTERRUPTED: Final = 130

_USAGE_ERRORS: Final = (InvalidAddress, InvalidValue, NotationError)


def build() -> App:
    """Return the command line in the current language; the module of a command is imported on first use."""
    app = bare_app(
        "orinkit",
        tr(
            "Control and simulate DENSO robot controllers (b-CAP) and ABH3 motor drivers (CAN). "
            "Start with: orinkit demo\n"
            "\nThe language follows LANG; ORINKIT_LANG=en or ORINKIT_LANG=ja overrides it."
        ),
    )
    serve = App(
        name="serve",
        help=tr("Serve a virtual controller or your own device on the network."),
        sort_key=2,
    )
    serve.command(
        "orinkit.cli.commands.serve_rc8:serve_rc8",
        name="rc8",
        help=tr("Serve a virtual RC8 robot controller."),
    )
    serve.command(
        "orinkit.cli.commands.serve_ve026a:serve_ve026a",
        name="ve026a",
        help=tr("Serve a virtual VE026A, a small arm with a serial line."),
    )
    serve.command(
        "orinkit.cli.commands.serve_abh3:serve_abh3",
        name="abh3",
        usage="orinkit serve abh3 [URL] [OPTIONS]",
        help=tr("Serve virtual ABH3 motor drivers on a CAN bus."),
    )
    serve.command(
        "orinkit.cli.commands.serve_device:serve_device",
        name="device",
        help=tr("Serve your own devices, written in Python."),
    )
    app.command("orinkit.cli.demo.rc8:demo", name="demo", sort_key=1, usage="orinkit demo [OPTIONS] [DEVICE]", help=tr("Run a client against a virtual RC8 or VE026A and explain every packet."))  # fmt: skip
    app.command(serve)
    app.command(_command_of("get"), name="get", sort_key=3, help=tr("Read a variable of a controller."))  # fmt: skip
    app.command(_command_of("put"), name="put", sort_key=4, help=tr("Write a variable of a controller."))  # fmt: skip
    app.command(_command_of("call"), name="call", sort_key=5, help=tr("Call any CAO function."))  # fmt: skip
    app.command(_command_of("info"), name="info", sort_key=6, help=tr("Show information about a controller and its state."))  # fmt: skip
    app.command(_command_of("decode"), name="decode", sort_key=7, help=tr("Explain b-CAP packets in hex, field by field."))  # fmt: skip
    app.command(_command_of("dissector"), name="dissector", sort_key=8, help=tr("Write a dissector of b-CAP for Wireshark."))  # fmt: skip
    app.command(_command_of("functions"), name="functions", sort_key=9, usage="orinkit functions [OPTIONS] [FILTER]", help=tr("List the CAO functions."))  # fmt: skip
    app.command(_command_of("pendant"), name="pendant", sort_key=10, usage="orinkit pendant [OPTIONS] URL ACTION [VALUE...]", help=tr("Operate the pendant of a virtual RC8."))  # fmt: skip
    app.command(_command_of("move"), name="move", sort_key=11, help=tr("Move a robot to a pose."))  # fmt: skip
    app.command(_command_of("stream"), name="stream", sort_key=12, help=tr("Execute a trajectory in slave mode."))  # fmt: skip
    app.command(_command_of("plot"), name="plot", sort_key=13, help=tr("Plot a recorded motion."))  # fmt: skip
    app.command(_command_of("gateway"), name="gateway", sort_key=14, usage="orinkit gateway --upstream URL [OPTIONS]", help=tr("Forward calls to other controllers, over any protocol."))  # fmt: skip
    app.command(_command_of("raw"), name="raw", sort_key=7, usage="orinkit raw URL|OPTIONS HEX...", help=tr("Send raw packets in hex and explain the replies."))  # fmt: skip
    app.command(_command_of("shell"), name="shell", sort_key=6, help=tr("Open an interactive session with a controller."))  # fmt: skip
    app.command(_command_of("tester"), name="tester", sort_key=2, usage="orinkit tester [OPTIONS] [URL ...]", help=tr("Open the Tester in a browser: connections, objects, packets, motions, the arm in 3D."))  # fmt: skip
    abh3 = _abh3()
    app.command(abh3)
    for each in (app, serve, abh3):
        _translate_flags(each)
    return app


def bare_app(name: str, text: str) -> App:
    """Return a command line without commands.

    Args:
        name: Name of the program.
        text: Help text.
    """
    return App(
        name=name,
        help=text,
        version=orinkit.__version__,
        help_format="plaintext",
        help_formatter=HelpFormatter(),
        group_commands=Group(tr("Commands")),
        group_arguments=Group(tr("Arguments"), sort_key=1),
        group_parameters=Group(tr("Options"), sort_key=9),
        default_parameter=Parameter(negative=()),
        suppress_keyboard_interrupt=False,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )


def _abh3() -> App:
    app = App(name="abh3", sort_key=15, help=tr("ABH3 motor drivers on a CAN bus: monitor, decode logs, run motors, generate a DBC file."))  # fmt: skip
    app.command("orinkit.cli.abh3.commands:monitor", name="monitor", sort_key=1, usage="orinkit abh3 monitor [URL] [OPTIONS]", help=tr("Show and decode the frames on a bus."))  # fmt: skip
    app.command("orinkit.cli.abh3.commands:decode", name="decode", sort_key=2, help=tr("Decode the frames of a log."))  # fmt: skip
    app.command("orinkit.cli.abh3.commands:dbc", name="dbc", sort_key=3, help=tr("Print a DBC file of all frames: orinkit abh3 dbc > abh3.dbc"))  # fmt: skip
    app.command("orinkit.cli.abh3.drive:drive", name="drive", sort_key=4, usage="orinkit abh3 drive [URL] --seconds S [--ay N] [--bx N] [OPTIONS]", help=tr("Run the motors of a driver for some seconds."))  # fmt: skip
    return app


def _command_of(name: str) -> str:
    return f"orinkit.cli.commands.{name}:{name}"


def _translate_flags(app: App) -> None:
    app["--help"].help = tr("Show this help.")
    app["--version"].help = tr("Show the version.")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Args:
        argv: Arguments without the program name; by default those of the process.
    """
    _escape_unencodable()
    with screened():
        return guarded(lambda: build()(list(sys.argv[1:] if argv is None else argv)))


def guarded(run: Callable[[], int | None]) -> int:
    """Run a command; an error becomes one line on stderr and an exit code."""
    try:
        code = run() or DONE
        if sys.stdout is not None:  # stdout is None if the shell has closed it (>&-)
            sys.stdout.flush()
    except CycloptsError as error:
        return _report(usage_text(error), USAGE)
    except CommandError as error:
        return _report(str(error), error.code)
    except _USAGE_ERRORS as error:
        return _report(str(error), USAGE)
    except OrinError as error:
        return _report(str(error), FAILED)
    except KeyboardInterrupt:
        return _report(tr("interrupted"), INTERRUPTED)
    except BrokenPipeError:  # the reader has closed the pipe, as in "orinkit functions | head"
        _discard_stdout()
        return FAILED
    except Exception as error:
        if os.environ.get("ORINKIT_TRACEBACK"):
            raise
        if isinstance(error.__cause__, MissingExtra):  # the import of a command's module failed
            return _report(str(error.__cause__), FAILED)
        if isinstance(error, OSError):
            _discard_stdout()  # at exit, Python would write the rest of its buffer and report the same error again
            return _report(_os_error_text(error), FAILED)
        kind, hint = type(error).__name__, "ORINKIT_TRACEBACK=1"
        text = tr("unexpected {kind}: {error}. Try: {hint} for a traceback", kind=kind, error=error, hint=hint)
        return _report(text, FAILED)
    return code


def _report(text: str, code: int) -> int:
    if sys.stderr is not None:  # with file=None, print would write to stdout
        with suppress(OSError):
            print(f"orinkit: {' '.join(text.split())}", file=sys.stderr)
    return code


def _os_error_text(error: OSError) -> str:
    """Return the system's error message with the file name, if there is one."""
    reason = error.strerror or str(error) or type(error).__name__
    what = reason if error.filename is None else f"{error.filename}: {reason}"
    return tr("reading or writing failed: {what}", what=what)


def _discard_stdout() -> None:
    """Redirect stdout to the null device if it cannot be written to."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except (OSError, ValueError):  # ValueError: stdout is closed
        with suppress(OSError, ValueError):  # stdout may not have a file descriptor
            number = sys.stdout.fileno()
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)


def _escape_unencodable() -> None:
    """Print characters that the terminal's encoding lacks (Japanese) as escapes instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
