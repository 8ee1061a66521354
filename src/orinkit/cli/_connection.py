"""How a command reaches a controller and the object on it that it works on."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, TypeAlias

from cyclopts import Group, Parameter

import orinkit
from orinkit.cli._errors import unusable
from orinkit.cli._transcript import Packet, Transcript
from orinkit.client._common import DEFAULT_TIMEOUT, RC8
from orinkit.language import pick

Owner: TypeAlias = orinkit.Controller | orinkit.Robot | orinkit.Task | orinkit.Extension | orinkit.File

CONNECTION = Group(pick("Connection", "接続"), sort_key=8)
OBJECT = Group(pick("Object", "オブジェクト"), sort_key=7)

Url: TypeAlias = Annotated[
    str,
    Parameter(help=pick("Controller: tcp://192.168.0.1:5007, or only its host.", "コントローラ: tcp://192.168.0.1:5007、またはホスト名のみ。")),
]  # fmt: skip
Json: TypeAlias = Annotated[bool, Parameter(help=pick(
    "Print one JSON document; bytes in hex, dates in ISO 8601.",
    "JSON 文書 1 つで出力する。バイト列は 16 進、日時は ISO 8601。"))]  # fmt: skip


@Parameter(name="*", group=CONNECTION)
@dataclass(frozen=True)
class Connection:
    """How to connect."""

    provider: Annotated[
        str,
        Parameter(
            help=pick(
                "Provider name; RC9 and COBOTTA PRO want CaoProv.DENSO.VRC9.",
                "プロバイダ名。RC9 と COBOTTA PRO は CaoProv.DENSO.VRC9。",
            )
        ),
    ] = RC8
    timeout: Annotated[
        float, Parameter(help=pick("Seconds for connecting and for each call.", "接続と各呼び出しの制限時間 (秒)。"))
    ] = DEFAULT_TIMEOUT
    trace: Annotated[bool, Parameter(help=pick("Show every packet on stderr.", "全パケットを stderr に表示する。"))] = (
        False
    )

    def open(self, url: str) -> orinkit.Controller:
        """Connect to the controller."""
        return orinkit.connect(url, provider=self.provider, timeout=self.timeout, trace=self._transcript())

    def open_client(self, url: str) -> orinkit.Client:
        """Open the connection only."""
        return orinkit.open_client(url, timeout=self.timeout, trace=self._transcript())

    def _transcript(self) -> Transcript | None:
        return Transcript(_to_stderr) if self.trace else None


def _to_stderr(packet: Packet) -> None:
    for line in packet.lines():
        print(line, file=sys.stderr)


@Parameter(name="*", group=OBJECT)
@dataclass(frozen=True)
class Owning:
    """Whose variable it is; the controller's if nothing is named."""

    robot: Annotated[str | None, Parameter(help=pick("A robot, by name.", "ロボット名。"))] = None
    task: Annotated[str | None, Parameter(help=pick("A task, by name.", "タスク名。"))] = None
    extension: Annotated[str | None, Parameter(help=pick("An extension board, by name.", "拡張ボード名。"))] = None
    file: Annotated[str | None, Parameter(help=pick("A file, by name.", "ファイル名。"))] = None

    def of(self, controller: orinkit.Controller) -> Owner:
        """Return the object that is named, the controller if none is."""
        named = [name for name in ("robot", "task", "extension", "file") if getattr(self, name) is not None]
        if len(named) > 1:
            options = " ".join(f"--{name}" for name in named)
            raise unusable(f"give only one of {options}", f"{options} は 1 つだけ指定してください")
        if self.robot is not None:
            return controller.robot(self.robot)
        if self.task is not None:
            return controller.task(self.task)
        if self.extension is not None:
            return controller.extension(self.extension)
        return controller.file(self.file) if self.file is not None else controller
