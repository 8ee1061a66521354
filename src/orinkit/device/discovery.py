"""Loading of providers from installed packages, modules and single files.

A package registers its provider with an entry point of the group ``orinkit.providers``. The name of the entry point is
the provider name; its value is the location of the provider::

    [project.entry-points."orinkit.providers"]
    "CaoProv.Example.Gripper" = "my_gripper:Gripper"

The value names one of the following:

* a subclass of :class:`orinkit.Device` or :class:`~orinkit.cao.provider.Provider` that can be instantiated without
  arguments;
* a function without arguments that returns a provider;
* a provider object.

Clients reach the provider under its own provider names and under the name of the entry point. If another provider has
the same name as the entry point, clients that use this name reach the provider of the entry point.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import logging
import os
import re
import reprlib
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Final, NamedTuple, TypeGuard

from orinkit.cao.provider import Provider
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.core.errors import ProviderLoadFailed as ProviderLoadFailed
from orinkit.core.i18n import tr

logger = logging.getLogger("orinkit.providers")

GROUP: Final = "orinkit.providers"
"""Group of the entry points."""

_FILE: Final = re.compile(r"(?P<path>.+\.py)(:(?P<attribute>[^:/\\]*))?", re.IGNORECASE | re.DOTALL)
_ENTRIES: Final = "_orinkit_entries"  # attribute of a provider that contains its entry points
_PACKAGE: Final = str(Path(__file__).parent) + os.sep
_SHOWN: Final = 100  # maximum number of characters of a target in a message
_MAX_REASON: Final = 500  # maximum number of characters of an exception in a message
_REPR: Final = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = _SHOWN


BUILT_IN: Final = {"CaoProv.Waco.ABH3": "orinkit.abh3.provider.provider:ABH3Provider"}
"""Locations of providers in orinkit itself, by provider name. They are loaded only if they are requested by name."""


class Installed(NamedTuple):
    """An entry point of an installed package.

    Attributes:
        name: Provider name.
        distribution: Name and version of the package, ``"my-gripper 1.0"``; ``""`` if unknown.
        value: Location of the provider, ``"my_gripper:Gripper"``.
    """

    name: str
    distribution: str
    value: str


def installed() -> list[Installed]:
    """Return the entry points of installed packages, sorted by name, without importing the packages."""
    return [_installed(entry) for entry in _entries()]


def load(target: str) -> Provider:
    """Load a provider. Return a new instance, unless the target names an existing provider object.

    Args:
        target: Name of an installed provider, ``"CaoProv.Example.Gripper"`` (case is ignored); a class in a module,
            ``"my_gripper:Gripper"``; or a class in a file, ``"path/to/gripper.py:Gripper"``. While the file is loaded,
            it may import modules from its directory. The class may be omitted if the module or file defines exactly one
            provider class.

    Raises:
        ProviderLoadFailed: If the target does not exist, raises an exception, or is not a provider.
    """
    target = target.strip()
    file = _FILE.fullmatch(target)
    if file is not None:
        module, attribute = _import_file(target, Path(file["path"])), file["attribute"] or ""
    else:
        entry = _named(target)
        if entry is not None:
            return _load_entry(entry)
        known = {name.lower(): place for name, place in BUILT_IN.items()}
        name, _, attribute = known.get(target.lower(), target).partition(":")
        module = _import(target, name)
    return _with_names(target, _create(target, _find(target, module, attribute)))


def load_installed(beside: Sequence[Provider] = (), *, exclude: Collection[str] = ()) -> list[Provider]:
    """Load the providers of all installed packages; log each provider that cannot be loaded, with the reason.

    Args:
        beside: Other providers of the same server. If an installed provider is the same object as one of them, it is
            omitted from the result. If it cannot be combined with them, for example because of its dialect, it is
            omitted too, and this is logged.
        exclude: Names of entry points to omit.
    """
    unwanted = {name.strip().lower() for name in exclude}
    found: list[Provider] = []
    for entry in _entries():
        if entry.name.lower() in unwanted:
            continue
        try:
            provider = _load_entry(entry)
            others = [*beside, *found]
            if not any(provider is other for other in others):
                ProviderRegistry([*others, provider])  # fails if the provider has another dialect
                found.append(provider)
        except (ProviderLoadFailed, ValueError) as error:
            text = tr("%s (%s) was not loaded: %s")
            logger.warning(text, entry.name, _distribution(entry) or entry.value, error)
    reserve_names(found)
    return found


def reserve_names(providers: Sequence[Provider]) -> None:
    """Reserve the name of each entry point for its provider.

    The name is removed from the provider names of all providers that were loaded from other entry points. Each removal
    is logged. Providers without an entry point, or with read-only provider names, keep their names.
    """
    owners: dict[str, Provider] = {}
    for provider in providers:
        for entry in _came_from(provider):
            owners.setdefault(entry.name.lower(), provider)
    for provider in providers:
        own = {entry.name.lower() for entry in _came_from(provider)}
        lost = [name for name in provider.provider_names if name.lower() not in own and name.lower() in owners]
        if own and lost:
            _take_away(provider, lost, owners)


def _take_away(provider: Provider, lost: Collection[str], owners: Mapping[str, Provider]) -> None:
    try:
        provider.provider_names = tuple(name for name in provider.provider_names if name not in lost)
    except AttributeError:
        return  # a read-only property: the first provider with this name is used
    for name in lost:
        text = tr("provider name %s is used by %s and by %s: the entry point of that name takes precedence")
        logger.warning(text, name, _origin(provider), _origin(owners[name.lower()]))


def log_served(providers: Sequence[Provider], beside: Sequence[Provider] = ()) -> None:
    """Log the providers of a server with their names: ``serving CaoProv.Example.Gripper (my-gripper 1.0)``.

    A name that several providers have is logged only for the first of them, because clients reach only this
    provider under the name.

    Args:
        providers: Providers in the order in which they are served.
        beside: Those of ``providers`` that are not to be logged.
    """
    taken: set[str] = set()
    for provider in providers:
        names = [name for name in provider.provider_names if name.lower() not in taken]
        taken.update(name.lower() for name in names)
        if names and not any(provider is other for other in beside):
            packages = dict.fromkeys(entry.distribution for entry in _came_from(provider))
            origin = ", ".join(filter(None, packages)) or _class_name(provider)
            logger.info(tr("serving %s (%s)"), ", ".join(names), origin)


def warn_of_clashes(providers: Sequence[Provider]) -> None:
    """Log a warning for each provider name that several providers have. The first of these providers is used."""
    owners: dict[str, Provider] = {}
    for provider in providers:
        for name in provider.provider_names:
            owner = owners.setdefault(name.lower(), provider)
            if owner is not provider:
                text = tr("provider name %s is used by %s and by %s: the first one takes precedence")
                logger.warning(text, name, _origin(owner), _origin(provider))


# --- entry points -----------------------------------------------------------------------------------------------------


def _entries() -> list[metadata.EntryPoint]:
    try:
        found = list(metadata.entry_points(group=GROUP))
    except Exception:  # noqa: BLE001 - the metadata of some installed package are damaged
        found = [entry for each in metadata.distributions() for entry in _entries_of(each)]
    return sorted(found, key=lambda entry: (entry.name.lower(), _distribution(entry)))


def _entries_of(distribution: metadata.Distribution) -> list[metadata.EntryPoint]:
    try:
        return list(distribution.entry_points.select(group=GROUP))
    except Exception as error:  # noqa: BLE001 - the metadata of this package are damaged
        text = tr("cannot read the entry points of %s: %s")
        logger.warning(text, getattr(distribution, "_path", distribution), _reason(error))
        return []


def _distribution(entry: metadata.EntryPoint) -> str:
    try:
        return "" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    except Exception:  # noqa: BLE001 - its METADATA are damaged or missing
        return ""


def _installed(entry: metadata.EntryPoint) -> Installed:
    return Installed(entry.name, _distribution(entry), entry.value)


def _came_from(provider: Provider) -> tuple[Installed, ...]:
    """Return the entry points from which a provider was loaded; several entry points may name the same provider."""
    found: tuple[Installed, ...] = vars(provider).get(_ENTRIES, ())
    return found


def _named(target: str) -> metadata.EntryPoint | None:
    return next((entry for entry in _entries() if entry.name.lower() == target.lower()), None)


def _load_entry(entry: metadata.EntryPoint) -> Provider:
    place = f"{entry.name} = {entry.value}"
    name, _, attribute = entry.value.partition("[")[0].partition(":")
    provider = _create(place, _find(place, _import(place, name.strip()), attribute.strip()))
    provider = _with_names(place, provider, also=entry.name)
    this = _installed(entry)
    if this not in (entries := _came_from(provider)):
        vars(provider)[_ENTRIES] = (*entries, this)
    return provider


# --- modules and files ------------------------------------------------------------------------------------------------


def _import(target: str, name: str) -> ModuleType:
    """Import a module by name.

    Raises:
        ProviderLoadFailed: If the module cannot be imported.
    """
    if not all(part.isidentifier() for part in name.split(".")):
        raise _failed(
            target,
            tr("not the name of an installed provider. Try: module:Class or file.py:Class"),
        )
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise _failed(target, _reason(error)) from error  # a module that the target imports does not exist
        raise _failed(target, _no_module(name)) from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise _failed(target, _reason(error)) from error


def _no_module(name: str) -> str:
    offered = ", ".join([*(entry.name for entry in _entries()), *BUILT_IN])
    near = Path(f"{name}.py")
    hint = tr(" Try: {file}:Class", file=near) if near.is_file() else ""
    return tr(
        "neither a module nor a provider {name} exists; installed providers: {offered}.{hint}",
        name=name,
        offered=offered,
        hint=hint,
    )


def _import_file(target: str, path: Path) -> ModuleType:
    """Import a file and return its module; if the file has already been imported, return the existing module.

    Raises:
        ProviderLoadFailed: If the file cannot be imported.
    """
    try:
        path = path.resolve()
        exists = path.is_file()
    except (OSError, ValueError):  # not a valid file name
        exists = False
    if not exists:
        raise _failed(target, tr("the file does not exist"))
    name = _module_name(path)
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise _failed(target, tr("not a Python file"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # required by dataclasses and pickle
    try:
        with _on_path(str(path.parent)):
            spec.loader.exec_module(module)
    except BaseException as error:
        sys.modules.pop(name, None)
        if isinstance(error, Exception | SystemExit):
            raise _failed(target, _reason(error)) from error
        raise
    return module


def _module_name(path: Path) -> str:
    """Return a module name for a file: its name without ``.py``, with a number if another module has this name."""
    plain = path.stem.replace(".", "_")
    name, count = plain, 1
    while not _is_free(name, path):
        count += 1
        name = f"{plain}_{count}"
    return name


def _is_free(name: str, path: Path) -> bool:
    known = sys.modules.get(name)
    if known is not None:
        return getattr(known, "__file__", None) == str(path)
    spec = importlib.util.find_spec(name)
    return spec is None or spec.origin == str(path)


@contextmanager
def _on_path(directory: str) -> Iterator[None]:
    """Allow imports from a directory for the duration of a block."""
    importlib.invalidate_caches()
    if directory in sys.path:
        yield
        return
    sys.path.insert(0, directory)
    try:
        yield
    finally:
        if directory in sys.path:
            sys.path.remove(directory)


# --- providers in a module --------------------------------------------------------------------------------------------


def _find(target: str, module: ModuleType, attribute: str) -> object:
    """Return the object that an attribute of a module names.

    For the attribute ``""``, the result is the only provider class of the module.

    Raises:
        ProviderLoadFailed: If the attribute does not exist, or the module does not define exactly one provider class.
    """
    classes = _classes(module)
    if attribute:
        found: object = module
        for part in attribute.split("."):
            try:
                found = getattr(found, part)
            except Exception as error:
                raise _failed(target, _missing_attribute(attribute, error, classes)) from error
        return found
    if len(classes) == 1:
        return classes[0]
    if classes:
        raise _failed(target, tr("it defines several classes. Try: one of {names}", names=_names(classes)))
    raise _failed(target, tr("it defines no subclass of Device or Provider"))


def _missing_attribute(attribute: str, error: Exception, classes: Sequence[type[Provider]]) -> str:
    if not isinstance(error, AttributeError):
        return _reason(error)
    shown = attribute[:_SHOWN]
    if not classes:
        return tr("it has no attribute {name}", name=shown)
    return tr("it has no attribute {name}. Try: {classes}", name=shown, classes=_names(classes))


def _names(classes: Sequence[type[Provider]]) -> str:
    return ", ".join(each.__name__ for each in classes)


def _classes(module: ModuleType) -> list[type[Provider]]:
    """Return the public provider classes that a module defines or, if it is a package, imports from its own modules."""
    name = module.__name__
    found = [each for each in vars(module).values() if isinstance(each, type) and issubclass(each, Provider)]
    own = [each for each in found if f"{each.__module__}.".startswith(f"{name}.") and each.__name__[0] != "_"]
    return list(dict.fromkeys(own))


def _create(target: str, found: object) -> Provider:
    """Return ``found`` if it is a provider. If it is a provider class or a function, call it to create the provider.

    Raises:
        ProviderLoadFailed: If the object is not a provider, or creating it fails.
    """
    provider = found
    if _is_factory(found):
        _check_arguments(target, found)
        try:
            provider = found()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise _failed(target, _reason(error)) from error
    if not isinstance(provider, Provider):
        shown = _REPR.repr(provider)
        raise _failed(target, tr("not a Device or Provider: {shown}", shown=shown))
    return provider


def _is_factory(found: object) -> TypeGuard[Callable[[], object]]:
    """Return True if an object creates providers: a provider class or a function."""
    if isinstance(found, type):
        return issubclass(found, Provider)
    return callable(found) and not isinstance(found, Provider) and not inspect.iscoroutinefunction(found)


def _check_arguments(target: str, maker: Callable[[], object]) -> None:
    """Check that a class or function can be called without arguments.

    Raises:
        ProviderLoadFailed: If it requires arguments.
    """
    try:
        signature = inspect.signature(maker)
    except (TypeError, ValueError):  # a compiled function has no signature
        return
    try:
        signature.bind()
    except TypeError:
        call = f"{getattr(maker, '__name__', _REPR.repr(maker))}{str(signature).partition(' ->')[0]:.{_SHOWN}}"
        raise _failed(
            target,
            tr("{call} requires arguments. Try: a function without arguments that returns a provider", call=call),
        ) from None


def _with_names(target: str, provider: Provider, also: str = "") -> Provider:
    """Check the names of a provider, add ``also`` to them, and return the provider.

    Raises:
        ProviderLoadFailed: If the provider has no names, or one of its names is invalid.
    """
    try:
        names = provider.provider_names
        if names:
            ProviderRegistry(provider)  # checks the names
        if also and also.lower() not in (name.lower() for name in names):
            provider.provider_names = (*names, also)
    except Exception as error:
        raise _failed(target, str(error) if isinstance(error, TypeError) else _reason(error)) from error
    if not provider.provider_names:
        raise _failed(
            target,
            tr("it has no provider_names, so clients could not connect to it"),
        )
    return provider


# --- messages ---------------------------------------------------------------------------------------------------------


def _failed(target: str, reason: str) -> ProviderLoadFailed:
    shown = target if len(target) <= _SHOWN else f"...{target[3 - _SHOWN :]}"  # the end of a path is more informative
    return ProviderLoadFailed(f"{shown or repr(shown)}: {reason}")


def _reason(error: BaseException) -> str:
    """Return the text of an exception, and the file and line where it was raised."""
    lines = traceback.format_exception_only(error)
    text = " ".join("".join(lines[-1:] if isinstance(error, SyntaxError) else lines).split())[:_MAX_REASON]
    internal = ("<frozen", _PACKAGE)
    places = [each for each in traceback.extract_tb(error.__traceback__) if not each.filename.startswith(internal)]
    if isinstance(error, SyntaxError) and error.filename:
        return f"{text} ({Path(error.filename).name}:{error.lineno})"
    if places:
        return f"{text} ({Path(places[-1].filename).name}:{places[-1].lineno})"
    return text


def _class_name(provider: Provider) -> str:
    return f"{type(provider).__module__}.{type(provider).__qualname__}"


def _origin(provider: Provider) -> str:
    """Return the origin of a provider for messages: its entry points and their packages, otherwise its class."""
    places = (f"{each.name} = {each.value} ({each.distribution or '?'})" for each in _came_from(provider))
    return ", ".join(places) or _class_name(provider)
