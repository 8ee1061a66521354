"""The dissector for Wireshark, in the real tshark: packets of the documents, retries, streams, random and broken packets."""

from __future__ import annotations

import json
import math
import random
import struct
import subprocess
from datetime import datetime, timedelta
from decimal import Decimal
from itertools import pairwise

import pytest

from orinkit.bcap import dissect, packet
from orinkit.bcap.dissect import explain, first_error, one_line
from orinkit.bcap.dissector import lua
from orinkit.bcap.packet import Packet
from orinkit.bcap.pcapng import SERIAL_LINE, CaptureConnection
from orinkit.cao.functions import FUNCTIONS
from orinkit.core import hresult, i18n
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.conversions import ole_datetime, ole_days
from orinkit.values.types import ARRAY, TABLE, TypeRow, type_name
from orinkit.values.variant import VARIANT_ARRAY, Variant, VarType
from support import paths
from support.tshark import TCP, UDP, Dissected, Result, Tshark, needs_tshark

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
SEED = 5007


@pytest.fixture
def tshark(tmp_path) -> Tshark:
    return Tshark(tmp_path)


def request(serial: int, function: int = 101, *arguments, reserved: int = 0, crc: bool = False) -> bytes:
    return packet.encode(Packet(serial, function, list(arguments or (3,)), reserved), crc=crc)


def reply(serial: int, *arguments, code: int = 0, crc: bool = False) -> bytes:
    return packet.encode(Packet(serial, code, list(arguments)), crc=crc)


# --- the Lua text -----------------------------------------------------------------------------------------------------


@pytest.mark.core
def test_the_text_contains_every_row_of_the_tables():
    text = lua("1.2.3", 5008)
    assert "orinkit 1.2.3" in text
    assert 'local DEFAULT_PORTS = "5008"' in text
    assert "@VERSION@" not in text
    assert "@TABLES@" not in text
    for code, function in FUNCTIONS.items():
        assert f'[{code}] = {{name = "{function.name}"' in text
    for code, row in hresult.CODES.items():
        assert f'[{code}] = {{"{row.name}", ' in text
    for each in TABLE:
        assert f'[{int(each.code)}] = {{name = "{each.name}"' in text


# --- the packets of the documents -------------------------------------------------------------------------------------


def connection_of(vector) -> CaptureConnection:
    return SERIAL_LINE if vector["transport"] == "com" else TCP


@needs_tshark
def test_the_packets_of_the_documents_are_dissected_as_the_documents_explain_them(tshark):
    """Each packet is on a connection of its own, so that the function of a reply is not known from another one."""
    sent = []
    for number, vector in enumerate(VECTORS):
        place = ("127.0.0.1", 40000 + number)
        connection = CaptureConnection("tcp", place, ("127.0.0.1", 5007))
        sent.append((">" if vector["kind"] == "request" else "<", bytes.fromhex(vector["hex"]), connection))
    found = tshark.dissect(sent)
    assert found.experts == []
    assert len(found.packets) == len(VECTORS) == 75
    for vector, (_, data, _), shown, info in zip(VECTORS, sent, found.packets, found.infos, strict=True):
        check_vector(vector, data, shown)
        assert info == one_line(data)


def check_vector(vector, data: bytes, shown: Dissected) -> None:
    assert not shown.malformed
    assert shown.show("bcap.serial") == str(vector["serial"])
    assert shown.show("bcap.reserved") == str(vector["reserved"])
    assert shown.show("bcap.arguments") == str(len(vector["arguments"]))
    if vector["kind"] == "request":
        name = FUNCTIONS[vector["function_id"]].name
        assert shown.labels("bcap.function")[0].startswith(f"Function: {name} ({vector['function_id']})")
    else:
        assert int(shown.show("bcap.return_code"), 16) == vector["return_code"]
    assert len(shown.shows("bcap.crc")) == (vector["transport"] == "com")
    labels = shown.labels("bcap.argument")
    for label, given in zip(labels, vector["arguments"], strict=True):
        assert label.endswith(f"({given['type']})")
    assert values_of(shown) == [value for each in packet.decode(data, exact=True).arguments for value in flat(each)]
    assert shown.pieces(data) == pieces_of(data)


def pieces_of(data: bytes) -> list[tuple[int, bytes]]:
    return [(field.offset, field.raw) for field in explain(data) if field.raw]


def flat(value: Variant) -> list[object]:
    """Return the numbers and texts in a value, in order; dates as days, amounts as ten-thousandths."""
    items = value.value if value.type & ARRAY else [value.value]
    base = VarType(value.type & ~ARRAY)
    if base == VarType.VARIANT:
        return [number for each in items for number in flat(each)]
    if base in (VarType.EMPTY, VarType.NULL):
        return []
    if base == VarType.UI1 and value.type & ARRAY:
        return [bytes(items)] if items else []
    return [plain(base, item) for item in items]


