"""The providers of one server, by name."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from orinkit.cao.controller_names import ControllerNames
from orinkit.cao.provider import Provider
from orinkit.cao.quota import ByteQuota
from orinkit.cao.user_functions import UserFunction
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import quoted, tr

logger = logging.getLogger("orinkit.session")


class ProviderRegistry:
    """The providers of one server, by name.

    Args:
        providers: the providers; one with the name ``"*"`` also serves unknown names.
        objects: limit on the objects of one client; beyond it, E_MAX_OBJECT is returned.

    Attributes:
        names: names of the controllers of all clients.
        user_functions: user-defined functions by their numbers, each with its provider.
    """

    def __init__(self, providers: Provider | Iterable[Provider], objects: int = 1000) -> None:
        self.providers = [providers] if isinstance(providers, Provider) else _checked(providers)
        self.objects = objects
        self.kept = ByteQuota()
        self.names = ControllerNames()
        self._by_name = {name.lower(): p for p in reversed(self.providers) for name in _names(p)}
        first, *others = self.providers
        for other in others:
            _check_together(first, other)
        self.dialect = first.dialect
        self.functions = first.functions
        self.fixed_handles = first.fixed_handles
        self.requires_secret = all(each.requires_secret for each in self.providers)
        self.unwraps_variants = any(each.unwraps_variants for each in self.providers)
        self.user_functions = _user_functions(self.providers)

    def find(self, name: str) -> Provider:
        """Return a provider by its name.

        Raises:
            CallError: E_CAO_PROV_INVALID if there is no such provider.
        """
        found = self._by_name.get(name.strip().lower()) or self._by_name.get("*")
        if found is None:
            offered = ", ".join(dict.fromkeys(name for p in self.providers for name in p.provider_names))
            raise error_for(
                hresult.E_CAO_PROV_INVALID,
                tr("unknown provider {name}; available: {offered}", name=quoted(name), offered=offered),
            )
        return found


def _user_functions(providers: Iterable[Provider]) -> dict[int, tuple[Provider, UserFunction]]:
    """Return the user-defined functions of all providers by their numbers.

    Raises:
        ValueError: If two providers have a function of the same number.
    """
    found: dict[int, tuple[Provider, UserFunction]] = {}
    for provider in providers:
        for each in provider.user_functions():
            number = each.function.id
            if number in found:
                names = type(found[number][0]).__name__, type(provider).__name__
                raise ValueError(
                    tr(
                        "{first} and {second} both have the user-defined function {number}",
                        first=names[0],
                        second=names[1],
                        number=number,
                    )
                )
            found[number] = provider, each
    return found


def _checked(given: object) -> list[Provider]:
    listed = list(given) if isinstance(given, Iterable) and not isinstance(given, type) else [given]
    wrong = [each for each in listed if not isinstance(each, Provider)]
    if wrong:
        raise TypeError(
            tr(
                "expected a Provider or Device object, got {wrong!r:.100}. Try: pass an instance: MyDevice()",
                wrong=wrong[0],
            )
        )
    if not listed:
        raise ValueError(tr("no provider to serve"))
    return [each for each in listed if isinstance(each, Provider)]


def _check_together(one: Provider, other: Provider) -> None:
    kinds = [(each.dialect, each.functions, each.fixed_handles) for each in (one, other)]
    if kinds[0] != kinds[1]:
        names = type(one).__name__, type(other).__name__
        raise ValueError(
            tr(
                "{first} and {second} use different dialects of b-CAP and cannot be served together",
                first=names[0],
                second=names[1],
            )
        )


def _names(provider: Provider) -> list[str]:
    names = provider.provider_names
    if not names:
        logger.warning("%s has no provider_names: clients cannot connect to it", type(provider).__name__)
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise TypeError(
            tr(
                '{name}.provider_names must be a tuple of names, such as ("CaoProv.Example.Gripper",), not {names!r}',
                name=type(provider).__name__,
                names=names,
            )
        )
    return list(names)
