from __future__ import annotations

import pickle

import pytest

from orinkit.core import hresult, i18n
from orinkit.virtual.rc8.pacscript.compiler import compile_program
from orinkit.virtual.rc8.pacscript.errors import ProgramFault, ProgramLoadError
from orinkit.virtual.rc8.pacscript.machine import MachineState
from support.pacscript_world import FakeWorld, body, run

LONG_LINE = "I1 = 1 ' " + "x" * 1020

# lines of Sub Main, from line 2; line and column of the error; its message
WRONG = [
    (["I1 ="], 2, 5, "unexpected end of line"),
    (["I1 = (1"], 2, 8, 'unexpected end of line; ")" may be missing'),
    (["If I1 = 1", "End If"], 2, 10, 'unexpected end of line; "Then" may be missing'),
    (["For I1 = 1"], 2, 11, 'unexpected end of line; "To" may be missing'),
    (["I1 = 1 2"], 2, 8, "unexpected 2"),
    (["I1 = 5x"], 2, 6, "5x is not a number"),
    (["I1 = 1e999"], 2, 6, "1e999 is too large"),
    (["I1 = &H100000000"], 2, 6, "&H100000000 is too large"),
    (['S1 = "abc'], 2, 6, "the string has no closing quotation mark"),
    (["I1 = 1 ; 2"], 2, 8, "unexpected character ;"),
    (["I1 = \x07"], 2, 6, "unexpected character U+0007"),
    (["a = 1"], 2, 1, "a is not declared"),
    (["I1 = 1 + nothing"], 2, 10, "nothing is not declared"),
    (["I1 = nothing(1)"], 2, 6, "unknown array or Function nothing"),
    (["Nothing 1"], 2, 1, "unknown command, Sub or Function Nothing"),
    (["Nothing[1] = 1"], 2, 1, "Nothing[ ] is not a global variable. Try: Nothing( ) for an element of an array"),
    (["Dim a As Integer", "Dim A As Single"], 3, 5, "A is declared twice"),
    (["Dim a As Real"], 2, 10, "unknown type Real"),
    (["Dim P1 As Position"], 2, 5, "P1 cannot be declared: it is the name of a global variable"),
    (["Dim Speed As Single"], 2, 5, "Speed cannot be declared: it is a reserved word of PacScript"),
    (["Dim a(1, 1, 1, 1)"], 2, 5, "a: an array may have at most 3 dimensions"),
    (["Dim a(-1)"], 2, 7, "the highest index of an array must be 0 to 99999"),
    (["Dim a(99999), b(0)"], 2, 15, "b: the arrays of a Sub may have at most 100000 elements in total"),
    (["Dim a(I1)"], 2, 7, "expected a constant"),
    (["Dim a(1) As Integer = 1"], 2, 23, "an array cannot be initialised in Dim"),
    (["Dim a(1)", "I1 = a"], 3, 6, "a is an array. Try: an element, a(0)"),
    (["Dim a(1)", "a = 1"], 3, 1, "a is an array; only an element can be used here"),
    (["Dim a(1)", "a(1, 2) = 1"], 3, 1, "wrong number of arguments for a: 2, expected 1"),
    (["Const a = 1", "a = 2"], 3, 1, "the constant a cannot be changed"),
    (["True = 1"], 2, 1, "the constant True cannot be changed"),
    (['Const a As Integer = "x"'], 2, 22, "expected a number, got a string"),
    (["Dim a", "a(1) = 2"], 3, 1, "a is not an array"),
    (["Dim a", "I1 = a(1)"], 3, 6, "unknown array or Function a"),
    (['I1 = I["a"]'], 2, 8, "expected a number, got a string"),
    (["Wait I1 = 1, 10, 5"], 2, 18, "expected a variable"),
    (["I[1]"], 2, 1, "expected the name of a Sub"),
    (["Foo(1, 2), 3"], 2, 1, "unexpected comma"),
    (["Goto *1"], 2, 6, "* must be followed by the name of a label"),
    (["I1 = Sin()"], 2, 6, "wrong number of arguments for Sin: 0, expected 1"),
    (['S1 = Mid("a")'], 2, 6, "wrong number of arguments for Mid: 1, expected 2 to 3"),
    (["Delay"], 2, 1, "wrong number of arguments for Delay: 0, expected 1"),
    (["Next"], 2, 1, "Next without For"),
    (["Loop"], 2, 1, "Loop without Do"),
    (["Wend"], 2, 1, "Wend without While"),
    (["End If"], 2, 1, "End If without If"),
    (["Else"], 2, 1, "Else without If"),
    (["Case 1"], 2, 1, "Case without Select Case"),
    (["Exit For"], 2, 1, "Exit For without For"),
    (["Exit Function"], 2, 1, "Exit Function without Sub"),
    (["Return"], 2, 1, "Return without Gosub"),
    (["Dim i, j", "For i = 0 To 1", "Next j"], 4, 1, "Next j does not match For i in line 3"),
    (["If I1 Then", "I1 = 0"], 4, 1, "unexpected End Sub: the If in line 2 has no End If"),
    (["Do", "If I1 Then", "Loop"], 4, 1, "unexpected Loop: the If in line 3 has no End If"),
    (["Do", "For I1 = 0 To 1", "Loop"], 4, 1, "unexpected Loop: the For in line 3 has no Next"),
    (["Select Case I1", "Case 1"], 4, 1, "unexpected End Sub: the Select Case in line 2 has no End Select"),
    (["Select Case I1", "I1 = 0", "End Select"], 3, 1, "the Select Case in line 2 must begin with a Case"),
    (["Select Case I1", "Case Else", "Case 1", "End Select"], 4, 1,
     "Case after the Case Else of the Select Case in line 2"),
    (["If I1 Then", "Else", "ElseIf I2 Then", "End If"], 4, 1, "ElseIf after the Else of the If in line 2"),
    (["Do While I1", "Loop Until I2"], 3, 1, "the Do in line 2 already has a condition"),
    (["Goto *nowhere"], 2, 6, "unknown label nowhere in this Sub"),
    (["*a:", "*a:"], 3, 1, "label a is declared twice"),
    (["Goto *inside", "Do", "*inside:", "Loop"], 2, 6,
     "cannot jump to label inside inside the Do in line 3"),
    (["Gosub *inside", "If I1 Then", "*inside:", "End If"], 2, 7,
     "cannot jump to label inside inside the If in line 3"),
    (["Move"], 2, 5, "unexpected end of line"),
    (["Move P1"], 2, 6, "the first argument of Move must be one of P, L, C, S"),
    (["Move P"], 2, 1, "Move requires a pose"),
    (["Move C, P1"], 2, 1, "Move requires a relay pose and a target"),
    (["Move P, @X P1"], 2, 10, "a pass mark must be @0, @P, @E or @ with a radius in mm"),
    (["Move P, P1, Force = 5"], 2, 13, "Force is not an option of Move"),
    (["Move P, Speed = 5, P1"], 2, 20, "poses must come before options"),
    (["Approach C, P1, 50"], 2, 10, "the first argument of Approach must be one of P, L"),
    (["Approach P, P1"], 2, 1, "Approach requires a pose and a length"),
    (["Approach P, @P P1, 50"], 2, 14, "the pass mark of Approach must precede the length"),
    (["Drive 1, 10"], 2, 7, "expected a joint and a value, for example (1, 10)"),
    (["Drive (1, 10), @P (2, 20)"], 2, 17, "a pass mark is not allowed here"),
    (["Drive (1, 10) Ex(7, 1)"], 2, 15, "Ex and ExA are not allowed here"),
    (["Rotate (V1, V2, V3), 45"], 2, 9, "Rotate in a plane given by three points is not supported"),
    (["Rotate XY, 45, @P V1"], 2, 1, "the pass mark of Rotate must precede the angle"),
    (["Rotate XX, 45"], 2, 8, "the plane of Rotate must be one of XY, YZ, ZX, XYH, YZH, ZXH"),
    (["Rotate XYH, 45"], 2, 1, "Rotate XYH requires a pivot"),
    (["Rotate XY, 45, V1, Static = True"], 2, 20, "Rotate Static = is not supported"),
    (["Set I1"], 2, 5, "expected an I/O point, for example IO[128], not I1"),
    (["I1 = (1, 2)"], 2, 7, "a list in parentheses is not allowed here"),
    (["Sub Inner", "End Sub"], 2, 1, "unexpected Sub: the Sub in line 1 has no End Sub"),
    ([LONG_LINE], 2, 1, "the line has more than 1024 bytes"),
]  # fmt: skip


