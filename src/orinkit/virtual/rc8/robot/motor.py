"""The motor supply of the arm: switching takes its time, and waits for nobody in an emergency."""

from __future__ import annotations

from enum import Enum
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for

ON_CYCLES: Final = 125
"""Cycles that switching on takes: 1 s, as long as controllers of this kind take at least (1 to 3 s)."""

OFF_CYCLES: Final = 38
"""Cycles that switching off takes: brakes first, about 0.3 s."""


class MotorState(Enum):
    """Where the motor supply is."""

    OFF = "off"
    SWITCHING_ON = "switching on"
    ON = "on"
    SWITCHING_OFF = "switching off"


class Motor:
    """The motor supply."""

    def __init__(self) -> None:
        self.state = MotorState.OFF
        self._cycles = 0
        self._waiting: list[Deferred[None]] = []

    @property
    def on(self) -> bool:
        """Whether the robot can move."""
        return self.state is MotorState.ON

    @property
    def switching(self) -> bool:
        """Whether it is on its way from one state to the other."""
        return self._cycles > 0

    def switch(self, on: bool) -> Deferred[None]:
        """Begin to switch; the promise is kept when it is on, or off.

        Raises:
            CallError: MOTOR_SWITCHING_OFF, it cannot go on while it is going off.
        """
        done = Deferred[None]()
        if on:
            if self.state is MotorState.SWITCHING_OFF:
                raise error_for(hresult.MOTOR_SWITCHING_OFF)
            if self.state is MotorState.OFF:
                self.state, self._cycles = MotorState.SWITCHING_ON, ON_CYCLES
        elif self.state in (MotorState.ON, MotorState.SWITCHING_ON):
            self._break_off(hresult.MOTOR_ON_FAILED)
            self.state, self._cycles = MotorState.SWITCHING_OFF, OFF_CYCLES
        if self.switching:
            self._waiting.append(done)
        else:
            done.set_result()
        return done

    def cut(self) -> None:
        """Take the supply away at once, for an error or an emergency stop."""
        if self.state is MotorState.SWITCHING_OFF:  # it is what they wait for
            self._arrive()
        self._cycles = 0
        self.state = MotorState.OFF
        self._break_off(hresult.MOTOR_ON_FAILED)

    def step(self) -> bool:
        """Do one cycle; returns whether it is still switching."""
        if not self._cycles:
            return False
        self._cycles -= 1
        if not self._cycles:
            self.state = MotorState.ON if self.state is MotorState.SWITCHING_ON else MotorState.OFF
            self._arrive()
        return self.switching

    def _arrive(self) -> None:
        waiting, self._waiting = self._waiting, []
        for done in waiting:
            done.set_result()

    def _break_off(self, code: int) -> None:
        waiting, self._waiting = self._waiting, []
        for done in waiting:
            done.set_exception(error_for(code))
