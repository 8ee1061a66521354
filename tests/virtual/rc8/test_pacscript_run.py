from __future__ import annotations

import pytest

from orinkit.core import hresult
from orinkit.rc8.motion_options import MotionOptions
from orinkit.values.poses import AT_COMMAND, AT_ENCODER, PASSING, Extra, PassMark, Target
from orinkit.virtual.rc8.pacscript.compiler import compile_program
from orinkit.virtual.rc8.pacscript.machine import Machine, MachineState
from orinkit.virtual.rc8.samples import sample_programs
from support.pacscript_world import FakeWorld, after, body, run

ZERO_P = (*(0.0,) * 6, -1.0)
PLAIN = MotionOptions()

# statements of Sub Main -> variables afterwards
PROGRAMS = {
    "assignment": (["I1 = 3", "F[1 + 1] = 2.5", "D3 = 0.1", 'S1 = "text"'],
                   {"I1": 3, "F2": 2.5, "D3": 0.1, "S1": "text"}),
    "both spellings": (["I[5] = 1", "I2 = I5 + I[5]", "I6 = 5", "I[I6] = I[I6] + 1"], {"I5": 2, "I2": 2, "I6": 5}),
    "single precision": (["F1 = 0.1", "D1 = F1"], {"F1": 0.10000000149011612, "D1": 0.10000000149011612}),
    "rounding to Integer": (["I1 = 2.5", "I2 = -2.5", "I3 = 2.49"], {"I1": 3, "I2": -2, "I3": 2}),
    "poses": (["P1 = P(1, 2, 3)", "P2 = P(1, 2, 3, 4, 5, 6, 5)", "J1 = J(10, 20)", "V1 = V(1, 2, 3)",
               "T1 = T(1, 2, 3, 0, 1, 0, 0, 0, -1, Fig(P2))"],
              {"P1": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, -1.0), "P2": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 5.0),
               "J1": (10.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), "V1": (1.0, 2.0, 3.0),
               "T1": (1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 5.0)}),
    "pose arithmetic": (["P1 = P(1, 2, 3, 0, 0, 0, 5) + P(10, 20, 30)", "P2 = P1 - P(1, 0, 0, 0, 0, 90)",
                         "J1 = J(1, 2) + J(0, 1)", "V1 = 2 * (V(1, 2, 3) - V(1, 1, 1)) / 4", "V2 = -V1"],
                        {"P1": (11.0, 22.0, 33.0, 0.0, 0.0, 0.0, 5.0), "P2": (10.0, 22.0, 33.0, 0.0, 0.0, -90.0, 5.0),
                         "J1": (1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), "V1": (0.0, 0.5, 1.0), "V2": (0.0, -0.5, -1.0)}),
    "a product of T": (["T1 = T(10, 0, 0, 0, 0, 1, 1, 0, 0, 5) * T(1, 2, 3, 0, 1, 0, 0, 0, 1, 7)"],
                       {"T1": (13.0, 1.0, 2.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 7.0)}),
    "parts of poses": (["P1 = P(1, 2, 3, 4, 5, 6, 5)", "D1 = PosX(P1) + PosY(P1) + PosZ(P1)",
                        "D2 = PosRX(P1) * 100 + PosRY(P1) * 10 + PosRZ(P1)", "I1 = Fig(P1)", "D3 = Joint(2, J(7, 8))",
                        "V1 = AVec(T(0, 0, 0, 0, 1, 0, 0, 0, 1))", "D4 = Magnitude(V(3, 4, 0))"],
                       {"P1": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 5.0), "D1": 6.0, "D2": 456.0, "I1": 5, "D3": 8.0,
                        "V1": (0.0, 0.0, 1.0), "D4": 5.0}),
    "LetX and the like": (["LetX P1 = 1", "LetRZ P[1] = 90", "LetF P1 = 5", "LetJ 2, J1 = 45", "LetZ V1 = 3",
                           "Dim a(1) As Position", "LetY a(1) = 2", "P2 = a(1)"],
                          {"P1": (1.0, 0.0, 0.0, 0.0, 0.0, 90.0, 5.0), "J1": (0.0, 45.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                           "V1": (0.0, 0.0, 3.0), "P2": (0.0, 2.0, 0.0, 0.0, 0.0, 0.0, -1.0)}),
    "local variables": (["Dim a As Integer, b As Single = 1.5, c(2) As Integer, s As String", "c(a + 1) = 7", "a = c(1)",
                         's = "x" & a', "I1 = a", "F1 = b", "S1 = s"], {"I1": 7, "F1": 1.5, "S1": "x7"}),
    "arrays of three dimensions": (["Dim a(1, 2, 3) As Integer, i, j, k", "For i = 0 To 1", "For j = 0 To 2",
                                    "For k = 0 To 3", "a(i, j, k) = i * 100 + j * 10 + k", "Next", "Next", "Next",
                                    "I1 = a(1, 2, 3)", "I2 = a(0, 2, 1)", "I3 = a(1, 0, 0)"],
                                   {"I1": 123, "I2": 21, "I3": 100}),
    "constants": (["Const a = 2, b = a * 3", 'Const s As String = "t"', "I1 = b", "S1 = s & Pi"],
                  {"I1": 6, "S1": "t3.141592653589793"}),
    "If on a line": (["If 1 = 1 Then I1 = 1 : I2 = 2 Else I3 = 3", "If 1 = 2 Then I4 = 4 Else I5 = 5 : I6 = 6",
                      "If 1 = 2 Then I7 = 7"], {"I1": 1, "I2": 2, "I5": 5, "I6": 6}),
    "If, ElseIf, Else": (["Dim i As Integer", "For i = 0 To 3", "If i = 0 Then", "I1 = 10", "ElseIf i = 1 Then", "I2 = 11",
                          "ElseIf i = 2 Then", "I3 = 12", "Else", "I4 = 13", "End If", "Next"],
                         {"I1": 10, "I2": 11, "I3": 12, "I4": 13}),
    "For": (["Dim i As Integer", "For i = 1 To 4", "I1 = I1 + i", "Next i", "I2 = i"], {"I1": 10, "I2": 5}),
    "For with Step": (["For I3 = 10 To 0 Step -4", "I1 = I1 + I3", "Next I3", "For F1 = 0 To 1 Step 0.25",
                       "I2 = I2 + 1", "Next"], {"I1": 18, "I2": 5, "I3": -2, "F1": 1.25}),
    "For that is not entered": (["For I1 = 5 To 4", "I2 = 1", "Next"], {"I1": 5}),
    "Exit For": (["For I1 = 1 To 9", "For I2 = 1 To 9", "If I2 = 3 Then Exit For", "Next", "If I1 = 4 Then Exit For", "Next"],
                 {"I1": 4, "I2": 3}),
    "Do While": (["Do While I1 < 3", "I1 = I1 + 1", "Loop", "Do Until I2 >= 2", "I2 = I2 + 1", "Loop"], {"I1": 3, "I2": 2}),
    "Loop Until": (["Do", "I1 = I1 + 1", "Loop Until I1 = 3", "Do", "I2 = I2 + 1", "Loop While I2 < 0"], {"I1": 3, "I2": 1}),
    "Exit Do": (["Do", "I1 = I1 + 1", "If I1 = 7 Then Exit Do", "Loop"], {"I1": 7}),
    "While and Wend": (["While I1 < 3", "I1 = I1 + 1", "Wend"], {"I1": 3}),
    "Select Case": (["Dim i As Integer", "For i = 0 To 9", "Select Case i", "Case 1, 2", "I1 = I1 + 1", "Case 3 To 5",
                     "I2 = I2 + 1", "Case Is > 7", "I3 = I3 + 1", "Case Else", "I4 = I4 + 1", "End Select", "Next"],
                    {"I1": 2, "I2": 3, "I3": 2, "I4": 3}),
    "Select Case of texts": (['Select Case "b"', 'Case "a"', "I1 = 1", 'Case "b" : I2 = 2', "End Select"], {"I2": 2}),
    "Goto": (["*again", "I1 = I1 + 1", "If I1 < 3 Then Goto *again", "Goto done", "I2 = 1", "done: I3 = 1"],
             {"I1": 3, "I3": 1}),
    "Goto out of a loop": (["For I1 = 1 To 9", "Do", "Goto *out", "Loop", "Next", "*out:", "I2 = 1"], {"I1": 1, "I2": 1}),
    "Gosub": (["Gosub *a", "Gosub *a", "Goto *end", "*a: I1 = I1 + 1", "Return", "*end:"], {"I1": 2}),
    "I/O": (["Set IO[128]", "IO129 = On", "IO[130] = True", "Set IO131", "Reset IO[131]", "I1 = IOB[128]",
             "IOW[200] = -1", "I2 = IOW[200]", "IOD[256] = &H12345678", "I3 = IOB[256]", "Set IOB[136]", "I4 = IOB136"],
            {"I1": 7, "I2": 65535, "I3": 0x78, "I4": 255}),
    "I/O in conditions": (["Set IO[1]", "If IO[1] = On Then I1 = 1", "If IO[1] = True Then I2 = 1", "If IO[1] Then I3 = 1",
                           "If Not IO[1] Then I4 = 1", "If IO[1] <> Off And Not (IO[2] Or IO[3]) Then I5 = 1", "I6 = IO[1]"],
                          {"I1": 1, "I2": 1, "I3": 1, "I5": 1, "I6": 1}),
    "End": (["I1 = 1", "If I1 = 1 Then End", "I1 = 2"], {"I1": 1}),
    "Exit Sub": (["I1 = 1", "Exit Sub", "I1 = 2"], {"I1": 1}),
    "numbers": (["D1 = Abs(-2.5)", "I1 = Sgn(-3)", "I2 = Int(-2.5)", "I3 = Fix(-2.5)", "D2 = Sqr(9)", "D3 = Exp(0)",
                 "D4 = Log10(1000)", "D5 = Pow(2, 3)", "I4 = Max(1, 5, 3)", "I5 = Min(4, 2)", "D6 = Log(1)"],
                {"D1": 2.5, "I1": -1, "I2": -3, "I3": -2, "D2": 3.0, "D3": 1.0, "D4": 3.0, "D5": 8.0, "I4": 5, "I5": 2,
                 "D6": 0.0}),
    "angles are degrees": (["F1 = Sin(30)", "F2 = Cos(60)", "F3 = Tan(45)", "F4 = Atn2(1, -1)", "F5 = Acos(0.5)",
                            "F6 = RadDeg(Pi)", "F7 = Asin(1) + Atn(1)", "I1 = DegRad(180) * 1000"],
                           {"F1": 0.5, "F2": 0.5, "F3": 1.0, "F4": 135.0, "F5": 60.0, "F6": 180.0, "F7": 135.0, "I1": 3142}),
    "texts": (['S1 = Left("abcdef", 2) & Mid("abcdef", 3, 2) & Right("abcdef", 2) & Mid("abc", 3)', 'I1 = Len("日本")',
               'I2 = InStr("hello", "l")', 'I3 = InStr(4, "hello", "l")', 'S2 = UCase("aB") & LCase("Cd") & Trim(" e ")',
               'D1 = Val("12.5 mm")', 'I4 = Val("&H10")', 'S3 = Str(1 / 4) & Chr(65)', 'I5 = Asc("A")',
               'S4 = Hex(255) & " " & Bin(5) & " " & Hex(-1)', 'I6 = Val("mm")', 'S5 = Left("a", 9)'],
              {"S1": "abcdefc", "I1": 2, "I2": 3, "I3": 4, "S2": "ABcde", "D1": 12.5, "I4": 16, "S3": "0.25A", "I5": 65,
               "S4": "FF 101 FFFFFFFF", "I6": 0, "S5": "a"}),
    "functions of the controller": (["P1 = CurPos", "J1 = DestJnt", "I1 = CurFig", "P2 = J2P(J(1, 2))", "I2 = OutRange(P1, -1)",
                                     "P3 = DevH(P(1, 1, 1, 0, 0, 0, 5), P(0, 0, -5))"],
                                    {"P1": (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), "I1": 5, "P2": ZERO_P, "I2": 0,
                                     "J1": (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), "P3": (1.0, 1.0, -4.0, 0.0, 0.0, 0.0, 5.0)}),
    "types of locals": (["Dim l As Long, b As Boolean, v, w As Variant", "l = 3.7", "b = 5", "v = V(1, 2, 3)", 'w = "x"',
                         "I1 = l", "I2 = b", "V1 = v", "S1 = w"], {"I1": 4, "I2": -1, "V1": (1.0, 2.0, 3.0), "S1": "x"}),
    "comparing poses": (["If P1 = P2 Then I1 = 1", "If P1 <> J2P(J1) + P(1, 0) Then I2 = 1", "If J1 = J(1) Then I3 = 1"],
                        {"I1": 1, "I2": 1}),
    "indices that are calculated": (["I1 = 2", "P[I1] = P(1)", "P3 = P[I1 + 0]", "IO[I1 + 3] = On", "I2 = IO[I1 + 3]",
                                     "I3 = IOB[I1 - 2]", "D1 = +F[I1] - 1.5", "For I[4] = 1 To 2", "Next I[4]"],
                                    {"I1": 2, "P2": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0),
                                     "P3": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0), "I2": 1, "I3": 32, "D1": -1.5, "I4": 3}),
    "letters as names": (["Dim i As Integer, p(2) As Integer, t As Single", "i = 2", "p(1) = i", "t = p(1) / 4",
                          "I[1] = p(i - 1)", "F1 = t"], {"I1": 2, "F1": 0.5}),
}  # fmt: skip


