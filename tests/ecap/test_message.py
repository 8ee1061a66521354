from __future__ import annotations

import struct
from datetime import datetime
from decimal import Decimal
from enum import IntEnum, StrEnum

import pytest

from orinkit.bcap.requests import encode_request
from orinkit.cao.arguments import read_arguments
from orinkit.cao.functions import BY_NAME, FUNCTIONS
from orinkit.cao.table import Argument
from orinkit.cao.user_functions import UserFunction, foreign_entry, user_entry
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, InvalidValue, LimitExceeded, ProtocolError
from orinkit.ecap.message import (
    explain_reply,
    explain_request,
    own_code,
    read_reply,
    read_request,
    reply_error,
    write_reply,
    write_request,
)
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits, encode_variant
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from support.ecap_bodies import BAD_BODIES, BODIES, EXAMPLES, bstr, i4
from support.strategies import same

pytestmark = pytest.mark.core

MIB = 1 << 20
PUT = b"Func=102,Arg1=3,Arg2="  # Variable_PutValue


def refusal(body: bytes, limits: PacketLimits = DEFAULT_LIMITS) -> CallError:
    with pytest.raises(CallError) as refused:
        read_request(body, limits)
    return refused.value


def unreadable(body: bytes, limits: PacketLimits = DEFAULT_LIMITS) -> ProtocolError:
    with pytest.raises(ProtocolError) as refused:
        read_reply(body, limits)
    return refused.value


# --- the examples of section 3.5 --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "value"), EXAMPLES, ids=[text for text, _ in EXAMPLES])
def test_the_examples_of_the_document_as_arguments(text, value):
    function, arguments = read_request(PUT + text.encode())
    assert function.name == "Variable_PutValue"
    assert same(arguments, [i4(3), value])
    body = write_request(function, (3, value))
    assert same(read_request(body).arguments, [i4(3), value])


@pytest.mark.parametrize(("text", "value"), EXAMPLES, ids=[text for text, _ in EXAMPLES])
def test_the_examples_of_the_document_as_results(text, value):
    code, result = read_reply(f"0x00000000,{text}".encode())
    assert code == 0
    assert same(result, value)
    assert write_reply(0, value) == f"0x00000000,{text}".encode()


# --- requests ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("each", BODIES, ids=[each.name for each in BODIES])
def test_requests_of_clients(each):
    function, arguments = read_request(each.body)
    assert function.id == each.function
    assert same(arguments, each.arguments)


@pytest.mark.parametrize("each", BAD_BODIES, ids=[each.name for each in BAD_BODIES])
def test_invalid_requests_are_refused_with_a_reason(each):
    error = refusal(each.body)
    assert error.code == each.code
    assert each.detail in error.detail


@pytest.mark.parametrize("each", BAD_BODIES, ids=[each.name for each in BAD_BODIES])
def test_reasons_are_also_in_japanese(each):
    i18n.use("ja")
    detail = refusal(each.body).detail
    assert any("ぁ" <= sign <= "ヿ" for sign in detail)
    assert explain_request(each.body)


def test_requests_of_the_orinkit_client():
    connect = BY_NAME["Controller_Connect"]
    assert (
        write_request(connect, ("b-CAP", "CaoProv.DENSO.VRC", "localhost", ""))
        == b"Func=3,Arg1=b-CAP,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=,Arg5="
    )
    assert (
        write_request(connect, ("座,Arg2=&+ %", "", "", "a=b"))
        == b"Func=3,Arg1=%E5%BA%A7%2CArg2%3D%26%2B%20%25,Arg2=,Arg3=,Arg4=a%3Db,Arg5="
    )
    assert write_request(BY_NAME["Service_Start"], ()) == b"Func=1,Arg1=,Arg2=,Arg3=,Arg4=,Arg5="
    assert (
        write_request(BY_NAME["Robot_Move"], (5, 1, [1.0, 0.5], "NEXT"))
        == b"Func=72,Arg1=5,Arg2=1,Arg3=8197%2C1%2C0.5,Arg4=NEXT,Arg5="
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, b""),
        (Variant(VarType.EMPTY), b""),
        (Variant(VarType.NULL), b"1%2C"),
        ("", b"8%2C"),
        ("P1", b"8%2CP1"),
        ([], b"8204%2C"),
        (True, b"11%2C-1"),
        (100, b"3%2C100"),
        (b"\0\xff", b"8209%2C0%2C255"),
        (datetime(2026, 11, 21, 10), b"7%2C2026-11-21%2010%3A00%3A00"),
        (Decimal("1.5"), b"6%2C1.5"),
        ([1, "a", [2.5]], b"8204%2C%283%2C1%29%2C%288%2Ca%29%2C%288197%2C2.5%29"),
    ],
)
def test_any_value_is_written_in_notation(value, text):
    assert write_request(BY_NAME["Variable_PutValue"], (3, value)) == PUT + text + b",Arg3=,Arg4=,Arg5="


