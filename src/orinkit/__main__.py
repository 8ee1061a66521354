"""``orinkit`` and ``python -m orinkit``."""

from __future__ import annotations

import sys

from orinkit.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
