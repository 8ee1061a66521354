"""Plot the round trips of a run: ``python bench/plot.py build/bench/bench.csv PICTURE`` (requires the extra ``plot``)."""

from __future__ import annotations

import argparse
from pathlib import Path

from natural import ACTIONS, INTERVALS
from results import Row, read

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728")


def added(rows: list[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """Return the added microseconds by interval, kind of client and action."""
    found: dict[str, dict[str, dict[str, float]]] = {pace: {} for pace in INTERVALS}
    for row in rows:
        for action in ACTIONS.values():
            if row.added is not None and row.what.startswith(f"{action} ("):
                kind, _, pace = row.what.removeprefix(f"{action} (").partition("), ")
                found[pace].setdefault(kind, {})[action] = row.added
    return found


def plot(rows: list[Row], path: Path) -> None:
    """Write a picture with one diagram for each interval.

    Raises:
        ImportError: If matplotlib is not installed.
    """
    from matplotlib.figure import Figure  # an extra; importing it takes long

    figure = Figure(figsize=(12, 4), layout="constrained")
    for axes, (pace, kinds) in zip(figure.subplots(1, len(INTERVALS)), added(rows).items(), strict=True):
        height = 0.8 / max(1, len(kinds))
        for number, (kind, values) in enumerate(kinds.items()):
            names = [name for name in ACTIONS.values() if name in values]
            places = [list(ACTIONS.values()).index(name) + number * height for name in names]
            axes.barh(places, [values[name] for name in names], height, label=kind, color=COLOURS[number % 4])
        axes.set_yticks([each + 0.4 - height / 2 for each in range(len(ACTIONS))], ACTIONS.values())
        axes.invert_yaxis()
        axes.set_title(pace)
        axes.set_xlabel("added to the bare reference (p50), us")
        axes.label_outer()
    if any(added(rows).values()):
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("picture", type=Path)
    arguments = parser.parse_args()
    plot(read(arguments.results), arguments.picture)


if __name__ == "__main__":
    main()