def values(world: FakeWorld) -> dict[str, object]:
    return {f"{kind}{index}": value for (kind, index), value in world.values.items()}


@pytest.mark.parametrize(("lines", "expected"), PROGRAMS.values(), ids=PROGRAMS)
def test_variables_after_a_program(lines, expected):
    assert values(after(*lines)) == expected


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_result_does_not_depend_on_the_size_of_slices(name):
    source = body(*PROGRAMS[name][0], "Move P, P1, P2", "Delay 20", "Wait IO[5] = On, 50")
    whole, pieces = FakeWorld(), FakeWorld()
    assert run(source, whole).state is MachineState.DONE
    assert run(source, pieces, budget=1).state is MachineState.DONE
    assert (pieces.values, pieces.points, pieces.log) == (whole.values, whole.points, whole.log)


# --- Subs and Functions -----------------------------------------------------------------------------------------------


def subs(main: list[str], *rest: str) -> dict[str, object]:
    world = FakeWorld()
    machine = run(body(*main) + "\n".join(rest) + "\n", world)
    assert machine.state is MachineState.DONE, machine.fault
    return values(world)


def test_a_sub_is_called_in_three_ways():
    assert subs(["Add 1, 2", "Call Add(3, 4)", "Add(5, 6)"], "Sub Add(a, b)", "I1 = I1 + a * b", "End Sub") == {
        "I1": 44
    }


