"""Poses of robots: values, figures, and the text form for Robot_Move (RC8 3.3.4, 4.6.1).

=====================================  ==========================================================================
value                                  meaning
=====================================  ==========================================================================
``P(x, y, z, rx, ry, rz, fig)``        position: mm, degrees (turned about Z, then new Y, then new X), figure
``T(x, y, z, ox, oy, oz, ax, ay, az,   homogeneous transformation: mm, orient vector (the tool's Y axis), approach
fig)``                                 vector (the tool's Z axis), figure
``J(j1, ..., j8)``                     joints: degrees, mm for linear ones
``V(x, y, z)``                         vector
=====================================  ==========================================================================

All these values are tuples of ``float`` and can be assigned directly to a variable of the controller. :func:`to_text`
returns the text for a controller with all digits: ``P(364.16, 0, 278.5355, 180, 0, 180, 5)``. ``str()`` rounds to six
decimals, for display.

The target of a motion has this form as text; blanks between its parts and the case of letters are ignored::

    [@P | @E | @C | @0 | @<mm>]  P1  |  P[1]  |  P(v, v, ...)  |  (v, v, ...)   [EX((7, v), (8, v)) | EXA((7, v))]

T, J or V may replace P, and ``EX(7, v)`` is valid for a single joint. Numbers (``v``, ``mm``) may have a sign,
decimals and an exponent.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, Final, Literal, Self, TypeAlias

from orinkit.core.errors import InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.core.record import record
from orinkit.core.validation import brief, check_finite
from orinkit.values import pose_numbers as checks
from orinkit.values.pose_numbers import FIG_AUTO as FIG_AUTO
from orinkit.values.pose_numbers import FIG_NEAREST as FIG_NEAREST
from orinkit.values.pose_numbers import FIG_WITHIN_LIMITS as FIG_WITHIN_LIMITS
from orinkit.values.pose_numbers import Figure as Figure
from orinkit.values.pose_numbers import describe_figure as describe_figure
from orinkit.values.pose_text import PassMarkText, Scanner, TargetParts, read_mark, read_target

Kind: TypeAlias = Literal["P", "T", "J", "V", ""]
"""Pose type of a target; ``""`` if it is unspecified."""


# --- values -----------------------------------------------------------------------------------------------------------


class _Values(tuple[float, ...]):
    """Base class of P, T, J and V: a tuple of finite ``float``."""

    __slots__ = ()
    _kind: ClassVar[str]

    @classmethod
    def of(cls, values: Iterable[float]) -> Self:
        """Return a value from a sequence of numbers, for example the VT_R8 array in a reply.

        The figure of a P or T may be missing. A J has 1 to 8 numbers; zeros for unused joints are kept, too.

        Raises:
            InvalidValue: If the argument is not a sequence, the number of values is wrong, a value is not a finite
                number, or the figure is not a whole number.
        """
        numbers = checks.listed(cls._kind, values)
        if cls._kind in ("P", "T") and len(numbers) < checks.COUNTS[cls._kind][1]:
            numbers.append(FIG_AUTO)
        return tuple.__new__(cls, checks.to_floats(cls._kind, numbers))

    def __getnewargs__(self) -> tuple[float, ...]:
        return tuple(self)

    def __str__(self) -> str:
        return checks.rounded_text(self._kind, self)

    def __repr__(self) -> str:
        fields = zip(checks.FIELDS[self._kind], self, strict=True)
        return f"{self._kind}({', '.join(f'{name}={_shown_number(value)}' for name, value in fields)})"


class _Point(_Values):
    """Base class of P, T and V, which begin with x, y, z."""

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
        """Return a copy with some fields changed: ``pose.replace(z=pose.z + 10)``.

        Raises:
            InvalidValue: If a value is not a finite number.
            TypeError: If there is no such field.
        """
        names = checks.FIELDS[self._kind]
        if unknown := fields.keys() - set(names):
            raise TypeError(f"{self._kind} has no field {min(unknown)!r}, it has {', '.join(names)}")
        return self.of([fields.get(name, value) for name, value in zip(names, self, strict=True)])


class P(_Point):
    """A position: x, y, z in mm, rx, ry, rz in degrees, fig (:class:`Figure` or FIG_AUTO).

    The rotation is Rz(rz) * Ry(ry) * Rx(rx). As a tuple, a position consists of seven ``float``, as in the reply of a
    controller; the property ``fig`` is an ``int``.

    Raises:
        InvalidValue: If a value is not a finite number, or ``fig`` is not a whole number.
    """

    __slots__ = ()
    _kind = "P"

    def __new__(cls, x: float, y: float, z: float, rx: float, ry: float, rz: float, fig: float = FIG_AUTO) -> Self:
        """Create a position from its seven values."""
        return cls.of((x, y, z, rx, ry, rz, fig))

    @property
    def rx(self) -> float:
        """First rotation, about the X axis of the base frame, in degrees."""
        return self[3]

    @property
    def ry(self) -> float:
        """Second rotation, about the Y axis of the base frame, in degrees."""
        return self[4]

    @property
    def rz(self) -> float:
        """Last rotation, about the Z axis of the base frame, in degrees."""
        return self[5]

    @property
    def fig(self) -> int:
        """The figure; negative if the controller chooses it."""
        return int(self[6])


class T(_Point):
    """A homogeneous transformation: x, y, z in mm, orient vector, approach vector, fig as in :class:`P`.

    The orient vector (ox, oy, oz) is the tool's Y axis, the approach vector (ax, ay, az) its Z axis, both of length 1.

    Raises:
        InvalidValue: If a value is not a finite number, or ``fig`` is not a whole number.
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
        """Create a transformation from its ten values."""
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
        """The figure; negative if the controller chooses it."""
        return int(self[9])


