"""Check the documents: programs run, commands print the output shown, and links are valid.

Each page of ``PAGES`` is executed from top to bottom, in its own directory, in English:

* A ``python`` block is executed; all blocks of a page share one namespace, as one program. The comments ``# -> text`` are, in
  order, the lines that the block prints.
* A ``console`` block is a terminal. ``$ orinkit ...`` is executed (``NAME=value`` may precede it), and the lines below it are
  its output, on stdout and stderr. The command must succeed; otherwise, ``$ echo $?`` after it shows the exit code.
  ``$ orinkit serve ...`` and ``$ orinkit gateway ...`` run until the end of the page, and must then stop cleanly; their log
  on stderr is not shown. ``$ curl ...`` and ``$ sh examples/...`` are executed unchanged, without curl's progress. Other
  commands are not allowed.
* ``...`` matches anything within a line; alone on a line, it matches any number of lines.
* ``<!-- not run: reason -->`` above a block skips it. ``<!-- saved as: NAME.py -->`` also writes it to a file before it is
  executed.

Addresses are written as a reader would type them. During execution, ``127.0.0.1:5007`` and ``192.168.0.1:5007`` (also plain
``192.168.0.1``) are replaced by the address of a virtual RC8, which the test serves unless the page does. Any other
``127.0.0.1:PORT`` is replaced by a free port, the same one throughout the page, for servers of the page itself. Port 0 is not
replaced. A pseudo-terminal that ``serve`` has printed (``/dev/pts/3``) is replaced by the one that it has opened. Output is
compared with the addresses as written. Pages with a multicast CAN bus, which is shared by the whole machine, run one at a time.

A motor on CAN stops by itself if no reply or command arrives for 0.5 s. A busy machine may need longer, so these times are
increased during execution.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import random
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import IO

import pytest

import orinkit
from orinkit.abh3.aio import AsyncDriver
from orinkit.abh3.api.names import Driver
from orinkit.virtual.rc8 import VirtualRC8
from support.pages import ROOT, Block, blocks
from support.waiting import PATIENCE, until

pytestmark = pytest.mark.slow

TWINS = ("README.md", "README.ja.md")
# the Japanese README has the same code as the English one; another test checks this
PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs" / "howto").glob("*.md"))]
DOCUMENTS = [*TWINS, "CHANGELOG.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md"))]

ADDRESS = re.compile(r"127\.0\.0\.1:(\d+)|192\.168\.0\.1(?::5007)?(?![\d.:])")
TERMINAL = re.compile(r"/dev/(?:pts/|ttys)\d+")
MULTICAST = "udp_multicast"
MULTICAST_PORT = 43113
VIRTUAL = "127.0.0.1:5007"
SERVES_VIRTUAL = re.compile(r"^\$ orinkit serve(?!.*127\.0\.0\.1:(?!5007))(?! ve026a| device| abh3)", re.MULTILINE)
LISTENING = ("--tcp", "--udp", "--serial", "--pty", "--http")
HANGS = 300
"""Seconds after which a command hangs; the slowest one takes 15 s on a machine that does nothing else."""
PATIENT = f"""
import sys
from orinkit.__main__ import main
from orinkit.abh3.aio import AsyncDriver
from orinkit.cli.abh3 import drive as _abh3_drive
AsyncDriver.keep_alive.__kwdefaults__["patience"] = {PATIENCE}
_abh3_drive._MAX_COMMAND_DELAY = {PATIENCE}
sys.exit(main())
"""
"""The program, with longer times for motors on CAN."""
PORTS = range(15_000, 32_000)
"""Below those that Linux gives to outgoing connections."""
CURL = re.compile(r"^\$ (?:curl|sh examples/)", re.MULTILINE)


# --- running a page ---------------------------------------------------------------------------------------------------


class Addresses:
    """Maps the addresses written in a page to those used during execution."""

    def __init__(self) -> None:
        self._real: dict[str, str] = {}

    def set(self, written: str, real: str) -> None:
        """Set the address used during execution."""
        self._real[written] = real

    def real(self, text: str) -> str:
        """Return a text with the addresses used during execution."""
        text = TERMINAL.sub(lambda match: self._real.get(match[0], match[0]), text)
        return ADDRESS.sub(lambda match: self._of(match[0], match[1]), text)

    def written(self, text: str) -> str:
        """Return a text with the addresses as written in the page."""
        written = {real: name for name, real in self._real.items()}
        if not written:
            return text
        return re.sub(rf"(?:{'|'.join(map(re.escape, written))})(?!\d)", lambda match: written[match[0]], text)

    def _of(self, written: str, port: str | None) -> str:
        if port == "0":
            return written
        key = VIRTUAL if port is None else written
        if key not in self._real:
            before = self._real.get(f"127.0.0.1:{int(port) - 1}") if port else None
            number = int(before.rpartition(":")[2]) + 1 if before else self.free_port()  # serve rc8 --count
            self._real[key] = f"127.0.0.1:{number}"
        return self._real[key]

    def free_port(self) -> int:
        """Return a port on which nothing listens, nor on the next two, outside the range of ephemeral ports."""
        for port in random.sample(PORTS[:-2], len(PORTS) - 2):
            with contextlib.ExitStack() as sockets, contextlib.suppress(OSError):
                for number, kind in product(range(port, port + 3), (socket.SOCK_STREAM, socket.SOCK_DGRAM)):
                    sockets.enter_context(socket.socket(type=kind)).bind(("127.0.0.1", number))
                return port
        raise AssertionError("no port is free")


class Terminal:
    """Executes the console blocks of a page."""

    def __init__(self, addresses: Addresses) -> None:
        self.addresses = addresses
        self.code = 0
        self._last = ""  # output of the last command
        self._served: list[tuple[subprocess.Popen[str], IO[str]]] = []

    def run(self, block: Block) -> str:
        """Execute the commands of a block; return the resulting text of the terminal."""
        pieces = re.split(r"^\$ (.*)\n", f"{block.text}\n", flags=re.MULTILINE)
        assert not pieces[0].strip(), "a console block begins with a command"
        self.addresses.real(block.text)  # also those that only occur in the output
        return "".join(
            f"$ {command}\n{self.addresses.written(self._command(self.addresses.real(command), shown))}"
            for command, shown in zip(pieces[1::2], pieces[2::2], strict=True)
        )

    def _command(self, command: str, shown: str) -> str:
        if command == "echo $?":
            code, self.code = self.code, 0
            return f"{code}\n"
        assert self.code == 0, f"the command before it failed: {self._last}"
        words = shlex.split(command)
        extra = dict(word.split("=", 1) for word in itertools.takewhile(re.compile(r"[A-Z_]+=").match, words))
        program, *arguments = words[len(extra) :]
        if arguments[:1] in (["serve"], ["gateway"]) and program == "orinkit":
            return self._serve(arguments, extra, shown)
        done = subprocess.run(
            [*_words_of(program, arguments), *arguments], env=environment(extra), stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, encoding="utf-8", timeout=HANGS, check=False,
        )  # fmt: skip
        self.code, self._last = done.returncode, done.stdout
        return done.stdout if done.stdout.endswith("\n") or not done.stdout else f"{done.stdout}\n"

    def _serve(self, arguments: list[str], extra: dict[str, str], shown: str) -> str:
        if arguments[1:2] == ["abh3"]:  # serves a CAN bus
            arguments += ["--command-timeout", "0"]
        elif not any(word in LISTENING for word in arguments):
            arguments += ["--tcp", self.addresses.real(VIRTUAL)]
        log = Path(f"serve{len(self._served)}.log").open("w+", encoding="utf-8")  # noqa: SIM115 - closed in kill()
        process = subprocess.Popen(
            [*_words_of("orinkit", arguments), *arguments], env=environment(extra), stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=log, text=True, encoding="utf-8",
        )  # fmt: skip
        self._served.append((process, log))
        assert process.stdout is not None
        stream: IO[str] = process.stdout
        said = "".join(stream.readline() for _ in range(shown.count("\n")))
        for written, real in zip(TERMINAL.findall(shown), TERMINAL.findall(said), strict=False):
            self.addresses.set(written, real)
        return said

    def stop(self) -> None:
        """Stop all servers; each must stop cleanly."""
        for process, _ in self._served:
            process.send_signal(signal.SIGINT)
        for process, log in self._served:
            output, _ = process.communicate(timeout=HANGS)
            log.seek(0)
            assert (process.returncode, output) == (0, ""), log.read()

    def kill(self) -> None:
        """Kill all remaining servers, also after a failure."""
        for process, log in self._served:
            process.kill()
            process.wait()
            log.close()
            if process.stdout is not None:
                process.stdout.close()


def _words_of(program: str, arguments: list[str]) -> list[str]:
    """Return the command line that starts a program of a page."""
    turns = "abh3" in arguments or "CaoProv.Waco.ABH3" in arguments
    started = [sys.executable, "-c", PATIENT] if turns else [sys.executable, "-m", "orinkit"]
    programs = {"orinkit": started, "curl": ["curl", "-sS"], "sh": ["sh"]}
    assert program in programs, f"a page's console runs {', '.join(programs)}, not {program}"
    return programs[program]


def environment(extra: dict[str, str]) -> dict[str, str]:
    """Return the environment of a command: this package, English texts, no colours, a wide terminal."""
    path = str(Path(orinkit.__file__).parent.parent)
    wide = {"COLUMNS": "120", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8", "PYTHONUNBUFFERED": "1"}
    return {**os.environ, "PYTHONPATH": path, "ORINKIT_LANG": "en", **wide, **extra}


def run_python(page: str, block: Block, addresses: Addresses, namespace: dict[str, object]) -> str:
    """Execute a block; return its output."""
    code = compile("\n" * (block.line - 1) + addresses.real(block.text), page, "exec")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, namespace)
    return addresses.written(printed.getvalue())


def shown_by(code: str) -> str:
    """Return the expected output from the comments of a block."""
    return "".join(f"{line}\n" for line in re.findall(r"# -> ?(.*)$", code, re.MULTILINE))


def agrees(shown: str, printed: str) -> bool:
    """Return True if the output matches the text shown, in which ``...`` matches anything."""
    parts = [
        r"(?:.*\n)*?" if line.strip() == "..." else ".*".join(map(re.escape, line.rstrip().split("..."))) + r"[ ]*\n"
        for line in shown.rstrip("\n").split("\n")
    ]
    return re.fullmatch("".join(parts) if shown.strip() else r"\s*", printed) is not None


@contextlib.contextmanager
def virtual(page: str, addresses: Addresses) -> Iterator[None]:
    """Serve a virtual RC8 for a page that connects to one and does not serve it itself."""
    text = "\n".join(block.text for block in blocks(page) if not block.skipped)
    if SERVES_VIRTUAL.search(text):
        yield
    else:
        # not an ephemeral port: the next port of a page becomes the one after it, which must be free, too
        with orinkit.serve(VirtualRC8(), f"tcp://127.0.0.1:{addresses.free_port()}") as server:
            addresses.set(VIRTUAL, server.url.removeprefix("tcp://"))
            yield


@contextlib.contextmanager
def bus_of_its_own(page: str) -> Iterator[None]:
    """Wait until no other run of this page uses the bus; hold the TCP port of the same number as a lock."""
    with socket.socket() as lock:
        if MULTICAST in (ROOT / page).read_text(encoding="utf-8"):
            until(lambda: _bound(lock))
        yield


def _bound(lock: socket.socket) -> bool:
    with contextlib.suppress(OSError):
        lock.bind(("127.0.0.1", MULTICAST_PORT))
        return True
    return False


@pytest.mark.parametrize("page", PAGES)
def test_page_does_what_it_shows(page, tmp_path, monkeypatch):
    if CURL.search((ROOT / page).read_text(encoding="utf-8")) and shutil.which("curl") is None:
        pytest.skip("there is no curl here")
    monkeypatch.chdir(tmp_path)
    for driver in (Driver, AsyncDriver):
        monkeypatch.setitem(driver.keep_alive.__kwdefaults__, "patience", PATIENCE)
    Path("examples").symlink_to(ROOT / "examples")
    addresses = Addresses()
    terminal = Terminal(addresses)
    namespace: dict[str, object] = {"__name__": "page"}
    try:
        with bus_of_its_own(page), virtual(page, addresses):
            for block in blocks(page):
                if block.skipped or block.language not in ("python", "console"):
                    continue
                if block.saved:
                    Path(block.saved).write_text(f"{block.text}\n", encoding="utf-8")
                if block.language == "python":
                    shown, printed = shown_by(block.text), run_python(page, block, addresses, namespace)
                else:
                    shown, printed = block.text, terminal.run(block)
                assert agrees(shown, printed), f"{page}:{block.line} shows\n{shown}\nbut prints\n{printed}"
            assert terminal.code == 0, "the last command failed"
            terminal.stop()
    finally:
        terminal.kill()


def test_every_how_to_has_something_that_runs():
    for page in PAGES:
        assert any(block.language in ("python", "console") and not block.skipped for block in blocks(page)), page


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a\nb", "a\nb\n", True),
        ("a\nb", "a\n", False),
        ("a", "a\nb\n", False),
        ("a\n...\nd", "a\nb\nc\nd\n", True),
        ("a\n...", "a\n", True),
        ("a...d", "abcd\n", True),
        ("a...d", "ab\ncd\n", False),
        ("", "", True),
        ("", "a\n", False),
    ],
)
def test_three_dots_stand_for_anything(shown, printed, same):
    assert agrees(shown, printed) is same


# --- links and translations -------------------------------------------------------------------------------------------

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def prose(page: str) -> str:
    """Return the text of a page without code blocks and inline code."""
    text = re.sub(r"^```.*?^```$", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "", text)


def headings(page: str) -> list[tuple[int, str]]:
    """Return the level and the text of each heading."""
    text = re.sub(r"^```.*?^```$", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return [(len(marks), title) for marks, title in re.findall(r"^(#+) (.+)$", text, re.MULTILINE)]


def anchor(title: str) -> str:
    """Return the anchor of a heading, as generated by GitHub."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", DOCUMENTS)