def test_a_parameter_by_reference_changes_the_callers_variable():
    lines = ["Dim a As Integer, b(2) As Integer", "a = 1", "Bump a", "Bump b(2)", "Bump I3", "Bump I[4]", "Bump 5",
             "I1 = a", "I2 = b(2)"]  # fmt: skip
    assert subs(lines, "Sub Bump(x As Integer)", "x = x + 10", "End Sub") == {"I1": 11, "I2": 10, "I3": 10, "I4": 10}


def test_a_reference_is_passed_on():
    assert subs(["Outer I1"], "Sub Outer(a As Integer)", "Inner a", "a = a * 2", "End Sub",
                "Sub Inner(ByRef b As Integer)", "b = 4", "End Sub") == {"I1": 8}  # fmt: skip


def test_a_parameter_by_value_does_not_change_the_callers_variable():
    assert subs(["I1 = 1", "Bump I1"], "Sub Bump(ByVal x As Integer)", "x = x + 10", "I2 = x", "End Sub") == {
        "I1": 1,
        "I2": 11,
    }


def test_a_variable_of_another_type_is_passed_by_value():
    lines = ["Dim a As Single", "a = 1.6", "Bump a", "F1 = a"]
    assert subs(lines, "Sub Bump(x As Integer)", "I1 = x", "x = 9", "End Sub") == {"I1": 2, "F1": 1.600000023841858}


