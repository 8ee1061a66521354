"""What the asynchronous and the synchronous client share: plain data, no calls."""

from __future__ import annotations

from collections import Counter, deque
from datetime import datetime
from operator import index
from threading import Lock
from typing import Any, Final, NamedTuple, TypeVar

from orinkit.bcap.profiles import LEAST_TRIES, MOST_TRIES, STREAM
from orinkit.cao.dialect import DIALECTS, VE026A, Dialect
from orinkit.cao.table import Function
from orinkit.cao.transport_profile import TransportProfile
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, ProtocolError, error_for
from orinkit.core.i18n import tr
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.values.pose_numbers import brief
from orinkit.values.variant import Value, Variant, VarType

RC8: Final = "CaoProv.DENSO.VRC"
"""The provider name of RC8, RC8A and COBOTTA controllers (RC8 3.1.2)."""

DEFAULT_TIMEOUT: Final = STREAM.timeout
T = TypeVar("T", str, bytes)
_LEAST_ALIVE: Final = 0.3  # s
_MOST_ALIVE: Final = 3600.0
_LEAST_WDT: Final = 0.08
_USUAL_WDT: Final = 0.4
_MOST_SECONDS: Final = 2e6
_LINE: Final = 3  # place of the line in the details of an error; that of the program is before it
_LOGGED_MESSAGE: Final = 12  # place in a record of the error log


class ObjectFunctions(NamedTuple):
    """The functions that every kind of object has under its own ids; ``None`` where a kind has none."""

    release: Function[[int], None]
    attribute: Function[[int], int] | None = None
    help: Function[[int], str] | None = None
    name: Function[[int], str] | None = None
    get_tag: Function[[int], Any] | None = None
    put_tag: Function[[int, Value], None] | None = None
    get_id: Function[[int], Any] | None = None
    put_id: Function[[int, Value], None] | None = None
    variable: Function[[int, str, str], int] | None = None
    variable_names: Function[[int, str], Any] | None = None
    execute: Function[[int, str, Value], Any] | None = None


class ErrorInfo(NamedTuple):
    """One error that the controller reports now (GetCurErrorInfo).

    Attributes:
        code: unsigned 32 bits.
        message: the controller's own text.
        details: what else the controller says of it, as it came.
    """

    code: int
    message: str
    details: tuple[Any, ...] = ()

    @property
    def program(self) -> str:
        """Program in which it happened; ``""`` where that is not told."""
        return self.details[2] if len(self.details) > _LINE and isinstance(self.details[2], str) else ""

    @property
    def line(self) -> int:
        """Line of the program, counted from 1; 0 where that is not told."""
        line = self.details[_LINE] if self.program else 0
        return line if isinstance(line, int) else 0

    def __str__(self) -> str:
        return f"0x{self.code:08X} {self.message or hresult.lookup(self.code).text}"

    def __repr__(self) -> str:
        return f"ErrorInfo(code=0x{self.code:08X}, message={self.message!r}, details={self.details!r})"


def not_understood(command: str, answer: Any) -> ProtocolError:
    """Return the error of a command whose answer is not what it should be."""
    return ProtocolError(tr("{command} was answered with {answer!r:.80}", command=command, answer=answer))


def error_count(answer: Any) -> int:
    """Read what GetCurErrorCount answers with.

    Raises:
        ProtocolError: it is no number.
    """
    if isinstance(answer, int | float) and 0 <= answer < 2**31:
        return int(answer)
    raise not_understood("GetCurErrorCount", answer)


def no_such_error(error: CallError) -> bool:
    """Return whether an error is that of a list which has become shorter meanwhile."""
    return error.code == hresult.DISP_E_BADINDEX


def error_info(answer: Any) -> ErrorInfo:
    """Read the array that GetCurErrorInfo answers with: code, message, details (reference: docs/protocol.md).

    Raises:
        ProtocolError: it is no such array.
    """
    if isinstance(answer, list) and len(answer) > 1 and isinstance(answer[0], int) and isinstance(answer[1], str):
        return ErrorInfo(hresult.unsigned(answer[0]), answer[1], tuple(answer[2:]))
    raise not_understood("GetCurErrorInfo", answer)


def service_option(option: str | None, profile: TransportProfile, dialect: Dialect, timeout: float) -> str | None:
    """Return Service_Start's option: as given, or a watchdog that lets long calls outlast the time-out.

    The watchdog interval must be above 80 ms and below the time-out (RC8 table 3-1); where that cannot be, none is asked
    for, nor where the controller tells in another way that it is at work.
    """
    if option is not None:
        return option or None
    if not profile.watched or not dialect.takes_options:
        return None
    interval = min(_USUAL_WDT, timeout / 2)
    return f"WDT={round(interval * 1000)}" if interval > _LEAST_WDT + 0.001 else None


