"""The results of a run: rows with goals, as a table and as CSV."""

from __future__ import annotations

import csv
import unicodedata
from collections.abc import Iterable
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path

BUILD = Path(__file__).parents[1] / "build" / "bench"


@dataclass(frozen=True, slots=True)
class Row:
    """One result.

    Attributes:
        what: What was measured; unique in a run.
        value: The result, for times p50.
        unit: Unit of ``value``, ``p99``, ``reference`` and ``added``.
        p99: 99th percentile, if the result is a time.
        reference: Result of the reference in the same run.
        ratio: ``value`` divided by ``reference``, or the median of such ratios.
        added: ``value`` minus ``reference``, or the median of such differences.
        goal: The goal as text.
        met: ``"met"``, ``"NOT MET"``, or ``""`` without a goal.
        note: Further information.
    """

    what: str
    value: float
    unit: str
    p99: float | None = None
    reference: float | None = None
    ratio: float | None = None
    added: float | None = None
    goal: str = ""
    met: str = ""
    note: str = ""


@dataclass
class Results:
    """The rows of one run, and what was stated about the machine."""

    rows: list[Row] = field(default_factory=list)

    def add(self, row: Row) -> None:
        """Add a row and print it."""
        self.rows.append(row)
        print(text(row), flush=True)

    def compared(
        self, what: str, value: float, reference: float, unit: str, *, p99: float | None = None, goal: str = "",
        met: bool | None = None, note: str = "", ratio: float | None = None, added: float | None = None,
    ) -> None:  # fmt: skip
        """Add a result beside its reference. Ratio and difference may have been measured in pairs."""
        if ratio is None:
            ratio = value / reference if reference else None
        if added is None:
            added = value - reference
        self.add(Row(what, value, unit, p99, reference, ratio, added, goal, judged(met), note))

    def limited(self, what: str, value: float, unit: str, most: float | None, note: str = "") -> None:
        """Add a result that must not exceed a limit."""
        goal, met = ("", None) if most is None else (f"<= {most:g} {unit}", value <= most)
        self.add(Row(what, value, unit, goal=goal, met=judged(met), note=note))

    def write(self, path: Path) -> None:
        """Write all rows as CSV."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(each.name for each in fields(Row))
            writer.writerows(["" if cell is None else cell for cell in astuple(row)] for row in self.rows)

    def goals(self) -> None:
        """Print the rows that have a goal, and the number of goals that are met."""
        aimed = [row for row in self.rows if row.goal]
        if not aimed:
            return
        print("\nGoals")
        for row in aimed:
            shown = " or ".join(
                filter(None, (number(row.value, row.unit), "" if row.ratio is None else f"{row.ratio:.2f} x"))
            )
            print(f"  {padded(row.what, 52)} {padded(row.goal, 34)} {shown:<22} {row.met}")
        print(f"{sum(row.met == 'met' for row in aimed)} of {len(aimed)} goals are met.")


def read(path: Path) -> list[Row]:
    """Read the rows of a CSV file."""

    def optional(cell: str) -> float | None:
        return float(cell) if cell else None

    with path.open(newline="", encoding="utf-8") as file:
        return [
            Row(
                row["what"], float(row["value"]), row["unit"], optional(row["p99"]), optional(row["reference"]),
                optional(row["ratio"]), optional(row["added"]), row["goal"], row["met"], row["note"],
            )
            for row in csv.DictReader(file)
        ]  # fmt: skip


def judged(met: bool | None) -> str:
    """Return whether a goal is met as text."""
    return "" if met is None else "met" if met else "NOT MET"


def number(value: float | None, unit: str) -> str:
    """Return a number with its unit as text."""
    return "" if value is None else f"{value:,.{0 if abs(value) >= 1000 else 2}f} {unit}"


def padded(what: str, width: int) -> str:
    """Return a text with spaces up to a width; Japanese characters are two columns wide."""
    return what + " " * max(0, width - sum(1 + (unicodedata.east_asian_width(each) in "WF") for each in what))


def text(row: Row) -> str:
    """Return a row as a line."""
    parts: Iterable[str] = (
        f"{number(row.value, row.unit):>14}",
        "" if row.p99 is None else f"p99 {number(row.p99, row.unit)}",
        "" if row.reference is None else f"bare {number(row.reference, row.unit)}",
        "" if row.ratio is None else f"ratio {row.ratio:.2f}",
        "" if row.added is None or row.unit == "/s" else f"adds {number(row.added, row.unit)}",
        row.goal and f"goal {row.goal}: {row.met}",
        row.note,
    )
    return f"{padded(row.what, 58)} {'  '.join(filter(None, parts))}"
