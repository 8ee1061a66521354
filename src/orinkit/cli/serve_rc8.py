"""``orinkit serve rc8``: the virtual RC8 on the network."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.cli._errors import Failure, unusable, whole_number
from orinkit.cli._serving import Listening, check, run
from orinkit.language import pick
from orinkit.virtual.rc8 import Permission, VirtualRC8
from orinkit.virtual.rc8.memory import DEFAULT_IO_POINTS

_CONTROLLER: Final = Group(pick("Controller", "コントローラ"), sort_key=7)
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
    listening: Listening = _LISTENING,
) -> int:  # fmt: skip
    """Serve a virtual RC8; each listener is told on stdout as "ready tcp://HOST:PORT". Stops on SIGINT and SIGTERM."""
    check(listening)
    try:
        rc8 = VirtualRC8(
            counts=read_counts(count),
            io_points=io_points,
            state=state,
            permission=Permission.parse(permission),
            accept_pc_provider=accept_pc_provider,
        )
    except ValueError as error:
        raise Failure(str(error), 2) from None
    try:
        return run(rc8, listening)
    finally:
        rc8.close()


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