def test_a_function_returns_by_assignment():
    assert subs(["I1 = Twice(3) + Twice(Twice(1))"], "Function Twice(ByVal n As Integer) As Integer", "Twice = n * 2",
                "Exit Function", "Twice = 0", "End Function") == {"I1": 10}  # fmt: skip


def test_a_function_without_arguments_and_as_a_statement():
    assert subs(["I1 = Answer", "I2 = Answer()", "Answer"], "Function Answer As Integer", "I3 = I3 + 1", "Answer = 42",
                "End Function") == {"I1": 42, "I2": 42, "I3": 3}  # fmt: skip


def test_recursion():
    assert subs(["I1 = Factorial(10)"], "Function Factorial(ByVal n As Integer) As Integer",
                "If n < 2 Then Factorial = 1 Else Factorial = n * Factorial(n - 1)", "End Function") == {"I1": 3628800}  # fmt: skip


def test_every_call_has_its_own_variables():
    assert subs(["I1 = f(3)"], "Function f(ByVal n As Integer) As Integer", "Dim a(3) As Integer, i As Integer",
                "For i = 0 To 3", "a(i) = n", "Next", "If n > 0 Then i = f(n - 1)", "f = a(0) + a(3)",
                "End Function") == {"I1": 6}  # fmt: skip


