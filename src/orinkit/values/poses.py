"""Poses of robots: values, figures, and the texts that Robot_Move takes (RC8 3.3.4, 4.6.1).

=====================================  ==========================================================================
value                                  what it is
=====================================  ==========================================================================
``P(x, y, z, rx, ry, rz, fig)``        position: mm, degrees (turned about Z, then Y, then X), figure
``T(x, y, z, ox, oy, oz, ax, ay, az,   homogeneous transformation: mm, orient vector (the tool's Y axis), approach
fig)``                                 vector (the tool's Z axis), figure
``J(j1, ..., j8)``                     joints: degrees, mm for linear ones
``V(x, y, z)``                         vector
=====================================  ==========================================================================

All are tuples of ``float``, so a variable takes them as they are. :func:`to_text` gives the text that a controller reads,
``P(364.16, 0, 278.5355, 180, 0, 180, 5)``, with all digits; ``str()`` the same rounded to six decimals, for people.

A target of a motion as text; blanks between its parts and capitals do not matter::

    [@P | @E | @0 | @<mm>]  P1  |  P[1]  |  P(v, v, ...)  |  (v, v, ...)   [EX((7, v), (8, v)) | EXA((7, v))]

with T, J or V in place of P, and ``EX(7, v)`` for a single joint. Numbers may have a sign, decimals and an exponent.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, Self, TypeAlias

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.values import pose_numbers as checks
from orinkit.values.pose_numbers import FIG_AUTO as FIG_AUTO
from orinkit.values.pose_numbers import FIG_NEAREST as FIG_NEAREST
from orinkit.values.pose_numbers import FIG_WITHIN_LIMITS as FIG_WITHIN_LIMITS
from orinkit.values.pose_numbers import Figure as Figure
from orinkit.values.pose_numbers import describe_figure as describe_figure
from orinkit.values.pose_text import PassMarkText, Scanner, TargetParts, read_mark, read_target

Kind: TypeAlias = Literal["P", "T", "J", "V", ""]
"""What the numbers of a target are; ``""`` where it was not said."""


# --- values -----------------------------------------------------------------------------------------------------------


class _Values(tuple[float, ...]):
    """What P, T, J and V have in common: a tuple of finite ``float``."""

    __slots__ = ()
    _kind: ClassVar[str]

    @classmethod
    def of(cls, values: Iterable[float]) -> Self:
        """Return the value that numbers stand for, as a controller answers them: R8[7], R8[8], R8[10].

        A P or T may come without its figure, a J has 1 to 8 numbers, and all are kept.

        Raises:
            InvalidValue: no sequence, too few or too many, one that is no finite number, a figure that is no whole one.
        """
        numbers = checks.listed(cls._kind, values)
        if cls._kind in ("P", "T") and len(numbers) < checks.COUNTS[cls._kind][1]:
            numbers.append(FIG_AUTO)
        return tuple.__new__(cls, checks.conform(cls._kind, numbers))

    def __getnewargs__(self) -> tuple[float, ...]:
        return tuple(self)

    def __str__(self) -> str:
        return checks.rounded(self._kind, self)

    def __repr__(self) -> str:
        fields = zip(checks.FIELDS[self._kind], self, strict=True)
        return f"{self._kind}({', '.join(f'{name}={_shown_number(value)}' for name, value in fields)})"


class _Point(_Values):
    """What begins with x, y, z."""

    __slots__ = ()

    @property
    def x(self) -> float:
        """X, in mm."""
        return self[0]

    @property
    def y(self) -> float:
        """Y, in mm."""
        return self[1]

    @property
    def z(self) -> float:
        """Z, in mm."""
        return self[2]

    def replace(self, **fields: float) -> Self:
        """Return the same with some fields changed: ``pose.replace(z=pose.z + 10)``.

        Raises:
            InvalidValue: a value is no finite number.
            TypeError: a name is no field.
        """
        names = checks.FIELDS[self._kind]
        if unknown := fields.keys() - set(names):
            raise TypeError(f"{self._kind} has no field {min(unknown)!r}, it has {', '.join(names)}")
        return self.of([fields.get(name, value) for name, value in zip(names, self, strict=True)])


class P(_Point):
    """A position: x, y, z in mm, rx, ry, rz in degrees, fig (:class:`Figure` or FIG_AUTO).

    The rotation is Rz(rz) * Ry(ry) * Rx(rx). As a tuple it is seven ``float``, what a controller sends for it; ``fig``
    by its name is an ``int``.

    Raises:
        InvalidValue: a value is no finite number, or ``fig`` no whole one.
    """

    __slots__ = ()
    _kind = "P"

    def __new__(cls, x: float, y: float, z: float, rx: float, ry: float, rz: float, fig: float = FIG_AUTO) -> Self:
        """Return the position of its seven values."""
        return cls.of((x, y, z, rx, ry, rz, fig))

    @property
    def rx(self) -> float:
        """Turned about the base's X axis first, in degrees."""
        return self[3]

    @property
    def ry(self) -> float:
        """Turned about the base's Y axis second, in degrees."""
        return self[4]

    @property
    def rz(self) -> float:
        """Turned about the base's Z axis last, in degrees."""
        return self[5]

    @property
    def fig(self) -> int:
        """The figure; negative where the controller is to choose."""
        return int(self[6])


