"""How tasks are started and stopped, and what they tell about themselves (RC8 3.2; reference: task modes and status)."""

from __future__ import annotations

from enum import IntEnum


class TaskMode(IntEnum):
    """How a program is started (Task_Start)."""

    CYCLE = 1
    CONTINUOUS = 2
    STEP = 3


class StopMode(IntEnum):
    """How a program is stopped (Task_Stop)."""

    DEFAULT = 0
    INSTANT = 1
    STEP = 2
    CYCLE = 3
    INITIALIZE = 4


class TaskStatus(IntEnum):
    """What a task is doing (GetStatus)."""

    NON_EXISTENT = 0
    SUSPENDED = 1
    READY = 2
    RUNNING = 3
    STEP_STOPPED = 4
