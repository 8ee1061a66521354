"""Access rules: read-only access, or lists of allowed calls. :class:`RestrictedProvider` applies rules to any provider.

A forbidden call returns E_ACCESSDENIED and does not reach the provider. The lists contain shell patterns (``*``, ``?``,
``[12]``); case is ignored. Calls that start or stop the service, connect to or disconnect from a controller, or release
an object are always allowed.

Controllers may ignore the case of non-ASCII letters in different ways. A name with such letters is therefore allowed
only if it matches the list in each of these ways.
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
from orinkit.core.validation import brief
from orinkit.rc8.pose_arguments import line_type_as_position, read_targets
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType

READING: Final[Mapping[str, frozenset[str]]] = {
    interface: frozenset(name.lower() for name in names.split())
    for interface, names in {
        # RC8 3.3.6, and other commands that clients use (docs/howto/virtual-rc8.md)
        "Controller": """
            GetErrorDescription GetCurErrorCount GetCurErrorInfo GetErrorLogCount GetErrorLog GetOprLogCount GetOprLog
            SysInfo SysState StoState GetAutoMode GetPublicValue
            HandCurPos HandCurLoad HandCurPressure HandBusyState HandHoldState HandInposState HandZonState
            HandMotorState
        """,
        # RC8 3.3.4 and table 4-1, and slvGetLateness of virtual controllers. Only real controllers have the commands of
        # the second half.
        "Robot": """
            TakeArmState CurSpd CurAcc CurDec CurJSpd CurJAcc CurJDec CurExtSpd CurExtAcc CurExtDec CurTool CurWork
            CurPos CurPosEx CurJnt CurJntEx CurTrn CurTrnEx CurFig
            HighCurPos HighCurPosEx HighCurJnt HighCurJntEx HighCurTrn HighCurTrnEx HighCurFig
            DestPos DestPosEx DestJnt DestJntEx DestTrn DestTrnEx DestFig
            P2J P2T J2P J2T T2P T2J TMul TInv TNorm MPS RPM DPS Dev DevH OutRange MotionComplete
            GetToolDef GetWorkDef WorkAttribute GetBaseDef ConvertPosWork GetAreaDef AreaSize GetAreaEnabled
            CheckVirtualFence GetPathPointCount GetPathPoint
            GetSrvData GetSrvJntData CurPayLoad CurForceSensorPayLoad ForceValue RobInfo GetHandIO
            GetCtrlLogMaxTime GetCtrlLogInterval GetMechaButtonState CurScene CurSubScene SceneInfo
            GetLogCount GetLogRecord slvGetMode slvGetLateness GetRobotTypeName
            CurSpeedMode GetMotionPreparationState
            HandCurPos HandCurLoad HandCurPressure HandBusyState HandHoldState HandInposState HandZonState
            HandMotorState
            TwofgIsConn TwofgIsBusy TwofgIsGrip TwofgGetErrorCode TwofgGetWidth TwofgGetMinWidth TwofgGetMaxWidth
            TwofgGetForce TwofgGetOrientation TwofgGetFingerLength TwofgGetFTWidth TwofgGetMode
            Vgc10IsConn Vgc10IsGrip Vgc10GetVacuum
        """,
        "Task": "GetStatus GetThreadPriority",  # RC8 3.2
        # Electric grippers
        "Extension": """
            CurPos GetPoint get_EmgState get_ZonState get_OrgState get_HoldState get_InposState get_Error get_BusyState
            get_MotorState
        """,
        "File": "",
    }.items()
}
"""Commands of Execute that only read, in lower case, by interface. With ``read_only``, no other commands are allowed.

