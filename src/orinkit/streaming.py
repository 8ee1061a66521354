"""The names of streaming in slave mode, for annotations and limits of one's own; ``robot.slave_mode()`` makes a stream.

::

    from orinkit.streaming import Limits, Stream
"""

from __future__ import annotations

from orinkit.cao.slave_lateness import Lateness
from orinkit.client._async_slave import AsyncStream
from orinkit.client._slave_common import Progress, StreamResult, Timing
from orinkit.client._sync_slave import Stream
from orinkit.slave.breaches import TrajectoryError
from orinkit.slave.limits import Limits, PathLimits
from orinkit.slave.realtime import RealTime
from orinkit.slave.samples import Sample

__all__ = [
    "AsyncStream",
    "Lateness",
    "Limits",
    "PathLimits",
    "Progress",
    "RealTime",
    "Sample",
    "Stream",
    "StreamResult",
    "Timing",
    "TrajectoryError",
]
