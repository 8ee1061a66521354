"""Motions of several robots that start in the same cycle: SyncTimeStart to SyncTimeEnd, SyncMoveStart to SyncMoveEnd.

Between the two commands, the motions of the client are planned and collected; nothing moves. If an arm is stopped,
released, switched off or moved before the end of the block, its collected motions are invalid.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

from orinkit.cao.provider import Deferred
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.virtual.engine.motion.coupling import Coupling
from orinkit.virtual.engine.motion.planner import Motion
from orinkit.virtual.engine.motion.queue import ROOM, Ticket
from orinkit.virtual.rc8.robot.arm import RC8Arm
from orinkit.virtual.rc8.robot.arm_owner import Operator
from orinkit.virtual.rc8.robot.carried_motions import Carrier, FollowingArm
from orinkit.virtual.rc8.robot.conditions import require
from orinkit.virtual.rc8.robot.motion_planner import Plans
from orinkit.virtual.rc8.robot.target import Joints
from orinkit.virtual.rc8.robot.unit import RobotUnit
from orinkit.virtual.rc8.robot.waiting_calls import all_of


@dataclass(slots=True, eq=False)
class CollectedMotions:
    """The motions of one arm in a block.

    Attributes:
        robot: The robot.
        operator: The client, as the operator of this arm.
        start: Joint position of the arm when its first motion was planned.
        interruptions: :attr:`RC8Arm.interruptions` at this time.
        motions: The motions, in order.
    """

    robot: RobotUnit
    operator: Operator
    start: Joints
    interruptions: int
    motions: list[Motion] = field(default_factory=list)

    @classmethod
    def begin(cls, robot: RobotUnit, operator: Operator) -> CollectedMotions:
        """Return an empty collection for an arm at standstill.

        Raises:
            CallError: The code of the first violated condition of a motion; ROBOT_MOVING.
        """
        _require_ready(robot.arm, operator)
        return cls(robot, operator, robot.arm.queue.joints, robot.arm.interruptions)

    @property
    def end(self) -> Joints:
        """Joint position at the end of the motions."""
        return self.motions[-1].end if self.motions else self.start

    def require_valid(self) -> None:
        """Raise an exception unless the motions may still begin.

        Raises:
            CallError: The code of the first violated condition of a motion; ROBOT_MOVING; STOPPED_DURING_PC_MOTION if
                the arm has been stopped, released, switched off or moved meanwhile.
        """
        arm = self.robot.arm
        _require_ready(arm, self.operator)
        arm.hardware.force.require_slow(self.motions)
        if arm.interruptions != self.interruptions or arm.queue.joints != self.start:
            raise error_for(
                hresult.STOPPED_DURING_PC_MOTION,
                tr(
                    "{robot} has been stopped, released or moved since the start of the block; its motions are "
                    "discarded. Try: begin again with SyncTimeStart or SyncMoveStart",
                    robot=self.robot.name,
                ),
            )

    def begin_motions(self) -> Ticket:
        """Queue the motions; return the ticket of the last one."""
        arm = self.robot.arm
        return [arm.enqueue(each) for each in self.motions][-1]


def _require_ready(arm: RC8Arm, operator: Operator) -> None:
    require("Move", arm, operator)
    if arm.busy:
        raise error_for(hresult.ROBOT_MOVING)


class SyncBlock(ABC):
    """The motions that a client has commanded since the start of the block."""

    def __init__(self) -> None:
        self._parts: dict[int, CollectedMotions] = {}
        self._refused = False

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the commands of the block, without Start and End."""

    def add(self, robot: RobotUnit, operator: Operator, plans: Plans) -> Deferred[None] | None:
        """Plan motions of a robot, and keep them until the end of the block.

        If a motion is refused, none begins at the end of the block.

        Args:
            robot: The robot.
            operator: The client, as the operator of the robot's arm.
            plans: The motions.

        Returns:
            ``None``, or a Deferred (``brief``) if the motions are planned in a thread.

        Raises:
            CallError: Errors of planning; as for :meth:`CollectedMotions.require_valid`. SyncMove: E_FAIL for a
                follower; INTERPOLATION_NOT_SUPPORTED for PTP.
        """
        try:
            planning = self._plan(robot, operator, plans)
        except BaseException:
            self._refused = True
            raise
        if planning is not None:
            planning.add_done_callback(lambda: self._notice(planning))
        return planning

    def _notice(self, planning: Deferred[None]) -> None:
        try:
            planning.result()
        except Exception:  # noqa: BLE001 - the call reports it
            self._refused = True

    @abstractmethod
    def _plan(self, robot: RobotUnit, operator: Operator, plans: Plans) -> Deferred[None] | None:
        """Plan motions of a robot for :meth:`add`."""

    def run(self, *, wait: bool = True) -> Deferred[None] | None:
        """Begin all motions in the next cycle.

        Args:
            wait: False if the call does not wait for the motions (NEXT).

        Returns:
            A Deferred that resolves when all motions have ended; ``None`` without ``wait``, or if there are no motions.

        Raises:
            CallError: As for :meth:`CollectedMotions.require_valid`; E_FAIL if a motion was refused. No arm moves then.
        """
        if self._refused:
            raise error_for(
                hresult.E_FAIL,
                tr(
                    "a motion after {name}Start was refused; the others are discarded. Try: begin again with {name}Start",
                    name=self.name,
                ),
            )
        parts = [part for part in self._parts.values() if part.motions]
        for part in parts:
            part.require_valid()
        try:
            last = [part.begin_motions() for part in parts]
            self._join([part.robot.arm for part in parts])
        except BaseException:  # no arm may move alone; no cycle has run yet
            for part in parts:
                part.robot.arm.stop(hresult.STOPPED_DURING_PC_MOTION)
            raise
        if not (wait and parts):
            return None
        return all_of([part.robot.arm.when_done(ticket) for part, ticket in zip(parts, last, strict=True)])

    @abstractmethod
    def _join(self, arms: Sequence[RC8Arm]) -> None:
        """Connect the arms whose motions begin, if they belong together."""

    def _part(self, robot: RobotUnit, operator: Operator, count: int) -> CollectedMotions:
        """Return the motions of a robot after checking that more can be added."""
        part = self._parts.get(robot.number)
        if part is None:
            part = self._parts[robot.number] = CollectedMotions.begin(robot, operator)
        part.require_valid()
        if len(part.motions) + count > ROOM:
            raise error_for(hresult.ROBOT_MOVING, tr("the motion queue is full"))
        return part