class T(_Point):
    """A homogeneous transformation: x, y, z in mm, orient vector, approach vector, fig as of :class:`P`.

    The orient vector (ox, oy, oz) is the tool's Y axis, the approach vector (ax, ay, az) its Z axis, both of length 1.

    Raises:
        InvalidValue: a value is no finite number, or ``fig`` no whole one.
    """

    __slots__ = ()
    _kind = "T"

    def __new__(
        cls,
        x: float, y: float, z: float,
        ox: float, oy: float, oz: float,
        ax: float, ay: float, az: float,
        fig: float = FIG_AUTO,
    ) -> Self:  # fmt: skip
        """Return the transformation of its ten values."""
        return cls.of((x, y, z, ox, oy, oz, ax, ay, az, fig))

    @property
    def ox(self) -> float:
        """X of the orient vector."""
        return self[3]

    @property
    def oy(self) -> float:
        """Y of the orient vector."""
        return self[4]

    @property
    def oz(self) -> float:
        """Z of the orient vector."""
        return self[5]

    @property
    def ax(self) -> float:
        """X of the approach vector."""
        return self[6]

    @property
    def ay(self) -> float:
        """Y of the approach vector."""
        return self[7]

    @property
    def az(self) -> float:
        """Z of the approach vector."""
        return self[8]

    @property
    def fig(self) -> int:
        """The figure; negative where the controller is to choose."""
        return int(self[9])


class V(_Point):
    """A vector: x, y, z.

    Raises:
        InvalidValue: a value is no finite number.
    """

    __slots__ = ()
    _kind = "V"

    def __new__(cls, x: float, y: float, z: float) -> Self:
        """Return the vector of its three values."""
        return cls.of((x, y, z))


class J(_Values):
    """Joints, 1 to 8 of them: degrees, mm for linear ones. ``J(45, 30, 120, 0, -60, 0)[2]`` is the third.

    Raises:
        InvalidValue: no joint or more than eight, or a value that is no finite number.
    """

    __slots__ = ()
    _kind = "J"

    def __new__(cls, *joints: float) -> Self:
        """Return the joints, the first one first."""
        return cls.of(joints)

    def __repr__(self) -> str:
        return f"J({', '.join(map(_shown_number, self))})"


PoseLike: TypeAlias = "P | T | J | V | Target | str"
"""What a client takes as a pose: a value, a target, or its text."""


# --- targets ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PassMark:
    """When a motion counts as done, so that the next one may begin.

    Attributes:
        mode: ``"0"`` the command value is at the target, ``"E"`` the encoders are, ``"P"`` near the target as the
            controller sees fit, ``"n"`` within ``radius``.
        radius: mm, above 0, only with ``"n"``.

    Raises:
        InvalidValue: another mode, or a radius that does not go with it.
    """

    mode: Literal["0", "E", "P", "n"]
    radius: float = 0.0

    def __post_init__(self) -> None:
        radius = checks.finite("PassMark", "radius", self.radius)
        if self.mode not in ("0", "E", "P", "n") or (radius > 0) != (self.mode == "n") or radius < 0:
            raise InvalidValue(
                tr(
                    'no pass mark has mode {mode} and radius {radius:g}; it is "0", "E" or "P", or "n" with '
                    "a radius above 0 mm",
                    mode=checks.brief(self.mode),
                    radius=radius,
                )
            )
        object.__setattr__(self, "radius", radius)

    def __str__(self) -> str:
        return f"@{checks.plain_decimal(self.radius) if self.mode == 'n' else self.mode}"

    @classmethod
    def parse(cls, text: str) -> PassMark:
        """Return the mark of a text: ``@P``, ``@E``, ``@0``, or ``@10`` for 10 mm.

        Raises:
            NotationError: the text is no mark.
        """
        scanner = Scanner(text)
        mark = read_mark(scanner)
        if mark is None:
            raise scanner.expected(
                tr('a pass mark ("@P", "@E", "@0", or "@10" for 10 mm)'),
            )
        scanner.finish()
        return _pass_mark(mark)


AT_COMMAND: Final = PassMark("0")
"""``@0``"""
AT_ENCODER: Final = PassMark("E")
"""``@E``"""
PASSING: Final = PassMark("P")
"""``@P``"""


@dataclass(frozen=True, slots=True)
class Extra:
    """Where extra joints go at the same time.

    Attributes:
        absolute: True for EXA, to the values; False for EX, by the values.
        joints: number (7 or 8) and value (degrees, mm for a linear one) of one or two joints.

    Raises:
        InvalidValue: no joint, one twice, another number, or a value that is no finite number.
    """

    absolute: bool
    joints: tuple[tuple[int, float], ...]

    def __post_init__(self) -> None:
        numbers = [number for number, _ in self.joints]
        if not numbers or len(set(numbers)) < len(numbers) or not set(numbers) <= set(checks.EXTRA_JOINTS):
            raise InvalidValue(
                tr("extra joints {numbers}: joint 7, 8 or both are wanted", numbers=checks.brief(numbers))
            )
        joints = tuple((int(number), checks.finite("Extra", f"J{number}", value)) for number, value in self.joints)
        object.__setattr__(self, "joints", joints)

    def __str__(self) -> str:
        joints = ", ".join(f"({number}, {checks.plain_decimal(value)})" for number, value in self.joints)
        return f"{'EXA' if self.absolute else 'EX'}({joints})"