class V(_Point):
    """A vector: x, y, z.

    Raises:
        InvalidValue: If a value is not a finite number.
    """

    __slots__ = ()
    _kind = "V"

    def __new__(cls, x: float, y: float, z: float) -> Self:
        """Create a vector from its three values."""
        return cls.of((x, y, z))


class J(_Values):
    """1 to 8 joints, in degrees, or in mm for linear joints. ``J(45, 30, 120, 0, -60, 0)[2]`` is the third joint.

    Raises:
        InvalidValue: If there are no joints or more than eight, or a value is not a finite number.
    """

    __slots__ = ()
    _kind = "J"

    def __new__(cls, *joints: float) -> Self:
        """Create joints from their values, beginning with the first joint."""
        return cls.of(joints)

    def __repr__(self) -> str:
        return f"J({', '.join(map(_shown_number, self))})"


PoseLike: TypeAlias = "P | T | J | V | Target | str"
"""The poses that methods of a client accept: a P, T, J or V, a :class:`Target`, or the text of a target."""


# --- targets ----------------------------------------------------------------------------------------------------------


@record
class PassMark:
    """Pass mark: the condition under which a motion counts as complete, so that the next one may begin.

    Attributes:
        mode: ``"0"``: the command position has reached the target. ``"E"``: the encoder values have reached the target.
            ``"C"``: the tool has reached the target within the tolerance of CrtMotionAllow. ``"P"``: the arm is near the target; the controller determines the distance. ``"n"``: the arm is within
            ``radius`` of the target.
        radius: Radius in mm, above 0; only for ``"n"``.

    Raises:
        InvalidValue: If the mode is unknown, or the radius is not valid for the mode.
    """

    mode: Literal["0", "E", "C", "P", "n"]
    radius: float = 0.0

    def __post_init__(self) -> None:
        radius = check_finite("radius", self.radius, "PassMark")
        if self.mode not in ("0", "E", "C", "P", "n") or (radius > 0) != (self.mode == "n") or radius < 0:
            raise InvalidValue(
                tr(
                    'invalid pass mark, mode {mode} with radius {radius:g} mm. Try: "0", "E", "C" or "P", or "n" with '
                    "a radius above 0 mm",
                    mode=brief(self.mode),
                    radius=radius,
                )
            )
        object.__setattr__(self, "radius", radius)

    def __str__(self) -> str:
        return f"@{checks.plain_decimal(self.radius) if self.mode == 'n' else self.mode}"

    @classmethod
    def parse(cls, text: str) -> PassMark:
        """Parse a pass mark: ``@P``, ``@E``, ``@C``, ``@0``, or ``@10`` for 10 mm.

        Raises:
            NotationError: If the text is not a pass mark.
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
"""The pass mark ``@0``: the command position has reached the target."""
AT_ENCODER: Final = PassMark("E")
"""The pass mark ``@E``: the encoder values have reached the target."""
PASSING: Final = PassMark("P")
"""The pass mark ``@P``: the arm is near the target."""


@record
class Extra:
    """Motion of extended joints during a motion of the arm.

    Attributes:
        absolute: True for EXA (move to the values); False for EX (move by the values).
        joints: Number (7 or 8) and value (degrees, mm for a linear joint) of one or two joints.

    Raises:
        InvalidValue: If there is no joint, a joint occurs twice, a joint number is not 7 or 8, or a value is not a
            finite number.
    """

    absolute: bool
    joints: tuple[tuple[int, float], ...]

    def __post_init__(self) -> None:
        numbers = [number for number, _ in self.joints]
        if not numbers or len(set(numbers)) < len(numbers) or not set(numbers) <= set(checks.EXTRA_JOINTS):
            raise InvalidValue(tr("the extended joints must be 7, 8 or both, not {numbers}", numbers=brief(numbers)))
        joints = tuple((int(number), check_finite(f"J{number}", value, "Extra")) for number, value in self.joints)
        object.__setattr__(self, "joints", joints)

    def __str__(self) -> str:
        joints = ", ".join(f"({number}, {checks.plain_decimal(value)})" for number, value in self.joints)
        return f"{'EXA' if self.absolute else 'EX'}({joints})"


@record
class Target:
    """The target of a motion. ``str()`` returns a text that :func:`parse_target` parses to an equal target.

    Attributes:
        kind: Pose type; ``""`` if it is unspecified.
        value: The numbers (6 or 7 of a P, 9 or 10 of a T, 1 to 8 of a J, 3 of a V, up to 10 of ``""``), or the index of
            a global variable of the pose type.
        mark: Pass mark; ``None`` if it is unspecified.
        extra: Extended joints; ``None`` if there are none.

    Raises:
        InvalidValue: If the pose type is unknown, the number of values is wrong, or a value is not a finite number.
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
            object.__setattr__(self, "value", tuple(checks.to_floats(self.kind, checks.listed(self.kind, self.value))))

    @property
    def pose(self) -> P | T | J | V | None:
        """The value as a P, T, J or V; ``None`` for a global variable, or if the pose type is unspecified."""
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
    """Parse a target; the grammar is in the module's docstring.

    Raises:
        NotationError: If the text is not a target, or has more than 4096 characters. The message contains the column,
            counted from 1, and the expected text.
    """
    scanner = Scanner(text)
    target = _target(read_target(scanner))
    scanner.finish()
    return target