@pytest.mark.parametrize(("lines", "line", "column", "message"), WRONG, ids=[row[3][:40] for row in WRONG])
def test_a_compile_error_has_its_position(lines, line, column, message):
    with pytest.raises(ProgramLoadError) as caught:
        compile_program(body(*lines), "Pro1.pcs")
    error = caught.value
    assert (error.message, error.line, error.column) == (message, line, column)
    assert error.file == "Pro1.pcs"
    assert error.code == hresult.SYNTAX_ERROR
    assert str(error) == f"Pro1.pcs:{line}:{column}: {message}"


@pytest.mark.parametrize(
    ("source", "line", "column", "message"),
    [
        ("", 1, 1, "the program has no Sub Main"),
        ("Function Main\nEnd Function\n", 1, 1, "the program has no Sub Main"),
        ("Sub Main(a)\nEnd Sub\n", 1, 5, "Sub Main cannot have parameters"),
        ("Sub Main\nI1 = 1\n", 1, 1, "Sub has no End Sub"),
        ("Sub Main\nEnd Function\n", 2, 1, "unexpected End Function: the Sub in line 1 has no End Sub"),
        ("I1 = 1\nSub Main\nEnd Sub\n", 1, 1, "a statement must be in a Sub or Function"),
        ("Sub Main\nEnd Sub\nSub main\nEnd Sub\n", 3, 5, "main is declared twice"),
        ("Const c = 1\nSub Main\nDim c\nEnd Sub\n", 3, 5, "c is declared twice"),
        ("Sub Main\nfoo 1\nEnd Sub\nSub Foo(a, b)\nEnd Sub\n", 2, 1, "wrong number of arguments for Foo: 1, expected 2"),
        ("Sub Main\nI1 = foo(1)\nEnd Sub\nSub Foo(a)\nEnd Sub\n", 2, 6, "foo is a Sub and returns no value"),
        ("Sub Main\nWait foo(1) > 1\nEnd Sub\nFunction Foo(a)\nEnd Function\n", 2, 6,
         "Foo cannot be called in the condition of Wait"),
        ("Sub Main\nDim s As Single\nfoo s\nEnd Sub\nSub Foo(ByRef a As Integer)\nEnd Sub\n", 3, 5,
         "parameter a of Foo is ByRef and requires a variable of type Integer"),
        ("Sub Main\nFork Other\nEnd Sub\n", 2, 1, "Fork is not supported"),
    ],
)  # fmt: skip
def test_an_error_of_the_whole_file_has_its_position(source, line, column, message):
    with pytest.raises(ProgramLoadError) as caught:
        compile_program(source, "f")
    assert (caught.value.message, caught.value.line, caught.value.column) == (message, line, column)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("Run Pro2", "Run"),
        ("kill Pro2", "Kill"),
        ("Suspend Pro2", "Suspend"),
        ("ONERR goto *x", "OnErr"),
        ("On Error Goto x", "On"),
        ("Interrupt On", "Interrupt"),
        ("Print #1, S1", "Print"),
        ("Comm.Open 1", "Comm.Open"),
        ("SyncTimeStart", "SyncTimeStart"),
        ("Draw L, V1", "Draw"),
        ("ArchMove P1, 10", "ArchMove"),
        ("JSpeed 50", "JSpeed"),
        ("MoveBackTraceLog 1", "MoveBackTraceLog"),
        ("Static a As Integer", "Static"),
        ("DefIO a = Bit, 128", "DefIO"),
        ("Repeat", "Repeat"),
        ("Robot0.SetHoming 7, 100", "Robot0.SetHoming"),
        ("#Include <a.h>", "#Include"),
        ("#define A 1", "#Define"),
        ("I1 = CurPosEx()", "CurPosEx"),
        ("I1 = CurErr()", "CurErr"),
        ("IOF[1] = 1", "IOF"),
        ("I1 = IOF[1]", "IOF"),
        ("Call Run(1)", "Run"),
    ],
)
def test_unsupported_words_are_rejected_by_name(line, word):
    with pytest.raises(ProgramLoadError) as caught:
        compile_program(body(line), "f")
    assert caught.value.message == f"{word} is not supported"
    assert caught.value.line == 2


