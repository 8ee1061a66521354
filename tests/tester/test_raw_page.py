"""The page Raw packets: the procedures of RC8 5.2 and 5.3, invalid text, all roles, and when the connection is closed."""

from __future__ import annotations

import json
import re
import socket
import time
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.dissect import split
from orinkit.cao import functions as f
from orinkit.raw.hex_text import hex_text
from orinkit.raw.packets import assemble, assemble_reply
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.ve026a import VirtualVE026A
from support import paths
from support.browser import TesterProcess, needs_browser, user
from support.objects_page import choose_type, expect, fill
from support.peers import RawClient
from support.received import ReceivedPackets, received_packets
from support.recording_relay import Relay
from support.waiting import PATIENCE, until

pytestmark = needs_browser

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))
START = "01 10 00 00 00 01 00 00 00 01 00 00 00 00 00 04"
OPENING = [
    ("Service_Start", []),
    ("Controller_Connect", ["", "CaoProv.DENSO.VRC", "localhost", ""]),
    ("Controller_GetRobot", ["2", "Arm", ""]),
    ("Robot_Execute", ["3", "TakeArm", "8195,0,1"]),
]


def printed(line: int, document: str = "bcap-rc8.ja.txt") -> bytes:
    """Return the packet that a document prints at a line."""
    (found,) = [each for each in PRINTED if each["document"] == document and each["line"] == line]
    return bytes.fromhex(found["hex"])


SESSION = [printed(line) for line in (236, 251, 270, 291, 305, 324, 338, 354)]
"""The requests of a session, from Service_Start to Service_Stop."""


@pytest.fixture
def received() -> Iterator[ReceivedPackets]:
    with received_packets() as recorded:
        yield recorded


@pytest.fixture(scope="module")
def person(browser: Any) -> Iterator[Any]:
    """The browser of one user for all tests, because only one user can hold the controls."""
    with user(browser) as opened:
        yield opened.context


@pytest.fixture
def page(person: Any, bench: Any) -> Iterator[Any]:
    opened = person.new_page()
    yield opened
    opened.close()


def open_page(page: Any, url: str, parameters: str = "") -> Any:
    """Open the page; with parameters, connect."""
    page.goto(f"{url}/raw")
    page.get_by_test_id("raw-text").wait_for()
    if parameters:
        fill(page, "raw-parameters", parameters)
        page.get_by_test_id("raw-connect").click()
        expect(page.get_by_test_id("raw-disconnect")).to_be_enabled()
    return page


def eth(url: str, role: int = 0, timeout: int = int(PATIENCE * 1000)) -> str:
    """Return a parameter string."""
    place = url.partition("://")[2]
    return f"Conn=eth:{place}, Timeout={timeout}, PacketOpt=0:0:0, EtherOpt={role}:0, Sync=True"


def write(page: Any, *packets: bytes | str) -> None:
    """Enter packets, separated by blank lines."""
    texts = [each if isinstance(each, str) else hex_text(each) for each in packets]
    fill(page, "raw-text", "\n\n".join(texts))


def send(page: Any, *packets: bytes | str) -> None:
    """Enter packets and press Send."""
    write(page, *packets)
    page.get_by_test_id("raw-send").click()


def shown_bytes(page: Any, marker: str) -> bytes:
    return bytes.fromhex(" ".join(page.locator(f'[data-testid="{marker}"] .ok-byte[data-byte]').all_text_contents()))


def counter(page: Any, name: str, value: int) -> None:
    expect(page.get_by_test_id(f"raw-{name}")).to_have_text(f"{value:,}")


def expect_replies(page: Any, count: int) -> None:
    """Wait until a number of packets has been sent, each with a reply; S_EXECUTING may have arrived, too."""
    expect(page.get_by_test_id("raw-progress")).to_contain_text(f"{count} sent · {count} replies")


def opening(*further: tuple[str, list[str]]) -> list[bytes]:
    """Return the packets that take the arm, and further ones."""
    return [assemble(name, values, serial) for serial, (name, values) in enumerate([*OPENING, *further], 1)]


# --- the procedures of the document -----------------------------------------------------------------------------------


