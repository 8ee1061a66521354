"""``orinkit pendant``: press the buttons of a virtual RC8 through its control port."""

from __future__ import annotations

import json as json_texts
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from cyclopts import Parameter

from orinkit.cli._connection import CONNECTION, Connection
from orinkit.cli._errors import Failure, unusable
from orinkit.client._common import DEFAULT_TIMEOUT
from orinkit.errors import AccessDenied, CallError, InvalidArgument, ProtocolError
from orinkit.hresult import E_CAO_PROV_INVALID
from orinkit.language import pick
from orinkit.transport.address import Address, is_loopback, parse_address

PROVIDER: Final = "CaoProv.orinkit.Pendant"

MODES: Final = {"manual": 1, "teach": 2, "auto": 3}


def read_mode(word: str) -> int:
    """Return the number of a mode from its name.

    Raises:
        Failure: it is none.
    """
    mode = MODES.get(word.strip().lower())
    if mode is None:
        raise unusable(
            f"{word!r:.40} is no mode; manual, teach or auto",
            f"{word!r:.40} というモードはありません (manual、teach、auto のいずれか)",
        )
    return mode


@dataclass(frozen=True, slots=True)
class Action:
    """What the command line can have done.

    Attributes:
        command: of the control port.
        values: what is written behind it, for people.
        read: returns the command's parameter from these words and whether to wait; raises Failure.
        shows: what of the status is shown when it is done; all of it where this is empty.
        waits: whether it can wait for its end.
    """

    command: str
    values: str
    read: Callable[[Words], Any]
    shows: tuple[str, ...] = ()
    waits: bool = False


@dataclass(frozen=True, slots=True)
class Words:
    """The words behind an action.

    Attributes:
        given: the words.
        wait: whether the end is to be waited for.
        usage: how the action is written, for the error messages.
    """

    given: tuple[str, ...]
    wait: bool
    usage: str

    def none(self) -> None:
        """No words."""
        self.count(0)

    def one(self) -> str:
        """One word."""
        return self.count(1)[0]

    def flag(self) -> bool:
        """``on`` or ``off``."""
        word = self.one().lower()
        if word not in ("on", "off"):
            raise self.wrong()
        return word == "on"

    def number(self, index: int) -> float:
        """The word at a place as a number."""
        try:
            return float(self.given[index])
        except ValueError:
            raise self.wrong() from None

    def count(self, least: int, most: int | None = None) -> tuple[str, ...]:
        """The words, that many of them."""
        if not least <= len(self.given) <= (least if most is None else most):
            raise self.wrong()
        return self.given

    def wrong(self) -> Failure:
        """Return the exception for words that cannot be."""
        return unusable(f"the form is: {self.usage}", f"次の形で指定してください: {self.usage}")


def _jog(words: Words) -> list[float]:
    words.count(2)
    axis, distance = words.number(0), words.number(1)
    if not axis.is_integer():
        raise words.wrong()
    return [int(axis), distance, int(words.wait)]


def _whole(words: Words) -> int:
    words.count(1)
    number = words.number(0)
    if not number.is_integer():
        raise words.wrong()
    return int(number)


def _workpiece(words: Words) -> list[float] | None:
    word = words.one()
    return None if word.lower() == "none" else [words.number(0)]


_STOPS: Final = ("motor", "error")
ACTIONS: Final[dict[str, Action]] = {
    "mode": Action("Mode", "manual|teach|auto", lambda words: read_mode(words.one()), ("mode",)),
    "token": Action("Token", "any|tp|io|ethernet[:ADDRESS]", Words.one, ("token",)),
    "estop": Action("EmergencyStop", "on|off", Words.flag, ("emergency_stop", *_STOPS)),
    "protective": Action("ProtectiveStop", "on|off", Words.flag, ("protective_stop", *_STOPS)),
    "auto-enable": Action("AutoEnable", "on|off", Words.flag, ("auto_enable", *_STOPS)),
    "deadman": Action("Deadman", "on|off", Words.flag, ("deadman",)),
    "motor": Action("Motor", "on|off", lambda words: [words.flag(), words.wait], ("motor",), waits=True),
    "jog": Action("Jog", "AXIS DISTANCE", _jog, ("moving", "joints"), waits=True),
    "lock": Action("MachineLock", "on|off", Words.flag, ("machine_lock",)),
    "slave-limit": Action("SlaveLimit", "0|1|2|3", _whole, ("slave_limit",)),
    "error": Action("RaiseError", "NAME|0xCODE [MESSAGE]", lambda words: list(words.count(1, 2)), ("error",)),
    "clear": Action("ClearErrors", "", Words.none, ("error",)),
    "restart": Action("Restart", "", Words.none, _STOPS),
    "workpiece": Action("Workpiece", "WIDTH|none", _workpiece, ("hand.workpiece", "hand.holding")),
    "status": Action("Status", "", Words.none),
}
"""The actions, by name."""


