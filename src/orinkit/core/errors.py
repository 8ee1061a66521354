"""Every exception that orinkit raises.

::

    OrinError
    ├── InvalidValue (ValueError)          a Python value that does not fit a VARIANT, or the requested type
    ├── NotationError (ValueError)         text that is not valid VARIANT notation
    ├── InvalidAddress (ValueError)        an invalid URL or connection string
    ├── ProtocolError                      received bytes violate the protocol
    │   └── LimitExceeded                  received data exceeds a limit
    ├── TransportError (ConnectionError)   the connection failed
    │   ├── ConnectFailed                  it could not be opened
    │   ├── ConnectionLost                 it broke while in use
    │   └── ConnectionClosed               it was used after it was closed locally
    ├── MissingExtra (ImportError)         a feature needs a package that is not installed
    ├── ProviderLoadFailed                 a user-written provider could not be loaded
    ├── ObjectReleased                     an object was used after it was closed
    ├── MessagesDisabled                   a message function on a connection with messages=False
    ├── StreamError                        streaming in slave mode ended or could not start
    ├── CallTimeout (TimeoutError)         no reply in time; the call may or may not have been executed
    │   └── DriverTimeout                  the same, from an ABH3 motor driver
    ├── ParameterRefused                   an ABH3 motor driver refused to read or write a parameter
    ├── DriverFault                        an ABH3 motor driver has errors that a reset does not clear
    └── CallError                          the controller returned an error code
        ├── GeneralError                   0x8000xxxx, 0x8002xxxx, 0x8007xxxx
        │   ├── NotImplementedCall         E_NOTIMPL
        │   ├── InvalidArgument            E_INVALIDARG, wrong type, wrong index
        │   ├── InvalidHandle              E_HANDLE
        │   └── AccessDenied               E_ACCESSDENIED
        ├── CaoError                       0x800002xx, 0x800004xx, 0x800009xx
        │   ├── ObjectNotFound             E_CAO_OBJECT_NOTFOUND
        │   ├── AlreadyRegistered          E_CAO_COLLECTION_REGISTERED
        │   └── ExecutionTimeout           E_TIMEOUT returned by the controller
        ├── PacketError                    0x800100xx, 0x800101xx
        ├── BusyError                      E_BUSY_PROC
        ├── SocketError                    0x8091xxxx
        ├── UserDefinedError               0x80040200 to 0x8004FFFF
        ├── UnknownError                   a code outside all known ranges
        └── ControllerError                0x8LMMNNNN: level, subsystem, number
            ├── MotionError  ServoError  SafetyError  ProgramError
            └── OptionError  LanguageError  PendantError

A served device raises :class:`CallError` to return an error code to the client: ``raise CallError(code)``.
All exceptions can be pickled.
"""

from __future__ import annotations

import re
from typing import Final

from orinkit.core import hresult
from orinkit.core.hresult import CodeFamily, ReturnCode
from orinkit.core.i18n import tr

_SHOWN_ARGUMENT: Final = 60
_SECRET: Final = re.compile(r"\b(secret|token|password)(\s*=\s*)[^,;'\"\s]+", re.IGNORECASE)


class OrinError(Exception):
    """Base class of all exceptions raised by orinkit."""


class InvalidValue(OrinError, ValueError):
    """A Python value cannot be sent as a VARIANT, does not fit the requested type, or is out of range."""


class NotationError(OrinError, ValueError):
    """A text is not valid VARIANT notation (e-CAP 3.5, RC8 5.3); the message gives the column, counted from 1."""


class InvalidAddress(OrinError, ValueError):
    """A URL or DENSO connection string is malformed or names an unavailable transport."""


class MissingExtra(OrinError, ImportError):
    """An optional feature needs packages that are not installed; the message shows the install command."""


class ProtocolError(OrinError):
    """Received bytes violate the protocol.

    Attributes:
        code: Return code with which a server replies to such bytes (VE026A table 3-5).
        fatal: True if packet boundaries are lost, so that the connection must be closed.
    """

    def __init__(self, message: str, code: int = hresult.E_INVALIDRCVPACKET, *, fatal: bool = False) -> None:
        super().__init__(message)
        self.code = code
        self.fatal = fatal

    def __reduce__(self) -> tuple[object, ...]:
        return _restore_protocol_error, (type(self), self.args[0], self.code, self.fatal)


