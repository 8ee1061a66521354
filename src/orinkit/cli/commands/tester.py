"""``orinkit tester``: the browser-based Tester."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import Parameter

from orinkit.cli._shared.collector import collect_as_usual
from orinkit.cli._shared.errors import usage_error
from orinkit.cli._shared.listen_addresses import LISTENING
from orinkit.core import logs
from orinkit.core.errors import MissingExtra
from orinkit.core.i18n import tr

_PORT = 8450


def tester(
    *urls: Annotated[str, Parameter(name="URL", help=tr("Addresses of controllers to connect to."))],
    http: Annotated[
        str,
        Parameter(
            group=LISTENING,
            help=tr("Address of the web server: HOST:PORT. Port 0 selects a free port. If other machines can reach the "
                "address, users need the token that is printed."),
        ),
    ] = f"127.0.0.1:{_PORT}",
    allow_host: Annotated[
        tuple[str, ...],
        Parameter(group=LISTENING, help=tr("Further host name under which users reach the web server; may be repeated.")),
    ] = (),
    no_browser: Annotated[bool, Parameter(help=tr("Do not open a browser."))] = False,
    virtual: Annotated[
        tuple[str, ...],
        Parameter(help=tr("Virtual controller to start: rc8, ve026a or abh3; may be repeated.")),
    ] = (),
) -> int:  # fmt: skip
    """Serve the Tester; print "ready http://HOST:PORT". Stop on SIGINT, SIGTERM or SIGHUP."""
    host, port = _address(http)
    try:
        from orinkit.tester.server import Reports, TesterOptions, serve
        from orinkit.tester.state.connection_spec import ConnectionSpec
        from orinkit.tester.state.simulators import KINDS
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("orinkit"):
            raise
        raise MissingExtra(tr("the Tester requires nicegui. Try: pip install 'orinkit[tester]'")) from error
    unknown = [each for each in virtual if each not in KINDS]
    if unknown:
        raise usage_error(tr("--virtual {key}: not one of {known}", key=unknown[0], known=", ".join(KINDS)))
    specs = [ConnectionSpec(url.partition("://")[2] or url, url).check() for url in urls]
    logs.to_stderr()

    def ready(url: str) -> None:
        collect_as_usual()
        print(f"ready {url}", flush=True)

    def warning(text: str) -> None:
        print(f"orinkit: {text}", file=sys.stderr, flush=True)

    serve(TesterOptions(host, port, allow_host, specs, virtual, not no_browser), Reports(ready, warning))
    return 0


def _address(text: str) -> tuple[str, int]:
    """Return host and port.

    Raises:
        CommandError: If the text is not HOST:PORT.
    """
    host, colon, port = text.removeprefix("http://").rpartition(":")
    if not colon and port.isdecimal():
        host = "127.0.0.1"
    if not host or not port.isascii() or not port.isdecimal() or int(port) > 65535:
        raise usage_error(tr("--http {text:.60}: not HOST:PORT. Try: 127.0.0.1:0", text=text))
    return host, int(port)
