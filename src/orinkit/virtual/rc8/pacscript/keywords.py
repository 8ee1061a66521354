"""The words of PacScript: keywords of the grammar, words that start a command, and unsupported words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from orinkit.virtual.rc8.pacscript.robot_words import STATEMENTS

_KEYWORDS: Final = """
    and as byref byval call case const dim do else elseif end exit for function gosub goto if is let loop mod next not
    or return select step sub then to until wend while xor
"""
KEYWORDS: Final[Mapping[str, str]] = {word: word.upper() for word in _KEYWORDS.split()} | {"endif": "END_IF"}
"""Keywords that are reserved at any position, each with the name of its token."""

PAIRS: Final[Mapping[tuple[str, str], str]] = {
    ("end", "sub"): "END_SUB",
    ("end", "function"): "END_FUNCTION",
    ("end", "if"): "END_IF",
    ("end", "select"): "END_SELECT",
    ("exit", "sub"): "LEAVE",
    ("exit", "function"): "LEAVE",
    ("exit", "for"): "LEAVE",
    ("exit", "do"): "LEAVE",
    ("select", "case"): "SELECT_CASE",
    ("case", "else"): "CASE_ELSE",
}
"""Pairs of words that form one token."""

_COMMANDS: Final = "accel changetool changework decel delay extspeed givearm hold motor printdbg printmsg speed wait"
STARTERS: Final[Mapping[str, str]] = (
    dict.fromkeys(("move", "approach", "depart", "drive", "drivea", "rotate", "rotateh"), "MOTION")
    | dict.fromkeys(_COMMANDS.split(), "COMMAND")
    | dict.fromkeys((word.lower() for word in STATEMENTS), "COMMAND")
    | dict.fromkeys(("set", "reset"), "POINT")
    | dict.fromkeys(("letx", "lety", "letz", "letrx", "letry", "letrz", "letf"), "LETPART")
    | {"letj": "LETJOINT", "takearm": "TAKEARM", "public": "PUBLIC"}
)
"""Words that are commands at the start of a statement, each with the name of its token."""

_TYPES: Final = "integer long single double string position joint trans vector variant boolean"
TYPES: Final = frozenset(_TYPES.split())
"""Types that may follow As."""

CONSTANTS: Final[Mapping[str, int | float]] = {"true": -1, "false": 0, "on": 1, "off": 0, "pi": 3.141592653589793}
"""Predefined constants."""

GLOBAL_KINDS: Final = frozenset("IFDVPJTS")
POINT_KINDS: Final = frozenset(("IO", "IOB", "IOW", "IOD"))
"""The classes of I/O points; :data:`GLOBAL_KINDS` contains the classes of global variables."""
NUMBERED: Final = re.compile(r"(IO[BWD]?|[IFDVPJTS])([0-9]{1,9})", re.IGNORECASE | re.ASCII)
"""Matches the name of a global variable or of an I/O point, for example ``P12`` or ``IO128``."""

_REFUSED_WORDS: Final = """
    AddPathPoint ArchMove AreaPos BasePos Buzzer CalcBackTraceLog Chuck ClearLog ClearMsg ClearServoLog ClrErr
    ClrPathPoint Com_Discom Com_Encom Com_State Comm ContinueRun ContinueStartAll CPMode Create_Sem CreateSem
    CurCPMode CurErr CurJntEx CurPayload CurPosEx CurTrnEx Date DefArea DefDbl DefInt DefIO DefJnt DefPos DefSng
    DefStr DefTrn DefVec Delete_Sem DeleteSem DestJntEx DestPosEx DestTrnEx Draw ErrMsg ExtAccel ExtDecel Extern
    Flush Flush_Sem FlushSem Fork GenerateNonStopPath GetCtrlLogInterval GetCtrlLogMaxTime GetErrLvl GetHandIO
    GetJntData GetPathPoint GetPathPointCount GetRobotTypeName GetSrvState GetTime Give_Sem GiveSem GiveVis GoHome
    Halt HighCurJntEx HighCurPosEx HighCurTrnEx In Input InputBox Interrupt IOBlock IOF JAccel JDecel Join JSpeed
    Kill KillAll KillAllTsr LetA LetO LetP LetR LetT LineInput LinePrint LoadPathPoint MotorState MoveBackTraceLog
    MsgBox OffSrv On OnErr OnSrv Out Pallet PosClr Print PrintLbl Private Program RaiseError ReDim Repeat Replace
    Resume Run RunAllTsr SetCtrlLogInterval SetCtrlLogMaxTime SetHandIO SetHoming ShutDown Split Sprintf SrvLock
    SrvUnLock StartLog StartServoLog Static Status StepStopAll Stop StopEnd StopLog StopServoLog StrReverse Suspend
    SuspendAll SyncMoveEnd SyncMoveStart SyncTimeEnd SyncTimeStart SysInfo SysLog SysState Take_Sem TakeSem TakeVis
    Time TMul UnChuck WaitMotion WorkPos
"""
REFUSED: Final[Mapping[str, str]] = {word.lower(): word for word in _REFUSED_WORDS.split()}
"""Words of PacScript that this interpreter does not support, in lower case, each with its documented spelling."""

DIRECTIVES: Final[Mapping[str, str]] = {
    "include": "#Include", "define": "#Define", "undef": "#Undef", "error": "#Error", "if": "#If", "ifdef": "#Ifdef",
    "ifndef": "#Ifndef", "else": "#Else", "elif": "#Elif", "endif": "#Endif",
}  # fmt: skip
"""Unsupported preprocessor directives; only ``#Pragma`` is supported."""


def canonical(word: str) -> str:
    """Return a keyword in the spelling of the manuals: ``ElseIf`` for ``ELSEIF``."""
    lower = word.lower()
    return _WRITTEN.get(lower, lower.capitalize())


_MIXED: Final = """
    ElseIf ByRef ByVal DriveA RotateH ChangeTool ChangeWork ExtSpeed GiveArm PrintDbg PrintMsg TakeArm LetX LetY LetZ
    LetRX LetRY LetRZ LetF LetJ
"""
_WRITTEN: Final[Mapping[str, str]] = {word.lower(): word for word in (*_MIXED.split(), *STATEMENTS)}
