"""Connection strings of DENSO's b-CAP Tester (RC8 table 5-1): ``Server=192.168.0.1, UDP=0, Timeout=800``.

Options are separated by commas; blanks around commas and ``=`` are ignored. Names are case-insensitive. A value with a
comma, a bracket or a quotation mark is quoted: ``Option="@EventDisable=False,Wpj=*"``. Inside the quotes, a doubled
quotation mark means one. No I/O.
"""

from __future__ import annotations

import re
from typing import Any, Final, NamedTuple

from orinkit.bcap.profiles import DEFAULT_TRIES, LEAST_TRIES, MOST_TRIES
from orinkit.cao.options import split_options
from orinkit.cao.table import LONGEST_OPTION
from orinkit.client._shared.common import LOCALHOST, RC8
from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.core.record import field_names, record
from orinkit.core.validation import brief, whole
from orinkit.transport.address import Address, invalid_value_message, parse_address
from orinkit.transport.registry import AnyAddress

_CONNECTION_STRING: Final = re.compile(r"[\s,]*[A-Za-z][A-Za-z0-9_]*\s*[=,]")
_QUOTED: Final = re.compile(r'"((?:[^"]|"")*)"' + "|" + r"'((?:[^']|'')*)'", re.DOTALL)
_PLAIN: Final = re.compile(r"[^\s,\"'()\[\]{}<>](?:[^,\"'()\[\]{}<>]*[^\s,\"'()\[\]{}<>])?")
_COM_PORT: Final = re.compile(r"com([0-9]+)(:.*)?", re.IGNORECASE)
_INTEGER: Final = re.compile(r"[+-]?[0-9]+", re.ASCII)
_FLAGS: Final = {"true": True, "1": True, "false": False, "0": False}
_LONGEST_TIMEOUT: Final = 2_000_000_000  # ms


class ConnectionOption(NamedTuple):
    """A row of table 5-1.

    Attributes:
        name: Name of the option.
        parameter: Attribute of :class:`ConnectionString`.
        default: Value if the option is absent; ``None`` if the option is required.
        valid: Valid values of a number.
        clamped: True if a number outside the range counts as the nearest valid one.
        argument: Argument of ``connect()`` that the option sets; ``""`` if it is part of the address.
        bare: True if the option may be given without a value: True for a flag, an empty text otherwise.
        allowed: Description of the valid values.
    """

    name: str
    parameter: str
    default: str | int | bool | None = None
    valid: range = range(0)
    clamped: bool = False
    argument: str = ""
    bare: bool = False
    allowed: str = ""

    def read(self, text: str | None) -> Any:
        """Return the value that a text represents; ``None`` is the text of an option without ``=``.

        Raises:
            InvalidAddress: If the text does not represent a valid value.
        """
        if text is None:
            if not self.bare:
                raise InvalidAddress(tr("{name} requires a value; expected: {known}", name=self.name, known=tr(self.allowed)))  # fmt: skip
            return "" if self.default == "" else True
        if isinstance(self.default, bool):
            return self.check(_FLAGS.get(text.lower(), text))
        if isinstance(self.default, int):
            return self.check(int(text) if _INTEGER.fullmatch(text) else text)
        return self.check(text)

    def check(self, value: Any) -> Any:
        """Return a valid value.

        Raises:
            InvalidAddress: If the value is not valid.
        """
        if isinstance(self.default, bool):
            return value if isinstance(value, bool) else self._refuse(value)
        if not isinstance(self.default, int):
            return value if isinstance(value, str) and (value or self.default is not None) else self._refuse(value)
        number = whole(value)
        if number is not None and self.clamped:
            number = min(max(number, self.valid.start), self.valid.stop - 1)
        return number if number is not None and number in self.valid else self._refuse(value)

    def write(self, value: Any) -> str:
        """Return the option as text."""
        text = str(value)
        if text and not _PLAIN.fullmatch(text):
            text = '"' + text.replace('"', '""') + '"'
        return f"{self.name}={text}"

    def _refuse(self, value: object) -> Any:
        raise self.refusal(value)

    def refusal(self, value: object) -> InvalidAddress:
        """Return the exception for an invalid value."""
        shown = value if isinstance(value, str) else brief(value)
        return InvalidAddress(invalid_value_message(self.name, shown, tr(self.allowed)))