No documented command of a VE026A is included, because all of them have effects: Motor, slvChangeMode, slvMove and
ClearError (VE026A 5.3).
"""

_COMMAND: Final = "execute"
_MAX_LENGTH: Final = 1000  # characters; longer names are never allowed
_ANY: Final = "*"  # in the name of a variable, if the client chooses the number of the variable later
_LEADING_ZEROS: Final = re.compile(r"([a-z]|io[a-z]?)0+([0-9]+)")
_LIKE_ASCII: Final = str.maketrans({"\u0130": "i", "\u0131": "i", "\u017f": "s", "\u212a": "k"})
_FOLDINGS: Final[tuple[Callable[[str], str], ...]] = (
    str.lower,
    str.casefold,
    lambda text: text.upper().lower(),
    lambda text: text.translate(_LIKE_ASCII).lower(),  # the case folding of re.IGNORECASE
    lambda text: unicodedata.normalize("NFKC", text).casefold(),
    lambda text: unicodedata.normalize("NFKC", text).translate(_LIKE_ASCII).casefold(),
)
_MARK: Final = re.compile(r"@\s*+(?:[pec]|[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?)")
_REFERENCE: Final = re.compile(r"(?<![a-z0-9_])(io[bwdf]?|[ifdvpjts])\s*+(?:\[?+\s*+([0-9]++)|\[)")
_TAKING_POSES: Final = frozenset(
    {"p2j", "p2t", "j2p", "j2t", "t2p", "t2j", "dev", "devh", "outrange", "convertposwork"}
    | {"approach", "draw", "archmove", "tmul", "tinv", "tnorm"}
    | {"addpathpoint", "settooldef", "setworkdef", "setbasedef"}
)  # commands of the robot that interpret [5, "P"] as the variable P5; other commands interpret it as two parameters
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
    """Access rules. Without any restriction, everything is allowed.

    A list of variables restricts the variables that a client names in calls. It does not restrict the programs of the
    controller: a client that may write and start a program can reach all variables. To prevent this, also set
    ``read_only``, or a list of functions without ``File_*`` and ``Task_*``.

    Attributes:
        read_only: Allow only reading: functions named Get..., and the commands of :data:`READING`.
        functions: Patterns of function names, for example ``Robot_*``. The names are those of the b-CAP documents.
        variables: Patterns of variable names, for example ``IO1[0-9]``. They apply to the variables of all objects.
            Leading zeros of numbers are ignored: ``I015`` is ``I15``. The name of a variable may contain ``*``; the
            client then chooses the number later, by setting the ID of the variable. Such a variable is allowed only by
            the identical pattern or by ``*``: ``I*`` is allowed by ``I*``, not by ``I??*`` or ``I[!0]*``. The list also
            applies to variables that a call names in its arguments: in any text in the parameters of an Execute
            function or of a Command object (``"@P P1"``), and in the poses (``[5, "P"]``) and options (``SPEED=F2``) of
            Robot_Move, Robot_Rotate and Robot_Drive. In the parameters of a Command object, any array that may be a
            pose is treated as a pose, because the meaning of the array is unknown.
        commands: Patterns of commands of Execute and of Command objects, for example ``CurPos`` or ``Robot.CurPos``.

    Raises:
        TypeError: If a list of patterns is a single text, or contains an element that is not a text.
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
                    tr("{name} must be a list of patterns, not {patterns}", name=name, patterns=brief(patterns))
                )

    def check(self, function: Function[..., Any], arguments: Sequence[Any]) -> None:
        """Check that a call is allowed.

        Args:
            function: Function of CAO.
            arguments: Arguments of the call, without the handle.

        Raises:
            CallError: E_ACCESSDENIED, if the call is forbidden.
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
    """A provider that applies access rules to another provider.

    Args:
        provider: Provider to restrict.
        rules: Access rules.
    """

    def __init__(self, provider: Provider, rules: AccessRules) -> None:
        self._provider = provider
        self._rules = rules
        self.provider_names = provider.provider_names
        self.guard = provider.guard
        self.dialect = provider.dialect
        self.functions = provider.functions
        self.fixed_handles = provider.fixed_handles
        self.requires_secret = provider.requires_secret
        self.unique_names = provider.unique_names
        self.unwraps_variants = True  # the rules apply to the values

    def handle_of(self, interface: str, name: str) -> int:
        """Return the restricted provider's handle for an object; used only if ``fixed_handles`` is set."""
        return self._provider.handle_of(interface, name)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Result[ControllerObject]:
        """Connect to the restricted provider for one client; return a controller object that applies the rules."""
        made: Result[ControllerObject] = _restricted(
            "Controller", self._provider.connect(name, machine, option, client), self._rules
        )
        return made

    def close(self) -> Awaitable[None] | None:
        """Close the provider after the server has stopped."""
        return self._provider.close()


