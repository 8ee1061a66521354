"""The decoder, on frames of hosts and drivers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.abh3.table import ids
from orinkit.abh3.table.decoder import DecodedFrame, Decoder
from orinkit.abh3.table.frames import Codec
from orinkit.abh3.table.records import BR0, BR1, BR1V2, BUF, DP0R, DP0RV2, DP0S
from orinkit.abh3.table.signals import DIALECTS
from orinkit.can.frame import CanFrame
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core

COMMAND, FEEDBACK = 0x00EF0102, 0x00EF0201


def frame(number: int, data: str = "") -> CanFrame:
    return CanFrame(number, bytes.fromhex(data))


def decoded(number: int, data: str = "", **options: object) -> DecodedFrame:
    return Decoder(**options).decode(frame(number, data))


# Frames of a real bus: the driver's replies to a command, min^-1.
GOLDEN = [
    ("b6ff0000dbffdbff", (-14.8, 0.0, -7.4, -7.4)),
    ("c2ffadffb8ff0b00", (-12.4, -16.6, -14.4, 2.2)),
    ("000034001a00e6ff", (0.0, 10.4, 5.2, -5.2)),
    ("e7ff1400feffe9ff", (-5.0, 4.0, -0.4, -4.6)),
    ("f4ffe1ffeaff0900", (-2.4, -6.2, -4.4, 1.8)),
    ("0c0039002300eaff", (2.4, 11.4, 7.0, -4.4)),
]


@pytest.mark.parametrize(("data", "velocities"), GOLDEN)
def test_feedback_of_a_real_driver(data, velocities):
    found = decoded(FEEDBACK, data)
    assert (found.name, found.source, found.destination, found.fault) == ("DP0R", 1, 2, None)
    record = found.record
    assert isinstance(record, DP0R)
    assert (record.a_velocity, record.b_velocity, record.y_velocity, record.x_velocity) == velocities
    assert [value.content for value in found.values] == list(velocities)


def test_command_of_a_real_host():
    found = decoded(COMMAND, "0000000003300000")
    assert isinstance(found.record, DP0S)
    assert (found.name, found.source, found.destination) == ("DP0S", 2, 1)
    assert "servo_on" in found.record.inputs
    assert "start" in found.record.inputs
    assert found.text == (
        "DP0S 2 -> 1: A/Y command = 0.0 min^-1, B/X command = 0.0 min^-1, "
        "inputs = 0x00003003 (A/Y servo on, A/Y start, B/X servo on, B/X start)"
    )


def test_flags_of_real_drivers():
    found = decoded(0x00FF2801, "0000400000004000")
    assert isinstance(found.record, BR0)
    assert (found.source, found.destination) == (1, None)
    assert list(found.record.errors) == list(found.record.warnings) == ["can_communication"]
    states = decoded(0x00FF2901, "70000708c3000000").record
    assert isinstance(states, BR1)
    assert (int(states.control), int(states.io)) == (0x08070070, 0x000000C3)
    assert "travel_model" in states.control


def test_japanese():
    i18n.use("ja")
    assert decoded(FEEDBACK, GOLDEN[0][0]).text == (
        "DP0R 1 -> 2: A 速度帰還 = -14.8 min^-1, B 速度帰還 = 0.0 min^-1, Y 速度帰還 = -7.4 min^-1, X 速度帰還 = -7.4 min^-1"
    )
    assert decoded(0x00EAFF02, "28ff00").text == "REQUEST 2 -> 全体: 要求対象 = BR0, グループ = 5"
    assert "2 バイト" in decoded(COMMAND, "0000").text


def test_the_dialect_of_2023():
    assert isinstance(decoded(FEEDBACK, "0000000001000080", dialect="v2").record, DP0RV2)
    found = decoded(FEEDBACK, "0500fbff01000080", dialect="v2")
    assert found.text == (
        "DP0R 1 -> 2: A/Y velocity feedback = 1.0 min^-1, B/X velocity feedback = -1.0 min^-1, "
        "control flags = 0x80000001 (A/Y servo on, an error is present)"
    )
    assert isinstance(decoded(0x00FF2901, "0000000000000000", dialect="v2").record, BR1V2)


def test_torque_makes_a_command_a_current():
    assert "A/Y command = 10.00 %, B/X command = 200.0 min^-1" in decoded(COMMAND, "e803e80300000001").text
    assert "A/Y command = 200.0 min^-1, B/X command = 10.00 %" in decoded(COMMAND, "e803e80300000002").text
    assert "A/Y command = 10.00 %" in decoded(COMMAND, "e803e80300000100", dialect="v2").text


def test_load_units():
    assert "A axis load = 6 %" in decoded(0x00FF2B01, "0000000006000200").text
    assert "A axis load = 0.6 %" in decoded(0x00FF2B01, "0000000006000200", load_unit=0.1).text


@pytest.mark.parametrize("priority", range(8))
def test_priority_does_not_matter(priority):
    data = GOLDEN[0][0]
    assert decoded(FEEDBACK | priority << 26, data).text == decoded(FEEDBACK, data).text
    assert decoded(0x00FF2801 | priority << 26, "00" * 8).name == "BR0"


# --- requests, multi-packet messages ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "data", "text"),
    [
        (0x00EA0102, "28ff00", "REQUEST 2 -> 1: requested = BR0, group = 5"),
        (0x00EAFF02, "87ff00", "REQUEST 2 -> all: requested = BR7, group = 16"),
        (0x00EA0102, "00ef00", "REQUEST 2 -> 1: requested = DP0R"),
        (0x00EA0102, "00ef01", "REQUEST 2 -> 1: requested = DP1R"),
        (0x00EA0102, "eafe00", "REQUEST 2 -> 1: requested = 0x00FEEA"),
        (0x00EA0102, "28ff00ff", "REQUEST 2 -> 1: 4 bytes instead of 3: 28 FF 00 FF, requested = BR0, group = 5"),
        (0x00EA0102, "28", "REQUEST 2 -> 1: 1 bytes instead of 3: 28"),
        (0x01EF0102, "", "DP1S 2 -> 1: requested = DP1R"),
        (0x01EF0201, "01000000ffffffff", "DP1R 1 -> 2: A axis pulse count = 1 pulse, B axis pulse count = -1 pulse"),
        (0x00FF2F01, "0102", "BR7 1 -> all: data = 01 02"),
        (
            0x00EC0102,
            "1012000303 00ef00",
            "TP.CM 2 -> 1: control = RTS, message = 18 byte, packets = 3, maximum packets per CTS = 3, PGN = 0x00EF00",
        ),
        (
            0x00EC0201,
            "110301ffff 00ef00",
            "TP.CM 1 -> 2: control = CTS, packets that may be sent = 3, next packet = 1, PGN = 0x00EF00",
        ),
        (
            0x00EC0102,
            "ff03ffffff 00ef00",
            "TP.CM 2 -> 1: control = Abort, reason = 3 (time-out), PGN = 0x00EF00",
        ),
        (0x00EC0102, "77ffffffff 00ef00", "TP.CM 2 -> 1: control = 0x77, PGN = 0x00EF00"),
        (0x00EC0102, "10", "TP.CM 2 -> 1: 1 bytes instead of 8: 10"),
        (0x00EB0102, "0343503030303039 35"[:16], "TP.DT 2 -> 1: packet = 3, data = 43 50 30 30 30 30 39"),
        (0x00EB0102, "", "TP.DT 2 -> 1: 0 bytes instead of 8: -"),
        (FEEDBACK, "b6ff", "DP0R 1 -> 2: 2 bytes instead of 8: B6 FF"),
        (0x18FEF103, "01", "unknown 3 -> all: not a frame of an ABH3: 18FEF103#01"),
        (0x02EF0102, "", "unknown 2 -> 1: not a frame of an ABH3: 02EF0102#"),
        (0x01FF2801, "", "unknown 1 -> all: not a frame of an ABH3: 01FF2801#"),
    ],
)
def test_other_frames(number, data, text):
    assert decoded(number, data).text == text


def test_a_broadcast_without_a_layout_has_its_bytes():
    assert decoded(0x00FF2F01, "0102").record == BUF(data=b"\x01\x02")


def test_a_group():
    assert decoded(0x00FF0001, "00" * 8).name == "BR0"  # any
    assert decoded(0x00FF0001, "00" * 8, group=0).name == "BR0"
    other = decoded(0x00FF0001, "00" * 8, group=5)
    assert (other.name, other.record) == ("", None)
    assert other.text == "unknown 1 -> all: BR0 of another broadcast group, 0: 00 00 00 00 00 00 00 00"
    assert other.fault is not None
    i18n.use("ja")
    assert other.text == "不明 1 -> 全体: 別のブロードキャストグループ 0 の BR0: 00 00 00 00 00 00 00 00"
    assert other.fault.english == "BR0 of another broadcast group, 0: 00 00 00 00 00 00 00 00"


# --- hosts and drivers ------------------------------------------------------------------------------------------------


def test_neither_address_is_known():
    found = decoded(0x00EF0304, "0000000000000000")
    assert (found.name, found.record) == ("", None)
    assert "single packet of which the host cannot be determined" in found.text


def test_known_hosts():
    decoder = Decoder(hosts=(4, 9))
    assert decoder.decode(frame(0x00EF0304, "00" * 8)).name == "DP0S"
    assert decoder.decode(frame(0x00EF0403, "00" * 8)).name == "DP0R"
    assert decoder.decode(frame(0x00EF0309, "00" * 8)).name == "DP0S"
    assert decoder.decode(frame(0x00EF0904, "00" * 8)).name == ""  # from host to host


def test_a_request_identifies_the_host():
    decoder = Decoder(hosts=())
    assert decoder.decode(frame(0x00EF0304, "00" * 8)).name == ""
    decoder.decode(frame(0x00EAFF04, "28ff00"))
    assert decoder.decode(frame(0x00EF0304, "00" * 8)).name == "DP0S"
    assert decoder.decode(frame(0x00EF0403, "00" * 8)).name == "DP0R"


def test_a_request_for_another_frame_identifies_no_host():
    decoder = Decoder(hosts=())
    decoder.decode(frame(0x00EAFF04, "eafe00"))
    assert decoder.decode(frame(0x00EF0304, "00" * 8)).name == ""


def test_a_broadcast_identifies_the_driver():
    decoder = Decoder(hosts=())
    decoder.decode(frame(0x00FF2803, "00" * 8))
    assert decoder.decode(frame(0x00EF0304, "00" * 8)).name == "DP0S"
    assert decoder.decode(frame(0x00EF0403, "00" * 8)).name == "DP0R"


def test_traffic_takes_precedence_over_known_hosts():
    """A driver has address 2, the usual address of hosts."""
    decoder = Decoder()
    decoder.decode(frame(0x00FF2802, "00" * 8))
    assert decoder.decode(frame(0x00EF020A, "00" * 8)).name == "DP0S"
    assert decoder.decode(frame(0x00EF0A02, "00" * 8)).name == "DP0R"


# --- anything ---------------------------------------------------------------------------------------------------------

PFS = st.sampled_from([ids.SINGLE, ids.REQUEST, ids.BROADCAST, ids.CONTROL, ids.TRANSFER])
BYTES = st.integers(0, 255)
KNOWN = st.builds(
    lambda pf, ps, sa, dp, p: int(ids.FrameId(pf, ps, sa, dp, p)),
    PFS,
    BYTES,
    BYTES,
    st.integers(0, 1),
    st.integers(0, 7),
)


@given(
    st.lists(st.tuples(KNOWN | st.integers(0, 0x1FFFFFFF) | st.integers(), st.binary(max_size=70)), max_size=20),
    st.sampled_from(["v1", "v2"]),
    st.sampled_from(["en", "ja"]),
)
def test_any_frame_is_decoded(frames, dialect, lang):
    i18n.use(lang)
    decoder = Decoder(dialect)
    for number, data in frames:
        found = decoder.decode(CanFrame(number, data))
        assert found.text
        assert "\n" not in found.text
        assert found.frame == CanFrame(number, data)


@pytest.mark.parametrize("dialect", DIALECTS.values(), ids=list(DIALECTS))
@pytest.mark.parametrize("load_unit", [1.0, 0.1])
@given(data=st.binary(min_size=8, max_size=8))
def test_every_data_frame_is_decoded_as_by_the_codec(dialect, load_unit, data):
    decoder = Decoder(dialect, load_unit=load_unit)
    codec = Codec(dialect.with_load_unit(load_unit))
    for layout in dialect.layouts.values():
        if layout.broadcast is not None:
            number = ids.broadcast(5, layout.broadcast, 1)
        else:
            number = ids.single(1, 2, dp=layout.dp) if layout.from_host else ids.single(2, 1, dp=layout.dp)
        found = decoder.decode(CanFrame(number, data))
        assert found.name == layout.name
        assert repr(found.record) == repr(codec.decode(layout.name, data))  # nan != nan
        assert [value.name for value in found.values] == [field.name for field in layout.fields]


@pytest.mark.parametrize(
    "options", [{"dialect": "v3"}, {"hosts": (254,)}, {"hosts": ("2",)}, {"group": 32}, {"load_unit": 0.5}]
)
def test_invalid_arguments(options):
    with pytest.raises(InvalidValue):
        Decoder(**options)
