"""``orinkit gateway``: other controllers, over whatever protocol clients speak."""

from __future__ import annotations

import re
from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao.provider import Provider
from orinkit.cli._shared.errors import CommandError, unusable
from orinkit.cli._shared.files import read, read_token
from orinkit.cli._shared.serving import ServerOptions, begin_log, check, run
from orinkit.core.errors import InvalidValue, OrinError
from orinkit.core.i18n import tr
from orinkit.gateway import AccessRules, RemoteProvider, RestrictedProvider, Upstream
from orinkit.transport.address import parse_address
from orinkit.transport.registry import examples, row_of

_UPSTREAM: Final = Group(tr("Controllers"), sort_key=6)
_RULES: Final = Group(tr("What is allowed"), sort_key=7)
_LISTENING: Final = ServerOptions()
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
"A controller: {examples}; NAME=URL for one of several, which clients choose by the machine name of "
"Controller_Connect.", examples=examples()),
        ),
    ],
    provider: Annotated[
        tuple[str, ...],
        Parameter(
            group=_UPSTREAM,
            show_default=_all,
            help=tr("Provider name that is passed on; all are unless told otherwise. May be given again."),
        ),
    ] = ("*",),
    timeout: Annotated[
        float | None,
        Parameter(
            group=_UPSTREAM,
            help=tr(
"Seconds for connecting to a controller and for each call (3 by default); with UDP and "
"serial lines for each try (0.5)."),
        ),
    ] = None,
    tries: Annotated[
        int,
        Parameter(
            group=_UPSTREAM,
            help=tr("How often a request is sent with UDP and serial lines while no answer comes, 1 to 7."),
        ),
    ] = DEFAULT_TRIES,
    dialect: Annotated[
        str, Parameter(group=_UPSTREAM, help=tr("rc8 or ve026a."))
    ] = "rc8",
    upstream_token_file: Annotated[
        str | None,
        Parameter(
            group=_UPSTREAM,
            help=tr("File with the token that an HTTP controller wants to be shown."),
        ),
    ] = None,
    upstream_cafile: Annotated[
        str | None,
        Parameter(
            group=_UPSTREAM,
            help=tr("PEM file of certificates that an https controller's is to be signed by."),
        ),
    ] = None,
    read_only: Annotated[
        bool, Parameter(group=_RULES, help=tr("Only what reads."))
    ] = False,
    allow_function: Annotated[
        tuple[str, ...],
        Parameter(
            group=_RULES,
            help=tr("Functions that are allowed, by the documents' names: \"Robot_*\"; may be given again."),
        ),
    ] = (),
    allow_variable: Annotated[
        tuple[str, ...],
        Parameter(
            group=_RULES,
            help=tr("Variables that are allowed: \"IO1??\"; may be given again."),
        ),
    ] = (),
    allow_command: Annotated[
        tuple[str, ...],
        Parameter(
            group=_RULES,
            help=tr("Commands of Execute that are allowed: \"Get*\"; may be given again."),
        ),
    ] = (),
    listening: ServerOptions = _LISTENING,
) -> int:  # fmt: skip
    """Pass calls on to other controllers; each listener is told on stdout as "ready URL". Stops on SIGINT, SIGTERM and SIGHUP."""
    check(listening)
    if upstream_cafile is not None:
        read("--upstream-cafile", upstream_cafile)
    token = "" if upstream_token_file is None else read_token(upstream_token_file)
    try:
        found = {
            name: Upstream(
                url,
                timeout=timeout,
                tries=tries,
                dialect=dialect,
                token=token if _is_web(url) else "",
                cafile=(upstream_cafile or "") if _is_web(url) else "",
            )
            for name, url in _named(upstream)
        }
        remote: Provider = RemoteProvider(found, names=provider)
    except (OrinError, InvalidValue, ValueError) as error:
        raise CommandError(str(error), 2) from None
    rules = AccessRules(read_only, allow_function, allow_variable, allow_command)
    begin_log(listening)
    return run([remote if rules == AccessRules() else RestrictedProvider(remote, rules)], listening)


def _named(given: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return name and URL of each controller; the name of a single one may be left out.

    Raises:
        Failure: a name is missing, or there twice.
    """
    found = [(match[1].strip(), match[2]) if (match := _NAMED.fullmatch(text)) else ("", text) for text in given]
    names = [name.lower() for name, _ in found]
    if len(found) > 1 and ("" in names or len(set(names)) < len(names)):
        raise unusable(
            tr("--upstream: each of several controllers needs a name of its own, as cell1=tcp://192.168.0.1:5007"),
        )
    return found


def _is_web(url: str) -> bool:
    return row_of(parse_address(url)).http