def _restore_protocol_error(kind: type[ProtocolError], message: str, code: int, fatal: bool) -> ProtocolError:
    return kind(message, code, fatal=fatal)


class LimitExceeded(ProtocolError):
    """Received data is well-formed but exceeds the configured limits."""


class TransportError(OrinError, ConnectionError):
    """The connection to the peer failed."""


class ConnectFailed(TransportError):
    """The connection could not be opened."""


class ConnectionLost(TransportError):
    """The peer closed the connection, or the connection broke, while it was in use."""


class ConnectionClosed(TransportError):
    """The connection was used after it had been closed locally."""


class ProviderLoadFailed(OrinError):
    """A provider could not be loaded; the message gives its name, the cause, and the file and line of the failure."""


class ObjectReleased(OrinError):
    """An object of a controller was used after it had been closed locally; nothing was sent."""


class MessagesDisabled(OrinError):
    """A message function was called on a connection with ``messages=False``; nothing was sent."""


class StreamError(OrinError):
    """Streaming in slave mode ended or could not start, for a reason other than an error of the controller.

    Attributes:
        reason: Why streaming ended: ``"stopped"`` (this program was stopped with SIGSTOP), ``"idle"`` (no set-points)
            or ``"terminated"`` (the streaming process received SIGTERM); ``""`` for another reason.
    """

    def __init__(self, message: str = "", reason: str = "") -> None:
        super().__init__(message)
        self.reason = reason


class CallTimeout(OrinError, TimeoutError):
    """No reply within the time-out; the controller may or may not have executed the call.

    Attributes:
        function: Name of the function, as in the specification.
        seconds: Elapsed time in s, over all attempts.
        tries: Number of times the request was sent; above 1 only if packets may be lost (UDP, serial lines).
        executing: True if the controller reported that the call was still executing when its deadline passed.
    """

    def __init__(self, function: str, seconds: float, tries: int = 1, *, executing: bool = False) -> None:
        super().__init__(function, seconds, tries)
        self.function = function
        self.seconds = seconds
        self.tries = tries
        self.executing = executing

    def __str__(self) -> str:
        if self.executing:
            return tr(
                "{function}: not finished within its deadline of {seconds:g} s; the controller reported that the "
                "call was still executing, and may complete it later. Try: a longer deadline",
                function=self.function,
                seconds=self.seconds,
            )
        if self.tries > 1 and self.function == "Service_Start":  # the first call of a connection
            return tr(
                "{function}: no reply within {seconds:g} s (sent {tries} times). Try: check that the controller is on "
                "and the address is correct. On a serial line, check the port, the cable, the bit rate and the parity "
                "(?baudrate=115200), and that no other program uses the port",
                function=self.function,
                seconds=self.seconds,
                tries=self.tries,
            )
        if self.tries > 1:
            return tr(
                "{function}: no reply within {seconds:g} s; the controller may or may not have executed it "
                "(sent {tries} times, executed at most once). Try: a longer timeout",
                function=self.function,
                seconds=self.seconds,
                tries=self.tries,
            )
        return tr(
            "{function}: no reply within {seconds:g} s; the controller may or may not have executed it. Try: a longer "
            "timeout, or the service option WDT, with which the controller reports that a call is still executing",
            function=self.function,
            seconds=self.seconds,
        )


class DriverTimeout(CallTimeout):
    """No reply from an ABH3 motor driver; it may or may not have accepted the command.

    The function ``stop_and_wait`` also raises this error if the driver replies, but has not reached standstill in time.

    Attributes:
        address: CAN address of the driver.
    """

    def __init__(self, function: str, seconds: float, address: int) -> None:
        super().__init__(function, seconds)
        self.address = address

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.function, self.seconds, self.address)

    def __str__(self) -> str:
        if self.function == "stop_and_wait":
            return tr(
                "ABH3 {address} did not reach standstill within {seconds:g} s. Try: a longer timeout, or check "
                "the deceleration time of the driver",
                address=self.address,
                seconds=self.seconds,
            )
        if "req" in self.function:
            return tr(
                "{function}: no reply from ABH3 {address} within {seconds:g} s. Try: if the driver replies to "
                "commands, check its broadcast group (a parameter); otherwise check that the driver is on, that "
                "the bit rate and both addresses (driver and host) match the parameters of the driver, and that "
                "the bus is terminated",
                function=self.function,
                address=self.address,
                seconds=self.seconds,
            )
        return tr(
            "{function}: no reply from ABH3 {address} within {seconds:g} s; the driver may or may not have "
            "accepted the command. Try: check that the driver is on, that the bit rate and both addresses (driver "
            "and host) match the parameters of the driver, that the bus is terminated, and that the driver is set "
            "to reply (parameter single packet 0 mode)",
            function=self.function,
            address=self.address,
            seconds=self.seconds,
        )