_TEXT: Final = N_("any text")
_FLAG: Final = N_("True or False")
OPTIONS: Final = (
    ConnectionOption("Server", "server", allowed=N_("HOST, HOST:PORT, COM1, /dev/ttyUSB0 or http://HOST:PORT")),
    ConnectionOption("UDP", "udp", False, bare=True, allowed=N_("True or False; True requires Server=HOST:PORT")),
    ConnectionOption(
        "Timeout", "timeout_ms", 500, range(1, _LONGEST_TIMEOUT + 1), argument="timeout",
        allowed=N_("a number of ms from 1 to 2,000,000,000"),
    ),
    ConnectionOption(
        "TORetry", "tries", DEFAULT_TRIES, range(LEAST_TRIES, MOST_TRIES + 1), clamped=True, argument="tries",
        allowed=N_("a number from 1 to 7"),
    ),
    ConnectionOption("Provider", "provider", RC8, argument="provider", allowed=_TEXT),
    ConnectionOption("Machine", "machine", LOCALHOST, argument="machine", allowed=_TEXT),
    ConnectionOption("Option", "option", "", argument="option", bare=True, allowed=_TEXT),
    ConnectionOption("Message", "messages", True, argument="messages", bare=True, allowed=_FLAG),
    ConnectionOption("Debug", "debug", False, argument="debug", bare=True, allowed=_FLAG),
)  # fmt: skip
"""THE TABLE of connection strings, RC8 table 5-1, in the order in which they are written."""

BY_NAME: Final = {option.name.lower(): option for option in OPTIONS}
"""The options by their names in lower case."""
_BY_PARAMETER: Final = {option.parameter: option for option in OPTIONS}


