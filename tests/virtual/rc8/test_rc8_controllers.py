"""The controllers that a virtual RC8 represents: version, type, arm, and the form of errors."""

from __future__ import annotations

from datetime import datetime

import pytest

from orinkit.arms import load_model
from orinkit.core import hresult
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from orinkit.virtual.rc8.profiles import PROFILES
from support.guide_client import GuideClient

CODE = hresult.signed(hresult.TARGET_OVER_SOFT_LIMIT_AXIS1)


@pytest.fixture
def client(request):
    made = GuideClient(**getattr(request, "param", {}))
    yield made
    made.close()


def of_controller(client, name):
    return client.call("Variable_GetValue", client.value("Controller_GetVariable", client.controller, name, ""))


def of_robot(client, name):
    return client.call("Variable_GetValue", client.value("Robot_GetVariable", client.robot, name, ""))


@pytest.mark.field("3.3")
@pytest.mark.parametrize(
    ("client", "version", "type_name"),
    [
        ({}, "2.6.0", "VS050A3-AV6-NNN-NNN"),
        ({"controller": "RC8A"}, "2.13.0", "VS050A3-AV6-NNN-NNN"),
        ({"controller": "rc9"}, "1.0.0", "CVRB-0609W4 B"),
        ({"controller": "cobotta"}, "2.13.0", "CVR038A1-AV6-NNN-NNN"),
        ({"version": "2.13.4"}, "2.13.4", "VS050A3-AV6-NNN-NNN"),
        ({"controller": "rc9", "version": "1.4.1", "model": "VM-60B1"}, "1.4.1", "VM60B1-AV6-NNN-NNN"),
    ],
    indirect=["client"],
)
def test_version_and_arm(client, version, type_name):
    assert of_controller(client, "@VERSION") == Variant(VarType.BSTR, version)
    assert of_robot(client, "@TYPE_NAME") == Variant(VarType.BSTR, type_name)


@pytest.mark.parametrize("client", [{"controller": name} for name in PROFILES], indirect=True, ids=PROFILES)
def test_type(client):
    profile = client.rc8.state.profile
    assert of_controller(client, "@TYPE") == Variant(VarType.BSTR, profile.type)
    assert client.rc8.state.arm.model == load_model(profile.model)


@pytest.mark.field("2.9")
@pytest.mark.parametrize("client", [{"model": "VS-060", "type_name": "VS060A3-AV6-NNN-NNN"}], indirect=True)
def test_type_name_of_the_arm(client):
    name = Variant(VarType.BSTR, "VS060A3-AV6-NNN-NNN")
    assert of_robot(client, "@TYPE_NAME") == name
    assert client.call("Robot_Execute", client.robot, "GetRobotTypeName", None) == name


def current_error(client):
    client.rc8.raise_error(CODE)
    return client.call("Controller_Execute", client.controller, "GetCurErrorInfo", 0).value


@pytest.mark.field("3.3")
@pytest.mark.parametrize("client", [{"controller": "rc9"}], indirect=True)
def test_errors_of_an_rc9(client):
    *items, moment = current_error(client)
    assert [item.type for item in items] == [
        VarType.I4,
        VarType.BSTR,
        VarType.I4,
        VarType.I4,
        VarType.BSTR,
        VarType.I4,
        VarType.I4,
    ]
    assert (items[0].value, items[2].value) == (CODE, CODE)
    assert moment.type == VarType.DATE
    assert abs((moment.value - client.rc8.state.calendar.now()).total_seconds()) < 1.5
    assert isinstance(moment.value, datetime)


def test_errors_of_an_rc8(client):
    items = current_error(client)
    assert len(items) == 7
    assert (items[0].value, items[2].value) == (CODE, 0)


@pytest.mark.parametrize(
    "settings", [{"controller": "rc7"}, {"controller": ""}, {"type_name": " "}, {"type_name": "a\n"}]
)
def test_invalid_settings(settings):
    with pytest.raises(ValueError, match=r"controller .*rc8, rc8a, rc9, cobotta|type name"):
        VirtualRC8(**settings)