class ParameterRefused(OrinError):
    """An ABH3 motor driver refused to read or write a parameter."""


class DriverFault(OrinError):
    """An ABH3 motor driver has errors that a reset does not clear.

    Attributes:
        errors: Error flags (ABH3 document 2.3).
        warnings: Warning flags.
        texts: Descriptions of the flags that are set.
    """

    def __init__(self, errors: int, warnings: int, texts: tuple[str, ...] = ()) -> None:
        super().__init__(errors, warnings, texts)
        self.errors = errors
        self.warnings = warnings
        self.texts = texts

    def __str__(self) -> str:
        texts = ", ".join(self.texts) or "-"
        return tr(
            "the driver still has errors after a reset: {texts} (errors 0x{errors:08X}, warnings 0x{warnings:08X}). Try: "
            "remove the cause, then call reset_errors() again; check dialect= (v1 and v2 reset with different bits)",
            texts=texts,
            errors=self.errors,
            warnings=self.warnings,
        )


class CallError(OrinError):
    """A call returned an error code. A served device raises it to return that code to the client.

    Attributes:
        code: Return code, unsigned 32 bits.
        function: Name of the function, as in the specification; ``""`` if unknown.
        arguments: Arguments of the call.
        detail: Additional information, for example the text of an exception in a served device.
        subject: Name of the object whose function was called; ``""`` if unknown.
        info: Name, text and hint of the code (:class:`orinkit.core.hresult.ReturnCode`).
        defined_by_device: True if the device has defined the code, so that the codes of b-CAP do not describe it.
    """

    defined_by_device = False

    def __init__(self, code: int, detail: str = "", function: str = "", arguments: tuple[object, ...] = ()) -> None:
        code = hresult.unsigned(code)
        super().__init__(code, detail, function, arguments)
        self.code = code
        self.detail = detail
        self.function = function
        self.arguments = arguments
        self.subject = ""

    @property
    def info(self) -> ReturnCode:
        """The name, text and hint of the code."""
        return hresult.defined_by_device(self.code) if self.defined_by_device else hresult.lookup(self.code)

    def __str__(self) -> str:
        info = self.info
        of = tr(" of {subject}", subject=_shorten(self.subject)) if self.subject else ""
        call = f"{self.function}({', '.join(map(_shorten, self.arguments))}){of}: " if self.function else ""
        name = f" {info.name}" if not info.name.startswith("0x") else ""
        detail = f" [{self.detail}]" if self.detail else ""
        hint = tr(". Try: {hint}", hint=info.hint) if info.hint else ""
        if self.function == "Controller_Connect" and not self.detail:  # b-CAP transmits only the code
            hint += tr(" Check the provider and the option; an orinkit server logs why it refused the connection.")
        return f"{call}0x{self.code:08X}{name}: {info.text}{detail}{hint}"


class GeneralError(CallError):
    """An error of the general ranges 0x8000xxxx, 0x8002xxxx and 0x8007xxxx."""


class NotImplementedCall(GeneralError):
    """E_NOTIMPL: the controller or device does not implement the function or command."""


class InvalidArgument(GeneralError):
    """E_INVALIDARG, DISP_E_TYPEMISMATCH and similar: an argument was rejected."""


class InvalidHandle(GeneralError):
    """E_HANDLE: no object of this connection has the handle, or the function requires an object of another type."""


class AccessDenied(GeneralError):
    """E_ACCESSDENIED: this client is not permitted to make the call."""


class CaoError(CallError):
    """An error of the CAO and b-CAP service ranges 0x800002xx, 0x800004xx and 0x800009xx."""