class Mode(IntEnum):
    CYCLE = 2


class Name(StrEnum):
    MOTOR = "Motor"


def test_numbers_and_texts_of_other_types():
    start = BY_NAME["Task_Start"]
    assert write_request(start, (2, Mode.CYCLE, Name.MOTOR)).startswith(b"Func=88,Arg1=2,Arg2=2,Arg3=Motor,")
    assert write_request(start, (True, -1, "")).startswith(b"Func=88,Arg1=1,Arg2=-1,Arg3=,")
    drive = BY_NAME["Robot_Drive"]
    assert b"Arg3=0.1," in write_request(drive, (2, 1, 0.1, ""))
    assert b"Arg3=1000000," in write_request(drive, (2, 1, 10**6, ""))
    assert b"Arg3=1e%2B20," in write_request(drive, (2, 1, 1e20, ""))
    assert read_request(write_request(drive, (2, 1, 1e20, ""))).arguments[2] == Variant(
        VarType.R4, 1.0000000200408773e20
    )
    assert read_request(b"Func=68,Arg1=2,Arg2=1,Arg3=1e39").arguments[2] == Variant(
        VarType.R8, 1e39
    )  # too large for a number


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("Controller_GetHelp", ("2",)),
        ("Controller_GetHelp", (2.0,)),
        ("Controller_GetHelp", (2**31,)),
        ("Controller_GetHelp", (None,)),
        ("Task_Start", (2, -(2**31) - 1, "")),
        ("Robot_Drive", (2, 1, "1", "")),
        ("Robot_Drive", (2, 1, 1e39, "")),
        ("Robot_Drive", (2, 1, 10**400, "")),
        ("Controller_GetVariable", (2, b"IO150", "")),
        ("Controller_GetVariable", (2, None, "")),
        ("Controller_GetVariable", (2, "IO150", 5)),
        ("Variable_PutValue", (2, 2**31)),
        ("Variable_PutValue", (2, object)),
    ],
)
def test_invalid_arguments_are_refused_as_by_b_cap(name, arguments):
    with pytest.raises(InvalidValue) as other:
        encode_request(BY_NAME[name], arguments, 1)
    with pytest.raises(InvalidValue) as refused:
        write_request(BY_NAME[name], arguments)
    assert str(refused.value) == str(other.value)
    assert str(refused.value).startswith(f"{name}, argument ")


def test_arrays_that_are_nested_too_deep_are_not_encoded():
    value = Variant(VARIANT_ARRAY, [])
    for _ in range(16):
        value = Variant(VARIANT_ARRAY, [value])
    with pytest.raises(
        InvalidValue, match=r"Variable_PutValue, argument 2 \(value\): VARIANT arrays nested deeper than 16"
    ):
        write_request(BY_NAME["Variable_PutValue"], (2, value))
    with pytest.raises(InvalidValue, match="nested deeper than 16"):
        write_reply(0, value)


def test_only_arguments_at_the_end_are_optional():
    """Empty arguments are omitted at the end; in between they would require a default."""
    for function in FUNCTIONS.values():
        optional = [argument.optional for argument in function.arguments]
        assert sum(optional) <= 1
        assert not any(optional[:-1])
        assert len(optional) <= 5


def test_omitted_arguments_have_their_defaults():
    function, arguments = read_request(b"Func=112,Arg1=4")
    assert read_arguments(function, arguments) == [4, 0]
    function, arguments = read_request(b"Func=17,Arg1=4,Arg2=Motor")
    assert read_arguments(function, arguments) == [4, "Motor", Variant(VarType.EMPTY)]
    function, arguments = read_request(b"Func=3")
    assert read_arguments(function, arguments) == ["", "", "", ""]