class SyncTime(SyncBlock):
    """SyncTimeStart to SyncTimeEnd: each robot executes its own motions; the first ones begin in the same cycle."""

    @property
    def name(self) -> str:
        """Name of the commands of the block, without Start and End."""
        return "SyncTime"

    def _plan(self, robot: RobotUnit, operator: Operator, plans: Plans) -> Deferred[None] | None:
        part = self._part(robot, operator, len(plans.makes))
        start = part.end
        return robot.moves.collect(plans, lambda: plans.planned(start), part.motions.extend)

    def _join(self, arms: Sequence[RC8Arm]) -> None:
        """Do nothing: after the start, each arm moves and stops by itself."""


class SyncMove(SyncBlock):
    """SyncMoveStart to SyncMoveEnd: the followers keep the poses of their tools relative to the tool of the leader.

    Args:
        leader: The robot that is commanded.
        operator: The client, as the operator of the leader's arm.
        followers: The robots that follow, each with its operator.

    Raises:
        CallError: The code of the first violated condition of a motion, for any of the arms; ROBOT_MOVING.
    """

    def __init__(self, leader: RobotUnit, operator: Operator, followers: Sequence[tuple[RobotUnit, Operator]]) -> None:
        super().__init__()
        self._leader = leader
        self._parts = {
            robot.number: CollectedMotions.begin(robot, each) for robot, each in ((leader, operator), *followers)
        }
        self._followers = [self._parts[robot.number] for robot, _ in followers]

    @property
    def name(self) -> str:
        """Name of the commands of the block, without Start and End."""
        return "SyncMove"

    def _plan(self, robot: RobotUnit, operator: Operator, plans: Plans) -> Deferred[None] | None:
        """Plan motions of the leader and of its followers."""
        if robot is not self._leader:
            raise error_for(
                hresult.E_FAIL,
                tr(
                    "{robot} follows {leader}. Try: command {leader}, or call SyncMoveEnd first",
                    robot=robot.name,
                    leader=self._leader.name,
                ),
            )
        parts = [self._part(robot, operator, len(plans.makes)), *self._followers]
        for part in parts:
            part.require_valid()
        space = robot.arm.space
        carrier = Carrier(space.copy(space.read_variable))
        followers = [FollowingArm(each.robot.arm.space.copy(space.read_variable), each.end) for each in self._followers]
        start = parts[0].end

        def planned() -> list[list[Motion]] | Exception:
            motions = plans.planned(start)
            if isinstance(motions, Exception):
                return motions
            try:
                return [carrier.carry(each, followers) for each in motions]
            except Exception as error:  # noqa: BLE001 - raised inside the lock
                return error

        def keep(rows: list[list[Motion]]) -> None:
            for row in rows:
                for part, motion in zip(parts, row, strict=True):
                    part.motions.append(motion)

        return robot.moves.collect(plans, planned, keep)

    def run(self, *, wait: bool = True) -> Deferred[None] | None:
        """Begin the motions of all arms in the next cycle; see :meth:`SyncBlock.run`."""
        for part in self._parts.values():
            part.require_valid()
        return super().run(wait=wait)

    def _join(self, arms: Sequence[RC8Arm]) -> None:
        """Couple the arms until standstill: they have the same progress in every cycle, and stop together."""
        coupling = Coupling([arm.queue for arm in arms])
        for arm in arms:
            arm.queue.coupling = coupling
            arm.companions = tuple(other for other in arms if other is not arm)
