"""Rows of what programs in the field send and expect; a test names the rows that it shows.

``@pytest.mark.field("1.2")`` names section 1, row 2. ``tests/project/test_guide.py`` checks the names.
"""

from __future__ import annotations

from typing import Final

ROWS: Final[dict[str, str]] = {
    "1.1": "queries on the connection that is in slave mode, between calls of slvMove",
    "1.2": "option 0x400000 | mask with a mask of all axes",
    "1.3": "size of user I/O in bits",
    "1.4": "set-points of the published slave-mode samples, with a reversal",
    "1.5": "ManualReset, ClearError and Motor on within a few ms after an error; TakeArm after a limit",
    "1.6": "starvation in modes 0 and 2 is reported once as 0x84201482",
    "2.1": "GiveArm and Motor off right after a move that was answered at a pass mark",
    "2.2": "GiveArm without holding the arm",
    "2.3": "Approach and Depart with nested VARIANT arrays",
    "2.4": "mark and type letter of a pose in either order",
    "2.5": "DriveEx and DriveAEx with elements [R4[axis, value], -1, mark]",
    "2.6": "commands of the controller sent by Robot_Execute",
    "2.7": "six bare numbers in OutRange; a move with type L",
    "2.8": "figure of the usual pose of a COBOTTA",
    "2.9": "type name of a VS-060",
    "3.1": "variables @START, @STOP, @STATUS_DETAILS, @ERROR, TOOL1, WORK1",
    "3.2": "commands that programs ask for",
    "3.3": "version of the controller; error information of an RC9",
    "3.4": "empty lists of names are arrays of strings",
    "3.5": "Message=False at Controller_Connect",
    "3.6": "File_PutValue without @Create",
    "4.1": "503 bytes over UDP",
    "4.2": "503 bytes over a serial line",
    "4.3": "slow calls over a serial line",
    "4.4": "error replies carry one VT_EMPTY argument",
    "4.5": "Command_Execute has a result",
    "4.6": "WDT of 80, and WDT with a text",
    "4.7": "calls 100 ms apart",
    "4.8": "Motor of the VE026A, which takes 3 s",
    "4.9": "reply to a malformed packet on a serial line",
    "5.1": "user-defined functions",
    "5.2": "0x8001xxxx belongs to the device",
    "5.3": "text form of e-CAP",
    "5.4": "pages of other origins; JSON",
}
"""Section and row, and what it is about."""