@record(kw_only=True)
class ConnectionString:
    """The options of a connection string; ``str`` returns the string with all options.

    Attributes:
        server: ``HOST``, ``HOST:PORT``, a serial port (``COM3``, ``com:3:38400:N:8:1:0``, ``/dev/ttyUSB0``), or the URL
            of a transport other than TCP and UDP.
        udp: True for UDP, False for TCP.
        timeout_ms: Time-out in ms, as ``timeout`` of ``connect()``.
        tries: Maximum number of times that a request is sent on UDP and serial lines, 1 to 7. Smaller numbers count as
            1, larger ones as 7.
        provider: Provider name.
        machine: Machine name.
        option: Option string of Controller_Connect.
        messages: False if the message functions are disabled.
        debug: True if the client keeps the last packets.

    Raises:
        InvalidAddress: If a value is not valid.
    """

    server: str
    udp: bool = False
    timeout_ms: int = 500
    tries: int = DEFAULT_TRIES
    provider: str = RC8
    machine: str = LOCALHOST
    option: str = ""
    messages: bool = True
    debug: bool = False

    def __post_init__(self) -> None:
        for name in field_names(ConnectionString):
            object.__setattr__(self, name, _BY_PARAMETER[name].check(getattr(self, name)))
        self._address()

    @classmethod
    def parse(cls, text: str) -> ConnectionString:
        """Parse a connection string.

        Raises:
            InvalidAddress: If an option is unknown, repeated or missing, or if a value is not valid.
        """
        return cls(**_values(text))

    def __str__(self) -> str:
        return ", ".join(option.write(getattr(self, option.parameter)) for option in OPTIONS)

    @property
    def url(self) -> str:
        """The URL of the controller: ``tcp://192.168.0.1:5007``."""
        return str(self._address())

    @property
    def timeout(self) -> float:
        """The time-out in s."""
        return self.timeout_ms / 1000

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of ``connect()`` besides the URL."""
        return {option.argument: getattr(self, option.argument) for option in OPTIONS if option.argument}

    def _address(self) -> AnyAddress:
        text = self.server.strip()
        com = _COM_PORT.fullmatch(text)
        if com:
            text = f"com:{com[1]}{com[2] or ''}"
        elif text.startswith("/"):
            text = f"serial://{text}"
        try:
            address = parse_address(text)
        except InvalidAddress as error:
            raise BY_NAME["server"].refusal(self.server) from error
        if isinstance(address, Address):
            if text.lower().startswith(("tcp:", "udp:")):  # UDP= selects the transport
                raise BY_NAME["server"].refusal(self.server)
            return address._replace(scheme="udp" if self.udp else "tcp")
        if self.udp:
            raise BY_NAME["udp"].refusal(self.udp)
        return address


class ConnectArguments(NamedTuple):
    """Arguments of ``connect()`` after the evaluation of a connection string."""

    url: str
    provider: str = RC8
    machine: str = LOCALHOST
    option: str = ""
    timeout: float | None = None
    tries: int = DEFAULT_TRIES
    messages: bool = True
    debug: bool = False


def evaluate(given: ConnectArguments) -> ConnectArguments:
    """Replace a connection string in place of the URL by its URL and its options.

    An option of the string replaces the argument. An option that the string does not contain has the value of the
    argument; only the time-out then has the default of connection strings, 0.5 s.

    Raises:
        InvalidAddress: If the connection string is not valid.
        InvalidValue: If an option of the string and the argument have different values.
    """
    if not is_connection_string(given.url):
        return given
    values = _values(given.url)
    parsed = ConnectionString(**values)
    contained = {option for option in OPTIONS if option.argument and option.parameter in values}
    for option in contained:
        argument, value = getattr(given, option.argument), getattr(parsed, option.argument)
        if argument not in (ConnectArguments._field_defaults[option.argument], value):
            raise InvalidValue(
                tr(
                    "{option} in the connection string contradicts {name}={value}. Try: give only one of them",
                    option=option.write(values[option.parameter]),
                    name=option.argument,
                    value=brief(argument),
                )
            )
    changed = {option.argument: getattr(parsed, option.argument) for option in contained}
    if given.timeout is None:
        changed["timeout"] = parsed.timeout
    return given._replace(url=parsed.url, **changed)


def is_connection_string(text: object) -> bool:
    """Return True if a text has the form of a connection string, not of a URL or a host name."""
    return isinstance(text, str) and _CONNECTION_STRING.match(text) is not None


def url_of(text: str) -> str:
    """Return the URL of a connection string; return any other text unchanged.

    Raises:
        InvalidAddress: If the connection string is not valid.
    """
    return ConnectionString.parse(text).url if is_connection_string(text) else text


def _values(text: str) -> dict[str, Any]:
    """Return the values of the options in a connection string by parameter."""
    if len(text) > LONGEST_OPTION:
        raise InvalidAddress(
            tr(
                "connection string of {count} characters exceeds the limit of {most} characters",
                count=len(text),
                most=LONGEST_OPTION,
            )
        )
    parts, unclosed = split_options(text)
    if unclosed:
        raise InvalidAddress(tr("connection string: {sign} is missing after {part!r:.80}", sign=unclosed, part=parts[-1]))  # fmt: skip
    values: dict[str, Any] = {}
    for part in parts:
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not name and not equals:
            continue
        option = BY_NAME.get(name.lower())
        if option is None:
            known = ", ".join(each.name for each in OPTIONS)
            raise InvalidAddress(
                tr(
                    "connection string: unknown option {part!r:.80}; known options: {known}",
                    part=part.strip(),
                    known=known,
                )
            )
        if option.parameter in values:
            raise InvalidAddress(tr("{name} is given twice", name=option.name))
        values[option.parameter] = option.read(_unquoted(value) if equals else None)
    if "server" not in values:
        raise InvalidAddress(tr("connection string: Server is missing. Try: Server=192.168.0.1"))
    return values


def _unquoted(value: str) -> str:
    quoted = _QUOTED.fullmatch(value)
    if quoted is None:
        return value
    return quoted[2].replace("''", "'") if quoted[1] is None else quoted[1].replace('""', '"')
