"""Areas in the workspace that the controller watches, and virtual fences (RC8 provider guide, SetAreaDef).

The guide names the elements of an area, but not all their meanings. Those marked "assumption" in :class:`Area` are
assumptions of this project.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from orinkit.arms import frames
from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.virtual.engine.control_loop import PERIOD

Matrix = NDArray[np.float64]

AREAS: Final = 32
"""Number of areas."""
LEAST_ELEMENTS, ELEMENTS = 11, 34
MOST_FENCES: Final = 16

_NONE: Final = -1  # an I/O point or a variable that is not used
_FARTHEST: Final = 1e6
_MILLISECONDS: Final = 1000
_SIGNAL, _STOP = 0, 1
_PAIRS: Final = 8
_AT_IO, _AT_VARIABLE, _AT_ERROR, _AT_TIME, _AT_TURN, _AT_MARGIN, _AT_PAIRS = 9, 10, 11, 12, 13, 16, 17


@record
class Box:
    """A cuboid in the base frame.

    Attributes:
        pose: X, Y, Z (mm), RX, RY, RZ (deg) of its centre.
        size: Lengths of its edges, mm.
    """

    pose: tuple[float, ...] = (0.0,) * 6
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def inverse(self) -> Matrix:
        """Return the transformation from the base frame to the frame of the box."""
        return np.asarray(frames.inverse_of(frames.matrix_of_position(self.pose)))

    def contains(self, local: Sequence[float], margin: float = 0.0) -> bool:
        """Return True if a point in the frame of the box is in the box, or at most ``margin`` mm outside."""
        return all(abs(value) <= edge / 2 + margin for value, edge in zip(local, self.size, strict=False))


@record
class Area:
    """The definition of an area.

    Attributes:
        box: The cuboid that the tool tip must enter.
        io: I/O point that is on while the tip is inside; -1 for none.
        variable: Position variable in which the position is stored when the tip enters; -1 for none.
        detection: 0: I/O and variable only; 1: also an error, which stops the arm (assumption).
        time: Time for which the tip must be inside, ms (assumption).
        turn: Range of the rotations RX, RY, RZ against the box in which the tool counts as inside, deg; 0 for any
            (assumption).
        margin: Distance from the box, mm, at which the tip counts as outside again (assumption).
        pairs: Eight pairs of a position and a margin, which are stored only.
        enabled: True if the area is watched.
    """

    box: Box = Box()
    io: int = _NONE
    variable: int = _NONE
    detection: int = _SIGNAL
    time: float = 0.0
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    margin: float = 0.0
    pairs: tuple[float, ...] = (0.0,) * (2 * _PAIRS)
    enabled: bool = False

    @classmethod
    def of_elements(cls, given: Sequence[float], before: Area) -> Area:
        """Return an area from the 11 to 34 elements of SetAreaDef; ``before`` supplies those that are left out.

        Raises:
            CallError: E_INVALIDARG for a wrong number of elements; VALUE_OUT_OF_RANGE.
        """
        if not LEAST_ELEMENTS <= len(given) <= ELEMENTS:
            raise error_for(
                hresult.E_INVALIDARG,
                tr("an area has {least} to {most} elements, not {count}", least=LEAST_ELEMENTS, most=ELEMENTS,
                   count=len(given)),
            )  # fmt: skip
        for value in given:
            if not abs(value) <= _FARTHEST:
                raise error_for(hresult.VALUE_OUT_OF_RANGE, f"{value:g}")
        full = [*given, *before.elements()[len(given) :]]
        if any(edge < 0 for edge in full[6:9]) or full[_AT_TIME] < 0 or full[_AT_MARGIN] < 0:
            raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("sizes, times and margins of an area must not be negative"))
        if full[_AT_ERROR] not in (_SIGNAL, _STOP):
            raise error_for(hresult.VALUE_OUT_OF_RANGE, tr("the detection of an area is 0 (signal) or 1 (stop)"))
        return cls(
            Box(tuple(full[:6]), (full[6], full[7], full[8])),
            int(full[_AT_IO]),
            int(full[_AT_VARIABLE]),
            int(full[_AT_ERROR]),
            full[_AT_TIME],
            (full[_AT_TURN], full[_AT_TURN + 1], full[_AT_TURN + 2]),
            full[_AT_MARGIN],
            tuple(full[_AT_PAIRS : _AT_PAIRS + 2 * _PAIRS]),
            bool(full[-1]),
        )

    def elements(self) -> list[float]:
        """Return the 34 elements."""
        return [
            *self.box.pose, *self.box.size, float(self.io), float(self.variable), float(self.detection), self.time,
            *self.turn, self.margin, *self.pairs, float(self.enabled),
        ]  # fmt: skip


class _Watch:
    """An area that is watched."""

    __slots__ = ("_cycles", "_inverse", "area", "inside")

    def __init__(self, area: Area) -> None:
        self.area = area
        self.inside = False
        self._inverse = area.box.inverse()
        self._cycles = 0

    @property
    def pending(self) -> bool:
        """True while the tip is inside, but not yet for the time of the area."""
        return self._cycles > 0 and not self.inside

    def step(self, tip: Matrix) -> bool:
        """Watch the tip for one cycle; return True if it enters or leaves the area."""
        local = self._inverse @ tip
        inside = self.area.box.contains(local[:3, 3].tolist(), self.area.margin if self.inside else 0.0)
        inside = inside and self._turned(local)
        self._cycles = self._cycles + 1 if inside else 0
        if inside and not self.inside and self._cycles * PERIOD * _MILLISECONDS < self.area.time:
            return False
        changed = inside is not self.inside
        self.inside = inside
        return changed

    def _turned(self, local: Matrix) -> bool:
        if not any(self.area.turn):
            return True
        turns = frames.position_of_matrix(local)[3:]
        return all(not most or abs(turn) <= most / 2 for turn, most in zip(turns, self.area.turn, strict=True))


class Areas:
    """The areas of one arm.

    Args:
        set_io: Callback that sets an I/O point.
        store: Callback that stores the position of the tool in a position variable.
        fault: Callback that raises an error of the controller; invoked with code and detail.
    """

    def __init__(
        self, set_io: Callable[[int, bool], None], store: Callable[[int], None], fault: Callable[[int, str], None]
    ) -> None:
        self._areas: dict[int, Area] = {}
        self._watched: dict[int, _Watch] = {}
        self._set_io = set_io
        self._store = store
        self._fault = fault

    @property
    def watching(self) -> bool:
        """True if an area is watched."""
        return bool(self._watched)

    @property
    def pending(self) -> bool:
        """True while the tip is in an area, but not yet for the time of the area."""
        return any(watch.pending for watch in self._watched.values())

    def area(self, number: int) -> Area:
        """Return the definition of an area.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if it does not exist.
        """
        return self._areas.get(_check(number)) or Area()

    def define(self, number: int, area: Area) -> None:
        """Define an area; it is watched if it is enabled.

        Raises:
            CallError: VALUE_OUT_OF_RANGE if it does not exist.
        """
        self._areas[_check(number)] = area
        self._forget(number)
        if area.enabled:
            self._watched[number] = _Watch(area)

    def step(self, tip: Matrix) -> None:
        """Watch the tool tip for one cycle."""
        for number, watch in list(self._watched.items()):
            if watch.step(tip):
                self._crossed(number, watch)

    def _crossed(self, number: int, watch: _Watch) -> None:
        area = watch.area
        if area.io >= 0:
            self._write(number, lambda: self._set_io(area.io, watch.inside))
        if not watch.inside:
            return
        if area.variable >= 0:
            self._write(number, lambda: self._store(area.variable))
        if area.detection == _STOP:
            self._fault(hresult.OUT_OF_WORKING_RANGE, tr("the tool has entered area {number}", number=number))

    def _write(self, number: int, write: Callable[[], None]) -> None:
        """Write a variable; if this fails, raise an error of the controller, because no client waits for the write.

        A position variable may have been deleted since the area was defined.
        """
        try:
            write()
        except CallError as error:
            self._fault(error.code, tr("area {number}", number=number) + f": {error.detail}")

    def _forget(self, number: int) -> None:
        watch = self._watched.pop(number, None)
        if watch is not None and watch.inside and watch.area.io >= 0:
            self._set_io(watch.area.io, False)


@record
class Fence:
    """A virtual fence.

    Attributes:
        box: The cuboid.
        inside: True if the tool tip must stay in the box, False if it must stay outside.
    """

    box: Box
    inside: bool = True


class Fences:
    """The virtual fences of one arm; a tool tip that crosses one stops the arm with an error.

    Args:
        fault: Callback that raises an error of the controller; invoked with code and detail.
    """

    def __init__(self, fault: Callable[[int, str], None]) -> None:
        self._fault = fault
        self._fences: list[tuple[Fence, Matrix]] = []
        self._crossed = 0

    def __len__(self) -> int:
        return len(self._fences)

    def set(self, fences: Iterable[Fence]) -> None:
        """Replace all fences.

        Raises:
            ValueError: If there are too many, or a number is not valid.
        """
        given = list(fences)
        if len(given) > MOST_FENCES:
            raise ValueError(tr("there are more than {most} fences", most=MOST_FENCES))
        for fence in given:
            if not all(0 < edge <= _FARTHEST for edge in fence.box.size):
                raise ValueError(tr("the edges of a fence must be above 0 mm"))
            if len(fence.box.pose) != 6 or not all(map(math.isfinite, fence.box.pose)):
                raise ValueError(tr("the pose of a fence has six numbers"))
        self._fences = [(fence, fence.box.inverse()) for fence in given]
        self._crossed = 0

    def crossed_by(self, tip: Matrix) -> int:
        """Return the number of the first fence that a tool frame is beyond, counted from 1; 0 if there is none."""
        for number, (fence, inverse) in enumerate(self._fences, start=1):
            if fence.box.contains((inverse @ tip)[:3, 3].tolist()) is not fence.inside:
                return number
        return 0

    def step(self, tip: Matrix) -> None:
        """Watch the tool tip for one cycle."""
        crossed = self.crossed_by(tip)
        if crossed and crossed != self._crossed:
            self._fault(hresult.OUT_OF_WORKING_RANGE, tr("the tool has crossed virtual fence {number}", number=crossed))
        self._crossed = crossed


def _check(number: int) -> int:
    if not 0 <= number < AREAS:
        raise error_for(
            hresult.VALUE_OUT_OF_RANGE,
            tr("area {number} does not exist; areas: 0 to {last}", number=number, last=AREAS - 1),
        )
    return number
