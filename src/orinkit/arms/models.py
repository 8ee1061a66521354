"""Robot models, read from TOML files: one file per arm, in this package or supplied by the user.

A file contains ``name``, ``type_name``, ``origins`` (x, y, z of each joint of the robot), ``axes`` (tables of ``lower``,
``upper``, ``velocity`` and optionally ``acceleration``, ``slave_acceleration`` and ``linear``), ``home``, and optionally
``kind`` (``"six-axis"``, the default, or ``"scara"``), ``figure_bits``, ``mass`` (kg, of the whole arm), ``payload`` (kg)
and a table ``path`` of ``speed``, ``acceleration``, ``rotation`` and ``rotation_acceleration``. A six-axis arm has six
origins and six to eight axes, a SCARA four origins and four axes.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Final, Literal, NoReturn, TypeAlias

from orinkit.core.i18n import tr
from orinkit.core.record import record

_PACKAGE: Final = "orinkit.arms"
_NAME: Final = re.compile(r'^name = "([^"]+)"$', re.MULTILINE)


def _built_in() -> dict[str, str]:
    """Return the file names of the built-in models by model name, in the order of the model names.

    Only the model name is read from each file, because parsing all files would delay the start of every program.
    """
    found = {}
    for file in resources.files(_PACKAGE).iterdir():
        if file.name.endswith(".toml"):
            name = _NAME.search(file.read_text(encoding="utf-8"))
            assert name is not None, file.name
            found[name[1]] = file.name
    return dict(sorted(found.items()))


_BUILT_IN: Final = _built_in()
MODEL_NAMES: Final = tuple(_BUILT_IN)
"""Names of the built-in models for :func:`load_model`; each model is a TOML file in this package."""

DEFAULT_SECONDS_TO_SPEED: Final = 0.2  # s, velocity / acceleration, if a file contains no acceleration
DEFAULT_SLAVE_RATE: Final = 17.0  # 1/s, slave_acceleration / velocity, if a file contains no slave_acceleration
DEFAULT_PATH: Final = {"speed": 1500.0, "acceleration": 7500.0, "rotation": 360.0, "rotation_acceleration": 1800.0}

DEFAULT_MASS: Final = 40.0  # kg of the arm for each m between shoulder and flange, if a file contains no mass
DEFAULT_PAYLOAD: Final = 0.12  # of the mass, if a file contains no payload

_COBOTTA_BIT: Final = 256  # of the figure; its meaning is not published
_SERIES: Final = re.compile("[A-Z]+[0-9]+(?:A[0-9]{2,})?")  # HM4A73, but not the version A3 of a VS050A3

ArmKind: TypeAlias = Literal["six-axis", "scara"]
"""Kinds of arms: a vertical arm with six axes, or a horizontal arm with four."""

_ROBOT_AXES: Final[dict[ArmKind, int]] = {"six-axis": 6, "scara": 4}
_MOST_AXES: Final[dict[ArmKind, int]] = {"six-axis": 8, "scara": 4}
_LINEAR_OF_SCARA: Final = 2  # index of the linear axis
_LARGEST: Final = 1e6  # for lengths in mm, angles in deg, and their first and second derivatives
_LONGEST_NAME: Final = 64
_LARGEST_FILE: Final = 1_000_000
_KEYS: Final = frozenset(
    {"name", "type_name", "kind", "origins", "axes", "home", "figure_bits", "path", "mass", "payload"}
)
_AXIS_KEYS: Final = frozenset({"lower", "upper", "velocity", "acceleration", "slave_acceleration", "linear"})


@record
class AxisModel:
    """One axis, in deg, or in mm if it is linear.

    Attributes:
        lower: Lower soft limit.
        upper: Upper soft limit.
        velocity: Largest velocity, deg/s or mm/s.
        acceleration: Largest acceleration, deg/s^2 or mm/s^2. DENSO does not publish it. A file may omit it; the
            default, 5 times ``velocity``, is an assumption of this project.
        linear: True for a linear axis.
        slave_acceleration: Largest acceleration of a command in slave mode, deg/s^2 or mm/s^2. A controller accepts
            larger changes of a command than it plans itself. 0 is the default: 17 times ``velocity``, the figure that
            is known of a COBOTTA PRO, but at least ``acceleration``.
    """

    lower: float
    upper: float
    velocity: float
    acceleration: float
    linear: bool = False
    slave_acceleration: float = 0.0

    def __post_init__(self) -> None:
        if not self.slave_acceleration:
            assumed = max(self.acceleration, self.velocity * DEFAULT_SLAVE_RATE)
            object.__setattr__(self, "slave_acceleration", assumed)


@record
class ArmModel:
    """The model of one arm.

    The origin of a joint is a position in the frame of the previous joint; for joint 1, in the base frame. When all joints
    of a six-axis arm are zero, the arm stands upright, and the joints rotate about the axes z, y, y, z, y, z. When all
    joints of a SCARA are zero, the arm is stretched out in the X direction. Its joints 1, 2 and 4 rotate about z. Joint 3
    moves in the Z direction, in mm. The Z axis of its flange points upwards, like that of the base.

    Attributes:
        name: Name of the model, for example ``"VS-050"``.
        type_name: Reply to ``@TYPE_NAME`` and ``GetRobotTypeName``.
        origins: Origins of the six joints of a six-axis arm, or of the four joints of a SCARA, (x, y, z) each, mm.
        axes: Six to eight axes; the seventh and eighth are extended joints, which do not move the flange. A SCARA has
            exactly four axes.
        home: Home position of each axis, within the limits. The virtual arm starts at this position.
        path_speed: Largest velocity of the TCP on a path, mm/s. This and the next three limits are not published;
            their defaults 1500, 7500, 360 and 1800 are assumptions of this project.
        path_acceleration: Largest acceleration of the TCP on a path, mm/s^2.
        path_rotation: Largest velocity of the orientation on a path, deg/s.
        path_rotation_acceleration: Largest acceleration of the orientation on a path, deg/s^2.
        mass: Mass of the whole arm, kg; 0 for an estimate from the lengths of the links.
        payload: Largest payload, kg; 0 for an estimate from the mass.
        figure_bits: Bits that the controller sets in every figure that it reports.
        kind: ``"six-axis"`` or ``"scara"``.
    """

    name: str
    type_name: str
    origins: tuple[tuple[float, float, float], ...]
    axes: tuple[AxisModel, ...]
    home: tuple[float, ...]
    path_speed: float = DEFAULT_PATH["speed"]
    path_acceleration: float = DEFAULT_PATH["acceleration"]
    path_rotation: float = DEFAULT_PATH["rotation"]
    path_rotation_acceleration: float = DEFAULT_PATH["rotation_acceleration"]
    mass: float = 0.0
    payload: float = 0.0
    figure_bits: int = 0
    kind: ArmKind = "six-axis"

    @property
    def robot_axes(self) -> int:
        """The number of axes that move the flange: 6, or 4 for a SCARA."""
        return _ROBOT_AXES[self.kind]

    @property
    def is_scara(self) -> bool:
        """True for a SCARA."""
        return self.kind == "scara"


def joint_unit(index: int, count: int) -> str:
    """Return the unit of a joint, by its index from 0, of an arm with ``count`` axes: deg, mm, or deg (mm) if unknown.

    An arm with four axes is a SCARA, whose joint 3 is linear. Only the model shows the unit of an extended joint.
    """
    if count == _ROBOT_AXES["scara"] and index == _LINEAR_OF_SCARA:
        return "mm"
    return "deg" if index < _ROBOT_AXES["six-axis"] else "deg (mm)"


def load_model(name_or_path: str | Path) -> ArmModel:
    """Return a built-in model, or read one from a TOML file.

    Args:
        name_or_path: One of :data:`MODEL_NAMES`, in upper or lower case, with or without dashes; or the path of a file.

    Raises:
        ValueError: If there is no such model or file, or the file is not a valid model; the message names the file, the
            key and the reason.
    """
    wanted = _plain(str(name_or_path))
    for name, file in _BUILT_IN.items():
        if isinstance(name_or_path, str) and _plain(name) == wanted:
            text = resources.files(_PACKAGE).joinpath(file).read_text(encoding="utf-8")
            return parse_model(text, file)
    return parse_model(_read(Path(name_or_path)), str(name_or_path))


def model_of_type(type_name: str) -> ArmModel | None:
    """Return the built-in model for a type name (``@TYPE_NAME``, GetRobotTypeName); ``None`` if there is none.

    Only the series is compared, for example ``VS050`` in ``VS050A3-AV6-NNN-NNN``. The rest of the name describes the
    controller.
    """
    wanted = _SERIES.match(type_name.strip().upper())
    for name in MODEL_NAMES:
        model = load_model(name)
        known = _SERIES.match(model.type_name)
        if wanted is not None and known is not None and known[0] == wanted[0]:
            return model
    return None


def parse_model(text: str, source: str) -> ArmModel:
    """Parse a model from TOML text.

    Args:
        text: Content of the file.
        source: Name of the file, for error messages.

    Raises:
        ValueError: If the text is not a valid model; the message names ``source``, the key and the reason.
    """
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ValueError(tr("{source}: not valid TOML: {error}", source=source, error=_short(error))) from None
    except ValueError as error:  # an integer with more digits than Python converts
        raise ValueError(tr("{source}: invalid value: {error}", source=source, error=_short(error))) from None
    return _ModelReader(source).model(table)


class _ModelReader:
    """Validates a parsed TOML table and converts it to an :class:`ArmModel`; errors name the file."""

    def __init__(self, source: str) -> None:
        self._source = source

    def model(self, table: Mapping[str, object]) -> ArmModel:
        self._check_keys(table, _KEYS, "")
        kind = self._kind(table.get("kind", "six-axis"))
        axes = self._axes(table.get("axes"), kind)
        path = self._path(table.get("path", {}))
        return ArmModel(
            name=self._text(table, "name"),
            type_name=self._text(table, "type_name"),
            kind=kind,
            origins=self._origins(table.get("origins"), kind),
            axes=axes,
            home=self._home(table.get("home"), axes),
            figure_bits=self._bits(table.get("figure_bits", 0), "figure_bits"),
            path_speed=path["speed"],
            path_acceleration=path["acceleration"],
            path_rotation=path["rotation"],
            path_rotation_acceleration=path["rotation_acceleration"],
            mass=self._positive(table["mass"], "mass") if "mass" in table else 0.0,
            payload=self._positive(table["payload"], "payload") if "payload" in table else 0.0,
        )

    def _text(self, table: Mapping[str, object], key: str) -> str:
        value = table.get(key)
        if not isinstance(value, str) or not value.strip() or not value.isprintable() or len(value) > _LONGEST_NAME:
            self._fail(
                key,
                tr("must be a string of 1 to {most} printable characters", most=_LONGEST_NAME),
            )
        return value

    def _kind(self, value: object) -> ArmKind:
        kind = next((each for each in _ROBOT_AXES if each == value), None)
        if kind is None:
            self._fail("kind", tr("must be one of {names}", names=", ".join(_ROBOT_AXES)))
        return kind

    def _origins(self, value: object, kind: ArmKind) -> tuple[tuple[float, float, float], ...]:
        rows = self._list(value, "origins", _ROBOT_AXES[kind], _ROBOT_AXES[kind])
        origins = []
        for index, row in enumerate(rows):
            key = f"origins[{index}]"
            x, y, z = (self._number(entry, key) for entry in self._list(row, key, 3, 3))
            origins.append((x, y, z))
        for key, length in (_links_of_scara(origins) if kind == "scara" else _links_of_six(origins)).items():
            if length < 1.0:
                self._fail(key, tr("the link is shorter than 1 mm"))
        return tuple(origins)

    def _axes(self, value: object, kind: ArmKind) -> tuple[AxisModel, ...]:
        rows = self._list(value, "axes", _ROBOT_AXES[kind], _MOST_AXES[kind])
        return tuple(self._axis(row, f"axes[{index}]", index, kind) for index, row in enumerate(rows))

    def _axis(self, row: object, key: str, index: int, kind: ArmKind) -> AxisModel:
        if not isinstance(row, dict):
            self._fail(key, tr("must be a table"))
        self._check_keys(row, _AXIS_KEYS, f"{key}.")
        lower = self._number(row.get("lower"), f"{key}.lower")
        upper = self._number(row.get("upper"), f"{key}.upper")
        if lower >= upper:
            self._fail(f"{key}.lower", tr("{lower:g} must be below upper ({upper:g})", lower=lower, upper=upper))
        velocity = self._positive(row.get("velocity"), f"{key}.velocity")
        acceleration = self._positive(
            row.get("acceleration", velocity / DEFAULT_SECONDS_TO_SPEED), f"{key}.acceleration"
        )
        slave_acceleration = (
            self._positive(row["slave_acceleration"], f"{key}.slave_acceleration")
            if "slave_acceleration" in row
            else 0.0
        )
        linear = self._linear(row.get("linear", False), f"{key}.linear", index, kind)
        return AxisModel(lower, upper, velocity, acceleration, linear, slave_acceleration)

    def _linear(self, value: object, key: str, index: int, kind: ArmKind) -> bool:
        if not isinstance(value, bool):
            self._fail(key, tr("must be true or false"))
        if kind == "scara" and value != (index == _LINEAR_OF_SCARA):
            self._fail(key, tr("joint 3 of a SCARA is linear, and no other joint is"))
        if kind != "scara" and value and index < _ROBOT_AXES[kind]:
            self._fail(key, tr("only an extended joint can be linear"))
        return value

    def _home(self, value: object, axes: Sequence[AxisModel]) -> tuple[float, ...]:
        home = tuple(self._number(entry, "home") for entry in self._list(value, "home", len(axes), len(axes)))
        for number, (position, axis) in enumerate(zip(home, axes, strict=True), start=1):
            if not axis.lower <= position <= axis.upper:
                self._fail(
                    "home",
                    tr(
                        "J{number} = {position:g} is outside the limits, {lower:g} to {upper:g}",
                        number=number,
                        position=position,
                        lower=axis.lower,
                        upper=axis.upper,
                    ),
                )
        return home

    def _bits(self, value: object, key: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or value not in (0, _COBOTTA_BIT):
            self._fail(key, tr("must be 0 or {bit}", bit=_COBOTTA_BIT))
        return value

    def _path(self, table: object) -> dict[str, float]:
        if not isinstance(table, dict):
            self._fail("path", tr("must be a table"))
        self._check_keys(table, DEFAULT_PATH, "path.")
        return {key: self._positive(table.get(key, default), f"path.{key}") for key, default in DEFAULT_PATH.items()}

    def _check_keys(self, table: Mapping[str, object], keys: Collection[str], prefix: str) -> None:
        for key in table:
            if key not in keys:
                names = ", ".join(sorted(keys))
                self._fail(
                    prefix + _short(key),
                    tr("unknown key; valid keys: {names}", names=names),
                )

    def _list(self, value: object, key: str, minimum: int, maximum: int) -> list[object]:
        if not isinstance(value, list) or not minimum <= len(value) <= maximum:
            count = str(minimum) if minimum == maximum else f"{minimum}..{maximum}"
            self._fail(key, tr("must be a list of {count} entries", count=count))
        return value

    def _positive(self, value: object, key: str) -> float:
        number = self._number(value, key)
        if number <= 0:
            self._fail(key, tr("must be greater than 0, not {number:g}", number=number))
        return number

    def _number(self, value: object, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._fail(key, tr("must be a number"))
        if not -_LARGEST <= value <= _LARGEST:  # also rejects NaN
            self._fail(
                key,
                tr("must be a number from {least:g} to {most:g}", least=-_LARGEST, most=_LARGEST),
            )
        return float(value)

    def _fail(self, key: str, reason: str) -> NoReturn:
        raise ValueError(f"{self._source}: {key}: {reason}")


def _links_of_six(origins: Sequence[tuple[float, float, float]]) -> dict[str, float]:
    """Return the lengths of upper arm and forearm, mm, by the keys from which they result."""
    upper, fore, wrist = origins[2], origins[3], origins[4]
    return {
        "origins[2]": math.hypot(upper[0], upper[2]),
        "origins[3], origins[4]": math.hypot(fore[0], fore[2] + wrist[2]),
    }


def _links_of_scara(origins: Sequence[tuple[float, float, float]]) -> dict[str, float]:
    """Return the horizontal lengths of the two arms, mm, by the keys from which they result."""
    first, second, last = origins[1:4]
    return {
        "origins[1]": math.hypot(first[0], first[1]),
        "origins[2], origins[3]": math.hypot(second[0] + last[0], second[1] + last[1]),
    }


def _read(path: Path) -> str:
    names = ", ".join(MODEL_NAMES)
    shown = _short(path)
    if not _is_file(path):
        raise ValueError(tr("{shown}: no such robot model or file; built-in models: {names}", shown=shown, names=names))
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
    except OSError as error:
        raise ValueError(tr("{shown}: cannot be read: {reason}", shown=shown, reason=error.strerror)) from None
    if len(content) > _LARGEST_FILE:
        raise ValueError(tr("{shown}: larger than {most} bytes", shown=shown, most=_LARGEST_FILE))
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError(tr("{shown}: not UTF-8 text", shown=shown)) from None


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # the name is too long
        return False


def _plain(name: str) -> str:
    return name.strip().lower().replace("-", "").replace("_", "")


def _short(value: object) -> str:
    text = str(value)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= 200 else text[:200] + "..."
