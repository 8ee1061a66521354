"""Decoder for all frames on a bus of ABH3 drivers, for programs that only listen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from orinkit.abh3.table import ids
from orinkit.abh3.table.bits import Values
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.ids import FrameId
from orinkit.abh3.table.records import BUF, Flags, Record
from orinkit.abh3.table.signals import CURRENT, Dialect, FrameLayout, Quantity, SignalField, dialect_of
from orinkit.abh3.table.transfer_fields import KINDS, PARTS, PGN_AT, REASONS
from orinkit.can.frame import MAX_ID, CanFrame
from orinkit.core.i18n import N_, tr, translate

DP0S: Final = "DP0S"
DP0R: Final = "DP0R"
DP1S: Final = "DP1S"
DP1R: Final = "DP1R"
REQUEST: Final = "REQUEST"
CONTROL: Final = "TP.CM"
TRANSFER: Final = "TP.DT"
UNKNOWN: Final = ""

_FULL: Final = 8
_REQUEST: Final = 3
_REQUESTED: Final = N_("requested")

Content: TypeAlias = int | float | str | Flags
"""The types of a value in a frame."""


@dataclass(frozen=True, slots=True)
class DecodedValue:
    """One value of a frame.

    Attributes:
        name: Name for programs.
        title: Name for people, in English.
        content: A number in physical units, a flag word, or a text.
        unit: Unit of the content; ``""`` if it has none.
        digits: Decimal places of the content; ``None`` for a single-precision float.
        note: Meaning of the content, in English; ``None`` if it needs no explanation.
    """

    name: str
    title: str
    content: Content
    unit: str = ""
    digits: int | None = 0
    note: str | None = None

    @property
    def shown(self) -> str:
        """The content with its unit, or the texts of its flags, in the current language."""
        content = self.content
        if isinstance(content, Flags):
            texts = ", ".join(_flag_texts(content))
            return f"0x{content.value:08X}" + (f" ({texts})" if texts else "")
        if isinstance(content, str):
            return content
        number = f"{content:.7g}" if self.digits is None else f"{content:.{self.digits}f}"
        shown = f"{number} {self.unit}" if self.unit else number
        return f"{shown} ({tr(self.note)})" if self.note else shown

    def __str__(self) -> str:
        return f"{tr(self.title)} = {self.shown}"


class FrameFault(NamedTuple):
    """The reason why a frame is wrong or cannot be decoded.

    Attributes:
        message: The text in English, with placeholders.
        message_args: Values of the placeholders.
    """

    message: str
    message_args: Values

    @property
    def text(self) -> str:
        """The text, in the current language."""
        return tr(self.message, **dict(self.message_args))

    @property
    def english(self) -> str:
        """The text, in English."""
        return translate("en", self.message, **dict(self.message_args))


@dataclass(frozen=True, slots=True)
class DecodedFrame:
    """A decoded frame.

    Attributes:
        frame: The frame as received.
        name: ``"DP0S"``, ``"DP0R"``, ``"DP1S"``, ``"DP1R"``, ``"BR0"`` to ``"BR7"``, ``"REQUEST"``, ``"TP.CM"``,
            ``"TP.DT"``; ``""`` for any other frame.
        source: Address of the sender.
        destination: Address of the receiver; ``None`` if the frame is for all nodes.
        record: The content in physical units; ``None`` if there is no record for this frame, or the frame is not valid.
        values: The content as separate values.
        fault: The reason why the frame is wrong or cannot be decoded; ``None`` if the frame is valid.
    """

    frame: CanFrame
    name: str
    source: int
    destination: int | None
    record: Record | None = None
    values: tuple[DecodedValue, ...] = ()
    fault: FrameFault | None = None

    @property
    def heading(self) -> str:
        """Name, source and destination: ``"DP0R 1 -> 2"``."""
        name = self.name or tr("unknown")
        if self.destination is None:
            return tr("{name} {source} -> all", name=name, source=self.source)
        return f"{name} {self.source} -> {self.destination}"

    @property
    def content(self) -> str:
        """The content without the heading, in the current language."""
        parts = [*([self.fault.text] if self.fault else []), *map(str, self.values)]
        return ", ".join(parts)

    @property
    def text(self) -> str:
        """The frame as one line of text, in the current language."""
        return f"{self.heading}: {self.content}" if self.values or self.fault else self.heading


class Decoder:
    """Decodes frames, and detects from them which nodes are hosts: hosts send requests, and drivers send broadcasts.

    Args:
        dialect: Dialect of the drivers, ``"v1"`` or ``"v2"``.
        hosts: Addresses that count as hosts until frames show the contrary. Frames may also show that other nodes are
            hosts.
        group: Group of the drivers' broadcasts. Broadcasts of other groups are returned, but not decoded. ``None`` to
            decode the broadcasts of all groups.
        load_unit: Resolution of the loads in frames, in %: 1 or 0.1.

    Raises:
        InvalidValue: If the dialect, an address, the group or the unit is not valid.
    """

    def __init__(
        self,
        dialect: str | Dialect = "v1",
        *,
        hosts: Iterable[int] = (2,),
        group: int | None = None,
        load_unit: float = 1.0,
    ) -> None:
        self.dialect = dialect_of(dialect).with_load_unit(load_unit)
        self.group = None if group is None else ids.check_group(group)
        self._codec = Codec(self.dialect)
        self._is_host = {ids.check_address("host", host): True for host in hosts}

    def decode(self, frame: CanFrame) -> DecodedFrame:
        """Decode any frame; its priority is ignored. If it cannot be decoded, the result contains a fault."""
        parts = FrameId.parse(frame.id)
        page = None if parts.reserved or not 0 <= frame.id <= MAX_ID else parts.dp
        match parts.pf, page:
            case ids.SINGLE, 0 | 1:
                return self._single(frame, parts)
            case ids.REQUEST, 0:
                return self._request(frame, parts)
            case ids.BROADCAST, 0:
                return self._broadcast(frame, parts)
            case ids.CONTROL, 0:
                return _control(frame, parts)
            case ids.TRANSFER, 0:
                return _transfer(frame, parts)
        bytes_ = f"{frame.id:08X}#{frame.data.hex().upper()}"
        fault = FrameFault(N_("not a frame of an ABH3: {frame}"), (("frame", bytes_),))
        return DecodedFrame(frame, UNKNOWN, parts.sa, _destination(parts), fault=fault)

    # --- single packets (sections 2.1 and 2.2) ------------------------------------------------------------------------

    def _single(self, frame: CanFrame, parts: FrameId) -> DecodedFrame:
        from_host = self._from_host(parts)
        if from_host is None:
            data = frame.data.hex(" ").upper() or "-"
            fault = FrameFault(N_("single packet of which the host cannot be determined: {data}"), (("data", data),))
            return DecodedFrame(frame, UNKNOWN, parts.sa, _destination(parts), fault=fault)
        if parts.dp and from_host:
            values = (DecodedValue("wanted", _REQUESTED, DP1R),)
            return DecodedFrame(
                frame, DP1S, parts.sa, _destination(parts), values=values, fault=_length_fault(frame, 0)
            )
        return self._data(frame, parts, (DP0S if from_host else DP0R) if not parts.dp else DP1R)

    def _from_host(self, parts: FrameId) -> bool | None:
        """Return True if a single packet is from a host; ``None`` if this is unknown or contradictory."""
        source, destination = self._is_host.get(parts.sa), self._is_host.get(parts.ps)
        if source is None:
            return None if destination is None else not destination
        return None if destination == source else source

    def _data(self, frame: CanFrame, parts: FrameId, name: str) -> DecodedFrame:
        """Decode a frame according to its layout in the table."""
        destination = _destination(parts)
        if len(frame.data) != _FULL:
            return DecodedFrame(frame, name, parts.sa, destination, fault=_length_fault(frame, _FULL))
        layout = self.dialect.layouts[name]
        record = self._codec.decode(name, frame.data)
        values = tuple(self._values(layout, record))
        return DecodedFrame(frame, name, parts.sa, destination, record, values)

    def _values(self, layout: FrameLayout, record: Record) -> Iterator[DecodedValue]:
        for field in layout.fields:
            content = getattr(record, field.name)
            if field.quantity is None:
                yield DecodedValue(field.name, field.title, content)
            else:
                quantity = self._quantity(field, field.quantity, record)
                digits = quantity.digits if quantity.steps else None
                yield DecodedValue(field.name, field.title, content, quantity.unit, digits)

    def _quantity(self, field: SignalField, quantity: Quantity, record: Record) -> Quantity:
        """Return the quantity of a field; for a command, a current if the inputs in the frame select torque mode."""
        is_current = (
            field.torque_input
            and int(record.raw_values.get("inputs", 0)) & self.dialect.inputs.masks[field.torque_input]
        )
        return CURRENT if is_current else quantity

    # --- broadcasts (sections 2.3 to 2.9) and requests ----------------------------------------------------------------

    def _broadcast(self, frame: CanFrame, parts: FrameId) -> DecodedFrame:
        group, number = divmod(parts.ps, ids.BROADCASTS)
        name = f"BR{number}"
        data = frame.data.hex(" ").upper() or "-"
        if self.group not in (None, group):
            fault = FrameFault(
                N_("{name} of another broadcast group, {group}: {data}"),
                (("name", name), ("group", group), ("data", data)),
            )
            return DecodedFrame(frame, UNKNOWN, parts.sa, None, fault=fault)
        self._learn(parts.sa, is_host=False)
        if number not in self.dialect.broadcasts:
            value = DecodedValue("data", N_("data"), data)
            return DecodedFrame(frame, name, parts.sa, None, BUF(data=bytes(frame.data)), (value,))
        return self._data(frame, parts, name)

    def _request(self, frame: CanFrame, parts: FrameId) -> DecodedFrame:
        fault = _length_fault(frame, _REQUEST)
        destination = _destination(parts)
        if len(frame.data) < _REQUEST:
            return DecodedFrame(frame, REQUEST, parts.sa, destination, fault=fault)
        ps, pf, page = frame.data[:_REQUEST]
        wanted, group = f"0x{page:02X}{pf:02X}{ps:02X}", None
        if (pf, page) == (ids.BROADCAST, 0):
            group, number = divmod(ps, ids.BROADCASTS)
            wanted = f"BR{number}"
        elif pf == ids.SINGLE and page in (0, 1):
            wanted = (DP0R, DP1R)[page]
        if group is not None or wanted in (DP0R, DP1R):
            self._learn(parts.sa, is_host=True)
            if destination is not None:
                self._learn(destination, is_host=False)
        values = [DecodedValue("wanted", _REQUESTED, wanted)]
        if group is not None:
            values.append(DecodedValue("group", N_("group"), group))
        return DecodedFrame(frame, REQUEST, parts.sa, destination, values=tuple(values), fault=fault)

    def _learn(self, address: int, *, is_host: bool) -> None:
        self._is_host[address] = is_host


# --- multi-packet messages --------------------------------------------------------------------------------------------


def _control(frame: CanFrame, parts: FrameId) -> DecodedFrame:
    data, destination = frame.data, _destination(parts)
    if len(data) != _FULL:
        return DecodedFrame(frame, CONTROL, parts.sa, destination, fault=_length_fault(frame, _FULL))
    kind = data[0]
    values = [DecodedValue("kind", N_("control"), KINDS.get(kind, f"0x{kind:02X}"))]
    for part in PARTS:
        if kind in part.kinds:
            number = int.from_bytes(data[part.start : part.start + part.size], "little")
            note = REASONS.get(number) if part.name == "reason" else None
            values.append(DecodedValue(part.name, part.title, number, part.unit, note=note))
    pgn = int.from_bytes(data[PGN_AT:], "little")
    values.append(DecodedValue("pgn", "PGN", f"0x{pgn:06X}"))
    return DecodedFrame(frame, CONTROL, parts.sa, destination, values=tuple(values))


def _transfer(frame: CanFrame, parts: FrameId) -> DecodedFrame:
    destination = _destination(parts)
    if len(frame.data) != _FULL:
        return DecodedFrame(frame, TRANSFER, parts.sa, destination, fault=_length_fault(frame, _FULL))
    values = (
        DecodedValue("number", N_("packet"), frame.data[0]),
        DecodedValue("data", N_("data"), frame.data[1:].hex(" ").upper()),
    )
    return DecodedFrame(frame, TRANSFER, parts.sa, destination, values=values)


# --- helpers ----------------------------------------------------------------------------------------------------------


def _destination(parts: FrameId) -> int | None:
    return None if parts.pf >= _FIRST_FOR_ALL or parts.ps == ids.EVERYONE else parts.ps


_FIRST_FOR_ALL: Final = 0xF0  # lowest PF whose PS is not an address


def _length_fault(frame: CanFrame, length: int) -> FrameFault | None:
    """Return the fault of a frame with a wrong length, ``None`` if the length is right."""
    if len(frame.data) == length:
        return None
    data = frame.data.hex(" ").upper() or "-"
    values = (("count", len(frame.data)), ("length", length), ("data", data))
    return FrameFault(N_("{count} bytes instead of {length}: {data}"), values)


def _flag_texts(flags: Flags) -> Iterator[str]:
    for number in range(32):
        if flags.value >> number & 1:
            bit = flags.word.by_number.get(number)
            yield bit.text if bit else tr("bit {number}", number=number)
