"""Tool, work and base frames: their definitions, and the current ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from orinkit.arms import frames
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.core.i18n import tr

Matrix: TypeAlias = NDArray[np.float64]
"""A frame as a homogeneous transformation, 4 x 4, in mm."""

TOOLS: Final = 64
WORKS: Final = 8
BASES: Final = 8
STANDARD, FIXED_TOOL = 0, 1
"""Attributes of a work frame: the arm holds the tool; the tool is fixed, and the arm holds the workpiece."""

_MOST: Final = 1e5  # mm, deg
_ZERO: Final = (0.0,) * 6


@dataclass(slots=True)
class FrameSet:
    """The tool, work or base frames; number 0 of tools and works is the flange or the base and cannot be changed.

    Attributes:
        count: Number of frames.
        code: Error code for a number out of range.
        current: Number of the current frame.
        first: Lowest number that can be changed.
        origin: Frame in which the frames are defined; ``None`` for the base frame of the arm.
    """

    count: int
    code: int
    current: int = 0
    first: int = 1
    origin: Matrix | None = None
    _attributes: dict[int, int] = field(default_factory=dict)
    _values: dict[int, tuple[float, ...]] = field(default_factory=dict)
    _matrices: dict[int, Matrix] = field(default_factory=dict)

    def copy(self) -> FrameSet:
        """Return a copy with the present frames."""
        return FrameSet(
            self.count, self.code, self.current, self.first, self.origin, dict(self._attributes), dict(self._values),
            dict(self._matrices),
        )  # fmt: skip

    def check(self, number: int, first: int = 0) -> int:
        """Return the number of a frame after checking that it is at least ``first`` and less than ``count``.

        Pass 1 as ``first`` to change a frame, because frame 0 cannot be changed.

        Raises:
            CallError: If the number is out of this range.
        """
        if not first <= number < self.count:
            raise error_for(
                self.code,
                tr(
                    "number {number} is out of range; expected {first} to {count}",
                    number=number,
                    first=first,
                    count=self.count - 1,
                ),
            )
        return number

    def define(self, number: int, values: Sequence[float], attribute: int = STANDARD) -> None:
        """Set a frame: X, Y, Z in mm, RX, RY, RZ in deg, and its attribute.

        Raises:
            CallError: If the frame does not exist, or cannot be changed; VALUE_OUT_OF_RANGE.
        """
        self.check(number, self.first)
        if attribute not in (STANDARD, FIXED_TOOL):
            raise error_for(
                hresult.VALUE_OUT_OF_RANGE,
                tr("attribute {attribute} is neither 0 (standard) nor 1 (fixed tool)", attribute=attribute),
            )
        for value in values[:6]:
            if not abs(value) <= _MOST:
                raise error_for(
                    hresult.VALUE_OUT_OF_RANGE,
                    tr("{value:g} exceeds the limit of {most:g} mm or deg", value=value, most=_MOST),
                )
        self._values[number] = tuple(values[:6])
        self._attributes[number] = attribute
        self._matrices.pop(number, None)

    def attribute(self, number: int = -1) -> int:
        """Return the attribute of a frame; -1 is the current frame."""
        return self._attributes.get(self.current if number == -1 else self.check(number), STANDARD)

    def place_origin(self, origin: Matrix | None) -> None:
        """Set the frame in which the frames are defined."""
        self.origin = origin
        self._matrices.clear()

    def values(self, number: int) -> tuple[float, ...]:
        """Return X, Y, Z, RX, RY, RZ of a frame."""
        return self._values.get(self.check(number), _ZERO)

    def matrix(self, number: int = -1) -> Matrix:
        """Return a frame as a matrix; -1 is the current frame."""
        number = self.current if number == -1 else self.check(number)
        matrix = self._matrices.get(number)
        if matrix is None:
            matrix = frames.matrix_of_position(self.values(number))
            if self.origin is not None:
                matrix = np.asarray(self.origin @ matrix)
            self._matrices[number] = matrix
        return matrix


def tool_frames() -> FrameSet:
    """Return the tool frames: 0 is the flange, 1 to 63 are definable."""
    return FrameSet(TOOLS, hresult.TOOL_NUMBER_OUT_OF_RANGE)


def work_frames() -> FrameSet:
    """Return the work frames: 0 is the base, 1 to 7 are definable."""
    return FrameSet(WORKS, hresult.WORK_NUMBER_OUT_OF_RANGE)


def base_frames() -> FrameSet:
    """Return the base frames: 0 is that of the arm in the world, 1 to 7 are kept for other arms."""
    return FrameSet(BASES, hresult.VALUE_OUT_OF_RANGE, first=0)


IDENTITY: Final[Matrix] = np.eye(4)
