"""THE TABLE of the fields of slave mode: the arguments and results of slvMove (RC8 4.2, tables 4-1 to 4-3).

One row of :data:`FIELDS` describes one field. The rows are in the order of the fields in ``Sample`` and in files;
``place`` is their order in slvMove. The rows are used for:

=====================================  ================================================================================
use                                    columns
=====================================  ================================================================================
bits of slvSendFormat, slvRecvFormat   ``send``, ``receive``; pairs that exclude each other are in :data:`EXCLUSIVE`
slvMove's parameter and its result     ``place``, ``form``, ``count``; ``label`` etc. name a field in messages
memory of the streaming process        ``form``, ``count``
``Sample``, MCAP                       ``name``; ``text`` is the description in the schema
CSV                                    ``column``, ``form``, ``count``
words of the client's ``recv``         ``name``, if ``by_word``
parameters of ``slave_mode()``         ``name``; the parameters themselves are written by hand in the client
I/O points and sources of values       ``name``, a key of tables in ``virtual/rc8/robot``: ``slave_mode/io.py`` and
                                       ``slave_feedback.py``
=====================================  ================================================================================

A new received field requires one row here. For the virtual RC8, it also requires one entry in ``SOURCES`` of
``virtual/rc8/robot/slave_feedback.py``. Its value is then in ``Sample.more`` under its name, unless ``Sample`` has an
attribute of that name. A new sent field also requires an attribute of ``SetPoint`` and of ``Outputs``, and a parameter
of the client's methods, because these have static types.

A new type of value requires a member of :class:`FieldType`, and an entry in the table of each module that handles
values: ``rc8/slave_values.py``, ``rc8/slave_feedback.py``, ``streaming/process/record_layout.py``,
``streaming/recording/recorder.py``.
"""

from __future__ import annotations

from enum import Enum, IntFlag
from itertools import combinations
from typing import Final, Literal, TypeAlias

from orinkit.core.i18n import N_
from orinkit.core.record import record

PoseKind: TypeAlias = Literal["P", "J", "T"]
"""The pose type of a set-point: P (position), J (joints), T (homogeneous transformation)."""


class FieldType(Enum):
    """The type of a field's value."""

    POSE = "pose"
    """The numbers of a pose. In slvMove's parameter or result, they are elements of a VT_R8 array."""
    REALS = "reals"
    """Up to :attr:`SlaveField.count` numbers, a VT_R8 array. Received only."""
    REAL = "real"
    """One number, VT_R8. Received only."""
    STAMP = "stamp"
    """The controller's time, a VT_I4 that wraps around; programs receive it in seconds. Received only."""
    BITS = "bits"
    """32 I/O states, VT_I4."""
    BYTES = "bytes"
    """I/O states, a VT_UI1 array.

    In slvMove's parameter, two VT_I4 precede the array: the number of the first I/O point and the number of bytes.
    """
    WINDOW = "window"
    """The user I/O requested for the result, two VT_I4: number of the first I/O point, number of bytes. Sent only."""


class ReceiveBits(IntFlag):
    """The flags of slvRecvFormat, which select fields of the result.

    The bits of POSE_MASK are not flags; together they are a number that selects the poses.
    """

    TIME = 0x10
    HAND = 0x20
    CURRENT = 0x40
    MINI = 0x100
    USER = 0x200


class SendBits(IntFlag):
    """The bits of slvSendFormat, which select the fields of slvMove's parameter that follow the pose."""

    HAND = 0x20
    MINI = 0x100
    USER = 0x200


@record(kw_only=True)
class SlaveField:
    """One row of the table.

    Attributes:
        name: Name for programs.
        label: Name in messages.
        text: Description for users; empty if no file contains the field.
        form: Type of the value.
        place: Position in slvMove's parameter and result; fields with the same position are in the order of the rows.
        count: Maximum number of values; 1 if the field is not an array of numbers.
        kind: Pose type; ``None`` if the field is not a pose.
        mode: Number of the pose type in slvChangeMode (low byte); 0 if the field is not a pose.
        receive: Bit in slvRecvFormat. If it is set, the result contains the field; a field of type WINDOW is in the
            parameter instead.
        send: Bit in slvSendFormat; 0 if the field has none.
        by_word: True if the client parameter ``recv`` accepts the name.
        column: Name of the field's columns in a CSV file; if it is ``""``, ``name`` is used.
        answer_label: Name in messages about a result; if it is ``""``, ``label`` is used.
        offset_label, size_label: Names of the offset and the size of user I/O in messages.
    """

    name: str
    label: str
    form: FieldType
    place: int
    text: str = ""
    count: int = 1
    kind: PoseKind | None = None
    mode: int = 0
    receive: int = 0
    send: int = 0
    by_word: bool = True
    column: str = ""
    answer_label: str = ""
    offset_label: str = ""
    size_label: str = ""