def test_functions_in_conditions_are_called_each_time():
    assert subs(["Do While Count < 3", "Loop", "If Count = 9 Then", "ElseIf Count = 5 Then", "I2 = 1", "End If",
                 "Select Case Count", "Case Count - 1", "I3 = 1", "End Select"],
                "Function Count As Integer", "I1 = I1 + 1", "Count = I1", "End Function") == {"I1": 7, "I2": 1, "I3": 1}  # fmt: skip


def test_a_function_that_waits_in_an_expression():
    world = FakeWorld()
    source = body("I1 = 1 + Slow(2)") + "Function Slow(n)\nMove P, P1\nDelay 40\nSlow = n\nEnd Function\n"
    assert run(source, world, budget=1).state is MachineState.DONE
    assert values(world) == {"I1": 3}
    assert world.seconds >= 0.04


def test_constants_outside_of_subs_are_global():
    source = "Sub Main\nI1 = LIMIT\nOther\nEnd Sub\nConst LIMIT = 5\nSub Other\nI2 = LIMIT * 2\nEnd Sub\n"
    world = FakeWorld()
    run(source, world)
    assert values(world) == {"I1": 5, "I2": 10}


# --- motions and commands ---------------------------------------------------------------------------------------------


def test_pose_variables_are_evaluated_when_the_motion_begins():
    world = after("Dim a As Position", "P1 = P(1, 2, 3)", "a = P1", "Move P, P1, a", "Move L, P[1]")
    target = Target("P", (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, -1.0))
    assert world.log == [("move", 1, target, PLAIN), ("move", 1, target, PLAIN), ("move", 2, target, PLAIN)]


