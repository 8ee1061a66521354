"""decode: packets in any spelling of hex."""

from __future__ import annotations

import io
import json
import sys

import pytest

from orinkit.cli.commands.decode import read_hex
from orinkit.core import i18n
from support import paths

VECTORS = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
START = "01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04"
FRAME = bytes.fromhex(START)
READ = "01 1e 00 00 00 04 00 00 00 65 00 00 00 01 00 0a 00 00 00 03 00 01 00 00 00 03 00 00 00 04"

XXD = """\
00000000: 0110 0000 0001 0000 0001 0000 0000 0004  ................
00000010: 0110                                     ..
"""
HEXDUMP = """\
00000000  01 10 00 00 00 01 00 00  00 01 00 00 00 00 00 04  |.... abcd......4|
00000010
"""
WIRESHARK = """\
0000   01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04   .....ab cd ef...
"""


@pytest.mark.parametrize(
    "text",
    [
        START,
        START.replace(" ", ""),
        START.upper(),
        START.replace(" ", ", "),
        START.replace(" ", ":"),
        START.replace(" ", "\n"),
        "{ " + ", ".join(f"0x{byte:02X}" for byte in FRAME) + " };",
        ",".join(f"0x{byte:x}" for byte in FRAME),
        "".join(f"\\x{byte:02x}" for byte in FRAME),
        "0x" + FRAME.hex(),
        " ".join(f"{byte:x}" for byte in FRAME),
        repr(FRAME.hex(" ", 4)),
        "01100000  00010000  00010000  00000004",
        HEXDUMP.rsplit("\n", 2)[0],
        WIRESHARK,
        XXD.splitlines()[0],
    ],
)
def test_any_spelling_of_hex_is_read(text):
    assert read_hex(text) == FRAME


def test_a_dump_of_several_lines():
    assert read_hex(XXD) == FRAME + b"\x01\x10"


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: f"{vector['document'][:11]}:{vector['line']}")
def test_every_packet_of_the_documents(run, vector):
    done = run("decode", vector["hex"], "--json")
    assert (done.code, done.err) == (0, "")
    (packet,) = done.json["packets"]
    assert packet["bytes"] == vector["hex"].lower()
    assert "".join(field["bytes"] for field in packet["fields"]) == packet["bytes"]
    assert not packet["wrong"]


def test_the_text_output(run):
    done = run("decode", *READ.split())
    assert done.code == 0
    lines = done.out.splitlines()
    assert lines[0] == "Variable_GetValue(3)"
    assert lines[5].startswith("    9   function id  ")
    assert "  65 00 00 00              101 Variable_GetValue: " in lines[5]
    assert lines[-1].split() == ["29", "end", "(EOT)", "04"]


def test_several_packets_in_a_row_with_their_requests(run):
    asked = next(vector["hex"] for vector in VECTORS if vector["function_id"] == 9)
    answered = next(v["hex"] for v in VECTORS if v["function_id"] == 9 and v["kind"] == "response")
    packets = run("decode", asked + answered, READ, "--json").json["packets"]
    assert [packet["meaning"] for packet in packets] == [
        'Controller_GetVariable(2, "IO150", "")',
        "S_OK -> 3",
        "Variable_GetValue(3)",
    ]
    assert "Variable handle" in [field["name"] for field in packets[1]["fields"]]


def test_packets_from_stdin(run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(HEXDUMP.rsplit("\n", 2)[0]))
    assert run("decode", "-").out.startswith("Service_Start()\n")


def test_a_wrong_packet_is_explained_and_fails(run):
    done = run("decode", START.replace("10", "11", 1))
    assert done.code == 1
    assert "   1 ! length" in done.out
    assert (
        done.err
        == "orinkit: 1 of 1 packets malformed; first error at offset 1: 17 bytes, but the packet has 16 bytes\n"
    )
    assert run("decode", "ff", "--json").json["packets"][0]["fields"] == [
        {
            "offset": 0,
            "bytes": "ff",
            "name": "not a packet",
            "meaning": "a packet must begin with SOH 01",
            "level": 0,
            "error": True,
        }
    ]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["0x01", "zz"], "'zz' is not hex"),
        (["011"], "'011' has an odd number of hex digits (3)"),
        ([""], "no packet given. Try: the bytes of a packet in hex, or - for stdin"),
        ([], "HEX is missing (see orinkit decode --help)"),
        (["g" * 100], f"'{'g' * 20}...' is not hex"),
    ],
)
def test_invalid_hex(refused, words, message):
    assert refused("decode", *words, code=2) == message


def test_in_japanese(run):
    i18n.use("ja")
    out = run("decode", START).out
    assert "関数 ID" in out
    assert "この接続のサービスを開始する。" in out
