"""Parameters and monitors with their units."""

from __future__ import annotations

from typing import Any

import pytest

from orinkit.abh3.session.parameter_value import ParameterValue, monitor, parameter, word_of
from orinkit.abh3.session.telabh3 import MONITORS, PARAMETERS
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core

UNKNOWN = 0x7001


def test_a_parameter_in_its_unit() -> None:
    found = parameter(0x5000, 0x00400008)  # 8e2 as PACK_FLOAT
    assert found == ParameterValue(0x5000, 0x00400008, PARAMETERS[0x5000])
    assert (found.value, found.unit) == (800.0, "min^-1")
    assert str(found) == "0x5000 A/Y velocity #0: 800 min^-1"
    i18n.use("ja")
    assert str(found) == "0x5000 A/Y 速度 #0: 800 min^-1"


def test_a_monitor_in_its_unit() -> None:
    found = monitor(0x1004, 0x01E000ED)
    assert found == ParameterValue(0x1004, 0x01E000ED, MONITORS[0x1004])
    assert (found.value, found.unit) == (pytest.approx(23.7), "V")
    assert str(found) == "0x1004 main voltage: 23.7 V"


def test_parameters_and_monitors_are_separate() -> None:
    assert monitor(0x5000, 1).item is None
    assert parameter(0x1004, 1).item is None


def test_whole_numbers_keep_all_their_digits() -> None:
    assert str(monitor(0x1054, 0x7FFFFFFF)) == "0x1054 A axis pulse count: 2147483647 pulse"
    assert str(monitor(0x1064, 0xFFFFFFFF)) == "0x1064 B axis pulse count: -1 pulse"
    assert str(monitor(0x0000, 0x80400001)) == "0x0000 error flags: 2151677953"


def test_an_unknown_address_is_its_word() -> None:
    found = parameter(UNKNOWN, 0xFFFFFFFF)
    assert (found.item, found.value, found.unit) == (None, 0xFFFFFFFF, "")
    assert str(found) == "0x7001: 4294967295"
    assert str(monitor(0x0ABC, 5)) == "0x0ABC: 5"


def test_words_of_values() -> None:
    assert word_of(0x5000, 800, raw=False) == 0x00400008
    assert word_of(0x5000, 800, raw=True) == 800
    assert word_of(0x4103, -1, raw=False) == 0xFFFFFFFF
    assert word_of(UNKNOWN, 0xFFFFFFFF, raw=True) == 0xFFFFFFFF
    assert word_of(0x4101, 250000, raw=False) == 250000


@pytest.mark.parametrize(
    ("address", "value", "raw", "said"),
    [
        (UNKNOWN, 1, False, ("raw=True", "raw=True")),
        pytest.param(10**5000, 1, False, ("address must be", "address は"), id="great"),
        (UNKNOWN, 1.0, True, ("whole number", "整数")),
        (0x5000, 800.0, True, ("whole number", "整数")),
        (0x5000, "1", True, ("whole number", "整数")),
        (0x4101, 0.5, False, ("bit rate", "ボーレート")),
        (0x5000, 1e300, False, ("velocity", "速度")),
    ],
)
def test_invalid_values(address: int, value: Any, raw: bool, said: tuple[str, str]) -> None:
    for tongue, text in zip(("en", "ja"), said, strict=True):
        i18n.use(tongue)
        with pytest.raises(InvalidValue, match=text):
            word_of(address, value, raw=raw)
