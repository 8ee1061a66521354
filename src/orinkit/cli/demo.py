"""``orinkit demo``: a client and a virtual RC8 talk over TCP, and every packet is shown and checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Parameter

from orinkit.cli._connection import Json
from orinkit.cli._errors import Failure
from orinkit.cli._transcript import Packet, Transcript
from orinkit.language import pick

if TYPE_CHECKING:
    import orinkit
    from orinkit.cli._demo_steps import Step
    from orinkit.virtual.rc8 import VirtualRC8

_URL: Final = "tcp://127.0.0.1:0"


def demo(
    *,
    fields: Annotated[
        bool, Parameter(help=pick("Explain every packet field by field.", "全パケットを項目ごとに説明する。"))
    ] = False,
    json: Json = False,
) -> None:
    """Serve a virtual RC8 on a free loopback port and run the document's List 3-1 against it.

    Every answer is compared with the document; exit code 1 if one differs.
    """
    from orinkit.cli._demo_steps import LISTS
    from orinkit.cli._output import print_json

    documents: list[dict[str, Any]] = []
    say: Callable[[str], None] = (lambda _line: None) if json else print
    url = run_lists(LISTS, documents, say, fields=fields)
    if json:
        print_json({"url": url, "steps": documents, "as_documented": True})
    count = len(documents)
    say(pick(f"\nAll {count} answers are as the document says.", f"\n{count} 件の応答はすべて仕様書のとおりでした。"))


def run_lists(
    lists: dict[str, tuple[Step, ...]], documents: list[dict[str, Any]], say: Callable[[str], None], *, fields: bool
) -> str:
    """Run programs of the document against a virtual RC8 of their own; returns where it was.

    Args:
        lists: the programs, by name.
        documents: takes each step with its packets, for JSON.
        say: takes each line for people.
        fields: explain packets field by field.

    Raises:
        Failure: an answer is not as the document says.
    """
    import orinkit
    from orinkit.cli._output import bold
    from orinkit.virtual.rc8 import VirtualRC8

    rc8 = VirtualRC8()
    with orinkit.serve(rc8, _URL) as server:
        say(pick(f"A virtual RC8 listens at {server.url}.", f"仮想 RC8 を {server.url} で起動しました。"))
        for name, steps in lists.items():
            say(
                "\n"
                + bold(
                    pick(
                        f"{name} of the b-CAP specification for RC8, and a look at @MODE and at errors",
                        f"b-CAP 通信仕様書 RC8 用 {name}、および @MODE とエラーの確認",
                    )
                )
            )
            transcript = Transcript()
            with orinkit.open_client(server.url, trace=transcript) as client:
                run = Run(client, rc8, transcript)
                for number, step in enumerate(steps, 1):
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
        return server.url


class Run:
    """Carries out steps on one connection and compares the packets that come back with the document."""

    def __init__(self, client: orinkit.Client, rc8: VirtualRC8, transcript: Transcript) -> None:
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
            value = self._client.request(step.function, *arguments).value
        except OrinError as error:
            return self._transcript.packets[first:], str(error)
        if step.keep:
            self._handles[step.keep] = value
        packets = self._transcript.packets[first:]
        return packets, compare(packets, step)


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
