"""Scenes: named sets of settings between which a program changes (RC9, COBOTTA PRO).

The documents name the commands CurScene, CurSubScene, SceneInfo and ChangeScene, but not the contents of a scene. Here, a
scene has a name, and optionally a tool, a work and an external speed that become the current ones.
"""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record

MOST: Final = 255
FIRST: Final = (1, 1)
_UNCHANGED: Final = -1


@record
class Scene:
    """A set of settings.

    Attributes:
        name: Name of the scene.
        tool: Number of the tool, -1 to keep the current one.
        work: Number of the work, -1 to keep the current one.
        speed: External speed, %; -1 to keep it.
    """

    name: str = ""
    tool: int = _UNCHANGED
    work: int = _UNCHANGED
    speed: float = _UNCHANGED


class Scenes:
    """The scenes of one arm; initially there is scene 1 with sub-scene 1, which changes nothing.

    Attributes:
        current: Numbers of the current scene and sub-scene.
    """

    def __init__(self) -> None:
        self.current = FIRST
        self._scenes: dict[tuple[int, int], Scene] = {FIRST: Scene()}

    def define(self, number: int, sub: int, scene: Scene) -> None:
        """Define a scene.

        Raises:
            ValueError: If a number is not 1 to 255.
        """
        if not (1 <= number <= MOST and 1 <= sub <= MOST):
            raise ValueError(tr("the numbers of a scene must be 1 to {most}", most=MOST))
        self._scenes[number, sub] = scene

    def scene(self, number: int, sub: int) -> Scene:
        """Return a scene.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if it does not exist.
        """
        found = self._scenes.get((number, sub))
        if found is None:
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE, tr("scene {number}, {sub} does not exist", number=number, sub=sub)
            )
        return found