@dataclass(frozen=True, slots=True)
class Target:
    """Where a motion goes. ``str()`` is a text that :func:`parse_target` reads as an equal target.

    Attributes:
        kind: what the numbers are, ``""`` where it was not said.
        value: the numbers (6 or 7 of a P, 9 or 10 of a T, 1 to 8 of a J, 3 of a V, up to 10 of ``""``), or the number
            of a global variable of the kind.
        mark: ``None`` where none was given.
        extra: ``None`` where none was given.

    Raises:
        InvalidValue: another kind, another number of values, a value that is no finite number.
    """

    kind: Kind
    value: tuple[float, ...] | int
    mark: PassMark | None = None
    extra: Extra | None = None

    def __post_init__(self) -> None:
        checks.check_kind(self.kind)
        if isinstance(self.value, int):
            checks.check_index(self.kind, self.value)
        else:
            object.__setattr__(self, "value", tuple(checks.conform(self.kind, checks.listed(self.kind, self.value))))

    @property
    def pose(self) -> P | T | J | V | None:
        """The value as an object; ``None`` for a variable, and where the kind was not said."""
        if isinstance(self.value, int):
            return None
        kind = _CLASSES.get(self.kind)
        return None if kind is None else kind.of(self.value)

    def __str__(self) -> str:
        pose = f"{self.kind}{self.value}" if isinstance(self.value, int) else checks.written(self.kind, self.value)
        return " ".join(str(part) for part in (self.mark, pose, self.extra) if part is not None)


_CLASSES: Final[dict[str, type[P | T | J | V]]] = {"P": P, "T": T, "J": J, "V": V}


# --- text -> target ---------------------------------------------------------------------------------------------------


def parse_target(text: str) -> Target:
    """Return the target that a text stands for; the module's docstring has the grammar.

    Raises:
        NotationError: the text is none, or has more than 4096 characters; the message names the column, counted from 1,
            and what was expected there.
    """
    scanner = Scanner(text)
    target = _target(read_target(scanner))
    scanner.finish()
    return target


def parse_targets(text: str) -> tuple[Target, ...]:
    """Return one or several targets, separated by commas: ``P1, @E P2`` of an arc.

    Raises:
        NotationError: as :func:`parse_target`.
    """
    scanner = Scanner(text)
    targets = [_target(read_target(scanner))]
    while scanner.skip(","):
        targets.append(_target(read_target(scanner)))
    scanner.finish()
    return tuple(targets)


def to_text(pose: PoseLike, mark: str | PassMark = "") -> str:
    """Return the text that a client sends for a pose: ``@E P(364.16, 0, 278.5355, 180, 0, 180, 5)``.

    Args:
        pose: a value, a :class:`Target`, or a text, which is sent as it is.
        mark: ``@P``, ``@E``, ``@0``, ``@<mm>`` or a :class:`PassMark`, put in front.

    Raises:
        InvalidValue: the pose or the mark is something else, or the pose has a mark of its own and another is given.
        NotationError: the mark is a text that is none.
    """
    text = _text_of(pose)
    if mark == "":
        return text
    mark = as_mark(mark)
    if text.lstrip().startswith("@"):
        raise InvalidValue(
            tr("{text} has a pass mark already, {mark} cannot be put in front", text=checks.brief(text), mark=mark)
        )
    return f"{mark} {text}"


def as_mark(mark: object) -> PassMark:
    """Return a pass mark, or its text, as a :class:`PassMark`.

    Raises:
        InvalidValue: it is something else.
        NotationError: the text is none.
    """
    if isinstance(mark, PassMark):
        return mark
    if isinstance(mark, str):
        return PassMark.parse(mark)
    raise InvalidValue(
        tr(
            '{mark} is no pass mark; a pass mark is a text: "@P", "@E", "@0", or "@10" for 10 mm',
            mark=checks.brief(mark),
        )
    )


def _target(parts: TargetParts) -> Target:
    kind: Any = parts.kind
    extra = None if parts.extra is None else Extra(*parts.extra)
    return Target(kind, parts.value, None if parts.mark is None else _pass_mark(parts.mark), extra)


def _pass_mark(mark: PassMarkText) -> PassMark:
    mode: Any = mark.mode
    return PassMark(mode, mark.radius)


def _text_of(pose: object) -> str:
    if isinstance(pose, P | T | J | V):
        return checks.written(pose._kind, pose)  # noqa: SLF001 - one of us
    if isinstance(pose, Target | str):
        return str(pose)
    raise InvalidValue(
        tr("{pose} is no pose; give P(...), T(...), J(...), V(...) or a text like 'P1'", pose=checks.brief(pose))
    )


def _shown_number(value: float) -> str:
    return repr(value).removesuffix(".0")
