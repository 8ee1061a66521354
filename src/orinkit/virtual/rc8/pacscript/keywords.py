"""The words of PacScript: keywords of the grammar, words that start a command, and unsupported words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

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

_COMMANDS: Final = """
    accel changetool changework decel delay extspeed givearm hold motor printdbg printmsg speed wait
    curlmt forcechangetable forcectrl forceparam forcesensor forcewaitcondition grvctrl grvoffset highpathaccuracy
    payload resetarea setarea tool work zforce
"""
STARTERS: Final[Mapping[str, str]] = (
    dict.fromkeys(("move", "approach", "depart", "drive", "drivea", "rotate", "rotateh"), "MOTION")
    | dict.fromkeys(_COMMANDS.split(), "COMMAND")
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
    ArchMove AreaPos Arrive BasePos Buzzer CalcBackTraceLog Chuck ClearLog ClearMsg ClrErr Com_Discom Com_Encom
    Com_State Comm ContinueRun CPMode Create_Sem CreateSem CurAcc CurCPMode CurDec CurErr CurExtAcc CurExtDec
    CurExtSpd CurPayload CurSpd CurSpeedMode Date DefArea DefDbl DefInt DefIO DefJnt DefPos DefSng DefStr DefTrn
    DefVec Delete_Sem DeleteSem Draw ErAlw ErrMsg ExtAccel ExtDecel Extern Flush Flush_Sem FlushSem Fork GetErrLvl
    GetJntData GetSrvState GetTime Give_Sem GiveSem GiveVis GoHome Halt In Input InputBox Interrupt IOBlock IOF JAccel
    JDecel Join JSpeed Kill KillAll LetA LetO LetP LetR LetT LineInput LinePrint MotionComplete MotionSkip
    MotionTimeout MotorState MoveBackTraceLog MPS MsgBox OffSrv On OnErr OnSrv Out Pallet PosClr Print PrintLbl
    Private Program RaiseError ReDim Repeat Replace Resume Run SetHoming ShutDown SingularAvoid SpeedMode Split
    Sprintf SrvLock SrvUnLock StartLog Static Status Stop StopEnd StopLog StrReverse Suspend SuspendAll SyncMoveEnd
    SyncMoveStart SysLog SysState Take_Sem TakeSem TakeVis Time ToolPos UnChuck WaitMotion WorkPos
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
    LetRX LetRY LetRZ LetF LetJ CurLmt ForceChangeTable ForceCtrl ForceParam ForceSensor ForceWaitCondition GrvCtrl
    GrvOffset HighPathAccuracy PayLoad ResetArea SetArea ZForce
"""
_WRITTEN: Final[Mapping[str, str]] = {word.lower(): word for word in _MIXED.split()}