def parse_targets(text: str, most: int | None = None) -> tuple[Target, ...]:
    """Parse one or several targets, separated by commas, for example ``P1, @E P2`` for the two targets of an arc.

    Args:
        text: The text.
        most: Maximum number of targets; ``None`` for no limit other than the length of the text.

    Raises:
        NotationError: As for :func:`parse_target`; also if there are too many targets.
    """
    scanner = Scanner(text)
    targets = [_target(read_target(scanner))]
    while scanner.skip(","):
        if len(targets) == most:
            raise NotationError(tr("more than {most} poses", most=most))
        targets.append(_target(read_target(scanner)))
    scanner.finish()
    return tuple(targets)


def to_text(pose: PoseLike, mark: str | PassMark = "") -> str:
    """Return the text that a client sends for a pose: ``@E P(364.16, 0, 278.5355, 180, 0, 180, 5)``.

    Args:
        pose: A P, T, J or V, a :class:`Target`, or a text; a text is not checked.
        mark: Pass mark to prepend: ``@P``, ``@E``, ``@0``, ``@<mm>`` or a :class:`PassMark`.

    Raises:
        InvalidValue: If the type of the pose or of the mark is not valid, or if ``mark`` is given although the pose
            already has a mark.
        NotationError: If the mark is a text that is not a pass mark.
    """
    text = _text_of(pose)
    if mark == "":
        return text
    mark = as_mark(mark)
    if text.lstrip().startswith("@"):
        raise InvalidValue(tr("{text} already has a pass mark, {mark} cannot be added", text=brief(text), mark=mark))
    return f"{mark} {text}"


def as_mark(mark: object) -> PassMark:
    """Return a pass mark, or the text of one, as a :class:`PassMark`.

    Raises:
        InvalidValue: If the argument is neither a pass mark nor a text.
        NotationError: If the text is not a pass mark.
    """
    if isinstance(mark, PassMark):
        return mark
    if isinstance(mark, str):
        return PassMark.parse(mark)
    raise InvalidValue(
        tr(
            '{mark} is not a pass mark. Try: a text, "@P", "@E", "@0", or "@10" for 10 mm',
            mark=brief(mark),
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
        return checks.written(pose._kind, pose)  # noqa: SLF001 - a class of this module
    if isinstance(pose, Target | str):
        return str(pose)
    raise InvalidValue(
        tr("{pose} is not a pose. Try: P(...), T(...), J(...), V(...) or a text like 'P1'", pose=brief(pose))
    )


def _shown_number(value: float) -> str:
    return repr(value).removesuffix(".0")