class _RestrictedObject(CaoObject):
    """An object that checks each call of the client and forwards allowed calls to an object of the provider."""

    def __init__(self, served: CaoObject, rules: AccessRules) -> None:
        super().__init__()
        self._served = served
        self._rules = rules

    def release(self) -> None:
        self._served.release()

    def is_moving(self) -> bool:
        """Return True if an arm of the provider's controller executes a motion of this client, or may start one."""
        return isinstance(self._served, ControllerObject) and self._served.is_moving()

    def stop_moving(self) -> None:
        """Stop the motions of the client. The access rules do not apply, because the server calls this method."""
        if isinstance(self._served, ControllerObject):
            self._served.stop_moving()

    def connection_lost(self) -> None:
        """Pass on that the client has been lost. The access rules do not apply, because the server calls this method."""
        if isinstance(self._served, ControllerObject):
            self._served.connection_lost()

    def _call(self, function: Function[..., Any], arguments: tuple[Any, ...]) -> Any:
        self._rules.check(function, arguments)
        result = getattr(self._served, function.method)(*arguments)
        return _restricted(function.creates, result, self._rules) if function.creates else result


def _checked(function: Function[..., Any]) -> Callable[..., Any]:
    def method(self: _RestrictedObject, *arguments: Any) -> Any:
        return self._call(function, arguments)

    method.__name__, method.__doc__ = function.method, function.en
    return method


_CLASSES: Final[dict[str, Callable[[CaoObject, AccessRules], Any]]] = {
    interface: type(
        f"_Restricted{interface}",
        (_RestrictedObject,),
        {e.method: _checked(e) for e in FUNCTIONS.values() if e.interface == interface and e.id not in _ALWAYS},
    )
    for interface in dict.fromkeys(entry.creates for entry in FUNCTIONS.values() if entry.creates)
}


def _restricted(interface: str, result: Any, rules: AccessRules) -> Any:
    """Return the result of a provider's method, which may be immediate or deferred.

    If the result is a CAO object, it is replaced by an object that applies the rules to the calls of the client.
    """
    if isinstance(result, CaoObject):
        return _CLASSES[interface](result, rules)
    if type(result) is ResultWithCode:
        return ResultWithCode(result.code, _restricted(interface, result.value, rules))
    if type(result) is BlockingCall:
        return BlockingCall(lambda: _restricted(interface, result.run(), rules))
    if type(result) is Deferred:
        return _restricted_deferred(interface, result, rules)
    return _restricted_awaitable(interface, result, rules) if isawaitable(result) else result


async def _restricted_awaitable(interface: str, result: Awaitable[Any], rules: AccessRules) -> Any:
    return _restricted(interface, await result, rules)


def _restricted_deferred(interface: str, result: Deferred[Any], rules: AccessRules) -> Deferred[Any]:
    deferred = Deferred[Any](brief=result.brief)

    def settle() -> None:
        try:
            deferred.set_result(_restricted(interface, result.result(), rules))
        except BaseException as error:  # noqa: BLE001 - the provider may raise any exception
            deferred.set_exception(error)

    result.add_done_callback(settle)
    return deferred


def _command_of(function: Function[..., Any], arguments: Sequence[Any]) -> str | None:
    """Return the name of the command if a call is Execute or creates a Command object; otherwise ``None``."""
    if function.creates == "Command" or (function.method == _COMMAND and isinstance(arguments[0], str)):
        return str(arguments[0])
    return None


def _allows(patterns: Sequence[str], function: Function[..., Any], command: str) -> bool:
    """Return True if a command is on the list of allowed commands.

    The name of a Command object may begin with the name of the object that executes the command: ``Robot.Motor``.
    Patterns may omit this beginning.
    """
    return _matches(command, patterns) or (bool(function.creates) and _matches(command.rpartition(".")[2], patterns))


