"""Data types, checks and conversions shared by the asynchronous and the synchronous client; no I/O."""

from __future__ import annotations

from collections import Counter, deque
from datetime import datetime
from threading import Lock
from typing import Any, Final, NamedTuple, TypeVar

from orinkit.bcap.profiles import LEAST_TRIES, MOST_TRIES, STREAM
from orinkit.cao.dialect import DIALECTS, VE026A, Dialect
from orinkit.cao.table import Function
from orinkit.cao.transport_profile import TransportProfile
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, ProtocolError, error_for
from orinkit.core.i18n import tr
from orinkit.core.validation import brief, check_range, check_seconds, whole
from orinkit.rc8.task_modes import StopMode, TaskMode, TaskStatus
from orinkit.values.variant import Value, Variant, VarType

RC8: Final = "CaoProv.DENSO.VRC"
"""Provider name of RC8, RC8A and COBOTTA controllers (RC8 3.1.2)."""
LOCALHOST: Final = "localhost"
"""Default machine name of Controller_Connect; controllers also accept their own address."""

DEFAULT_TIMEOUT: Final = STREAM.timeout
MIN_ALIVE: Final = 0.3
"""Smallest value of ``alive=`` in s."""
MAX_ALIVE: Final = 3600.0
"""Largest value of ``alive=`` in s."""

T = TypeVar("T", str, bytes)
_MIN_WDT: Final = 0.08  # s
_DEFAULT_WDT: Final = 0.4  # s
_MAX_TIMEOUT: Final = 2e6  # s
_LINE: Final = 3  # index of the line in the details of an error; the index before it is the program
_LOGGED_MESSAGE: Final = 12  # index of the message in a record of the error log


class ObjectFunctions(NamedTuple):
    """The functions of one object type that most object types have, for example GetName.

    The same function of another object type has another ID. A field is ``None`` if the type does not have the function.
    """

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


class CallRequest(NamedTuple):
    """A call to be made.

    Attributes:
        function: Function of CAO.
        arguments: Arguments of the function, in order, with defaults filled in.
        seconds: Time-out in s; on UDP and serial lines, of each attempt.
        exact: True to return the result with its VARIANT type.
        deadline: Maximum duration of the call in s; ``None`` for no limit.
    """

    function: Function[..., Any]
    arguments: tuple[Any, ...]
    seconds: float
    exact: bool = False
    deadline: float | None = None


class ErrorInfo(NamedTuple):
    """An error that is present on the controller (GetCurErrorInfo).

    Attributes:
        code: Return code, unsigned 32 bits.
        message: The controller's own text.
        details: Further values that the controller returns for the error, unchanged.
    """

    code: int
    message: str
    details: tuple[Any, ...] = ()

    @property
    def program(self) -> str:
        """The program in which the error occurred; ``""`` if unknown."""
        return self.details[2] if len(self.details) > _LINE and isinstance(self.details[2], str) else ""

    @property
    def line(self) -> int:
        """The line of the program, counted from 1; 0 if unknown."""
        line = self.details[_LINE] if self.program else 0
        return line if isinstance(line, int) else 0

    def __str__(self) -> str:
        return f"0x{self.code:08X} {self.message or hresult.lookup(self.code).text}"

    def __repr__(self) -> str:
        return f"ErrorInfo(code=0x{self.code:08X}, message={self.message!r}, details={self.details!r})"


def unexpected_value(command: str, answer: Any) -> ProtocolError:
    """Create the error for a command that returned an unexpected value."""
    return ProtocolError(tr("{command} returned an unexpected value: {answer!r:.80}", command=command, answer=answer))


def error_count(value: Any) -> int:
    """Return the number of errors from the result of GetCurErrorCount.

    Raises:
        ProtocolError: If the value is not a number.
    """
    if isinstance(value, int | float) and 0 <= value < 2**31:
        return int(value)
    raise unexpected_value("GetCurErrorCount", value)


