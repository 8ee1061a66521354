"""What the demo does and what the document says to each step, as data: a list of steps for each of its programs.

A further program of the document is a further list here and an entry in :data:`LISTS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from orinkit import functions as f
from orinkit import hresult
from orinkit.cao.table import Function
from orinkit.language import pick
from orinkit.variant import VARIANT_ARRAY, Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8

DEMO_ERROR: Final = hresult.MOTOR_NOT_ON
"""The error that the demo raises in the virtual controller."""


@dataclass(frozen=True, slots=True)
class Handle:
    """Stands for the handle that an earlier step was answered with."""

    name: str


Check = Callable[[list[Variant]], str]
"""Looks at the arguments of a reply; returns what the document says instead, ``""`` if they are right."""


@dataclass(frozen=True, slots=True)
class Step:
    """One call, and what it must be answered with.

    Attributes:
        en, ja: what is done.
        section: where the document has it.
        function: what is called.
        arguments: of the call; a :class:`Handle` for a handle.
        check: tells whether the answer is right.
        keep: name under which the handle in the answer is kept.
        before: what happens in the controller before the call, nothing by default.
    """

    en: str
    ja: str
    section: str
    function: Function[..., Any]
    arguments: tuple[Any, ...]
    check: Check
    keep: str = ""
    before: Callable[[VirtualRC8], None] | None = None

    @property
    def title(self) -> str:
        """What is done, in the language in force."""
        return pick(self.en, self.ja)


# --- what answers must be ---------------------------------------------------------------------------------------------


def nothing(answer: list[Variant]) -> str:
    """No result."""
    return pick("no argument", "引数なし") if answer else ""


def a_handle(answer: list[Variant]) -> str:
    """A handle: one VT_I4 above zero."""
    right = len(answer) == 1 and answer[0].type == VarType.I4 and answer[0].value > 0
    return "" if right else pick("a handle (VT_I4 above 0)", "ハンドル (正の VT_I4)")


def exactly(vt: VarType, value: Any = None) -> Check:
    """Return the check for one value of one type."""
    wanted = Variant(vt, value)

    def check(answer: list[Variant]) -> str:
        return "" if answer == [wanted] else repr(wanted)

    return check


def an_error(code: int) -> Check:
    """Return the check for an array that begins with an error code and its text (GetCurErrorInfo)."""

    def check(answer: list[Variant]) -> str:
        right = len(answer) == 1 and answer[0].type == VARIANT_ARRAY and len(answer[0].value) > 1
        if right:
            first, second = answer[0].plain[:2]
            right = first == hresult.signed(code) and isinstance(second, str) and second != ""
        return "" if right else pick(f"an array of 0x{code:08X} and its text", f"0x{code:08X} とその説明の配列")

    return check


def a_text(answer: list[Variant]) -> str:
    """A text that says something."""
    right = len(answer) == 1 and answer[0].type == VarType.BSTR and answer[0].value
    return "" if right else pick("a text (VT_BSTR)", "文字列 (VT_BSTR)")


# --- List 3-1 ---------------------------------------------------------------------------------------------------------


def _raise_error(rc8: VirtualRC8) -> None:
    rc8.raise_error(DEMO_ERROR)


_CONTROLLER: Final = Handle("controller")
_IO150: Final = Handle("IO150")
_MODE: Final = Handle("@MODE")
_AUTOMATIC: Final = 3

# fmt: off
LIST_3_1: Final[tuple[Step, ...]] = (
    Step("Start the service of this connection", "この接続のサービスを開始する", "RC8 3.1.1",
         f.service_start, (), nothing),
    Step("Connect to the controller", "コントローラに接続する", "RC8 3.1.2",
         f.controller_connect, ("", "CaoProv.DENSO.VRC", "localhost", ""), a_handle, keep=_CONTROLLER.name),
    Step("Connect to the variable IO150", "変数 IO150 に接続する", "RC8 3.1.2",
         f.controller_get_variable, (_CONTROLLER, "IO150", ""), a_handle, keep=_IO150.name),
    Step("Read it: the point is off", "読み出す: OFF", "RC8 3.1.3",
         f.variable_get_value, (_IO150,), exactly(VarType.BOOL, False)),
    Step("Write it, as the sample does: VT_I4 -1", "サンプルと同じく VT_I4 の -1 を書き込む", "RC8 3.1.7",
         f.variable_put_value, (_IO150, Variant(VarType.I4, -1)), nothing),
    Step("Read it back: the point is on", "再び読み出す: ON", "RC8 3.1.3",
         f.variable_get_value, (_IO150,), exactly(VarType.BOOL, True)),
    Step("Connect to the system variable @MODE", "システム変数 @MODE に接続する", "RC8 3.1.6",
         f.controller_get_variable, (_CONTROLLER, "@MODE", ""), a_handle, keep=_MODE.name),
    Step("Read it: 3, automatic", "読み出す: 3 (自動)", "RC8 2.2",
         f.variable_get_value, (_MODE,), exactly(VarType.I4, _AUTOMATIC)),
    Step("An error has happened: how many are there?", "エラーが発生した: 件数を聞く", "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetCurErrorCount", None), exactly(VarType.I4, 1), before=_raise_error),
    Step("Which one is it?", "エラーの内容を聞く", "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetCurErrorInfo", 0), an_error(DEMO_ERROR)),
    Step("What does that code mean?", "コードの意味を聞く", "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetErrorDescription", hresult.signed(DEMO_ERROR)), a_text),
    Step("Clear it", "エラーをクリアする", "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "ClearError", None), exactly(VarType.EMPTY)),
    Step("No error is left", "エラーがないことを確かめる", "RC8 3.3.6",
         f.controller_execute, (_CONTROLLER, "GetCurErrorCount", None), exactly(VarType.I4, 0)),
    Step("Release @MODE", "@MODE を解放する", "RC8 3.1.4",
         f.variable_release, (_MODE,), nothing),
    Step("Release IO150", "IO150 を解放する", "RC8 3.1.4",
         f.variable_release, (_IO150,), nothing),
    Step("Disconnect from the controller", "コントローラから切断する", "RC8 3.1.4",
         f.controller_disconnect, (_CONTROLLER,), nothing),
    Step("Stop the service", "サービスを停止する", "RC8 3.1.5",
         f.service_stop, (), nothing),
)
# fmt: on

LISTS: Final[dict[str, tuple[Step, ...]]] = {"List 3-1": LIST_3_1}
"""The programs of the RC8 document that the demo runs, by their names there."""
