"""Providers from elsewhere: of packages that are installed, of modules, of single files.

A package offers its provider with an entry point of the group ``orinkit.providers``. The entry's name is the provider's
name, its value is where it is found::

    [project.entry-points."orinkit.providers"]
    "CaoProv.Example.Gripper" = "my_gripper:Gripper"

What is found there is a class that can be made without arguments, :class:`orinkit.Device` or another
:class:`~orinkit.cao.provider.Provider`; or a function without arguments that returns a provider; or a provider. It answers
to its own provider names and to the entry's name, which no other entry's provider takes from it.
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
from orinkit.cao.session import ProviderRegistry
from orinkit.core.errors import LoadFailed as LoadFailed
from orinkit.core.i18n import tr

logger = logging.getLogger("orinkit.providers")

GROUP: Final = "orinkit.providers"
"""The entry points' group."""

_FILE: Final = re.compile(r"(?P<path>.+\.py)(:(?P<attribute>[^:/\\]*))?", re.IGNORECASE | re.DOTALL)
_ENTRIES: Final = "_orinkit_entries"  # attribute of a provider
_PACKAGE: Final = str(Path(__file__).parent) + os.sep
_SHOWN: Final = 100  # characters of a target in a message
_LONGEST: Final = 500  # characters of an exception in a message
_REPR: Final = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = _SHOWN


BUILT_IN: Final = {"CaoProv.Waco.ABH3": "orinkit.abh3.provider.provider:ABH3Provider"}
"""Providers of orinkit that are served where they are named only."""


class Installed(NamedTuple):
    """An entry point of an installed package.

    Attributes:
        name: the provider's name.
        distribution: the package's name and version, ``"my-gripper 1.0"``; ``""`` where it does not say.
        value: where the provider is found, ``"my_gripper:Gripper"``.
    """

    name: str
    distribution: str
    value: str


def installed() -> list[Installed]:
    """Return what installed packages offer, sorted by name; nothing of it is imported."""
    return [_installed(entry) for entry in _entries()]


def load(target: str) -> Provider:
    """Return a provider, made anew unless an object is named.

    Args:
        target: ``"CaoProv.Example.Gripper"``, the name of an installed one, in upper or lower case;
            ``"my_gripper:Gripper"`` in a module; ``"path/to/gripper.py:Gripper"`` in a file, which may import its
            neighbours while it is loaded. Module and file alone will do where they have exactly one class of a device.

    Raises:
        LoadFailed: it is not there, raises an exception, or is no provider.
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
    return _reachable(target, _made(target, _find(target, module, attribute)))


def load_installed(beside: Sequence[Provider] = (), *, but: Collection[str] = ()) -> list[Provider]:
    """Return all that installed packages offer, as far as it can be loaded; the log tells of each that cannot, and why.

    Args:
        beside: those that are served by the same server.
        but: names of those that are left out.
    """
    unwanted = {name.strip().lower() for name in but}
    found: list[Provider] = []
    for entry in _entries():
        if entry.name.lower() in unwanted:
            continue
        try:
            provider = _load_entry(entry)
            others = [*beside, *found]
            if not any(provider is other for other in others):
                ProviderRegistry([*others, provider])  # it may speak another dialect
                found.append(provider)
        except (LoadFailed, ValueError) as error:
            text = tr("%s (%s) is left out: %s")
            logger.warning(text, entry.name, _distribution(entry) or entry.value, error)
    settle_names(found)
    return found


def settle_names(providers: Sequence[Provider]) -> None:
    """Give every entry its own name: another entry's provider that lists it among its provider names goes without.

    The log tells of it. A provider that came from no entry keeps its names; so does one that has no setter for them.
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
        return  # a property: the first has the name then
    for name in lost:
        text = tr("the provider name %s is claimed by %s and by %s: the entry of that name has it")
        logger.warning(text, name, _origin(provider), _origin(owners[name.lower()]))


def log_served(providers: Sequence[Provider], beside: Sequence[Provider] = ()) -> None:
    """Tell the log what is served, by the names that it really has: ``serving CaoProv.Example.Gripper (my-gripper 1.0)``.

    Args:
        providers: in the order in which they are served.
        beside: those of them that are not worth telling.
    """
    taken: set[str] = set()
    for provider in providers:
        names = [name for name in provider.provider_names if name.lower() not in taken]
        taken.update(name.lower() for name in names)
        if names and not any(provider is other for other in beside):
            packages = dict.fromkeys(entry.distribution for entry in _came_from(provider))
            whence = ", ".join(filter(None, packages)) or _kind(provider)
            logger.info(tr("serving %s (%s)"), ", ".join(names), whence)


