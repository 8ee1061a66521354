"""Every exception that orinkit raises.

::

    OrinError
    ├── InvalidValue (ValueError)          a Python value that no VARIANT, or not the one asked for, can hold
    ├── NotationError (ValueError)         VARIANT text that cannot be read
    ├── InvalidAddress (ValueError)        a URL or connection string that cannot be used
    ├── ProtocolError                      bytes from the other side that are not the protocol
    │   └── LimitExceeded                  ... or are more than the limits allow
    ├── TransportError (ConnectionError)   the link itself
    │   ├── ConnectFailed                  could not be opened
    │   ├── ConnectionLost                 ended while in use
    │   └── ConnectionClosed               used after it was closed here
    ├── MissingExtra (ImportError)         a part of orinkit needs a package that is not installed
    ├── LoadFailed                         a provider of one's own that cannot be loaded
    ├── ObjectReleased                     an object was used after it was closed here
    ├── StreamError                        streaming in slave mode has ended, or cannot begin
    ├── CallTimeout (TimeoutError)         no answer in time; whether the call was executed is not known
    │   └── DriverTimeout                  ... of an ABH3 motor driver
    ├── DriverRefused                      an ABH3 motor driver does not read or write a parameter
    ├── DriverFault                        an ABH3 motor driver has errors that a reset does not clear
    └── CallError                          the controller answered with an error code
        ├── GeneralError                   0x8000xxxx, 0x8002xxxx, 0x8007xxxx
        │   ├── NotImplementedCall         E_NOTIMPL
        │   ├── InvalidArgument            E_INVALIDARG, wrong type, wrong index
        │   ├── InvalidHandle              E_HANDLE
        │   └── AccessDenied               E_ACCESSDENIED
        ├── CaoError                       0x800002xx, 0x800004xx, 0x800009xx
        │   ├── ObjectNotFound             E_CAO_OBJECT_NOTFOUND
        │   ├── AlreadyRegistered          E_CAO_COLLECTION_REGISTERED
        │   └── ExecutionTimeout           E_TIMEOUT said by the controller
        ├── PacketError                    0x800100xx, 0x800101xx
        ├── BusyError                      E_BUSY_PROC
        ├── SocketError                    0x8091xxxx
        ├── UserDefinedError               0x80040200 to 0x8004FFFF
        ├── UnknownError                   a code outside every range
        └── ControllerError                0x8LMMNNNN: level, subsystem, number
            ├── MotionError  ServoError  SafetyError  ProgramError
            └── OptionError  LanguageError  PendantError

A :class:`CallError` is also what a served device raises to answer a call with that code (``raise CallError(code)``).
All of them can be pickled.
"""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.hresult import CodeFamily, ReturnCode
from orinkit.core.i18n import tr

_SHOWN_ARGUMENT: Final = 60


class OrinError(Exception):
    """The base of every exception of orinkit."""


class InvalidValue(OrinError, ValueError):
    """A Python value that cannot be sent as a VARIANT, or not as the type that was asked for."""


class NotationError(OrinError, ValueError):
    """A text that is not VARIANT notation (e-CAP 3.5, RC8 5.3); the message names the column, counted from 1."""


class InvalidAddress(OrinError, ValueError):
    """A URL or DENSO connection string that cannot be read, or names a transport that is not there."""


class MissingExtra(OrinError, ImportError):
    """A part of orinkit whose packages are not installed; the message says how to install them."""


class ProtocolError(OrinError):
    """Bytes that are not the protocol.

    Attributes:
        code: the return code a server answers such bytes with (VE026A table 3-5).
        fatal: True where the stream has lost its place and the link has to be closed.
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
    """Bytes that would be the protocol but are more than the limits in force allow."""


class TransportError(OrinError, ConnectionError):
    """The link to the other side failed."""


class ConnectFailed(TransportError):
    """The link could not be opened."""


class ConnectionLost(TransportError):
    """The other side closed the link, or it broke, while it was in use."""


class ConnectionClosed(TransportError):
    """The link was used after it had been closed on this side."""


class LoadFailed(OrinError):
    """A provider could not be loaded; the message says which one, why, and where that happened."""


class ObjectReleased(OrinError):
    """An object of a controller was used after it had been closed on this side; nothing was sent."""


class StreamError(OrinError):
    """Streaming in slave mode has ended, or cannot begin, for a reason that is not the controller's."""


