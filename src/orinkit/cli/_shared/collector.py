"""The garbage collector while the command line starts, and afterwards."""

from __future__ import annotations

import gc
from typing import Final

_USUAL: Final = gc.get_threshold()
_WHILE_STARTING: Final = 10_000  # new objects; with the default, 700 to 2,000, collections take a tenth of the start


def collect_rarely() -> None:
    """Collect garbage rarely while modules are imported, because modules are not garbage."""
    gc.set_threshold(_WHILE_STARTING)


def collect_as_usual() -> None:
    """Collect garbage as usual, but do not visit the objects that exist now; call this when a server has started.

    A full collection over all modules would take 40 ms, which would delay the motion cycle. Without frequent
    collections, garbage would keep large packets in memory. No collection precedes, because it would take 18 ms, and
    imports leave less than 1 MB of garbage.
    """
    gc.freeze()
    gc.set_threshold(*_USUAL)
