"""``orinkit raw``: send packets in hex, without changing them."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from orinkit.cli._shared.errors import usage_error
from orinkit.cli._shared.files import read
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from orinkit.bcap.dissect import Kind
    from orinkit.bcap.profiles import BcapProfile
    from orinkit.raw.exchange import LoopProgress, RawExchange
    from orinkit.raw.options import RawOptions

_ONE_BYTE: Final = re.compile(r"(?:0[xX]|\\x)?[0-9A-Fa-f]{1,2},?")
_FOREVER: Final = 3600.0  # s; a server that receives nothing asks again


def raw(
    url: Annotated[
        str,
        Parameter(
            name="URL",
            help=tr(
                "Address (tcp://, udp://, serial://), or the parameters of Raw Packet Mode: "
                '"Conn=eth:192.168.0.1:5007, Timeout=300, PacketOpt=0:0:0, EtherOpt=0:0, Sync=True".'
            ),
        ),
    ],
    /,
    *hex_bytes: Annotated[
        str,
        Parameter(
            "HEX",
            allow_leading_hyphen=True,
            required=True,
            help=tr(
                "Packets in hex, one per argument; arguments of one byte are joined to a packet. @FILE reads a file and - "
                "stdin, in which blank lines separate packets."
            ),
        ),
    ],
    hex: Annotated[bool, Parameter(help=tr("Print only the hex of the replies."))] = False,  # noqa: A002 - the option
    count: Annotated[int, Parameter(help=tr("Number of times to send all packets; the rates are printed."))] = 1,
    timeout: Annotated[
        float | None,
        Parameter(help=tr("Time-out in seconds for connecting and for each reply; 0.5 by default.")),
    ] = None,
) -> int:  # fmt: skip
    """Send packets in hex unchanged, and print the explained replies; exit with code 1 if a packet has no reply.

    No function is called before. As a server (EtherOpt 1 or 3), print each received packet and send the next one of the
    given packets in reply.
    """
    import asyncio
    from dataclasses import replace

    from orinkit.raw.options import RawOptions

    options = RawOptions.parse(url)
    if timeout is not None:
        options = replace(options, timeout=timeout)
    if count < 1:
        raise usage_error(tr("--count must be at least 1, not {count}", count=count))
    packets = read_packets(hex_bytes, options.role.profile, "reply" if options.role.serves else "request")
    if options.role.serves:
        if count > 1:
            raise usage_error(tr("--count does not apply to a server"))
        return asyncio.run(_serve(options, packets, only_hex=hex))
    return asyncio.run(_send(options, packets, count, only_hex=hex))


# --- packets ----------------------------------------------------------------------------------------------------------


def read_packets(words: Iterable[str], profile: BcapProfile, kind: Kind = "request") -> list[bytes]:
    """Return the packets of the command line; print a warning for each malformed one.

    Args:
        words: The arguments of the command.
        profile: Properties of the transport.
        kind: ``"reply"`` if this side is a server.

    Raises:
        CommandError: If a text is not hex, or there is no packet.
    """
    from orinkit.core.errors import InvalidValue
    from orinkit.raw.packets import parse_packets

    found = parse_packets("\n\n".join(_texts(words)), profile, kind)
    try:
        packets = found.sendable()
    except InvalidValue as error:
        raise usage_error(str(error)) from None
    for problem in found.problems:
        text = tr("packet {number}: {text}", number=problem.packet + 1, text=problem.text)
        print(tr("orinkit: warning: {text}", text=text), file=sys.stderr)
    return packets


def _texts(words: Iterable[str]) -> Iterator[str]:
    """Yield the text of each packet; words of one byte are joined."""
    single: list[str] = []
    for word in words:
        if _ONE_BYTE.fullmatch(word):
            single.append(word)
            continue
        if single:
            yield " ".join(single)
            single.clear()
        if word == "-":
            yield sys.stdin.read()
        elif word.startswith("@"):
            yield read("HEX", word[1:]).decode("ascii", "replace")
        else:
            yield word
    yield " ".join(single)


# --- client -----------------------------------------------------------------------------------------------------------


async def _send(options: RawOptions, packets: list[bytes], count: int, *, only_hex: bool) -> int:
    from orinkit.raw.exchange import RawExchange

    async with await RawExchange.open(options) as exchange:
        if count > 1:
            return await _loop(exchange, packets, count, only_hex=only_hex)
        missing = 0
        for number, data in enumerate(packets, 1):
            reply = await exchange.send(data)
            if reply is not None:
                show_packet(reply, data, only_hex=only_hex)
            elif options.sync:
                missing += 1
                print(no_reply(number, options.timeout), file=sys.stderr)
    return int(missing > 0)


def no_reply(number: int, seconds: float) -> str:
    """Return the message for a packet without a reply."""
    return tr("orinkit: packet {number}: no reply within {seconds:g} s", number=number, seconds=seconds)


def show_packet(data: bytes, request: bytes | None = None, *, only_hex: bool = False, sent: bool = False) -> None:
    """Print a packet: explained, or only its bytes in hex.

    Args:
        data: The packet.
        request: For a reply, the packet that it answers.
        only_hex: True to print only the bytes.
        sent: True for a packet that this side has sent.
    """
    from orinkit.bcap.dissect import explain, one_line
    from orinkit.cli._shared.terminal import bold
    from orinkit.cli._shared.transcript import field_lines

    if only_hex:
        print(data.hex(" "))
        return
    arrow = "→" if sent else "←"
    print("\n".join([bold(f"{arrow} {one_line(data, request)}"), *field_lines(explain(data, request=request))]))


async def _loop(exchange: RawExchange, packets: list[bytes], count: int, *, only_hex: bool) -> int:
    from orinkit.cli._shared.moving import ProgressBar

    with ProgressBar() as bar:

        def progress(state: LoopProgress) -> None:
            if bar.seen:
                bar.show(tr("sending"), state.rounds / state.count, f"{state.rate:.0f}/s")

        done = await exchange.loop(packets, count, progress)
    if done.reply is not None:
        show_packet(done.reply, packets[-1], only_hex=only_hex)
    if not only_hex:
        print(
            tr(
                "{sent} packets sent, {replies} replies, {seconds:.3f} s, {rate:.0f} packets/s",
                sent=done.sent,
                replies=done.replies,
                seconds=done.seconds,
                rate=done.rate,
            )
        )
    return int(exchange.options.sync and done.replies < done.sent)


# --- server -----------------------------------------------------------------------------------------------------------


async def _serve(options: RawOptions, packets: list[bytes], *, only_hex: bool) -> int:
    from orinkit.raw.exchange import RawExchange

    async with await RawExchange.open(options) as exchange:
        print(f"ready {exchange.url}", flush=True)
        for data in packets:
            request = None
            while request is None:
                request = await exchange.receive(_FOREVER)
            show_packet(request.data, only_hex=only_hex)
            await exchange.send(data, request.peer, wait=False)
            if not only_hex:
                show_packet(data, request.data, sent=True)
            sys.stdout.flush()
    return 0
