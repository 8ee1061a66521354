"""``orinkit gateway``: forward calls to other controllers, between any two protocols."""

from __future__ import annotations

import re
from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao.provider import Provider
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli._shared.files import read, read_token, warn_of_exposure
from orinkit.cli._shared.serving import ServerOptions, begin_log, check, run
from orinkit.client._shared.common import LOCALHOST, check_timeout
from orinkit.client._shared.connection_string import BY_NAME, ConnectArguments, evaluate
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import tr
from orinkit.gateway import AccessRules, RemoteProvider, RestrictedProvider, Upstream
from orinkit.transport.address import parse_address
from orinkit.transport.registry import examples, row_of

_UPSTREAM: Final = Group(tr("Controllers"), sort_key=6)
_RULES: Final = Group(tr("Access rules"), sort_key=7)
_LISTENING: Final = ServerOptions()
_TOKEN: Final = "--upstream-token-file"  # noqa: S105 - not a password
_NAMED: Final = re.compile(r"([^=:/?&]+)=(.*)", re.DOTALL)


def _all(_given: object) -> str:
    return tr("all names")


def gateway(
    *,
    upstream: Annotated[
        tuple[str, ...],
        Parameter(
            group=_UPSTREAM,
            help=tr(
"Address of a controller: {examples}. With several controllers, NAME=URL for each; clients select one by "
"the machine name of Controller_Connect.", examples=examples()),
        ),
    ],
    provider: Annotated[
        tuple[str, ...],
        Parameter(
            group=_UPSTREAM,
            show_default=_all,
            help=tr("Forward only calls for this provider name; by default for all names. May be repeated."),
        ),
    ] = ("*",),
    timeout: Annotated[
        float | None,
        Parameter(
            group=_UPSTREAM,
            help=tr(
"Time-out in seconds for connecting to a controller and for each call (3 by default); over "
"UDP and serial lines for each attempt (0.5)."),
        ),
    ] = None,
    tries: Annotated[
        int,
        Parameter(
            group=_UPSTREAM,
            help=tr("How many times to send a request over UDP and serial lines if no reply arrives, 1 to 7."),
        ),
    ] = DEFAULT_TRIES,
    dialect: Annotated[
        str, Parameter(group=_UPSTREAM, help=tr("Dialect of the controllers: rc8 or ve026a."))
    ] = "rc8",
    upstream_token_file: Annotated[
        str | None,
        Parameter(
            group=_UPSTREAM,
            help=tr("File with the token for HTTP controllers."),
        ),
    ] = None,
    upstream_cafile: Annotated[
        str | None,
        Parameter(
            group=_UPSTREAM,
            help=tr("PEM file with the CA certificates that verify https controllers."),
        ),
    ] = None,
    read_only: Annotated[
        bool, Parameter(group=_RULES, help=tr("Allow only calls that read."))
    ] = False,
    allow_function: Annotated[
        tuple[str, ...],
        Parameter(
            group=_RULES,
            help=tr("Allow only functions whose name (as in the documents) matches this pattern, for example "
                "\"Robot_*\"; may be repeated."),
        ),
    ] = (),
    allow_variable: Annotated[
        tuple[str, ...],
        Parameter(
            group=_RULES,
            help=tr("Allow only variables whose name matches this pattern, for example \"IO1??\"; may be repeated."),
        ),
    ] = (),
    allow_command: Annotated[
        tuple[str, ...],
        Parameter(
            group=_RULES,
            help=tr("Allow only commands of Execute whose name matches this pattern, for example \"Get*\"; may be "
                "repeated."),
        ),
    ] = (),
    listening: ServerOptions = _LISTENING,
) -> int:  # fmt: skip
    """Forward calls to other controllers; print "ready URL" for each listener. Stop on SIGINT, SIGTERM or SIGHUP."""
    check(listening)
    if upstream_cafile is not None:
        read("--upstream-cafile", upstream_cafile)
    token = "" if upstream_token_file is None else read_token(upstream_token_file, _TOKEN)
    if timeout is not None:
        check_timeout(timeout, "--timeout")
    try:
        found = {
            name: Upstream(
                given.url,
                timeout=given.timeout,
                tries=given.tries,
                dialect=dialect,
                machine="" if given.machine == LOCALHOST else given.machine,
                token=token if _is_web(given.url) else "",
                cafile=(upstream_cafile or "") if _is_web(given.url) else "",
            )
            for name, text in _named(upstream)
            for given in [_settings(ConnectArguments(text, timeout=timeout, tries=tries))]
        }
        remote: Provider = RemoteProvider(found, names=provider)
    except (OrinError, InvalidValue, ValueError) as error:
        raise CommandError(str(error), 2) from None
    rules = AccessRules(read_only, allow_function, allow_variable, allow_command)
    begin_log(listening)
    if upstream_token_file is not None:
        warn_of_exposure(_TOKEN, upstream_token_file)
    return run([remote if rules == AccessRules() else RestrictedProvider(remote, rules)], listening)


def _named(given: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return name and URL of each controller; the name of a single one may be omitted.

    Raises:
        CommandError: If a name is missing or occurs twice.
    """
    found = [
        (match[1].strip(), match[2])
        if (match := _NAMED.fullmatch(text)) and match[1].strip().lower() not in BY_NAME
        else ("", text)
        for text in given
    ]
    names = [name.lower() for name, _ in found]
    if len(found) > 1 and ("" in names or len(set(names)) < len(names)):
        raise usage_error(
            tr("--upstream: several controllers require unique names. Try: cell1=tcp://192.168.0.1:5007"),
        )
    return found


def _settings(given: ConnectArguments) -> ConnectArguments:
    """Evaluate a connection string; an option that the clients of a gateway choose is refused."""
    found = evaluate(given)
    chosen = ConnectArguments(found.url, machine=found.machine, timeout=found.timeout, tries=found.tries)
    if found != chosen:
        raise usage_error(
            tr(
                "--upstream {text!r:.80}: the clients of the gateway choose Provider and Option, and Message and Debug "
                "do not apply. Try: only Server, UDP, Timeout, TORetry and Machine",
                text=given.url,
            )
        )
    return found


def _is_web(url: str) -> bool:
    return row_of(parse_address(url)).http
