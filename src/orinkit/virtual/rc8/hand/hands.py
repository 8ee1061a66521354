"""All hands of a controller."""

from __future__ import annotations

from collections.abc import Iterable

from orinkit.core import hresult
from orinkit.core.i18n import tr
from orinkit.virtual.engine.control_loop import ControlLoop
from orinkit.virtual.rc8.hand.cobotta import CobottaHand
from orinkit.virtual.rc8.hand.fingers import Fingers
from orinkit.virtual.rc8.hand.gripper import BOARDS, Gripper
from orinkit.virtual.rc8.hand.onrobot import TwoFinger, VacuumGripper
from orinkit.virtual.rc8.hand.vacuum import Vacuum
from orinkit.virtual.rc8.switches import Switches


class Hands:
    """The hands of a controller; the control loop calls :meth:`step` in every cycle.

    Args:
        cycles: The control loop of the controller.
        switches: The switches of the controller.
        boards: Numbers of the boards for electric grippers that are fitted, 0 to 7.

    Attributes:
        cobotta: The parallel hand of a COBOTTA.
        vacuum: The vacuum hand of a COBOTTA.
        grippers: The electric grippers ``Hand0`` to ``Hand7`` by the number of their board.
        two_finger: The 2FG7 of a COBOTTA PRO.
        vacuum_gripper: The VGC10 of a COBOTTA PRO.

    Raises:
        ValueError: If a board does not exist.
    """

    def __init__(self, cycles: ControlLoop, switches: Switches, boards: Iterable[int] = (0,)) -> None:
        numbers = sorted(set(boards))
        for number in numbers:
            if not 0 <= number < BOARDS:
                raise ValueError(
                    tr(
                        "hand {number} does not exist; the boards have the numbers 0 to {last}",
                        number=number,
                        last=BOARDS - 1,
                    )
                )
        self.cobotta = CobottaHand(cycles, switches)
        self.vacuum = Vacuum(cycles)
        self.grippers = {number: Gripper(cycles, switches, number) for number in numbers}
        self.two_finger = TwoFinger(cycles, switches)
        self.vacuum_gripper = VacuumGripper(cycles)
        self._all: tuple[Fingers | Vacuum | VacuumGripper, ...] = (
            self.cobotta, self.vacuum, self.two_finger, self.vacuum_gripper, *self.grippers.values(),
        )  # fmt: skip

    def fingers(self, name: str) -> Fingers:
        """Return a hand with fingers by its name: ``""`` for the hand of a COBOTTA, ``"Hand0"``, or ``"2FG7"``.

        Raises:
            ValueError: If no hand has this name.
        """
        named: dict[str, Fingers] = {"": self.cobotta, "2fg7": self.two_finger}
        named |= {f"hand{number}": gripper for number, gripper in self.grippers.items()}
        found = named.get(name.strip().lower())
        if found is None:
            raise ValueError(tr("no hand with fingers has the name {name}", name=f"{name:.40}"))
        return found

    def step(self) -> bool:
        """Execute one cycle; return True if a hand is still moving."""
        more = False
        for hand in self._all:
            if hand.active:
                more = hand.step() or more
        return more

    def power_on(self) -> None:
        """Reset all hands as at power-on."""
        self.stop(hresult.STOPPED_DURING_PC_MOTION)
        self.vacuum.stop()
        self.vacuum_gripper.release(0)
        for gripper in self.grippers.values():
            gripper.power_on()

    def stop(self, code: int) -> None:
        """End all movements; calls that wait for them fail with this code."""
        for hand in (self.cobotta, self.two_finger, *self.grippers.values()):
            hand.stop(code)
        self.vacuum_gripper.close(code)
