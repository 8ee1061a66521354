"""The motor supply of the arm: switching takes time, except in an emergency, in which the supply is cut."""

from __future__ import annotations

from enum import Enum
from typing import Final

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for

ON_CYCLES: Final = 125
"""Number of 8 ms cycles to switch on: 1 s, the shortest time of controllers of this type (1 to 3 s)."""

OFF_CYCLES: Final = 38
"""Number of 8 ms cycles to switch off: about 0.3 s, in which the brakes engage."""


class MotorState(Enum):
    """State of the motor supply."""

    OFF = "off"
    SWITCHING_ON = "switching on"
    ON = "on"
    SWITCHING_OFF = "switching off"


_ON: Final = MotorState.ON  # for every cycle; see orinkit.virtual.engine.motion.queue


class Motor:
    """The motor supply."""

    def __init__(self) -> None:
        self.state = MotorState.OFF
        self._cycles = 0
        self._waiting: list[Deferred[None]] = []

    @property
    def on(self) -> bool:
        """True if the motor is on, so that the robot can move."""
        return self.state is _ON

    @property
    def switching(self) -> bool:
        """True while the motor is being switched on or off."""
        return self._cycles > 0

    def switch(self, on: bool) -> Deferred[None]:
        """Begin to switch the motor on or off; return a Deferred that resolves when the motor is on or off.

        Raises:
            CallError: MOTOR_SWITCHING_OFF if ``on`` is True while the motor is being switched off.
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
        """Switch the motor off immediately, for an error or an emergency stop."""
        if self.state is MotorState.SWITCHING_OFF:  # complete the pending calls that switch the motor off
            self._arrive()
        self._cycles = 0
        self.state = MotorState.OFF
        self._break_off(hresult.MOTOR_ON_FAILED)

    def step(self) -> bool:
        """Execute one cycle; return True if the motor is still being switched."""
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
