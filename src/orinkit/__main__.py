"""``orinkit`` and ``python -m orinkit``."""

from __future__ import annotations

import sys

from orinkit.core.i18n import tr


def main() -> int:
    """Run the command line of the process and return its exit code; Ctrl-C ends it from the first moment on."""
    try:
        from orinkit.cli.app import main as run  # takes its time: an interrupt meanwhile is no error of the program

        return run()
    except KeyboardInterrupt:
        if sys.stderr is not None:
            sys.stderr.write(f"orinkit: {tr('interrupted')}\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