def warn_of_clashes(providers: Sequence[Provider]) -> None:
    """Tell the log of every provider name that two claim; the first has it."""
    owners: dict[str, Provider] = {}
    for provider in providers:
        for name in provider.provider_names:
            owner = owners.setdefault(name.lower(), provider)
            if owner is not provider:
                text = tr("the provider name %s is claimed by %s and by %s: the first has it")
                logger.warning(text, name, _origin(owner), _origin(provider))


# --- entry points -----------------------------------------------------------------------------------------------------


def _entries() -> list[metadata.EntryPoint]:
    try:
        found = list(metadata.entry_points(group=GROUP))
    except Exception:  # noqa: BLE001 - a package whose data are damaged, one of all that are installed
        found = [entry for each in metadata.distributions() for entry in _entries_of(each)]
    return sorted(found, key=lambda entry: (entry.name.lower(), _distribution(entry)))


def _entries_of(distribution: metadata.Distribution) -> list[metadata.EntryPoint]:
    try:
        return list(distribution.entry_points.select(group=GROUP))
    except Exception as error:  # noqa: BLE001 - as above: it is this one
        text = tr("entry points that cannot be read: %s: %s")
        logger.warning(text, getattr(distribution, "_path", distribution), _reason(error))
        return []


def _distribution(entry: metadata.EntryPoint) -> str:
    try:
        return "" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    except Exception:  # noqa: BLE001 - its METADATA are damaged or not there
        return ""


def _installed(entry: metadata.EntryPoint) -> Installed:
    return Installed(entry.name, _distribution(entry), entry.value)


def _came_from(provider: Provider) -> tuple[Installed, ...]:
    """Return the entries that a provider was loaded from: one, or several that name the same object."""
    found: tuple[Installed, ...] = vars(provider).get(_ENTRIES, ())
    return found


def _named(target: str) -> metadata.EntryPoint | None:
    return next((entry for entry in _entries() if entry.name.lower() == target.lower()), None)


def _load_entry(entry: metadata.EntryPoint) -> Provider:
    place = f"{entry.name} = {entry.value}"
    name, _, attribute = entry.value.partition("[")[0].partition(":")
    provider = _made(place, _find(place, _import(place, name.strip()), attribute.strip()))
    provider = _reachable(place, provider, also=entry.name)
    here = _installed(entry)
    if here not in (entries := _came_from(provider)):
        vars(provider)[_ENTRIES] = (*entries, here)
    return provider


# --- modules and files ------------------------------------------------------------------------------------------------


def _import(target: str, name: str) -> ModuleType:
    """Import a module by its name.

    Raises:
        LoadFailed: it cannot be.
    """
    if not all(part.isidentifier() for part in name.split(".")):
        raise _failed(
            target,
            tr("neither the name of an installed provider, nor module:Class, nor file.py:Class"),
        )
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise _failed(target, _reason(error)) from error  # one that it imports itself
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
        "there is no module {name}, and no such provider (there are: {offered}).{hint}",
        name=name,
        offered=offered,
        hint=hint,
    )


