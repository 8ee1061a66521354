"""Request bodies in the notations that users write, and their meaning; the examples of section 3.5."""

from __future__ import annotations

from struct import pack, unpack
from typing import NamedTuple

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType


def bstr(text: str) -> Variant:
    return Variant(VarType.BSTR, text)


def i4(number: int) -> Variant:
    return Variant(VarType.I4, number)


def r4(number: float) -> Variant:
    return Variant(VarType.R4, unpack("<f", pack("<f", number))[0])


def i2(number: int) -> Variant:
    return Variant(VarType.I2, number)


class Body(NamedTuple):
    """A valid body, the id of the function that it calls, and the decoded arguments."""

    name: str
    body: bytes
    function: int
    arguments: list[Variant]


class BadBody(NamedTuple):
    """An invalid body, the return code, and a part of the detail."""

    name: str
    body: bytes
    code: int
    detail: str


EXAMPLES = [
    ("2,100", i2(100)),
    ("8,Sample", bstr("Sample")),
    ("12,(8,Sample)", Variant(VarType.VARIANT, bstr("Sample"))),
    ("8194,100,200,300", Variant(VarType.I2 | ARRAY, [100, 200, 300])),
    ("8200,Sample,Test", Variant(VarType.BSTR | ARRAY, ["Sample", "Test"])),
    ("8,Sample,Test", bstr("Sample,Test")),
    ("8204,(8,Sample),(2,100)", Variant(VARIANT_ARRAY, [bstr("Sample"), i2(100)])),
]
"""The examples of section 3.5: text and value."""

_CONNECT = [bstr("b-CAP"), bstr("CaoProv.DENSO.VRC"), bstr("localhost")]

