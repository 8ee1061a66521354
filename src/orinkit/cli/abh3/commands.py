"""``orinkit abh3``: monitor ABH3 motor drivers on CAN, decode logs, and generate a DBC file."""

from __future__ import annotations

import sys
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from orinkit.cli._shared.errors import usage_error, whole_number
from orinkit.cli.abh3.bus import FRAMES, BusOptions, FrameOptions, JsonLines, Url, default_text, whole_numbers
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    from orinkit.abh3.table.decoder import DecodedFrame, Decoder
    from orinkit.can.bus import Bus

_BUS: Final = BusOptions()
_FRAMES: Final = FrameOptions()
_SLICE: Final = 0.1  # s


def monitor(
    url: Url = None,
    /,
    *,
    plain: Annotated[
        bool,
        Parameter(help=tr("Print a line per frame instead of a table; the default if stdout is not a terminal.")),
    ] = False,
    json: JsonLines = False,
    count: Annotated[
        int | None,
        Parameter(converter=whole_number, help=tr("Number of frames after which to end.")),
    ] = None,
    seconds: Annotated[
        float | None, Parameter(help=tr("Time in seconds after which to end."))
    ] = None,
    frames: FrameOptions = _FRAMES,
    bus: BusOptions = _BUS,
) -> int:  # fmt: skip
    """Show and decode the frames on a bus until Ctrl-C is pressed. The command only listens and never sends."""
    address = bus.address(url)
    decoder = frames.decoder()
    for option, number in (("--count", count), ("--seconds", seconds)):
        if number is not None and not number > 0:
            raise usage_error(tr("{option} must be more than 0, not {number}", option=option, number=number))

    from orinkit.can.bus import Bus

    opened = Bus.open(address)
    try:
        as_table = not (plain or json) and _on_terminal()
        if not _show(opened, decoder, (count, seconds), as_json=json, as_table=as_table):
            print(
                tr("orinkit: no frames received on {address}", address=address),
                file=sys.stderr,
            )
    except KeyboardInterrupt:
        pass
    finally:
        opened.close()
    return 0


def _on_terminal() -> bool:
    return sys.stdout is not None and sys.stdout.isatty()  # None if the shell has closed it (>&-)


def _show(
    bus: Bus, decoder: Decoder, limits: tuple[int | None, float | None], *, as_json: bool, as_table: bool
) -> bool:
    """Show frames until a number of frames or a time in s is reached; return True if there were any."""
    seen = False
    count, seconds = limits
    end = None if seconds is None else monotonic() + seconds
    if as_table:
        from orinkit.cli.abh3.live_table import LiveTable

        with LiveTable() as table:
            while count != 0 and (left := _left(end)) > 0:
                frame = bus.receive(min(left, _SLICE))
                if frame is not None:
                    seen = True
                    table.add(decoder.decode(frame))
                    count = count and count - 1
                table.refresh()
        return seen
    while count != 0 and (left := _left(end)) > 0:
        frame = bus.receive(min(left, _SLICE))
        if frame is not None:
            seen = True
            _print(decoder.decode(frame), as_json=as_json)
            count = count and count - 1
    return seen


def _left(end: float | None) -> float:
    return _SLICE if end is None else end - monotonic()


def _print(decoded: DecodedFrame, *, as_json: bool) -> None:
    from orinkit.cli.abh3.show import json_line, line

    print((json_line if as_json else line)(decoded), flush=True)


def decode(
    file: Annotated[
        str,
        Parameter(
            allow_leading_hyphen=True,
            help=tr(
"Log file: .log or .txt (output of candump or python -m can.logger), .asc, .blf, .csv or .trc; - reads output of "
"candump or python -m can.logger from stdin."),
        ),
    ],
    /,
    *,
    json: JsonLines = False,
    frames: FrameOptions = _FRAMES,
) -> int:  # fmt: skip
    """Decode the frames of a log, one per line; exit with code 1 if there are lines that are not frames."""
    from orinkit.cli.abh3.logs import FrameLog

    decoder = frames.decoder()
    log = FrameLog(file)
    for frame in log:
        _print(decoder.decode(frame), as_json=json)
    if log.skipped:
        print(
            tr(
"orinkit: {count} frames skipped: standard identifiers, remote, error or FD "
"frames", count=log.skipped),
            file=sys.stderr,
        )  # fmt: skip
    log.raise_for_errors()
    return 0


def dbc(
    *,
    dialect: Annotated[
        str, Parameter(group=FRAMES, help=tr("v1 (as in the manufacturer's document) or v2 (2023 and later)."))
    ] = "v1",
    address: Annotated[
        tuple[int, ...],
        Parameter(
            group=FRAMES,
            converter=whole_numbers,
            show_default=default_text,
            help=tr("Address of a driver; may be repeated."),
        ),
    ] = (1,),
    host: Annotated[
        int, Parameter(group=FRAMES, converter=whole_number, help=tr("Address of the host."))
    ] = 2,
    group: Annotated[
        int,
        Parameter(group=FRAMES, converter=whole_number, help=tr("Broadcast group.")),
    ] = 5,
    load_unit: Annotated[
        float, Parameter(group=FRAMES, help=tr("Unit of load values in %: 1 or 0.1."))
    ] = 1.0,
) -> int:  # fmt: skip
    """Print a DBC file of all frames. Example: orinkit abh3 dbc > abh3.dbc; candump can0 | cantools decode abh3.dbc."""
    from orinkit.abh3.table import dbc as made

    print(made.dbc(dialect, addresses=address, host=host, group=group, load_unit=load_unit), end="")
    return 0