@pytest.mark.parametrize(
    ("text", "over_b_cap"),
    [
        ("abc", bstr("abc")),
        ("1.5", Variant(VarType.R8, 1.5)),
        ("4294967295", Variant(VarType.UI4, 2**32 - 1)),
        ("99999999999999999999", bstr("99999999999999999999")),
        ("nan", Variant(VarType.R8, float("nan"))),
        ("-inf", Variant(VarType.R8, float("-inf"))),
        ("2147483648", Variant(VarType.R8, 2.0**31)),
        ("7,1", Variant(VarType.DATE, 1.0)),
        ("8195,1,2", Variant(VarType.I4 | ARRAY, [1, 2])),
    ],
)
def test_a_number_is_refused_as_over_b_cap(text, over_b_cap):
    start = BY_NAME["Task_Start"]
    with pytest.raises(CallError) as other:
        read_arguments(start, [i4(2), over_b_cap])
    assert refusal(f"Func=88,Arg1=2,Arg2={text}".encode()).code == own_code(other.value.code) == hresult.E_INVALIDARG


# --- replies ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "result", "body"),
    [
        (0, None, b"0x00000000"),
        (0, Variant(VarType.EMPTY), b"0x00000000"),
        (0, Variant(VarType.NULL), b"0x00000000,1,"),
        (0, i4(2), b"0x00000000,3,2"),
        (0, bstr(""), b"0x00000000,8,"),
        (0, bstr(" 座標,変換\r\n"), b"0x00000000,8, " + "座標,変換\r\n".encode()),
        (0x900, Variant(VarType.UI1 | ARRAY, b"\x01\xff"), b"0x00000900,8209,1,255"),
        (0x8007_0006, None, b"0x80070006"),
        (-2147024890, None, b"0x80070006"),
    ],
)
def test_replies_of_the_orinkit_server(code, result, body):
    assert write_reply(code, result) == body
    read = read_reply(body)
    assert read[0] == hresult.unsigned(code)
    assert same(read[1], None if result == Variant(VarType.EMPTY) else result)


@pytest.mark.parametrize(
    ("body", "code", "result"),
    [
        (b"0x0", 0, None),
        (b"0X0000000a,3,2", 10, i4(2)),
        (b"0x80004005", 0x8000_4005, None),
        (b"0", 0, None),
        (b"0,8,a,b", 0, bstr("a,b")),
        (b"+5,3,1", 5, i4(1)),
        (b"2147942406", 0x8007_0006, None),
        (b"-2147024890", 0x8007_0006, None),
        (b"4294967295", 0xFFFF_FFFF, None),
        (b"\r\n\n\n 0x00000000 , 3 , 2 \r\n", 0, i4(2)),
        (b"\xef\xbb\xbf0x00000000,3,2", 0, i4(2)),
        (b"0x00000000,", 0, None),
        (b"0x00000000, \r\n", 0, None),
        (b"0x00000000\r\n", 0, None),
        (b"0x00000000,0,", 0, Variant(VarType.EMPTY)),
        (b"0x000000003,2", 0, i4(2)),  # as printed in the document: nothing between code and result
        (b"0x00000000 8204,(8,a)", 0, Variant(VARIANT_ARRAY, [bstr("a")])),
        (b"0x00000000\n8,a\n", 0, bstr("a\n")),
        (b"0x80070057,what a server may have to say", 0x8007_0057, None),
        (b"0x80070057,\xff", 0x8007_0057, None),
    ],
)
def test_replies_of_other_servers(body, code, result):
    read = read_reply(body)
    assert read[0] == code
    assert same(read[1], result)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"", "'' is not an e-CAP reply, which begins with a return code such as 0x00000000. Try: check the address"),
        (b" \r\n", "is not an e-CAP reply"),
        (
            b"<!DOCTYPE html><html><head><title>404</title>",
            "'<!DOCTYPE html><html><head><title>404</…' is not an e-CAP reply",
        ),
        (b"\xff\xfe0\x00", "is not an e-CAP reply"),
        (b"0x", "is not an e-CAP reply"),
        (b"0x000000000", "is not an e-CAP reply"),
        (b"0x0000000000000000", "is not an e-CAP reply"),
        (b"0x000000000,1", "is not an e-CAP reply"),
        (b"00000000A", "is not an e-CAP reply"),
        (b"12345678901", "is not an e-CAP reply"),
        (b"4294967296", "is not an e-CAP reply"),
        (b"-2147483649", "is not an e-CAP reply"),
        (b"0 OK", "is not an e-CAP reply"),
        ("０".encode(), "is not an e-CAP reply"),
        (
            b"0x00000000,abc",
            "invalid result 'abc' in an e-CAP reply: column 1: expected the number of a type",
        ),
        (b"0x00000000,3,2,", "column 3: expected a whole number"),
        (b"0x00000000,8," + "座".encode("shift_jis"), "in an e-CAP reply: not utf-8"),
    ],
)
def test_invalid_replies_are_quoted(body, message):
    error = unreadable(body)
    assert message in str(error)
    assert error.code == hresult.E_INVALIDRCVPACKET
    i18n.use("ja")
    assert any("ぁ" <= sign <= "ヿ" for sign in str(unreadable(body)))