MOTIONS = {
    "Move P, @E P1": ("move", 1, Target("P", ZERO_P, AT_ENCODER), PLAIN),
    "Move PTP, @0 J1": ("move", 1, Target("J", (0.0,) * 8, AT_COMMAND), PLAIN),
    "Move L, @20 T1": ("move", 2, Target("T", (*(0.0,) * 9, -1.0), PassMark("n", 20.0)), PLAIN),
    "Move L, @(I1 + 5) P1": ("move", 2, Target("P", ZERO_P, PassMark("n", 5.0)), PLAIN),
    "Move C, P1, @P P2": ("move", 3, Target("P", ZERO_P), Target("P", ZERO_P, PASSING), PLAIN),
    "Move S, 2": ("move", 4, Target("", (2.0,)), PLAIN),
    "Move P, P1 Ex((7, 10), (8, 20))": ("move", 1, Target("P", ZERO_P, None, Extra(False, ((7, 10.0), (8, 20.0)))), PLAIN),
    "Move P, P1 ExA(7, 10)": ("move", 1, Target("P", ZERO_P, None, Extra(True, ((7, 10.0),))), PLAIN),
    "Move P, P1 ExA(J(1,2,3,4,5,6,7,8))": (
        "move", 1, Target("P", ZERO_P, None, Extra(True, ((7, 7.0), (8, 8.0)))), PLAIN),
    "Move P, P1, Speed = 50, Accel = 40, Decel = 30, Time = 200, Next": (
        "move", 1, Target("P", ZERO_P), MotionOptions(50.0, 40.0, 30.0, 200.0, next=True)),
    "Move P, P1, S = 25 * 2": ("move", 1, Target("P", ZERO_P), MotionOptions(50.0)),
    "Approach P, P1, 50": ("approach", 1, Target("P", ZERO_P), 50.0, None, PLAIN),
    "Approach L, J1, @P 40 Ex(7, 10), Speed = 30": (
        "approach", 2, Target("J", (0.0,) * 8, None, Extra(False, ((7, 10.0),))), 40.0, PASSING, MotionOptions(30.0)),
    "Depart L, @E 50": ("depart", 2, 50.0, AT_ENCODER, PLAIN),
    "Drive (1, 10), (2, -5)": ("drive", ((1, 10.0), (2, -5.0)), False, None, PLAIN),
    "Drive(7, 50), (7, 100)": ("drive", ((7, 100.0),), False, None, PLAIN),
    "DriveA @P (1, J(30, 40)), (2, J(30, 40)), Next": (
        "drive", ((1, 30.0), (2, 40.0)), True, PASSING, MotionOptions(next=True)),
    "DriveA J(1, 2)": ("drive", tuple((n, float(n) if n < 3 else 0.0) for n in range(1, 9)), True, None, PLAIN),
    "Rotate XY, 45": ("rotate", "XY", 45.0, None, PLAIN),
    "Rotate yz, @E -45, V(1, 2, 3), Pose = 1, Speed = 20": (
        "rotate", "YZ", -45.0, Target("V", (1.0, 2.0, 3.0)), MotionOptions(20.0, mark=AT_ENCODER, pose=1)),
    "RotateH @P 30": ("rotate", "XYH", 30.0, Target("V", (0.0, 0.0, 0.0)), MotionOptions(mark=PASSING, pose=1)),
    "TakeArm": ("take_arm", 0, False),
    "TakeArm Keep = 1": ("take_arm", 0, True),
    "TakeArm 2 Keep = 0": ("take_arm", 2, False),
    "TakeArm 2, Keep = True": ("take_arm", 2, True),
    "GiveArm": ("give_arm",),
    "Motor On": ("motor", True),
    "Motor False": ("motor", False),
    "Speed 50": ("speed", 50.0),
    "Accel 50": ("accel", 50.0, None),
    "Accel 50, 40": ("accel", 50.0, 40.0),
    "Decel 30": ("accel", None, 30.0),
    "ExtSpeed 20": ("ext_speed", 20.0, None, None),
    "ExtSpeed 20, 4, 5": ("ext_speed", 20.0, 4.0, 5.0),
    "ChangeTool 1": ("change_tool", 1),
    "ChangeWork I1 + 2": ("change_work", 2),
}  # fmt: skip


@pytest.mark.parametrize(("line", "call"), MOTIONS.items(), ids=MOTIONS)
def test_commands_call_the_host_interface(line, call):
    assert after(line).log == [call]


@pytest.mark.parametrize("line", ["Move P, P1", "Motor On", "Depart L, 50", "Drive (1, 1)", "Rotate XY, 1"])
def test_a_program_waits_for_a_motion(line):
    world = FakeWorld(polls=2)
    machine = Machine(compile_program(body(line, "I1 = 1"), "f"), world)
    assert machine.run(100) == 1
    assert (machine.state, machine.line, world.values) == (MachineState.WAITING, 2, {})
    assert machine.run(100) == 0
    assert machine.state is MachineState.WAITING
    assert machine.run(100) == 2
    assert machine.state is MachineState.DONE
    assert values(world) == {"I1": 1}


