"""Entry point of the command ``orinkit`` and of ``python -m orinkit``."""

from __future__ import annotations

import gc
import sys
from typing import Final

from orinkit.core.i18n import tr

_NEW_OBJECTS: Final = 10_000  # modules are not garbage: with the default, 700, collections take a tenth of the start


def main() -> int:
    """Run the command ``orinkit`` and return its exit code. Ctrl-C is handled even while modules are being imported."""
    gc.set_threshold(_NEW_OBJECTS)
    try:
        from orinkit.cli.app import main as run  # inside "try", because this import is slow

        return run()
    except KeyboardInterrupt:
        if sys.stderr is not None:
            sys.stderr.write(f"orinkit: {tr('interrupted')}\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
