"""Start modes, stop modes and status of tasks (RC8 3.2, and DENSO's published implementations)."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal, TypeAlias

TaskName: TypeAlias = Literal["cycle", "continuous", "step", "step_back"]
"""The names of :class:`TaskMode`."""
StopName: TypeAlias = Literal["default", "instant", "step", "cycle", "initialize"]
"""The names of :class:`StopMode`."""


class _Named(IntEnum):
    """A number whose string is its name in lower case."""

    def __str__(self) -> str:
        return self.name.lower()


class TaskMode(_Named):
    """The start modes of a program (Task_Start)."""

    CYCLE = 1
    CONTINUOUS = 2
    STEP = 3
    STEP_BACK = 4


class StopMode(_Named):
    """The stop modes of a program (Task_Stop)."""

    DEFAULT = 0
    INSTANT = 1
    STEP = 2
    CYCLE = 3
    INITIALIZE = 4


class TaskStatus(_Named):
    """The status of a task (GetStatus)."""

    NON_EXISTENT = 0
    SUSPENDED = 1
    READY = 2
    RUNNING = 3
    STEP_STOPPED = 4
