"""plot: pictures of recorded motions, and errors for invalid files."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest

from orinkit.cli._shared import motion_plot
from orinkit.cli._shared.motion_record import PERIOD, command_and_encoder, read_csv, recording_of, write_csv
from orinkit.core import i18n

SIGNATURES = {"png": b"\x89PNG\r\n\x1a\n", "svg": b"<?xml", "pdf": b"%PDF-"}
HEADER = "time_s,J1_command,J2_command\n"


def record(command: float, encoder: float) -> list[float]:
    """Return a record of the control log in which joints 7 and 8 are unused."""
    values = [0.0] * 32
    values[: 6 * 4] = [command, encoder, 0.1, 5.0] * 6
    return [*values, 0, 0, 0, 0, 17, 0, 0]


@pytest.fixture
def motion(tmp_path) -> Path:
    path = tmp_path / "motion.csv"
    angles = [45 * (1 - math.cos(place / 20 * math.pi)) for place in range(21)]
    write_csv(path, recording_of([command_and_encoder(record(angle, angle - 0.1)) for angle in angles]))
    return path


@pytest.mark.parametrize("kind", SIGNATURES)
def test_a_picture(run, motion, tmp_path, kind):
    target = tmp_path / f"picture.{kind}"
    done = run("plot", str(motion), "--out", str(target))
    assert (done.code, done.out, done.err) == (0, f"{target}\n", "")
    assert target.read_bytes().startswith(SIGNATURES[kind])


def test_the_picture_is_written_beside_the_file(run, motion):
    assert run("plot", str(motion)).out == f"{motion.with_suffix('.png')}\n"
    assert motion.with_suffix(".png").stat().st_size > 10_000


def test_contents_of_the_picture(run, motion, tmp_path):
    target = tmp_path / "picture.svg"
    run("plot", str(motion), "--out", str(target))
    text = target.read_text()
    for words in (
        "joints [deg]",
        "velocity [deg/s]",
        "acceleration [deg/s²]",
        "time [s]",
        "J1",
        "J6",
        "dotted: encoders",
        "recorded motion, 0.16 s",
    ):
        assert f"<!-- {words} -->" in text
    assert "<!-- J7 -->" not in text


def test_identical_curves_stay_visible(motion):
    from matplotlib.figure import Figure

    figure = Figure()
    motion_plot.draw(read_csv(motion), figure)
    lines = figure.axes[0].get_lines()[:6]
    assert len({str(line._dash_pattern) for line in lines}) == 6


def test_an_arm_that_did_not_move(run, tmp_path):
    path, target = tmp_path / "x.csv", tmp_path / "x.svg"
    path.write_text(f"{HEADER}0,1,2\n0.008,1,2\n0.016,1,2\n")
    assert run("plot", str(path), "--out", str(target)).code == 0
    assert "<!-- the arm did not move -->" in target.read_text()


def test_without_encoders_and_with_two_samples(run, tmp_path):
    path = tmp_path / "x.csv"
    path.write_text(f"{HEADER}0,1,2\n0.5,2,3\n\n")
    target = tmp_path / "x.svg"
    assert run("plot", str(path), "--out", str(target)).code == 0
    assert "velocity" in target.read_text()
    assert "acceleration" not in target.read_text()


def test_a_written_file_can_be_read(motion):
    read = read_csv(motion)
    assert list(read.joints) == [1, 2, 3, 4, 5, 6]
    assert read.times[:3] == pytest.approx([0, PERIOD, 2 * PERIOD])
    assert read.command[-1] == pytest.approx([90.0] * 6)
    assert read.encoder[-1] == pytest.approx([89.9] * 6)


def test_extended_joints_are_included_if_they_are_used():
    moved = record(1, 1)
    moved[7 * 4] = 5.0
    assert recording_of([command_and_encoder(record(0, 0)), command_and_encoder(moved)]).joints == [1, 2, 3, 4, 5, 6, 8]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "line 1: the columns time_s, J1_command"),
        (b"a,b\n1,2\n", "line 1: the columns time_s, J1_command"),
        (b"time_s\n1\n", "line 1"),
        (b"J1_command\n1\n", "line 1"),
        (b"time_s,J1_command,J1_command\n1,2,3\n", "line 1"),
        (b"time_s,J1_command,J9_command,J2_encoder\n1,2,3,4\n", "have different joints"),
        (f"{HEADER}0,1,2\n".encode(), "the arm did not move"),
        (HEADER.encode(), "the arm did not move"),
        (f"{HEADER}0,1,2\n0,2,3\n".encode(), "must be increasing"),
        (f"{HEADER}0,1,2\n1,2\n".encode(), "line 3: got 2 values, expected 3"),
        (f"{HEADER}0,1,2\n1,2,x\n".encode(), "line 3: column"),
        (f"{HEADER}0,1,2\n1,2,nan\n".encode(), "line 3: column"),
        (f"{HEADER}0,1,2\n1,2,1e999\n".encode(), "line 3: column"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "not a CSV file"),
        (b'time_s,"J1', "not a CSV file"),
        (b"time_s," + b"x" * 200_000, "not a CSV file"),
    ],
)
def test_an_invalid_file(refused, tmp_path, content, words):
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    line = refused("plot", str(path), code=2)
    assert words in line
    assert str(path) in line
    assert not path.with_suffix(".png").exists()
    i18n.use("ja")
    assert refused("plot", str(path), code=2) != line


def test_files_that_cannot_be_used(refused, motion, tmp_path):
    assert "cannot read" in refused("plot", str(tmp_path / "none.csv"), code=2)
    assert "cannot read" in refused("plot", str(tmp_path), "--out", "x.png", code=2)
    assert ".png, .svg, .pdf" in refused("plot", str(motion), "--out", str(tmp_path / "x.gif"), code=2)
    assert ".png, .svg, .pdf" in refused("plot", str(motion), "--out", "", code=2)
    assert "cannot write" in refused("plot", str(motion), "--out", str(tmp_path / "none" / "x.png"))


def test_without_matplotlib(refused, motion, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "pip install 'orinkit[plot]'" in refused("plot", str(motion))
    i18n.use("ja")
    assert "pip install 'orinkit[plot]'" in refused("plot", str(motion))


def test_without_a_screen(refused, motion, monkeypatch):
    import matplotlib as mpl

    monkeypatch.setitem(mpl.rcParams, "backend", "agg")
    assert "no screen" in refused("plot", str(motion), "--show")


def test_a_window(run, motion, monkeypatch):
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    shown = []
    monkeypatch.setattr(mpl, "get_backend", lambda: "qtagg")
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf()))
    done = run("plot", str(motion), "--show")
    assert (done.code, done.out) == (0, "")
    assert len(shown[0].axes) == 3
    assert not motion.with_suffix(".png").exists()
    plt.close("all")


def test_labels_are_in_english_without_a_japanese_font(run, motion, tmp_path, monkeypatch):
    """The labels are English instead of boxes."""
    from matplotlib.font_manager import fontManager

    i18n.use("ja")
    target = tmp_path / "x.svg"
    monkeypatch.setattr(fontManager, "ttflist", [font for font in fontManager.ttflist if font.name == "DejaVu Sans"])
    assert run("plot", str(motion), "--out", str(target)).code == 0
    assert "<!-- time [s] -->" in target.read_text()


@pytest.mark.parametrize("answer", [None, [], [1.0] * 31, ["x"] * 39, "text"])
def test_invalid_records(answer):
    with pytest.raises(Exception, match="unexpected reply to GetLogRecord"):
        command_and_encoder(answer)
