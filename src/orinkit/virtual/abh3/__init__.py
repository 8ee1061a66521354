"""A virtual ABH3: a motor driver for two axes on CAN, simulated according to the manufacturer's document.

"The document" is "ABH3 CAN 通信 ホスト用サンプルソフト仕様"; all section numbers refer to it.

:class:`VirtualABH3` receives and returns frames; it is not connected to a bus. :class:`Parameters` are the settings of
the driver. The module ``flags`` computes the control flags from inputs and terminals. The modules ``axis`` and
``drive`` move the motors. ``fault_monitor`` handles time-outs, errors and warnings, ``schedule`` handles the periodic
frames, and ``memory`` handles the parameters and monitors of TelABH3.

The document does not specify everything. In these cases the virtual driver behaves as follows:

- The answering mode -1 of single packets means "when received", as in section 1: the driver answers each one that it
  receives. An overview of the manufacturer calls -1 "no answer"; in this project, the mode ``None`` means "no answer".
- The document does not disclose DP1 (section 2.2): a frame of DP1 and a request for DP1 are not answered. A request for
  broadcast 7, which has no data, is not answered either.
- Only a command (DP0) of 8 bytes from the driver's host restarts the time-outs; they begin at power-on. A warning
  without an error ends with the next command, and the motors follow that command. An error and its warning remain until
  the error is reset.
- A reset of errors takes effect after 1 ms to 2 ms, and only on errors without a remaining cause.
- An error stops the motors with the deceleration of a stop; then the servo is switched off.
- The control flags are computed from inputs and terminals only: a time-out or an error does not change the flags
  ``start`` and ``servo_on``. The flags for ready, busy and brake show the actual state.
- The error code and the alarm code are 0 without faults, 3 if CAN communication is the only fault (as observed on real
  drivers), and otherwise 15.
- Feedback in DP0 is a velocity in torque mode too.
- The velocity command in broadcast 2 is the target velocity of the axis, before acceleration; it is 0 in torque mode,
  or if start is off.

Not simulated: correction by analog inputs, master and slave, S-curves, gains, the mechanical effect of the brake, the
effect of the current limit on acceleration in speed mode, broadcasts from other drivers (receiving groups), the bit
rate, and all faults except time-outs; :meth:`VirtualABH3.inject` raises other faults. The speed limit applies to each
commanded axis (A/Y and B/X), not to each motor.
"""

from orinkit.virtual.abh3.device import VirtualABH3 as VirtualABH3
from orinkit.virtual.abh3.parameters import DataSet as DataSet
from orinkit.virtual.abh3.parameters import Parameters as Parameters
from orinkit.virtual.abh3.state import DriverState as DriverState

__all__ = ["DataSet", "DriverState", "Parameters", "VirtualABH3"]