def test_errors_are_in_japanese_too():
    i18n.use("ja")
    with pytest.raises(ProgramLoadError) as caught:
        compile_program(body("OnErr Goto *x"), "f")
    assert caught.value.message == "OnErr には対応していません"


def test_a_program_that_is_too_long_is_rejected():
    with pytest.raises(ProgramLoadError, match="more than 262144 characters"):
        compile_program("\n" * 262_145, "f")


# --- run-time errors --------------------------------------------------------------------------------------------------

OUT_OF_RANGE = hresult.VALUE_OUT_OF_RANGE
MISMATCH = hresult.VARIABLE_CHANGE_FAILED
FAULTS = [
    (["I[100] = 1"], 2, hresult.GLOBAL_VARIABLE_OUT_OF_RANGE, "100"),
    (["I1 = -1", "I2 = I[I1]"], 3, hresult.GLOBAL_VARIABLE_OUT_OF_RANGE, "-1"),
    (["IO[512] = On"], 2, hresult.VARIABLE_INDEX_INVALID, "512"),
    (["I1 = 1 / I2"], 2, OUT_OF_RANGE, "division by zero"),
    (["I1 = 1 \\ I2"], 2, OUT_OF_RANGE, "division by zero"),
    (["I1 = 1 Mod 0"], 2, OUT_OF_RANGE, "division by zero"),
    (["I1 = 2147483647", "I1 = I1 + 1"], 3, OUT_OF_RANGE, "the number is too large for its type"),
    (["I1 = 100000 * 100000"], 2, OUT_OF_RANGE, "the number is too large for its type"),
    (["I1 = 3e9"], 2, OUT_OF_RANGE, "the number is too large for its type"),
    (["F1 = 1e39"], 2, OUT_OF_RANGE, "the number is too large for its type"),
    (["D1 = 1e308 * 10"], 2, OUT_OF_RANGE, "the number is too large for its type"),
    (["D1 = 10 ^ 1000"], 2, OUT_OF_RANGE, "10 ^ 1000 is undefined or too large"),
    (["D1 = (-1) ^ 0.5"], 2, OUT_OF_RANGE, "-1 ^ 0.5 is undefined or too large"),
    (["D1 = Sqr(-1)"], 2, OUT_OF_RANGE, "the function is undefined for -1"),
    (["I1 = 1 << 32"], 2, OUT_OF_RANGE, "the shift count 32 is not in -31 to 31"),
    (['I1 = "a"'], 2, MISMATCH, "expected a number, got a string"),
    (["S1 = 1"], 2, MISMATCH, "expected a string, got a number"),
    (["P1 = J1"], 2, MISMATCH, "expected P, got J"),
    (["I1 = P1 + J1"], 2, MISMATCH, "P and J cannot be added or subtracted"),
    (["I1 = P1 * 2"], 2, MISMATCH, "P and a number cannot be multiplied"),
    (['If I1 = "a" Then I2 = 1'], 2, MISMATCH, "a number and a string cannot be compared"),
    (["If P1 < P2 Then I2 = 1"], 2, MISMATCH, "poses can only be compared with = and <>"),
    (["If S1 Then I2 = 1"], 2, MISMATCH, "expected a number, got a string"),
    (["D1 = PosX(J1)"], 2, MISMATCH, "expected P, T, V, got J"),
    (["Dim a(3)", "I1 = a(4)"], 3, hresult.DISP_E_BADINDEX, "index 4 of a is out of range: 0..3"),
    (["Dim a(1, 2)", "a(1, -1) = 0"], 3, hresult.DISP_E_BADINDEX, "index -1 of a is out of range: 0..1, 0..2"),
    (["S1 = \"" + "x" * 255 + '"', 'S1 = S1 + "y"'], 3, hresult.STRING_TOO_LONG, ""),
    (["Dim s As String", 's = "x"', "Do", "s = s & s", "Loop"], 5, hresult.STRING_TOO_LONG, "the string has more than 4096 characters"),
    (["Delay -1"], 2, OUT_OF_RANGE, "the time is negative: -1 ms"),
    (["Speed 0"], 2, OUT_OF_RANGE, "a percentage must be above 0 and at most 100, not 0"),
    (["Move P, P1, Speed = 101"], 2, OUT_OF_RANGE, "a percentage must be above 0 and at most 100, not 101"),
    (["Move P, P1, Time = 0"], 2, OUT_OF_RANGE, "invalid duration of a motion: 0 ms"),
    (["Move P, V1"], 2, MISMATCH, "expected P, J, T, got V"),
    (["Move P, P1 Ex((6, 1))"], 2, OUT_OF_RANGE, "joint 6 is not an extended joint (7 or 8)"),
    (["Drive (9, 1)"], 2, OUT_OF_RANGE, "joint 9 is not in 1 to 8"),
    (["I1 = Joint(0, J1)"], 2, OUT_OF_RANGE, "joint 0 is not in 1 to 8"),
    (['S1 = Mid("abc", 0)'], 2, OUT_OF_RANGE, "position 0 is less than 1"),
    (["Move P, @(I1 - 1) P1"], 2, OUT_OF_RANGE, "the radius of a pass mark is negative: -1 mm"),
    (["Rotate XY, 45, V1, Pose = 3"], 2, OUT_OF_RANGE, "Pose must be 1 or 2, not 3"),
    (['S1 = Left("a", -1)'], 2, OUT_OF_RANGE, "the number of characters is negative: -1"),
    (["S1 = Chr(256)"], 2, OUT_OF_RANGE, "256 is not a character code"),
    (['I1 = Asc("")'], 2, OUT_OF_RANGE, "the string is empty"),
    (['I1 = Asc("\U0001f600")'], 2, OUT_OF_RANGE, "the character has no code in Shift_JIS"),
    (["I1 = -2147483647", "I1 = I1 - 2"], 3, OUT_OF_RANGE, "the number is too large for its type"),
    (["*a:", "Gosub *a", "Return"], 3, OUT_OF_RANGE, "Gosub is nested more than 64 deep"),
    (["Goto *b", "*a:", "Gosub *b", "*b:", "Return"], 6, OUT_OF_RANGE, "Return without Gosub"),
]  # fmt: skip