def check_alive(seconds: float | None, option: str | None, dialect: Dialect) -> None:
    """Check the seconds within which a client is to be heard.

    Raises:
        InvalidValue: they are no number from 0.3 to 3,600; or the dialect knows no options.
    """
    if seconds is None:
        return
    given: object = seconds
    if isinstance(given, bool) or not isinstance(given, int | float) or not _LEAST_ALIVE <= given <= _MOST_ALIVE:
        raise InvalidValue(
            tr(
                "alive must be {least:g} to {most:g} seconds, not {seconds}",
                least=_LEAST_ALIVE,
                most=_MOST_ALIVE,
                seconds=brief(seconds),
            )
        )
    if not dialect.takes_options:
        raise InvalidValue(
            tr("alive cannot be said in the dialect {name}, whose Service_Start has no options", name=dialect.name)
        )
    if option is not None and "alive=" in option.replace(" ", "").lower():
        raise InvalidValue(tr("give alive= or Alive in service=, not both"))


def check_watchdog(option: str | None) -> None:
    """Check that an option of Service_Start asks for no watchdog where the tries of a call are the signs of life.

    Raises:
        InvalidValue: it does: S_EXECUTING would put the next try off.
    """
    if option is not None and "wdt=" in option.replace(" ", "").lower():
        raise InvalidValue(
            tr(
                "over UDP and serial lines alive= cannot be combined with WDT in service=: the tries of "
                "a call are the signs of life, and WDT stops them. Try: leave WDT out"
            )
        )


def with_alive(option: str | None, seconds: float | None) -> str | None:
    """Return Service_Start's option with the time within which the client is to be heard; ``None`` leaves it as it is."""
    if seconds is None:
        return option
    return ",".join(part for part in (option, f"Alive={round(seconds * 1000)}") if part)


def motor_state(dialect: Dialect, *, on: bool) -> Value:
    """Return the parameter of Motor: that it is to be waited for too, where that can be said."""
    return Variant(VarType.I2, int(on)) if dialect.short_numbers else [int(on), 0]


def no_code(dialect: Dialect) -> Value:
    """Return the parameter of ClearError (VE026A table 5-2: a code that is not used)."""
    return Variant(VarType.I2, 0) if dialect.short_numbers else None


def dialect_of(name: str | None, provider: str) -> Dialect | None:
    """Return the dialect of that name, or that a provider's name tells; ``None`` where nothing does.

    Raises:
        InvalidValue: there is no dialect of that name.
    """
    if name is not None:
        given: object = name
        dialect = DIALECTS.get(given.lower()) if isinstance(given, str) else None
        if dialect is None:
            known = ", ".join(DIALECTS)
            raise InvalidValue(tr("dialect: {name}; possible: {known}", name=brief(name), known=known))
        return dialect
    return VE026A if not provider or is_ve026a(provider) else None


def is_ve026a(told: object) -> bool:
    """Whether the name of a provider, or a version, is that of a VE026A."""
    return VE026A.name.upper() in str(told).upper()


def forgotten_after(profile: TransportProfile) -> str:
    """Return what there is to say of a handle that is not known any more, to a client that was silent for long."""
    name, seconds = profile.name.upper(), profile.memory
    return tr(
        "a controller forgets a client on {name} that calls nothing for {seconds:g} s, with all "
        "its objects. Connect again, call something now and then, or use TCP",
        name=name,
        seconds=seconds,
    )


def check_timeout(seconds: float, name: str = "timeout") -> float:
    """Return a time-out in seconds.

    Raises:
        InvalidValue: it is not a positive number, or more than a clock of the system can count.
    """
    if not _is_number(seconds) or not 0 < seconds <= _MOST_SECONDS:
        raise InvalidValue(
            tr(
                "{name} must be a positive number of seconds up to {most:.0e}, not {seconds}",
                name=name,
                most=_MOST_SECONDS,
                seconds=brief(seconds),
            )
        )
    return float(seconds)


def check_deadline(seconds: float | None) -> float | None:
    """Return a deadline in seconds, ``None`` for none.

    Raises:
        InvalidValue: it is not a positive number, or more than a clock of the system can count.
    """
    return None if seconds is None else check_timeout(seconds, "deadline")


def check_tries(number: int) -> int:
    """Return how often a request is sent in all: 1 to 7, what is below counts as 1, what is above as 7 (RC8 table 5-1).

    Raises:
        InvalidValue: it is no whole number.
    """
    try:
        whole = index(number)
    except TypeError:
        raise InvalidValue(
            tr(
                "tries must be a whole number from {least} to {most}, not {number}",
                least=LEAST_TRIES,
                most=MOST_TRIES,
                number=brief(number),
            )
        ) from None
    return min(max(whole, LEAST_TRIES), MOST_TRIES)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def text_list(answer: Any) -> list[str]:
    """Return a list of names; a controller without any answers VT_EMPTY."""
    return [] if answer is None else [answer] if isinstance(answer, str) else [str(name) for name in answer]


# --- tasks ------------------------------------------------------------------------------------------------------------


