"""Encoding and decoding of e-CAP messages: the bodies of requests and replies (e-CAP 3).

An example of a request is ``Func=9,Arg1=2,Arg2=IO150,Arg3=,Arg4=,Arg5=`` (:mod:`orinkit.ecap.fields`). An argument of
type VARIANT is written in the notation of e-CAP 3.5, for example ``8,Sample`` (:mod:`orinkit.values.notation`); an
empty value is VT_EMPTY. Any other argument is plain text. A string is written literally, a number in decimal, or in
hexadecimal with ``0x``. A number may also be written in the notation, because that is unambiguous.

An example of a reply is ``0x00000000,3,2``. It consists of the return code and, if the function has a result, a comma
and the result in the notation.

Every VARIANT is transmitted without loss, except NaN: every NaN is received as Python's ``float("nan")``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple
from urllib.parse import quote_from_bytes

from orinkit.cao import coerce
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Argument, Function
from orinkit.cao.user_functions import NO_FUNCTIONS, UserFunction, is_user_function
from orinkit.core import hresult
from orinkit.core.errors import (
    CallError,
    InvalidValue,
    LimitExceeded,
    NotationError,
    ProtocolError,
    error_for,
)
from orinkit.core.i18n import printable, quoted, tr
from orinkit.core.validation import rounded_to_single
from orinkit.ecap.fields import ARGUMENTS, BLANKS, UTF_8, FormField, decoded, encoded, read_fields, refused
from orinkit.ecap.limits import check_cost, parse_limited, too_long
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.notation import format_variant, parse, parse_lenient
from orinkit.values.notation_numbers import FLAGS, LONGEST, REAL, WHOLE
from orinkit.values.types import VarType, misfit
from orinkit.values.variant import Variant, trusted, variant

_FAILED: Final = 0x8000_0000
_DETAIL: Final = 500  # maximum number of characters of an error description
_EMPTY: Final = FormField("")


class EcapRequest(NamedTuple):
    """A call to be executed by :meth:`orinkit.cao.session.Session.invoke`.

    Attributes:
        function: an entry of the table of functions.
        arguments: the arguments with their types, without empty optional arguments at the end.
    """

    function: Function[..., Any]
    arguments: list[Variant]


# --- requests ---------------------------------------------------------------------------------------------------------


def own_code(code: int) -> int:
    """Return the code with which a server of e-CAP itself replies; 0x8001xxxx belongs to the device (e-CAP table 3)."""
    return hresult.E_INVALIDARG if is_device_code(code) else code


def is_device_code(code: int) -> bool:
    """Return True for a code that the device defines (e-CAP table 3)."""
    return hresult.unsigned(code) >> 16 == 0x8001


def write_request(function: Function[..., Any], arguments: tuple[Any, ...], charset: str = UTF_8) -> bytes:
    """Return the body of a call.

    Args:
        function: an entry of the table of functions, or the entry of a user-defined function.
        arguments: the result of :meth:`~orinkit.cao.table.Function.bind`.
        charset: encoding of the text.

    Raises:
        InvalidValue: If an argument does not fit its type; the message names the function and the argument.
    """
    texts = [""] * ARGUMENTS
    is_user = is_user_function(function.id)
    for number, (argument, value) in enumerate(zip(function.arguments, arguments, strict=False), 1):
        try:
            text = _write_user_argument(value) if is_user else _WRITERS[argument.vt](value)
            texts[number - 1] = quote_from_bytes(encoded(text, charset), safe="")
        except InvalidValue as error:
            raise InvalidValue(function.where(number) + str(error)) from None
    fields = "".join(f",Arg{number}={text}" for number, text in enumerate(texts, 1))
    return f"Func={function.id}{fields}".encode("ascii")


def read_request(
    body: bytes,
    limits: PacketLimits = DEFAULT_LIMITS,
    charset: str = UTF_8,
    user_functions: Mapping[int, UserFunction] = NO_FUNCTIONS,
) -> EcapRequest:
    """Decode the body of a call.

    Args:
        body: the body.
        limits: limits on the size of the body and on the values in it.
        charset: encoding of the text.
        user_functions: the user-defined functions of the server, by their numbers.

    Raises:
        CallError: E_INVALIDARG if the body is not a request, an argument is invalid, or a limit is exceeded; E_NOTIMPL
            if the function is unknown.
    """
    try:
        return _read_request(body, limits, charset, user_functions)
    except CallError as error:
        raise error_for(own_code(error.code), error.detail) from None


def _read_request(
    body: bytes, limits: PacketLimits, charset: str, user_functions: Mapping[int, UserFunction]
) -> EcapRequest:
    if len(body) > limits.packet:
        raise error_for(hresult.E_PACKETSIZEOVER, too_long(len(body), limits))
    fields = read_fields(body, charset)
    function = _function(fields["func"].text.strip(BLANKS), user_functions)
    given = [fields.get(f"arg{number}", _EMPTY) for number in range(1, ARGUMENTS + 1)]
    _check_number(function, given)
    count = len(function.arguments)
    while count > function.required and _is_omitted(function.arguments[count - 1], given[count - 1]):
        count -= 1
    pairs = list(zip(function.arguments, given[:count], strict=False))
    try:
        check_cost((field.text for argument, field in pairs if argument.vt is VarType.VARIANT), limits)
    except LimitExceeded as error:
        raise error_for(error.code, f"{function.name}: {error}") from None
    return EcapRequest(function, [_read(function, number, *pair, limits) for number, pair in enumerate(pairs, 1)])


def explain_request(body: bytes) -> str:
    """Return a one-line summary of a request, even of an invalid one.

    Example: ``Controller_GetVariable handle=2 name="IO150" option=""``.
    """
    try:
        fields = read_fields(body)
    except CallError as error:
        return tr("not an e-CAP request: {detail}", detail=error.detail)
    word = fields.pop("func").text.strip(BLANKS)
    function = FUNCTIONS.get(_whole(word) or 0)
    words = [function.name if function else tr("unknown function {word}", word=printable(word))]
    arguments = function.arguments if function else ()
    for number, argument in enumerate(arguments, 1):
        text = printable(fields.pop(f"arg{number}", _EMPTY).text)
        words.append(f'{argument.name}="{text}"' if argument.vt is VarType.BSTR else f"{argument.name}={text}")
    words += [f'{name.capitalize()}="{printable(field.text)}"' for name, field in sorted(fields.items()) if field.text]
    return " ".join(words)


# Writing


def _write_integer(value: Any) -> str:
    codec.encode_integer(value)  # raises InvalidValue if it does not fit, as for b-CAP
    return str(int(value))


def _write_single(value: Any) -> str:
    codec.encode_single(value)
    return format_variant(trusted(VarType.R4, float(value))).partition(",")[2]


def _write_string(value: Any) -> str:
    if not isinstance(value, str):
        raise misfit(VarType.BSTR, value)
    return str.__str__(value)


def _write_variant(value: Any) -> str:
    item = variant(value)
    return "" if item.type == VarType.EMPTY else format_variant(item, exact=True)


def _write_user_argument(value: Any) -> str:
    """Return an argument of a user-defined function: text and numbers without a type, as the document has it.

    The client does not know the type of the argument. A :class:`~orinkit.values.variant.Variant` and any other value are
    written with their types.
    """
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, bool | int | float):
        item = variant(value)
        return format_variant(item).partition(",")[2]
    return _write_variant(value)


_WRITERS: Final[dict[VarType, Callable[[Any], str]]] = {
    VarType.I4: _write_integer,
    VarType.R4: _write_single,
    VarType.BSTR: _write_string,
    VarType.VARIANT: _write_variant,
}

# Reading


_IDS: Final = {entry.name.lower(): entry.id for entry in FUNCTIONS.values()}


def _function(word: str, user_functions: Mapping[int, UserFunction]) -> Function[..., Any]:
    number = _whole(word)
    if number is None:
        by_name = _IDS.get(word.lower(), 3)
        raise refused(tr("Func: {word} is not a number. Try: Func={by_name}", word=quoted(word), by_name=by_name))
    if number in user_functions:
        return user_functions[number].function
    function = FUNCTIONS.get(number)
    if function is None:
        raise error_for(
            hresult.E_NOTIMPL,
            tr("unknown function {word}; ids are 1 to {count}", word=quoted(word), count=len(FUNCTIONS)),
        )
    return function


def _whole(word: str) -> int | None:
    """Return a whole number, decimal or hexadecimal, or ``None`` if the text is not one."""
    match = WHOLE.fullmatch(word) if len(word) <= LONGEST else None
    return int(word, 16 if match[1] else 10) if match else None


def _check_number(function: Function[..., Any], given: list[FormField]) -> None:
    for number, field in enumerate(given, 1):
        if number > len(function.arguments) and field.text.strip(BLANKS):
            raise refused(
                tr("{name} has no argument {number}; Arg{number} must be empty", name=function.name, number=number)
            )


def _is_omitted(argument: Argument, field: FormField) -> bool:
    return argument.optional and not (field.text if argument.vt is VarType.BSTR else field.text.strip(BLANKS))


def _read(
    function: Function[..., Any], number: int, argument: Argument, field: FormField, limits: PacketLimits
) -> Variant:
    try:
        if argument.vt is VarType.VARIANT:
            read = _read_user_argument if is_user_function(function.id) else _read_variant
            return read(field.text, limits)
        return _read_handle(field.text) if argument.is_handle else _READERS[argument.vt](field.text)
    except NotationError as error:
        kind = tr("; a VARIANT is written <type>,<value>, such as 3,100 or 8,text")
        code, reason = hresult.E_INVALIDARG, f"{error}{kind}"
    except ProtocolError as error:
        code, reason = error.code, str(error)
    except CallError as error:
        code, reason = error.code, error.detail
    plus = tr('. Try: encode a "+" as %2B; a literal "+" means a space')
    raise error_for(code, function.where(number) + reason + (plus if field.plus else ""))


def _read_variant(text: str, limits: PacketLimits) -> Variant:
    return parse_limited(text, limits) if text.strip(BLANKS) else trusted(VarType.EMPTY, None)


def _read_user_argument(text: str, limits: PacketLimits) -> Variant:
    """Return an argument of any type: a VARIANT in the notation, or a text or number without a type."""
    if _TYPED.match(text):
        return parse_limited(text, limits)
    return parse_lenient(text) if text else trusted(VarType.EMPTY, None)


def _read_string(text: str) -> Variant:
    return trusted(VarType.BSTR, text)


def _read_integer(text: str) -> Variant:
    return trusted(VarType.I4, coerce.to_integer(_read_number(text)))


def _read_real(text: str) -> Variant:
    """Return a number in single precision, as a b-CAP client sends it; if it is too large for VT_R4, return a VT_R8."""
    word = text.strip(BLANKS)
    if len(word) <= LONGEST and REAL.fullmatch(word):
        number = coerce.to_real(trusted(VarType.R8, float(word)))  # includes "-0", which is not a whole number
    else:
        number = coerce.to_real(_read_number(text))
    try:
        return trusted(VarType.R4, rounded_to_single(number))
    except OverflowError:
        return trusted(VarType.R8, number)


def _read_handle(text: str) -> Variant:
    given = _read_number(text)
    try:
        return _integer(coerce.to_handle(given))
    except CallError as error:
        found = quoted(text)
        raise error_for(
            error.code,
            tr(
                "{found} is not a handle. Try: a number returned by Controller_Connect, Controller_GetVariable or "
                "a similar function",
                found=found,
            ),
        ) from None


def _read_double(text: str) -> Variant:
    word = text.strip(BLANKS)
    if len(word) <= LONGEST and REAL.fullmatch(word):
        return trusted(VarType.R8, coerce.to_real(trusted(VarType.R8, float(word))))
    return trusted(VarType.R8, coerce.to_real(_read_number(text)))


def _read_flag(text: str) -> Variant:
    """Return a flag; also ``true`` and ``false`` as text."""
    flag = FLAGS.get(text.strip(BLANKS).lower())
    return trusted(VarType.BOOL, bool(_read_number(text).value) if flag is None else flag)


_READERS: Final[dict[VarType, Callable[[str], Variant]]] = {
    VarType.I4: _read_integer,
    VarType.R4: _read_real,
    VarType.R8: _read_double,
    VarType.BOOL: _read_flag,
    VarType.BSTR: _read_string,
}
_TYPED: Final = re.compile(r"[ \t\r\n]*[0-9]{1,5}[ \t\r\n]*,")


def _read_number(text: str) -> Variant:
    """Return a text as a number of any type; the caller checks its range, as it does for b-CAP."""
    word = text.strip(BLANKS)
    if not word:
        raise refused(tr("expected a number, got an empty value"))
    if len(word) <= LONGEST:
        if "," in word:
            return parse(word)
        whole = _whole(word)
        if whole is not None:
            return _integer(whole)
        if REAL.fullmatch(word):
            return trusted(VarType.R8, float(word))
    raise error_for(hresult.E_INVALIDARGTYPE, tr("{word} is not a number", word=quoted(word)))


def _integer(number: int) -> Variant:
    if -(2**31) <= number < 2**31:
        return trusted(VarType.I4, number)
    if 0 <= number < 2**32:
        return trusted(VarType.UI4, number)
    return trusted(VarType.BSTR, str(number))  # too large for an integer type; the conversion to a number reports it


# --- replies ----------------------------------------------------------------------------------------------------------

_SLICE: Final = 4096  # characters encoded at a time
_BLANK: Final = rb"[ \t\r\n]*+"
# A return code, followed by a comma or the end of the body. The document prints no comma between code and result.
# Therefore a code of eight hexadecimal digits may also be followed immediately by the result.
_REPLY: Final = re.compile(
    rb"(?:\xef\xbb\xbf)?" + _BLANK + rb"(0x[0-9a-f]{8}(?=" + _BLANK + rb"[1-9][0-9]{0,4}" + _BLANK + rb",)"
    rb"|(?:0x[0-9a-f]{1,8}|[+-]?[0-9]{1,10})(?=" + _BLANK + rb"(?:,|\Z)))" + _BLANK + rb",?",
    re.IGNORECASE,
)  # fmt: skip


def write_reply(code: int, result: Variant | None, charset: str = UTF_8) -> bytes:
    """Return the body of a reply; a result of type VT_EMPTY is omitted, as if there were no result.

    Raises:
        InvalidValue: If VARIANT arrays are nested deeper than the notation allows.
    """
    text = "" if result is None or result.type == VarType.EMPTY else f",{format_variant(result, exact=True)}"
    text = f"0x{hresult.unsigned(code):08X}{text}"
    slices = range(0, len(text), _SLICE)  # other threads cannot run while Python encodes one slice
    return b"".join([encoded(text[at : at + _SLICE], charset) for at in slices])


def read_reply(body: bytes, limits: PacketLimits = DEFAULT_LIMITS, charset: str = UTF_8) -> tuple[int, Variant | None]:
    """Return the return code, as an unsigned number, and the result of a reply (``None`` if the reply has no result).

    In the body, the code is hexadecimal with ``0x``, or decimal, signed or unsigned. Line feeds may precede it. Data
    after an error code is ignored.

    Raises:
        ProtocolError: If the body is not a reply.
    """
    if len(body) > limits.packet:
        raise LimitExceeded(too_long(len(body), limits), hresult.E_PACKETSIZEOVER)
    code, rest = _split_reply(body)
    if code >= _FAILED or not rest.strip():
        return code, None
    try:
        text = decoded(rest, charset)
        check_cost([text], limits)
        return code, parse_limited(text, limits)
    except UnicodeDecodeError:
        raise _no_reply(rest, tr("not {charset}", charset=charset)) from None
    except NotationError as error:
        raise _no_reply(rest, str(error)) from None


def read_detail(body: bytes) -> str:
    """Return the error description that follows the return code of a reply, as one line; ``""`` if there is none."""
    _, rest = _split_reply(body)
    return printable(" ".join(rest[: 4 * _DETAIL].decode("utf-8", "replace").split()))


def reply_error(code: int, detail: str, function: str, arguments: tuple[object, ...]) -> CallError:
    """Return the exception for the return code of a reply.

    A code 0x8001xxxx belongs to the device, so the texts of b-CAP do not describe it. A server of orinkit sends a detail.
    """
    error = error_for(code, detail, function, arguments)
    error.defined_by_device = is_device_code(code) and not detail
    return error


def explain_reply(body: bytes) -> str:
    """Return a one-line summary of a reply, even of an invalid one, for example ``S_OK 3,2``."""
    try:
        code, rest = _split_reply(body)
    except ProtocolError as error:
        return str(error)
    detail = read_detail(body)
    info = hresult.lookup(code) if detail or not is_device_code(code) else hresult.defined_by_device(code)
    if info.failed:
        name = "" if info.name.startswith("0x") else f" {info.name}"
        return f"0x{code:08X}{name}: {info.text}" + (f" [{detail}]" if detail else "")
    return f"{info.name} {printable(rest[:1000].decode('utf-8', 'replace'))}".rstrip()


def _split_reply(body: bytes) -> tuple[int, bytes]:
    match = _REPLY.match(body)
    if match:
        number = int(match[1], 16 if b"x" in match[1].lower() else 10)
        if -(2**31) <= number < 2**32:
            return hresult.unsigned(number), body[match.end() :]
    found = _quoted(body)
    raise ProtocolError(
        tr(
            "{found} is not an e-CAP reply, which begins with a return code such as 0x00000000. Try: check the "
            "address of the e-CAP server, including its path",
            found=found,
        )
    )


def _no_reply(rest: bytes, reason: str) -> ProtocolError:
    found = _quoted(rest)
    return ProtocolError(tr("invalid result {found} in an e-CAP reply: {reason}", found=found, reason=reason))


def _quoted(data: bytes) -> str:
    return quoted(data[:200].decode("utf-8", "replace"))
