"""Saved connections."""

from __future__ import annotations

import json

import pytest

from orinkit.core.errors import InvalidAddress, InvalidValue
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.tester.state.profiles import ProfileStore

SPEC = ConnectionSpec(
    "cell 1", "udp://192.168.0.1:5007", "CaoProv.DENSO.VRC9", "host", "@IfNotMember", messages=False, timeout=800, tries=1,
    debug=True, token="secret", driver=3, dialect="v2", control="tcp://127.0.0.1:1", secret="another",
)  # fmt: skip


def test_saved_connections_are_read_again(tmp_path):
    path = tmp_path / "deep" / "connections.json"
    ProfileStore(path).save(SPEC)
    (found,) = ProfileStore(path)
    assert found == ConnectionSpec(**SPEC.to_json())
    assert (found.messages, found.timeout, found.tries, found.debug, found.driver) == (False, 800, 1, True, 3)
    assert "secret" not in path.read_text()
    assert "another" not in path.read_text()


def test_delete_and_replace(tmp_path):
    store = ProfileStore(tmp_path / "c.json")
    store.save(SPEC)
    store.save(ConnectionSpec("cell 1", "tcp://10.0.0.1:5007"))
    store.save(ConnectionSpec("cell 2", "tcp://10.0.0.2:5007"))
    assert store.get("cell 1").url == "tcp://10.0.0.1:5007"
    store.delete("cell 1")
    assert [each.name for each in ProfileStore(store.path)] == ["cell 2"]


@pytest.mark.parametrize(
    "content",
    ["", "{", "3", "[1]", '[{"name": 1, "url": "tcp://a:1"}]', '[{"name": "a"}]', '[{"name": "a", "url": "x://"}]'],
)
def test_a_damaged_file_is_kept(tmp_path, content):
    path = tmp_path / "c.json"
    path.write_text(content)
    store = ProfileStore(path)
    assert list(store) == []
    assert path.read_text() == content
    store.save(SPEC)
    assert path.with_suffix(".json.bak").read_text() == content
    assert len(json.loads(path.read_text())) == 1


def test_unknown_parameters_are_ignored(tmp_path):
    path = tmp_path / "c.json"
    path.write_text('[{"name": "a", "url": "tcp://a:1", "future": 1}]')
    assert [each.name for each in ProfileStore(path)] == ["a"]


@pytest.mark.parametrize(
    "changes", [{"name": " "}, {"name": "x" * 61}, {"timeout": -1}, {"tries": 0}, {"tries": 8}, {"dialect": "v3"}]
)
def test_invalid_parameters(changes):
    with pytest.raises(InvalidValue):
        ConnectionSpec(**{"name": "a", "url": "tcp://a:1", **changes}).check()


def test_invalid_address():
    with pytest.raises(InvalidAddress):
        ConnectionSpec("a", "tcp://").check()