def test_links_are_valid(page):
    for link in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, fragment = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), f"{page}: {link}"
        if fragment:
            name = str(target.resolve().relative_to(ROOT.resolve()))
            assert fragment in {anchor(title) for _, title in headings(name)}, f"{page}: {link}"


def test_both_readmes_have_the_same_sections():
    english, japanese = (headings(page) for page in TWINS)
    assert [level for level, _ in english] == [level for level, _ in japanese]


def test_both_readmes_have_the_same_code():
    """The comments of shell commands are translated."""

    def code(block: Block) -> str:
        return re.sub(r" +# .*", "", block.text) if block.language == "sh" else block.text

    english, japanese = ([(block.language, code(block), block.skipped) for block in blocks(page)] for page in TWINS)
    assert english == japanese


def test_every_page_is_linked_from_the_readme():
    linked = set(LINK.findall(prose("README.md")))
    assert {page for page in DOCUMENTS if page.startswith("docs/")} <= {link.partition("#")[0] for link in linked}


def test_the_table_of_lost_clients_has_the_rows_of_its_benchmark():
    page = (ROOT / "docs/howto/lost-clients.md").read_text(encoding="utf-8")
    shown = [row.split(" | ")[0] for row in page.partition("|---|---|---|\n| ")[2].partition("\n\n")[0].split("\n| ")]
    source = (ROOT / "bench" / "losses.py").read_text(encoding="utf-8")
    assert shown == re.findall(r'(?:Loss|row)\("([^"]+)"', source)