def pendant(
    url: Annotated[
        str,
        Parameter(
            help=pick(
                "Control port, as orinkit serve rc8 --control says it: tcp://127.0.0.1:5008.",
                "orinkit serve rc8 --control が表示する制御ポート: tcp://127.0.0.1:5008。",
            )
        ),
    ],
    action: Annotated[
        str,
        Parameter(
            help=pick("What to do: ", "操作: ")
            + ", ".join(f"{name} {each.values}".rstrip() for name, each in ACTIONS.items())
            + "."
        ),
    ],
    /,
    *value: Annotated[
        str,
        Parameter(
            help=pick(
                "What the action wants, as above; DISTANCE is in degrees, WIDTH in mm.",
                "上記の操作の値。DISTANCE は度、WIDTH は mm。",
            )
        ),
    ],
    wait: Annotated[
        bool, Parameter(help=pick("Wait for the end of jog or motor.", "jog・motor の完了を待つ。"))
    ] = False,
    json: Annotated[
        bool,
        Parameter(help=pick("Print the whole status as one JSON document.", "状態全体を JSON 文書 1 つで出力する。")),
    ] = False,
    control_secret_file: Annotated[
        str | None,
        Parameter(
            group=CONNECTION,
            help=pick(
                "File with the secret of the control port; by default the one that a server of this account has left.",
                "制御ポートのシークレットのファイル。既定は同じアカウントのサーバが残したファイル。",
            ),
        ),
    ] = None,
    timeout: Annotated[
        float,
        Parameter(
            group=CONNECTION,
            help=pick("Seconds for connecting and for each call.", "接続と各呼び出しの制限時間 (秒)。"),
        ),
    ] = DEFAULT_TIMEOUT,
    trace: Annotated[
        bool, Parameter(group=CONNECTION, help=pick("Show every packet on stderr.", "全パケットを stderr に表示する。"))
    ] = False,
) -> None:
    """Press a button of a virtual RC8 and print how things stand then."""
    from orinkit.cli._output import print_json
    from orinkit.cli._terminal import one_line

    wanted = _find(action)
    usage = f"{action} {wanted.values}".rstrip() + (" [--wait]" if wanted.waits else "")
    if wait and not wanted.waits:
        raise unusable(f"--wait is of no use with {action}", f"{action} に --wait は使えません")
    secret = _secret(url, control_secret_file)
    connection = Connection(PROVIDER, timeout, trace, option=f"Secret={secret}" if secret else None)
    status = _press(url, connection, wanted, Words(value, wait, usage))
    if json:
        print_json(status)
    else:
        for line in lines(status, wanted.shows):
            print(one_line(line))


def _find(name: str) -> Action:
    found = ACTIONS.get(name.lower())
    if found is None:
        raise unusable(
            f"there is no action {name!r:.40}; there are {', '.join(ACTIONS)}",
            f"操作 {name!r:.40} はありません ({'、'.join(ACTIONS)} のいずれか)",
        )
    return found


def _secret(url: str, path: str | None) -> str:
    """Return the secret of a control port; ``""`` where nothing is known of it.

    Raises:
        Failure: the file cannot be used.
        InvalidAddress: the URL is none.
    """
    from orinkit.cli._control_secret import find_secret, read_secret

    if path is not None:
        return read_secret(path)
    address = parse_address(url)
    return find_secret(address) if isinstance(address, Address) and is_loopback(address.host) else ""