def _import_file(target: str, path: Path) -> ModuleType:
    """Import a file, or return the module if it has been imported.

    Raises:
        LoadFailed: it cannot be.
    """
    try:
        path = path.resolve()
        there = path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    if not there:
        raise _failed(target, tr("there is no such file"))
    name = _module_name(path)
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise _failed(target, tr("no file of Python"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look a class's module up there
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
    """Return the name of a file's module: its own, unless another module is or would be found under it."""
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
    """Let modules of a directory be imported."""
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


# --- what is found there ----------------------------------------------------------------------------------------------


def _find(target: str, module: ModuleType, attribute: str) -> object:
    """Return what an attribute names; without one, the only class of a provider.

    Raises:
        LoadFailed: there is no such thing, or several classes.
    """
    classes = _classes(module)
    if attribute:
        found: object = module
        for part in attribute.split("."):
            try:
                found = getattr(found, part)
            except Exception as error:
                raise _failed(target, _not_there(attribute, error, classes)) from error
        return found
    if len(classes) == 1:
        return classes[0]
    if classes:
        raise _failed(target, tr("say which class of it: {names}", names=_names(classes)))
    raise _failed(target, tr("it has no class of a Device or Provider of its own"))


def _not_there(attribute: str, error: Exception, classes: Sequence[type[Provider]]) -> str:
    if not isinstance(error, AttributeError):
        return _reason(error)
    shown = attribute[:_SHOWN]
    if not classes:
        return tr("it has no {name}", name=shown)
    return tr("it has no {name}, but {classes}", name=shown, classes=_names(classes))


def _names(classes: Sequence[type[Provider]]) -> str:
    return ", ".join(each.__name__ for each in classes)


def _classes(module: ModuleType) -> list[type[Provider]]:
    """Return the classes of providers that a module, or a package's modules, define for others."""
    name = module.__name__
    found = [each for each in vars(module).values() if isinstance(each, type) and issubclass(each, Provider)]
    own = [each for each in found if f"{each.__module__}.".startswith(f"{name}.") and each.__name__[0] != "_"]
    return list(dict.fromkeys(own))


def _made(target: str, found: object) -> Provider:
    """Return the provider that was found, or is made by what was found.

    Raises:
        LoadFailed: it is none, or none can be made.
    """
    made = found
    if _makes(found):
        _check_arguments(target, found)
        try:
            made = found()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise _failed(target, _reason(error)) from error
    if not isinstance(made, Provider):
        shown = _REPR.repr(made)
        raise _failed(target, tr("a Device or Provider is needed, not {shown}", shown=shown))
    return made


def _makes(found: object) -> TypeGuard[Callable[[], object]]:
    """Whether it is to be called: a class of providers, or a function."""
    if isinstance(found, type):
        return issubclass(found, Provider)
    return callable(found) and not isinstance(found, Provider) and not inspect.iscoroutinefunction(found)


def _check_arguments(target: str, maker: Callable[[], object]) -> None:
    """Refuse a class or function that wants arguments: there is nobody to give them.

    Raises:
        LoadFailed: it does.
    """
    try:
        signature = inspect.signature(maker)
    except (TypeError, ValueError):  # of a compiled one nothing is known
        return
    try:
        signature.bind()
    except TypeError:
        call = f"{getattr(maker, '__name__', _REPR.repr(maker))}{str(signature).partition(' ->')[0]:.{_SHOWN}}"
        raise _failed(
            target,
            tr("{call} needs arguments. Try: a function without arguments that returns one", call=call),
        ) from None


def _reachable(target: str, provider: Provider, also: str = "") -> Provider:
    """Return a provider after making sure that clients can name it, by one more name if that is given.

    Raises:
        LoadFailed: it has no name, or its names are none.
    """
    try:
        names = provider.provider_names
        if names:
            ProviderRegistry(provider)  # looks at them
        if also and also.lower() not in (name.lower() for name in names):
            provider.provider_names = (*names, also)
    except Exception as error:
        raise _failed(target, str(error) if isinstance(error, TypeError) else _reason(error)) from error
    if not provider.provider_names:
        raise _failed(
            target,
            tr("it has no provider_names, so nobody could connect to it"),
        )
    return provider


# --- messages ---------------------------------------------------------------------------------------------------------


def _failed(target: str, reason: str) -> LoadFailed:
    shown = target if len(target) <= _SHOWN else f"...{target[3 - _SHOWN :]}"  # the end of a path says more
    return LoadFailed(f"{shown or repr(shown)}: {reason}")


def _reason(error: BaseException) -> str:
    """Return what an exception says, and where it was raised."""
    lines = traceback.format_exception_only(error)
    text = " ".join("".join(lines[-1:] if isinstance(error, SyntaxError) else lines).split())[:_LONGEST]
    not_theirs = ("<frozen", _PACKAGE)
    places = [each for each in traceback.extract_tb(error.__traceback__) if not each.filename.startswith(not_theirs)]
    if isinstance(error, SyntaxError) and error.filename:
        return f"{text} ({Path(error.filename).name}:{error.lineno})"
    if places:
        return f"{text} ({Path(places[-1].filename).name}:{places[-1].lineno})"
    return text


def _kind(provider: Provider) -> str:
    return f"{type(provider).__module__}.{type(provider).__qualname__}"


def _origin(provider: Provider) -> str:
    """Return the entries and packages of a provider, else its class."""
    places = (f"{each.name} = {each.value} ({each.distribution or '?'})" for each in _came_from(provider))
    return ", ".join(places) or _kind(provider)
