"""``orinkit serve device``: serve the user's own devices on the network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cao.provider import Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.serving import ServerOptions, begin_log, check, run
from orinkit.core.i18n import tr
from orinkit.device.discovery import ProviderLoadFailed, load, log_served, reserve_names, warn_of_clashes

_LISTENING: Final = ServerOptions()


def serve_device(
    *target: Annotated[
        str,
        Parameter(
            required=True,
            help=tr(
"file.py:Class, module:Class, or the name of an installed provider; the class may be "
"omitted if there is only one."),
        ),
    ],
    listening: ServerOptions = _LISTENING,
) -> int:  # fmt: skip
    """Serve your own devices; print "ready URL" for each listener. Stop on SIGINT, SIGTERM or SIGHUP."""
    check(listening)
    begin_log(listening)
    providers = load_targets(target)
    name_and_log_providers(providers)
    return run(providers, listening)


def load_targets(targets: Sequence[str], first: Sequence[Provider] = ()) -> list[Provider]:
    """Return the providers in ``first`` followed by those named on a command line.

    Raises:
        CommandError: If a provider cannot be loaded, or cannot be served together with the others.
    """
    providers = list(first)
    for target in targets:
        try:
            provider = load(target)
            if not any(provider is other for other in providers):
                ProviderRegistry([*providers, provider])
                providers.append(provider)
        except ProviderLoadFailed as error:
            raise CommandError(str(error), 2) from error
        except ValueError as error:  # the provider has another dialect
            raise CommandError(f"{target}: {error}", 2) from error
    return providers


def name_and_log_providers(providers: Sequence[Provider], *but: Provider) -> None:
    """Reserve the names of installed providers, and log conflicting names and the served providers.

    Args:
        providers: The providers, in the order in which they are served.
        but: Providers that are not logged.
    """
    reserve_names(providers)
    warn_of_clashes(providers)
    log_served(providers, but)