def _denied(url: str, *, known: bool) -> Failure:
    if known:
        return Failure(
            pick(
                f"{url} refuses the secret. Try: --control-secret-file FILE with the one that its server has printed",
                f"{url} にシークレットを拒否されました。対処: サーバが表示したシークレットのファイルを --control-secret-file で指定してください",
            )
        )
    return Failure(
        pick(
            f"{url} needs its secret, and no server of this account has left one for this port. "
            "Try: --control-secret-file FILE with the one that its server has printed",
            f"{url} にはシークレットが必要ですが、このアカウントのサーバが残したものは見つかりません。"
            "対処: サーバが表示したシークレットのファイルを --control-secret-file で指定してください",
        )
    )


def _press(url: str, connection: Connection, action: Action, words: Words) -> dict[str, Any]:
    """Press a button; returns the status behind it."""
    parameter = action.read(words)
    try:
        controller = connection.open(url)
    except AccessDenied:
        raise _denied(url, known=connection.option is not None) from None
    except CallError as error:
        if error.code != E_CAO_PROV_INVALID:
            raise
        raise Failure(
            pick(
                f"{url} is no control port; orinkit serve rc8 --control 127.0.0.1:5008 opens one",
                f"{url} は制御ポートではありません (orinkit serve rc8 --control 127.0.0.1:5008 で開きます)",
            )
        ) from None
    with controller:
        if action.command != "Status":
            try:
                controller.execute(action.command, parameter)
            except InvalidArgument as error:  # only the code comes over the wire, not what is wrong
                raise Failure(f"{error} {words.wrong()}") from None
        return _status(controller.execute("Status"))


def _status(answer: object) -> dict[str, Any]:
    try:
        status = json_texts.loads(answer) if isinstance(answer, str) else None
    except (ValueError, RecursionError):
        status = None
    if isinstance(status, dict):
        return status
    raise ProtocolError(
        pick(f"Status was answered with {answer!r:.80}", f"Status の応答 {answer!r:.80} を解釈できません")
    )


# --- for people -------------------------------------------------------------------------------------------------------

_LABELS: Final = {
    "mode": ("mode", "モード"), "token": ("executable token", "起動権"), "emergency_stop": ("emergency stop", "非常停止"),
    "protective_stop": ("protective stop", "防護停止"), "auto_enable": ("auto enable", "自動イネーブル"),
    "deadman": ("enable switch", "イネーブルスイッチ"), "machine_lock": ("machine lock", "マシンロック"),
    "motor": ("motor", "モータ"), "moving": ("moving", "動作中"), "held": ("paused", "一時停止中"),
    "arm_holder": ("arm taken by", "アームの占有者"), "error": ("error", "エラー"), "joints": ("joints", "各軸値"),
    "programs": ("programs running", "実行中のプログラム数"), "slave_mode": ("slave mode", "スレーブモード"),
    "slave_limit": ("slave limit", "スレーブモードの限界値"), "hand.position": ("hand: position", "ハンド: 位置"),
    "hand.motor": ("hand: motor", "ハンド: モータ"), "hand.moving": ("hand: moving", "ハンド: 動作中"),
    "hand.holding": ("hand: holding", "ハンド: 把持中"), "hand.force": ("hand: force", "ハンド: 把持力"),
    "hand.workpiece": ("hand: workpiece", "ハンド: ワーク"),
}  # fmt: skip


def lines(status: Mapping[str, Any], shows: tuple[str, ...] = ()) -> list[str]:
    """Return the status for people: a line for each thing, of all or of those that are named."""
    from orinkit.cli._output import padded, width

    rows = [
        (pick(*_LABELS.get(name, (name, name))), _shown(value))
        for name, value in _flat(status)
        if not shows or name in shows
    ]
    widest = max((width(label) for label, _ in rows), default=0)
    return [f"{padded(label, widest)}  {value}" for label, value in rows]


def _flat(status: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    for name, value in status.items():
        rows += _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(f"{prefix}{name}", value)]
    return rows


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list):
        return " ".join(map(_shown, value))
    if isinstance(value, float):
        return f"{value:g}" if abs(value) < 1e6 else str(value)
    return "-" if value in (None, "") else str(value)
