"""``orinkit demo``: a client and a virtual RC8 talk over TCP, and every packet is shown and checked."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Parameter

from orinkit.cli._connection import Json
from orinkit.cli._errors import Failure
from orinkit.cli._transcript import Packet, Transcript
from orinkit.language import pick

if TYPE_CHECKING:
    import orinkit
    from orinkit.cli._demo_steps import Program, Step
    from orinkit.virtual.rc8 import VirtualRC8

_URL: Final = "tcp://127.0.0.1:0"
_INTERVAL: Final = 0.15


def demo(
    *,
    fields: Annotated[
        bool, Parameter(help=pick("Explain every packet field by field.", "全パケットを項目ごとに説明する。"))
    ] = False,
    json: Json = False,
    picture: Annotated[
        str | None,
        Parameter(help=pick("File for a picture of the arm's motion (png, svg, pdf).",
                            "アームの動きを描いた図の保存先 (png、svg、pdf)。")),
    ] = None,
) -> None:  # fmt: skip
    """Serve virtual RC8s on free loopback ports and run the document's Lists 3-1, 3-2 and 3-3 against them.

    Every answer is compared with the document; exit code 1 if one differs.
    """
    from orinkit.cli._demo_steps import LISTS
    from orinkit.cli._output import print_json

    documents: list[dict[str, Any]] = []
    say: Callable[[str], None] = (lambda _line: None) if json else print
    recording = Recording()
    for name, program in LISTS.items():
        run_program(name, program, documents, say, fields=fields, recording=recording)
    if picture is not None:
        recording.draw(picture)
    if json:
        print_json({"steps": documents, "as_documented": True, "picture": picture})
    count = len(documents)
    say(pick(f"\nAll {count} answers are as the document says.", f"\n{count} 件の応答はすべて仕様書のとおりでした。"))
    if picture is not None:
        say(pick(f"The arm's motion is drawn in {picture}.", f"アームの動きを {picture} に描きました。"))


class Recording:
    """The control log of the motion that was watched."""

    def __init__(self) -> None:
        self.records: list[list[float]] = []

    def draw(self, path: str) -> None:
        """Draw the joints over time.

        Raises:
            Failure: there is no matplotlib, or the file cannot be written.
        """
        from orinkit.cli._motion_plot import save
        from orinkit.cli._motion_record import joints_of, recording_of

        save(recording_of([joints_of(record) for record in self.records]), Path(path))


def run_program(
    name: str, program: Program, documents: list[dict[str, Any]], say: Callable[[str], None], *, fields: bool,
    recording: Recording | None = None,
) -> None:  # fmt: skip
    """Run a program of the document against a virtual RC8 of its own.

    Args:
        name: of the program in the document.
        program: the program.
        documents: takes each step with its packets, for JSON.
        say: takes each line for people.
        fields: explain packets field by field.
        recording: takes the motion that is watched.

    Raises:
        Failure: an answer is not as the document says.
    """
    import orinkit
    from orinkit.cli._output import bold
    from orinkit.virtual.rc8 import VirtualRC8

    rc8 = VirtualRC8()
    with orinkit.serve(rc8, _URL) as server:
        say(
            bold(
                pick(
                    f"\n{name} of the b-CAP specification for RC8: {program.en}",
                    f"\nb-CAP 通信仕様書 RC8 用 {name}: {program.ja}",
                )
            )
        )
        say(pick(f"A virtual RC8 listens at {server.url}.", f"仮想 RC8 を {server.url} で起動しました。"))
        transcript = Transcript()
        with orinkit.open_client(server.url, trace=transcript) as client:
            run = Run(client, rc8, transcript, Watch(server.url, say, recording))
            for number, step in enumerate(program.steps, 1):
                say(f"\n{bold(f'{number:2}. {step.title}')}  [{step.section}]")
                packets, problem = run.carry_out(step)
                for packet in packets:
                    say("\n".join(packet.lines(fields=fields)))
                if problem:
                    raise Failure(f"{name}, {number}. {step.title}: {problem}")
                documents.append(
                    {"list": name, "number": number, "title": step.title, "section": step.section,
                     "packets": [packet.document() for packet in packets]}
                )  # fmt: skip


class Watch:
    """Shows over a second connection where the arm is while a call of the first is at work, and records it."""

    def __init__(self, url: str, say: Callable[[str], None], recording: Recording | None) -> None:
        self._url = url
        self._say = say
        self._recording = recording

    def during(self, call: Callable[[], Any]) -> Any:
        """Return what a call gives, or raise what it raises, and look on meanwhile."""
        import orinkit

        with orinkit.connect(self._url) as rc8, rc8.robot("Arm") as robot, ThreadPoolExecutor(1) as pool:
            robot.execute("StartLog")
            at_work = pool.submit(call)
            while not at_work.done():
                joints = robot.execute("CurJnt")[:6]
                self._say("      " + "  ".join(f"J{n} {value:8.3f}" for n, value in enumerate(joints, 1)))
                wait([at_work], _INTERVAL)
            robot.execute("StopLog")
            if self._recording is not None:
                count = robot.execute("GetLogCount")
                self._recording.records = [robot.execute("GetLogRecord", index) for index in range(count)]
            return at_work.result()


class Run:
    """Carries out steps on one connection and compares the packets that come back with the document."""

    def __init__(self, client: orinkit.Client, rc8: VirtualRC8, transcript: Transcript, watch: Watch) -> None:
        self._watch = watch
        self._client = client
        self._rc8 = rc8
        self._transcript = transcript
        self._handles: dict[str, int] = {}

    def carry_out(self, step: Step) -> tuple[list[Packet], str]:
        """Make the call; returns its packets, and what is not as it should be."""
        from orinkit.cli._demo_steps import Handle
        from orinkit.errors import OrinError

        first = len(self._transcript.packets)
        if step.before is not None:
            step.before(self._rc8)
        arguments = [self._handles[item.name] if isinstance(item, Handle) else item for item in step.arguments]
        try:
            value = self._request(step, arguments)
        except OrinError as error:
            return self._transcript.packets[first:], str(error)
        if step.keep:
            self._handles[step.keep] = value
        packets = self._transcript.packets[first:]
        return packets, compare(packets, step)

    def _request(self, step: Step, arguments: list[Any]) -> Any:
        if step.watch:
            return self._watch.during(lambda: self._client.request(step.function, *arguments).value)
        return self._client.request(step.function, *arguments).value


def compare(packets: list[Packet], step: Step) -> str:
    """Return what differs from the document, ``""`` if nothing does."""
    from orinkit.bcap import packet

    if [each.direction for each in packets] != [">", "<"]:
        return pick("one request and one reply were expected", "要求と応答が 1 つずつではありません")
    request, reply = (packet.decode(each.data, exact=True) for each in packets)
    if (reply.serial, reply.reserved, reply.code) != (request.serial, 0, 0):
        head = (reply.serial, reply.reserved, reply.code)
        return pick(
            f"serial, reserved field and return code are {head}, ({request.serial}, 0, 0) was expected",
            f"シリアル番号、予約、リターンコードが ({request.serial}, 0, 0) ではなく {head} です",
        )
    expected = step.check(reply.arguments)
    if not expected:
        return ""
    return pick(
        f"answered with {reply.arguments}, the document has {expected}",
        f"応答は {reply.arguments} ですが、仕様書では {expected} です",
    )
