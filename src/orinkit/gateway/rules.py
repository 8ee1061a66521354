"""What a client may call: read-only, or only what is on a list. :class:`RestrictedProvider` puts rules around any provider.

What is not allowed is E_ACCESSDENIED, and does not reach the provider. Lists are of shell patterns (``*``, ``?``,
``[12]``), upper and lower case do not matter. Connecting, disconnecting and releasing are always allowed.
A name with letters beyond ASCII is allowed only where it is under every way in which another side may fold its case.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from inspect import isawaitable
from typing import Any, Final

from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.options import Options
from orinkit.cao.provider import (
    BlockingCall,
    CaoObject,
    ClientInfo,
    ControllerObject,
    Deferred,
    Provider,
    Result,
    ResultWithCode,
)
from orinkit.cao.table import Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.rc8.pose_arguments import read_targets
from orinkit.values.pose_numbers import brief
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType

READING: Final[Mapping[str, frozenset[str]]] = {
    interface: frozenset(name.lower() for name in names.split())
    for interface, names in {
        # RC8 3.3.6, and what clients of controllers use: docs/howto/virtual-rc8.md
        "Controller": """
            GetErrorDescription GetCurErrorCount GetCurErrorInfo GetErrorLogCount GetErrorLog GetOprLogCount GetOprLog
            SysInfo SysState StoState GetAutoMode
            HandCurPos HandCurLoad HandCurPressure HandBusyState HandHoldState HandMotorState
        """,
        # RC8 3.3.4 and table 4-1, and slvGetLateness of virtual ones; the second half are those of real controllers only
        "Robot": """
            TakeArmState CurSpd CurAcc CurDec CurJSpd CurJAcc CurJDec CurExtSpd CurExtAcc CurExtDec CurTool CurWork
            CurPos CurPosEx CurJnt CurJntEx CurTrn CurTrnEx CurFig
            HighCurPos HighCurPosEx HighCurJnt HighCurJntEx HighCurTrn HighCurTrnEx HighCurFig
            DestPos DestJnt DestTrn DestFig
            P2J P2T J2P J2T T2P T2J Dev DevH OutRange MotionComplete GetToolDef GetWorkDef GetPathPointCount
            GetSrvData GetLogCount GetLogRecord slvGetMode slvGetLateness GetRobotTypeName
            CurSpeedMode GetAreaEnabled RobInfo CheckVirtualFence ConvertPoswork GetBaseDef CurForceSensorPayLoad
            GetMotionPreparationState GetMechaButtonState CurScene CurSubScene SceneInfo
        """,
        "Task": "GetStatus",  # RC8 3.2
        "Extension": "CurPos get_BusyState get_HoldState get_OrgState",  # of the electric hand
        "File": "",
    }.items()
}
"""Commands of Execute that change nothing and need no right but that to read, by interface, in lower case.