BODIES = [
    Body("as the document prints it",
         b"Func=3,Arg1=b-CAP,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=,Arg5=", 3, _CONNECT),
    Body("as the document breaks the line",
         b"Func=3,Arg1=b-CAP,Arg2=CaoProv.DENSO.VRC,Arg3=localhost,Arg4=,  \r\nArg5=", 3, _CONNECT),
    Body("blanks behind the commas and around the names",
         b"Func = 3, Arg1 =b-CAP,\tArg2=CaoProv.DENSO.VRC,\n Arg3=localhost", 3, _CONNECT),
    Body("curl -d, one field each", b"Func=3&Arg1=b-CAP&Arg2=CaoProv.DENSO.VRC&Arg3=localhost&Arg4=", 3, _CONNECT),
    Body("commas and & mixed", b"Func=3,Arg1=b-CAP&Arg2=CaoProv.DENSO.VRC,Arg3=localhost", 3, _CONNECT),
    Body("unused ones left out", b"Func=101,Arg1=3", 101, [i4(3)]),
    Body("all five, unused ones empty", b"Func=101,Arg1=3,Arg2=,Arg3=,Arg4=,Arg5=", 101, [i4(3)]),
    Body("no argument at all", b"Func=2", 2, []),
    Body("unused ones of blanks", b"Func=2,Arg1= ,Arg2=%20&Arg3=+", 2, []),
    Body("any order", b"Arg2=IO150,Arg1=2,Func=9", 9, [i4(2), bstr("IO150")]),
    Body("lower case", b"func=9,arg1=2,arg2=IO150", 9, [i4(2), bstr("IO150")]),
    Body("upper case", b"FUNC=9&ARG1=2&ARG2=IO150", 9, [i4(2), bstr("IO150")]),
    Body("a line break at the end, as curl --data-binary @file keeps it", b"Func=9,Arg1=2,Arg2=IO150\r\n", 9,
         [i4(2), bstr("IO150")]),
    Body("a byte order mark, as Notepad writes it", b"\xef\xbb\xbfFunc=9,Arg1=2,Arg2=IO150", 9, [i4(2), bstr("IO150")]),
    Body("empty pieces", b"&Func=9&&Arg1=2&Arg2=IO150&\r\n", 9, [i4(2), bstr("IO150")]),
    Body("curl --data-urlencode of one value", b"Func=9&Arg1=2&Arg2=%40CURRENT%5FTIME", 9, [i4(2), bstr("@CURRENT_TIME")]),
    Body("escapes in upper case", b"Func=107,Arg1=3,Arg2=8%2Ca%2Cb%3D%26c%2F%E3%82%BF", 107, [i4(3), bstr("a,b=&c/タ")]),
    Body("escapes in lower case", b"Func=107,Arg1=3,Arg2=8%2ca%2cb%3d%26c%2f%e3%82%bf", 107, [i4(3), bstr("a,b=&c/タ")]),
    Body("an escape of a percent sign is not read twice", b"Func=9,Arg1=2,Arg2=%252C%25", 9, [i4(2), bstr("%2C%")]),
    Body("an encoded separator is part of the value", b"Func=9,Arg1=2,Arg2=a%2CArg3=b%26Arg4%3Dc", 9,
         [i4(2), bstr("a,Arg3=b&Arg4=c")]),
    Body("UTF-8 as it is", "Func=107,Arg1=3,Arg2=8,座標,変換".encode(), 107, [i4(3), bstr("座標,変換")]),
    Body("UTF-8 encoded", b"Func=107&Arg1=3&Arg2=8%2C%E5%BA%A7%E6%A8%99", 107, [i4(3), bstr("座標")]),
    Body("beyond the first plane", "Func=107,Arg1=3,Arg2=8,🤖%F0%9F%A4%96".encode(), 107, [i4(3), bstr("🤖🤖")]),
    Body("a character as two surrogates, as Java's modified UTF-8 has it",
         b"Func=107,Arg1=3,Arg2=8,%ED%A0%BE%ED%B4%96\xed\xa0\xbe", 107, [i4(3), bstr("🤖\ud83e")]),
    Body("an option string as it is", b"Func=1,Arg1=WDT=400,InvokeTimeout=5000,Arg2=,Arg3=,Arg4=,Arg5=", 1,
         [bstr("WDT=400,InvokeTimeout=5000")]),
    Body("an option string encoded", b"Func=1&Arg1=WDT%3D400%2CInvokeTimeout%3D5000", 1, [bstr("WDT=400,InvokeTimeout=5000")]),
    Body("a comma with no field behind it", b"Func=9,Arg1=2,Arg2=a,b,Arg6=c,Argument=d,Arg1,Func,", 9,
         [i4(2), bstr("a,b,Arg6=c,Argument=d,Arg1,Func,")]),
    Body("a VARIANT array as it is", b"Func=17,Arg1=2,Arg2=Test,Arg3=8204,(8,Sample),(2,100),Arg4=", 17,
         [i4(2), bstr("Test"), EXAMPLES[6][1]]),
    Body("a VARIANT array encoded, blanks in it", b"Func=17&Arg1=2&Arg2=Test&Arg3=8204%2C+%288%2CSample%29%2C+%282%2C+100%29",
         17, [i4(2), bstr("Test"), EXAMPLES[6][1]]),
    Body("a pose", b"Func=72,Arg1=5,Arg2=1,Arg3=8,@P P(400, 0, 300, 180, 0, 180, -1),Arg4=NEXT", 72,
         [i4(5), i4(1), bstr("@P P(400, 0, 300, 180, 0, 180, -1)"), bstr("NEXT")]),
    Body("a VARIANT that is nothing", b"Func=72,Arg1=5,Arg2=1,Arg3=,Arg4=NEXT", 72,
         [i4(5), i4(1), Variant(VarType.EMPTY), bstr("NEXT")]),
    Body("an empty string as VARIANT", b"Func=102,Arg1=3,Arg2=8,", 102, [i4(3), bstr("")]),
    Body("VT_NULL as VARIANT", b"Func=102,Arg1=3,Arg2=1,", 102, [i4(3), Variant(VarType.NULL)]),
    Body("nothing as VARIANT where it may not be left out", b"Func=102,Arg1=3,Arg2=", 102, [i4(3), Variant(VarType.EMPTY)]),
    Body("+ is a blank in a form", b"Func=17&Arg1=2&Arg2=GetErrorDescription+1&Arg3=8,a+b%2Bc", 17,
         [i4(2), bstr("GetErrorDescription 1"), bstr("a b+c")]),
    Body("+ is itself if commas separate the fields", b"Func=17,Arg1=2,Arg2=a+b,Arg3=8,a+b%2Bc", 17,
         [i4(2), bstr("a+b"), bstr("a+b+c")]),
    Body("a % that begins no escape", b"Func=17,Arg1=2,Arg2=100%,Arg3=8,%G1 x%4", 17,
         [i4(2), bstr("100%"), bstr("%G1 x%4")]),
    Body("the same in a form", b"Func=17&Arg1=2&Arg2=100%&Arg3=8,%%41%u0041", 17,
         [i4(2), bstr("100%"), bstr("%A%u0041")]),
    Body("strings of an array, with blanks, quotes and brackets", b'Func=102,Arg1=3,Arg2=8200, a ,"b",c(,"d', 102,
         [i4(3), Variant(VarType.BSTR | ARRAY, [" a ", '"b"', "c(", '"d'])]),
    Body("blanks are part of a string", b"Func=9,Arg1=2,Arg2= IO150%20,Arg3= ", 9, [i4(2), bstr(" IO150 "), bstr(" ")]),
    Body("encoded in one piece: curl --data-urlencode 'Func=17,Arg1=2,...'",
         b"Func=17%2CArg1%3D2%2CArg2%3DTest%2B%2CArg3%3D8%2Ca%2Cb", 17, [i4(2), bstr("Test+"), bstr("a,b")]),
    Body("encoded in one piece: curl --data-urlencode 'Func=17&Arg1=2&...'",
         b"Func=17%26Arg1%3D2%26Arg2%3D100%25%2C%E5%BA%A7", 17, [i4(2), bstr("100%,座")]),
    Body("encoded in one piece: curl --data-urlencode '=Func=17,Arg1=2,...', encodeURIComponent",
         b"Func%3D17%2C%20Arg1%3D2%2CArg2%3dTest", 17, [i4(2), bstr("Test")]),
    Body("commas encoded, = not", b"Func=17%2CArg1=2%2CArg2=Test", 17, [i4(2), bstr("Test")]),
    Body("numbers with blanks and signs", b"Func= 68 ,Arg1= 5 ,Arg2=%2B2,Arg3= -1.5 ,Arg4=", 68, [i4(5), i4(2), r4(-1.5)]),
    Body("hexadecimal numbers", b"Func=0x44,Arg1=0X5,Arg2=-0x2,Arg3=0xff", 68, [i4(5), i4(-2), r4(255)]),
    Body("numbers in notation", b"Func=68,Arg1=3,5,Arg2=2,2,Arg3=4,1.5", 68, [i4(5), i4(2), r4(1.5)]),
    Body("numbers in notation, encoded", b"Func=68&Arg1=19%2C5&Arg2=8195%2C2&Arg3=8%2C1e2", 68, [i4(5), i4(2), r4(100)]),
    Body("a whole number as a fraction or with an exponent", b"Func=68,Arg1=5,Arg2=2.0,Arg3=1E-3", 68, [i4(5), i4(2), r4(0.001)]),
    Body("an exponent without a sign", b"Func=68,Arg1=5,Arg2=1e1,Arg3=2e3", 68, [i4(5), i4(10), r4(2000)]),
    Body("a handle beyond VT_I4", b"Func=20,Arg1=4294967295", 20, [Variant(VarType.UI4, 0xFFFFFFFF)]),
    Body("a negative handle", b"Func=20,Arg1=-1", 20, [i4(-1)]),
    Body("an optional number left out", b"Func=112,Arg1=4,Arg2=", 112, [i4(4)]),
    Body("an optional number of blanks", b"Func=112,Arg1=4,Arg2=%20", 112, [i4(4)]),
    Body("an optional number", b"Func=112,Arg1=4,Arg2=1", 112, [i4(4), i4(1)]),
    Body("a NUL in a string", b"Func=9,Arg1=2,Arg2=a%00b", 9, [i4(2), bstr("a\0b")]),
    Body("backslashes", rb"Func=9,Arg1=2,Arg2=\x41\%5C\u0041%41", 9, [i4(2), bstr(r"\x41\\\u0041A")]),
]  # fmt: skip
"""Valid bodies."""