def plain(base: VarType, item: object) -> object:
    if base == VarType.BOOL:
        return -1 if item else 0
    if base == VarType.CY:
        return int(item * 10_000)  # type: ignore[operator]  # a number here
    if base == VarType.R4:
        return float(f"{item:.6g}")  # type: ignore[str-format]  # a number here
    return item


PARSERS = {
    "integer": int,
    "decimal": int,
    "bool": int,
    "code": lambda text: int(text, 16),
    "str": str,
}


def values_of(shown: Dissected) -> list[object]:
    """Return the values that tshark shows, as numbers and texts."""
    rows = {f"bcap.value.{row.name[3:].lower()}": row for row in TABLE}
    found: list[object] = []
    for each in shown.fields:
        name, value = each.get("name", ""), each.get("show", "")
        raw = bytes.fromhex(each.get("value", ""))
        if name == "bcap.value.bytes":
            found.append(raw)
        elif name in rows:
            found.append(parsed(rows[name], value, raw))
        elif name == "bcap.string_length" and value == "0":
            found.append("")
    return found


def parsed(row: TypeRow, value: str, raw: bytes) -> object:
    if row.code == VarType.R4:
        assert float(value) == pytest.approx(struct.unpack("<f", raw)[0], rel=1e-5, nan_ok=True)
        return float(f"{struct.unpack('<f', raw)[0]:.6g}")
    if row.format == "d":
        assert float(value) == pytest.approx(struct.unpack("<d", raw)[0], rel=1e-12, nan_ok=True)
        return struct.unpack("<d", raw)[0]
    if row.code == VarType.BSTR:
        return raw.decode("utf-16-le", "surrogatepass")
    kind = row.number_kind or (row.python.__name__ if row.python else "")
    return PARSERS[kind](value)


# --- calls ------------------------------------------------------------------------------------------------------------


@needs_tshark
def test_requests_and_replies_are_matched(tshark):
    found = tshark.dissect([
        (">", request(7), TCP),
        ("<", reply(7, code=hresult.S_EXECUTING), TCP),
        (">", request(8, 21, 2), TCP),
        ("<", reply(7, 1.5), TCP),
        ("<", reply(8, code=hresult.E_HANDLE), TCP),
        ("<", reply(9), TCP),
    ])  # fmt: skip
    first, executing, second, answer, failure, unknown = found.packets
    assert found.infos == [
        "Variable_GetValue(3)",
        "Variable_GetValue: S_EXECUTING",
        "Controller_GetName(2)",
        "Variable_GetValue: S_OK -> 1.5",
        f"Controller_GetName: 0x80070006 E_HANDLE: {hresult.lookup(hresult.E_HANDLE).en}",
        "S_OK",
    ]
    assert (first.show("bcap.response_in"), first.show("bcap.executing_in")) == ("4", "2")
    assert second.show("bcap.response_in") == "5"
    assert [each.show("bcap.request_in") for each in (executing, answer, failure)] == ["1", "1", "3"]
    assert float(answer.show("bcap.time")) == pytest.approx(0.003)
    assert answer.labels("bcap.argument") == ["result: 1.5 (VT_R8)"]
    assert failure.shows("bcap.failed") != []
    assert unknown.shows("bcap.request_in") == unknown.shows("bcap.function") == []
    assert not any(each.malformed for each in found.packets)


@needs_tshark
def test_the_result_of_a_function_that_creates_an_object_is_a_handle(tshark):
    found = tshark.dissect([(">", request(1, 9, 2, "IO150", ""), UDP), ("<", reply(1, 3), UDP)])
    assert found.packets[0].labels("bcap.argument")[1] == 'name: "IO150" (VT_BSTR)'
    assert found.packets[1].labels("bcap.argument") == ["Variable handle: 3 (VT_I4)"]


@needs_tshark
def test_retries_refer_to_the_first_attempt(tshark):
    found = tshark.dissect([
        (">", request(7, reserved=7), UDP),
        (">", request(8, reserved=7), UDP),
        (">", request(9, reserved=7), UDP),
        ("<", reply(9, 5), UDP),
        ("<", reply(8, 5), UDP),
    ])  # fmt: skip
    first, second, third, answer, late = found.packets
    assert found.infos[:4] == [
        "Variable_GetValue(3)",
        "Retry of 7: Variable_GetValue(3)",
        "Retry of 7: Variable_GetValue(3)",
        "Variable_GetValue: S_OK -> 5",
    ]
    assert [each.shows("bcap.retry") != [] for each in found.packets] == [False, True, True, False, False]
    assert second.show("bcap.first_attempt_in") == third.show("bcap.first_attempt_in") == "1"
    assert first.shows("bcap.retry_in") == ["2", "3"]
    assert [each.show("bcap.response_in") for each in (first, second, third)] == ["4", "4", "4"]
    assert (answer.show("bcap.request_in"), late.show("bcap.request_in")) == ("3", "2")
    assert float(answer.show("bcap.time")) == pytest.approx(0.003)


