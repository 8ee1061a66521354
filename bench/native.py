"""The programs in C: a responder and a bare client. They are compiled into ``build/bench`` when they are required."""

from __future__ import annotations

import multiprocessing.connection
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from measuring import CORES, on_core, process
from packets import DONE, FUNCTION, REPLIES, SERIAL

HERE = Path(__file__).parent
BUILD = HERE.parent / "build" / "bench"
NO_COMPILER = (
    "No C compiler: the responder is in Python, so its time is included in every round trip. Try: apt-get install gcc"
)


def compiled(name: str) -> Path | None:
    """Compile a program, unless it is up to date; return its path, or ``None`` if there is no compiler."""
    source, program = HERE / f"{name}.c", BUILD / name
    newest = max(path.stat().st_mtime for path in (source, HERE / "common.h"))
    if program.exists() and program.stat().st_mtime > newest:
        return program
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    BUILD.mkdir(parents=True, exist_ok=True)
    done = subprocess.run([compiler, "-O2", "-o", program, source], check=False, capture_output=True, text=True)
    if done.returncode:
        print(f"{source.name} cannot be compiled: {done.stderr.strip()}")
        return None
    return program


def core(number: int) -> str:
    """Return the number of a core for a program in C; -1 if there is only one core."""
    return str(CORES[number]) if len(CORES) > 1 else "-1"


@contextmanager
def responder() -> Iterator[tuple[int, str]]:
    """Run a responder on the last core; yield its port and its language."""
    program = compiled("responder")
    if program is None:
        print(NO_COMPILER)
        with process(python_responder) as port:
            yield int(port), "Python"
        return
    replies = (f"{function}:{reply.hex()}" for function, reply in REPLIES.items())
    command: list[str | Path] = [program, core(-1), DONE.hex(), *replies]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        try:
            yield int(child.stdout.readline()), "C"
        finally:
            child.terminate()


def python_responder(pipe: multiprocessing.connection.Connection) -> None:
    """Run the responder in Python, with a thread for each connection."""
    on_core(-1)

    def converse(peer: socket.socket) -> None:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with peer:
            while data := peer.recv(65536):
                reply = REPLIES.get(int.from_bytes(data[FUNCTION], "little"), DONE)
                peer.sendall(reply[: SERIAL.start] + data[SERIAL] + reply[SERIAL.stop :])

    with socket.create_server(("127.0.0.1", 0)) as listener:
        pipe.send(str(listener.getsockname()[1]))
        while True:
            threading.Thread(target=converse, args=(listener.accept()[0],), daemon=True).start()