NANS = [
    (VarType.R8, "<d", 0x7FF8_0000_0000_0000),
    (VarType.R8, "<d", 0xFFF8_0000_0000_0001),
    (VarType.R4, "<f", 0x7FC0_0000),
    (VarType.R4, "<f", 0xFFC0_1234),
]


@pytest.mark.parametrize(("vt", "form", "bits"), NANS)
def test_any_nan_arrives_as_the_nan_of_python(vt, form, bits):
    """There is only one notation for all NaNs; all other values are transmitted without loss."""
    (nan,) = struct.unpack(form, bits.to_bytes(struct.calcsize(form), "little"))
    _, result = read_reply(write_reply(0, Variant(vt, nan)))
    assert result is not None
    assert encode_variant(result) == encode_variant(Variant(vt, float("nan")))


# --- bounds -----------------------------------------------------------------------------------------------------------

SMALL = PacketLimits(variants=100)


def test_the_length_of_a_body_is_limited():
    limits = PacketLimits(packet=100)
    assert read_request(b"Func=9,Arg1=2,Arg2=".ljust(100, b"a"), limits).arguments[1] == bstr("a" * 81)
    assert refusal(b"Func=9,Arg1=2,Arg2=".ljust(101, b"a"), limits).code == hresult.E_INVALIDARG
    assert read_reply(b"0,8,".ljust(100, b"a"), limits) == (0, bstr("a" * 96))
    error = unreadable(b"0,8,".ljust(101, b"a"), limits)
    assert isinstance(error, LimitExceeded)
    assert "body of 101 bytes exceeds the limit of 100 bytes" in str(error)


@pytest.mark.parametrize(
    ("head", "element", "most"),
    [
        ("8204", "(3,1)", 100),
        ("8204", "(0,)", 100),
        ("8200", "a", 100),
        ("8200", '"a,"', 100),
        ("8199", "1", 100),
        ("8198", "1.5", 100),
        ("8203", "1", 1615),  # 16 characters count as one; the remainder of the division is free
        ("8209", "1", 2000),  # no bytes in a packet, but slow to parse as text
        ("8195", "1", 1615),
    ],
)
def test_the_number_of_elements_is_limited(head, element, most):
    for count, fits in ((most, True), (most + 1, False)):
        text = f"{head},{','.join([element] * count)}"
        if fits:
            assert len(read_request(PUT + text.encode(), SMALL).arguments[1].value) == most
            assert len(read_reply(f"0,{text}".encode(), SMALL)[1].value) == most
        else:
            assert refusal(PUT + text.encode(), SMALL).code == hresult.E_INVALIDARG
            error = unreadable(f"0,{text}".encode(), SMALL)
            assert isinstance(error, LimitExceeded)
            assert error.code == hresult.E_ARGSIZEOVER


@pytest.mark.parametrize(
    "text",
    [
        "8204," + ",".join(["(0)"] * 300),
        "8204,(08200,a" + ",a" * 600 + ")",
        "8204,( 8199,1" + ",1" * 600 + ")",
        "12,(8200," + "," * 600 + ")",
        "8200," + "()" * 300,
        '12,(8,"' + '""' * 10_000 + '")',
        "8200," + '""' * 20_000,
    ],
)
def test_texts_that_take_long_to_parse_are_refused(text):
    error = refusal(PUT + text.encode(), SMALL)
    assert error.code == hresult.E_INVALIDARG
    assert error.detail.startswith(
        "Variable_PutValue: the arrays have too many elements for e-CAP, which transfers arrays as text"
    )


@pytest.mark.parametrize("text", ["8," + '(,"' * 9000, "8,8200," + "," * 9000, "5," + " " * 9000 + "1"])
def test_a_scalar_may_be_long(text):
    assert read_request(PUT + text.encode(), SMALL).arguments[1].type in (VarType.BSTR, VarType.R8)


def test_a_long_text_that_is_not_in_notation():
    assert refusal(PUT + b"x" * 9000, SMALL).code == hresult.E_INVALIDARG


