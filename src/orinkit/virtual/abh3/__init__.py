"""A virtual ABH3: a motor driver for two axes on CAN, as the document has it, without hardware.

:class:`VirtualABH3` takes frames and gives frames; it knows no bus. :class:`Parameters` are those of the driver. Below it
``flags`` makes control flags of inputs and terminals, ``axis`` and ``drive`` move the motors, ``watch`` has time-outs, errors
and warnings, ``schedule`` the frames that are sent unasked, ``memory`` what TelABH3 commands read and write.

Where the document says nothing, it does this:

- -1 as the way of answering single packets is "when received", as in section 1; the maker's overview calls -1 "no answer",
  which is ``None`` here.
- DP1 is withheld by the document (section 2.2): its frame and a request for it are not answered. Nor is a request for
  broadcast 7, which has no data.
- Only a command (DP0) of the driver's host, of 8 bytes, restarts the time-outs; they run from power-on. A warning alone
  ends with the next command, and motion goes on as that command says. An error, and the warning with it, stays until the
  error is reset.
- A reset of errors takes effect in 1 ms to 2 ms, and only on what has no cause any more.
- An error stops the motors with the deceleration of a stop; then the servo is off.
- The control flags are what the bits make of each other: a time-out or an error does not change ``start`` and ``servo_on``
  in them. Ready, busy and the brake say what is the case.
- Error code and alarm code are 3 where nothing but CAN communication is wrong, as has been seen on drivers, otherwise 15.
- Feedback in DP0 is a velocity in torque mode too.
- The velocity command in broadcast 2 is what the axis is to reach, before acceleration; it is 0 where start is off.

Not simulated: correction by analog inputs, master and slave, S-curves, gains, the mechanical effect of the brake, what a
limited current does to acceleration in speed mode, broadcasts that come from other drivers (receiving groups), bit rate,
and every fault but the time-outs, which :meth:`VirtualABH3.inject` raises. The speed limit is that of each commanded axis.
"""

from orinkit.virtual.abh3.device import VirtualABH3 as VirtualABH3
from orinkit.virtual.abh3.parameters import DataSet as DataSet
from orinkit.virtual.abh3.parameters import Parameters as Parameters
from orinkit.virtual.abh3.state import DriverState as DriverState

__all__ = ["DataSet", "DriverState", "Parameters", "VirtualABH3"]
