"""Virtual controllers that the Tester starts as child processes: :class:`Simulators`."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import signal
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from orinkit.core.errors import ConnectFailed, InvalidValue
from orinkit.core.i18n import N_, current, tr, translate
from orinkit.tester.state.connection_spec import ConnectionSpec

MAX_SIMULATORS: Final = 8
_READY: Final = 30.0  # s in which a virtual controller must be ready
_EXIT: Final = 5.0  # s
_PR_SET_PDEATHSIG: Final = 1
_SHOWN: Final = 2000


@dataclass(frozen=True, slots=True)
class SimulatorKind:
    """A kind of virtual controller.

    Attributes:
        key: Key of the kind.
        label: Name for users, in English.
        hint: What it is, in English.
        arguments: Arguments of the command ``orinkit``.
        provider: Provider name for the connection.
        has_pendant: True if the controller has a control port.
    """

    key: str
    label: str
    hint: str
    arguments: Sequence[str]
    provider: str = "CaoProv.DENSO.VRC"
    has_pendant: bool = False


KINDS: Final = {
    kind.key: kind
    for kind in (
        SimulatorKind(
            "rc8", N_("Virtual RC8"), N_("A robot controller with a six-axis arm that moves, over TCP, with its pendant."),
            ("serve", "rc8", "--tcp", "127.0.0.1:0", "--control", "127.0.0.1:0"), has_pendant=True,
        ),
        SimulatorKind("ve026a", N_("Virtual VE026A"), N_("A small educational arm on a serial line."), ("serve", "ve026a", "--pty"), provider=""),
        SimulatorKind("abh3", N_("Virtual ABH3"), N_("A motor driver with two axes on a CAN bus."), ("serve", "abh3", "pty://")),
    )
}  # fmt: skip
"""The kinds of virtual controllers, by key."""


class Simulator:
    """A virtual controller in a child process.

    Attributes:
        kind: The kind.
        spec: The parameters of a connection to it.
    """

    def __init__(self, kind: SimulatorKind, process: asyncio.subprocess.Process, spec: ConnectionSpec) -> None:
        self.kind = kind
        self.spec = spec
        self._process = process
        self._drains = [asyncio.create_task(_drain(stream)) for stream in (process.stdout, process.stderr) if stream]

    @property
    def running(self) -> bool:
        """True if the process has not ended."""
        return self._process.returncode is None

    async def stop(self) -> None:
        """End the process: first with SIGTERM, after 5 s with SIGKILL."""
        await _end(self._process)
        for drain in self._drains:
            drain.cancel()


class Simulators:
    """The virtual controllers that this Tester has started."""

    def __init__(self) -> None:
        self._running: list[Simulator] = []
        self._numbers: dict[str, int] = {}

    def __iter__(self) -> Iterator[Simulator]:
        return iter([each for each in self._running if each.running])

    async def start(self, key: str, *options: str) -> Simulator:
        """Start a virtual controller.

        Args:
            key: Key of the kind.
            *options: Further options of ``orinkit serve``.

        Raises:
            InvalidValue: If too many virtual controllers are running.
            ConnectFailed: If the virtual controller does not start; the message contains its output.
        """
        kind = KINDS[key]
        if len(list(self)) >= MAX_SIMULATORS:
            raise InvalidValue(tr("at most {most} virtual controllers can run. Try: stop one", most=MAX_SIMULATORS))
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "orinkit", *kind.arguments, *options,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
            start_new_session=True, preexec_fn=_end_with_parent,
        )  # fmt: skip
        try:
            lines = await asyncio.wait_for(_ready_lines(process, kind), _READY)
        except BaseException as error:
            await _end(process)
            if not isinstance(error, TimeoutError | EOFError):
                raise
            output = (await process.stderr.read(_SHOWN)).decode(errors="replace") if process.stderr else ""
            raise ConnectFailed(tr("{name} did not start: {output}", name=tr(kind.label), output=output)) from None
        number = self._numbers[key] = self._numbers.get(key, 0) + 1
        label = translate(current(), kind.label)  # a name, which must not change with the language of a page
        name = label if number == 1 else f"{label} {number}"
        spec = ConnectionSpec(
            name, lines["ready"], provider=kind.provider, control=lines.get("ready control", ""),
            secret=lines.get("control secret", ""),
        )  # fmt: skip
        simulator = Simulator(kind, process, spec)
        self._running = [each for each in self._running if each.running] + [simulator]
        return simulator

    async def stop_all(self) -> None:
        """End all virtual controllers."""
        await asyncio.gather(*(each.stop() for each in self))


async def _ready_lines(process: asyncio.subprocess.Process, kind: SimulatorKind) -> dict[str, str]:
    """Read the lines of a server until it is ready; return the word after each keyword.

    Raises:
        EOFError: If the server ends.
    """
    wanted = {"ready", *(("ready control", "control secret") if kind.has_pendant else ())}
    found: dict[str, str] = {}
    assert process.stdout is not None
    while not wanted <= found.keys():
        line = (await process.stdout.readline()).decode()
        if not line:
            raise EOFError
        words = line.split()
        if len(words) >= 2:
            found[" ".join(words[:-1])] = words[-1]
    return found


async def _drain(stream: asyncio.StreamReader) -> None:
    while await stream.read(65536):
        pass


async def _end(process: asyncio.subprocess.Process) -> None:
    if process.returncode is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), _EXIT)
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _end_with_parent() -> None:
    """Let the kernel end this process if the Tester is killed (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
