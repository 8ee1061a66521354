"""Recording of samples in a file: CSV, or MCAP for Foxglove, PlotJuggler and similar programs."""

from __future__ import annotations

import csv
import json
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TextIO

from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import N_, tr
from orinkit.core.optional_deps import require
from orinkit.core.validation import brief
from orinkit.rc8.slave_fields import POSES, RECEIVED, FieldType, SlaveField
from orinkit.streaming.recording.samples import OWN, Sample
from orinkit.streaming.trajectory.csv_file import COMMAND, ENCODER, TIME
from orinkit.streaming.trajectory.limit_violations import check_period
from orinkit.values.pose_numbers import FIELDS

if TYPE_CHECKING:
    from orinkit.rc8.slave_formats import PoseKind

SAMPLE_TOPIC: Final = "/slave/sample"
"""Channel of an MCAP file with one message per set-point."""
INFO_TOPIC: Final = "/slave/info"
"""Channel of an MCAP file with a single message, which contains the properties common to all set-points."""

_NANO: Final = 1_000_000_000
_CHUNK: Final = 64 * 1024  # bytes, about 1 s; data that is lost if the process is killed
_LATEST: Final = 2**63  # ns; largest start time: times in an MCAP file have 64 bits, and the time of a sample is added
_ROBOT_JOINTS: Final = 6
_VALUE: Final = ".6f"
_EXACT: Final = ".9f"  # for commands, so that a recording can be streamed again, and for components of unit vectors
_TIME: Final = ".6f"


class Recorder:
    """Writes samples into a file; created by :func:`open_recorder`.

    Errors while writing do not raise an exception, because the arm is moving; they are reported in ``error``.

    Attributes:
        path: Path of the file.
        count: Number of samples written.
        error: Message of the error that ended the recording; ``None`` if there was none.
    """

    def __init__(self, path: Path, file: _File) -> None:
        self.path = path
        self.count = 0
        self.error: str | None = None
        self._file: _File | None = file

    def write(self, sample: Sample) -> None:
        """Write a sample; do nothing after an error, or if the file is closed."""
        if self._file is None or self.error is not None:
            return
        try:
            self._file.write(sample)
            self.count += 1
        except Exception as error:  # noqa: BLE001 - a recording never stops a motion
            self._failed(error)

    def close(self) -> None:
        """Complete and close the file; errors are reported in ``error``. Further calls have no effect."""
        file, self._file = self._file, None
        if file is None:
            return
        try:
            file.close(complete=self.error is None)
        except Exception as error:  # noqa: BLE001 - as in write()
            self._failed(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _failed(self, error: Exception) -> None:
        if self.error is None:
            reason = _reason(error)
            self.error = tr(
                "cannot write {path}: {reason}; the recording ended after {count} samples",
                path=self.path,
                reason=reason,
                count=self.count,
            )


def open_recorder(path: str | Path, *, kind: PoseKind, period: float, start_ns: int | None = None) -> Recorder:
    """Open a file for a recording; an existing file is overwritten.

    Args:
        path: Path of the file, with the suffix ``.csv`` or ``.mcap``.
        kind: Pose type of the set-points.
        period: Time between two set-points, s.
        start_ns: Time of the first set-point, ns since 1970, for the times of an MCAP file. ``None``: the time at which
            the first sample is written.

    Raises:
        InvalidValue: If an argument or the suffix is not valid, the directory does not exist, or the file cannot be
            written.
        MissingExtra: If the file is MCAP, and the package ``mcap`` is not installed (extra ``log``).
    """
    check_period(period)
    if kind not in ("J", "P", "T"):
        raise InvalidValue(tr('kind is {kind}, but must be "J", "P" or "T"', kind=brief(kind)))
    if start_ns is not None and not 0 <= start_ns <= _LATEST:
        raise InvalidValue(tr("start_ns is {start_ns}, which is not a valid time", start_ns=brief(start_ns)))
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".mcap"):
        raise InvalidValue(tr("{path}: the name of a recording must end in .csv or .mcap", path=path))
    if not path.parent.is_dir():
        raise InvalidValue(tr("the directory {parent} does not exist", parent=path.parent))
    try:
        return Recorder(path, _Csv(path, kind, period) if suffix == ".csv" else _Mcap(path, kind, period, start_ns))
    except (OSError, ValueError) as error:
        raise InvalidValue(tr("cannot write {path}: {error}", path=path, error=_reason(error))) from None


class _File(Protocol):
    """A file that contains samples in one format."""

    def write(self, sample: Sample) -> None:
        """Write a sample."""

    def close(self, *, complete: bool) -> None:
        """Close the file; if ``complete`` is False, do not write any further data."""