def test_rc8_5_2_raw_packet_mode(page: Any, bench: Any) -> None:
    open_page(page, bench.tester.url)
    place = bench.server.url.partition("://")[2]  # of the selected connection
    expect(page.get_by_test_id("raw-place")).to_have_value(place)
    with Relay(int(place.rpartition(":")[2])) as relay:
        place = relay.url.partition("://")[2]
        fill(
            page, "raw-parameters", f"Conn=eth:{place}, Timeout=30000, PacketOpt=0:0:0, EtherOpt=0:0, Sync=True"
        )  # 5.2.1
        page.get_by_test_id("raw-connect").click()
        expect(page.get_by_test_id("raw-state")).to_have_text(f"connected to {relay.url}")
        write(page, *SESSION)  # 5.2.2: several packets
        expect(page.get_by_test_id("raw-status")).to_contain_text("8 packets")
        page.get_by_test_id("raw-send").click()
        expect_replies(page, len(SESSION))
        ((sent, _),) = relay.streams
        assert split(bytes(sent)) == SESSION
        expect(page.get_by_test_id("raw-reply")).to_have_text("S_OK")  # the reply to the last packet
        assert shown_bytes(page, "raw-rx-bytes") == bytes.fromhex("01100000000800000000000000000004")
        write(page, printed(216))
        fill(page, "raw-count", "20")
        page.get_by_test_id("raw-loop").click()
        expect(page.get_by_test_id("raw-progress")).to_contain_text("20 of 20 · 20 sent · 20 replies")
        assert split(bytes(sent)) == SESSION + 20 * [printed(216)]
        fill(page, "raw-count", "1000000")
        page.get_by_test_id("raw-loop").click()
        until(lambda: split(bytes(sent)).count(printed(216)) > 25)
        page.get_by_test_id("raw-stop").click()
        expect(page.get_by_test_id("raw-progress")).to_contain_text("stopped: ")  # on a stalling machine perhaps before
        size = len(sent)
        page.get_by_test_id("raw-disconnect").click()
        expect(page.get_by_test_id("raw-state")).to_have_text("not connected")
        assert len(sent) == size  # it has not begun again


