"""Stored poses."""

from __future__ import annotations

import pytest

from orinkit.core.errors import InvalidValue
from orinkit.tester.state.arm.poses import PoseStore

JOINTS = (0.0, 45.0, 90.0, 0.0, 45.0, 0.0)


def test_poses_are_kept_for_each_type_of_arm(tmp_path):
    store = PoseStore(tmp_path / "orinkit" / "poses.json")
    store.save("Home", "VS050", JOINTS)
    store.save("家", "VS050", JOINTS)
    store.save("Home", "VE026A", (*JOINTS, 1.0))
    store.save("Home", "VS050", (1.0, *JOINTS[1:]))
    again = PoseStore(store.path)
    assert [(pose.name, pose.joints[0]) for pose in again.of("VS050")] == [("Home", 1.0), ("家", 0.0)]
    again.delete(next(again.of("VS050")))
    assert [pose.name for pose in PoseStore(store.path).of("VS050")] == ["家"]
    assert [pose.joints for pose in again.of("VE026A")] == [(*JOINTS, 1.0)]


@pytest.mark.parametrize("name", ["", "  ", "x" * 61, "a\nb"])
def test_invalid_names_are_refused(tmp_path, name):
    store = PoseStore(tmp_path / "poses.json")
    with pytest.raises(InvalidValue):
        store.save(name, "VS050", JOINTS)
    assert not store.path.exists()


@pytest.mark.parametrize("joints", [(), (1.0,), (float("nan"),) * 6])
def test_invalid_joints_are_refused(tmp_path, joints):
    with pytest.raises(InvalidValue):
        PoseStore(tmp_path / "poses.json").save("Home", "VS050", joints)


@pytest.mark.parametrize("text", ["", "{", "[1]", '[{"name": "a"}]', '{"a": 1}'])
def test_a_damaged_file_is_kept_as_a_copy(tmp_path, text):
    path = tmp_path / "poses.json"
    path.write_text(text)
    store = PoseStore(path)
    assert not list(store.of("VS050"))
    assert path.read_text() == text
    store.save("Home", "VS050", JOINTS)
    assert path.with_suffix(".json.bak").read_text() == text