# --- CSV --------------------------------------------------------------------------------------------------------------


class _Csv:
    """CSV: a row per sample, written immediately, so that no sample is lost if the process is killed.

    The column ``time_s`` contains the number of the set-point, multiplied by the period, because the controller takes
    one set-point per period. The time of sending is in the column ``sent_s``; it does not affect ``time_s``. The
    commanded velocity can therefore be computed from ``time_s``.
    """

    def __init__(self, path: Path, kind: PoseKind, period: float) -> None:
        self._kind = kind
        self._period = period
        self._file: TextIO = path.open("w", newline="", encoding="utf-8", buffering=1)
        self._writer = csv.writer(self._file)
        self._groups: list[_Group] | None = None

    def write(self, sample: Sample) -> None:
        if self._groups is None:
            self._groups = _groups(self._kind, sample)
            names = [name for group in self._groups for name in group.names]
            self._writer.writerow([TIME, *names])
        row = [format(sample.number * self._period, _TIME)]
        for group in self._groups:
            row.extend(group.texts(sample))
        self._writer.writerow(row)

    def close(self, *, complete: bool) -> None:
        self._file.close()


class _Group:
    """The columns of a CSV file that contain one value of a sample, for example all columns of a pose.

    Args:
        value: Callback that returns the value from a sample; ``None`` if the sample does not have it.
        names: Names of the columns.
        form: Format of a number.
    """

    __slots__ = ("_form", "_value", "names")

    def __init__(self, value: Callable[[Sample], Any], names: Sequence[str], form: str = _VALUE) -> None:
        self.names = names
        self._value = value
        self._form = form

    def texts(self, sample: Sample) -> list[str]:
        """Return one text per column; the texts are empty if the sample does not have the value."""
        value = self._value(sample)
        if value is None:
            return [""] * len(self.names)
        if isinstance(value, bytes):
            return [value.hex()]
        if not isinstance(value, tuple):
            return [format(value, self._form)]
        texts = [format(number, self._form) for number in value[: len(self.names)]]
        return texts + [""] * (len(self.names) - len(texts))


def _groups(kind: PoseKind, sample: Sample) -> list[_Group]:
    """Return the columns that follow the time: those of the values that ``sample``, the first sample, contains."""
    count = len(sample.command)
    names = [*_titles(kind), *(f"extra_{number}" for number in range(1, count))][:count]
    groups = [_Group(attrgetter("command"), [f"{name}{COMMAND}" for name in names], _EXACT)]
    if sample.joints is not None:
        if kind != "J":
            count = len(sample.joints) if any(sample.joints[_ROBOT_JOINTS:]) else _ROBOT_JOINTS
        groups.append(_Group(attrgetter("joints"), [f"{name}{ENCODER}" for name in FIELDS["J"][:count]]))
    groups.append(_Group(attrgetter("sent"), ["sent_s"], _TIME))
    has = [row for row in RECEIVED if row is not POSES["J"] and sample.value(row) is not None]
    groups += [_group_of(row, sample) for row in has if row.form is FieldType.STAMP]
    groups.append(_Group(attrgetter("code"), ["code"], "#010x"))
    poses = [row for row in has if row.form is FieldType.POSE][:1]  # columns of a second pose would have the same names
    others = [row for row in has if row.form not in (FieldType.STAMP, FieldType.POSE)]
    return groups + [_group_of(row, sample) for row in (*poses, *others)]


_NUMBER_FORMS: Final = {FieldType.STAMP: _TIME, FieldType.BITS: "d"}


def _group_of(row: SlaveField, sample: Sample) -> _Group:
    """Return the columns of a field of the reply; ``sample`` is the first sample, which contains the field."""
    form = _EXACT if row.kind == "T" else _NUMBER_FORMS.get(row.form, _VALUE)
    name = row.column or row.name
    names = [name]
    if row.kind is not None:
        names = _titles(row.kind)
    elif row.form is FieldType.REALS:
        names = [f"{name}_{number}" for number in range(1, len(sample.value(row)) + 1)]
    return _Group(partial(_value_of, row), names, form)


def _value_of(row: SlaveField, sample: Sample) -> Any:
    return sample.value(row)


def _titles(kind: PoseKind) -> list[str]:
    return [name.capitalize() if name == "fig" else name.upper() for name in FIELDS[kind]]


# --- MCAP -------------------------------------------------------------------------------------------------------------


