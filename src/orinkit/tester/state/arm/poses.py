"""Stored poses of a user: :class:`PoseStore`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.tester.state.json_file import JsonFile

MAX_POSES: Final = 500
LONGEST_NAME: Final = 60


@dataclass(frozen=True, slots=True)
class StoredPose:
    """A joint position with a name.

    Attributes:
        name: Name, unique for a type of arm.
        arm: Type name of the arm.
        joints: Joint position, deg (mm for linear axes), one value per axis.
    """

    name: str
    arm: str
    joints: tuple[float, ...]

    def check(self) -> StoredPose:
        """Return the pose if it is valid.

        Raises:
            InvalidValue: If the name or the joints are invalid.
        """
        if not self.name.strip() or len(self.name) > LONGEST_NAME or not self.name.isprintable():
            raise InvalidValue(tr("the name must have 1 to {most} printable characters", most=LONGEST_NAME))
        if not 4 <= len(self.joints) <= 8 or not all(math.isfinite(joint) for joint in self.joints):
            raise InvalidValue(tr("the joint position is not known"))
        return self


class PoseStore:
    """The stored poses of a user, in a file (:class:`JsonFile`).

    Args:
        path: Path of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = JsonFile(path)
        found = self._file.read(lambda rows: [_pose(each) for each in rows])
        self._poses = {(pose.arm, pose.name): pose for pose in found}
        self.version = 0

    def of(self, arm: str) -> Iterator[StoredPose]:
        """Yield the poses of a type of arm, in the order in which they were saved."""
        return (pose for pose in list(self._poses.values()) if pose.arm == arm)

    def save(self, name: str, arm: str, joints: Sequence[float]) -> None:
        """Save a pose; it replaces the one of the same name.

        Raises:
            InvalidValue: If the name is invalid, or too many poses are saved.
            OSError: If the file cannot be written.
        """
        pose = StoredPose(name.strip()[: LONGEST_NAME + 1], arm, tuple(round(joint, 6) for joint in joints)).check()
        poses = {**self._poses, (arm, pose.name): pose}
        if len(poses) > MAX_POSES:
            raise InvalidValue(tr("at most {most} poses can be saved. Try: delete some", most=MAX_POSES))
        self._write(poses)

    def delete(self, pose: StoredPose) -> None:
        """Delete a pose.

        Raises:
            OSError: If the file cannot be written.
        """
        self._write({key: each for key, each in self._poses.items() if each != pose})

    def _write(self, poses: dict[tuple[str, str], StoredPose]) -> None:
        self._file.write([asdict(pose) for pose in poses.values()])
        self._poses = poses
        self.version += 1


def _pose(saved: dict[str, Any]) -> StoredPose:
    return StoredPose(
        str(saved["name"]), str(saved["arm"]), tuple(float(joint) for joint in saved["joints"])
    ).check()  # fmt: skip
