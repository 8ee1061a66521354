"""The surroundings of an arm of a virtual controller, set by tests and users: surfaces, fences, scenes, buttons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.objects.device_commands import path_file, path_text
from orinkit.virtual.rc8.robot.hardware.areas import Box, Fence
from orinkit.virtual.rc8.robot.hardware.arm_hardware import BUTTONS, ArmHardware
from orinkit.virtual.rc8.robot.hardware.contact import CompliantSurface
from orinkit.virtual.rc8.robot.hardware.scenes import Scene
from orinkit.virtual.rc8.robot.motor import MotorState
from orinkit.virtual.rc8.robot.unit import RobotUnit
from orinkit.virtual.rc8.state import RC8State

_LONGEST_NAME: Final = 64


class Workspace:
    """The surroundings of an arm. Every method is thread-safe.

    If an argument is not valid, a method raises :class:`ValueError`.

    Args:
        state: The controller.
        robot: The robot to which the arm belongs.
    """

    def __init__(self, state: RC8State, robot: RobotUnit) -> None:
        self._state = state
        self._robot = robot

    @property
    def _hardware(self) -> ArmHardware:
        return self._robot.arm.hardware

    def place(
        self,
        name: str,
        pose: Sequence[float],
        *,
        size: tuple[float, float] = (200.0, 200.0),
        thickness: float = 100.0,
        stiffness: float = 10.0,
        damping: float = 0.0,
        friction: float = 0.0,
        radius: float = 0.0,
    ) -> None:
        """Place a compliant surface; another one of the same name is replaced.

        Args:
            name: Name of the surface.
            pose: X, Y, Z (mm), RX, RY, RZ (deg) of its centre in the base frame; its free side is +Z.
            size: Lengths of its edges along X and Y, 0.1 to 100,000 mm.
            thickness: Deepest penetration, 0.1 to 100,000 mm.
            stiffness: 0.001 to 1000 N/mm.
            damping: 0 to 10 N s/mm.
            friction: Coefficient of friction, 0 to 2.
            radius: Radius of the flat end of the tool, 0 to 500 mm; 0 for a point.

        Raises:
            ValueError: If a number is out of range, or there are 16 surfaces already.
        """
        if not name.strip() or len(name) > _LONGEST_NAME:
            raise ValueError(tr("the name of a surface has 1 to {most} characters", most=_LONGEST_NAME))
        surface = CompliantSurface(tuple(map(float, pose)), size, thickness, stiffness, damping, friction, radius)
        with self._state.cycles:
            self._hardware.place_surface(name, surface)

    def remove(self, name: str) -> None:
        """Remove a surface.

        Raises:
            ValueError: If there is no surface of this name.
        """
        with self._state.cycles:
            self._hardware.place_surface(name, None)

    @property
    def surfaces(self) -> Mapping[str, CompliantSurface]:
        """The surfaces, by name."""
        with self._state.cycles:
            return dict(self._hardware.force.surfaces)

    def fence(self, *fences: tuple[Sequence[float], Sequence[float], bool]) -> None:
        """Set the virtual fences; without arguments, remove them.

        Args:
            fences: For each fence, the pose of a box (X, Y, Z in mm, RX, RY, RZ in deg, in the base frame), the lengths
                of its edges in mm, and True if the tool tip must stay inside, False if it must stay outside.

        Raises:
            ValueError: If a number is not valid.
        """
        made = []
        for pose, size, inside in fences:
            x, y, z = map(float, size)
            made.append(Fence(Box(tuple(map(float, pose)), (x, y, z)), bool(inside)))
        with self._state.cycles:
            self._hardware.fences.set(made)
            self._hardware.wake()

    def scene(
        self, number: int, sub: int, *, name: str = "", tool: int = -1, work: int = -1, speed: float = -1.0
    ) -> None:
        """Define a scene: a tool, a work and an external speed (%) that become current with ChangeScene; -1 keeps them.

        Raises:
            ValueError: If a number is not valid.
        """
        space = self._robot.arm.space
        with self._state.cycles:
            try:
                space.tools.check(tool, -1)
                space.works.check(work, -1)
            except CallError as error:
                raise ValueError(error.detail) from None
            if speed != -1 and not 0 < speed <= 100:
                raise ValueError(tr("a speed must be above 0 and at most 100 %, not {speed:g}", speed=speed))
            self._hardware.scenes.define(number, sub, Scene(name, tool, work, speed))

    def press(self, button: int) -> None:
        """Press a button on the arm, 0 to 2; it counts as pressed until ClearMechaButtonState.

        Raises:
            ValueError: If the button does not exist.
        """
        if not 0 <= button < BUTTONS:
            raise ValueError(
                tr("button {number} does not exist; buttons: 0 to {last}", number=button, last=BUTTONS - 1)
            )
        with self._state.cycles:
            self._hardware.buttons[button] = True

    def lose_calibration(self) -> None:
        """Lose the reference positions of the encoders; the motor cannot be switched on until AutoCal.

        Raises:
            CallError: MOTOR_IS_ON.
        """
        with self._state.cycles:
            if self._robot.arm.motor.state is not MotorState.OFF:
                raise error_for(hresult.MOTOR_IS_ON)
            self._hardware.calibrated = False

    def save_path(self, number: int) -> None:
        """Save a path for free curves to its file, from which LoadPathPoint reads it.

        Raises:
            CallError: E_INVALIDARG if the path does not exist; errors of the file store.
        """
        self.path_writer(number)()

    def path_writer(self, number: int) -> Callable[[], None]:
        """Return a function that writes the file of a path for free curves; call it outside the lock.

        Raises:
            CallError: E_INVALIDARG if the path does not exist.
        """
        moves, files = self._robot.moves, self._state.files
        with self._state.cycles:
            targets = moves.path_targets(number)
        return lambda: files.write(path_file(number), path_text([moves.as_position(each) for each in targets]))

    def status(self) -> dict[str, object]:
        """Return the surroundings as a dictionary that can be converted to JSON."""
        with self._state.cycles:
            hardware = self._hardware
            return {
                "surfaces": [name for name, _ in hardware.force.surfaces],
                "force_control": hardware.force.on,
                "force": [round(value, 6) for value in hardware.force.sensed()],
                "fences": len(hardware.fences),
                "scene": list(hardware.scenes.current),
                "buttons": list(hardware.buttons),
                "calibrated": hardware.calibrated,
            }