class _Mcap:
    """MCAP: a JSON message per sample, in chunks that are written when full."""

    def __init__(self, path: Path, kind: PoseKind, period: float, start_ns: int | None) -> None:
        writer = _mcap_writer()
        self._start = start_ns
        self._waiting = 0
        self._file = path.open("wb")
        self._writer = writer(self._file)
        try:
            self._samples = self._begin(kind, period)
        except OSError:
            with suppress(OSError):
                self._file.close()
            raise

    def write(self, sample: Sample) -> None:
        if self._start is None:
            self._start = time.time_ns() - round(sample.sent * _NANO)
        moment = self._start + round(sample.sent * _NANO)
        data = _json(_as_json(sample))
        self._writer.add_message(self._samples, moment, data, moment, sample.number)
        self._waiting += len(data)
        if self._waiting >= _CHUNK:
            self._waiting = 0
            self._writer.flush()

    def close(self, *, complete: bool) -> None:
        try:
            if complete:
                self._writer.finish()
        finally:
            self._file.close()

    def _begin(self, kind: PoseKind, period: float) -> int:
        """Write the schemas and the properties of the recording; return the number of the channel for samples."""
        self._writer.start(profile="", library="orinkit")
        samples = self._channel(SAMPLE_TOPIC, "orinkit.streaming.Sample", _sample_schema())
        info = self._channel(INFO_TOPIC, "orinkit.streaming.Info", _info_schema())
        now = time.time_ns() if self._start is None else self._start
        self._writer.add_message(info, now, _json({"kind": kind, "period": period}), now)
        self._writer.flush()
        return samples

    def _channel(self, topic: str, name: str, schema: dict[str, Any]) -> int:
        number: int = self._writer.register_schema(name, "jsonschema", _json(schema))
        channel: int = self._writer.register_channel(topic, "json", number)
        return channel


def _mcap_writer() -> Any:
    """Return the class that writes MCAP, typed as ``Any``, because its methods are untyped."""
    require(tr("recording in MCAP"), "log", "mcap")
    from mcap.writer import Writer

    return Writer


def _as_json(sample: Sample) -> dict[str, Any]:
    """Return the values that a sample has, by name."""
    found = {name: value for name, get in _GETTERS.items() if (value := get(sample)) is not None}
    for row in _HEXADECIMAL:
        if row.name in found:
            found[row.name] = found[row.name].hex()
    return found


def _json(value: dict[str, Any]) -> bytes:
    try:
        return json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
    except ValueError:  # JSON cannot represent NaN
        return _json({name: _finite(entry) for name, entry in value.items()})


def _finite(entry: Any) -> Any:
    if isinstance(entry, tuple):
        return [_finite(number) for number in entry]
    return None if isinstance(entry, float) and not math.isfinite(entry) else entry


_JSON_TYPES: Final = {
    FieldType.STAMP: "number", FieldType.REAL: "number", FieldType.POSE: "array", FieldType.REALS: "array",
    FieldType.BITS: "integer", FieldType.BYTES: "string",
}  # fmt: skip
_SAMPLE: Final[dict[str, tuple[str, str]]] = {  # type, description
    "number": ("integer", N_("number of the set-point, from 0")),
    "sent": ("number", N_("time of sending, s since the first set-point was sent")),
    "command": ("array", N_("set-point of pose type J (joints in deg), P (X, Y, Z in mm, angles in deg, Fig) or T")),
    "code": ("integer", N_("return code")),
    **{row.name: (_JSON_TYPES[row.form], row.text) for row in RECEIVED},
    "delay": ("number", N_("time from setting a live target to sending this set-point, s; only for the first set-point towards the "
        "target")),
    "replied": ("number", N_("time of the reply, s since the first set-point was sent")),
}  # fmt: skip
_ROWS: Final = {row.name: row for row in RECEIVED}
_GETTERS: Final[dict[str, Callable[[Sample], Any]]] = {
    name: partial(_value_of, _ROWS[name]) if name in _ROWS and name not in OWN else attrgetter(name) for name in _SAMPLE
}
_HEXADECIMAL: Final = tuple(row for row in RECEIVED if row.form is FieldType.BYTES)
_INFO: Final[dict[str, tuple[str, str]]] = {
    "kind": ("string", N_("pose type of the set-points: J, P or T")),
    "period": ("number", N_("time between two set-points, s")),
}


def _sample_schema() -> dict[str, Any]:
    return _schema(tr("A set-point and its feedback"), _SAMPLE)


def _info_schema() -> dict[str, Any]:
    return _schema(tr("Properties common to all set-points"), _INFO)


def _schema(title: str, fields: dict[str, tuple[str, str]]) -> dict[str, Any]:
    properties: dict[str, dict[str, Any]] = {}
    for name, (kind, text) in fields.items():
        properties[name] = {"type": kind, "description": tr(text)}
        if kind == "array":
            properties[name]["items"] = {"type": "number"}
    return {"title": title, "type": "object", "properties": properties}


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
