"""``orinkit`` and ``python -m orinkit``."""

from __future__ import annotations

import sys

from orinkit.language import pick


def main() -> int:
    """Run the command line of the process and return its exit code; Ctrl-C ends it from the first moment on."""
    try:
        from orinkit.cli.app import main as run  # takes its time: an interrupt meanwhile is no error of the program

        return run()
    except KeyboardInterrupt:
        if sys.stderr is not None:
            sys.stderr.write(f"orinkit: {pick('interrupted', '中断しました')}\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