def test_several_variants_are_bounded_together():
    array = b"8195,1" + b",1" * 1500
    assert read_request(b"Func=73,Arg1=5,Arg2=" + array + b",Arg3=1,Arg4=", SMALL).function.name == "Robot_Rotate"
    error = refusal(b"Func=73,Arg1=5,Arg2=" + array + b",Arg3=1,Arg4=" + array, SMALL)
    assert error.code == hresult.E_INVALIDARG


def test_the_limit_on_depth_applies_to_long_arrays():
    error = refusal(
        PUT + b"8204,(8204,(8204," + b",".join([b"(3,1)"] * 50) + b"))", PacketLimits(variants=100, depth=2)
    )
    assert error.code == hresult.E_INVALIDARG
    assert error.detail.startswith("Variable_PutValue, argument 2 (value): VARIANT arrays nested deeper than 2")


# --- Shift_JIS ----------------------------------------------------------------------------------------------------------


@pytest.mark.field("5.3")
def test_a_body_in_shift_jis():
    plain = "Func=107,Arg1=3,Arg2=8,座標ソ+表".encode("cp932")
    escaped = b"Func=107&Arg1=3&Arg2=8," + b"".join(b"%%%02X" % byte for byte in "座標ソ+表".encode("cp932"))
    for body in (plain, escaped):
        assert read_request(body, charset="shift_jis").arguments == [i4(3), bstr("座標ソ+表")]
    function = BY_NAME["Variable_PutTag"]
    written = write_request(function, (3, "座標ソ+表"), "shift_jis")
    assert read_request(written, charset="shift_jis").arguments == [i4(3), bstr("座標ソ+表")]
    assert write_reply(0, bstr("表"), "shift_jis") == b"0x00000000,8," + "表".encode("cp932")
    assert read_reply(write_reply(0, bstr("表"), "shift_jis"), charset="shift_jis") == (0, bstr("表"))


def test_a_body_that_does_not_have_the_encoding():
    with pytest.raises(CallError) as caught:
        read_request(b"Func=107,Arg1=3,Arg2=ab\x81", charset="shift_jis")
    assert (caught.value.code, caught.value.detail) == (hresult.E_INVALIDARG, "Arg2 is not shift_jis: bytes 81 at 2")
    with pytest.raises(CallError, match=r"Arg2 is not UTF-8: bytes 81 at 2\. Try: send UTF-8"):
        read_request(b"Func=107,Arg1=3,Arg2=ab\x81")


# --- codes of the device ------------------------------------------------------------------------------------------------


@pytest.mark.field("5.2")
def test_codes_of_the_device_are_not_explained_as_those_of_b_cap():
    error = reply_error(0x80010001, "", "Variable_GetValue", (3,))
    assert "Error defined by the device" in str(error)
    assert "E_INVALIDRCVPACKET" not in str(error)
    assert explain_reply(b"0x80010001") == "0x80010001: Error defined by the device"
    assert "E_HANDLE" in str(reply_error(hresult.E_HANDLE, "", "", ()))


# --- user-defined functions ---------------------------------------------------------------------------------------------

BLINK = user_entry(
    300,
    "Blink",
    (Argument("times", VarType.I4), Argument("name", VarType.BSTR, optional=True, default="")),
    None,
    "",
    "",
)
ANY = user_entry(301, "Any", tuple(Argument(f"a{n}", VarType.VARIANT, optional=True) for n in range(5)), None, "", "")
TYPED = user_entry(302, "Typed", (Argument("level", VarType.R8), Argument("on", VarType.BOOL)), None, "", "")
OWN = {each.id: UserFunction(each, print) for each in (BLINK, ANY, TYPED)}


@pytest.mark.field("5.1")
@pytest.mark.parametrize(
    ("body", "arguments"),
    [
        (b"Func=300,Arg1=3,Arg2=red", [i4(3), bstr("red")]),
        (b"Func=300&Arg1=3%2C5&Arg2=8,x", [i4(5), bstr("8,x")]),
        (b"Func=301,Arg1=3,Arg2=1.5,Arg3=red,Arg4=8,5,Arg5=8194,1,2",
         [i4(3), Variant(VarType.R8, 1.5), bstr("red"), bstr("5"), Variant(VarType.I2 | ARRAY, [1, 2])]),
    ],
)  # fmt: skip
def test_a_request_for_a_user_defined_function(body, arguments):
    assert read_request(body, user_functions=OWN).arguments == arguments
    assert refusal(body).code == hresult.E_NOTIMPL