_ARG = hresult.E_INVALIDARG

BAD_BODIES = [
    BadBody("empty", b"", _ARG, "the field Func is missing: the body is empty. Try: Func=3,Arg1=...,Arg2=..."),
    BadBody("only blanks", b" \t \r\n", _ARG, "the field Func is missing: the body is empty"),
    BadBody("JSON", b'{"Func": 3}', _ARG, "the field Func is missing: the body begins with '{\"Func\": 3}'"),
    BadBody("XML, long", b"<soap>" * 20, _ARG, "the field Func is missing: the body begins with '<soap><soap><soap><soap><soap><soap><so…'"),
    BadBody("no Func", b"Arg1=3", _ARG, "the field Func is missing: the body begins with 'Arg1=3'"),
    BadBody("no = at all", b"Func", _ARG, "the field Func is missing"),
    BadBody("no Func in what was encoded in one piece", b"Arg1%3D3%2CArg2%3D4", _ARG, "the field Func is missing: the body begins with 'Arg1=3,Arg2=4'"),
    BadBody("UTF-16", "Func=3".encode("utf-16"), _ARG, "the field Func is missing"),
    BadBody("Func without a number", b"Func=,Arg1=3", _ARG, "Func: '' is not a number. Try: Func=3"),
    BadBody("Func with a word", b"Func=abc,Arg1=3", _ARG, "Func: 'abc' is not a number"),
    BadBody("Func with a name", b"Func=variable_getvalue,Arg1=3", _ARG, "Try: Func=101"),
    BadBody("Func with a fraction", b"Func=3.0", _ARG, "Func: '3.0' is not a number"),
    BadBody("Func with a number that goes on and on", b"Func=" + b"1" * 5000, _ARG, "is not a number"),
    BadBody("Func in notation", b"Func=3,3", _ARG, "Func: '3,3' is not a number"),
    BadBody("Func 0", b"Func=0", hresult.E_NOTIMPL, "unknown function '0'; ids are 1 to 137"),
    BadBody("Func 138", b"Func=138", hresult.E_NOTIMPL, "unknown function '138'"),
    BadBody("Func negative", b"Func=-1", hresult.E_NOTIMPL, "unknown function '-1'"),
    BadBody("Func huge", b"Func=" + b"9" * 50, hresult.E_NOTIMPL, "unknown function '99999"),
    BadBody("Func twice", b"Func=3,Arg1=a,Func=4", _ARG, "Func is repeated"),
    BadBody("an argument twice, in another case", b"Func=3&Arg1=a&ARG1=b", _ARG, "Arg1 is repeated"),
    BadBody("twice in what was encoded in one piece", b"Func=3%2CArg1%3Da%2CFunc%3D4", _ARG, "Func is repeated"),
    BadBody("an unknown name", b"Func=3&Arg1=a&Arg6=b", _ARG, "unknown field 'Arg6=b'"),
    BadBody("an unknown name first", b"Function=3&Func=3", _ARG, "unknown field 'Function=3'"),
    BadBody("an & in a value", b"Func=3,Arg1=A&B,Arg2=c", _ARG, "unknown field 'B'; the fields are Func and Arg1 to Arg5. Try: encode an & in a value as %26"),
    BadBody("an & in what was encoded in one piece", b"Func=9%26b", _ARG, "unknown field 'b'"),
    BadBody("too many pieces", b"Func=3" + b"&" * 32, _ARG, "more than 32 fields"),
    BadBody("Shift_JIS", "Func=9,Arg1=2,Arg2=座標".encode("shift_jis"), _ARG, "Arg2 is not UTF-8: bytes 8d c0 95 57 at 0. Try: send UTF-8, or the header Content-Type: application/x-www-form-urlencoded; charset=Shift_JIS"),
    BadBody("no UTF-8, encoded", b"Func=9,Arg1=2,Arg2=ab%FF", _ARG, "Arg2 is not UTF-8: bytes ff at 2"),
    BadBody("no UTF-8 in Func", b"Func=\xff", _ARG, "Func is not UTF-8"),
    BadBody("too many arguments", b"Func=101,Arg1=3,Arg2=,Arg3=x", _ARG, "Variable_GetValue has no argument 3; Arg3 must be empty"),
    BadBody("an argument for none", b"Func=2,Arg5=1", _ARG, "Service_Stop has no argument 5"),
    BadBody("no handle", b"Func=101", _ARG, "Variable_GetValue, argument 1 (handle): expected a number, got an empty value"),
    BadBody("a handle of blanks", b"Func=9,Arg1= ,Arg2=a", _ARG, "Controller_GetVariable, argument 1 (handle): expected a number, got an empty value"),
    BadBody("a word for a handle", b"Func=101,Arg1=abc", _ARG, "argument 1 (handle): 'abc' is not a number"),
    BadBody("a fraction for a handle", b"Func=101,Arg1=2.5", _ARG, "argument 1 (handle): '2.5' is not a handle"),
    BadBody("a handle beyond 32 bits", b"Func=101,Arg1=0x100000000", _ARG, "'0x100000000' is not a handle"),
    BadBody("a string in notation for a handle", b"Func=101,Arg1=8,2", _ARG, "'8,2' is not a handle"),
    BadBody("a comma in a name of a field", b"Func=9,Arg1=2,Agr2=IO150", _ARG, "argument 1 (handle): column 3: expected"),
    BadBody("a word for a number", b"Func=88,Arg1=5,Arg2=abc", _ARG, "Task_Start, argument 2 (mode): 'abc' is not a number"),
    BadBody("a fraction for a whole number", b"Func=88,Arg1=5,Arg2=1.5", _ARG, "argument 2 (mode): 1.5 is not a whole number"),
    BadBody("beyond VT_I4", b"Func=88,Arg1=5,Arg2=2147483648", _ARG, "argument 2 (mode): 2147483648 is out of range"),
    BadBody("far beyond VT_I4", b"Func=88,Arg1=5,Arg2=0x1" + b"0" * 1000, _ARG, "is out of range"),
    BadBody("infinity for a whole number", b"Func=88,Arg1=5,Arg2=inf", _ARG, "inf is not a whole number"),
    BadBody("a number that goes on and on", b"Func=88,Arg1=5,Arg2=" + b"1" * 1101, _ARG, "is not a number"),
    BadBody("another type for a whole number", b"Func=88,Arg1=5,Arg2=7,2026-11-21", _ARG, "argument 2 (mode): got VT_DATE"),
    BadBody("NaN", b"Func=68,Arg1=5,Arg2=1,Arg3=nan", _ARG, "Robot_Drive, argument 3 (value): nan is not a finite number"),
    BadBody("a number beyond double precision", b"Func=68,Arg1=5,Arg2=1,Arg3=1e999", _ARG, "argument 3 (value): inf is not a finite number"),
    BadBody("digits of another script", "Func=68,Arg1=5,Arg2=1,Arg3=１".encode(), _ARG, "'１' is not a number"),
    BadBody("an exponent whose + was a blank", b"Func=68&Arg1=5&Arg2=1&Arg3=1e+06", _ARG, "'1e 06' is not a number. Try: encode a \"+\" as %2B"),
    BadBody("the same in notation", b"Func=102&Arg1=3&Arg2=5,1e+06", _ARG, "column 3: expected a number in the range of double precision (VT_R8), found '1e 06'; a VARIANT is written <type>,<value>, such as 3,100 or 8,text. Try: encode a \"+\""),
    BadBody("no notation", b"Func=102,Arg1=3,Arg2=IO150", _ARG, "Variable_PutValue, argument 2 (value): column 1: expected the number of a type"),
    BadBody("a number by itself for a VARIANT", b"Func=102,Arg1=3,Arg2=100", _ARG, "a VARIANT is written <type>,<value>, such as 3,100 or 8,text"),
    BadBody("nested too deep", b"Func=102,Arg1=3,Arg2=" + b"12,(" * 20 + b"3,1" + b")" * 20, _ARG, "nested deeper than 16"),
]  # fmt: skip
"""Invalid bodies."""
