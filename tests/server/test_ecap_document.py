"""Requests of curl and plain HTTP clients, and the exact replies: those of docs/howto/ecap.md and of e-CAP 3.5."""

from __future__ import annotations

import http.client
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator

import pytest

import orinkit
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import VirtualRC8
from support.devices import Workshop
from support.ecap_bodies import EXAMPLES
from support.paths import ROOT

ROW = re.compile(r"^\| `(Func|func|Arg1)(.*?)` \| `(0x.*?)` \| .* \|$", re.MULTILINE)
CURL = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")


def documented() -> list[tuple[str, str]]:
    """Return the requests in docs/howto/ecap.md and their replies, in order."""
    page = (ROOT / "docs/howto/ecap.md").read_text(encoding="utf-8")
    return [(name + rest, reply) for name, rest, reply in ROW.findall(page)]


@pytest.fixture
def url() -> Iterator[str]:
    rc8 = VirtualRC8(clock=Clock(10.0))
    with orinkit.serve([rc8, Workshop()], "http://127.0.0.1:0") as server:
        yield server.url
    rc8.close()


def by_http_client(url: str, body: str) -> str:
    connection = http.client.HTTPConnection(url.partition("//")[2], timeout=20)
    connection.request("POST", "/", body.encode(), {"Content-Type": "application/x-www-form-urlencoded"})
    reply = connection.getresponse()
    text = reply.read().decode()
    connection.close()
    assert reply.status == 200
    return text


def by_curl(url: str, body: str) -> str:
    done = subprocess.run(
        ["curl", "-sS", "--data-binary", body, f"{url}/any/path"], capture_output=True, check=True, timeout=60
    )
    return done.stdout.decode()


@pytest.mark.parametrize("send", [by_http_client, pytest.param(by_curl, marks=CURL)])
def test_the_requests_of_the_page(url: str, send: Callable[[str, str], str]) -> None:
    rows = documented()
    assert len(rows) >= 30
    for body, reply in rows:
        assert (body, send(url, body)) == (body, reply)


def test_the_examples_of_the_document_both_ways(url: str) -> None:
    """Echo returns each value as it was written; VT_VARIANT around a single value is that value."""
    by_http_client(url, "Func=1")
    handle = by_http_client(url, "Func=3,Arg1=,Arg2=Test.Workshop,Arg3=,Arg4=").rpartition(",")[2]
    for text, _ in EXAMPLES:
        echoed = by_http_client(url, f"Func=17,Arg1={handle},Arg2=Echo,Arg3={text}")
        assert echoed == f"0x00000000,{text.removeprefix('12,(').rstrip(')') if text.startswith('12,') else text}"


@CURL
@pytest.mark.parametrize("name", ["ecap-list-3-1.sh", "ecap-list-3-3.sh"])
@pytest.mark.parametrize("token", ["", "secret-7"])
def test_the_lists_of_the_rc8_document_by_curl_alone(name: str, token: str) -> None:
    rc8 = VirtualRC8(clock=Clock(10.0))
    options = orinkit.HttpOptions(token=token)
    with orinkit.serve(rc8, "http://127.0.0.1:0", http=options) as server:
        done = subprocess.run(
            ["sh", str(ROOT / "examples" / name), server.url], capture_output=True, text=True, timeout=60, check=False,
            env={**os.environ, "ORINKIT_TOKEN": token},
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
        lines = done.stdout.splitlines()
        assert all(" -> 0x00000000" in line for line in lines)
        assert lines[0].startswith("Func=1")
        assert lines[-1] == "Func=2 -> 0x00000000"
        if "3-3" in name:
            (pose,) = [line for line in lines if "CurPos" in line]
            numbers = [float(part) for part in pose.rpartition("8197,")[2].split(",")]
            assert numbers == pytest.approx([330, 180, 320, 180, 0, 180, 5], abs=0.05)
        assert server.clients == 0
    rc8.close()


@CURL
def test_a_list_that_fails_reports_it() -> None:
    with orinkit.serve(Workshop(), "http://127.0.0.1:0") as server:
        done = subprocess.run(
            ["sh", str(ROOT / "examples/ecap-list-3-1.sh"), server.url], capture_output=True, text=True, timeout=60, check=False
        )  # fmt: skip
        assert done.returncode == 1
        assert done.stdout.splitlines()[-1].endswith("0x80000201")
