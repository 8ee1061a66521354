"""Poses, vectors, lengths and axes in every form of the provider guide, appendix B, as clients send them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from orinkit.core import hresult
from orinkit.values.variant import ARRAY, VARIANT_ARRAY, Variant, VarType, variant
from support.cell import Cell

P = [350.0, 0.0, 300.0, 180.0, 0.0, 180.0, 5.0]
J = [10.0, 45.0, 90.0, 0.0, 45.0, 0.0, 0.0, 0.0]
APPROACH, PTP, LINE, ARC, CURVE = 20.0, 1, 2, 3, 4


def r4(*values: float) -> Variant:
    return Variant(VarType.R4 | ARRAY, list(values))


def r8(*values: float) -> Variant:
    return Variant(VarType.R8 | ARRAY, list(values))


def parts(*values: Any) -> Variant:
    return Variant(VARIANT_ARRAY, [each if isinstance(each, Variant) else variant(each) for each in values])


@pytest.fixture
def cell():
    cell = Cell().take()
    cell.put("P70", P)
    cell.put("J5", J)
    cell.put("V1", [0.0, 0.0, 20.0])
    yield cell
    cell.close()


def moved(cell: Cell, result: Any) -> np.ndarray:
    cell.run(result)
    return np.array(cell.arm.queue.joints)


def mark_of(cell: Cell) -> str:
    """Return the pass mark of the motion that was commanded last."""
    return str(cell.arm.queue.tickets[-1].motion.mark)


# --- C0: poses --------------------------------------------------------------------------------------------------------

TO_P = {
    "text": "@E P70", "text with elements": f"@E P({', '.join(map(str, P))})", "no letter": f"@E ({', '.join(map(str, P))})",
    "index": [70, 0, -2], "index in R4": parts(70.0, 0, -2), "index, no type": parts(70, -1, -2), "no extended joints": parts(r8(*P), 0, -2, 0),
    "no extended joints as a text": parts(r8(*P), "P", "@E", ""), "index and letter": [70, "P", "@E"], "index, mark first": [70, "@E", "P"],
    "raw and numbers": parts(r8(*P), 0, -2), "raw and texts": parts(r8(*P), "P", "@E"), "raw in R4": parts(r4(*P), "P", "@E"),
    "six elements, no letter": f"@E ({', '.join(map(str, P[:6]))})", "mark before letter": parts(r8(*P), "@E", "P"), "nested": parts(parts(*P), "P", "@E"), "nested, mark first": parts(parts(*P), "@E", "P"),
}  # fmt: skip


@pytest.mark.parametrize("form", TO_P)
@pytest.mark.field("2.4")
@pytest.mark.guide("5.2.25, App. B Move")
def test_forms_of_a_position(cell, form):
    there = cell.arm.space.position(moved(cell, cell.move(PTP, "P70")))
    cell.stand(0, 45, 90, 0, 45, 0)
    result = cell.move(PTP, TO_P[form])
    assert mark_of(cell) == "@E"
    assert cell.arm.space.position(moved(cell, result)) == pytest.approx(there, abs=1e-3)


TO_J = {
    "text": "@P J5", "index": [5, 2, -1], "index in R4": parts(5.0, 2, -1), "raw": parts(r4(*J), "J", "@P"), "raw, mark first": parts(r4(*J), "@P", "J"),
    "eight": "@P J(10, 45, 90, 0, 45, 0, 0, 0)", "six": "@P J(10, 45, 90, 0, 45, 0)",
}  # fmt: skip


@pytest.mark.parametrize("form", TO_J)
@pytest.mark.guide("5.2.25, App. B Move")
def test_forms_of_a_joint_position(cell, form):
    result = cell.move(PTP, TO_J[form])
    assert mark_of(cell) == "@P"
    cell.run(result)
    cell.clock.advance(2.0)
    assert cell.arm.queue.joints == pytest.approx(J[:6])


@pytest.mark.parametrize(
    "form", ["J(1, 2, 93, 4)", parts(r8(1.0, 2.0, 93.0, 4.0), "J"), parts(r4(1.0, 2.0, 93.0, 4.0), 2)]
)
@pytest.mark.guide("5.2.25, App. B Move")
def test_joints_that_are_not_given_keep_their_positions(cell, form):
    cell.stand(0, 45, 90, 0, 41, 7)
    assert moved(cell, cell.move(PTP, form)) == pytest.approx([1, 2, 93, 4, 41, 7])


@pytest.mark.guide("5.2.25, App. B Move")
def test_a_vt_r4_array_is_a_position(cell):
    """The value of a J variable, passed as it is, is read as a position, as by a real controller."""
    cell.run(cell.move(PTP, r4(*J)))
    assert cell.arm.space.position(cell.arm.queue.joints)[:3] == pytest.approx(J[:3], abs=1e-3)
    cell.stand(0, 45, 90, 0, 45, 0)
    there = moved(cell, cell.move(PTP, "P70"))
    for form in (r4(*P), r4(*P[:6]), r4(*P, 0.0)):
        cell.stand(0, 45, 90, 0, 45, 0)
        assert moved(cell, cell.move(PTP, form)) == pytest.approx(there, abs=1e-3)


@pytest.mark.guide("5.2.25, App. B Move")
def test_an_index_alone_is_a_position(cell):
    there = moved(cell, cell.move(PTP, "P70"))
    cell.stand(0, 45, 90, 0, 45, 0)
    assert moved(cell, cell.move(PTP, parts(Variant(VarType.R4, 70.0)))) == pytest.approx(there, abs=1e-3)


CURVES = {
    "text": "@E 5", "index": 5, "array": parts(5), "array and mark": parts(5, "", "@E"), "numbers": parts(5, -1, -2),
    "R4": parts(Variant(VarType.R4, 5.0), -1, -2), "mark only": parts(5, "@E"), "I4 array": Variant(VarType.I4 | ARRAY, [5, -1, -2]),
}  # fmt: skip


@pytest.mark.parametrize("form", CURVES)
@pytest.mark.guide("5.2.25, App. B Move")
def test_forms_of_a_stored_curve(cell, form):
    for point in ("P70", "P(330, 70, 300, 180, 0, 180, 5)", "P(300, 100, 300, 180, 0, 180, 5)"):
        cell.execute("AddPathPoint", [5, point])
    cell.run(cell.move(PTP, "P70"))
    result = cell.move(CURVE, CURVES[form])
    assert mark_of(cell) == ("@0" if form in ("index", "array") else "@E")
    at = cell.arm.space.position(moved(cell, result))
    assert at[:3] == pytest.approx([300, 100, 300], abs=1e-3)


@pytest.mark.parametrize("form", ["21", "0", parts(21), parts(4, "", "@E"), parts(5.5, "", "@E"), parts(5, "", "@X")])
def test_what_is_not_a_stored_curve(cell, form):
    assert cell.code_of(lambda: cell.move(CURVE, form)) == hresult.E_INVALIDARG
    assert not cell.arm.busy


@pytest.mark.parametrize("form", ["@C P70", parts(r8(*P), "P", "@C"), parts(r8(*P), "@C", "P")])
@pytest.mark.guide("5.2.25, App. B Move")
def test_the_mark_c(cell, form):
    result = cell.move(PTP, form)
    assert mark_of(cell) == "@C"
    cell.run(result)
    assert cell.arm.settled


@pytest.mark.parametrize("targets", ["P70, J5", parts(parts(70, "P"), parts(5, "J")), ["P70", "@E J5"]])
@pytest.mark.guide("5.2.25, App. B Move")
def test_an_arc_through_two_types_is_refused(cell, targets):
    assert cell.code_of(lambda: cell.move(ARC, targets)) == hresult.E_INVALIDARG
    assert not cell.arm.busy


BAD = {
    "two letters": parts(r8(*P), "P", "J"), "two marks": parts(r8(*P), "@E", "@P"), "unknown letter": parts(r8(*P), "L"),
    "unknown mark": parts(r8(*P), "P", "@X"), "six of any type": r8(*P[:6]), "five parts": parts(1, 0, 0, 0, 0),
}  # fmt: skip


@pytest.mark.parametrize("form", BAD)
def test_what_is_not_a_pose(cell, form):
    assert cell.code_of(lambda: cell.move(PTP, BAD[form])) in (hresult.E_INVALIDARG, hresult.DISP_E_TYPEMISMATCH)
    assert not cell.arm.busy


# --- C2: lengths and angles -------------------------------------------------------------------------------------------

LENGTHS = {
    "text": "@P 20", "text of a number": "20", "number": 20.0, "texts": [20.0, "", "@P"], "numbers": parts(20.0, -1, -1), "radius": [20.0, "", "@100"],
    "radius as a number": parts(20, -1, 100), "R4": parts(Variant(VarType.R4, 20.0), "", "@E"), "mark only": [20.0, "@P"],
}  # fmt: skip


@pytest.mark.parametrize("form", LENGTHS)
@pytest.mark.parametrize(
    "base",
    ["P70", parts(70, "P"), parts(r8(*P), "P"), parts(parts(*P), "P"), parts(70, 0, 0)],
    ids=["text", "index", "raw", "nested", "numbers, no mark"],
)
@pytest.mark.field("2.3")
@pytest.mark.guide("5.2.28.46 Approach")
def test_approach(cell, base, form):
    result = cell.robot.execute("Approach", parts(PTP, base, LENGTHS[form]))
    cell.run(result)
    cell.clock.advance(2.0)
    at = cell.arm.space.position(cell.arm.queue.joints)
    assert at[:6] == pytest.approx([350, 0, 320, 180, 0, 180], abs=1e-3)  # the tool points down


@pytest.mark.parametrize("form", LENGTHS)
@pytest.mark.field("2.3")
@pytest.mark.guide("5.2.28.47 Depart")
def test_depart(cell, form):
    cell.run(cell.move(PTP, "P70"))
    cell.run(cell.robot.execute("Depart", parts(LINE, LENGTHS[form])))
    cell.clock.advance(2.0)
    assert cell.arm.space.position(cell.arm.queue.joints)[:3] == pytest.approx([350, 0, 320], abs=1e-3)


@pytest.mark.parametrize("form", LENGTHS)
@pytest.mark.guide("5.2.28.50 RotateH")
def test_rotate_hand(cell, form):
    cell.run(cell.move(PTP, "P70"))
    before = cell.tip
    cell.run(cell.robot.execute("RotateH", parts(LENGTHS[form], "S=50")))
    cell.clock.advance(2.0)
    turned = before[:3, :3].T @ cell.tip[:3, :3]
    assert np.degrees(np.arctan2(turned[1, 0], turned[0, 0])) == pytest.approx(20.0)


@pytest.mark.parametrize("base", ["@P P70", "@0 P70", parts(70, 0, -1), parts(r8(*P), "P", "@E"), parts(70, 0, 30)])
@pytest.mark.guide("5.2.28.46 Approach")
def test_a_pass_mark_in_the_base_of_approach_is_refused(cell, base):
    assert cell.code_of(lambda: cell.robot.execute("Approach", parts(PTP, base, "20"))) == hresult.E_INVALIDARG
    assert not cell.arm.busy


@pytest.mark.parametrize(
    "form", ["@X 20", "20 mm", "", [20.0, "", "@P", None, 1], [[1.0, 2.0], "", "@P"], "20 EX(9, 1)"]
)
def test_what_is_not_a_length(cell, form):
    codes = (hresult.E_INVALIDARG, hresult.DISP_E_TYPEMISMATCH)
    assert cell.code_of(lambda: cell.robot.execute("Depart", parts(LINE, form))) in codes
    assert not cell.arm.busy


# --- C1: vectors ------------------------------------------------------------------------------------------------------

VECTORS = {
    "text": "V1", "text with a mark": "@P V1", "elements": "V(0, 0, 20)", "index": [1, "V", "@P"], "index in numbers": parts(1.0, 3, -2),
    "raw": parts(r4(0, 0, 20), 3, -2), "raw and texts": parts(r8(0, 0, 20), "V", "@P"),
}  # fmt: skip


@pytest.mark.parametrize("form", VECTORS)
@pytest.mark.parametrize("interpolation", [PTP, LINE])
@pytest.mark.guide("5.2.28.45 Draw")
def test_draw(cell, interpolation, form):
    cell.run(cell.move(PTP, "P70"))
    assert cell.run(cell.robot.execute("Draw", parts(interpolation, VECTORS[form], "S=50"))) is None
    cell.clock.advance(2.0)
    assert cell.arm.space.position(cell.arm.queue.joints) == pytest.approx([350, 0, 320, 180, 0, 180, 5], abs=1e-3)


@pytest.mark.guide("5.2.28.45 Draw")
def test_draw_is_relative_to_the_work_frame(cell):
    cell.execute("SetWorkDef", [1, "P(0, 0, 0, 90, 0, 0)"])  # its Z axis is -Y of the base
    cell.run(cell.move(PTP, "P70"))
    cell.robot.change("Work1")
    before = cell.tip
    cell.run(cell.robot.execute("Draw", parts(LINE, "V1")))
    assert cell.tip[:3, 3] - before[:3, 3] == pytest.approx([0, -20, 0], abs=1e-3)
    assert cell.tip[:3, :3] == pytest.approx(before[:3, :3], abs=1e-6)


@pytest.mark.parametrize(
    ("form", "code"),
    [("P70", hresult.DISP_E_TYPEMISMATCH), ("V1, V1", hresult.E_INVALIDARG), (5, hresult.DISP_E_TYPEMISMATCH)],
)
def test_what_is_not_a_vector(cell, form, code):
    assert cell.code_of(lambda: cell.robot.execute("Draw", parts(LINE, form))) == code


# --- C3: axes ---------------------------------------------------------------------------------------------------------

AXES = {
    "text": ["@0 (1, 10), (2, 5)"],
    "pairs": [[1, 10.0], [2, 5.0]],
    "pairs in one array": [[[1, 10.0], [2, 5.0]]],
    "elements": [[parts(parts(1, 10), -1, "@0"), parts(parts(2, 5), -1)]],
    "elements of R4": [parts(r4(1, 10), -1, 0), parts(r4(2, 5), -1, 0)],
    "elements with texts": [parts(parts(1, 10.0), "", "@0"), parts(parts(2, 5.0), "", "@0")],
}


@pytest.mark.parametrize("option", [[], ["S=50"], ["S=50, NEXT"]], ids=["none", "speed", "next"])
@pytest.mark.parametrize("form", AXES)
@pytest.mark.field("2.5")
@pytest.mark.guide("5.2.28.48 DriveEx", "5.2.28.49 DriveAEx")
def test_drive(cell, form, option):
    cell.run(cell.robot.execute("DriveEx", parts(*AXES[form], *option)))
    cell.clock.advance(3.0)
    assert cell.arm.queue.joints == pytest.approx((10, 50, 90, 0, 45, 0))
    cell.run(cell.robot.execute("DriveAEx", parts(*AXES[form], *option)))
    cell.clock.advance(3.0)
    assert cell.arm.queue.joints == pytest.approx((10, 5, 90, 0, 45, 0))


@pytest.mark.parametrize(
    "form", [[parts(r4(1, 10), -1, "@P")], [parts(r4(1, 10), "@P", "")], [parts(1, 10.0), -1, "@P"], ["@P (1, 10)"]]
)
@pytest.mark.guide("5.2.28.48 DriveEx")
def test_one_axis_with_a_pass_mark(cell, form):
    result = cell.robot.execute("DriveEx", parts(*form))
    assert mark_of(cell) == "@P"
    cell.run(result)
    cell.clock.advance(2.0)
    assert cell.arm.queue.joints[0] == pytest.approx(10.0)


@pytest.mark.parametrize(
    "form", [[], ["@0"], ["(1, 10) x"], [[1.0]], [[[1, 2, 3]]], [["a", "b"]], [[0, 5.0]], [[7, 5.0]], [1, 10.0]]
)
def test_what_is_not_an_axis(cell, form):
    codes = (hresult.E_INVALIDARG, hresult.DISP_E_TYPEMISMATCH)
    assert cell.code_of(lambda: cell.robot.execute("DriveEx", parts(*form))) in codes
    assert not cell.arm.busy


@pytest.mark.guide("5.2.24 Drive")
def test_drive_is_not_supported(cell):
    assert cell.code_of(lambda: cell.robot.drive(1, 10.0, "")) == hresult.E_NOTIMPL


# --- Rotate, Change, Accelerate, OutRange -----------------------------------------------------------------------------

PLANES = {
    "commas": "V(0,0,0),V(1,0,0),V(0,1,0)", "blanks": "V(0,0,0) V(1,0,0) V(0,1,0)", "tabs": "V10\tV11\tV12", "variables": "V10 V11,V12",
    "texts": ["V10", "V11", "V12"], "arrays": parts(parts(10, "V"), parts(11, "V"), parts(12, "V")), "numbers": parts([10, 3], [11, 3], [12, 3]),
    "name": "XY",
}  # fmt: skip


@pytest.mark.parametrize("form", PLANES)
@pytest.mark.guide("5.2.26 Rotate")
def test_forms_of_a_plane(cell, form):
    for index, vector in ((10, [0, 0, 0]), (11, [1, 0, 0]), (12, [0, 1, 0])):
        cell.put(f"V{index}", vector)
    cell.run(cell.move(PTP, "P70"))
    cell.run(cell.robot.rotate(variant(PLANES[form]), 10.0, variant("V(0, 0, 0)"), ""))
    angle = np.radians(10.0)
    assert cell.tip[:2, 3] == pytest.approx([350 * np.cos(angle), 350 * np.sin(angle)], abs=1e-2)


@pytest.mark.parametrize(("plane", "axis"), [("XYH", 2), ("YZH", 0), ("ZXH", 1), ("xyh", 2)])
@pytest.mark.guide("5.2.26 Rotate")
def test_planes_of_the_tool(cell, plane, axis):
    cell.run(cell.move(PTP, "P70"))
    before = cell.tip
    cell.run(cell.robot.rotate(variant(plane), 10.0, variant("V(0, 0, 0)"), ""))
    assert cell.tip[:3, 3] == pytest.approx(before[:3, 3], abs=1e-2)  # the pivot is the tool's origin
    assert cell.tip[:3, axis] == pytest.approx(before[:3, axis], abs=1e-4)


@pytest.mark.parametrize("plane", ["XYZ", "X", "HXY", "", "V1 V2", "V1 V2 V3 V4", "V1;V2;V3"])
def test_what_is_not_a_plane(cell, plane):
    assert (
        cell.code_of(lambda: cell.robot.rotate(variant(plane), 10.0, variant("V(0, 0, 0)"), "")) == hresult.E_INVALIDARG
    )


@pytest.mark.guide("5.2.23 Change")
def test_change_without_a_number(cell):
    cell.robot.change("Tool3")
    cell.robot.change("Work2")
    cell.robot.change("Tool")
    cell.robot.change(" work ")
    assert (cell.arm.space.tools.current, cell.arm.space.works.current) == (0, 0)


@pytest.mark.field("2.7")
def test_loose_poses():
    cell = Cell(loose_poses=True).take()
    assert cell.execute("OutRange", P[:6]) == 0
    assert cell.execute("OutRange", [5000.0, *P[1:6]]) == -1
    cell.run(cell.move(LINE, parts(r8(*P), "L", "@E")))
    assert cell.arm.space.position(cell.arm.queue.joints) == pytest.approx(P, abs=1e-3)
    cell.close()


@pytest.mark.field("2.7")
def test_loose_poses_are_refused_by_default(cell):
    assert cell.code_of(lambda: cell.execute("OutRange", P[:6])) == hresult.E_INVALIDARG
    assert cell.code_of(lambda: cell.move(LINE, parts(r8(*P), "L", "@E"))) == hresult.E_INVALIDARG


@pytest.mark.field("2.8")
def test_figure_of_the_usual_pose_of_a_cobotta():
    cell = Cell(model="COBOTTA").take()
    assert cell.execute("CurPos")[6] == 261.0
    assert cell.execute("CurFig") == 261
    cell.run(cell.move(PTP, "@E P(177.48, -44.48, 255, 180, 0, 180, 261)"))
    assert cell.execute("CurPos") == pytest.approx([177.48, -44.48, 255, 180, 0, 180, 261], abs=1e-3)
    cell.close()