def test_invalid_text_is_reported_at_its_place_and_not_sent(page: Any, bench: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        open_page(page, bench.tester.url, eth(f"tcp://127.0.0.1:{listener.getsockname()[1]}", timeout=200))
        line, _ = listener.accept()
    problems, error = page.get_by_test_id("raw-problems"), page.get_by_test_id("error-raw-send")
    for text, problem, refusal in (
        (f"{START}\n\n01 1z", "line 3, column 4", "packet 2: '1z' is not hex"),
        (START.replace("10", "12", 1), "the length is 18, but 16 bytes are present", "Send as it is"),
        ("02" + START[2:], "a packet must begin with SOH 01, not 02", "Send as it is"),
        (START[:-2] + "05", "a packet must end with EOT 04, not 05", "Send as it is"),
        ("", "", "no packet given"),
    ):
        send(page, text)
        expect(problems).to_contain_text(problem)
        expect(error).to_contain_text(refusal)
    page.get_by_test_id("raw-text").focus()
    page.keyboard.insert_text("01 " * 3_500_000)  # 10 MB, pasted
    expect(page.get_by_test_id("raw-status")).to_contain_text("exceeds 300,000 characters")
    page.get_by_test_id("raw-send").click()
    expect(error).to_contain_text("exceeds 300,000 characters")
    counter(page, "sent", 0)
    with line:
        line.settimeout(PATIENCE)
        write(page, START)
        expect(page.get_by_test_id("raw-packet-1")).to_contain_text("Service_Start()")
        page.get_by_test_id("raw-send").click()
        assert line.recv(1000) == bytes.fromhex(START)  # the first bytes that have arrived
        expect(error).to_contain_text("1 of 1 packets have no reply within 0.2 s")
        page.get_by_test_id("raw-as-is").click()
        send(page, "01 02 03")  # on purpose
        assert line.recv(1000) == b"\1\2\3"
        counter(page, "sent", 2)
        line.sendall(assemble_reply(0, [7], 1))
        expect(page.get_by_test_id("raw-reply")).to_have_text("S_OK -> 7")


def test_a_tcp_server_shows_what_clients_send_and_sends_to_them(page: Any, bench: Any) -> None:
    open_page(page, bench.tester.url)
    page.get_by_test_id("raw-role").click()
    page.get_by_role("option", name="TCP server").click()
    expect(page.get_by_test_id("raw-parameters")).to_have_value(re.compile("EtherOpt=1:5"))
    fill(page, "raw-place", "127.0.0.1:0")
    fill(page, "raw-clients", "2")
    page.get_by_test_id("raw-connect").click()
    state = page.get_by_test_id("raw-state")
    expect(state).to_contain_text("no client")
    url = re.search(r"tcp://127\.0\.0\.1:\d+", state.inner_text())[0]
    with RawClient(url) as first, RawClient(url) as second:
        expect(state).to_contain_text("2 clients")
        first.send(bytes.fromhex(START))
        expect(page.get_by_test_id("raw-reply")).to_have_text("Service_Start()")
        answer = assemble_reply(0, [7], 1)
        send(page, answer)
        assert (first.frame(), second.frame()) == (answer, answer)
        page.get_by_test_id("raw-peer").click()
        page.get_by_role("option", name=f"127.0.0.1:{second.socket.getsockname()[1]}").click()
        send(page, assemble_reply(0, [8], 1))
        assert second.frame() == assemble_reply(0, [8], 1)
        with RawClient(url) as third:
            assert third.ended()  # ConnMax
        counter(page, "sent", 3)
    expect(state).to_contain_text("no client")


@pytest.mark.soak
def test_rc8_5_3_a_pose_as_an_array_of_variants(page: Any, bench: Any, received: ReceivedPackets) -> None:
    open_page(page, bench.tester.url, eth(bench.server.url))
    send(page, *opening()[:3])  # the arm is not taken, because the pose cannot be reached
    expect_replies(page, 3)
    fill(page, "raw-text", "")
    page.get_by_test_id("raw-function").fill("Robot_Move")
    page.get_by_role("option", name="72 Robot_Move").click()
    fill(page, "raw-serial", "5")
    fill(page, "argument-handle", "3")
    fill(page, "argument-interpolation", "1")
    choose_type(page, "argument-pose", "ARRAY | VARIANT")
    fill(page, "argument-pose", "(8197, 0, 0, 0, 0, 0, 0, 5),(3, 0),(3, -2")
    expect(page.get_by_test_id("raw-assembler")).to_contain_text("expected")
    page.get_by_test_id("raw-append").click()
    expect(page.get_by_test_id("raw-text")).to_have_value("")  # nothing was appended
    fill(page, "argument-pose", "(8197, 0, 0, 0, 0, 0, 0, 5),(3, 0),(3, -2)")
    expect(page.get_by_test_id("argument-pose-description")).to_have_text("VT_VARIANT|VT_ARRAY, 3 elements")
    page.get_by_test_id("raw-append").click()
    expect(page.get_by_test_id("raw-packet-1")).to_contain_text("Robot_Move(3, 1, ")
    expect(page.get_by_test_id("raw-serial")).to_have_value("6")
    page.get_by_test_id("raw-send").click()
    expect_replies(page, 1)
    _handle, interpolation, pose, _option = received.wait_for(f.robot_move).arguments
    assert interpolation == Variant(VarType.I4, 1)
    assert pose == Variant(
        VARIANT_ARRAY,
        [Variant(VarType.R8 | ARRAY, [0, 0, 0, 0, 0, 0, 5]), Variant(VarType.I4, 0), Variant(VarType.I4, -2)],
    )
    page.get_by_test_id("raw-append").click()  # further packets follow, separated by blank lines
    expect(page.get_by_test_id("raw-status")).to_contain_text("2 packets")


# --- transports -------------------------------------------------------------------------------------------------------


@pytest.mark.soak
def test_a_udp_client(page: Any, bench: Any, received: ReceivedPackets) -> None:
    with orinkit.serve(VirtualRC8(), "udp://127.0.0.1:0") as server:
        open_page(page, bench.tester.url, eth(server.url, 2))
        expect(page.get_by_test_id("raw-profile").locator("xpath=ancestor::label")).to_contain_text("UDP")
        page.get_by_test_id("raw-append").click()  # Service_Start
        page.get_by_test_id("raw-send").click()
        expect(page.get_by_test_id("raw-reply")).to_have_text("S_OK")
        assert received.wait_for(f.service_start).reserved == 1
        write(page, assemble("Controller_Execute", ["1", "Do", "8," + "x" * 400]))
        expect(page.get_by_test_id("raw-problems")).to_contain_text("exceeds the limit of 503 bytes over udp")
        page.get_by_test_id("raw-disconnect").click()


@pytest.mark.soak
def test_a_udp_server(page: Any, bench: Any) -> None:
    open_page(page, bench.tester.url, "Conn=eth:127.0.0.1:0, EtherOpt=3")
    state = page.get_by_test_id("raw-state")
    expect(state).to_contain_text("listening on udp://")
    port = int(re.search(r"127\.0\.0\.1:(\d+)", state.inner_text())[1])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(PATIENCE)
        client.connect(("127.0.0.1", port))
        client.send(bytes.fromhex(START))
        expect(page.get_by_test_id("raw-reply")).to_have_text("Service_Start()")
        expect(state).to_contain_text("1 client")
        expect(page.get_by_test_id("raw-kind").get_by_role("button", name="Reply")).to_have_attribute(
            "aria-pressed", "true"
        )
        page.get_by_test_id("raw-with-value").click()
        fill(page, "raw-value", "7")
        fill(page, "raw-code", "0x80004001")
        page.get_by_test_id("raw-append").click()
        page.get_by_test_id("raw-send").click()
        got = packet.decode(client.recv(1000))
        assert (got.serial, got.code, got.arguments) == (1, 0x80004001, [7])


@pytest.mark.soak
def test_a_ve026a_on_a_serial_line_with_crc(page: Any, bench: Any, received: ReceivedPackets) -> None:
    arm = VirtualVE026A()
    start = printed(328, "bcap-ve026a.en.txt")
    with orinkit.serve(arm, "pty://") as server:
        open_page(page, bench.tester.url)
        page.get_by_test_id("raw-role").click()
        page.get_by_role("option", name="Serial line").click()
        fill(page, "raw-place", server.url)
        page.get_by_test_id("raw-connect").click()
        expect(page.get_by_test_id("raw-state")).to_contain_text("connected to serial:")
        write(page, start[:-3] + bytes([start[-3] ^ 1]) + start[-2:])
        expect(page.get_by_test_id("raw-problems")).to_contain_text("the CRC is wrong; the correct value is ba b3")
        page.get_by_test_id("raw-send").click()
        expect(page.get_by_test_id("error-raw-send")).to_contain_text("Send as it is")
        send(page, start)
        expect(page.get_by_test_id("raw-reply")).to_have_text("S_OK")
        assert shown_bytes(page, "raw-rx-bytes") == printed(333, "bcap-ve026a.en.txt")
        assert [data for data, crc in received.raw if crc] == [start]
        page.get_by_test_id("raw-disconnect").click()
        expect(page.get_by_test_id("raw-state")).to_have_text("not connected")
    arm.close()


# --- parameters -------------------------------------------------------------------------------------------------------


@pytest.mark.soak
def test_the_string_and_the_fields_stay_in_step(page: Any, bench: Any) -> None:
    open_page(page, bench.tester.url)
    text, place = page.get_by_test_id("raw-parameters"), page.get_by_test_id("raw-place")
    fill(page, "raw-parameters", "Conn=eth:192.168.0.9:5009, Timeout=800, EtherOpt=2:0, Sync=False")
    expect(place).to_have_value("192.168.0.9:5009")
    expect(page.get_by_test_id("raw-timeout")).to_have_value("800")
    expect(page.get_by_test_id("raw-sync")).to_have_attribute("aria-checked", "false")
    expect(page.get_by_test_id("raw-role").locator("xpath=ancestor::label")).to_contain_text("UDP client")
    fill(page, "raw-timeout", "900")
    page.get_by_test_id("raw-sync").click()
    expect(text).to_have_value("Conn=eth:192.168.0.9:5009, Timeout=900, PacketOpt=0:0:0, EtherOpt=2:0, Sync=True")
    card = page.get_by_test_id("raw-connection")
    for marker, value, problem in (
        ("raw-timeout", "soon", "Timeout cannot be 'soon'"),
        ("raw-packet-opt", "32:0:0", "the mode b-CAP (32) does not apply here"),
        ("raw-place", "192.168.0.9:99999", "99999"),
        ("raw-parameters", "Conn=eth:192.168.0.9, Speed=1", "unknown parameter 'speed'"),
        ("raw-parameters", "Conn=eth:0.0.0.0:5008, EtherOpt=1:0", "0.0.0.0 is not a loopback address"),
    ):
        before = page.get_by_test_id(marker).input_value()
        fill(page, marker, value)
        expect(card).to_contain_text(problem)
        page.get_by_test_id("raw-connect").click()
        expect(page.get_by_test_id("error-raw-connection")).to_contain_text(problem)
        expect(page.get_by_test_id("raw-state")).to_have_text("not connected")
        fill(page, marker, before)
        expect(card.locator(".q-field--error")).to_have_count(0)


@pytest.mark.soak
def test_another_user_cannot_connect_or_send(browser: Any, page: Any, bench: Any, received: ReceivedPackets) -> None:
    first = open_page(page, bench.tester.url, eth(bench.server.url))
    with user(browser, language="ja") as second:
        open_page(second, bench.tester.url)
        second.get_by_test_id("raw-connect").click()
        expect(second.get_by_test_id("error-raw-connection")).to_contain_text("操作権")
        expect(second.get_by_test_id("raw-send")).to_be_disabled()
        first.get_by_role("button", name="Give up").click()  # the connection is closed
        expect(first.get_by_test_id("raw-state")).to_contain_text("the controls were given up")
        second.get_by_test_id("raw-connect").click()
        expect(second.get_by_test_id("raw-disconnect")).to_be_enabled()
        first.get_by_test_id("raw-connect").click()
        expect(first.get_by_test_id("error-raw-connection")).to_contain_text("another user holds the controls")
        write(second, "0" * 5001)  # long texts are checked in a thread, in the language of the page
        expect(second.get_by_test_id("raw-problems")).to_contain_text("奇数")
        second.locator(".ok-controls button").click()  # gives up
        expect(second.get_by_test_id("raw-connect")).to_be_enabled()
    assert not received.of(f.service_start)


# --- the end of the connection ----------------------------------------------------------------------------------------


def move(page: Any, bench: Any) -> Any:
    """Start a motion that does not wait with a raw packet."""
    open_page(page, bench.tester.url, eth(bench.server.url))
    send(page, *opening(("Robot_Move", ["3", "1", "8,@E J(90,0,90,0,90,0)", "SPEED=1,NEXT"])))
    expect_replies(page, 5)
    expect(page.get_by_test_id("raw-reply")).to_have_text("S_OK")
    until(lambda: bench.rc8.state.arm.busy)
    return page


def close_page(page: Any) -> None:
    page.close()


def open_another(page: Any) -> None:
    page.get_by_role("link", name="Connections").first.click()


def give_up(page: Any) -> None:
    page.get_by_role("button", name="Give up").click()
    expect(page.get_by_test_id("raw-state")).to_contain_text("the controls were given up")
    page.get_by_role("button", name="Take", exact=True).click()


def press_stop(page: Any) -> None:
    page.get_by_test_id("stop-all").click()
    expect(page.get_by_test_id("raw-state")).to_contain_text("the stop button was pressed")
    expect(page.get_by_test_id("raw-send")).to_be_disabled()


@pytest.mark.soak
@pytest.mark.parametrize("leave", [close_page, open_another, give_up, press_stop])
def test_the_arm_stops_at_the_end_of_the_connection(page: Any, bench: Any, leave: Any) -> None:
    leave(move(page, bench))
    until(lambda: not bench.rc8.state.arm.busy)


@pytest.mark.soak
def test_a_loop_ends_with_the_page(page: Any, bench: Any, received: ReceivedPackets) -> None:
    def count() -> int:
        return [data for data, _ in received.raw].count(bytes.fromhex(START))

    def has_ended() -> bool:
        before = count()
        time.sleep(0.2)
        return count() == before

    open_page(page, bench.tester.url, eth(bench.server.url))
    write(page, START)
    fill(page, "raw-count", "1000000")
    page.get_by_test_id("raw-loop").click()
    until(lambda: count() > 50)
    page.close()
    until(has_ended)
    assert count() < 1_000_000


@pytest.mark.soak
def test_a_lost_connection_ends_a_loop_and_the_page_goes_on(browser: Any, tmp_path: Any) -> None:
    server = orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0")
    with TesterProcess(folder=tmp_path) as tester, user(browser) as page:
        open_page(page, tester.url, eth(server.url))
        write(page, START)
        fill(page, "raw-count", "1000000")
        page.get_by_test_id("raw-loop").click()
        expect(page.get_by_test_id("raw-stop")).to_be_enabled()
        server.close()
        expect(page.get_by_test_id("raw-state")).to_contain_text("connection lost")
        expect(page.get_by_test_id("error-raw-send")).to_be_visible()
        expect(page.get_by_test_id("raw-stop")).to_be_disabled()
        with orinkit.serve(VirtualRC8(), server.url):
            page.get_by_test_id("raw-connect").click()
            expect(page.get_by_test_id("raw-disconnect")).to_be_enabled()
            counter(page, "sent", 0)  # the loop does not continue
            page.get_by_test_id("raw-send").click()
            counter(page, "received", 1)