@needs_tshark
def test_a_return_code_that_is_also_a_function_id_is_recognized_by_its_direction(tshark):
    data = reply(4, code=hresult.S_FALSE)
    found = tshark.dissect([(">", request(4), TCP), ("<", data, TCP), (">", packet.encode(Packet(5, 1)), TCP)])
    assert found.infos == ["Variable_GetValue(3)", "Variable_GetValue: S_FALSE", "Service_Start()"]


@needs_tshark
def test_japanese_texts(tshark):
    before = i18n.current()
    i18n.use("ja")
    try:
        tshark.script.write_text(lua("test", 5007), encoding="utf-8")
    finally:
        i18n.use(before)
    found = tshark.dissect([(">", request(1, 64, 3, "座標"), TCP), ("<", reply(1, code=hresult.E_HANDLE), TCP)])
    assert FUNCTIONS[64].ja in found.packets[0].labels("bcap.function")[0]
    assert found.infos == [
        'Robot_Execute(3, "座標")',
        f"Robot_Execute: 0x80070006 E_HANDLE: {hresult.lookup(hresult.E_HANDLE).ja}",
    ]


# --- streams and ports ------------------------------------------------------------------------------------------------


@needs_tshark
def test_segments_are_reassembled_and_coalesced_packets_separated(tshark):
    """The packets are cut at random positions, so that a segment contains parts of packets, or several packets."""
    rng = random.Random(SEED)
    values = [[float(number) for number in range(rng.choice((1, 3, 400)))] for _ in range(60)]
    stream = b"".join(request(serial, 64, 3, "slvMove", value) for serial, value in enumerate(values, 1))
    cuts = [0, *sorted(rng.sample(range(1, len(stream)), 150)), len(stream)]
    segments = [(">", stream[start:end], TCP) for start, end in pairwise(cuts)]
    large = request(61, 64, 3, "x" * 100_000)
    found = tshark.dissect([*segments, (">", large, TCP)])
    assert [each.show("bcap.serial") for each in found.packets] == [str(serial) for serial in range(1, 62)]
    assert not any(each.malformed for each in found.packets)
    assert found.experts == []
    two = tshark.dissect([(">", request(1) + request(2, 21, 2), TCP)])
    assert two.infos == ["Variable_GetValue(3); Controller_GetName(2)"]


@needs_tshark
def test_other_ports_are_recognized_by_content_or_by_preference(tshark):
    elsewhere = {name: CaptureConnection(name, ("::1", 40001), ("::1", 46001)) for name in ("tcp", "udp")}
    strange = bytes([1]) + bytes(20)
    sent = [(way, data, each) for each in elsewhere.values() for way, data in ((">", request(1)), ("<", reply(1, 2)))]
    sent += [(">", strange, elsewhere["udp"])]
    found = tshark.dissect(sent)
    assert [each.frame for each in found.packets] == [1, 2, 3, 4]
    assert found.infos[:4] == ["Variable_GetValue(3)", "Variable_GetValue: S_OK -> 2"] * 2
    found = tshark.dissect(sent, "-o", "bcap.ports:46000-46002")
    assert [each.frame for each in found.packets] == [1, 2, 3, 4, 5]
    found = tshark.dissect(sent, "--disable-heuristic", "bcap_tcp", "--disable-heuristic", "bcap_udp")
    assert found.packets == []
    found = tshark.dissect(
        sent, "--disable-heuristic", "bcap_tcp", "--disable-heuristic", "bcap_udp", "-d", "tcp.port==46001,bcap"
    )
    assert [each.frame for each in found.packets] == [1, 2]


@needs_tshark
def test_a_vt_error_of_two_bytes_by_preference(tshark):
    argument = codec.encode_variant(Variant(VarType.ERROR, 0x1234), 2)
    data = packet.pack(1, 102, 1, argument)
    assert tshark.dissect([(">", data, TCP)]).packets[0].malformed
    (shown,) = tshark.dissect([(">", data, TCP)], "-o", "bcap.short_errors:TRUE").packets
    assert not shown.malformed
    assert int(shown.show("bcap.value.error"), 16) == 0x1234