class CallTimeout(OrinError, TimeoutError):
    """No answer within the time-out; whether the controller executed the call is not known.

    Attributes:
        function: the document's name of the function.
        seconds: that passed, those of all tries.
        tries: how often the request was sent; more than one only where packets may be lost (UDP, serial lines).
        executing: the controller has said that it was still at work when the call's deadline came.
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
                "{function}: not done within its deadline of {seconds:g} s; the controller said that it "
                "was still at work, and may carry it out yet. Try: a longer deadline",
                function=self.function,
                seconds=self.seconds,
            )
        if self.tries > 1 and self.function == "Service_Start":  # the first call of all
            return tr(
                "{function}: no answer within {seconds:g} s (it was sent {tries} times). Try: is the "
                "controller on, and the address right? On a serial line: are rate and parity those of "
                "the controller (?baudrate=115200), is it the right port and cable, does no other "
                "program read from it?",
                function=self.function,
                seconds=self.seconds,
                tries=self.tries,
            )
        if self.tries > 1:
            return tr(
                "{function}: no answer within {seconds:g} s; whether the controller executed it is not "
                "known (it was sent {tries} times, and is executed once at most). Try: a longer timeout",
                function=self.function,
                seconds=self.seconds,
                tries=self.tries,
            )
        return tr(
            "{function}: no answer within {seconds:g} s; whether the controller executed it is not "
            "known. Try: a longer timeout, or service option WDT so that the controller reports "
            "that it is still at work",
            function=self.function,
            seconds=self.seconds,
        )


class DriverTimeout(CallTimeout):
    """An ABH3 motor driver did not answer; whether it took the command is not known.

    Attributes:
        address: of the driver.
    """

    def __init__(self, function: str, seconds: float, address: int) -> None:
        super().__init__(function, seconds)
        self.address = address

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.function, self.seconds, self.address)

    def __str__(self) -> str:
        if self.function == "rest":
            return tr(
                "ABH3 {address} has not come to rest within {seconds:g} s. Try: more seconds; its deceleration time",
                address=self.address,
                seconds=self.seconds,
            )
        if "req" in self.function:
            return tr(
                "{function}: ABH3 {address} did not answer within {seconds:g} s. Try: if it answers commands, its broadcast "
                "group; else is it on, do bit rate, its address and the host's address fit its "
                "parameters, is the bus terminated?",
                function=self.function,
                address=self.address,
                seconds=self.seconds,
            )
        return tr(
            "{function}: ABH3 {address} did not answer within {seconds:g} s; whether it took the command is not known. Try: "
            "is it on, do bit rate, its address and the host's address fit its parameters, is the "
            "bus terminated, may it answer (single packet 0 mode)?",
            function=self.function,
            address=self.address,
            seconds=self.seconds,
        )


class DriverRefused(OrinError):
    """An ABH3 motor driver refuses to read or write a parameter."""


class DriverFault(OrinError):
    """An ABH3 motor driver has errors that a reset does not clear.

    Attributes:
        errors: its error flags (document 2.3).
        warnings: its warning flags.
        texts: what they say.
    """

    def __init__(self, errors: int, warnings: int, texts: tuple[str, ...] = ()) -> None:
        super().__init__(errors, warnings, texts)
        self.errors = errors
        self.warnings = warnings
        self.texts = texts

    def __str__(self) -> str:
        texts = ", ".join(self.texts) or "-"
        return tr(
            "the driver still has errors after a reset: {texts} (errors 0x{errors:08X}, warnings "
            "0x{warnings:08X}). Try: mend the cause, then reset_errors() again; is dialect= right "
            "(v1 and v2 reset by different bits)?",
            texts=texts,
            errors=self.errors,
            warnings=self.warnings,
        )


class CallError(OrinError):
    """A call was answered with an error code; or, raised by a served device, is to be answered with it.

    Attributes:
        code: the return code, unsigned 32 bits.
        function: the document's name of the function, ``""`` where it is not known.
        arguments: the arguments of the call.
        detail: what else is known, for example the text of an exception in a served device.
        subject: name of the object that was called, ``""`` where it is not known.
        info: name, text and hint of the code (:class:`orinkit.core.hresult.ReturnCode`).
    """

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
        """Name, text and hint of the code."""
        return hresult.lookup(self.code)

    def __str__(self) -> str:
        info = self.info
        of = tr(" of {subject}", subject=_shorten(self.subject)) if self.subject else ""
        call = f"{self.function}({', '.join(map(_shorten, self.arguments))}){of}: " if self.function else ""
        name = f" {info.name}" if not info.name.startswith("0x") else ""
        detail = f" [{self.detail}]" if self.detail else ""
        hint = tr(". Try: {hint}", hint=info.hint) if info.hint else ""
        if self.function == "Controller_Connect" and not self.detail:  # over b-CAP a code is all that comes
            hint += tr(" Are provider and option right? The log of an orinkit server says why it refused.")
        return f"{call}0x{self.code:08X}{name}: {info.text}{detail}{hint}"


class GeneralError(CallError):
    """A code of the general ranges 0x8000xxxx, 0x8002xxxx and 0x8007xxxx."""


class NotImplementedCall(GeneralError):
    """E_NOTIMPL: the function or command does not exist on the other side."""


class InvalidArgument(GeneralError):
    """E_INVALIDARG, DISP_E_TYPEMISMATCH and the like: an argument is refused."""


class InvalidHandle(GeneralError):
    """E_HANDLE: no object with this handle in this connection, or one of another kind."""


class AccessDenied(GeneralError):
    """E_ACCESSDENIED: not allowed for this client."""


class CaoError(CallError):
    """A code of the CAO and b-CAP service ranges 0x800002xx, 0x800004xx and 0x800009xx."""


class ObjectNotFound(CaoError):
    """E_CAO_OBJECT_NOTFOUND: no object of this name."""


class AlreadyRegistered(CaoError):
    """E_CAO_COLLECTION_REGISTERED: an object of this name is connected already."""


class ExecutionTimeout(CaoError):
    """E_TIMEOUT said by the controller: the call ran longer than InvokeTimeout."""


class PacketError(CallError):
    """The other side says that a packet was wrong (0x80010000 to 0x800101FF)."""


class BusyError(CallError):
    """E_BUSY_PROC: an earlier call of this connection is still being executed; this one was not."""


class SocketError(CallError):
    """The other side reports a socket error of its own (0x8091xxxx)."""


class UserDefinedError(CallError):
    """A code that the served device defines itself (0x80040200 to 0x8004FFFF)."""


class UnknownError(CallError):
    """A failure code outside every known range."""


class ControllerError(CallError):
    """A code of the robot controller, 0x8LMMNNNN: level L, subsystem MM, number NNNN."""


class MotionError(ControllerError):
    """Subsystem 20: motion and trajectory."""


class ServoError(ControllerError):
    """Subsystem 40: servo."""


class SafetyError(ControllerError):
    """Subsystems 48, 49, 4A: safety and I/O units."""


class ProgramError(ControllerError):
    """Subsystem 50: controller state, rights, programs, variables."""


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
    """Return the exception class for a return code; unknown codes fall back by range."""
    return _BY_CODE.get(hresult.unsigned(code)) or _BY_FAMILY[hresult.family(code)]


def error_for(code: int, detail: str = "", function: str = "", arguments: tuple[object, ...] = ()) -> CallError:
    """Return the exception, not raised yet, for a return code."""
    return error_class(code)(code, detail, function, arguments)


def _shorten(argument: object) -> str:
    text = repr(argument)
    return text if len(text) <= _SHOWN_ARGUMENT else f"{text[: _SHOWN_ARGUMENT - 3]}..."