@pytest.mark.parametrize(("lines", "line", "code", "detail"), FAULTS, ids=[row[0][-1][:30] for row in FAULTS])
def test_a_fault_has_its_line_and_code(lines, line, code, detail):
    machine = run(body(*lines))
    assert machine.state is MachineState.FAULT
    fault = machine.fault
    assert fault is not None
    assert (fault.code, fault.line, fault.detail) == (code, line, detail)
    assert machine.line == line
    assert fault.file == "Pro1.pcs"
    assert machine.run(10) == 0


def test_recursion_is_bounded():
    machine = run("Sub Main\nI1 = deep(0)\nEnd Sub\nFunction deep(ByVal n)\nI2 = n\ndeep = deep(n + 1)\nEnd Function\n")
    assert machine.fault is not None
    assert (machine.fault.code, machine.fault.line) == (OUT_OF_RANGE, 6)
    assert machine.fault.detail == "calls are nested more than 64 deep"


def test_the_arrays_of_all_active_calls_are_bounded():
    machine = run("Sub Main\ndeep\nEnd Sub\nSub deep\nDim a(29999)\ndeep\nEnd Sub\n")
    assert machine.fault is not None
    assert (machine.fault.code, machine.fault.line) == (hresult.E_OUTOFMEMORY, 6)