# --- random packets ---------------------------------------------------------------------------------------------------


def random_content(row: TypeRow, rng: random.Random) -> object:
    if row.bounds is not None:
        return rng.choice([*row.bounds, 0, 1, rng.randint(*row.bounds)])
    numbers = [
        0.0,
        -0.0,
        math.inf,
        math.nan,
        -1.5,
        rng.uniform(-1e6, 1e6),
        rng.uniform(-1, 1) * 10 ** rng.randint(-30, 30),
    ]
    if row.code == VarType.R4:
        return struct.unpack("<f", struct.pack("<f", rng.choice(numbers)))[0]
    if row.code == VarType.R8:
        return rng.choice([*numbers, 1e300])
    if row.code == VarType.CY:
        return Decimal(rng.choice([0, -1, 12345, rng.randint(-(2**63), 2**63 - 1)])).scaleb(-4)
    if row.code == VarType.DATE:
        moment = datetime(1899, 12, 30) + timedelta(
            days=rng.randint(-600_000, 2_900_000), seconds=rng.randint(0, 86399)
        )
        return ole_datetime(ole_days(moment))
    if row.code == VarType.BSTR:
        return rng.choice(["", "P1", "座標(基準)", "\x00\x07", "\U0001f916", "a" * 200, '"', "é" * 90])
    return rng.random() < 0.5


def random_variant(rng: random.Random, depth: int = 0) -> Variant:
    row = rng.choice(TABLE)
    if row.code == VarType.VARIANT:
        count = rng.randint(0, 3) if depth < 5 else 0
        return Variant(VARIANT_ARRAY, [random_variant(rng, depth + 1) for _ in range(count)])
    if row.empty:
        return Variant(row.code)
    if rng.random() < 0.5:
        return Variant(row.code, random_content(row, rng))
    return Variant(ARRAY | row.code, [random_content(row, rng) for _ in range(rng.randint(0, 12))])


def random_packet(rng: random.Random, serial: int) -> bytes:
    code = rng.choice([*FUNCTIONS, *hresult.CODES, 200, 0x80001234])
    values = [random_variant(rng) for _ in range(rng.randint(0, 4))]
    trailer = rng.choice([b"", b"", b"", b"reserved"])
    return packet.encode(Packet(serial, code, values, rng.choice([0, 0, serial, 7]), trailer), crc=rng.random() < 0.3)


@needs_tshark
def test_random_packets_are_dissected_as_by_explain(tshark):
    rng = random.Random(SEED)
    sent = [(">", random_packet(rng, serial), UDP) for serial in range(1, 600)]
    found = tshark.dissect(sent)
    assert len(found.packets) == len(sent)
    for (_, data, _), shown in zip(sent, found.packets, strict=True):
        assert first_error(explain(data)) is None
        assert not shown.malformed, data.hex()
        assert shown.pieces(data) == pieces_of(data)
        _, _, serial, reserved, code, count = packet.HEADER.unpack_from(data)
        assert shown.show("bcap.serial") == str(serial)
        assert shown.show("bcap.reserved") == str(reserved)
        assert shown.show("bcap.arguments") == str(count)
        is_request = dissect.kind_of(code) == "request"
        assert shown.shows("bcap.function")[: int(is_request)] == [str(code)] * is_request
        crc = any(field.name == "CRC" for field in explain(data))
        assert len(shown.shows("bcap.crc")) == crc
        arguments = packet.decode(data, exact=True, crc=crc).arguments
        assert [label.rpartition("(")[2] for label in shown.labels("bcap.argument")] == [
            f"{type_name(each.type)})" for each in arguments
        ]
        given = [value for each in arguments for value in flat(each)]
        assert [repr(value) for value in values_of(shown)] == [repr(as_days(value)) for value in given]


def as_days(value: object) -> object:
    return ole_days(value) if isinstance(value, datetime) else value


@needs_tshark
def test_dates_and_amounts_as_text(tshark):
    rng = random.Random(SEED)
    rows = {row.code: row for row in TABLE}
    moments = [random_content(rows[VarType.DATE], rng) for _ in range(200)]
    amounts = [random_content(rows[VarType.CY], rng) for _ in range(50)]
    numbers = [0.1, 1 / 3, 1e16, 1e22, 1e-300, -1.0, 123456789.123]
    found = tshark.dissect([(">", request(1, 102, 3, value), UDP) for value in (*moments, *amounts, *numbers)])
    labels = [each.labels("bcap.argument")[1] for each in found.packets]
    assert labels == [
        *(f"value: {moment.isoformat(' ')} (VT_DATE)" for moment in moments),
        *(f"value: {Decimal(amount):.4f} (VT_CY)" for amount in amounts),
        *(f"value: {number!r} (VT_R8)" for number in numbers),
    ]