def _only_reads(function: Function[..., Any], arguments: Sequence[Any]) -> bool:
    if function.method == _COMMAND:
        return str(arguments[0]).strip().lower() in READING.get(function.interface, ())
    if function.creates == "File":
        return not _creates_file(arguments[-1])
    return function.method.startswith("get_")


def _creates_file(option: str) -> bool:
    """Return True if at least one type of controller may create a file because of this option string."""
    if _CREATE not in option.lower():
        return False
    options = Options(option)
    return _CREATE not in options or options.text_of(_CREATE).strip().lower() not in _OFF


def _matches(name: str, patterns: Iterable[str]) -> bool:
    return _passes(name, patterns, fnmatchcase, str.strip)


def _covers(name: str, patterns: Iterable[str]) -> bool:
    """Return True if a variable is on the list; see :attr:`AccessRules.variables`."""
    return _passes(name, patterns, _covers_folded, _without_zeros)


def _passes(name: str, patterns: Iterable[str], match: Callable[[str, str], bool], tidy: Callable[[str], str]) -> bool:
    """Return True if a name matches at least one pattern in each of the ways in which a controller may ignore case.

    Args:
        name: Name of a function, a command or a variable.
        patterns: Patterns of the list.
        match: Function that compares the name with a pattern, both in lower case.
        tidy: Function that is applied to name and pattern before they are compared.
    """
    if len(name) > _MAX_LENGTH:
        return False
    for fold in _FOLDINGS[:1] if name.isascii() else _FOLDINGS:
        plain = tidy(fold(name).strip())
        if len(plain) > _MAX_LENGTH or not any(match(plain, tidy(fold(pattern).strip())) for pattern in patterns):
            return False
    return True


def _covers_folded(name: str, pattern: str) -> bool:
    return pattern in (name, _ANY) if _ANY in name else fnmatchcase(name, pattern)


def _without_zeros(name: str) -> str:
    """Return ``i15`` for ``i015``. Names of other forms, and patterns with wildcards, are returned unchanged."""
    found = _LEADING_ZEROS.fullmatch(name)
    return f"{found[1]}{found[2]}" if found else name


def _variables_in(function: Function[..., Any], arguments: Sequence[Any]) -> Iterator[str]:
    """Yield the names of the variables that a call refers to."""
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
    """Return True if a command may interpret arrays as poses; always True if its name has non-ASCII letters."""
    return not command.isascii() or command.strip().lower() in _TAKING_POSES


def _named_in(argument: Any, *, arrays: bool) -> Iterator[str]:
    """Yield the names of the variables in an argument.

    The names are searched for in texts and, if ``arrays`` is True, also in arrays such as ``[5, "P"]``, which is P5.
    """
    pending = [argument]
    while pending:
        given = pending.pop()
        value = given.value if isinstance(given, Variant) else given
        if isinstance(value, str):
            yield from _named_in_text(value)
        if isinstance(given, Variant) and given.type & ARRAY:
            if arrays:
                yield from _named_in_array(given)
            if given.type in (VARIANT_ARRAY, _TEXTS):
                pending += given.value


def _named_in_text(text: str) -> Iterator[str]:
    """Yield the names of the variables in a text such as ``P1``, ``P[1]`` or ``@PP 1``.

    If the index is not a number, as in ``P[I1]``, its value is unknown; the name is then ``P*``.
    """
    for fold in _FOLDINGS[:1] if text.isascii() else (_FOLDINGS[0], _FOLDINGS[-1]):
        for found in _REFERENCE.finditer(_MARK.sub(" ", fold(text))):
            digits = found[2]
            yield found[1].upper() + (_ANY if digits is None else digits.lstrip("0") or "0")


def _named_in_array(given: Variant) -> Iterator[str]:
    try:
        targets = read_targets(line_type_as_position(given))
    except CallError:
        return  # not a pose
    for target in targets:
        if isinstance(target.value, int):
            yield f"{target.kind or 'P'}{target.value}"


def _denied(what: str, *, read_only: bool = False) -> CallError:
    reason = tr("only reading is allowed") if read_only else tr("not on the list of allowed calls")
    return error_for(hresult.E_ACCESSDENIED, f"{what}: {reason}")