@pytest.mark.parametrize(
    ("line", "method"),
    [
        ("TakeArm", "take_arm"),
        ("Move P, P1", "move"),
        ("Move P, P1", "move wait"),
        ("Motor On", "motor wait"),
        ("ChangeTool 1", "change_tool"),
        ("Wait CurFig = 1", "current"),
    ],
)
def test_an_error_of_the_controller_is_a_fault_with_its_code(line, method):
    machine = run(body("I1 = 1", line, "I1 = 2"), FakeWorld(refuses={method: hresult.ARM_NOT_TAKEN}))
    assert machine.fault is not None
    assert (machine.fault.code, machine.fault.line) == (hresult.ARM_NOT_TAKEN, 3)


def test_a_pose_with_nan_is_a_fault():
    world = FakeWorld()
    world.values["P", 1] = (float("nan"), *(0.0,) * 6)
    machine = run(body("Move P, P1"), world)
    assert machine.fault is not None
    assert (machine.fault.code, machine.fault.line) == (OUT_OF_RANGE, 2)


def test_a_fault_while_waiting_ends_the_program():
    world = FakeWorld()
    world.on_poll = lambda world: world.refuses.update({"move wait": hresult.STOPPING_MOTION})
    machine = run(body("Move P, P1", "I1 = 1"), world)
    assert machine.state is MachineState.FAULT
    assert machine.fault is not None
    assert machine.fault.code == hresult.STOPPING_MOTION
    machine.restart()
    assert machine.state is MachineState.RUNNING
    assert machine.fault is None


def test_both_errors_can_be_pickled():
    error = pickle.loads(pickle.dumps(ProgramLoadError("m", "f", 2, 3)))
    assert (error.message, error.file, error.line, error.column) == ("m", "f", 2, 3)
    fault = pickle.loads(pickle.dumps(ProgramFault(0x83500002, "f", 4, "d")))
    assert (fault.code, fault.file, fault.line, fault.detail) == (0x83500002, "f", 4, "d")


def test_a_fault_as_a_string():
    fault = ProgramFault(0x83500002, "Pro1.pcs", 4, "division by zero")
    assert str(fault) == "Pro1.pcs:4: 0x83500002 VALUE_OUT_OF_RANGE: Value out of range [division by zero]"
