"""Round trips of what programs call, against bare references of the same run. Part of ``make bench``.

Each kind of client (synchronous and asyncio, with the C extension and without it; asyncio on uvloop) has a process of its
own (bench/contender.py), and so has a bare client in C. All are connected to one responder on another core. They take turns
in short rounds, and only one of them runs at a time.

The speed of the machine changes during a run. Therefore each action is measured beside its bare reference, and ratios and
differences are the medians of pairs: back to back, a pair consists of the medians of two short rounds that follow each
other; every 1 ms and every 8 ms, of two calls that follow each other.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from native import compiled, core, responder
from packets import REQUEST
from results import Results

PURE = "ORINKIT_PURE"
KINDS = {"sync": (True, False), "asyncio": (True, False), "uvloop": (False,) if find_spec("uvloop") else ()}
"""Kinds of clients; each is measured in pure Python (True) or with the extension (False)."""

INTERVALS = {"back to back": 0, "every 1 ms": 1_000_000, "every 8 ms": 8_000_000}
ACTIONS = {
    "call": "client.call(...)",
    "execute": 'robot.execute("slvMove", pose)',
    "prepared": 'robot.prepare("slvMove")(pose)',
    "read a variable": "variable.value, read",
    "write a variable": "variable.value, write",
}
GOAL_ACTIONS = ("execute", "read a variable", "write a variable")
CODEC_GOALS = {
    "encode": {True: 0.15, False: 1.0},
    "encode prepared": {True: 0.15, False: 1.0},
    "decode": {True: 0.2, False: 0.7},
}
LEAST_ADDED = 4.5  # us that the pure client may add, if this is more than its goal as a ratio
LEAST_RATIO = 0.95  # no client is faster than its reference: a lower ratio shows that the machine stalled
WARM_UP = 10  # samples at the beginning of each back-to-back round that do not count
CLOSER = 3  # times as many pairs if a limit is close


@dataclass(slots=True)
class Client:
    """A process that makes round trips.

    Attributes:
        label: Kind of client, for example "sync, pure".
        extension: State of the C extension.
        actions: Names of its actions.
        samples: Durations in us by action and interval.
        medians: Median of each round in us by action and interval.
        pairs: Durations in us of the action and of the bare reference beside it.
    """

    label: str
    process: subprocess.Popen[str]
    extension: str = "absent"
    actions: tuple[str, ...] = ("bare",)
    samples: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    medians: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    pairs: dict[tuple[str, str], list[tuple[float, float]]] = field(default_factory=dict)

    def line(self) -> str:
        """Return the next line of its output."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"the process of {self.label} has ended")
        return line

    def measure_pair(self, action: str, pace: str, count: int) -> None:
        """Measure the bare reference and an action: in turn, or back to back in one round each."""
        if INTERVALS[pace]:
            found = list(zip(*self.perform((action, "bare"), pace, count), strict=True))
        else:
            bare = self.measure("bare", pace, count)
            found = [(self.measure(action, pace, count), bare)]
        self.pairs.setdefault((action, pace), []).extend(found)

    def measure(self, action: str, pace: str, count: int) -> float:
        """Measure one action; return the median in us."""
        return statistics.median(self.perform((action,), pace, count)[0])

    def perform(self, actions: tuple[str, ...], pace: str, count: int) -> list[list[float]]:
        """Perform actions in turn ``count`` times, after some that do not count; return the durations of each in us."""
        interval = INTERVALS[pace]
        warm_up = 1 if interval else WARM_UP
        how = f"{count + warm_up} {interval}" if self.label == "C" else json.dumps([actions, count + warm_up, interval])
        assert self.process.stdin is not None
        print(how, file=self.process.stdin, flush=True)
        times = [int(each) / 1e3 for each in self.line().split()][warm_up * len(actions) :]
        found = [times[number :: len(actions)] for number in range(len(actions))]
        for action, samples in zip(actions, found, strict=True):
            self.samples.setdefault((action, pace), []).extend(samples)
            self.medians.setdefault((action, pace), []).append(statistics.median(samples))
        return found

    def p50(self, action: str, pace: str) -> float:
        """Return the median of all samples in us."""
        return statistics.median(self.samples[action, pace])

    def p99(self, action: str, pace: str) -> float:
        """Return the 99th percentile of all samples in us."""
        samples = sorted(self.samples[action, pace])
        return samples[min(len(samples) - 1, len(samples) * 99 // 100)]

    def compared(self, action: str, pace: str) -> tuple[float, float]:
        """Return the ratio of an action to the bare reference, and the difference in us: medians of all pairs."""
        pairs = self.pairs[action, pace]
        return statistics.median(mine / bare for mine, bare in pairs), statistics.median(
            mine - bare for mine, bare in pairs
        )

    @property
    def native(self) -> bool:
        """True if the process uses the C extension."""
        return self.extension == "in use"


@contextmanager
def started(command: list[str | Path], label: str, *, pure: bool = False) -> Iterator[Client]:
    """Start a client; its process ends with the ``with`` statement."""
    environment = {name: value for name, value in os.environ.items() if name != PURE}
    if pure:
        environment[PURE] = "1"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, env=environment, **pipes) as process:  # type: ignore[call-overload]  # arguments from a dict
        try:
            yield Client(label, process)
        finally:
            process.terminate()


@contextmanager
def clients(port: int) -> Iterator[list[Client]]:
    """Start all clients; without the extension, there is only the pure client of each kind."""
    with ExitStack() as stack:
        found: list[Client] = []
        program = compiled("bare_client")
        if program is not None:
            found.append(stack.enter_context(started([program, core(0), str(port), REQUEST.hex()], "C")))
        script = Path(__file__).with_name("contender.py")
        for kind, variants in KINDS.items():
            for pure in variants:
                label = f"{kind}, {'pure' if pure else 'extension'}"
                client = stack.enter_context(started([sys.executable, script, kind, str(port)], label, pure=pure))
                state = json.loads(client.line())
                client.extension, client.actions = state["extension"], tuple(state["actions"])
                if pure or client.native:
                    found.append(client)
                else:
                    client.process.terminate()
        yield found


def natural(rounds: int, back_to_back: int, paced: int, results: Results) -> None:
    """Measure all actions of all clients.

    Args:
        rounds: Number of rounds.
        back_to_back: Number of back-to-back calls of each action in a round.
        paced: Number of calls every 1 ms and every 8 ms in a round.
        results: The results are added here.
    """
    with responder() as (port, language), clients(port) as found:
        if not any(client.native for client in found):
            print("The C extension is absent: only the pure clients are measured.")
        if not any("prepared" in client.actions for client in found):
            print("This version has no prepared calls (robot.prepare).")
        for _ in range(rounds):
            for pace, interval in INTERVALS.items():
                for client in found:
                    measure_round(client, pace, paced if interval else back_to_back)
        report(found, language, results)


def measure_round(client: Client, pace: str, count: int) -> None:
    """Measure all actions of a client at one pace."""
    if client.label == "C":
        client.measure("bare", pace, count)
    for action in client.actions:
        if action in ACTIONS:
            close = pace != "every 1 ms" and client.label.startswith("sync") and action in GOAL_ACTIONS
            for _ in range(CLOSER if close else 1):
                client.measure_pair(action, pace, count)
        elif action != "bare" and not INTERVALS[pace]:  # the codec
            client.measure(action, pace, count)


def report(found: list[Client], language: str, results: Results) -> None:
    """Add the results of all clients."""
    for client in found:
        for pace in INTERVALS:
            medians = client.medians["bare", pace]
            what = f"bare {'client' if client.label == 'C' else 'reference'} ({client.label}), {pace}"
            spread = f"responder in {language}; p50 of the rounds {min(medians):.1f} to {max(medians):.1f} us"
            results.compared(what, client.p50("bare", pace), lowest(found, client, pace), "us",
                             p99=client.p99("bare", pace), note=spread)  # fmt: skip
            for action in client.actions:
                if action in ACTIONS:
                    compare_action(client, action, pace, results)
        for action, goals in CODEC_GOALS.items():
            if action in client.actions:
                what = f"{action} slvMove ({client.label})"
                results.limited(what, client.p50(action, "back to back"), "us", goals[client.native])


def lowest(found: list[Client], client: Client, pace: str) -> float:
    """Return p50 of the client in C; if there is none, that of the client itself."""
    return next((each for each in found if each.label == "C"), client).p50("bare", pace)


def compare_action(client: Client, action: str, pace: str, results: Results) -> None:
    """Add one result beside the bare reference of the same process."""
    mine, bare = client.p50(action, pace), client.p50("bare", pace)
    ratio, added = client.compared(action, pace)
    goal, met = judged(client, action, pace, ratio, added)
    note = "the reference was disturbed: repeat the run" if ratio < LEAST_RATIO else ""
    results.compared(f"{ACTIONS[action]} ({client.label}), {pace}", mine, bare, "us", p99=client.p99(action, pace),
                     goal=goal, met=met and not note, note=note, ratio=ratio, added=added)  # fmt: skip


def judged(client: Client, action: str, pace: str, ratio: float, added: float) -> tuple[str, bool | None]:
    """Return the goal of an action as text, and whether it is met; for actions without a goal ``""`` and ``None``."""
    if action not in GOAL_ACTIONS or pace == "every 1 ms" or client.label.startswith("uvloop"):
        return "", None
    together = pace == "back to back"
    if client.label.startswith("asyncio"):
        if not together:
            return "", None
        most = 1.15 if client.native else 1.4
    elif client.native:
        most = 1.05 if together else 1.10
    else:
        most = 1.25 if together else 1.5
    if together and not client.native and client.label.startswith("sync"):
        return f"<= {most} x or +{LEAST_ADDED} us", ratio <= most or added <= LEAST_ADDED
    return f"<= {most:.2f} x", ratio <= most