def is_bad_index(error: CallError) -> bool:
    """Return True if an error means that the index in the call is out of range.

    The index of an error is out of range, for example, if the errors have been cleared in the meantime.
    """
    return error.code == hresult.DISP_E_BADINDEX


def error_info(value: Any) -> ErrorInfo:
    """Return the error from the result of GetCurErrorInfo: an array of code, message and details (docs/protocol.md).

    Raises:
        ProtocolError: If the value is not such an array.
    """
    if isinstance(value, list) and len(value) > 1 and isinstance(value[0], int) and isinstance(value[1], str):
        return ErrorInfo(hresult.unsigned(value[0]), value[1], tuple(value[2:]))
    raise unexpected_value("GetCurErrorInfo", value)


def service_option(option: str | None, profile: TransportProfile, dialect: Dialect, timeout: float) -> str | None:
    """Return the option string of Service_Start: ``option`` or, if it is ``None``, a request for the watchdog.

    The result is ``None`` if Service_Start is to be called without options.

    With the watchdog, calls may take longer than the time-out. The watchdog interval must be above 80 ms and below the
    time-out (RC8 table 3-1). No watchdog is requested if such an interval is impossible, or if the controller reports
    in another way that a call is still executing.
    """
    if option is not None:
        return option or None
    if not profile.uses_watchdog or not dialect.takes_start_options:
        return None
    interval = min(_DEFAULT_WDT, timeout / 2)
    return f"WDT={round(interval * 1000)}" if interval > _MIN_WDT + 0.001 else None


def check_alive(seconds: float | None, option: str | None, dialect: Dialect) -> None:
    """Check ``alive``, the interval in s within which the server must receive a sign of life from the client.

    ``None`` means that the server requires no signs of life.

    Raises:
        InvalidValue: If the value is not a number from 0.3 to 3,600, if Service_Start has no options in the dialect,
            or if the option string of Service_Start already contains ``Alive``.
    """
    if seconds is None:
        return
    check_range("alive", seconds, MIN_ALIVE, MAX_ALIVE, seconds=True)
    if not dialect.takes_start_options:
        raise InvalidValue(
            tr("alive= is not supported by dialect {name}: its Service_Start has no options", name=dialect.name)
        )
    if option is not None and "alive=" in option.replace(" ", "").lower():
        raise InvalidValue(tr("alive= cannot be combined with Alive in service="))


def check_no_watchdog(option: str | None) -> None:
    """Check that an option string of Service_Start requests no watchdog.

    The function is called only if repeated requests are the signs of life of the client (``alive`` on UDP or a serial
    line).

    Raises:
        InvalidValue: If the option string contains ``WDT``. Each S_EXECUTING would then postpone the next repetition of
            the request.
    """
    if option is not None and "wdt=" in option.replace(" ", "").lower():
        raise InvalidValue(
            tr(
                "over UDP and serial lines, alive= cannot be combined with WDT in service=: repeated requests are the "
                "signs of life, and WDT suppresses them. Try: remove WDT"
            )
        )


def with_alive(option: str | None, seconds: float | None) -> str | None:
    """Return the option string of Service_Start with ``Alive`` added; unchanged if ``seconds`` is ``None``."""
    if seconds is None:
        return option
    return ",".join(part for part in (option, f"Alive={round(seconds * 1000)}") if part)


def motor_state(dialect: Dialect, *, on: bool) -> Value:
    """Return the parameter of the command Motor.

    If the dialect permits, the parameter requests that the controller reply only after the motor is on or off.
    """
    return Variant(VarType.I2, int(on)) if dialect.short_numbers else [int(on), 0]


def clear_error_parameter(dialect: Dialect) -> Value:
    """Return the parameter of ClearError: a code that a VE026A ignores (VE026A table 5-2), ``None`` for an RC8."""
    return Variant(VarType.I2, 0) if dialect.short_numbers else None


