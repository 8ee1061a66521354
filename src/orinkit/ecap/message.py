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
from collections.abc import Callable, Iterable
from typing import Any, Final, NamedTuple
from urllib.parse import quote

from orinkit.cao import coerce
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Argument, Function
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, LimitExceeded, NotationError, ProtocolError, error_for
from orinkit.core.i18n import printable, quoted, tr
from orinkit.core.validation import rounded_to_single
from orinkit.ecap.fields import ARGUMENTS, BLANKS, FormField, read_fields, refused, to_text
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from orinkit.values.notation import format_variant, parse
from orinkit.values.notation_numbers import LONGEST, REAL, WHOLE
from orinkit.values.types import ARRAY, TABLE, VARIANT_ARRAY, VarType, misfit
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


def write_request(function: Function[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """Return the body of a call.

    Args:
        function: an entry of the table of functions.
        arguments: the result of :meth:`~orinkit.cao.table.Function.bind`.

    Raises:
        InvalidValue: If an argument does not fit its type; the message names the function and the argument.
    """
    texts = [""] * ARGUMENTS
    for number, (argument, value) in enumerate(zip(function.arguments, arguments, strict=False), 1):
        try:
            texts[number - 1] = quote(_WRITERS[argument.vt](value), safe="", errors="surrogatepass")
        except InvalidValue as error:
            raise InvalidValue(function.where(number) + str(error)) from None
    fields = "".join(f",Arg{number}={text}" for number, text in enumerate(texts, 1))
    return f"Func={function.id}{fields}".encode("ascii")


def read_request(body: bytes, limits: PacketLimits = DEFAULT_LIMITS) -> EcapRequest:
    """Decode the body of a call.

    Raises:
        CallError: E_INVALIDARG if the body is not a request or an argument is invalid; E_INVALIDARGTYPE if an argument
            is not a number; E_NOTIMPL if the function is unknown; E_PACKETSIZEOVER or E_ARGSIZEOVER if a limit is
            exceeded.
    """
    if len(body) > limits.packet:
        raise error_for(hresult.E_PACKETSIZEOVER, _too_long(len(body), limits))
    fields = read_fields(body)
    function = _function(fields["func"].text.strip(BLANKS))
    given = [fields.get(f"arg{number}", _EMPTY) for number in range(1, ARGUMENTS + 1)]
    _check_number(function, given)
    count = len(function.arguments)
    while count > function.required and _is_omitted(function.arguments[count - 1], given[count - 1]):
        count -= 1
    pairs = list(zip(function.arguments, given[:count], strict=False))
    try:
        _check_cost((field.text for argument, field in pairs if argument.vt is VarType.VARIANT), limits)
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
    return "" if item.type == VarType.EMPTY else format_variant(item)


_WRITERS: Final[dict[VarType, Callable[[Any], str]]] = {
    VarType.I4: _write_integer,
    VarType.R4: _write_single,
    VarType.BSTR: _write_string,
    VarType.VARIANT: _write_variant,
}

# Reading


_IDS: Final = {entry.name.lower(): entry.id for entry in FUNCTIONS.values()}


def _function(word: str) -> Function[..., Any]:
    number = _whole(word)
    if number is None:
        by_name = _IDS.get(word.lower(), 3)
        raise refused(tr("Func: {word} is not a number. Try: Func={by_name}", word=quoted(word), by_name=by_name))
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
            return _read_variant(field.text, limits)
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
    return _parse(text, limits) if text.strip(BLANKS) else trusted(VarType.EMPTY, None)


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


_READERS: Final[dict[VarType, Callable[[str], Variant]]] = {
    VarType.I4: _read_integer,
    VarType.R4: _read_real,
    VarType.BSTR: _read_string,
}


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

_BLANK: Final = rb"[ \t\r\n]*+"
# A return code, followed by a comma or the end of the body. The document prints no comma between code and result.
# Therefore a code of eight hexadecimal digits may also be followed immediately by the result.
_REPLY: Final = re.compile(
    rb"(?:\xef\xbb\xbf)?" + _BLANK + rb"(0x[0-9a-f]{8}(?=" + _BLANK + rb"[1-9][0-9]{0,4}" + _BLANK + rb",)"
    rb"|(?:0x[0-9a-f]{1,8}|[+-]?[0-9]{1,10})(?=" + _BLANK + rb"(?:,|\Z)))" + _BLANK + rb",?",
    re.IGNORECASE,
)  # fmt: skip


def write_reply(code: int, result: Variant | None) -> bytes:
    """Return the body of a reply; a result of type VT_EMPTY is omitted, as if there were no result.

    Raises:
        InvalidValue: If VARIANT arrays are nested deeper than the notation allows.
    """
    text = "" if result is None or result.type == VarType.EMPTY else f",{format_variant(result)}"
    text = f"0x{hresult.unsigned(code):08X}{text}"
    slices = range(0, len(text), _SLICE)  # other threads cannot run while Python encodes one slice
    return b"".join([text[at : at + _SLICE].encode("utf-8", "surrogatepass") for at in slices])


def read_reply(body: bytes, limits: PacketLimits = DEFAULT_LIMITS) -> tuple[int, Variant | None]:
    """Return the return code, as an unsigned number, and the result of a reply (``None`` if the reply has no result).

    In the body, the code is hexadecimal with ``0x``, or decimal, signed or unsigned. Line feeds may precede it. Data
    after an error code is ignored.

    Raises:
        ProtocolError: If the body is not a reply.
    """
    if len(body) > limits.packet:
        raise LimitExceeded(_too_long(len(body), limits), hresult.E_PACKETSIZEOVER)
    code, rest = _split_reply(body)
    if code >= _FAILED or not rest.strip():
        return code, None
    try:
        text = to_text(rest)
        _check_cost([text], limits)
        return code, _parse(text, limits)
    except UnicodeDecodeError:
        raise _no_reply(rest, tr("not UTF-8")) from None
    except NotationError as error:
        raise _no_reply(rest, str(error)) from None


def read_detail(body: bytes) -> str:
    """Return the error description that follows the return code of a reply, as one line; ``""`` if there is none."""
    _, rest = _split_reply(body)
    return printable(" ".join(rest[: 4 * _DETAIL].decode("utf-8", "replace").split()))


def explain_reply(body: bytes) -> str:
    """Return a one-line summary of a reply, even of an invalid one, for example ``S_OK 3,2``."""
    try:
        code, rest = _split_reply(body)
    except ProtocolError as error:
        return str(error)
    info = hresult.lookup(code)
    if info.failed:
        name = "" if info.name.startswith("0x") else f" {info.name}"
        detail = read_detail(body)
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


# --- limits -----------------------------------------------------------------------------------------------------------


def _too_long(length: int, limits: PacketLimits) -> str:
    return tr("body of {length} bytes exceeds the limit of {most} bytes", length=length, most=limits.packet)


_SLICE: Final = 4096  # characters searched at a time
_MARGIN: Final = 80  # characters; at least the longest match of _HEAD
_FIRST: Final = re.compile(r"[ \t\r\n]*+([0-9]{1,5})")
_HEAD: Final = re.compile(r"(?:\A|\()[ \t\r\n]{0,64}+([0-9]{1,5}|[ \t\r\n])")
# The types of arrays whose elements are slow to parse. The elements of VARIANT arrays are counted by their brackets.
_SLOW: Final = {int(row.code) | ARRAY for row in TABLE if row.elements_per_unit == 1} - {VARIANT_ARRAY}
# The costs are the estimated times to parse a character, in microseconds. _ALLOWANCE is the time allowed for each
# permitted element, also in microseconds; with the default limits, the total is one second. The costs of brackets and
# of commas of slow types are overestimated: PacketLimits.variants limits such arrays after parsing.
_BRACKET_COST: Final = 10
_SLOW_COST: Final = 5
_QUOTES_FOR_ONE: Final = 8
_ALLOWANCE: Final = 20


def _check_cost(texts: Iterable[str], limits: PacketLimits) -> None:
    """Estimate the time to parse texts by counting characters, and refuse texts that would take too long.

    Raises:
        LimitExceeded: If the texts contain too many brackets, quotation marks and commas.
    """
    left = _ALLOWANCE * limits.variants
    for text in texts:
        if len(text) > limits.variants:
            left -= _cost(text, left)
    if left < 0:
        raise LimitExceeded(
            tr(
                "the arrays have too many elements for e-CAP, which transfers arrays as text. Try: use smaller "
                "arrays, several calls, or b-CAP"
            ),
            hresult.E_ARGSIZEOVER,
        )


def _cost(text: str, left: int) -> int:
    head = _FIRST.match(text)
    if not head or not (int(head[1]) & ARRAY or int(head[1]) == VarType.VARIANT):
        return 0  # a scalar, or not a VARIANT in the notation
    cost = _BRACKET_COST * _count(text, "(") + _count(text, '"') // _QUOTES_FOR_ONE
    if cost > left:
        return cost
    return cost + (_SLOW_COST if _has_slow(text) else 1) * _count(text, ",")


def _count(text: str, sign: str) -> int:
    return sum(text.count(sign, at, at + _SLICE) for at in range(0, len(text), _SLICE))


def _has_slow(text: str) -> bool:
    """Return True if a text may contain an array whose type is slow to parse.

    More than 64 blanks before a type also count as such an array, because the type after them is not examined.
    """
    for at in range(0, len(text), _SLICE):
        heads = set(_HEAD.findall(text, at, at + _SLICE + _MARGIN))
        if any(head.isspace() or int(head) in _SLOW for head in heads):
            return True
    return False


def _parse(text: str, limits: PacketLimits) -> Variant:
    """Return the VARIANT that a text in the notation of e-CAP 3.5 represents.

    Raises:
        NotationError: If the text is not a VARIANT.
        LimitExceeded: If the value exceeds the limits of a b-CAP packet.
    """
    item = parse(text)
    if item.type & ARRAY and len(text) > limits.variants:  # a shorter text cannot have more elements than the limit
        sizes = PacketLimits(limits.packet, limits.depth, limits.variants)
        codec.decode(codec.encode_variant(item), limits=sizes)
    return item