@pytest.mark.parametrize(
    ("level", "on", "number", "flag"),
    [
        (b"1.5", b"true", 1.5, True),
        (b" -2e3 ", b"FALSE", -2000.0, False),
        (b"0x10", b"1", 16.0, True),
        (b"4,0.25", b"0", 0.25, False),
        (b"4294967296", b"-1", 4294967296.0, True),
    ],
)
def test_numbers_and_flags_of_a_user_defined_function(level, on, number, flag):
    body = b"Func=302&Arg1=" + level.replace(b",", b"%2C") + b"&Arg2=" + on
    expected = [Variant(VarType.R8, number), Variant(VarType.BOOL, flag)]
    assert read_request(body, user_functions=OWN).arguments == expected


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        (b"Func=302&Arg1=&Arg2=1", "expected a number, got an empty value"),
        (b"Func=302&Arg1=high&Arg2=1", "'high' is not a number"),
        (b"Func=302&Arg1=1&Arg2=yes", "'yes' is not a number"),
    ],
)
def test_values_that_are_not_numbers_and_flags(body, detail):
    with pytest.raises(CallError, match=detail) as caught:
        read_request(body, user_functions=OWN)
    assert caught.value.code == hresult.E_INVALIDARG


@pytest.mark.field("5.1")
def test_a_call_of_a_user_defined_function():
    body = write_request(foreign_entry(301, 4), (3, 1.5, "1,a", Variant(VarType.I2, 7)))
    assert body == b"Func=301,Arg1=3,Arg2=1.5,Arg3=1%2Ca,Arg4=2%2C7,Arg5="
    with pytest.raises(InvalidValue, match="from 255"):
        foreign_entry(254, 0)
    with pytest.raises(InvalidValue, match="the limit is 5"):
        foreign_entry(300, 6)


# --- summaries --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "line"),
    [
        (b"Func=3,Arg1=,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=,Arg5=",
         'Controller_Connect name="" provider="CaoProv.DENSO.VRC" machine="localhost" option=""'),
        (b"Func=9&Arg1=2&Arg2=%E5%BA%A7", 'Controller_GetVariable handle=2 name="座" option=""'),
        (b"Func=102,Arg1=3,Arg2=8194%2C100", "Variable_PutValue handle=3 value=8194,100"),
        (b"Func=2", "Service_Stop"),
        (b"Func=2,Arg2=x,Arg1=", 'Service_Stop Arg2="x"'),
        (b"Func=200,Arg1=x", 'unknown function 200 Arg1="x"'),
        (b"Func=0", "unknown function 0"),
        (b"Func=a%1Bb", "unknown function a\\x1bb"),
        (b"Func=9,Arg1=2,Arg2=a%1B%5B2Jb%0A", 'Controller_GetVariable handle=2 name="a\\x1b[2Jb\\n" option=""'),
        (b"x", "not an e-CAP request: the field Func is missing: the body begins with 'x'. Try: Func=3,Arg1=...,Arg2=..."),
    ],
)  # fmt: skip
def test_a_request_in_one_line(body, line):
    assert explain_request(body) == line


@pytest.mark.parametrize(
    ("body", "line"),
    [
        (b"0x00000000,3,2", "S_OK 3,2"),
        (b"0x00000000", "S_OK"),
        (b"0,8,a\x1b[2J\n", "S_OK 8,a\\x1b[2J\\n"),
        (b"0x00000000,\xff", "S_OK \ufffd"),
        (b"0x80070006", "0x80070006 E_HANDLE: Invalid handle"),
        (b"<html>", "'<html>' is not an e-CAP reply"),
    ],
)
def test_a_reply_in_one_line(body, line):
    assert explain_reply(body).startswith(line)


def test_a_code_without_a_name_in_one_line():
    assert explain_reply(b"0x80010123").startswith("0x80010123: ")
    assert explain_reply(b"0x00000002,3,1") == "0x00000002 3,1"


def test_long_values_are_shortened_in_a_line():
    line = explain_request(b"Func=9,Arg1=2,Arg2=" + b"a" * 500)
    assert line == f'Controller_GetVariable handle=2 name="{"a" * 199}…" option=""'
    assert explain_request(b"Func=9,Arg1=2,Arg2=" + b"a" * 200).count(
        "a"
    ) == 200 + "Controller_GetVariable handle name".count("a")
    assert explain_reply(b"0,8," + b"a" * 5000) == f"S_OK 8,{'a' * 197}…"
