"""What a person sets at the controller: mode switch, emergency stop, enabling inputs, machine lock."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Mode(IntEnum):
    """The mode switch, with the values of ``@MODE``."""

    MANUAL = 1
    TEACH_CHECK = 2
    AUTOMATIC = 3


@dataclass(slots=True)
class Pendant:
    """The switches and inputs. It starts in automatic mode (RC8 2.2), with nothing pressed and nothing stopped.

    ``mode`` and ``emergency_stop`` are changed by :class:`~orinkit.virtual.rc8.state.State`, which tells the clients.
    """

    mode: Mode = Mode.AUTOMATIC
    emergency_stop: bool = False
    deadman: bool = False
    auto_enable: bool = True
    protective_stop: bool = False
    machine_lock: bool = False

    @property
    def torque_off(self) -> bool:
        """Whether a stop keeps the torque off (STO)."""
        return self.emergency_stop or self.protective_stop
