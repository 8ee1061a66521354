"""Print two runs side by side: ``python bench/compare.py build/bench/before.csv build/bench/bench.csv``."""

from __future__ import annotations

import argparse
from pathlib import Path

from results import Row, number, padded, read


def compare(before: list[Row], after: list[Row]) -> list[str]:
    """Return a line for each result of both runs; a change within the noise of the machine is no result."""
    earlier = {row.what: row for row in before}
    lines = [f"{padded('', 58)} {'before':>14} {'after':>14} {'change':>8} {'ratio before':>13} {'ratio after':>12}"]
    for row in after:
        old = earlier.pop(row.what, None)
        if old is None:
            lines.append(f"{padded(row.what, 58)} {'-':>14} {number(row.value, row.unit):>14}")
            continue
        change = f"{(row.value / old.value - 1) * 100:+.0f} %" if old.value else "-"
        ratios = (f"{each.ratio:.2f}" if each.ratio is not None else "-" for each in (old, row))
        lines.append(
            f"{padded(row.what, 58)} {number(old.value, old.unit):>14} {number(row.value, row.unit):>14} {change:>8} "
            "{:>13} {:>12}".format(*ratios)
        )
    lines += [f"{padded(row.what, 58)} {number(row.value, row.unit):>14} {'-':>14}" for row in earlier.values()]
    return lines


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    arguments = parser.parse_args()
    print("\n".join(compare(read(arguments.before), read(arguments.after))))


if __name__ == "__main__":
    main()
