"""The frame of the command line: which commands there are, and what becomes of errors."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from cyclopts import App, CycloptsError, Group, Parameter

import orinkit
from orinkit.cli._errors import Failure, usage_text
from orinkit.cli._help import HelpFormatter
from orinkit.cli._terminal import screened
from orinkit.errors import InvalidAddress, InvalidValue, NotationError, OrinError
from orinkit.language import pick

DONE: Final = 0
FAILED: Final = 1
USAGE: Final = 2
INTERRUPTED: Final = 130

_UNUSABLE: Final = (InvalidAddress, InvalidValue, NotationError)


def build() -> App:
    """Return the command line in the language in force; a command's module is imported when it is used."""
    app = App(
        name="orinkit",
        help=pick(
            "Drive and serve DENSO robot controllers over b-CAP, and ABH3 motor drivers over CAN. Begin with: orinkit demo\n\n"
            "Texts are English or Japanese as LANG says; ORINKIT_LANG=en or ORINKIT_LANG=ja decides.",
            "DENSO ロボットコントローラを b-CAP で、ABH3 モータドライバを CAN で操作し、それぞれの仮想機器を提供します。"
            "まず orinkit demo をお試しください。\n\n"
            "表示言語は LANG に従います (ORINKIT_LANG=en または ORINKIT_LANG=ja で指定)。",
        ),
        version=orinkit.__version__,
        help_format="plaintext",
        help_formatter=HelpFormatter(),
        group_commands=Group(pick("Commands", "コマンド")),
        group_arguments=Group(pick("Arguments", "引数"), sort_key=1),
        group_parameters=Group(pick("Options", "オプション"), sort_key=9),
        default_parameter=Parameter(negative=()),
        suppress_keyboard_interrupt=False,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    serve = App(
        name="serve",
        help=pick(
            "Serve a virtual controller, or a device of your own, on the network.",
            "仮想コントローラや自作のデバイスをネットワークで提供する。",
        ),
        sort_key=2,
    )
    serve.command(
        "orinkit.cli.serve_rc8:serve_rc8",
        name="rc8",
        help=pick("Serve a virtual RC8 robot controller.", "仮想 RC8 ロボットコントローラを提供する。"),
    )
    serve.command(
        "orinkit.cli.serve_ve026a:serve_ve026a",
        name="ve026a",
        help=pick(
            "Serve a virtual VE026A, the small arm with a serial line.",
            "仮想 VE026A (シリアル接続の小型アーム) を提供する。",
        ),
    )
    serve.command(
        "orinkit.cli.serve_abh3:serve_abh3",
        name="abh3",
        usage="orinkit serve abh3 [URL] [OPTIONS]",
        help=pick("Serve virtual ABH3 motor drivers on a CAN bus.", "仮想 ABH3 モータドライバを CAN バスで提供する。"),
    )
    serve.command(
        "orinkit.cli.serve_device:serve_device",
        name="device",
        help=pick("Serve devices of your own, written in Python.", "Python で書いた自作のデバイスを提供する。"),
    )
    app.command(_command_of("demo"), name="demo", sort_key=1, help=pick(
        "Watch a client and a virtual RC8, or VE026A, talk, every packet explained.",
        "クライアントと仮想 RC8 (または VE026A) の通信を、全パケットの説明付きで見る。"))  # fmt: skip
    app.command(serve)
    app.command(_command_of("get"), name="get", sort_key=3, help=pick(
        "Read a variable of a controller.", "コントローラの変数を読み出す。"))  # fmt: skip
    app.command(_command_of("put"), name="put", sort_key=4, help=pick(
        "Write a variable of a controller.", "コントローラの変数に書き込む。"))  # fmt: skip
    app.command(_command_of("call"), name="call", sort_key=5, help=pick(
        "Call any of the 137 functions.", "137 関数のいずれかを呼び出す。"))  # fmt: skip
    app.command(_command_of("info"), name="info", sort_key=6, help=pick(
        "Tell what a controller is and how it is.", "コントローラの情報と状態を表示する。"))  # fmt: skip
    app.command(_command_of("decode"), name="decode", sort_key=7, help=pick(
        "Explain b-CAP packets given in hex, field by field.",
        "16 進で与えた b-CAP パケットを項目ごとに説明する。"))  # fmt: skip
    app.command(_command_of("functions"), name="functions", sort_key=8, help=pick(
        "List the 137 functions.", "137 関数の一覧を表示する。"))  # fmt: skip
    app.command(_command_of("pendant"), name="pendant", sort_key=9, help=pick(
        "Press the buttons of a virtual RC8.", "仮想 RC8 の操作盤のボタンを押す。"))  # fmt: skip
    app.command(_command_of("move"), name="move", sort_key=10, help=pick(
        "Move a robot to a pose.", "ロボットを指定したポーズへ動かす。"))  # fmt: skip
    app.command(_command_of("stream"), name="stream", sort_key=11, help=pick(
        "Carry out a trajectory in slave mode.", "スレーブモードで軌道を実行する。"))  # fmt: skip
    app.command(_command_of("plot"), name="plot", sort_key=12, help=pick(
        "Plot a recorded motion.", "記録した動作をグラフにする。"))  # fmt: skip
    app.command(_command_of("gateway"), name="gateway", sort_key=13, help=pick(
        "Pass calls on to other controllers, over any protocol.",
        "他のコントローラへの呼び出しを、プロトコルを問わず中継する。"))  # fmt: skip
    abh3 = _abh3()
    app.command(abh3)
    for each in (app, serve, abh3):
        _translate_flags(each)
    return app


def _abh3() -> App:
    app = App(name="abh3", sort_key=14, help=pick(
        "ABH3 motor drivers on a CAN bus: listen, decode logs, turn motors, make a DBC file.",
        "CAN バス上の ABH3 モータドライバ: 通信の表示、ログの解読、モータの駆動、DBC ファイルの出力。"))  # fmt: skip
    app.command("orinkit.cli.abh3:monitor", name="monitor", sort_key=1, usage="orinkit abh3 monitor [URL] [OPTIONS]", help=pick(
        "Show the frames on a bus and what they say.", "バス上のフレームとその意味を表示する。"))  # fmt: skip
    app.command("orinkit.cli.abh3:decode", name="decode", sort_key=2, help=pick(
        "Tell what the frames of a log say.", "ログのフレームを解読する。"))  # fmt: skip
    app.command("orinkit.cli.abh3:dbc", name="dbc", sort_key=3, help=pick(
        "Print a DBC file of all frames: orinkit abh3 dbc > abh3.dbc", "全フレームの DBC ファイルを出力する: orinkit abh3 dbc > abh3.dbc"))  # fmt: skip
    app.command("orinkit.cli._abh3_drive:drive", name="drive", sort_key=4, usage="orinkit abh3 drive [URL] --seconds S [--ay N] [--bx N] [OPTIONS]", help=pick(
        "Turn the motors of a driver for some seconds.", "ドライバのモータを指定した秒数だけ動かす。"))  # fmt: skip
    return app


def _command_of(name: str) -> str:
    return f"orinkit.cli.{name}:{name}"


def _translate_flags(app: App) -> None:
    app["--help"].help = pick("Show this help.", "このヘルプを表示する。")
    app["--version"].help = pick("Show the version.", "バージョンを表示する。")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Args:
        argv: the arguments without the program's name; those of the process by default.
    """
    _show_what_cannot_be_encoded()
    with screened():
        return _guarded(lambda: build()(list(sys.argv[1:] if argv is None else argv)))


def _guarded(run: Callable[[], int | None]) -> int:
    """Run a command; whatever goes wrong becomes one line on stderr and an exit code."""
    try:
        code = run() or DONE
        if sys.stdout is not None:  # it is where a shell was told to close it
            sys.stdout.flush()
    except CycloptsError as error:
        return _say(usage_text(error), USAGE)
    except Failure as error:
        return _say(str(error), error.code)
    except _UNUSABLE as error:
        return _say(str(error), USAGE)
    except OrinError as error:
        return _say(str(error), FAILED)
    except KeyboardInterrupt:
        return _say(pick("interrupted", "中断しました"), INTERRUPTED)
    except BrokenPipeError:  # the reader has seen enough, as in "orinkit functions | head"
        _leave_stdout()
        return FAILED
    except Exception as error:
        if os.environ.get("ORINKIT_TRACEBACK"):
            raise
        if isinstance(error, OSError):
            _leave_stdout()  # what is left in its buffer would be tried again at the end, and complained about
            return _say(_refused(error), FAILED)
        kind, hint = type(error).__name__, "ORINKIT_TRACEBACK=1"
        text = pick(
            f"unexpected {kind}: {error} ({hint} shows where)", f"予期しない {kind}: {error} ({hint} で詳細表示)"
        )
        return _say(text, FAILED)
    return code


def _say(text: str, code: int) -> int:
    if sys.stderr is not None:  # print would take stdout for it
        with suppress(OSError):
            print(f"orinkit: {' '.join(text.split())}", file=sys.stderr)
    return code


def _refused(error: OSError) -> str:
    """Return what the system says, and of which file: a full disk, no permission."""
    reason = error.strerror or str(error) or type(error).__name__
    of = f"{error.filename}: " if error.filename is not None else ""
    return pick(f"reading or writing failed: {of}{reason}", f"読み書きに失敗しました: {of}{reason}")


def _leave_stdout() -> None:
    """Write no more to stdout if it takes nothing more."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except (OSError, ValueError):  # ValueError: somebody has closed it
        with suppress(OSError, ValueError):  # it may be no file at all
            number = sys.stdout.fileno()
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)


def _show_what_cannot_be_encoded() -> None:
    """Let a terminal that has no Japanese show escapes instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