def test_next_does_not_wait():
    world = FakeWorld()
    machine = Machine(compile_program(body("Move P, P1, Next", "I1 = 1"), "f"), world)
    machine.run(2)
    assert values(world) == {"I1": 1}


def test_delay_waits_for_its_time():
    world = FakeWorld()
    machine = Machine(compile_program(body("Delay 100", "I1 = 1"), "f"), world)
    machine.run(10)
    world.seconds = 0.099
    machine.run(10)
    assert (machine.state, machine.line) == (MachineState.WAITING, 2)
    world.seconds = 0.1
    machine.run(10)
    assert machine.state is MachineState.DONE


def test_a_delay_of_zero_does_not_wait():
    machine = Machine(compile_program(body("Delay 0", "I1 = 1"), "f"), FakeWorld())
    assert machine.run(10) == 3
    assert machine.state is MachineState.DONE


def test_wait_until_an_input_is_on():
    world = FakeWorld()
    machine = Machine(compile_program(body("Wait IO[5] = On, 1000, I1"), "f"), world)
    machine.run(10)
    assert machine.state is MachineState.WAITING
    world.write_io("IO", 5, 1)
    machine.run(10)
    assert machine.state is MachineState.DONE
    assert values(world) == {"I1": -1}


def test_wait_until_the_timeout():
    world = FakeWorld()
    machine = Machine(compile_program(body("I1 = 7", "Wait IO[5] = On, 1000, I1"), "f"), world)
    machine.run(10)
    world.seconds = 0.999
    machine.run(10)
    assert machine.state is MachineState.WAITING
    world.seconds = 1.0
    machine.run(10)
    assert machine.state is MachineState.DONE
    assert values(world) == {"I1": 0}


def test_messages():
    world = after('PrintMsg "done", 2, "Title"', "PrintMsg 1 + 1", 'PrintDbg "I1 =", I1, P1, 0.1, V(1, 2.5, -3)')
    assert world.shown == [
        ("msg", "done", "Title"),
        ("msg", "2", ""),
        ("dbg", "I1 = 0 P(0, 0, 0, 0, 0, 0, -1) 0.1 V(1, 2.5, -3)", ""),
    ]


def test_numbers_of_single_precision_are_printed_with_few_digits():
    assert after("F1 = 0.1", "PrintDbg F1, F1 * 2, 1e20, 1 / 3").shown == [
        ("dbg", "0.1 0.2 1e+20 0.3333333333333333", "")
    ]


def test_hold_waits_until_the_program_is_started_again():
    world = FakeWorld()
    machine = Machine(compile_program(body("Hold", "I1 = 1"), "f"), world)
    machine.run(10)
    assert machine.state is MachineState.WAITING
    world.held = False
    machine.run(10)
    assert machine.state is MachineState.DONE


def test_the_timer_counts_milliseconds():
    assert after("I1 = Timer", seconds=12.3456).values == {("I", 1): 12345}


def test_random_numbers_are_the_same_after_every_start():
    world = FakeWorld()
    machine = Machine(compile_program(body("D1 = Rnd", "D2 = Rnd()"), "f"), world)
    machine.run(10)
    first = values(world)
    assert first["D1"] != first["D2"]
    assert all(0 <= number < 1 for number in world.values.values())
    machine.restart()
    machine.run(10)
    assert values(world) == first


# --- the machine ------------------------------------------------------------------------------------------------------


def test_a_budget_is_kept():
    machine = Machine(compile_program(body("Do", "I1 = I1 + 1", "Loop"), "f"), world := FakeWorld())
    assert machine.run(0) == 0
    assert machine.run(11) == 11
    assert values(world) == {"I1": 6}
    assert machine.state is MachineState.RUNNING
    assert machine.line == 4


def test_lines_while_stepping():
    source = body("I1 = 1", "", "If I1 = 1 Then", "I2 = f(1) + f(2)", "Else", "I3 = 1", "End If", "Move P, P1, P2")
    source += "Function f(n)\nf = n\nEnd Function\n"
    machine = Machine(compile_program(source, "f"), world := FakeWorld(polls=1))
    lines = []
    while machine.state in (MachineState.RUNNING, MachineState.WAITING):
        if machine.state is MachineState.RUNNING:
            lines.append(machine.line)
        machine.step()
    assert lines == [2, 4, 5, 12, 13, 12, 13, 9, 10]
    assert values(world) == {"I1": 1, "I2": 3}
    assert set(lines) <= set(machine.program.lines)


