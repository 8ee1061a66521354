from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

import pytest

from orinkit.arms import MODEL_NAMES, ArmModel, AxisModel, load_model, parse_model
from orinkit.arms.kinematics import Kinematics
from orinkit.core import i18n

GOOD = """
name = "Arm"
type_name = "ARM-1"
origins = [[0, 0, 100], [10, 0, 100], [0, 0, 300.5], [-10, 0, 100], [0, 0, 150], [0, 0, 70]]
axes = [
    { lower = -170, upper = 170, velocity = 200 },
    { lower = -100, upper = 100, velocity = 200, acceleration = 700.5 },
    { lower = -100, upper = 100, velocity = 200 },
    { lower = -100, upper = 100, velocity = 200 },
    { lower = -100, upper = 100, velocity = 200 },
    { lower = -360, upper = 360, velocity = 400, linear = false },
    { lower = 0, upper = 1500, velocity = 1000, linear = true },
]
home = [0, 0, 90, 0, 90, 0, 10]
[path]
speed = 250
"""


@pytest.fixture
def english():
    before = i18n.current()
    i18n.use("en")
    yield
    i18n.use(before)


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_built_in_models_are_named_in_any_spelling(name):
    model = load_model(name)
    assert model.name == name
    for spelling in (name.lower(), name.replace("-", ""), name.lower().replace("-", ""), f" {name} "):
        assert load_model(spelling) == model


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_home_of_a_built_in_model_points_down_away_from_limits_and_singular_points(name):
    model = load_model(name)
    kinematics = Kinematics(model)
    flange = kinematics.forward(model.home)
    assert flange[:3, 2] == pytest.approx((0, 0, 1 if model.is_scara else -1), abs=1e-12)
    assert flange[2, 3] > 0
    assert not kinematics.is_singular(model.home)
    for position, axis in zip(model.home, model.axes, strict=True):
        assert axis.lower + 5 < position < axis.upper - 5


@pytest.mark.parametrize(
    ("name", "home"),
    [
        ("VS-050", (0, 45, 90, 0, 45, 0)),
        ("COBOTTA", (0, 30, 100, 0, 50, 0)),
        ("VE026A", (0, 30, 120, 0, 30, 0, 0)),
    ],
)
def test_documented_home_poses(name, home):
    assert load_model(name).home == home


def test_vs050_is_the_published_arm():
    model = load_model("VS-050")
    assert model.type_name == "VS050A3-AV6-NNN-NNN"
    assert model.origins[3] == (-10, 0, 119.5)
    assert [axis.velocity for axis in model.axes] == [425, 340, 385.72, 425, 327.01, 680]
    assert model.axes[2] == AxisModel(-120, 151, 385.72, 5 * 385.72, slave_acceleration=6300)
    assert (model.path_speed, model.path_acceleration) == (1500, 7500)
    assert (model.path_rotation, model.path_rotation_acceleration) == (360, 1800)


def test_ve026a_has_its_hand_as_seventh_axis():
    assert load_model("ve026a").axes[6] == AxisModel(-36.5, 25, 180, 900)


def test_every_data_file_belongs_to_a_name():
    files = [file for file in resources.files("orinkit.arms").iterdir() if file.name.endswith(".toml")]
    found = {tomllib.loads(file.read_text(encoding="utf-8"))["name"] for file in files}
    assert found == set(MODEL_NAMES)
    assert len(files) == len(MODEL_NAMES)