def dialect_of(name: str | None, provider: str) -> Dialect | None:
    """Return the dialect ``name``. If it is ``None``, return the dialect that the provider name implies.

    A provider name may imply no dialect; the result is then ``None``.

    Raises:
        InvalidValue: If no dialect has the name.
    """
    if name is not None:
        given: object = name
        dialect = DIALECTS.get(given.lower()) if isinstance(given, str) else None
        if dialect is None:
            known = ", ".join(DIALECTS)
            raise InvalidValue(tr("unknown dialect {name}. Try: {known}", name=brief(name), known=known))
        return dialect
    return VE026A if not provider or is_ve026a(provider) else None


def is_ve026a(text: object) -> bool:
    """Return True if a provider name or a version text belongs to a VE026A."""
    return VE026A.name.upper() in str(text).upper()


def expired_handle_hint(profile: TransportProfile) -> str:
    """Return the hint for E_HANDLE after a long idle period, in which the controller may have released the handle."""
    name, seconds = profile.name.upper(), profile.session_timeout
    return tr(
        "over {name}, a controller releases a client and all its objects after {seconds:g} s without a call. "
        "Connect again; then make calls regularly, or use TCP",
        name=name,
        seconds=seconds,
    )


def check_timeout(seconds: float, name: str = "timeout") -> float:
    """Check a time-out in s, and return it as a float.

    Raises:
        InvalidValue: If the value is not a positive number, or exceeds the range of the system's clock.
    """
    return check_seconds(name, seconds, _MAX_TIMEOUT)


def check_deadline(seconds: float | None) -> float | None:
    """Check a deadline in s, and return it as a float; ``None`` means no deadline.

    Raises:
        InvalidValue: If the value is not a positive number, or exceeds the range of the system's clock.
    """
    return None if seconds is None else check_timeout(seconds, "deadline")


def check_tries(number: int) -> int:
    """Return the maximum number of times that a request is sent, clamped to 1 to 7 (RC8 table 5-1).

    Raises:
        InvalidValue: If the value is not an integer.
    """
    tries = whole(number)
    if tries is None:
        raise InvalidValue(
            tr(
                "tries must be an integer from {least} to {most}, not {number}",
                least=LEAST_TRIES,
                most=MOST_TRIES,
                number=brief(number),
            )
        )
    return min(max(tries, LEAST_TRIES), MOST_TRIES)


def text_list(value: Any) -> list[str]:
    """Return the result of a ...Names function as a list; a controller returns VT_EMPTY for an empty list."""
    return [] if value is None else [value] if isinstance(value, str) else [str(name) for name in value]


# --- tasks ------------------------------------------------------------------------------------------------------------


def task_mode(kind: type[TaskMode | StopMode], mode: str | int) -> int:
    """Return the number of a mode, given by name or number; numbers are not checked.

    Raises:
        InvalidValue: If no mode has the name.
    """
    if not isinstance(mode, str):
        return int(mode)
    try:
        return int(kind[mode.strip().upper()])
    except KeyError:
        known = ", ".join(f'"{each.name.lower()}"' for each in kind)
        raise InvalidValue(tr("unknown mode {mode!r:.40}. Try: {known}", mode=mode, known=known)) from None


def task_status(value: Any) -> TaskStatus:
    """Return the status from the result of GetStatus.

    Raises:
        ProtocolError: If the value is not a status.
    """
    try:
        return TaskStatus(value)
    except ValueError:
        raise unexpected_value("GetStatus", value) from None


def is_program(program: str, task: str) -> bool:
    """Return True if the program named in an error is the program of a task."""
    names = [name.strip().replace("\\", "/").casefold().removesuffix(".pcs") for name in (program, task)]
    return bool(names[0]) and names[0] == names[1]


def program_error(info: ErrorInfo, task: str) -> CallError:
    """Return the exception for an error that ended a program."""
    place = tr("{program}, line {line}", program=info.program, line=info.line) if info.line else info.program
    error = error_for(info.code, f"{place}: {info.message}")
    error.subject = task
    return error


