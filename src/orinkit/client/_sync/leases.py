"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``leases.py`` by ``tools/make_sync.py``: do not edit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Final

from orinkit.client._shared import motion as common
from orinkit.client._shared.common import motor_state
from orinkit.client._sync.motion import ArmBase, MotionTracker
from orinkit.core.errors import BusyError, CallError, ObjectReleased, OrinError, TransportError
from orinkit.transport.runner import Deadline, sleep

_HALT_TIMEOUT: Final = 0.3  # s


class Lease(ABC):
    """Base class of context managers that take the arm semaphore, or switch the motor on, for the duration of a block.

    At the normal end of a block, the current motion is completed first; if the program has paused the motion, it is
    halted instead. If the block raises an exception, the arm is halted first. Afterwards, the arm semaphore is given
    back, or the motor is switched off. After an exception, errors in these steps are added to the exception as notes,
    and the remaining steps are still executed. If the connection is lost, the controller itself stops the arm and
    releases its semaphore.
    """

    __slots__ = ("_robot", "_track")

    def __init__(self, robot: ArmBase, track: MotionTracker) -> None:
        self._robot = robot
        self._track = track

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._robot!r}>"

    def __enter__(self) -> None:
        try:
            self._take()
            self._track.at_rest = False
        except CallError:  # refused: nothing has changed
            raise
        except BaseException as error:  # the controller may have executed the call
            self._retry(error, self._give, self._max_busy_time())
            raise

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._clean_up(error)
            return
        try:
            self._finish_motion()
        except BaseException as failure:
            self._clean_up(failure)
            raise
        self._give()

    def _finish_motion(self) -> None:
        track = self._track
        if track.at_rest or (track.running is None and not track.passing):
            return
        if track.paused:
            self._robot.halt()
        elif track.running is not None:
            track.running.wait()
        else:
            while not self._robot.motion_complete():
                sleep(common.POLL)
            track.passing = False

    def _clean_up(self, error: BaseException) -> None:
        """Halt the arm and call ``_give`` after an exception; add errors in these steps to the exception as notes."""
        robot = self._robot
        if not self._track.at_rest:
            problem = self._retry(error, robot.halt, _HALT_TIMEOUT)
            if isinstance(problem, BusyError):
                robot.client.close()
                error.add_note(common.closed_note(robot.client.profile))
                return
            if isinstance(problem, TransportError | ObjectReleased):
                return
        self._retry(error, self._give, self._max_busy_time())

    def _retry(self, error: BaseException, step: Callable[[], None], seconds: float) -> OrinError | None:
        """Execute a step of the clean-up; repeat the step while the controller is busy with an earlier call.

        Args:
            error: Exception to which an error in the step is added as a note.
            step: Function that executes the step.
            seconds: Maximum time in s for the repetitions.

        Returns:
            The error that the step raised; ``None`` on success.
        """
        deadline = Deadline(seconds)
        while True:
            try:
                step()
            except OrinError as problem:
                if self._is_busy(problem) and not deadline.passed:
                    sleep(common.SETTLE)
                    continue
                common.note_failure(error, problem, self._robot.client.profile)
                return problem
            return None

    def _max_busy_time(self) -> float:
        """Return the maximum time in s for which an earlier call may still be executing."""
        client = self._robot.client
        return max(client.timeout, *client.dialect.command_timeouts.values(), 0.0)

    def _is_busy(self, problem: OrinError) -> bool:
        """Return True if an error in the clean-up means that the controller is still executing an earlier call."""
        busy = self._robot.client.dialect.busy_code
        return isinstance(problem, BusyError) or (isinstance(problem, CallError) and problem.code == busy != 0)

    @abstractmethod
    def _take(self) -> None:
        """Take the arm, or switch the motor on."""

    @abstractmethod
    def _give(self) -> None:
        """Give the arm back, or switch the motor off."""


class Arm(Lease):
    """Takes the arm semaphore (RC8 3.3.2) and gives it back."""

    __slots__ = ("_group", "_keep")

    def __init__(self, robot: ArmBase, track: MotionTracker, group: int, keep: bool) -> None:
        super().__init__(robot, track)
        self._group = group
        self._keep = keep

    def _take(self) -> None:
        if self._robot.client.dialect.takes_arm:
            self._robot.execute("TakeArm", [self._group, int(self._keep)])

    def _give(self) -> None:
        if self._robot.client.dialect.takes_arm:
            self._robot.execute("GiveArm")


class Motor(Lease):
    """Switches the motor on and off, and waits in both cases until the controller has done so."""

    __slots__ = ()

    def _take(self) -> None:
        self._robot.execute("Motor", motor_state(self._robot.client.dialect, on=True))

    def _give(self) -> None:
        self._robot.execute("Motor", motor_state(self._robot.client.dialect, on=False))
        self._track.at_rest = True