class ObjectNotFound(CaoError):
    """E_CAO_OBJECT_NOTFOUND: no object has this name."""


class AlreadyRegistered(CaoError):
    """E_CAO_COLLECTION_REGISTERED: an object with this name is already registered."""


class ExecutionTimeout(CaoError):
    """E_TIMEOUT returned by the controller: the call took longer than ``InvokeTimeout`` (option of Service_Start)."""


class PacketError(CallError):
    """The peer reports an invalid packet (0x80010000 to 0x800101FF)."""


class BusyError(CallError):
    """E_BUSY_PROC: an earlier call of this connection is still executing; this call was not executed."""


class SocketError(CallError):
    """The peer reports an error of one of its own sockets (0x8091xxxx)."""


class UserDefinedError(CallError):
    """A code defined by the served device (0x80040200 to 0x8004FFFF and 0x80010200 to 0x8001FFFF)."""


class UnknownError(CallError):
    """An error code outside all known ranges."""


class ControllerError(CallError):
    """An error of the robot controller, 0x8LMMNNNN: level L, subsystem MM, number NNNN."""


class MotionError(ControllerError):
    """Subsystem 20: motion and trajectory."""


class ServoError(ControllerError):
    """Subsystem 40: servo."""


class SafetyError(ControllerError):
    """Subsystems 48, 49, 4A: safety and I/O units."""


class ProgramError(ControllerError):
    """Subsystem 50: controller state, permissions, programs and variables."""


class OptionError(ControllerError):
    """Subsystem 58: electric hand and options."""


class LanguageError(ControllerError):
    """Subsystem 60: program language and interpreter."""


class PendantError(ControllerError):
    """Subsystem 80: teach pendant."""


_BY_CODE: Final[dict[int, type[CallError]]] = {
    hresult.E_NOTIMPL: NotImplementedCall,
    hresult.E_INVALIDARG: InvalidArgument,
    hresult.DISP_E_TYPEMISMATCH: InvalidArgument,
    hresult.DISP_E_BADVARTYPE: InvalidArgument,
    hresult.DISP_E_OVERFLOW: InvalidArgument,
    hresult.DISP_E_BADINDEX: InvalidArgument,
    hresult.E_HANDLE: InvalidHandle,
    hresult.E_ACCESSDENIED: AccessDenied,
    hresult.E_CAO_OBJECT_NOTFOUND: ObjectNotFound,
    hresult.E_CAO_COLLECTION_REGISTERED: AlreadyRegistered,
    hresult.E_TIMEOUT: ExecutionTimeout,
}

_BY_FAMILY: Final[dict[CodeFamily, type[CallError]]] = {
    CodeFamily.SUCCESS: CallError,
    CodeFamily.GENERAL: GeneralError,
    CodeFamily.CAO: CaoError,
    CodeFamily.PACKET: PacketError,
    CodeFamily.BUSY: BusyError,
    CodeFamily.SOCKET: SocketError,
    CodeFamily.USER: UserDefinedError,
    CodeFamily.MOTION: MotionError,
    CodeFamily.SERVO: ServoError,
    CodeFamily.SAFETY: SafetyError,
    CodeFamily.PROGRAM: ProgramError,
    CodeFamily.OPTION: OptionError,
    CodeFamily.LANGUAGE: LanguageError,
    CodeFamily.PENDANT: PendantError,
    CodeFamily.CONTROLLER: ControllerError,
    CodeFamily.UNKNOWN: UnknownError,
}


def error_class(code: int) -> type[CallError]:
    """Return the exception class for a return code; for an unknown code, the class of its range."""
    return _BY_CODE.get(hresult.unsigned(code)) or _BY_FAMILY[hresult.family(code)]


def error_for(code: int, detail: str = "", function: str = "", arguments: tuple[object, ...] = ()) -> CallError:
    """Create the exception for a return code, without raising it."""
    return error_class(code)(code, detail, function, arguments)


def _shorten(argument: object) -> str:
    text = repr(argument)
    if isinstance(argument, str) and "=" in text:  # an option string; messages are logged and printed
        text = _SECRET.sub(r"\1\2***", text)
    return text if len(text) <= _SHOWN_ARGUMENT else f"{text[: _SHOWN_ARGUMENT - 3]}..."