def logged_message(value: Any, code: int) -> str:
    """Return the message of a record from GetErrorLog; ``""`` for a record with another code, or without a message."""
    if not isinstance(value, list) or len(value) <= _LOGGED_MESSAGE or not isinstance(value[0], int):
        return ""
    message = value[_LOGGED_MESSAGE]
    return message if isinstance(message, str) and hresult.unsigned(value[0]) == code else ""


# --- files ------------------------------------------------------------------------------------------------------------


def is_file_not_found(error: CallError) -> bool:
    """Return True if an error means that no file has the name in the call, although the name is valid."""
    return error.code == hresult.FILE_NOT_FOUND


def file_option(option: str, *, create: bool) -> str:
    """Return the option for connecting to a file; with ``create``, the controller creates a missing file."""
    return ",".join(filter(None, ("@Create=1", option))) if create else option


def parse_date(value: Any) -> Any:
    """Return a date such as ``2024-04-01 09:00:00`` as ``datetime``; return any other value unchanged."""
    if isinstance(value, str):
        try:
            return datetime.fromisoformat(value.strip())
        except ValueError:
            pass
    return value


def file_text(content: Any) -> str:
    """Return the content of a file as text; bytes are decoded as UTF-8, or else as Shift_JIS (code page 932).

    ``None`` (VT_EMPTY) is returned as an empty text.

    Raises:
        InvalidValue: If the content cannot be decoded.
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
    raise InvalidValue(tr("the content of the file is not text. Try: .data"))


def file_data(content: Any) -> bytes:
    """Return the content of a file as bytes; a text is encoded as UTF-8.

    ``None`` (VT_EMPTY) is returned as ``b""``.

    Raises:
        InvalidValue: If the content is neither text nor bytes.
    """
    if content is None:
        return b""
    if isinstance(content, str):
        return content.encode("utf-8", "surrogatepass")
    if isinstance(content, bytes):
        return content
    raise InvalidValue(
        tr("the content of the file is neither text nor bytes: {content!r:.40}. Try: .value", content=content)
    )


def check_content(kind: type[T], content: T) -> T:
    """Check that the new content of a file has the type ``kind``, and return it.

    A ``bytearray`` is converted if ``kind`` is ``bytes``.

    Raises:
        InvalidValue: If the content is not of the type ``kind``.
    """
    given: object = content
    if isinstance(given, bytearray) and kind is bytes:
        given = bytes(given)
    if isinstance(given, kind):
        return given
    raise InvalidValue(
        tr(
            "{content!r:.40} is not {name}. Try: .text for str, .data for bytes",
            content=content,
            name=kind.__name__,
        )
    )


class HandleTable:
    """The handles of a connection: those in use, and those of objects that were deleted without being closed.

    An object is deleted when Python garbage collects it. The handles of deleted objects are released before the next
    object is created. A controller may return the same handle for several objects (with ``@IfNotMember``; a VE026A
    always does). Such a handle is released with the last of these objects.
    """

    def __init__(self) -> None:
        self._handles: deque[tuple[Function[[int], None], int]] = deque()
        self._shared: Counter[tuple[int, int]] = Counter()  # (ID of the release function, handle) -> number of objects
        self._lock = Lock()

    def add_reference(self, release: Function[[int], None], handle: int) -> None:
        """Count one more object with this handle."""
        with self._lock:
            self._shared[release.id, handle] += 1

    def drop_reference(self, release: Function[[int], None], handle: int) -> bool:
        """Count one object fewer with this handle; return True if none is left, so that the handle must be released."""
        with self._lock:
            self._shared[release.id, handle] -= 1
            if self._shared[release.id, handle] > 0:
                return False
            del self._shared[release.id, handle]
            return True

    def add_orphan(self, release: Function[[int], None], handle: int) -> None:
        """Add the handle of a deleted object; may be called from any thread and during garbage collection."""
        self._handles.append((release, handle))

    def pop_orphan(self) -> tuple[Function[[int], None], int] | None:
        """Return the handle of a deleted object and remove it from this table; return ``None`` if there is none."""
        try:
            return self._handles.popleft()
        except IndexError:
            return None
