"""Entry point of ``orinkit`` and ``python -m orinkit``."""

from __future__ import annotations

import sys

from orinkit.core.i18n import tr


def main() -> int:
    """Run the command line and return the exit code. Ctrl-C is handled from the beginning, including the imports."""
    try:
        from orinkit.cli.app import main as run  # slow import: handle Ctrl-C during it, too

        return run()
    except KeyboardInterrupt:
        if sys.stderr is not None:
            sys.stderr.write(f"orinkit: {tr('interrupted')}\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
