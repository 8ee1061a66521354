"""Entry point of the command ``orinkit`` and of ``python -m orinkit``."""

from __future__ import annotations

import sys

from orinkit.cli._shared.collector import collect_rarely
from orinkit.core.i18n import tr


def main() -> int:
    """Run the command ``orinkit`` and return its exit code. Ctrl-C is handled even while modules are being imported."""
    collect_rarely()
    try:
        from orinkit.cli.app import main as run  # inside "try", because this import is slow

        return run()
    except KeyboardInterrupt:
        if sys.stderr is not None:
            sys.stderr.write(f"orinkit: {tr('interrupted')}\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