# --- malformed packets ------------------------------------------------------------------------------------------------


def broken(data: bytes, rng: random.Random) -> bytes:
    """Return a packet with a random error: cut, extended, or with other bytes, often in a length or a count."""
    result = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(result))
        match rng.randrange(5):
            case 0:
                del result[max(at, 1) :]
            case 1:
                result[at] = rng.randrange(256)
            case 2:
                result[at : at + 4] = struct.pack("<I", rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x10000, 17]))
            case 3:
                result[at:at] = rng.randbytes(rng.randint(1, 20))
            case 4:
                del result[at : at + rng.randint(1, 8)]
        if not result:
            return b"\x01"
    return bytes(result)


@needs_tshark
def test_malformed_packets_are_marked_without_an_error_of_the_dissector(tshark):
    rng = random.Random(SEED)
    sent = [(">", broken(random_packet(rng, serial), rng), UDP) for serial in range(1, 700)]
    found = tshark.dissect(sent)
    assert len(found.packets) == len(sent)
    marked = [shown.malformed for shown in found.packets]
    assert marked == [first_error(explain(data)) is not None for _, data, _ in sent]
    assert 100 < sum(marked) < len(sent)


@needs_tshark
def test_garbage_in_a_stream_is_marked_and_the_next_segment_is_dissected(tshark):
    rng = random.Random(SEED)
    sent = []
    for number in range(60):
        connection = CaptureConnection("tcp", ("127.0.0.1", 20000 + number), ("127.0.0.1", 5007))
        data = b"".join(broken(random_packet(rng, serial), rng) for serial in range(1, 4))
        sent += [(">", data[at : at + 200], connection) for at in range(0, len(data), 200)]
    tshark.dissect(sent)
    found = tshark.dissect([(">", request(1) + b"GET / HTTP/1.1", TCP), (">", request(2), TCP)])
    assert [each.malformed for each in found.packets] == [False, True, False]
    assert found.infos == ["Variable_GetValue(3); not a packet", "Variable_GetValue(3)"]


@needs_tshark
def test_packets_that_the_capture_has_cut_off(tshark):
    """Each packet of the capture contains its first 90 bytes only, as with the option -s of tcpdump."""
    connections = [CaptureConnection(TCP.transport, ("127.0.0.1", port), TCP.remote) for port in range(20000, 20100)]
    rng = random.Random(SEED)
    stream = [(">", request(1) + request(2) + request(3, 102, 3, "x" * 50_000), TCP), (">", request(4), TCP)]
    other = [(">", random_packet(rng, 1) + random_packet(rng, 2), each) for each in (*connections, UDP)]
    tshark.dissect([*stream, *other])
    cut = tshark.directory / "cut.pcapng"
    subprocess.run(["editcap", "-s", "90", str(tshark.directory / "capture.pcapng"), str(cut)], check=True)
    found = Result(tshark, cut, ())
    assert [each.frame for each in found.packets][:3] == [1, 1, 2]
    assert [bool(each.shows("bcap.cut")) for each in found.packets[:3]] == [False, True, False]
    assert found.infos[0] == "Variable_GetValue(3); Variable_GetValue(?)"
    whole = Result(tshark, cut, ("-o", "tcp.desegment_tcp_streams:FALSE"))
    assert len(whole.frames) == len(found.frames)


@needs_tshark
def test_limits_of_nesting_and_of_elements(tshark):
    deep = Variant(VarType.I4, 1)
    for _ in range(DEFAULT_LIMITS.depth):
        deep = Variant(VARIANT_ARRAY, [deep])
    too_deep = struct.pack("<HI", VARIANT_ARRAY, 1) * (DEFAULT_LIMITS.depth + 1) + struct.pack("<HIi", 3, 1, 1)
    wide = struct.pack("<HI", VARIANT_ARRAY, 60_000) + struct.pack("<HI", 0, 1) * 60_000
    raw = [struct.pack("<I", len(value)) + value for value in (too_deep, wide)]
    long = [float(number) for number in range(5000)]
    found = tshark.dissect([
        (">", request(1, 102, 3, deep), TCP),
        *((">", packet.pack(2 + number, 102, 1, value), TCP) for number, value in enumerate(raw)),
        (">", request(4, 102, 3, long), TCP),
    ])  # fmt: skip
    assert [each.malformed for each in found.packets] == [False, True, True, False]
    assert found.packets[3].labels("bcap.array")[-1] == "4000 more elements"
