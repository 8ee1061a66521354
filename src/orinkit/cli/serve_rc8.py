"""``orinkit serve rc8``: the virtual RC8 on the network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.arms import MODEL_NAMES
from orinkit.cli._control_secret import OPTION, left_for, read_secret
from orinkit.cli._errors import Failure, unusable, whole_number
from orinkit.cli._serving import LISTENING, Control, Listening, begin_log, check, check_control, run
from orinkit.cli.pendant import read_mode
from orinkit.cli.serve_device import announce, load_targets
from orinkit.errors import InvalidValue, NotationError
from orinkit.language import pick
from orinkit.poses import J, parse_target
from orinkit.providers import load_installed
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8 import Permission, VirtualRC8
from orinkit.virtual.rc8.control import ControlProvider
from orinkit.virtual.rc8.memory import DEFAULT_IO_POINTS

_CONTROLLER: Final = Group(pick("Controller", "コントローラ"), sort_key=7)
_ROBOT: Final = Group(pick("Robot", "ロボット"), sort_key=7)
_PROVIDERS: Final = Group(pick("Devices beside it", "併せて提供するデバイス"), sort_key=7)
_LISTENING: Final = Listening()


def serve_rc8(
    *,
    state: Annotated[
        str | None,
        Parameter(
            group=_CONTROLLER,
            help=pick("Directory that keeps the variables; forgotten at the end without it.",
                      "変数を保存するディレクトリ。指定しなければ終了時に失われます。"),
        ),
    ] = None,
    permission: Annotated[
        str,
        Parameter(
            group=_CONTROLLER,
            help=pick('Who may read (r) and write (rw): "192.168.0.7=r,10.0.0.0/8=none,*=rw".',
                      '読み出し (r)・読み書き (rw) の権限: "192.168.0.7=r,10.0.0.0/8=none,*=rw"。'),
        ),
    ] = "*=rw",
    count: Annotated[
        tuple[str, ...],
        Parameter(
            group=_CONTROLLER,
            help=pick("How many variables of a class I F D V P J T S: I=200; may be given again. 100 by default.",
                      "クラス I F D V P J T S ごとの変数の個数: I=200。複数指定可。既定は 100。"),
        ),
    ] = (),
    io_points: Annotated[
        int, Parameter(group=_CONTROLLER, converter=whole_number, help=pick("How many I/O points.", "I/O 点数。"))
    ] = DEFAULT_IO_POINTS,
    accept_pc_provider: Annotated[
        bool,
        Parameter(
            group=_CONTROLLER,
            help=pick("Answer to CaoProv.DENSO.RC8 too, which real controllers refuse but some clients send.",
                      "実機が拒否する CaoProv.DENSO.RC8 (一部のクライアントが送る) も受け付ける。"),
        ),
    ] = False,
    model: Annotated[
        str,
        Parameter(
            group=_ROBOT,
            help=pick(f"Its arm: {', '.join(MODEL_NAMES)}, or a TOML file of your own.",
                      f"アーム: {'、'.join(MODEL_NAMES)}、または独自の TOML ファイル。"),
        ),
    ] = "VS-050",
    mode: Annotated[
        str, Parameter(group=_ROBOT, help=pick("Mode switch: manual, teach or auto.", "モード: manual、teach、auto。"))
    ] = "auto",
    token: Annotated[
        str,
        Parameter(
            group=_ROBOT,
            help=pick("Executable token: any, tp, io, ethernet or ethernet:ADDRESS.",
                      "起動権: any、tp、io、ethernet、ethernet:アドレス。"),
        ),
    ] = "any",  # noqa: S107 - a start right
    motor_on: Annotated[
        bool, Parameter(group=_ROBOT, help=pick("The motor is on from the beginning.", "モータ ON の状態で起動する。"))
    ] = False,
    joints: Annotated[
        str | None,
        Parameter(
            group=_ROBOT,
            allow_leading_hyphen=True,
            help=pick('Where the arm stands, in degrees: "J(0, 30, 90, 0, 60, 0)" or 0,30,90,0,60,0; its home pose by default.',
                      'アームの初期姿勢 (度): "J(0, 30, 90, 0, 60, 0)" または 0,30,90,0,60,0。既定はホーム姿勢。'),
        ),
    ] = None,
    no_samples: Annotated[
        bool,
        Parameter(
            group=_ROBOT,
            help=pick("Put no sample programs into an empty file store.", "ファイル領域が空でもサンプルプログラムを置かない。"),
        ),
    ] = False,
    no_slave_licence: Annotated[
        bool,
        Parameter(
            group=_ROBOT,
            help=pick("Refuse slave mode: its licence is not registered.", "スレーブ機能のライセンスが未登録の状態にする。"),
        ),
    ] = False,
    slave_limit: Annotated[
        int,
        Parameter(
            group=_ROBOT,
            converter=whole_number,
            help=pick("Limits in slave mode: 0 servo, 1 servo x external speed, 2 command, 3 command x external speed.",
                      "スレーブモードの限界値: 0 サーボ限界、1 サーボ限界 (外部速度連動)、2 指令限界、3 指令限界 (外部速度連動)。"),
        ),
    ] = 0,
    strict_time: Annotated[
        bool,
        Parameter(
            group=_ROBOT,
            help=pick("Late set-points in slave mode are not waited for (250 ms): an error at once, or in mode 1 a stop in place, as on a real controller.",
                      "スレーブモードで遅れた位置指令を待たない (既定は 250 ms 待つ)。実機と同じく直ちにエラー、モード 1 ではその場で停止する。"),
        ),
    ] = False,
    time_scale: Annotated[
        float,
        Parameter(
            group=_CONTROLLER,
            help=pick("How many seconds of the controller pass in one real second; 20 makes motions 20 times as fast.",
                      "実時間 1 秒あたりに進むコントローラの秒数。20 なら動作が 20 倍速になる。"),
        ),
    ] = 1.0,
    provider: Annotated[
        tuple[str, ...],
        Parameter(
            group=_PROVIDERS,
            help=pick("A device to serve too: file.py:Class, module:Class, or the name of an installed one; may be given again.",
                      "併せて提供するデバイス: ファイル.py:クラス、モジュール:クラス、またはインストール済みのプロバイダ名。複数指定可。"),
        ),
    ] = (),
    no_providers: Annotated[
        bool,
        Parameter(
            group=_PROVIDERS,
            help=pick("Leave out installed providers; they are served too otherwise.",
                      "インストール済みのプロバイダを提供しない (指定しなければ併せて提供する)。"),
        ),
    ] = False,
    control: Annotated[
        str | None,
        Parameter(
            group=LISTENING,
            help=pick("HOST:PORT on this machine for orinkit pendant; printed as \"ready control tcp://HOST:PORT\", its secret below. Port 0 takes a free one.",
                      "orinkit pendant 用の、このマシン自身の HOST:PORT。\"ready control tcp://HOST:PORT\" と表示し、次の行にシークレットを表示する。ポート 0 は空きポート。"),
        ),
    ] = None,
    control_secret_file: Annotated[
        str | None,
        Parameter(
            group=LISTENING,
            help=pick("File with the secret of --control; without that file, where it is made and removed at the end. "
                      "By default a file that orinkit pendant finds.",
                      "--control のシークレットのファイル。なければ生成し、終了時に削除する。既定は orinkit pendant が自動で見つけるファイル。"),
        ),
    ] = None,
    listening: Listening = _LISTENING,
) -> int:  # fmt: skip
    """Serve a virtual RC8; each listener is told on stdout as "ready URL". Stops on SIGINT, SIGTERM and SIGHUP."""
    check(listening)
    secret = _read_control(control, control_secret_file)
    try:
        rc8 = VirtualRC8(
            counts=read_counts(count),
            io_points=io_points,
            state=state,
            permission=Permission.parse(permission),
            accept_pc_provider=accept_pc_provider,
            model=model,
            mode=read_mode(mode),
            token=token,
            motor=motor_on,
            joints=None if joints is None else read_joints(joints),
            samples=not no_samples,
            slave_licence=not no_slave_licence,
            slave_limit=slave_limit,
            strict_time=strict_time,
            clock=Clock(time_scale),
        )
    except ValueError as error:
        raise Failure(str(error), 2) from None
    try:
        begin_log(listening)
        served = load_targets(provider, [rc8])
        if not no_providers:
            served += load_installed(served, but=provider)
        announce(served, rc8)
        return run(served, listening, _control(rc8, control, secret, control_secret_file))
    finally:
        rc8.close()


def _read_control(url: str | None, path: str | None) -> str:
    """Return the secret of the control port if it is in a file already, else ``""``.

    Raises:
        Failure: the port, or the file, cannot be used.
        InvalidAddress: the port is none.
    """
    if url is not None:
        check_control(url)
        return read_secret(path) if path is not None and Path(path).exists() else ""
    if path is not None:
        raise unusable(f"{OPTION} needs --control HOST:PORT", f"{OPTION} には --control HOST:PORT が必要です")
    return ""


def _control(rc8: VirtualRC8, url: str | None, secret: str, path: str | None) -> Control | None:
    if url is None:
        return None
    provider = ControlProvider(rc8, secret=secret)

    @contextmanager
    def offered(port: int) -> Iterator[Sequence[str]]:
        if secret:  # whoever made the file knows it
            yield ()
        else:
            with left_for(provider.secret, port, path):
                yield (f"control secret {provider.secret}",)

    return Control(provider, url, offered)


def read_counts(texts: tuple[str, ...]) -> dict[str, int]:
    """Return counts by class from ``I=200``.

    Raises:
        Failure: a text is not of that form.
    """
    counts: dict[str, int] = {}
    for text in texts:
        name, equals, number = text.partition("=")
        if not equals or not number.isdecimal():
            raise unusable(
                f"--count {text}: CLASS=NUMBER is needed, as I=200", f"--count {text}: I=200 の形で指定してください"
            )
        counts[name.strip().upper()] = int(number)
    return counts


def read_joints(text: str) -> tuple[float, ...]:
    """Return joints from ``J(0, 30, 90, 0, 60, 0)`` or their numbers alone.

    Raises:
        Failure: the text is neither.
    """
    try:
        if text.strip()[:1] not in ("J", "j"):
            return tuple(J.of([float(part) for part in text.replace(",", " ").split()]))
        target = parse_target(text)
    except (NotationError, InvalidValue) as error:
        raise _no_joints(text, f": {error}") from None
    except ValueError:
        raise _no_joints(text) from None
    if target.kind != "J" or target.mark or target.extra or isinstance(target.value, int):
        raise _no_joints(text)
    return target.value


def _no_joints(text: str, reason: str = "") -> Failure:
    return unusable(
        f'--joints {text:.60}: "J(0, 30, 90, 0, 60, 0)" or 0,30,90,0,60,0 is the form{reason}',
        f'--joints {text:.60}: "J(0, 30, 90, 0, 60, 0)" または 0,30,90,0,60,0 の形で指定してください{reason}',
    )
