"""The interface between :class:`orinkit.arms.kinematics.solver.Kinematics` and the solvers of the kinds of arms."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar, Protocol

from numpy.typing import ArrayLike

from orinkit.arms.kinematics.chain import Array
from orinkit.arms.kinematics.figures import DoubleBits
from orinkit.arms.kinematics.inverse import Mask


class ForwardChain(Protocol):
    """The frames of an arm."""

    def forward(self, joints: ArrayLike) -> Array:
        """Return the flange frames, (..., 4, 4), mm, of joints (..., n)."""

    def jacobian(self, joints: ArrayLike) -> Array:
        """Return the Jacobians, (..., 6, m), of joints (..., n)."""


class ArmSolver(ABC):
    """Solves the inverse kinematics of one arm. Frames are in the base frame, mm; joints are in deg, or mm if linear.

    Attributes:
        posture_bits: The bits of a figure that distinguish postures.
        double_bits: Indices of the joints that can be DOUBLE, and their bits.
    """

    posture_bits: ClassVar[int]
    double_bits: ClassVar[DoubleBits]

    @property
    @abstractmethod
    def chain(self) -> ForwardChain:
        """The frames of the arm."""

    @abstractmethod
    def figure_of(self, joints: Sequence[float]) -> int:
        """Return the figure of joints."""

    @abstractmethod
    def known_bits(self, figure: int) -> int | None:
        """Return the bits of a figure that count; ``None`` if there is no such figure."""

    @abstractmethod
    def path_bits(self, joints: Sequence[float]) -> int:
        """Return the bits of the figure that a path which begins or ends at these joints cannot change."""

    @abstractmethod
    def equal_figures(self, figure: int, joints: Sequence[float]) -> list[int]:
        """Return the figures that count as the figure of these joints."""

    @abstractmethod
    def of_posture(self, frame: Array, posture: int, near: Array | None) -> Iterator[list[float]]:
        """Yield the solutions of one posture, in which no joint is DOUBLE."""

    @abstractmethod
    def bases(self, frame: Array, near: Array) -> list[list[float]]:
        """Return all distinct solutions, in which no joint is DOUBLE."""

    @abstractmethod
    def follow(self, flanges: Array, start: Array) -> tuple[Array, Mask]:
        """Return joints (N, m) along a path, each row nearest to the previous one; and which rows are in reach.

        Rows after the first one that is out of reach need not be valid.
        """

    @abstractmethod
    def is_singular(self, values: Array) -> bool:
        """Return True at a singular point or close to one."""

    def obstacle(self, frame: Array) -> str:
        """Return why the arm cannot hold its flange in this frame; ``""`` if the frame is only too far or too near."""
        return ""
