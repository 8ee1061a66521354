"""How a command reaches a controller and the object on it that it works on."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Final, TypeAlias

from cyclopts import Group, Parameter

import orinkit
from orinkit.bcap.profiles import DEFAULT_TRIES
from orinkit.cao.dialect import RC8 as RC8_DIALECT
from orinkit.cao.dialect import Dialect
from orinkit.cli._shared.errors import unusable
from orinkit.cli._shared.files import read_token
from orinkit.cli._shared.transcript import TracedPacket, Transcript
from orinkit.client._shared.common import RC8, dialect_of
from orinkit.core.errors import CallError, OrinError
from orinkit.core.hresult import signed
from orinkit.core.i18n import printable, tr
from orinkit.transport.registry import examples

Owner: TypeAlias = orinkit.Controller | orinkit.Robot | orinkit.Task | orinkit.Extension | orinkit.File

LOCALHOST: Final = "localhost"
_OF_DENSO: Final = ("caoprov.denso.", "ve026a")
_ASKING: Final = 1.0  # s
_MOST_WORDS: Final = 1000  # characters
CONNECTION = Group(tr("Connection"), sort_key=8)
OBJECT = Group(tr("Object"), sort_key=7)

Url: TypeAlias = Annotated[
    str,
    Parameter(help=tr("Controller: {examples}. A host alone is connected with TCP.", examples=examples())),
]
Json: TypeAlias = Annotated[bool, Parameter(help=tr("Print one JSON document; bytes in hex, dates in ISO 8601."))]  # fmt: skip


@Parameter(name="*", group=CONNECTION)
@dataclass(frozen=True)
class ConnectionOptions:
    """How to connect."""

    provider: Annotated[
        str,
        Parameter(help=tr("Provider name; RC9 and COBOTTA PRO want CaoProv.DENSO.VRC9.")),
    ] = RC8
    timeout: Annotated[
        float | None,
        Parameter(
            help=tr(
                "Seconds for connecting and for each call (3 by default); with UDP and serial lines for each try (0.5)."
            )
        ),
    ] = None
    trace: Annotated[bool, Parameter(help=tr("Show every packet on stderr."))] = False
    tries: Annotated[
        int,
        Parameter(help=tr("How often a request is sent with UDP and serial lines while no answer comes, 1 to 7.")),
    ] = DEFAULT_TRIES

    dialect: Annotated[
        str | None,
        Parameter(help=tr("rc8 or ve026a; by default as provider and version tell.")),
    ] = None

    token_file: Annotated[
        str | None,
        Parameter(help=tr("File with the token that an HTTP server wants to be shown.")),
    ] = None
    cafile: Annotated[
        str | None,
        Parameter(help=tr("PEM file of certificates that an https server's is to be signed by.")),
    ] = None

    machine: Annotated[
        str,
        Parameter(help=tr("Machine name of Controller_Connect; behind a gateway it says which controller.")),
    ] = LOCALHOST
    option: Annotated[
        str | None,
        Parameter(
            help=tr(
                'Option of Controller_Connect, as the provider wants it: "Interface=socketcan, '
                'Channel=can0, Address=1" with CaoProv.Waco.ABH3.'
            ),
        ),
    ] = None

    @property
    def known_dialect(self) -> Dialect:
        """Dialect of the controller as far as it can be known before the controller is asked."""
        return dialect_of(self.dialect, self.provider) or RC8_DIALECT

    def open(self, url: str, alive: float | None = None) -> orinkit.Controller:
        """Connect to the controller; ``alive`` as :func:`orinkit.connect` has it."""
        return orinkit.connect(
            url,
            provider=self.provider,
            machine=self.machine,
            option=self.option or "",
            timeout=self.timeout,
            tries=self.tries,
            trace=self._transcript(),
            dialect=self.dialect,
            token=self._token(),
            cafile=self.cafile or "",
            alive=alive,
        )

    @contextmanager
    def opened(self, url: str) -> Iterator[orinkit.Controller]:
        """Connect to the controller for a ``with`` statement; an error of it is told in its own words, where it has any."""
        with self.open(url) as controller:
            try:
                yield controller
            except CallError as error:
                if not error.detail and not self._denso:
                    error.detail = _words(controller, error)
                raise

    @property
    def _denso(self) -> bool:
        """Whether the provider is one of DENSO's, whose codes are known here."""
        provider = self.provider.strip().casefold()
        return not provider or any(name in provider for name in _OF_DENSO)

    def open_client(self, url: str) -> orinkit.Client:
        """Open the connection only."""
        return orinkit.open_client(
            url,
            timeout=self.timeout,
            tries=self.tries,
            trace=self._transcript(),
            token=self._token(),
            cafile=self.cafile or "",
        )

    def _token(self) -> str:
        return "" if self.token_file is None else read_token(self.token_file)

    def _transcript(self) -> Transcript | None:
        return Transcript(_to_stderr) if self.trace else None


def _words(controller: orinkit.Controller, error: CallError) -> str:
    """Return what a controller says of an error when it is asked for it; ``""`` where it says no more than the code does."""
    client = controller.client
    client.timeout, client.tries = min(client.timeout, _ASKING), 1  # for what is left, too: the error is to be told now
    try:
        words = controller.execute("GetErrorDescription", signed(error.code))
    except (OrinError, KeyboardInterrupt):  # the error is more than its words
        return ""
    if not isinstance(words, str) or words.strip() in ("", error.info.en, error.info.ja):
        return ""
    return printable(" ".join(words.split()), _MOST_WORDS)


def _to_stderr(packet: TracedPacket) -> None:
    for line in packet.lines():
        print(line, file=sys.stderr)


@Parameter(name="*", group=OBJECT)
@dataclass(frozen=True)
class OwnerOptions:
    """Whose variable it is; the controller's if nothing is named."""

    robot: Annotated[str | None, Parameter(help=tr("A robot, by name."))] = None
    task: Annotated[str | None, Parameter(help=tr("A task, by name."))] = None
    extension: Annotated[str | None, Parameter(help=tr("An extension board, by name."))] = None
    file: Annotated[str | None, Parameter(help=tr("A file, by name."))] = None

    def of(self, controller: orinkit.Controller) -> Owner:
        """Return the object that is named, the controller if none is."""
        named = [name for name in ("robot", "task", "extension", "file") if getattr(self, name) is not None]
        if len(named) > 1:
            options = " ".join(f"--{name}" for name in named)
            raise unusable(tr("give only one of {options}", options=options))
        if self.robot is not None:
            return controller.robot(self.robot)
        if self.task is not None:
            return controller.task(self.task)
        if self.extension is not None:
            return controller.extension(self.extension)
        return controller.file(self.file) if self.file is not None else controller
