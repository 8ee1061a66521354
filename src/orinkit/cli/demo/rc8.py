"""``orinkit demo``: a client calls a virtual controller; every packet is shown and checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from logging import NullHandler, getLogger
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import Parameter

from orinkit.cli._shared.connection import Json
from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli._shared.transcript import TracedPacket, Transcript
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import orinkit
    from orinkit.cli._shared.stream_report import StreamReport
    from orinkit.cli._shared.stream_trace import StreamTrace
    from orinkit.cli.demo.steps import DemoProgram, DemoStep, StreamStep
    from orinkit.virtual.rc8 import VirtualRC8

_URL: Final = "tcp://127.0.0.1:0"
_INTERVAL: Final = 0.15
_PATIENCE: Final = 30.0  # s for a reply: the virtual controller runs on this machine, which may be busy
_LOGS: Final = ("orinkit.rc8", "orinkit.ve026a")


def demo(
    device: Annotated[
        Literal["rc8", "ve026a"],
        Parameter(help=tr("Device to demonstrate: rc8 over TCP, or ve026a over a pseudo-terminal.")),
    ] = "rc8",
    /,
    *,
    fields: Annotated[
        bool, Parameter(help=tr("Explain every packet field by field."))
    ] = False,
    json: Json = False,
    picture: Annotated[
        str | None,
        Parameter(help=tr("File for a picture of the motion (.png, .svg, .pdf). A picture of the motion in slave mode is saved "
            "in the same directory.")),
    ] = None,
) -> None:  # fmt: skip
    """Serve virtual RC8s on free loopback ports and run Lists 3-1, 3-2, 3-3 and 4-1 of the RC8 document against them.

    With ``ve026a``, serve a virtual VE026A at a pseudo-terminal and run the procedure of section 6.2 of the VE026A
    document. Every reply is compared with the document; the exit code is 1 if a reply differs.
    """
    from orinkit.cli._shared.output import print_json

    say: Callable[[str], None] = (lambda _line: None) if json else print
    if picture is not None and device != "rc8":
        raise usage_error(tr("--picture is available for rc8 only"))
    with quiet_logs():
        if device == "rc8":
            document = _demo_rc8(say, picture, fields=fields)
        else:
            from orinkit.cli.demo import ve026a

            document = ve026a.run(say, fields=fields)
    if json:
        print_json(document)


@contextmanager
def quiet_logs() -> Iterator[None]:
    """Keep the logs of the virtual controllers off stderr: the demo itself reports late set-points."""
    handler = NullHandler()
    for name in _LOGS:
        getLogger(name).addHandler(handler)
    try:
        yield
    finally:
        for name in _LOGS:
            getLogger(name).removeHandler(handler)


def _demo_rc8(say: Callable[[str], None], picture: str | None, *, fields: bool) -> dict[str, Any]:
    """Run the programs of the RC8 document; return the steps, for JSON."""
    from orinkit.cli.demo.steps import LISTS

    documents: list[dict[str, Any]] = []
    recording = DemoRecording()
    for name, program in LISTS.items():
        run_program(name, program, documents, say, fields=fields, recording=recording)
    motion, slave = (None, None) if picture is None else recording.draw(Path(picture))
    count = sum(document["answers"] for document in documents)
    say(tr("\nAll {count} replies match the document.", count=count))
    if motion is not None:
        say(
            tr(
                "Pictures: the motion of the arm in {motion}, command and feedback of slave mode in {slave}.",
                motion=motion,
                slave=slave,
            )
        )
    return {"steps": documents, "as_documented": True, "picture": motion, "slave_picture": slave}


class DemoRecording:
    """Data for the pictures: the control log of the motion, and command and feedback of slave mode."""

    def __init__(self) -> None:
        self.records: list[list[float]] = []
        self.trace: StreamTrace | None = None

    def draw(self, path: Path) -> tuple[str, str]:
        """Draw the picture of the motion, and the picture of slave mode in the same directory; return both file names.

        Raises:
            CommandError: If matplotlib is not installed, or a file cannot be written.
        """
        from orinkit.cli._shared import motion_plot, stream_plot
        from orinkit.cli._shared.motion_record import command_and_encoder, recording_of
        from orinkit.cli._shared.picture import save

        motion, trace = recording_of([command_and_encoder(record) for record in self.records]), self.trace
        assert trace is not None
        beside = path.with_stem("slave" if path.stem != "slave" else "slave-mode")
        save(lambda figure, label: motion_plot.draw(motion, figure, label), path)
        save(lambda figure, label: stream_plot.draw(trace, figure, label), beside)
        return str(path), str(beside)


def run_program(
    name: str, program: DemoProgram, documents: list[dict[str, Any]], say: Callable[[str], None], *, fields: bool,
    recording: DemoRecording | None = None,
) -> None:  # fmt: skip
    """Run a program of the document against its own virtual RC8.

    Args:
        name: Name of the program in the document.
        program: The program.
        documents: List to which each step is appended with its packets, for JSON.
        say: Callback invoked with each line to be printed.
        fields: True to explain packets field by field.
        recording: Object in which the data for the pictures is stored.

    Raises:
        CommandError: If a reply differs from the document.
    """
    import orinkit
    from orinkit.cli._shared.terminal import bold
    from orinkit.virtual.rc8 import VirtualRC8

    rc8 = VirtualRC8()
    with orinkit.serve(rc8, _URL) as server:
        heading = tr("{name} of the b-CAP specification for RC8: {title}", name=name, title=program.title)
        say(bold(f"\n{heading}"))
        say(tr("A virtual RC8 listens at {url}.", url=server.url))
        transcript = Transcript()
        with orinkit.open_client(server.url, timeout=_PATIENCE, trace=transcript) as client:
            run = DemoRun(client, rc8, transcript, MotionDisplay(server.url, say, recording), fields=fields)
            for number, step in enumerate(program.steps, 1):
                say(f"\n{bold(f'{number:2}. {step.title}')}  [{step.section}]")
                outcome = run.carry_out(step)
                for line in outcome.lines:
                    say(line)
                if outcome.problem:
                    raise CommandError(f"{name}, {number}. {step.title}: {outcome.problem}")
                documents.append(
                    {"list": name, "number": number, "title": step.title, "section": step.section, **outcome.document()}
                )


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """Result of a step.

    Attributes:
        packets: The packets of the step.
        lines: Lines that are still to be shown.
        problem: Difference from the document; ``""`` if there is none.
        report: Report of a stream; ``None`` if the step is a call.
    """

    packets: list[TracedPacket]
    lines: list[str]
    problem: str
    report: StreamReport | None = None

    def document(self) -> dict[str, Any]:
        """Return the result for JSON."""
        document: dict[str, Any] = {"answers": 1, "packets": [packet.document() for packet in self.packets]}
        if self.report is not None:
            document["answers"] = self.report.result.sent
            document["stream"] = self.report.document()
        return document


class MotionDisplay:
    """Shows and records the joint position during a call; a second connection reads the position."""

    def __init__(self, url: str, say: Callable[[str], None], recording: DemoRecording | None) -> None:
        self._url = url
        self.say = say
        self.recording = recording

    def during(self, call: Callable[[], Any], *, log: bool) -> Any:
        """Show the joint position during a call; return the result of the call or raise its exception.

        Args:
            call: The call.
            log: True to keep the control log.
        """
        import orinkit
        from orinkit.cli.demo.stream import joints_line

        with (
            orinkit.connect(self._url, timeout=_PATIENCE) as rc8,
            rc8.robot("Arm") as robot,
            ThreadPoolExecutor(1) as pool,
        ):
            robot.execute("StartLog")
            self.say(joints_line(robot.execute("CurJnt")[:6]))
            running = pool.submit(call)
            while wait([running], _INTERVAL).not_done:
                self.say(joints_line(robot.execute("CurJnt")[:6]))
            robot.execute("StopLog")
            self.say(joints_line(robot.execute("CurJnt")[:6]))
            if log and self.recording is not None:
                count = robot.execute("GetLogCount")
                self.recording.records = [robot.execute("GetLogRecord", index) for index in range(count)]
            return running.result()


class DemoRun:
    """Executes steps on one connection and compares the replies with the document."""

    def __init__(
        self, client: orinkit.Client, rc8: VirtualRC8, transcript: Transcript, watch: MotionDisplay, *, fields: bool
    ) -> None:
        self._fields = fields
        self._watch = watch
        self._client = client
        self._rc8 = rc8
        self._transcript = transcript
        self._saved: dict[str, Any] = {}

    def carry_out(self, step: DemoStep | StreamStep) -> StepOutcome:
        """Execute a step: a call, or a stream."""
        from orinkit.cli.demo.steps import StreamStep
        from orinkit.core.errors import OrinError

        first = len(self._transcript.packets)
        try:
            if isinstance(step, StreamStep):
                return self._stream(step, first)
            self._call(step)
            problem = compare(self._transcript.packets[first:], step)
        except OrinError as error:
            problem = str(error)
        return StepOutcome(self._transcript.packets[first:], self._packets_since(first), problem)

    def _call(self, step: DemoStep) -> None:
        if step.before is not None:
            step.before(self._rc8)
        arguments = [self._given(argument) for argument in step.arguments]

        def request() -> Any:
            return self._client.request(step.function, *arguments).value

        value = self._watch.during(request, log=step.log) if step.watch else request()
        if step.save_as:
            self._saved[step.save_as] = value

    def _stream(self, step: StreamStep, first: int) -> StepOutcome:
        from orinkit.cli.demo import stream

        watch, points = self._watch, step.points(self._given(step.start))
        handles = self._given(step.controller), self._given(step.robot)

        shown = first

        def entered() -> None:
            nonlocal shown
            for line in self._packets_since(shown):
                watch.say(line)
            shown = len(self._transcript.packets)

        report, problem = stream.carry_out(self._client, handles, points, step.mode, watch.say, entered)
        if watch.recording is not None:
            watch.recording.trace = report.trace
        lines = [f"      {line}" for line in report.lines()]
        return StepOutcome(self._transcript.packets[first:], lines, problem, report)

    def _packets_since(self, first: int) -> list[str]:
        """Return the packets from index ``first`` on as texts for people."""
        return ["\n".join(packet.lines(fields=self._fields)) for packet in self._transcript.packets[first:]]

    def _given(self, argument: Any) -> Any:
        """Return an argument; replace a HandleOf by the result of the earlier step that it names."""
        from orinkit.cli.demo.steps import HandleOf

        return self._saved[argument.name] if isinstance(argument, HandleOf) else argument


def compare(packets: list[TracedPacket], step: DemoStep) -> str:
    """Return the difference of a reply from the document; ``""`` if there is none.

    S_EXECUTING packets may precede the reply (RC8 3.1.1).
    """
    from orinkit.bcap import packet
    from orinkit.core import hresult

    decoded = [packet.decode(each.data, exact=True) for each in packets]
    directions = "".join(each.direction for each in packets)
    early = [each for each in decoded[1:-1] if each.code != hresult.S_EXECUTING]
    if len(decoded) < 2 or early or directions != ">" + "<" * (len(decoded) - 1):
        return tr("expected one request and one reply")
    request, reply = decoded[0], decoded[-1]
    head = (reply.serial, reply.reserved, reply.code)
    if head != (request.serial, 0, 0):
        return tr(
            "serial number, reserved field and return code are {received}; the document has ({serial}, 0, 0)",
            received=head,
            serial=request.serial,
        )
    expected = step.check(reply.arguments)
    if not expected:
        return ""
    return tr("the reply is {arguments}; the document has {expected}", arguments=reply.arguments, expected=expected)
