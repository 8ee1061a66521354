"""``orinkit serve device``: devices of one's own on the network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cao.provider import Provider
from orinkit.cao.session import ProviderRegistry
from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.serving import ServerOptions, begin_log, check, run
from orinkit.core.i18n import tr
from orinkit.device.discovery import LoadFailed, load, log_served, settle_names, warn_of_clashes

_LISTENING: Final = ServerOptions()


def serve_device(
    *target: Annotated[
        str,
        Parameter(
            required=True,
            help=tr(
"file.py:Class, module:Class, or the name of an installed provider; the class may be "
"left out where there is one."),
        ),
    ],
    listening: ServerOptions = _LISTENING,
) -> int:  # fmt: skip
    """Serve devices of your own; each listener is told on stdout as "ready URL". Stops on SIGINT, SIGTERM and SIGHUP."""
    check(listening)
    begin_log(listening)
    providers = load_targets(target)
    announce(providers)
    return run(providers, listening)


def load_targets(targets: Sequence[str], first: Sequence[Provider] = ()) -> list[Provider]:
    """Return the providers that a command line names, behind those that are there.

    Raises:
        Failure: one cannot be loaded, or not be served beside the others.
    """
    providers = list(first)
    for target in targets:
        try:
            provider = load(target)
            if not any(provider is other for other in providers):
                ProviderRegistry([*providers, provider])
                providers.append(provider)
        except LoadFailed as error:
            raise CommandError(str(error), 2) from error
        except ValueError as error:  # it speaks another dialect
            raise CommandError(f"{target}: {error}", 2) from error
    return providers


def announce(providers: Sequence[Provider], *but: Provider) -> None:
    """Settle who has which name, and tell the log what is served and which names two claim.

    Args:
        providers: in the order in which they are served.
        but: those of which nothing is told.
    """
    settle_names(providers)
    warn_of_clashes(providers)
    log_served(providers, but)