def task_mode(kind: type[TaskMode | StopMode], mode: str | int) -> int:
    """Return the number of a mode from its name; a number is sent as it is.

    Raises:
        InvalidValue: there is no mode of that name.
    """
    if not isinstance(mode, str):
        return int(mode)
    try:
        return int(kind[mode.strip().upper()])
    except KeyError:
        known = ", ".join(f'"{each.name.lower()}"' for each in kind)
        raise InvalidValue(tr("there is no mode {mode!r:.40}; {known}", mode=mode, known=known)) from None


def task_status(answer: Any) -> TaskStatus:
    """Read what GetStatus answers with.

    Raises:
        ProtocolError: it is no status.
    """
    try:
        return TaskStatus(answer)
    except ValueError:
        raise not_understood("GetStatus", answer) from None


def is_program(program: str, task: str) -> bool:
    """Return whether the program that an error tells is that of a task."""
    names = [name.strip().replace("\\", "/").casefold().removesuffix(".pcs") for name in (program, task)]
    return bool(names[0]) and names[0] == names[1]


def program_error(info: ErrorInfo, task: str) -> CallError:
    """Return the error that has ended a program as an exception."""
    where = tr("{program}, line {line}", program=info.program, line=info.line) if info.line else info.program
    error = error_for(info.code, f"{where}: {info.message}")
    error.subject = task
    return error


def logged_message(answer: Any, code: int) -> str:
    """Return the message of a record that GetErrorLog answers with, ``""`` for one of another code, or none."""
    if not isinstance(answer, list) or len(answer) <= _LOGGED_MESSAGE or not isinstance(answer[0], int):
        return ""
    message = answer[_LOGGED_MESSAGE]
    return message if isinstance(message, str) and hresult.unsigned(answer[0]) == code else ""


# --- files ------------------------------------------------------------------------------------------------------------


def is_no_file(error: CallError) -> bool:
    """Return whether an error says that a file is not there, but could be."""
    return error.code == hresult.FILE_NOT_FOUND


def file_option(option: str, *, create: bool) -> str:
    """Return the option for connecting to a file, which is made if it is not there."""
    return ",".join(filter(None, ("@Create=1", option))) if create else option


def moment(answer: Any) -> Any:
    """Return a date that a controller has written, ``2024-04-01 09:00:00``, as ``datetime``; others as they are."""
    if isinstance(answer, str):
        try:
            return datetime.fromisoformat(answer.strip())
        except ValueError:
            pass
    return answer


def file_text(content: Any) -> str:
    """Return a file's content as text; bytes are read as UTF-8, or else as Shift_JIS (code page 932).

    Raises:
        InvalidValue: they are neither.
    """
    if content is None:
        return ""
    if isinstance(content, str):
        return content
    if isinstance(content, bytes):
        for encoding in ("utf-8-sig", "cp932"):
            try:
                return content.decode(encoding)
            except UnicodeDecodeError:
                pass
    raise InvalidValue(tr("the content of the file is no text; read .data"))


def file_data(content: Any) -> bytes:
    """Return a file's content as bytes.

    Raises:
        InvalidValue: it is neither text nor bytes.
    """
    if content is None:
        return b""
    if isinstance(content, str):
        return content.encode("utf-8", "surrogatepass")
    if isinstance(content, bytes):
        return content
    raise InvalidValue(
        tr("the content of the file is {content!r:.40}, neither text nor bytes; read .value", content=content)
    )


def check_content(kind: type[T], content: T) -> T:
    """Return what a file is to contain.

    Raises:
        InvalidValue: it is of another type.
    """
    given: object = content
    if isinstance(given, bytearray) and kind is bytes:
        given = bytes(given)
    if isinstance(given, kind):
        return given
    raise InvalidValue(
        tr(
            "{content!r:.40} is no {name}; a file has .text (str) and .data (bytes)",
            content=content,
            name=kind.__name__,
        )
    )


class HandleTable:
    """Handles that this program holds, and those whose objects were dropped without being closed.

    The latter are released before the next object is made. A controller may answer with one handle for several objects
    (``@IfNotMember``; a VE026A always does): it is released with the last of them.
    """

    def __init__(self) -> None:
        self._handles: deque[tuple[Function[[int], None], int]] = deque()
        self._shared: Counter[tuple[int, int]] = Counter()  # by function that releases it, and handle
        self._lock = Lock()

    def hold(self, release: Function[[int], None], handle: int) -> None:
        """One more object has this handle."""
        with self._lock:
            self._shared[release.id, handle] += 1

    def is_last(self, release: Function[[int], None], handle: int) -> bool:
        """One object has it no more; tells whether none is left, so that it is to be released."""
        with self._lock:
            self._shared[release.id, handle] -= 1
            if self._shared[release.id, handle] > 0:
                return False
            del self._shared[release.id, handle]
            return True

    def add(self, release: Function[[int], None], handle: int) -> None:
        """Note a handle; may be called from anywhere, also while Python collects garbage."""
        self._handles.append((release, handle))

    def take(self) -> tuple[Function[[int], None], int] | None:
        """Return one and forget it."""
        try:
            return self._handles.popleft()
        except IndexError:
            return None