@pytest.mark.parametrize("kind", [str, Path])
def test_a_users_own_file(tmp_path, kind):
    file = tmp_path / "arm.toml"
    file.write_text(GOOD, encoding="utf-8")
    model = load_model(kind(file))
    assert model == ArmModel(
        "Arm",
        "ARM-1",
        ((0, 0, 100), (10, 0, 100), (0, 0, 300.5), (-10, 0, 100), (0, 0, 150), (0, 0, 70)),
        (
            AxisModel(-170, 170, 200, 1000),
            AxisModel(-100, 100, 200, 700.5),
            *[AxisModel(-100, 100, 200, 1000)] * 3,
            AxisModel(-360, 360, 400, 2000),
            AxisModel(0, 1500, 1000, 5000, linear=True),
        ),
        (0, 0, 90, 0, 90, 0, 10),
        path_speed=250,
    )


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('name = "Arm"\n', "", "name"),
        ('name = "Arm"', "name = 7", "name"),
        ('name = "Arm"', 'name = "\\n"', "name"),
        ('"ARM-1"', '"' + "A" * 65 + '"', "type_name"),
        ("[0, 0, 70]", "[0, 0]", "origins[5]"),
        ("[0, 0, 70]", '[0, 0, "x"]', "origins[5]"),
        (", [0, 0, 70]", "", "origins"),
        ("300.5", "nan", "origins[2]"),
        ("300.5", "inf", "origins[2]"),
        ("300.5", "1" + "0" * 400, "origins[2]"),
        ("300.5", "true", "origins[2]"),
        ("300.5", "0.5", "origins[2]"),
        ("[-10, 0, 100], [0, 0, 150]", "[0, 0, 100], [0, 0, -100]", "origins[3]"),
        ("lower = -170, upper = 170", "lower = 170, upper = 170", "axes[0].lower"),
        ("lower = -170, ", "", "axes[0].lower"),
        ("upper = 170", "upper = inf", "axes[0].upper"),
        ("velocity = 400", "velocity = 0", "axes[5].velocity"),
        ("velocity = 400", "velocity = nan", "axes[5].velocity"),
        ("acceleration = 700.5", "acceleration = -1", "axes[1].acceleration"),
        ("linear = false", "linear = true", "axes[5].linear"),
        ("linear = true", "linear = 1", "axes[6].linear"),
        ("velocity = 400", "velocty = 400", "axes[5].velocty"),
        ("home = [0,", "home = [171,", "home"),
        (", 10]", "]", "home"),
        (", 10]", ", 1501]", "home"),
        ("speed = 250", "speed = 0", "path.speed"),
        ("speed = 250", "sped = 250", "path.sped"),
        ("[path]", "[paths]", "paths"),
        ("[path]\nspeed = 250", "", None),
    ],
)
def test_errors_in_a_file_name_the_key(english, old, new, key):
    assert GOOD.count(old) == 1
    text = GOOD.replace(old, new)
    if key is None:
        assert parse_model(text, "arm.toml").path_speed == 1500
        return
    with pytest.raises(ValueError) as caught:
        parse_model(text, "arm.toml")
    assert str(caught.value).startswith(f"arm.toml: {key}")


@pytest.mark.parametrize(
    "axes", ["[]", "5", "[1, 2, 3, 4, 5, 6]", "[" + "{ lower = 0, upper = 1, velocity = 1 }," * 9 + "]"]
)
def test_six_to_eight_axes(axes):
    start, end = GOOD.index("axes = "), GOOD.index("home = ")
    with pytest.raises(ValueError, match="axes"):
        parse_model(f"{GOOD[:start]}axes = {axes}\n{GOOD[end:]}", "arm.toml")


@pytest.mark.parametrize("text", ["", "x", "[" * 100_000, "a = " + "[" * 100_000, "a = " + "9" * 10_000, "\0", "a = 1"])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match=r"arm\.toml"):
        parse_model(text, "arm.toml")


@pytest.mark.parametrize("name", ["", " ", "VS-999", "x" * 10_000, "vs050\0", "/dev/zero", "."])
def test_an_unknown_name_lists_the_known_ones(name):
    with pytest.raises(ValueError, match="COBOTTA"):
        load_model(name)


def test_files_that_are_not_text_or_too_large_are_refused(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match="UTF-8"):
        load_model(file)
    file.write_bytes(b"#" * 1_000_001)
    with pytest.raises(ValueError, match="1000000"):
        load_model(file)


def test_messages_in_japanese():
    before = i18n.current()
    i18n.use("ja")
    try:
        with pytest.raises(ValueError, match="内蔵の機種: COBOTTA, "):
            load_model("VS-999")
        with pytest.raises(ValueError, match="テーブルが必要です"):
            parse_model(GOOD.replace("[path]\nspeed = 250", "path = 1").replace("home", "home", 1), "arm.toml")
    finally:
        i18n.use(before)
