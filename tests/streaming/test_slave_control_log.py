"""Control logs of other programs: CSV files whose columns the user chooses."""

from __future__ import annotations

import pytest

from orinkit.core.errors import InvalidValue
from orinkit.streaming.trajectory import control_log
from orinkit.streaming.trajectory.control_log import ControlLog, LogColumns

JAPANESE = "\r\n".join(
    [
        "制御ログ,VS-050",
        "",
        "時間[ms]," + ",".join(f"J{n} 指令値,J{n} 現在値" for n in range(1, 7)),
        *(f"{8 * row}," + ",".join(f"{row + n / 10},99" for n in range(1, 7)) for row in range(4)),
    ]
)


def log_of(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode(encoding))
    return ControlLog(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp932", "utf-16"])
def test_command_values_and_times_are_found_in_a_japanese_log(tmp_path, encoding):
    log = log_of(tmp_path, JAPANESE, encoding)
    columns = log.guess()
    assert columns == LogColumns((1, 3, 5, 7, 9, 11), time=0, time_unit=0.001)
    points, interval = log.points(columns)
    assert interval == pytest.approx(0.008)
    assert points == [tuple(row + n / 10 for n in range(1, 7)) for row in range(4)]


@pytest.mark.parametrize(
    ("header", "joints"),
    [
        ("Time;J1 Cmd;J2 Cmd;J3 Cmd;J4 Cmd;J5 Cmd;J6 Cmd", (1, 2, 3, 4, 5, 6)),
        ("Axis1 act;Axis2 act;Axis3;Axis4;Axis5;Axis6;Axis1", (6, None, 2, 3, 4, 5)),
        ("t;a;b;c;d;e;f", (None,) * 6),
    ],
)
def test_columns_are_proposed_by_their_names(tmp_path, header, joints):
    log = log_of(tmp_path, f"{header}\n1;2;3;4;5;6;7\n")
    assert log.guess().joints == joints


def test_a_log_without_a_header_has_numbered_columns_and_a_fixed_interval(tmp_path):
    log = log_of(tmp_path, "1 ,2,3,4,5,6\n" * 3)
    assert log.names[0] == "column 1"
    assert log.points(LogColumns((5, 4, 3, 2, 1, 0)))[0][0] == (6, 5, 4, 3, 2, 1)
    assert log.points(LogColumns((0, 1, 2, 3, 4, 5), interval=0.016))[1] == 0.016


@pytest.mark.parametrize(
    ("text", "columns", "message"),
    [
        ("1,2,3,4,5,6\n1,2,x,4,5,6\n", LogColumns((0, 1, 2, 3, 4, 5)), "line 2: column 3"),
        ("1,2,3,4,5,6\n1,2\n", LogColumns((0, 1, 2, 3, 4, 5)), "line 2: got 2 values"),
        ("1,2,3,4,5,6\n", LogColumns((0, 1, None, 3, 4, 5)), "J3: choose"),
        ("1,2,3,4,5,6\n", LogColumns((0, 1, 2, 3, 4, 5), interval=0.0), "interval"),
        ("0,2,3,4,5,6\n0,2,3,4,5,6\n", LogColumns((0, 1, 2, 3, 4, 5), time=0), "times increase by 0 s"),
    ],
)
def test_errors_name_the_place(tmp_path, text, columns, message):
    log = log_of(tmp_path, text)
    with pytest.raises(InvalidValue, match=message):
        log.points(columns)


@pytest.mark.parametrize("data", [b"", b"a,b,c\n1,2,3\n", b"\x00\x01" * 50, b"\x81,1,2,3,4,5,6"])
def test_other_files_are_refused(tmp_path, data):
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    with pytest.raises(InvalidValue, match=r"log\.csv"):
        ControlLog(path)


def test_a_large_file_is_refused_without_reading_it(tmp_path, monkeypatch):
    monkeypatch.setattr(control_log, "LARGEST_FILE", 10)
    with pytest.raises(InvalidValue, match="larger than"):
        log_of(tmp_path, JAPANESE)
