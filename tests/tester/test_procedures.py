"""The procedures of the documents, step by step on the pages: RC8 5.1.2 and 5.3, VE026A 6.2."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

import orinkit
from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.cao import functions as f
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.ve026a import VirtualVE026A
from support import paths
from support.browser import TesterProcess, needs_browser, user
from support.objects_page import add, choose, choose_type, expect, fill, open_objects, open_tab
from support.received import ReceivedPackets, received_packets

pytestmark = [needs_browser, pytest.mark.soak]

PRINTED = json.loads((paths.VECTORS / "bcap-packets.json").read_text(encoding="utf-8"))


@pytest.fixture
def received() -> Iterator[ReceivedPackets]:
    with received_packets() as recorded:
        yield recorded


def printed(document: str, line: int) -> bytes:
    """Return the packet that a document prints at a line."""
    (found,) = [each for each in PRINTED if each["document"] == document and each["line"] == line]
    return bytes.fromhex(found["hex"])


STEP_1 = printed("bcap-rc8.ja.txt", 1720)
STEP_2 = printed("bcap-rc8.ja.txt", 1733)


def as_printed(got: Packet, wanted: bytes, *, crc: bool = False) -> bytes:
    """Return the bytes of a received packet with the serial number and the handle of the printed one."""
    model = packet.decode(wanted, exact=True, crc=crc)
    got.serial, got.reserved, got.arguments[0] = model.serial, model.reserved, model.arguments[0]
    return packet.encode(got, crc=crc)


def execute(page: Any, command: str, parameter: str, type_name: str) -> None:
    """Execute a command of the selected object; the type is selected with the command, or by hand."""
    fill(page, "command", command)
    if parameter:
        page.get_by_test_id("command-hint").filter(has_text=": ").wait_for()
    if type_name not in page.get_by_test_id("parameter-type").locator("xpath=ancestor::label").inner_text():
        choose_type(page, "parameter", type_name)
    fill(page, "parameter", parameter)
    page.get_by_test_id("execute").click()


@pytest.mark.soak
def test_rc8_5_1_2_slave_mode_by_execute(browser: Any, bench: Any, received: ReceivedPackets) -> None:
    with user(browser) as page:
        open_objects(page, bench.tester.url)
        add(page, "Robot", "Arm")
        open_tab(page, "Execute")
        execute(page, "TakeArm", "0,1", "ARRAY | I4")
        received.wait_for(f.robot_execute)
        open_tab(page, "Move")
        fill(page, "pose", "@E P(364.16,0,278.5355,180,0,180,5)")
        page.get_by_test_id("move").click()
        expect(page.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")

        open_tab(page, "Execute")  # step 1
        execute(page, "slvChangeMode", "513", "I4")
        assert as_printed(received.wait_for(f.robot_execute, 2), STEP_1) == STEP_1
        expect(page.get_by_test_id("result-value")).to_have_text("(EMPTY)")
        execute(page, "slvMove", "364.16,0,278.5355,180,1.272222E-14,180,5", "ARRAY | R8")  # step 2
        assert as_printed(received.wait_for(f.robot_execute, 3), STEP_2) == STEP_2
        expect(page.get_by_test_id("result-type")).to_contain_text("VT_R8|VT_ARRAY")
        execute(page, "slvChangeMode", "0", "I4")
        expect(page.get_by_test_id("result-value")).to_have_text("(EMPTY)")


@pytest.mark.soak
def test_ve026a_6_2_checking_the_communication(browser: Any, tmp_path: Any, received: ReceivedPackets) -> None:
    arm = VirtualVE026A(motor_seconds=0.1)
    with orinkit.serve(arm, "pty://") as server, TesterProcess(folder=tmp_path) as tester, user(browser) as page:
        page.goto(tester.url)  # steps 1 to 3
        page.get_by_test_id("scheme").get_by_text("Serial").click()
        fill(page, "url", server.url)
        page.get_by_test_id("connect").click()
        page.get_by_test_id("state").get_by_text("connected", exact=True).wait_for()
        open_objects(page, tester.url)
        add(page, "Robot", "VE")  # step 4
        assert [each.value for each in received.wait_for(f.controller_get_robot).arguments[1:]] == ["VE", ""]
        open_tab(page, "Execute")
        execute(page, "Motor", "1", "I2")  # step 5
        motor = printed("bcap-ve026a.en.txt", 640)
        assert as_printed(received.wait_for(f.robot_execute), motor, crc=True) == motor
        expect(page.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
        add(page, "Variable", "@CURRENT_ANGLE")  # step 6
        connecting = printed("bcap-ve026a.en.txt", 591)
        assert as_printed(received.wait_for(f.robot_get_variable), connecting, crc=True) == connecting
        page.get_by_test_id("get").click()
        page.get_by_test_id("value-result-type").get_by_text("VT_R4|VT_ARRAY, 8 elements").wait_for()
        value = page.get_by_test_id("value-result-value").inner_text()
        choose(page, "VE")
        open_tab(page, "Execute")
        execute(page, "slvChangeMode", "2", "I4")  # step 7
        assert received.wait_for(f.robot_execute, 2).arguments[2] == Variant(VarType.I4, 2)
        expect(page.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")
        execute(page, "slvMove", value, "ARRAY | R4")  # step 8
        moved = received.wait_for(f.robot_execute, 3).arguments
        assert moved[1].value == "slvMove"
        assert moved[2].type == VarType.R4 | ARRAY
        assert moved[2].value == pytest.approx([float(each) for each in value.split(",")])
        execute(page, "slvChangeMode", "0", "I4")
        execute(page, "Motor", "0", "I2")
        expect(page.get_by_test_id("result-code")).to_have_text("0x00000000 S_OK")


def test_rc8_5_3_a_pose_as_an_array_of_variants(browser: Any, bench: Any, received: ReceivedPackets) -> None:
    with user(browser) as objects:
        open_objects(objects, bench.tester.url)
        add(objects, "Robot", "Arm")
        choose_type(objects, "pose", "ARRAY | VARIANT")
        fill(objects, "pose", "(8197, 0, 0, 0, 0, 0, 0, 5),(3, 0),(3, -2)")
        expect(objects.get_by_test_id("pose-description")).to_have_text("VT_VARIANT|VT_ARRAY, 3 elements")
        objects.get_by_test_id("move").click()
        handle, interpolation, pose, option = received.wait_for(f.robot_move).arguments
        assert interpolation == Variant(VarType.I4, 1)
        assert option == Variant(VarType.BSTR, "")
        assert pose == Variant(
            VARIANT_ARRAY,
            [Variant(VarType.R8 | ARRAY, [0, 0, 0, 0, 0, 0, 5]), Variant(VarType.I4, 0), Variant(VarType.I4, -2)],
        )
        expect(objects.get_by_test_id("object-handle")).to_have_text(f"handle {handle.value}")
        expect(objects.get_by_test_id("result-error")).to_contain_text(
            re.compile("0x[0-9A-F]{8} ")
        )  # the arm is not taken