def test_a_step_that_waits_ends_when_the_wait_is_over():
    machine = Machine(compile_program(body("Move P, P1", "I1 = 1"), "f"), FakeWorld(polls=1))
    machine.step()
    assert (machine.state, machine.line) == (MachineState.WAITING, 2)
    machine.step()
    assert (machine.state, machine.line) == (MachineState.RUNNING, 3)


def test_restart_begins_main_again():
    machine = Machine(
        compile_program(body("Dim a As Integer", "a = a + 1", "I1 = a", "I2 = I2 + 1"), "f"), world := FakeWorld()
    )
    for cycle in (1, 2):
        machine.run(100)
        assert machine.state is MachineState.DONE
        assert values(world) == {"I1": 1, "I2": cycle}
        machine.restart()
    assert (machine.state, machine.line) == (MachineState.RUNNING, 3)


def test_after_an_interruption_the_statement_is_executed_again():
    machine = Machine(compile_program(body("Move P, P1", "I1 = 1"), "f"), world := FakeWorld())
    machine.run(10)
    machine.cancel_wait()
    assert (machine.state, machine.line) == (MachineState.RUNNING, 2)
    machine.run(10)
    assert [call[0] for call in world.log] == ["move", "move"]


def test_a_program_is_run_by_any_number_of_machines():
    program = compile_program(body("Dim a(1) As Integer", "a(1) = a(1) + 1", "I1 = I1 + a(1)", "Delay 10"), "f")
    worlds = FakeWorld(), FakeWorld()
    machines = [Machine(program, world) for world in worlds]
    for machine in machines:
        machine.run(100)
    assert [values(world) for world in worlds] == [{"I1": 1}, {"I1": 1}]


def test_an_invalid_index_is_a_fault_with_the_controllers_code():
    machine = run(body("I1 = 1", "IO[9999] = On"))
    assert machine.fault is not None
    assert machine.fault.code == hresult.VARIABLE_INDEX_INVALID


# --- the samples ------------------------------------------------------------------------------------------------------


def test_the_sample_that_picks_and_places():
    world = FakeWorld()
    world.write("I", 10, 4)
    assert run(sample_programs()["Pro1.pcs"], world).state is MachineState.DONE
    assert values(world) == {"I10": 5}
    assert world.points == 1 << 129
    assert [call[0] for call in world.log if call[0] not in ("convert", "speed")] == [
        "take_arm", "move", "approach", "move", "depart", "approach", "move", "depart", "move", "give_arm",
    ]  # fmt: skip


def test_the_sample_that_calculates_a_pallet():
    world = FakeWorld()
    assert run(sample_programs()["Pro2.pcs"], world).state is MachineState.DONE
    assert world.values.pop(("S", 1)) == "12 places, pitch 40 x 60 mm"
    assert world.values == {
        ("P", 20 + row * 4 + column): (320.0 + 40 * row, -90.0 + 60 * column, 250.0, 180.0, 0.0, 180.0, 5.0)
        for row in range(3)
        for column in range(4)
    }
    assert world.log == []


def hand_over(world: FakeWorld) -> None:
    """Simulate parts: one arrives when the program is ready and is removed when it is not."""
    world.write_io("IO", 130, world.read_io("IO", 131))


def test_the_sample_that_receives_parts():
    world = FakeWorld(on_poll=hand_over)
    assert run(sample_programs()["Pro3.pcs"], world).state is MachineState.DONE
    assert values(world) == {"I11": 3, "I12": 0, "S2": "complete"}
    assert world.read_io("IO", 131) == 0


def test_the_sample_when_no_part_arrives():
    world = FakeWorld()
    assert run(sample_programs()["Pro3.pcs"], world).state is MachineState.DONE
    assert values(world) == {"I11": 0, "I12": 2, "S2": "timed out"}
    assert world.points == 0
    assert 4.0 <= world.seconds < 4.1