No documented command of a VE026A is among them: Motor, slvChangeMode, slvMove and ClearError all do something (VE026A 5.3).
"""

_COMMAND: Final = "execute"
_LONGEST: Final = 1000  # characters of a name that is on a list
_ANY: Final = "*"  # in the name of a variable: the client chooses the number afterwards
_LEADING_ZEROS: Final = re.compile(r"([a-z]|io[a-z]?)0+([0-9]+)")
_LIKE_ASCII: Final = str.maketrans({"\u0130": "i", "\u0131": "i", "\u017f": "s", "\u212a": "k"})
_FOLDINGS: Final[tuple[Callable[[str], str], ...]] = (
    str.lower,
    str.casefold,
    lambda text: text.upper().lower(),
    lambda text: text.translate(_LIKE_ASCII).lower(),  # as re.IGNORECASE
    lambda text: unicodedata.normalize("NFKC", text).casefold(),
    lambda text: unicodedata.normalize("NFKC", text).translate(_LIKE_ASCII).casefold(),
)
_MARK: Final = re.compile(r"@\s*+(?:[pe]|[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?)")
_REFERENCE: Final = re.compile(r"(?<![a-z0-9_])(io[bwdf]?|[ifdvpjts])\s*+(?:\[?+\s*+([0-9]++)|\[)")
_TAKING_POSES: Final = frozenset(
    {"p2j", "p2t", "j2p", "j2t", "t2p", "t2j", "dev", "devh", "outrange", "convertposwork"}
    | {"approach", "addpathpoint", "settooldef", "setworkdef", "setbasedef"}
)  # commands of the robot that read [5, "P"] as P5; for others it is two parameters
_TEXTS: Final = VarType.BSTR | ARRAY
_MOTIONS: Final = ("move", "rotate", "drive")
_CREATE: Final = "@create"
_OFF: Final = ("", "0", "false", "off", "no")
_ALWAYS: Final = frozenset(
    entry.id
    for entry in FUNCTIONS.values()
    if entry.releases or entry.interface == "Service" or entry.creates == "Controller"
)


@dataclass(frozen=True, slots=True)
class AccessRules:
    """What is allowed; without any of these, everything.

    A list of variables is about what a client names in a call. Programs of the controller use what they like, so a
    client that may write a file and start it reaches every variable: have ``read_only`` too, or a list of functions
    without ``File_*`` and ``Task_*``.

    Attributes:
        read_only: only what reads: functions whose names say Get, and the commands of :data:`READING`.
        functions: patterns for the documents' names: ``Robot_*``.
        variables: patterns for the names of variables, of whatever object: ``IO1[0-9]``. Numbers are compared without
            leading zeros: ``I015`` is ``I15``. A variable whose name has a ``*``, of which a client chooses the number
            afterwards, is allowed only by a pattern that is this very name, or by ``*``: ``I*`` by ``I*``, not by
            ``I??*`` or ``I[!0]*``. Variables that a call names otherwise have to be on the list too: in any text of the
            parameters of Execute and of Command objects (``"@P P1"``), in poses (``[5, "P"]``) and options
            (``SPEED=F2``) of Robot_Move, Robot_Rotate and Robot_Drive. A Command object does not tell which numbers are
            a pose: all that can be one count.
        commands: patterns for the commands of Execute and for Command objects, ``CurPos`` or ``Robot.CurPos`` too.

    Raises:
        TypeError: a text where several are wanted.
    """

    read_only: bool = False
    functions: Sequence[str] = ()
    variables: Sequence[str] = ()
    commands: Sequence[str] = ()

    def __post_init__(self) -> None:
        for name, patterns in (
            ("functions", self.functions),
            ("variables", self.variables),
            ("commands", self.commands),
        ):
            if isinstance(patterns, str) or not all(isinstance(each, str) for each in patterns):
                raise TypeError(
                    tr("{name}: a list of patterns is needed, not {patterns}", name=name, patterns=brief(patterns))
                )

    def check(self, function: Function[..., Any], arguments: Sequence[Any]) -> None:
        """Let a call pass, or refuse it.

        Args:
            function: an entry of the table.
            arguments: as a provider's method gets them: those behind the handle.

        Raises:
            CallError: E_ACCESSDENIED.
        """
        if function.id in _ALWAYS:
            return
        if self.functions and not _matches(function.name, self.functions):
            raise _denied(function.name)
        command = _command_of(function, arguments)
        if self.commands and command is not None and not _allows(self.commands, function, command):
            raise _denied(f"{function.name} {command:.40}")
        for name in _variables_in(function, arguments) if self.variables else ():
            if not _covers(name, self.variables):
                raise _denied(f"{function.name} {name:.40}")
        if self.read_only and not _only_reads(function, arguments):
            raise _denied(function.name if command is None else f"{function.name} {command:.40}", read_only=True)


class RestrictedProvider(Provider):
    """A provider of which only some of what it has may be used.

    Args:
        provider: any.
        rules: what is allowed.
    """

    def __init__(self, provider: Provider, rules: AccessRules) -> None:
        self._provider = provider
        self._rules = rules
        self.provider_names = provider.provider_names
        self.guard = provider.guard
        self.dialect = provider.dialect
        self.functions = provider.functions
        self.fixed_handles = provider.fixed_handles

    def handle_of(self, interface: str, name: str) -> int:
        """Return the handle of an object, where these are fixed."""
        return self._provider.handle_of(interface, name)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Result[ControllerObject]:
        """Return the controller object for one client."""
        made: Result[ControllerObject] = _covered(
            "Controller", self._provider.connect(name, machine, option, client), self._rules
        )
        return made

    def close(self) -> Awaitable[None] | None:
        """The server has stopped."""
        return self._provider.close()


class _RestrictedObject(CaoObject):
    """An object of which only some of what it has may be used."""

    def __init__(self, served: CaoObject, rules: AccessRules) -> None:
        super().__init__()
        self._served = served
        self._rules = rules

    def release(self) -> None:
        self._served.release()

    def is_moving(self) -> bool:
        """Ask the controller itself."""
        return isinstance(self._served, ControllerObject) and self._served.is_moving()

    def stop_moving(self) -> None:
        """Stop what it moves: that is always allowed."""
        if isinstance(self._served, ControllerObject):
            self._served.stop_moving()

    def _call(self, function: Function[..., Any], arguments: tuple[Any, ...]) -> Any:
        self._rules.check(function, arguments)
        result = getattr(self._served, function.method)(*arguments)
        return _covered(function.creates, result, self._rules) if function.creates else result


def _passed_on(function: Function[..., Any]) -> Callable[..., Any]:
    def method(self: _RestrictedObject, *arguments: Any) -> Any:
        return self._call(function, arguments)

    method.__name__, method.__doc__ = function.method, function.en
    return method


_CLASSES: Final[dict[str, Callable[[CaoObject, AccessRules], Any]]] = {
    interface: type(
        f"_Restricted{interface}",
        (_RestrictedObject,),
        {e.method: _passed_on(e) for e in FUNCTIONS.values() if e.interface == interface and e.id not in _ALWAYS},
    )
    for interface in dict.fromkeys(entry.creates for entry in FUNCTIONS.values() if entry.creates)
}


def _covered(interface: str, result: Any, rules: AccessRules) -> Any:
    """Return what a method has returned, whenever it comes, with the object in it restricted."""
    if isinstance(result, CaoObject):
        return _CLASSES[interface](result, rules)
    if type(result) is ResultWithCode:
        return ResultWithCode(result.code, _covered(interface, result.value, rules))
    if type(result) is BlockingCall:
        return BlockingCall(lambda: _covered(interface, result.run(), rules))
    if type(result) is Deferred:
        return _covered_later(interface, result, rules)
    return _covered_soon(interface, result, rules) if isawaitable(result) else result


async def _covered_soon(interface: str, result: Awaitable[Any], rules: AccessRules) -> Any:
    return _covered(interface, await result, rules)


def _covered_later(interface: str, result: Deferred[Any], rules: AccessRules) -> Deferred[Any]:
    promise = Deferred[Any]()

    def settle() -> None:
        try:
            promise.set_result(_covered(interface, result.result(), rules))
        except BaseException as error:  # noqa: BLE001 - whatever the device has failed with
            promise.set_exception(error)

    result.add_done_callback(settle)
    return promise


def _command_of(function: Function[..., Any], arguments: Sequence[Any]) -> str | None:
    """Return the command that is executed, or of which an object is made."""
    if function.creates == "Command" or (function.method == _COMMAND and isinstance(arguments[0], str)):
        return str(arguments[0])
    return None


def _allows(patterns: Sequence[str], function: Function[..., Any], command: str) -> bool:
    """Whether a command is on the list; the name of a Command object may have its owner in front: ``Robot.Motor``."""
    return _matches(command, patterns) or (bool(function.creates) and _matches(command.rpartition(".")[2], patterns))


def _only_reads(function: Function[..., Any], arguments: Sequence[Any]) -> bool:
    if function.method == _COMMAND:
        return str(arguments[0]).strip().lower() in READING.get(function.interface, ())
    if function.creates == "File":
        return not _creates_file(arguments[-1])
    return function.method.startswith("get_")


def _creates_file(option: str) -> bool:
    """Whether a file may be made; where it cannot be told how another side reads the option, it may."""
    if _CREATE not in option.lower():
        return False
    options = Options(option)
    return _CREATE not in options or options.text_of(_CREATE).strip().lower() not in _OFF


def _matches(name: str, patterns: Iterable[str]) -> bool:
    return _passes(name, patterns, fnmatchcase, str.strip)


def _covers(name: str, patterns: Iterable[str]) -> bool:
    """Whether a variable is on the list; see :attr:`AccessRules.variables`."""
    return _passes(name, patterns, _covers_folded, _without_zeros)


def _passes(name: str, patterns: Iterable[str], match: Callable[[str, str], bool], tidy: Callable[[str], str]) -> bool:
    """Whether a name is on the list under every folding that another side may use."""
    if len(name) > _LONGEST:
        return False
    for fold in _FOLDINGS[:1] if name.isascii() else _FOLDINGS:
        plain = tidy(fold(name).strip())
        if len(plain) > _LONGEST or not any(match(plain, tidy(fold(pattern).strip())) for pattern in patterns):
            return False
    return True


def _covers_folded(name: str, pattern: str) -> bool:
    return pattern in (name, _ANY) if _ANY in name else fnmatchcase(name, pattern)


def _without_zeros(name: str) -> str:
    """Return ``i15`` for ``i015``; names of other forms, and patterns with signs, as they are."""
    found = _LEADING_ZEROS.fullmatch(name)
    return f"{found[1]}{found[2]}" if found else name


def _variables_in(function: Function[..., Any], arguments: Sequence[Any]) -> Iterator[str]:
    """Name the variables that a call is about."""
    if function.creates == "Variable":
        yield str(arguments[0])
    elif function.method == _COMMAND and function.interface != "Command":
        arrays = function.interface == "Robot" and _takes_poses(str(arguments[0]))
        yield from _named_in(arguments[1], arrays=arrays)
    elif function.method == "put_parameters":
        yield from _named_in(arguments[0], arrays=True)
    elif function.interface == "Robot" and function.method in _MOTIONS:
        for argument in arguments:
            yield from _named_in(argument, arrays=True)


def _takes_poses(command: str) -> bool:
    """Whether a command reads arrays as poses; where it cannot be told how another side folds its name, it does."""
    return not command.isascii() or command.strip().lower() in _TAKING_POSES


def _named_in(argument: Any, *, arrays: bool) -> Iterator[str]:
    """Name the variables that an argument refers to, in texts and, where that is asked for, as ``[5, "P"]``."""
    waiting = [argument]
    while waiting:
        given = waiting.pop()
        value = given.value if isinstance(given, Variant) else given
        if isinstance(value, str):
            yield from _named_in_text(value)
        if isinstance(given, Variant) and given.type & ARRAY:
            if arrays:
                yield from _named_in_array(given)
            if given.type in (VARIANT_ARRAY, _TEXTS):
                waiting += given.value


def _named_in_text(text: str) -> Iterator[str]:
    """Name ``P1``, ``P[1]``, ``@PP 1``; an index that is no number is any: ``P*``."""
    for fold in _FOLDINGS[:1] if text.isascii() else (_FOLDINGS[0], _FOLDINGS[-1]):
        for found in _REFERENCE.finditer(_MARK.sub(" ", fold(text))):
            digits = found[2]
            yield found[1].upper() + (_ANY if digits is None else digits.lstrip("0") or "0")


def _named_in_array(given: Variant) -> Iterator[str]:
    try:
        targets = read_targets(given)
    except CallError:
        return  # no pose
    for target in targets:
        if isinstance(target.value, int):
            yield f"{target.kind or 'P'}{target.value}"


def _denied(what: str, *, read_only: bool = False) -> CallError:
    reason = tr("only reading is allowed here") if read_only else tr("not on the list of what is allowed here")
    return error_for(hresult.E_ACCESSDENIED, f"{what}: {reason}")