FIELDS: Final[tuple[SlaveField, ...]] = (
    SlaveField(name="time", label=N_("timestamp"), form=FieldType.STAMP, place=0, receive=ReceiveBits.TIME, column="controller_s",
          text=N_("the controller's time, s")),
    SlaveField(name="joints", label=N_("pose of type J"), form=FieldType.POSE, place=1, count=8, kind="J", mode=2,
          text=N_("joint position of the arm, deg (mm for linear joints)")),
    SlaveField(name="position", label=N_("pose of type P"), form=FieldType.POSE, place=1, count=7, kind="P", mode=1,
          text=N_("position of the tool: X, Y, Z in mm, RX, RY, RZ in deg, Fig")),
    SlaveField(name="trans", label=N_("pose of type T"), form=FieldType.POSE, place=1, count=10, kind="T", mode=3,
          text=N_("transformation of the tool: X, Y, Z in mm, orient and approach vector, Fig")),
    SlaveField(name="mini", label=N_("mini I/O"), form=FieldType.BITS, place=2, receive=ReceiveBits.MINI, send=SendBits.MINI,
          text=N_("states of the mini I/O")),
    SlaveField(name="hand", label=N_("hand I/O"), form=FieldType.BITS, place=5, receive=ReceiveBits.HAND, send=SendBits.HAND,
          text=N_("states of the hand I/O")),
    SlaveField(name="user", label=N_("user I/O to send"), form=FieldType.BYTES, place=3, receive=ReceiveBits.USER, send=SendBits.USER,
          by_word=False, answer_label=N_("user I/O"), offset_label=N_("offset of user I/O to send"),
          size_label=N_("size of user I/O to send"), text=N_("states of the user I/O, hexadecimal bytes")),
    SlaveField(name="window", label=N_("user I/O to receive"), form=FieldType.WINDOW, place=4, receive=ReceiveBits.USER, by_word=False,
          offset_label=N_("offset of user I/O to receive"), size_label=N_("size of user I/O to receive")),
    SlaveField(name="current", label=N_("motor currents"), form=FieldType.REALS, place=6, count=8, receive=ReceiveBits.CURRENT,
          text=N_("motor currents, A")),
)  # fmt: skip
"""The rows of the table."""

EXCLUSIVE: Final = (("mini", "user"),)
"""Pairs of fields that cannot be sent in the same slvMove (table 4-1)."""

MOST_USER_BYTES: Final = 64
"""Largest number of bytes of user I/O in one slvMove and in its result (RC8 4.2, note 3: many bytes delay slvMove)."""

# --- the number in slvRecvFormat that selects the poses (table 4-1) ---------------------------------------------------

POSE_MASK: Final = 0x0F
"""The bits of a receive format that select the pose."""
POSE_PARTS: Final[dict[int, tuple[PoseKind, ...]]] = {
    0: ("J",), 1: ("P",), 2: ("J",), 3: ("T",), 4: ("P", "J"), 5: ("T", "J"),
}  # fmt: skip
"""The pose types for each number in the bits of POSE_MASK; before any slvRecvFormat, the number is 0 (RC8 4.6.3)."""

# --- derived from the rows --------------------------------------------------------------------------------------------

ON_WIRE: Final = tuple(sorted(FIELDS, key=lambda field: field.place))
"""The rows in the order of slvMove."""
POSES: Final[dict[PoseKind, SlaveField]] = {field.kind: field for field in FIELDS if field.kind}
"""The rows of poses by pose type."""
POSE_SIZES: Final[dict[PoseKind, int]] = {kind: field.count for kind, field in POSES.items()}
"""The number of values of a complete pose, by pose type."""
PARAMETERS: Final = tuple(field for field in ON_WIRE if field.send or field.form is FieldType.WINDOW)
"""The fields that may follow the pose in slvMove's parameter, in its order (table 4-2)."""
OUTPUTS: Final = tuple(field for field in FIELDS if field.send)
"""The fields with I/O states that the client sends."""
RECEIVED: Final = tuple(field for field in FIELDS if field.form is not FieldType.WINDOW)
"""The fields that a result may contain, including the poses."""
WORDS: Final = tuple(field for field in RECEIVED if field.by_word)
"""The fields accepted by the client parameter ``recv``."""
RECEIVE_BITS: Final[tuple[int, ...]] = tuple(sorted({int(field.receive) for field in FIELDS if field.receive}))
"""All bits of slvRecvFormat except those of POSE_MASK."""


def _send_formats() -> tuple[int, ...]:
    bits = {field.name: int(field.send) for field in OUTPUTS}
    sets = [each for size in range(len(bits) + 1) for each in combinations(bits, size)]
    allowed = [each for each in sets if not any(set(pair) <= set(each) for pair in EXCLUSIVE)]
    return tuple(sorted(sum(bits[name] for name in each) for each in allowed))


SEND_FORMATS: Final = _send_formats()
"""The valid numbers of slvSendFormat."""
