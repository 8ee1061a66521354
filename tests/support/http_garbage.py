"""Malformed requests to an e-CAP server, and some valid ones; reproducible by seed.

A :class:`Stream` contains the bytes for one connection: requests in sequence, raw bytes between them, and mostly a valid
request with ``Connection: close`` at the end. If the expected status of a request is known, its path contains it:
``/405-GET-17`` expects 405 if the request arrives as a GET.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple
from urllib.parse import quote

from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.table import Argument, Function
from orinkit.values.notation import format_variant
from orinkit.values.variant import Variant, VarType, variant

Handles = Mapping[str, list[int]]
FORM = b"application/x-www-form-urlencoded"
WANTED = re.compile(rb"/([0-9]{3})-(\w+)-")
MEBIBYTE = 1 << 20

VALUES: list[Any] = [
    None, True, -5, 0, 1, 1.5, "", "IO150", "I5", "I*", "日本語", b"\x01\x04", [1, 2, 3], [1.5] * 8, ["a", "b"], -(2**31),
    [1, "b", [2.5, [None]]], [], float("nan"), float("inf"), -0.0, 5e-324, 2**31 - 1, "P(1,2,3,4,5,6,7)", "J(1,2,3,4,5,6)",
    "@P J(0,0,0,0,0,0)", Variant(VarType.I2, 3), Variant(VarType.CY, 1), Variant(VarType.DATE, 1.25), Variant(VarType.ERROR, 5),
    Variant(VarType.DATE, 1e300), Variant(VarType.UI8, 2**63), Variant(VarType.NULL), Variant(VarType.BOOL | 0x2000, [True, False]),
    Variant(VarType.BSTR | 0x2000, []), "\ud83e", "🤖", "a\0b", "%41+%", "x" * 5000, list(range(3000)),
]  # fmt: skip

# "Motor" is missing, so the arm cannot move, regardless of the other commands.
TEXTS = [
    "", "", "I5", "D2", "P1", "J2", "IO150", "V*", "@MODE", "@CURRENT_TIME", "@ERROR_CODE", "WDT=400", "InvokeTimeout=5000", "NEXT",
    "SPEED=50", "@IfNotMember", "ClearError", "GetCurErrorCount", "GetCurErrorInfo", "GetErrorDescription", "GetErrorLog", "SysState",
    "SysInfo", "TakeArm", "GiveArm", "TakeArmState", "CurPos", "CurJnt", "P2J", "slvChangeMode", "slvMove", "ExtSpeed", "Draw",
    "Rotate", "GetSrvData", "HandCurPos", "../../etc/passwd", "C:\\Windows", "Pro1", "Pro1.pcs", "日本語", "a,b=&c;+%", "Arg1=,Func=2",
    "\ud83e", "a\0b", "x" * 3000, "CaoProv.DENSO.VRC", "Test.Recorder", "*",
]  # fmt: skip
INTEGERS = [
    "0",
    "1",
    "-1",
    "2",
    " 3 ",
    "0x10",
    "2147483647",
    "-2147483648",
    "2147483648",
    "4294967295",
    "1e3",
    "2.0",
    "3,1",
    "8,1",
    "",
]
REALS = ["0", "1", "-1.5", "1e3", "1e39", "1e999", "nan", "inf", "-0.0", "4,1.5", "0xff", "."]

NUMBERS = [b"9" * 5000, b"1e999999999", b"0x" + b"f" * 400, b"-1", b"2147483648", b"99999999999999999999", b"0" * 4000 + b"1", b"1_0",
           "٣".encode(), b"1e", b"+", b"--1", b"0.0000001"]  # fmt: skip
ESCAPES = [
    b"%",
    b"%%",
    b"%G1",
    b"%1",
    b"%u1234",
    b"%00",
    b"%C0%80",
    b"%ED%A0%80",
    b"%F8%88%80%80%80",
    b"%FF",
    b"%2",
    b"%2525",
    b"%0d%0a",
]
ENCODINGS = ["shift_jis", "utf-16", "utf-16-le", "utf-32", "utf-7", "euc_jp", "iso2022_jp"]
PIECES = [b"\0", b"&", b",", b"=", b"Func=", b",Arg1=", b"&Arg9=1", b"8204,(", b")", b"(", b"8,", b"8204,", b"\r\n", b"\xff", b"\xef\xbb\xbf",
          b"Func=3,", b"65535,1", b"8195,", b" ", b"+", b"'", b'"', b"\\", b"<a>", b"{}"]  # fmt: skip
WORKS = [(b"Crash", b""), (b"CrashLater", b""), (b"CrashBlocking", b""), (b"Echo", b"8,x"), (b"EchoLater", b"8204,(8,x),(3,9)"),
         (b"Fail", b"3,-2147024882"), (b"Large", b"3,70000")]  # fmt: skip


class Bodies:
    """Generates bodies: calls of all functions with random arguments, and mutations of them.

    Args:
        chance: the source of all random choices.
    """

    def __init__(self, chance: random.Random) -> None:
        self.chance = chance
        self._functions = [each for each in FUNCTIONS.values() if not each.releases and each.interface != "Service"]
        self._mutations: list[Callable[[bytes], bytes]] = [
            self._flip, self._flip, self._cut, self._double, self._insert, self._insert, self._remove, self._number, self._escape,
            self._encode, self._splice, self._fields, self._noise, self._nest, self._random_call,
        ]  # fmt: skip

    def sound(self, handles: Handles) -> bytes:
        """Return a well-formed call of any function, with arguments of mostly the right types."""
        function = self.chance.choice(self._functions if self.chance.random() < 0.97 else list(FUNCTIONS.values()))
        fields = [("Func", str(function.id))]
        fields += [(f"Arg{n}", self._argument(function, each, handles)) for n, each in enumerate(function.arguments, 1)]
        if self.chance.random() < 0.3:
            fields += [(f"Arg{n}", "") for n in range(len(function.arguments) + 1, 6)]
        if self.chance.random() < 0.1:
            self.chance.shuffle(fields)
        return self._write(fields)

    def mutant(self, handles: Handles) -> bytes:
        """Return a call after one to three mutations."""
        body = self.sound(handles)
        for _ in range(self.chance.choice([1, 1, 1, 2, 3])):
            body = self.chance.choice(self._mutations)(body)
        return body

    def large(self) -> bytes:
        """Return a call with a text of 1 MiB, or a malformed body of that size."""
        letter = self.chance.choice(
            [
                b"x",
                b"%",
                b"%41",
                "日".encode(),
                b"%E6%97%A5",
                b"\xff",
                b",",
                b"&",
                b"8204,(",
                b"(",
                b"1,",
                b"%2C",
                b"\0",
                b"+",
            ]
        )
        text = letter * (MEBIBYTE // len(letter))
        head = self.chance.choice([b"Func=17,Arg1=2,Arg2=Echo,Arg3=8,", b"Func=17&Arg1=2&Arg2=", b"Func=101,Arg1=", b"", b"Func=", b"Arg1=8204,",
                                   b"Func=102,Arg1=3,Arg2=8195,", b"Func=102,Arg1=3,Arg2=8204,"])  # fmt: skip
        return head + text

    def to_workshop(self, handle: int, *, may_wait: bool) -> bytes:
        """Return a call of the workshop that waits, fails or crashes; not for mutation, as its parameter sets the duration."""
        if may_wait and self.chance.random() < 0.1:
            return b"Func=17,Arg1=%d,Arg2=Wait,Arg3=" % handle
        command, parameter = self.chance.choice(WORKS)
        return b"Func=17,Arg1=%d,Arg2=%b,Arg3=%b" % (handle, command, parameter)

    # --- calls ----------------------------------------------------------------------------------------------------

    def _argument(self, function: Function[..., Any], argument: Argument, handles: Handles) -> str:
        pick = self.chance.choice
        if argument.is_handle:
            if self.chance.random() < 0.85 and handles.get(function.interface):
                return str(pick(handles[function.interface]))
            return pick([*INTEGERS, *(str(each) for every in handles.values() for each in every)])
        if argument.vt is VarType.VARIANT:
            value = variant(pick(VALUES))
            return "" if value.type == VarType.EMPTY else format_variant(value)
        return pick({VarType.I4: INTEGERS, VarType.R4: REALS, VarType.BSTR: TEXTS}[argument.vt])

    def _write(self, fields: list[tuple[str, str]]) -> bytes:
        """Encode fields in one of the formats that clients use."""
        chance = self.chance
        way = chance.choice([_escaped, _escaped, _lower_case, _as_it_is])
        mark = chance.choice([b",", b"&", b", "])
        name: Callable[[str], str] = chance.choice([str.capitalize, str.capitalize, str.lower, str.upper])
        body = mark.join(name(key).encode() + b"=" + way(value) for key, value in fields)
        if chance.random() < 0.05:  # percent-encoded as a whole
            return b"Func=" + quote(body.partition(b"=")[2], safe="").encode()
        return body + chance.choice([b"", b"", b"", b"\r\n"])

    # --- mutations ------------------------------------------------------------------------------------------------

    def _place(self, body: bytes) -> int:
        return self.chance.randrange(len(body) + 1)

    def _flip(self, body: bytes) -> bytes:
        data = bytearray(body)
        for _ in range(self.chance.choice([1, 1, 2, 8])):
            if data:
                data[self.chance.randrange(len(data))] ^= 1 << self.chance.randrange(8)
        return bytes(data)

    def _cut(self, body: bytes) -> bytes:
        return body[: self._place(body)]

    def _double(self, body: bytes) -> bytes:
        place = self._place(body)
        part = body[place : place + self.chance.randrange(1, 200)]
        return body[:place] + part * self.chance.choice([1, 2, 50]) + body[place:]

    def _insert(self, body: bytes) -> bytes:
        place = self._place(body)
        return body[:place] + self.chance.choice(PIECES) * self.chance.choice([1, 1, 2, 100]) + body[place:]

    def _remove(self, body: bytes) -> bytes:
        place = self._place(body)
        return body[:place] + body[place + self.chance.randrange(1, 20) :]

    def _number(self, body: bytes) -> bytes:
        found = list(re.finditer(rb"[0-9]+", body))
        if not found:
            return body
        match = self.chance.choice(found)
        return body[: match.start()] + self.chance.choice(NUMBERS) + body[match.end() :]

    def _escape(self, body: bytes) -> bytes:
        place = self._place(body)
        return body[:place] + self.chance.choice(ESCAPES) * self.chance.choice([1, 1, 30]) + body[place:]

    def _encode(self, body: bytes) -> bytes:
        text = body.decode("utf-8", "replace") + self.chance.choice(["", "座標", "é"])
        return text.encode(self.chance.choice(ENCODINGS), "replace")

    def _splice(self, body: bytes) -> bytes:
        other = self.sound({})
        return body[: self._place(body)] + other[self._place(other) :]

    def _fields(self, body: bytes) -> bytes:
        field = self.chance.choice([b"&Arg1=1", b",Arg2=x", b"&", b"&x=1", b"&Func=1", b"&Arg6=1", b"&=", b"&Arg3=%"])
        return body + field * self.chance.choice([1, 2, 40, 10_000])

    def _noise(self, body: bytes) -> bytes:
        return body[: self._place(body)] + self.chance.randbytes(self.chance.randrange(200))

    def _nest(self, body: bytes) -> bytes:
        depth = self.chance.choice([2, 15, 16, 17, 40, 5000])
        ending = b")" * self.chance.choice([depth, depth, depth - 1, 0])
        return b"Func=17,Arg1=%d,Arg2=Echo,Arg3=" % self.chance.randrange(2, 9) + b"8204,(" * depth + b"3,1" + ending

    def _random_call(self, body: bytes) -> bytes:
        values = [
            quote(self.chance.choice(TEXTS + INTEGERS), safe="", errors="surrogatepass")
            for _ in range(self.chance.randrange(6))
        ]
        fields = "".join(f",Arg{number}={value}" for number, value in enumerate(values, 1))
        return f"Func={self.chance.randrange(140)}{fields}".encode()


def _escaped(text: str) -> bytes:
    return quote(text, safe="", errors="surrogatepass").encode()


def _lower_case(text: str) -> bytes:
    return re.sub(rb"%..", lambda match: match[0].lower(), _escaped(text)).replace(b"%20", b"+")


def _as_it_is(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


class Stream(NamedTuple):
    """The bytes for one connection.

    Attributes:
        data: all bytes.
        cut: number of bytes sent before the connection is cut without reading replies; ``None`` to send all and read.
    """

    data: bytes
    cut: int | None = None


class Headers(NamedTuple):
    """A variant of the header of a request.

    Attributes:
        status: the expected status; 0 if any status is allowed.
        lines: replacements for the lines with the same names; a value of ``None`` omits the line.
        method: the method of the request.
        version: the version of the request.
    """

    status: int = 0
    lines: tuple[tuple[bytes, bytes | None], ...] = ()
    method: bytes = b"POST"
    version: bytes = b"HTTP/1.1"


def _with(status: int, name: bytes, *values: bytes | None) -> list[Headers]:
    return [Headers(status, ((name, value),)) for value in values]


OTHERS = [
    *(Headers(405, method=method) for method in (b"GET", b"PUT", b"HEAD", b"OPTIONS", b"TRACE", b"DELETE", b"BREW", b"post", b"CONNECT", b"X" * 300)),
    *_with(200, b"Content-Type", FORM + b"; charset=UTF-8", None, FORM.upper(), FORM + b';charset="utf8"; x=y', FORM + b";"),
    *_with(415, b"Content-Type", b"application/json", b"text/plain", b"multipart/form-data; boundary=x", b";;;", FORM + b"; charset=EUC-JP",
           b"text/xml; charset=utf-8", b"\xff\xfe", FORM[:-1], b"x" * 9000),
    *_with(415, b"Content-Encoding", b"gzip", b"br, gzip", b"\x80"),
    *_with(200, b"Content-Encoding", b"identity"),
    *_with(421, b"Host", b"evil.example", b"evil.example:80", b"127.0.0.1.evil.example", b"x" * 300, b"\xe6\x97\xa5", b"[::1", b"1.2.3", b"a b", b":80",
           b"0x7f.1", b"[evil]"),
    *_with(200, b"Host", b"127.0.0.1", b"localhost:99999", b"[::1]:80", b"LOCALHOST", b"10.0.0.1", b""),
    *_with(400, b"Host", None),
    *_with(403, b"Origin", b"http://evil.example", b"null", b"", b"://", b"http://127.0.0.1.evil.example", b"\xff"),
    *_with(200, b"Cookie", b"a=" + b"x" * 8192, b";" * 5000, b"a", b"=", b"orinkit=1", b"\xff=\xfe", b"a=1; " * 900),
    *_with(200, b"Orinkit-Executing", b"80", b"400", b"0", b"-1", b"abc", b"99999999999999", "٣".encode(), b"", b"1e3"),
    *_with(200, b"Expect", b"100-continue", b"200-maybe"),
    *_with(200, b"Authorization", b"Bearer x", b"\xff" * 500, b"Basic"),
    *_with(200, b"Connection", b"keep-alive", b"x" * 500, b"upgrade"),
    *_with(200, b"Accept-Encoding", b"gzip, br;q=1.0, *;q=0"),
    *_with(200, b"Content-Length-X", b"1"),
    Headers(200, ((b"Connection", b"Upgrade"), (b"Upgrade", b"h2c"), (b"HTTP2-Settings", b"AAMAAABkAAQAoAAAAAIAAAAA"))),
    Headers(200, ((b"Connection", b"Upgrade"), (b"Upgrade", b"websocket"), (b"Sec-WebSocket-Key", b"dGhlIHNhbXBsZSBub25jZQ=="))),
    *(Headers(200, version=b"HTTP/1.0", lines=lines) for lines in ((), ((b"Host", None),), ((b"Connection", b"keep-alive"),))),
    *(Headers(version=version) for version in (b"HTTP/2.0", b"HTTP/0.9", b"HTTP/1.2", b"http/1.1", b"HTTP/1.1 ", b"HTTP/", b"", b"HTTP/11.1")),
    *_with(400, b"Content-Length", b"-1", b"+5", b"0x10", b"9" * 30, b"1e1", b"", b"5 5", b"\xff", b"1, 2"),
    *_with(413, b"Content-Length", b"99999999999999999", b"1000000000"),
    *_with(0, b"Content-Length", b"0", b"1", b"10", b"5000", None),
    *_with(0, b"X-Long", b"x" * 31_000, b"x" * 40_000, b"\0", b"a\rb", b"a\nb", b"\n folded"),
    *(Headers(0, ((name, b"x"),)) for name in (b"", b" X", b"X Y", b"X:", b"\xff", b"(X)", b"X" * 5000)),
]  # fmt: skip
"""Headers with one deviation from an ordinary header."""

OPENINGS = [
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\x12\x04\0\0\0\0\0",
    bytes.fromhex("16030100c8010000c40303") + bytes(range(200)),
    bytes.fromhex("01200000000100000001000000000004"),
    b"SSH-2.0-OpenSSH_9.2\r\n",
    b"GET /\r\n",
    b"POST /\r\nFunc=2\r\n",
    b"\r\n" * 20,
    b"\0" * 100,
    b"Func=1",
    b"POST / HTTP/1.1\n",
    b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n",
    b"x" * 50_000,
    b" POST / HTTP/1.1\r\n\r\n",
]
"""Bytes that arrive instead of a request."""


class Garbage:
    """Generates streams.

    Args:
        seed: determines the streams, except for handles and cookies.
    """

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self._bodies = Bodies(self.chance)
        self._count = 0

    def stream(self, handles: Handles, cookie: bytes) -> Stream:
        """Return the bytes for a connection.

        Args:
            handles: the client's handles, by interface.
            cookie: the client's cookie, which most requests contain.
        """
        chance = self.chance
        requests = chance.choice([1, 3, 8, 20])
        pieces = [self._request(handles, cookie) for _ in range(requests)]
        for _ in range(chance.choice([0, 0, 0, 0, 1])):
            junk = chance.choice([*OPENINGS, chance.randbytes(chance.randrange(1, 300))])
            pieces.insert(chance.choice([0, len(pieces), chance.randrange(len(pieces) + 1)]), junk)
        if chance.random() < 0.03:
            pieces.append(self._request(handles, cookie, self._bodies.large()))
        if chance.random() < 0.85:
            pieces.append(
                self._header(Headers(200, ((b"Connection", b"close"),)), b"", cookie, 15) + b"Func=101,Arg1=0"
            )
        data = b"".join(pieces)
        return Stream(data, chance.randrange(len(data) + 1) if chance.random() < 0.1 else None)

    def _request(self, handles: Handles, cookie: bytes, body: bytes | None = None) -> bytes:
        chance = self.chance
        if body is None and handles.get("Workshop") and chance.random() < 0.03:
            body = self._bodies.to_workshop(handles["Workshop"][0], may_wait=bool(cookie))
            how = Headers(200, ((b"Orinkit-Executing", chance.choice([b"80", None])),))
            return self._header(how, b"", cookie, len(body)) + body
        if body is None:
            body = self._bodies.sound(handles) if chance.random() < 0.45 else self._bodies.mutant(handles)
        if chance.random() < 0.1:
            cookie = chance.choice([b"", b"", cookie + b"x", cookie[:-1], cookie[:12]])
        way = chance.random()
        if way < 0.6:
            return self._header(Headers(200), b"", cookie, len(body)) + body
        if way < 0.85:
            return self._header(chance.choice(OTHERS), b"", cookie, len(body)) + body
        if way < 0.9:
            return self._wrong_length(cookie, body)
        if way < 0.96:
            return self._chunked(cookie, body)
        header = bytearray(self._header(Headers(), b"", cookie, len(body)))
        for _ in range(chance.choice([1, 2, 5])):
            header[chance.randrange(len(header))] ^= 1 << chance.randrange(8)
        return bytes(header) + body

    def _header(self, how: Headers, more: bytes, cookie: bytes, length: int) -> bytes:
        self._count += 1
        lines: dict[bytes, bytes | None] = {
            b"Host": b"127.0.0.1",
            b"Content-Type": FORM,
            b"Content-Length": b"%d" % length,
        }
        if cookie:
            lines[b"Cookie"] = cookie
        lines.update(how.lines)
        target = b"/%b-%b-%d" % (b"%d" % how.status if how.status else b"any", how.method, self._count)
        if not how.status and self.chance.random() < 0.2:
            target = self.chance.choice(
                [b"*", b"http://x/y", b"/%ff%00/../..", b"/" * 8000, b"", b"/ /", b"/\xff", b"?", b"x"]
            )
        text = b"".join(b"%b: %b\r\n" % (name, value) for name, value in lines.items() if value is not None)
        return b"%b %b %b\r\n%b%b\r\n" % (how.method, target, how.version, text, more)

    def _wrong_length(self, cookie: bytes, body: bytes) -> bytes:
        length = b"Content-Length: %d\r\n" % len(body)
        more, claimed = self.chance.choice([
            (b"", len(body) + self.chance.choice([1, 10, 1000, 100_000])), (b"", max(0, len(body) - self.chance.choice([1, 5, 30]))),
            (length, len(body)), (length, len(body) + 1), (b"Transfer-Encoding: identity\r\n", len(body)),
        ])  # fmt: skip
        return self._header(Headers(), more, cookie, claimed) + body

    def _chunked(self, cookie: bytes, body: bytes) -> bytes:
        chance = self.chance
        size = chance.choice([1, 7, 100, 5000]) if len(body) < 5000 else 5000
        pieces = [body[start : start + size] for start in range(0, len(body), size)]
        coded = [b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces]
        status, ending = 200, b"0\r\n\r\n"
        if chance.random() < 0.6:
            status = 0
            ending = chance.choice(
                [b"0\r\n\r\n", b"", b"0\r\n", b"0\r\nX-Trailer: 1\r\n\r\n", b"00000\r\n\r\n", b"-1\r\n\r\n"]
            )
            wrong = chance.choice([b"-5\r\nabcde\r\n", b"ffffffffffffffff\r\nabc", b"f" * 30 + b"\r\n", b"3\r\nabcde\r\n", b"3;x=y\r\nabc\r\n", b"3 \r\nabc\r\n",
                                   b"0x3\r\nabc\r\n", b"\r\n", b"3\nabc\n", b"3;" + b"x" * 40_000])  # fmt: skip
            coded.insert(chance.randrange(len(coded) + 1), wrong)
        lines = (
            [b"chunked"]
            if status
            else [b"chunked", b"chunked", b"CHUNKED", b"gzip, chunked", b"chunked, chunked", b"identity", b"x" * 900]
        )
        how = Headers(status, ((b"Content-Length", None), (b"Transfer-Encoding", chance.choice(lines))))
        if not status and chance.random() < 0.3:  # both headers, as in request smuggling
            how = how._replace(lines=((b"Transfer-Encoding", b"chunked"),))
        return self._header(how, b"", cookie, len(body)) + b"".join(coded) + ending
